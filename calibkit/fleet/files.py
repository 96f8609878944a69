"""The files of a finished fleet: its table as CSV and Parquet, a page, control charts, and a sealed
record of all of them.
"""

from collections.abc import Mapping
from typing import Any

from calibkit.commands import run_content
from calibkit.fleet import page
from calibkit.fleet.device import DeviceTask
from calibkit.fleet.table import FleetTable
from calibkit.records import sealed, store
from calibkit.records.version import SOFTWARE
from calibkit.report import control_charts, figures as drawing
from calibkit.report.control_charts import ControlChart
from calibkit.report.table import Cell, Column, Table, number_or_none, tabulate

DEVICE_KEYS = ("serial", "run", "run_sha256", "verdict", "error", "flags")
TEXTS = ("serial", "run", "run_sha256", "verdict", "error", "outlier_in")


def make_files(table: FleetTable, plan: DeviceTask, title: str) -> dict[str, bytes]:
    """File name → bytes of every file of a finished fleet."""
    flat = _flat_table(table)
    contents = {"fleet.csv": flat.to_csv().encode()}
    parquet = _parquet(flat)
    if parquet is not None:
        contents["fleet.parquet"] = parquet
    contents[page.PAGE] = page.make_page(title, table)
    if table.charts:
        contents["control_charts.pdf"] = drawing.pdf(control_charts.pages(title, table.charts))
    return {
        store.FLEET_FILE: sealed.seal(_document(table, plan, contents)).encode(),
        **contents,
    }


def _document(table: FleetTable, plan: DeviceTask, contents: Mapping[str, bytes]) -> dict[str, Any]:
    """fleet.json: recipe, devices with the digests of their runs, lines of every control chart,
    digests of the files.
    """
    return {
        "format": store.FLEET_FORMAT,
        "software": SOFTWARE,
        "effective_from": plan.date_of(entry.effective_from for entry in table.entries),
        "recipe": run_content.describe_recipe(plan.source),
        "units": tabulate("", DEVICE_KEYS, table.entries).to_objects(),
        "figures": [_figure(table, chart) for chart in table.charts],
        "files": store.list_files(contents),
    }


def _figure(table: FleetTable, chart: ControlChart) -> dict[str, Any]:
    """Lines and outliers of one control chart; a limit is null where no device can be judged."""
    control = chart.control
    outliers = [outlier for outlier in table.outliers if outlier.figure == chart.name]
    return {
        "name": chart.name,
        "unit": chart.unit,
        "units": len(chart.serials),
        "centre": control.centre,
        "sigma": control.sigma,
        "limit_sigma": number_or_none(control.limit),
        "outliers": tabulate("", ("serial", "value", "z"), outliers).to_objects(),
    }


def _flat_table(table: FleetTable) -> Table:
    """One row per device: what became of it, then each key figure, and its uncertainty where one is
    stated.
    """
    columns: list[Column] = []
    numbers: list[dict[str, float]] = []
    for chart in table.charts:
        columns.append(Column(f"{chart.name} [{chart.unit}]", unit=chart.unit))
        numbers.append(dict(zip(chart.serials, chart.values.tolist(), strict=True)))
        if any(chart.standard_uncertainties > 0.0):
            columns.append(Column(f"u({chart.name}) [{chart.unit}]", unit=chart.unit))
            uncertainties = chart.standard_uncertainties.tolist()
            numbers.append(dict(zip(chart.serials, uncertainties, strict=True)))
    stands_out: dict[str, list[str]] = {}
    for outlier in table.outliers:
        stands_out.setdefault(outlier.serial, []).append(f"{outlier.figure} (z = {outlier.z:.3g})")
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            entry.serial,
            entry.run,
            entry.run_sha256,
            entry.verdict,
            " ".join(entry.error.split()),
            "; ".join(stands_out.get(entry.serial, ())),
            *(values.get(entry.serial) for values in numbers),
        )
        for entry in table.entries
    )
    return Table("", (*TEXTS, *columns), rows)


def _parquet(table: Table) -> bytes | None:
    """Table as Parquet, the unit of each column in its metadata; None without pyarrow."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        return None
    fields = [
        pa.field(column.head, pa.float64(), metadata={"unit": column.unit})
        if column.unit
        else pa.field(column.head, pa.string())
        for column in table.formats
    ]
    sink = pa.BufferOutputStream()
    parquet.write_table(pa.Table.from_pylist(table.to_objects(), pa.schema(fields)), sink)
    return bytes(sink.getvalue())

"""The files of a finished fleet: its table as CSV, a page, and a sealed record of both."""

from calibkit.commands import run_content
from calibkit.fleet import page
from calibkit.fleet.device import DeviceTask
from calibkit.fleet.table import FleetTable
from calibkit.records import sealed, store
from calibkit.records.version import SOFTWARE
from calibkit.report.table import Cell, Column, Table, number_or_none, tabulate

DEVICE_KEYS = ("serial", "run", "run_sha256", "verdict", "error", "flags")
TEXTS = ("serial", "run", "run_sha256", "verdict", "error", "outlier_in")


def make_files(table: FleetTable, plan: DeviceTask, title: str) -> dict[str, bytes]:
    """File name → bytes of every file of a finished fleet: fleet.json has the recipe, devices with
    the digests of their runs, the lines of every control chart, and the digests of the files.
    """
    contents = {
        "fleet.csv": _flat_table(table).to_csv().encode(),
        page.PAGE: page.make_page(title, table),
    }
    figures = []
    for chart in table.charts:
        outliers = [outlier for outlier in table.outliers if outlier.figure == chart.name]
        entry = {
            "name": chart.name,
            "unit": chart.unit,
            "units": len(chart.serials),
            "centre": chart.control.centre,
            "sigma": chart.control.sigma,
            # null where no device can be judged
            "limit_sigma": number_or_none(chart.control.limit),
            "outliers": tabulate("", ("serial", "value", "z"), outliers).to_objects(),
        }
        figures.append(entry)
    document = {
        "format": store.FLEET_FORMAT,
        "software": SOFTWARE,
        "effective_from": plan.date_of(entry.effective_from for entry in table.entries),
        "recipe": run_content.describe_recipe(plan.source),
        "units": tabulate("", DEVICE_KEYS, table.entries).to_objects(),
        "figures": figures,
        "files": store.list_files(contents),
    }
    return {store.FLEET_FILE: sealed.seal(document).encode(), **contents}


def _flat_table(table: FleetTable) -> Table:
    """One row per device: what became of it, then each key figure, and its uncertainty where one is
    stated.
    """
    columns: list[Column] = []
    numbers: list[dict[str, float]] = []
    for chart in table.charts:
        columns.append(Column(f"{chart.name} [{chart.unit}]"))
        numbers.append(dict(zip(chart.serials, chart.values.tolist(), strict=True)))
        if any(chart.standard_uncertainties > 0.0):
            columns.append(Column(f"u({chart.name}) [{chart.unit}]"))
            uncertainties = chart.standard_uncertainties.tolist()
            numbers.append(dict(zip(chart.serials, uncertainties, strict=True)))
    rows: list[tuple[Cell, ...]] = []
    for entry in table.entries:
        outlying = [
            f"{outlier.figure} (z = {outlier.z:.3g})"
            for outlier in table.outliers
            if outlier.serial == entry.serial
        ]
        device = (entry.serial, entry.run, entry.run_sha256, entry.verdict)
        reasons = (" ".join(entry.error.split()), "; ".join(outlying))
        rows.append((*device, *reasons, *(values.get(entry.serial) for values in numbers)))
    return Table("", (*TEXTS, *columns), tuple(rows))

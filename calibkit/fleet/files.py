"""The files that tell of a fleet: table as CSV and Parquet, control charts, and a sealed record of
all of them.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
from typing import TYPE_CHECKING, Any

from calibkit import coefficients, pipeline, store
from calibkit.report import control_charts
from calibkit.report import figures as drawing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.fleet.table import Column, Table
    from calibkit.fleet.unit import Plan

TEXT = ("serial", "run", "run_sha256", "verdict", "error", "outlier_in")


def of(table: Table, plan: Plan, title: str) -> dict[str, bytes]:
    """File name → bytes of everything that tells of a fleet."""
    contents = {"fleet.csv": csv_of(table)}
    parquet = parquet_of(table)
    if parquet is not None:
        contents["fleet.parquet"] = parquet
    if table.charts:
        contents["control_charts.pdf"] = drawing.pdf(control_charts.pages(title, table.charts))
    return {
        store.FLEET_FILE: coefficients.seal(document(table, plan, contents)).encode(),
        **contents,
    }


def document(table: Table, plan: Plan, contents: Mapping[str, bytes]) -> dict[str, Any]:
    """fleet.json: recipe, units with the digests of their runs, lines of every control chart,
    digests of the files.
    """
    return {
        "format": store.FLEET_FORMAT,
        "software": pipeline.SOFTWARE,
        "effective_from": plan.date,
        "recipe": {
            "name": plan.source.name,
            "sha256": plan.source.sha256,
            "overrides": list(plan.source.overrides),
            "text": plan.source.text,
        },
        "units": [
            {
                "serial": entry.serial,
                "run": entry.run,
                "run_sha256": entry.run_sha256,
                "verdict": entry.verdict,
                "error": entry.error,
                "flags": entry.flags,
            }
            for entry in table.entries
        ],
        "figures": [_figure(table, number) for number in range(len(table.charts))],
        "files": [
            {"name": name, "sha256": hashlib.sha256(content).hexdigest()}
            for name, content in sorted(contents.items())
        ],
    }


def _figure(table: Table, number: int) -> dict[str, Any]:
    """Lines and outliers of one control chart; a limit is null where no unit can be judged."""
    chart = table.charts[number]
    control = chart.control
    return {
        "name": chart.name,
        "unit": chart.unit,
        "units": len(chart.serials),
        "centre": control.centre,
        "sigma": control.sigma,
        "limit_sigma": control.limit if math.isfinite(control.limit) else None,
        "outliers": [
            {"serial": outlier.serial, "value": outlier.value, "z": outlier.z}
            for outlier in table.outliers
            if outlier.figure == chart.name
        ],
    }


def _texts(table: Table) -> list[tuple[str, ...]]:
    """Cells of the columns that hold text, a tuple a unit."""
    named: dict[str, list[str]] = {}
    for outlier in table.outliers:
        named.setdefault(outlier.serial, []).append(f"{outlier.figure} (z = {outlier.z:.3g})")
    return [
        (
            entry.serial,
            entry.run,
            entry.run_sha256,
            entry.verdict,
            " ".join(entry.error.split()),
            "; ".join(named.get(entry.serial, ())),
        )
        for entry in table.entries
    ]


def _numbers(columns: Sequence[Column]) -> list[tuple[str, str, tuple[float, ...]]]:
    """Header, unit and values of the columns that hold numbers: each figure, and its uncertainty
    where one is stated.
    """
    found = []
    for column in columns:
        found.append((f"{column.name} [{column.unit}]", column.unit, column.values))
        if any(uncertainty > 0.0 for uncertainty in column.standard_uncertainties):
            found.append(
                (f"u({column.name}) [{column.unit}]", column.unit, column.standard_uncertainties)
            )
    return found


def csv_of(table: Table) -> bytes:
    """Table as CSV with one header line; numbers keep every digit, a figure that a unit lacks is an
    empty field.
    """
    numbers = _numbers(table.columns)
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([*TEXT, *(header for header, _, _ in numbers)])
    for row, texts in enumerate(_texts(table)):
        values = (column[row] for _, _, column in numbers)
        writer.writerow([*texts, *("" if math.isnan(value) else repr(value) for value in values)])
    return buffer.getvalue().encode()


def parquet_of(table: Table) -> bytes | None:
    """Table as Parquet, the unit of each column in its metadata; None without pyarrow."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        return None
    texts = zip(*_texts(table), strict=True)
    fields = [pa.field(name, pa.string()) for name in TEXT]
    arrays = [pa.array(cells, pa.string()) for cells in texts]
    for header, unit, values in _numbers(table.columns):
        fields.append(pa.field(header, pa.float64(), metadata={"unit": unit}))
        arrays.append(
            pa.array([None if math.isnan(value) else value for value in values], pa.float64())
        )
    sink = pa.BufferOutputStream()
    parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), sink)
    return bytes(sink.getvalue())

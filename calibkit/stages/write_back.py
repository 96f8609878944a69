"""A log written again, row for row and column for column, with some of its columns replaced."""

from __future__ import annotations

import contextlib
import csv
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import CalibkitError, FrameError, LogFormatError
from calibkit.readers import delimited, registry, tokens
from calibkit.stages import ingest

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import pandas as pd
    from numpy.typing import NDArray

    from calibkit.readers.table import Table
    from calibkit.recipe import Recipe


def replaced(
    recipe: Recipe,
    path: Path,
    columns: Mapping[str, NDArray[np.float64]],
    derived: Mapping[str, NDArray[np.float64]] | None = None,
) -> bytes:
    """Bytes of a log with canonical columns replaced, in the log's own unit and sign, and derived ones added behind.

    Every other field keeps its own characters. A reference column that a derived one would shadow is renamed
    reference_<column>. Numbers are written with the fewest digits that read back to the same float64. A log in another
    dialect or format is written as comma-separated UTF-8 with decimal points, every row and column of it.
    """
    log = _fields(recipe, path)
    own = {name: _source(recipe, name, log, path) for name in columns}
    texts = {
        log.header.index(own[name]): _texts(_own_unit(recipe, name, values, log, own[name]))
        for name, values in columns.items()
    }
    added = derived or {}
    names = [f"reference_{name}" if name in added else name for name in log.header]
    extra = [_texts(values) for values in added.values()]
    for text in (*texts.values(), *extra):
        if len(text) != len(log.rows):
            raise FrameError(
                f"{path.name}: {len(log.rows)} rows in, {len(text)} compensated",
                hint=_every_row(recipe, path),
            )
    for column, text in texts.items():
        for row, fields in enumerate(log.rows):
            fields[column] = text[row]
    lines = [[*fields, *(text[row] for text in extra)] for row, fields in enumerate(log.rows)]
    return _written([[*names, *added], *lines], quotes=log.quotes)


def _every_row(recipe: Recipe, path: Path) -> str:
    """What to do where counts since the row before leave the first row without a value: state their interval [s]."""
    said = "counts since the row before give the first row no value"
    counted = {name: column for name, column in recipe.columns.items() if column.interval_s is None}
    per_sample = [name for name, column in counted.items() if column.unit == "1/sample" and not column.accumulated]
    if not per_sample or any(column.accumulated for column in counted.values()):
        return f'{said}: map rates, or counts per sample (unit = "1/sample") with interval_s, the interval of a sample'
    usual = "SECONDS"
    with contextlib.suppress(CalibkitError):
        time = ingest.read_one(recipe, path, path.name, ("time_s",)).frame["time_s"].to_numpy(dtype=np.float64)
        usual = f"{float(np.median(np.diff(time))):.9g}"
    mapped = " ".join(f"--set columns.{name}.interval_s={usual}" for name in per_sample)
    return f"{said}: state the interval of a sample, and every row has one: {mapped} (the usual one of this log)"


@dataclass(frozen=True, slots=True)
class _Fields:
    """A log as characters: names, units that the header states, fields of each row; quotes where a field may hold a comma."""

    header: list[str]
    units: Mapping[str, str]
    rows: list[list[str]]
    quotes: bool


def _fields(recipe: Recipe, path: Path) -> _Fields:
    """Fields of a log: clean CSV as it stands, any other dialect or format by its reader."""
    data = delimited.load(path, path.name)
    if recipe.logs.format in {"auto", "csv"} and delimited.looks_clean(data):
        try:
            header, body = delimited.split(data, path.name)
            delimited.count_fields(body, len(header), path.name)
        except LogFormatError:
            if recipe.logs.format == "csv":
                raise
        else:
            rows = [line.split(",") for line in body.decode().rstrip("\n").split("\n")]
            stated = {name: units.of_header(name) for name in header}
            return _Fields(header, stated, rows, quotes=False)
    table = registry.read(path, path.name, recipe.logs, ())
    columns = [_characters(table.frame[name], table) for name in table.frame.columns]
    return _Fields(
        list(map(str, table.frame.columns)), table.units, list(map(list, zip(*columns, strict=True))), quotes=True
    )


def _characters(column: pd.Series, table: Table) -> list[str]:
    """A column's own characters with decimal points, or its numbers."""
    if column.dtype.kind == "f":
        return _texts(column.to_numpy(dtype=np.float64))
    commas = any(line.startswith("decimal = ','") for line in table.reading)
    texts = [str(text) for text in column.fillna("")]
    if not commas:
        return texts
    return [text.replace(",", ".") if tokens.NUMBER[","].fullmatch(text) else text for text in texts]


def _written(lines: list[list[str]], *, quotes: bool) -> bytes:
    """Comma-separated UTF-8."""
    if not quotes:
        return "".join(",".join(fields) + "\n" for fields in lines).encode()
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(lines)
    return stream.getvalue().encode()


def _source(recipe: Recipe, name: str, log: _Fields, path: Path) -> str:
    """Name that a canonical column has in the log, with or without the unit behind it."""
    source = recipe.columns[name].source if name in recipe.columns else name
    if source in log.header:
        return source
    found = [header for header in log.header if units.name_without_unit(header) == source]
    if len(found) != 1:
        raise FrameError(f"{path.name}: no column '{source}'", hint="check [columns] of the recipe")
    return found[0]


def _own_unit(recipe: Recipe, name: str, values: NDArray[np.float64], log: _Fields, header: str) -> NDArray[np.float64]:
    """Values in the unit and sign that the log's own column has."""
    column, stated = recipe.columns.get(name), log.units.get(header, "")
    if column is not None:
        return ingest.unmapped(values, column, name, recipe, stated)
    target = units.column_unit(name)
    return units.convert(values, target, stated or target, gravity_mps2=recipe.site.gravity_mps2)


def _texts(values: NDArray[np.float64]) -> list[str]:
    """Shortest texts that read back to the same numbers; a missing value is an empty field."""
    return ["" if np.isnan(value) else repr(value) for value in values.tolist()]

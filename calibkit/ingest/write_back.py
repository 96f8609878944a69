"""A log written again, row by row and column by column, with some of its columns replaced."""

from __future__ import annotations

import contextlib
import csv
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calibkit import units
from calibkit.errors import CalibkitError, FrameError, LogFormatError
from calibkit.ingest import mapping
from calibkit.ingest.column_values import unmap_values
from calibkit.numeric import chunks
from calibkit.readers import clean, delimited, registry, tokens
from calibkit.recipe import Column
from calibkit.recipe.logs import AUTO

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    import pandas as pd

    from calibkit.arrays import Array
    from calibkit.recipe import Recipe


Applied: TypeAlias = "tuple[Iterable[bytes], tuple[str, ...]]"
"""A compensated log: the new file's bytes, part by part, and the flags."""
_CSV = frozenset({AUTO, "csv"})
BLOCK = 1 << 18
"""Bytes of a log that are rewritten at a time."""


def rewrite_log(
    recipe: Recipe,
    path: Path,
    columns: Mapping[str, Array],
    derived: Mapping[str, Array] | None = None,
) -> Iterator[bytes]:
    """Bytes of a log, part by part, with canonical columns replaced and derived ones added behind.

    Columns are written in the log's own unit and sign; every other field keeps its own characters.
    A reference column that a derived one would shadow is renamed reference_<column>. Numbers are
    written with the fewest digits that read back to the same float64. A log in another dialect or
    format is written as comma-separated UTF-8 with decimal points, every row and column of it.
    Clean CSV takes the memory of a block.

    Raises FrameError or LogFormatError before the first part for what the log lacks, and
    LogFormatError in between where the log changes meanwhile.
    """
    log = _scan_clean(recipe, path) or _read_fields(recipe, path)
    added = derived or {}
    own = {name: _find_source(recipe, name, log, path) for name in columns}
    for values in (*columns.values(), *added.values()):
        if len(values) != log.count:
            raise FrameError(
                f"{path.name}: {log.count} rows in, {len(values)} compensated",
                hint=_interval_advice(recipe, path),
            )

    return _rewrite_blocks(recipe, log, columns, own, added, path.name)


def _rewrite_blocks(
    recipe: Recipe,
    log: _Fields,
    columns: Mapping[str, Array],
    own: Mapping[str, str],
    added: Mapping[str, Array],
    file: str,
) -> Iterator[bytes]:
    """Bytes of a log, block by block: canonical columns in place of its own ones (`own`, by
    canonical name), and added ones behind.
    """
    names = (f"reference_{name}" if name in added else name for name in log.header)
    yield _format_csv([[name] for name in (*names, *added)], quotes=log.quotes)
    row = 0
    for block in log.blocks():
        stop, fields = row + len(block[0]), list(block)
        if stop > log.count:
            break
        for name, source in own.items():
            mapped = recipe.columns.get(name) or Column(source=source)
            stated = log.units.get(source, "")
            values = unmap_values(columns[name][row:stop], mapped, name, recipe, stated)
            fields[log.header.index(source)] = _format_numbers(values)
        fields += [_format_numbers(values[row:stop]) for values in added.values()]
        chunks.release(*columns.values(), *added.values())
        yield _format_csv(fields, quotes=log.quotes)
        row = stop
    if row != log.count:
        raise clean.changed(file)


def _interval_advice(recipe: Recipe, path: Path) -> str:
    """Hint where counts since the row before leave the first row without a value: state their
    interval [s].
    """
    reason = "counts since the row before give the first row no value"
    counted = {name: column for name, column in recipe.columns.items() if column.interval_s is None}
    per_sample = [
        name
        for name, column in counted.items()
        if column.unit == "1/sample" and not column.accumulated
    ]
    if not per_sample or any(column.accumulated for column in counted.values()):
        return (
            f'{reason}: map rates, or counts per sample (unit = "1/sample") with interval_s, the'
            " interval of a sample"
        )
    usual = "SECONDS"
    with contextlib.suppress(CalibkitError):
        log = mapping.read_file(recipe, path, path.name, ("time_s",))
        time = log.frame["time_s"].to_numpy(dtype=np.float64)
        usual = f"{float(np.median(np.diff(time))):.9g}"
    mapped = " ".join(f"--set columns.{name}.interval_s={usual}" for name in per_sample)
    return (
        f"{reason}: state the interval of a sample, and every row has one: {mapped} (the usual one"
        " of this log)"
    )


@dataclass(frozen=True, slots=True)
class _Fields:
    """A log as characters: names, units that the header states, number of rows, and the fields of
    each column for one block of rows after the other.

    `quotes`: whether a field may hold a comma.
    """

    header: list[str]
    units: Mapping[str, str]
    count: int
    blocks: Callable[[], Iterable[list[list[str]]]]
    quotes: bool


def _scan_clean(recipe: Recipe, path: Path) -> _Fields | None:
    """Fields of clean CSV as they are in the file, which is read block by block; None of any other
    log.
    """
    scan = clean.scan_file(path, path.name) if recipe.logs.format in _CSV else None
    if scan is None:
        return None
    stated = {name: units.unit_in_header(name) for name in scan.header}
    return _Fields(
        list(scan.header),
        stated,
        scan.rows,
        lambda: _read_blocks(path, len(scan.header)),
        quotes=False,
    )


def _read_blocks(path: Path, width: int) -> Iterator[list[list[str]]]:
    """Fields of each column of clean CSV, one block of lines after the other; raises LogFormatError
    where it cannot be read.
    """
    with delimited.open_log(path, path.name) as stream:
        stream.readline()
        while block := stream.read(BLOCK):
            lines = (block + stream.readline()).decode().replace("\r\n", "\n").removesuffix("\n")
            fields = lines.replace("\n", ",").split(",")
            if len(fields) != width * (lines.count("\n") + 1):
                raise clean.changed(path.name)
            yield [fields[number::width] for number in range(width)]


def _read_fields(recipe: Recipe, path: Path) -> _Fields:
    """Fields of a log: of CSV as they are, of any other dialect or format by its reader."""
    data, _ = delimited.read_bytes(path, path.name)
    if recipe.logs.format in _CSV and delimited.looks_clean(data):
        try:
            header, body = delimited.split_header(data, path.name)
            delimited.require_fields(body, len(header), path.name)
        except LogFormatError:
            if recipe.logs.format == "csv":
                raise
        else:
            rows = [line.split(",") for line in body.decode().rstrip("\n").split("\n")]
            columns = list(map(list, zip(*rows, strict=True)))
            stated = {name: units.unit_in_header(name) for name in header}
            return _Fields(header, stated, len(rows), lambda: [columns], quotes=False)
    table = registry.read(path, path.name, recipe.logs, ())
    columns = [_format_column(table.frame[name], table.decimal) for name in table.frame.columns]
    return _Fields(
        list(map(str, table.frame.columns)),
        table.units,
        len(table.frame),
        lambda: [columns],
        quotes=True,
    )


def _format_column(column: pd.Series, decimal: str) -> list[str]:
    """A column's own characters with decimal points, or its numbers."""
    if column.dtype.kind == "f":
        return _format_numbers(column.to_numpy(dtype=np.float64))
    texts = map(str, column.fillna(""))
    if decimal == ".":
        return list(texts)
    return [
        text.replace(",", ".") if tokens.NUMBER[","].fullmatch(text) else text for text in texts
    ]


def _format_csv(columns: list[list[str]], *, quotes: bool) -> bytes:
    """Comma-separated UTF-8."""
    if not quotes:
        return ("\n".join(map(",".join, zip(*columns, strict=True))) + "\n").encode()
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(zip(*columns, strict=True))
    return stream.getvalue().encode()


def _find_source(recipe: Recipe, name: str, log: _Fields, path: Path) -> str:
    """Name that a canonical column has in the log, with or without the unit behind it."""
    source = recipe.columns[name].source if name in recipe.columns else name
    if source in log.header:
        return source
    found = [header for header in log.header if units.name_without_unit(header) == source]
    if len(found) != 1:
        raise FrameError(f"{path.name}: no column '{source}'", hint="check [columns] of the recipe")
    return found[0]


def _format_numbers(values: Array) -> list[str]:
    """Shortest texts that read back to the same numbers; a missing value is an empty field."""
    texts = list(map(repr, values.tolist()))
    for row in np.flatnonzero(np.isnan(values)).tolist():
        texts[row] = ""
    return texts

"""A log written again, row by row and column by column, with some of its columns replaced."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calibkit import units
from calibkit.errors import FrameError, LogFormatError
from calibkit.frame import values
from calibkit.ingest.column_values import unmap_values
from calibkit.ingest.text_lines import STATUS, TextLines
from calibkit.numeric import chunks
from calibkit.readers import clean, delimited, in_memory, registry, tokens
from calibkit.recipe import ColumnMapping
from calibkit.recipe.logs import AUTO

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.arrays import Array, Integers
    from calibkit.frame import Log
    from calibkit.readers.table import Table
    from calibkit.recipe import Recipe


Applied: TypeAlias = "tuple[Rewritten, tuple[str, ...]]"
"""A compensated log and the flags."""
_CSV = frozenset({AUTO, "csv"})
BLOCK = 1 << 18
"""Bytes of a log that are rewritten at a time."""


@dataclass(frozen=True, slots=True)
class Rewritten:
    """A log with its canonical columns `replaced` and others `added`, each along all rows of the
    file; iterated over, the bytes of the new file, part by part.

    `columns` are the replaced ones along the rows of the log's frame, `sources` has their names in
    the log, `uncorrected` the rows of the file by the reason why they could not be corrected, and
    `keep` whether these keep what was logged.
    """

    recipe: Recipe
    file: str
    log: Log
    fields: _RowFields
    columns: Mapping[str, Array]
    replaced: Mapping[str, Array]
    sources: Mapping[str, str]
    added: Mapping[str, Array]
    uncorrected: tuple[tuple[str, Integers], ...]
    keep: bool = False

    def __iter__(self) -> Iterator[bytes]:
        """Bytes of the new file; raises LogFormatError where the log changes meanwhile."""
        lines, quotes = self.fields.lines, self.fields.quotes or bool(self.uncorrected)
        status = (STATUS,) if self.uncorrected else ()
        shadowed = {*self.added, *status} & {*self.fields.header}
        renamed = {name: f"reference_{name}" for name in shadowed}
        if lines is not None:
            count = self.fields.count
            replaced = {k: self._texts(name, 0, count) for k, name in self._places()}
            added = {name: _format_numbers(values) for name, values in self.added.items()}
            yield lines.write(replaced, added, self._status(0, count), renamed)
            return
        header = [renamed.get(name, name) for name in self.fields.header]
        yield _format_csv([[name] for name in (*header, *self.added, *status)], quotes=quotes)
        row = 0
        for block in self.fields.blocks():
            stop, fields = row + len(block[0]), list(block)
            if stop > self.fields.count:
                break
            for k, name in self._places():
                texts = zip(self._texts(name, row, stop), block[k], strict=True)
                fields[k] = [logged if text is None else text for text, logged in texts]
            fields += [_format_numbers(values[row:stop]) for values in self.added.values()]
            fields += [self._status(row, stop) for _ in status]
            yield _format_csv(fields, quotes=quotes)
            row = stop
        if row != self.fields.count:
            raise clean.changed(self.file)

    def _places(self) -> list[tuple[int, str]]:
        """Number of each replaced column in the log, and its canonical name."""
        return [(self.fields.header.index(source), name) for name, source in self.sources.items()]

    def _texts(self, name: str, row: int, stop: int) -> list[str | None]:
        """Fields of a replaced column from one row to another, in the log's own unit and sign; None
        where what was logged is kept.
        """
        numbers = self._numbers(name, row, stop)
        texts: list[str | None] = [*_format_numbers(numbers)]
        for _, rows in self.uncorrected if self.keep else ():
            for k in rows[(rows >= row) & (rows < stop)].tolist():
                texts[k - row] = None
        return texts

    def _numbers(self, name: str, row: int, stop: int) -> Array:
        """Values of a replaced column from one row to another, in the log's own unit and sign."""
        source = self.sources[name]
        mapped = self.recipe.columns.get(name) or ColumnMapping(source=source)
        header_unit = self.fields.units.get(source, "")
        return unmap_values(self.replaced[name][row:stop], mapped, name, self.recipe, header_unit)

    def as_frame(self, logged: pd.DataFrame) -> pd.DataFrame:
        """The new log as a frame, where `logged` is the log: its index and columns stay; a table in
        place of the log has an index of its own.
        """
        import pandas as pd

        count = self.fields.count
        if self.fields.header != list(map(str, logged.columns)) or count != len(logged):
            return pd.read_csv(io.BytesIO(b"".join(self)))
        corrected, status = logged.copy(), self._status(0, count)
        for name, source in self.sources.items():
            numbers = self._numbers(name, 0, count)
            for _, rows in self.uncorrected if self.keep else ():
                numbers[rows] = logged[source].to_numpy()[rows]
            corrected[source] = numbers
        corrected = corrected.rename(
            columns={name: f"reference_{name}" for name in (*self.added, STATUS)}
        )
        corrected = corrected.assign(**self.added)
        return corrected.assign(**{STATUS: status}) if status else corrected

    def _status(self, row: int, stop: int) -> list[str]:
        """Why each row from one to another is not corrected, "" for one that is; empty where all
        rows of the log are.
        """
        if not self.uncorrected:
            return []
        words = [""] * (stop - row)
        for reason, rows in self.uncorrected:
            for k in rows[(rows >= row) & (rows < stop)].tolist():
                words[k - row] = reason
        return words

    def describe(self) -> list[str]:
        """What was done: rows and the size of the corrections, columns added, rows left out."""
        uncorrected_rows = sum(rows.size for _, rows in self.uncorrected)
        lines = [
            f"{self.fields.count - uncorrected_rows:,} of {self.fields.count:,} rows corrected"
        ]
        for name, source in self.sources.items():
            low, high = _range_of_differences(values(self.log.frame, name), self.columns[name])
            unit = units.column_unit(name)
            lines.append(f"column '{source}': {low:.4g} to {high:.4g} {unit} taken off")
        if self.added:
            lines.append(f"columns added: {', '.join(self.added)}")
        logged_fate = "keep what was logged" if self.keep else "are empty"
        lines += [
            f"{rows.size:,} rows not corrected ({reason}): their corrected values {logged_fate}"
            for reason, rows in self.uncorrected
        ]
        return lines


def rewrite_log(
    recipe: Recipe,
    path: Path,
    log: Log,
    columns: Mapping[str, Array],
    derived: Mapping[str, Array] | None = None,
) -> Rewritten:
    """A log with canonical columns replaced and derived ones added behind, each along the rows of
    its frame; rows of the file that it lacks are empty there and have a status.

    Columns are written in the log's own unit and sign; every other field keeps its own characters.
    A reference column that a derived one would shadow is renamed reference_<column>. Numbers are
    written with the fewest digits that read back to the same float64. Text keeps its encoding,
    delimiter, decimal mark and every line; another format is written as comma-separated UTF-8 with
    decimal points, every row and column of it. Clean CSV takes the memory of a block.

    Raises FrameError or LogFormatError for what the log lacks.
    """
    table_in_memory = in_memory.find(path)
    if table_in_memory is not None:
        fields = _list_fields(table_in_memory)
    else:
        fields = _scan_clean(recipe, path) or _read_fields(recipe, path, log)
    sources = {name: _find_source(recipe, name, fields, path) for name in columns}
    rows, lost = _find_rows(log)
    spread = [
        {name: _spread(column, rows, fields.count) for name, column in part.items()}
        for part in (columns, derived or {})
    ]
    for column in (*spread[0].values(), *spread[1].values()):
        if len(column) != fields.count:
            raise FrameError(
                f"{path.name}: {fields.count} rows in, {len(column)} compensated",
                hint="report this log as a fault",
            )
    return Rewritten(recipe, path.name, log, fields, columns, spread[0], sources, spread[1], lost)


def tabulate(
    recipe: Recipe, log: Log, columns: Mapping[str, Array], status: Sequence[str]
) -> Rewritten:
    """A table in place of a log: columns [n] in canonical units, and why a row has no result (""
    where it has one).
    """
    head, *added_names = columns
    first = [f"{value:.10g}" for value in columns[head]]
    fields = _RowFields([head], {}, len(first), lambda: [[first]], quotes=True)
    reasons = np.array(status, dtype=object)
    lost = tuple(
        (reason, np.flatnonzero(reasons == reason)) for reason in dict.fromkeys(status) if reason
    )
    added = {name: columns[name] for name in added_names}
    return Rewritten(recipe, log.file, log, fields, {}, {}, {}, added, lost)


def _range_of_differences(logged: Array, corrected: Array) -> tuple[float, float]:
    """Smallest and largest difference of two columns [n]."""
    return chunks.extremes_of_present(logged - corrected)


def _find_rows(log: Log) -> tuple[Integers | None, tuple[tuple[str, Integers], ...]]:
    """Rows of the file that a log's frame has, None where it has all, and those that are lost, by
    the reason.
    """
    if not log.lost:
        return None, ()
    frame_lines = log.frame.index.to_numpy()
    all_lines = np.sort(np.concatenate([frame_lines, *(rows for _, rows in log.lost)]))
    lost: dict[str, Integers] = {}
    for reason, rows in log.lost:
        row_numbers = np.searchsorted(all_lines, rows)
        lost[reason] = (
            np.concatenate([lost[reason], row_numbers]) if reason in lost else row_numbers
        )
    return np.searchsorted(all_lines, frame_lines), tuple(lost.items())


def _spread(frame_values: Array, rows: Integers | None, count: int) -> Array:
    """Values along a log's frame, along all rows of its file: missing where the frame has none."""
    if rows is None:
        return frame_values
    file_values = np.full(max(count, int(rows.max(initial=-1)) + 1), np.nan)
    file_values[rows] = frame_values
    return file_values


@dataclass(frozen=True, slots=True)
class _RowFields:
    """A log as characters: names, units that the header states, number of rows, and the fields of
    each column for one block of rows after the other.

    `quotes`: whether a field may hold a comma; `lines`: those of a text that is written as it is.
    """

    header: list[str]
    units: Mapping[str, str]
    count: int
    blocks: Callable[[], Iterable[list[list[str]]]]
    quotes: bool
    lines: TextLines | None = None


def _scan_clean(recipe: Recipe, path: Path) -> _RowFields | None:
    """Fields of clean CSV as they are in the file, which is read block by block; None of any other
    log.
    """
    scan = clean.scan_file(path, path.name) if recipe.logs.format in _CSV else None
    if scan is None:
        return None
    header_units = {name: units.unit_in_header(name) for name in scan.header}
    return _RowFields(
        list(scan.header),
        header_units,
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


def _read_fields(recipe: Recipe, path: Path, log: Log) -> _RowFields:
    """Fields of a log: of CSV as they are, of text by its lines, of any other format by its
    reader.
    """
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
            header_units = {name: units.unit_in_header(name) for name in header}
            return _RowFields(header, header_units, len(rows), lambda: [columns], quotes=False)
    if (text := _cut_text(recipe, path, data, log)) is not None:
        return text
    return _list_fields(registry.read(path, path.name, recipe.logs, ()))


def _list_fields(table: Table) -> _RowFields:
    """Fields of a log that is no text, or in memory."""
    frame = table.frame
    return _RowFields(
        list(map(str, frame.columns)),
        table.units,
        len(frame),
        lambda: [[_format_column(frame[name], table.decimal) for name in frame.columns]],
        quotes=True,
    )


def _cut_text(recipe: Recipe, path: Path, data: bytes, log: Log) -> _RowFields | None:
    """Fields of text in a dialect, which is written by its lines; None of another format."""
    is_text = recipe.logs.format == "text"
    if not is_text and (recipe.logs.format != AUTO or registry.recognise_format(data)):
        return None
    numbers = np.sort(np.concatenate([log.frame.index, *(rows for _, rows in log.lost)]))
    try:
        lines = TextLines.cut(data, path.name, recipe.logs, numbers.astype(np.int64) + 1)
    except LogFormatError:
        return None
    if lines is None:
        return None
    column_units = {column.name: column.unit for column in lines.dialect.columns if column.unit}
    header = list(lines.dialect.names)
    return _RowFields(header, column_units, len(numbers), list, quotes=False, lines=lines)


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


def _find_source(recipe: Recipe, name: str, log: _RowFields, path: Path) -> str:
    """Name that a canonical column has in the log, with or without the unit behind it."""
    source = recipe.columns[name].source if name in recipe.columns else name
    if source in log.header:
        return source
    headers = [header for header in log.header if units.name_without_unit(header) == source]
    if len(headers) != 1:
        raise FrameError(f"{path.name}: no column '{source}'", hint="check [columns] of the recipe")
    return headers[0]


def _format_numbers(values: Array) -> list[str]:
    """Shortest texts that read back to the same numbers; a missing value is an empty field."""
    texts = list(map(repr, values.tolist()))
    for row in np.flatnonzero(np.isnan(values)).tolist():
        texts[row] = ""
    return texts

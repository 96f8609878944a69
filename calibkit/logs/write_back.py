"""A log written again as clean CSV, row by row and column by column, with some of its columns
replaced and others added.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calibkit import units
from calibkit.errors import FrameError
from calibkit.logs.column_values import unmap_values
from calibkit.numeric import chunks
from calibkit.readers import clean, registry, tokens
from calibkit.readers.table import Table
from calibkit.recipe import ColumnMapping
from calibkit.records.frame import values

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.numeric.arrays import Array, Integers
    from calibkit.recipe import Recipe
    from calibkit.records.frame import Log


Applied: TypeAlias = "tuple[Rewritten, tuple[str, ...]]"
"""A compensated log and the flags."""
STATUS = "status"
"""Column that says why a row is not corrected."""
ROWS = 1 << 16
"""Rows that are written at a time."""


@dataclass(frozen=True, slots=True)
class Rewritten:
    """A log with canonical columns replaced and others added; iterated over, the bytes of the new
    file, part by part.
    """

    recipe: Recipe
    log: Log
    """Its frame has the rows of which the columns have values, `lost` those that could not be
    corrected, by the reason.
    """
    table: Table
    """The log as it was read."""
    replaced: Mapping[str, Array]
    """Canonical column → values along the rows of the log's frame."""
    sources: Mapping[str, str]
    """Canonical column → its name in the log."""
    added: Mapping[str, Array]
    """Further column → values along the rows of the log's frame."""
    keep: bool = False
    """Whether rows that could not be corrected keep what was logged."""

    @property
    def uncorrected(self) -> dict[str, Integers]:
        """Reason → lines of the rows that could not be corrected."""
        lines: dict[str, Integers] = {}
        for reason, rows in self.log.lost:
            lines[reason] = np.concatenate([lines[reason], rows]) if reason in lines else rows
        return lines

    @property
    def rows(self) -> int:
        """Number of rows of the new file."""
        index = self.log.frame.index
        alone = [int((~np.isin(lines, index)).sum()) for lines in self.uncorrected.values()]
        return len(index) + sum(alone)

    def __iter__(self) -> Iterator[bytes]:
        """Bytes of the new file; raises LogFormatError where the log changes meanwhile."""
        for first, stop in chunks.ranges(max(len(self.table.frame), 1), ROWS):
            frame = self.correct(replace(self.table, frame=self.table.frame.iloc[first:stop]))
            if first == 0:
                # a unit that the log states elsewhere stands behind the name
                header = []
                for name in map(str, frame.columns):
                    unit = self.table.units.get(name, "")
                    if units.unit_in_header(name) or name.rpartition("_")[2] in units.COLUMN_UNITS:
                        unit = ""
                    header.append([f"{name} ({unit})" if unit else name])
                yield _format_csv(header)
            yield _format_csv(
                [_format_column(column, self.table.decimal) for _, column in frame.items()]
            )

    def correct(self, table: Table) -> pd.DataFrame:
        """Rows of the log, or of a part of it, as they are in the new file."""
        import pandas as pd

        index = table.frame.index
        places = self.log.frame.index.get_indexer(index)
        missing = places < 0
        status = pd.Series("", index, dtype=object)
        for reason, lines in self.uncorrected.items():
            status[index.isin(lines)] = reason
        if (missing & (status == "").to_numpy()).any():
            raise clean.changed(table.file)

        def along_rows(column: Array) -> pd.Series:
            numbers = np.full(len(index), np.nan)
            numbers[~missing] = column[places[~missing]]
            return pd.Series(numbers, index)

        new_names = [*self.added, *([STATUS] if self.log.lost else [])]
        frame = table.frame.rename(columns={name: f"reference_{name}" for name in new_names})
        for name, source in self.sources.items():
            mapped = self.recipe.columns.get(name) or ColumnMapping(source=source)
            # as the log was read: a unit in the header counts where the recipe states none
            stated_unit = table.units.get(source) or units.unit_in_header(source)
            canonical = along_rows(self.replaced[name]).to_numpy()
            in_log = unmap_values(canonical, mapped, name, self.recipe, stated_unit)
            numbers = pd.Series(in_log, index)
            if self.keep and missing.any():
                numbers = numbers.astype(object).where(~missing, table.frame[source])
            frame = frame.assign(**{source: numbers})
        for name, column in self.added.items():
            frame[name] = along_rows(column)
        if self.log.lost:
            frame[STATUS] = status
        return frame

    def as_frame(self, logged: pd.DataFrame) -> pd.DataFrame:
        """The new log as a frame, where `logged` is the log: its index and columns stay; a table in
        place of the log has an index of its own.
        """
        header = list(map(str, self.table.frame.columns))
        if header != list(map(str, logged.columns)) or self.rows != len(logged):
            return self.correct(self.table)
        rows = logged.set_axis(header, axis=1).reset_index(drop=True)
        return self.correct(replace(self.table, frame=rows)).set_index(logged.index)

    def describe(self) -> list[str]:
        """What was done: rows and the size of the corrections, columns added, rows left out."""
        rows, uncorrected = self.rows, self.uncorrected
        corrected_rows = rows - sum(lines.size for lines in uncorrected.values())
        texts = [f"{corrected_rows:,} of {rows:,} rows corrected"]
        for name, source in self.sources.items():
            taken_off = values(self.log.frame, name) - self.replaced[name]
            low, high = chunks.extremes_of_present(taken_off)
            unit = units.column_unit(name)
            texts.append(f"column '{source}': {low:.4g} to {high:.4g} {unit} taken off")
        if self.added:
            texts.append(f"columns added: {', '.join(self.added)}")
        logged_fate = "keep what was logged" if self.keep else "are empty"
        texts += [
            f"{lines.size:,} rows not corrected ({reason}): their corrected values {logged_fate}"
            for reason, lines in uncorrected.items()
        ]
        return texts


def rewrite_log(
    recipe: Recipe,
    path: Path,
    log: Log,
    columns: Mapping[str, Array],
    derived: Mapping[str, Array] | None = None,
) -> Rewritten:
    """A log with canonical columns replaced and derived ones added behind, each along the rows of
    its frame; rows of the file that it lacks are empty there and have a status.

    The new file is comma-separated UTF-8 with decimal points and one line of names; it has every
    row and every column of the log in their order. Columns are written in the log's own unit and
    sign, numbers with the fewest digits that read back to the same float64, texts as they are. A
    unit that the log states in a line of its own stands in brackets behind the name. A reference
    column that a derived one would shadow is renamed reference_<column>.

    Raises FrameError or LogFormatError for what the log lacks.
    """
    derived = derived or {}
    for column in (*columns.values(), *derived.values()):
        if len(column) != len(log.frame):
            raise FrameError(
                f"{path.name}: {len(log.frame)} rows in, {len(column)} compensated",
                hint="report this log as a fault",
            )
    table = registry.read(path, path.name, recipe.logs, ())
    header = list(map(str, table.frame.columns))
    sources = {}
    for name in columns:
        source = recipe.columns[name].source if name in recipe.columns else name
        named = [column for column in header if units.name_without_unit(column) == source]
        if source not in header and len(named) != 1:
            raise FrameError(
                f"{path.name}: no column '{source}'", hint="check [columns] of the recipe"
            )
        sources[name] = source if source in header else named[0]
    return Rewritten(recipe, log, table, columns, sources, derived)


def tabulate(
    recipe: Recipe, log: Log, columns: Mapping[str, Array], status: Sequence[str]
) -> Rewritten:
    """A table in place of a log: columns [n] in canonical units, and why a row has no result (""
    where it has one).
    """
    import pandas as pd

    frame = pd.DataFrame(columns)
    reasons = np.array(status, dtype=object)
    lost = tuple(
        (reason, np.flatnonzero(reasons == reason)) for reason in dict.fromkeys(status) if reason
    )
    table = Table(log.file, log.sha256, frame)
    stations = replace(log, frame=frame, lost=lost)
    return Rewritten(recipe, stations, table, {}, {}, {})


def _format_column(column: pd.Series, decimal: str) -> list[str]:
    """Fields of a column: numbers with decimal points, a missing value empty, texts as they are."""
    if column.dtype.kind == "f":
        # the shortest texts that read back to the same numbers
        numbers = column.to_numpy(dtype=np.float64)
        texts = [repr(number).removesuffix(".0") for number in numbers.tolist()]
        for row in np.flatnonzero(np.isnan(numbers)).tolist():
            texts[row] = ""
        return texts
    texts = []
    for cell in column.astype(object).where(column.notna(), ""):
        text = repr(float(cell)).removesuffix(".0") if isinstance(cell, float) else str(cell)
        if decimal == "," and tokens.NUMBER[","].fullmatch(text):
            text = text.replace(",", ".")
        texts.append(text)
    return texts


def _format_csv(columns: list[list[str]]) -> bytes:
    """Comma-separated UTF-8."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(zip(*columns, strict=True))
    return stream.getvalue().encode()

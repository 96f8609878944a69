"""Units, signs, clocks and counters at the door: a log's own columns → canonical ones."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import FrameError, LogFormatError, RecipeError
from calibkit.ingest import naming
from calibkit.readers import times

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from calibkit.arrays import Array
    from calibkit.readers.table import Table
    from calibkit.recipe import Column, Recipe


SENTINELS = (9.9e37, -9.9e37)
"""Values that instruments write for overload, whatever the unit; 9.9E+37 is SCPI's."""
SENTINELS_BUT_COUNTS = (1e9, -1e9, 9e9, -9e9)
"""The same where the column is no count and no time, which can reach them; +9.0E+9 is an open
thermocouple.
"""

SPACING = 1e-3
"""Relative difference between the rows' spacing and a stated interval that no clock has."""


@dataclass(frozen=True, slots=True)
class Mapped:
    """A canonical column [n], what was noted of the data, and how it was read."""

    column: Array
    notes: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()
    since_row_before: bool = False


def resolved(source: str, table: Table) -> str | None:
    """The log's own name of a column: as it is written, or without the unit in brackets behind
    it.
    """
    if source in table.frame.columns:
        if f"{source} #2" in table.frame.columns:
            raise LogFormatError(
                f"{table.file}: column '{source}' stands twice",
                hint="give each column its own name",
            )
        return source
    found = [
        name for name in map(str, table.frame.columns) if units.name_without_unit(name) == source
    ]
    if len(found) > 1:
        raise LogFormatError(
            f"{table.file}: column '{source}' could be {' or '.join(map(repr, found))}",
            hint="name one of them, with its unit, in [columns]",
        )
    return found[0] if found else None


def time(table: Table, source: str, column: Column | None, name: str) -> Mapped:
    """Seconds [n] of a log's time column, whatever it is written as; raises LogFormatError or
    RecipeError.
    """
    raw = table.frame[source]
    form = column.time_format if column else ""
    if column and column.date:
        if column.date not in table.frame.columns:
            raise _absent(table, column.date, f"[columns.{name}] date")
        raw = table.frame[column.date].astype(str).str.strip() + " " + raw.astype(str).str.strip()
        form = form or times.recognise_format([str(field) for field in raw.iloc[:200]])
    place = f"{table.file}: column '{source}'"
    if form == times.EXCEL:
        return Mapped(
            times.spreadsheet_to_seconds(_numbers(raw, place)),
            (),
            (f"column '{source}': days since 1899-12-30",),
        )
    if not form and not _is_text(raw):
        return Mapped(raw.to_numpy(dtype=np.float64))
    form = form or _form(raw, place)
    clock = times.to_seconds(raw, form, place)
    return Mapped(clock.seconds, (), tuple(f"column '{source}': {note}" for note in clock.notes))


def _is_text(raw: pd.Series) -> bool:
    """Whether a column holds characters."""
    return raw.dtype.kind not in "fiub"


def _numbers(raw: pd.Series, place: str) -> Array:
    """A column as numbers."""
    try:
        return raw.to_numpy(dtype=np.float64)
    except ValueError:
        raise LogFormatError(
            f"{place}: text, expected numbers", hint="correct [columns], or time_format"
        ) from None


def _form(raw: pd.Series, place: str) -> str:
    """Format of a column's times, from its first fields; numbers of more digits than a float64
    holds are decimal seconds.
    """
    first = [str(field) for field in raw.iloc[:200]]
    form = times.recognise_format(first)
    if form:
        return form
    if all(times.is_decimal(field) for field in first):
        return times.DECIMAL
    file, _, column = place.partition(": ")
    row = next(k for k, field in enumerate(first) if not times.is_decimal(field))
    raise LogFormatError(
        f"{file}:{int(raw.index[row]) + 2}: {column}: found '{first[row][:40]}', expected a number"
        " or a time",
        hint="pin time_format in [columns], or repair the log",
    )


def stated_unit(table: Table, source: str, column: Column | None, name: str) -> str:
    """Unit of the log's column: the recipe's, else what the log's header states, else the canonical
    one.

    Raises FrameError where the recipe and the log contradict each other.
    """
    target = units.column_unit(name)
    header = table.units.get(source) or units.of_header(source)
    pinned = column.unit if column else ""
    if column is not None and column.accumulated:
        # differences of a counter are counts per sample, whether the log or the recipe says so or
        # neither
        if not {pinned, header} <= {"", "1", "1/sample"}:
            raise RecipeError(
                f"{table.file}: column '{source}': accumulated {pinned or header}, expected"
                " accumulated counts",
                hint=f"correct unit or accumulated in [columns.{name}]",
                at=("columns", name, "accumulated"),
            )
        return "1/sample"
    if not pinned or column is None:
        if not header:
            _agrees_with_its_name(table, source, name, target)
        return header or target
    if header == "1" and pinned in {"1/sample", "1/s"}:
        return pinned  # "counts" in a header leaves open of how long
    changed = column.scale != 1.0 or column.offset != 0.0
    if header and header != pinned and not changed and column.header_unit == "must agree":
        raise FrameError(
            f"{table.file}: column '{source}': the log states {header}, [columns.{name}] says"
            f" {pinned}",
            hint=f'correct the unit, or say header_unit = "ignored" in [columns.{name}]',
        )
    return pinned


def _agrees_with_its_name(table: Table, source: str, name: str, target: str) -> None:
    """Raise FrameError for a column without a stated unit whose name ends in another unit than it
    would be taken in.
    """
    unit = (
        naming.LAST_WORDS.get(source.strip().lower().rsplit("_", 1)[-1], "")
        if "_" in source
        else ""
    )
    if unit and unit != target and units.TABLE[unit].dimension == units.TABLE[target].dimension:
        raise FrameError(
            f"{table.file}: column '{source}': its name says {unit}, it would be taken in {target}",
            hint=f'state the unit: [columns.{name}] from = "{source}", unit = "{unit}"',
        )


def value(
    table: Table,
    source: str,
    column: Column | None,
    name: str,
    recipe: Recipe,
    seconds: Array | None,
) -> Mapped:
    """Canonical values [n] of a column: sign · (scale · value + offset), converted to the unit of
    its name.

    Counts per sample become counts per second by the interval of the recipe or of the log's own
    time [s].
    """
    raw = table.frame[source].to_numpy(dtype=np.float64)
    unit = stated_unit(table, source, column, name)
    target = units.column_unit(name)
    raw, notes = _without_sentinels(raw, recipe, unit, source, table)
    said: tuple[str, ...] = ()
    if column and column.wraps_at is not None:
        raw, said = unwrapped(raw, column.wraps_at, source)
    if column and column.accumulated:
        raw = np.concatenate([[np.nan], np.diff(raw)])
    scale, offset, sign = (column.scale, column.offset, column.sign) if column else (1.0, 0.0, 1)
    values = units.scaled(raw, scale) if scale != 1.0 else raw
    values = values + offset if offset else values
    per_sample = unit == "1/sample"
    if per_sample:
        values = values / _interval(column, seconds, name, table)
        notes += _otherwise_spaced(column, seconds, name)
        unit = "1/s"
    try:
        values = units.convert(values, unit, target, gravity_mps2=recipe.site.gravity_mps2)
    except RecipeError as error:
        place = ("columns", name, "unit")
        raise RecipeError(
            f"{table.file}: column '{source}': {error.message}", hint=error.hint, at=place
        ) from None
    if unit != target and not (column and column.unit):
        said += (f"column '{source}': {unit}, as the log states",)
    first_lost = column is not None and column.accumulated
    first_lost |= per_sample and (column is None or column.interval_s is None)
    return Mapped(values if sign == 1 else -values, notes, said, first_lost)


def _interval(
    column: Column | None, seconds: Array | None, name: str, table: Table
) -> Array | float:
    """Time [s] over which each row's counts were counted: the recipe's, or since the row before."""
    if column and column.interval_s is not None:
        return column.interval_s
    if seconds is None:
        raise RecipeError(
            f"{table.file}: counts per sample need the interval of a sample",
            hint=f"give interval_s in [columns.{name}], or map time_s",
        )
    return np.concatenate([[np.nan], np.diff(seconds)])


def _otherwise_spaced(column: Column | None, seconds: Array | None, name: str) -> tuple[str, ...]:
    """What to say where the rows lie further apart, or nearer, than counts are said to be counted
    for.
    """
    if column is None or column.interval_s is None or seconds is None or seconds.size < 2:
        return ()
    apart = float(np.nanmedian(np.diff(seconds)))
    if not apart > 0.0 or abs(apart / column.interval_s - 1.0) < SPACING:
        return ()
    said = (
        f"rows are {apart:g} s apart, interval_s says that each one counts {column.interval_s:g} s"
    )
    return (
        (
            f"column '{name}': {said}: rates are {apart / column.interval_s:.4g} times those of a"
            " log of every sample"
        ),
    )


def unwrapped(raw: Array, modulus: float, source: str) -> tuple[Array, tuple[str, ...]]:
    """A counter [n] that starts again at a modulus, made continuous: a step beyond half the modulus
    is a wrap.
    """
    step = np.diff(raw)
    wraps = np.where(np.isfinite(step), np.round(step / modulus), 0.0)
    count = int(np.count_nonzero(wraps))
    notes = (
        f"column '{source}': {count} wrap{'s' if count > 1 else ''} at {modulus:g} made continuous",
    )
    made = raw - modulus * np.concatenate([[0.0], np.cumsum(wraps)])
    return made, notes if count else ()


def _without_sentinels(
    raw: Array, recipe: Recipe, unit: str, source: str, table: Table
) -> tuple[Array, tuple[str, ...]]:
    """Values with those that mean "no value" made missing; which, how many, and the line of the
    first are said.
    """
    counted = units.TABLE[unit].dimension in {"count", "count rate", "count per sample", "time"}
    values = [*SENTINELS, *(() if counted else SENTINELS_BUT_COUNTS)]
    values += [entry for entry in recipe.logs.sentinels if not isinstance(entry, str)]
    # fmin and fmax pass over what is missing; most columns lie far inside all sentinels
    low, high = (float(end.reduce(raw)) if raw.size else 0.0 for end in (np.fmin, np.fmax))
    if not any(low <= value <= high for value in values):
        return raw, ()
    hit = np.isin(raw, values)
    if not hit.any():
        return raw, ()
    first = int(np.flatnonzero(hit)[0])
    line = int(table.frame.index[first]) + 2
    note = (
        f"column '{source}': {int(hit.sum())} × no value, the first {raw[first]:g} in line {line}"
    )
    return np.where(hit, np.nan, raw), (note,)


def complete(
    frame: pd.DataFrame, needed: Sequence[str], recipe: Recipe
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The frame without rows that lack a needed value, where the recipe says so; counted, located
    and reasoned.
    """
    if recipe.logs.missing == "refuse":
        return frame, ()
    columns = [name for name in needed if name in frame.columns]
    absent = frame[columns].isna()
    out = absent.any(axis=1).to_numpy()
    if not out.any():
        return frame, ()
    rows = frame.index[out]
    why = ", ".join(
        f"{int(absent[name].sum())} without {name}" for name in columns if absent[name].any()
    )
    note = (
        f"{int(out.sum())} rows removed ({why}), lines {spans([int(row) + 2 for row in rows])}:"
        ' missing = "drop"'
    )
    return frame[~out], (note,)


def spans(lines: Sequence[int], most: int = 8) -> str:
    """Lines as ranges: 3, 7-12, 40."""
    runs: list[list[int]] = []
    for line in lines:
        if runs and line == runs[-1][1] + 1:
            runs[-1][1] = line
        else:
            runs.append([line, line])
    said = [str(a) if a == b else f"{a}-{b}" for a, b in runs[:most]]
    return ", ".join(said) + (f" and {len(runs) - most} more ranges" if len(runs) > most else "")


def _absent(table: Table, name: str, where: str) -> FrameError:
    """The error of a column that the recipe names and the log has not."""
    close = difflib.get_close_matches(name, [str(column) for column in table.frame.columns], n=1)
    guess = (
        f"did you mean '{close[0]}'?"
        if close
        else f"columns: {', '.join(map(str, table.frame.columns[:12]))}"
    )
    return FrameError(f"{table.file}: {where} = '{name}': no such column", hint=guess)

"""One column of a log → canonical values: units, signs, times, counters, values that mean none."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import FrameError, LogFormatError, RecipeError, did_you_mean
from calibkit.logs import column_names, time_units
from calibkit.readers import times
from calibkit.readers.table import FIRST_ROW, Guess
from calibkit.recipe import ColumnMapping
from calibkit.records.frame import Origin

if TYPE_CHECKING:
    import pandas as pd

    from calibkit.numeric.arrays import Array
    from calibkit.readers.table import Table
    from calibkit.recipe import Recipe


_SENTINELS = (9.9e37, -9.9e37)
"""Values that instruments write for overload, whatever the unit; 9.9E+37 is SCPI's."""
_SENTINELS_BUT_COUNTS = (1e9, -1e9, 9e9, -9e9)
"""The same where the column is no count and no time, which can reach them; +9.0E+9 is an open
thermocouple.
"""

_SPACING = 1e-3
"""Relative difference between the spacing of rows and a stated interval that is noted; clocks
agree better.
"""
_LABEL = re.compile(
    r"(?:axis|channel|ch|no\.?|sensor)?[\s_]*[a-z]?[\s_]*\d*[\s_]*(?:axis)?|raw|mean|average|avg"
    r"|pt\d+|ntc|rtd|case|env|ambient|reference|ref|corrected|uncorrected|compensated|filtered",
    re.IGNORECASE,
)
"""Texts in brackets behind a name that say which column it is, not its unit."""


@dataclass(frozen=True, slots=True)
class MappedColumn:
    """Values of a canonical column [n], notes on its content, and how it was read."""

    numbers: Array
    notes: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()
    since_row_before: bool = False
    """Whether they are counts since the row before: the first row then has no value."""
    origin: Origin | None = None
    """Stamp of second 0 of a time, where it is certain."""


def find_column(source: str, table: Table) -> str | None:
    """The log's own name of a column, which may have a unit in brackets behind it; None where it is
    not there.
    """
    if source in table.frame.columns:
        if f"{source} #2" in table.frame.columns:
            raise LogFormatError(
                f"{table.file}: column '{source}' stands twice",
                hint="give each column its own name",
            )
        return source
    matches = [
        name for name in map(str, table.frame.columns) if units.name_without_unit(name) == source
    ]
    if len(matches) > 1:
        raise LogFormatError(
            f"{table.file}: column '{source}' could be {' or '.join(map(repr, matches))}",
            hint="name one of them, with its unit, in [columns]",
        )
    return matches[0] if matches else None


def read_time(table: Table, source: str, recipe: Recipe) -> MappedColumn:
    """Seconds [n] of a log's time column: times as they are written, or numbers in the unit that
    recipe or header state. Raises LogFormatError, FrameError or RecipeError.
    """
    column = recipe.columns.get("time_s") or ColumnMapping(source=source)
    raw, form = table.frame[source], column.time_format
    if column.date:
        if column.date not in table.frame.columns:
            columns = list(map(str, table.frame.columns))
            raise FrameError(
                f"{table.file}: [columns.time_s] date = '{column.date}': no such column",
                hint=did_you_mean(column.date, columns, f"columns: {', '.join(columns[:12])}"),
            )
        raw = table.frame[column.date].astype(str).str.strip() + " " + raw.astype(str).str.strip()
        form = form or times.recognise_format([str(field) for field in raw.iloc[:200]])
    if form == times.EXCEL:
        try:
            days = raw.to_numpy(dtype=np.float64)
        except ValueError:
            raise LogFormatError(
                f"{table.file}: column '{source}': text, expected numbers",
                hint="correct [columns], or time_format",
            ) from None
        counted = times.spreadsheet_to_seconds(days)
        return MappedColumn(
            counted.seconds,
            reading=(f"column '{source}': days since 1899-12-30",),
            origin=counted.origin,
        )
    if not form and raw.dtype.kind in "fiub":
        numbers = read_values(table, source, "time_s", recipe, None)
        if not (column.unit or table.units.get(source) or units.unit_in_header(source)):
            doubts = time_units.question_seconds(numbers.numbers, source, table.file)
            numbers = replace(numbers, notes=(*numbers.notes, *doubts))
        return replace(numbers, origin=Origin("numbers"))
    form = form or _time_format(raw, table.file, source)
    written_times = times.to_seconds(raw, form, table.file, source)
    reading = tuple(type(note)(f"column '{source}': {note}") for note in written_times.notes)
    return MappedColumn(written_times.seconds, (), reading, origin=written_times.origin)


def _time_format(raw: pd.Series, file: str, source: str) -> str:
    """Format of a column's times, from its first fields: decimal seconds where these are numbers of
    more digits than a float64 holds. Raises LogFormatError for anything else.
    """
    first = [str(field) for field in raw.iloc[:200]]
    form = times.recognise_format(first)
    if form:
        return form
    row = next((k for k, field in enumerate(first) if not times.is_decimal(field)), None)
    if row is None:
        return times.DECIMAL
    raise LogFormatError(
        f"{file}:{int(raw.index[row]) + 2}: column '{source}': found '{first[row][:40]}', expected"
        " a number or a time",
        hint="pin time_format in [columns], or repair the log",
    )


def _unknown_unit(table: Table, source: str) -> str:
    """Unit that the log states of a column and that is none of the table's, or ""."""
    unit = table.units.get(source, "")
    if unit:
        return "" if unit in units.TABLE else unit
    text = units.bracketed_text(source)
    if not text.isascii() and not re.search("[°µμ²³·]", text):
        return ""  # a remark in another script
    return "" if units.parse_unit(text) or _LABEL.fullmatch(text) else text


def _resolve_unit(table: Table, source: str, column: ColumnMapping, name: str) -> str:
    """Unit of the log's column: the recipe's, else what the log's header states, else the canonical
    one.

    Raises FrameError where the recipe and the log contradict each other.
    """
    target = units.column_unit(name)
    header = table.units.get(source) or units.unit_in_header(source)
    pinned = column.unit
    unknown = _unknown_unit(table, source)
    if unknown and not pinned:
        raise FrameError(
            f"{table.file}: column '{source}': the log states the unit '{unknown}', which is not"
            " known",
            hint=f'state what it is: [columns.{name}] from = "{source}", unit = "{target}", and'
            " scale where it is a multiple",
        )
    header = "" if unknown else header
    if column.accumulated:
        # differences of a counter are counts per sample, whether the log, the recipe or neither
        # states it
        if not {pinned, header} <= {"", "1", "1/sample"}:
            raise RecipeError(
                f"{table.file}: column '{source}': accumulated {pinned or header}, expected"
                " accumulated counts",
                hint=f"correct unit or accumulated in [columns.{name}]",
                at=("columns", name, "accumulated"),
            )
        return "1/sample"
    if not pinned:
        by_name = "" if header else _unit_of_name(source, target)
        if by_name not in {"", target}:
            raise FrameError(
                f"{table.file}: column '{source}': its name says {by_name}, it would be taken in"
                f" {target}",
                hint=f'state the unit: [columns.{name}] from = "{source}", unit = "{by_name}"',
            )
        return header or target
    if header == "1" and pinned in {"1/sample", "1/s"}:
        return pinned  # "counts" in a header does not state the interval
    changed = column.scale != 1.0 or column.offset != 0.0
    if header and header != pinned and not changed and column.header_unit == "must agree":
        raise FrameError(
            f"{table.file}: column '{source}': the log states {header}, [columns.{name}] says"
            f" {pinned}",
            hint=f'correct the unit, or say header_unit = "ignored" in [columns.{name}]',
        )
    return pinned


def _unit_of_name(source: str, target: str) -> str:
    """Unit of a target's dimension that the last word of a column's name is, or ""."""
    unit = column_names.unit_of_last_word(source)
    return unit if unit and units.TABLE[unit].dimension == units.TABLE[target].dimension else ""


def needs_time(table: Table, source: str, name: str, recipe: Recipe) -> bool:
    """Whether a column counts since the row before, so that its rate needs the log's time; errors
    as of `read_values`.
    """
    column = recipe.columns.get(name) or ColumnMapping(source=source)
    return column.interval_s is None and _resolve_unit(table, source, column, name) == "1/sample"


def resolve_units(recipe: Recipe, table: Table) -> dict[str, str]:
    """Unit of each column of a log that the recipe names, as the log has it."""
    sources = {name: find_column(column.source, table) for name, column in recipe.columns.items()}
    return {
        source: _resolve_unit(table, source, recipe.columns[name], name)
        for name, source in sources.items()
        if source is not None and not recipe.columns[name].time_format
    }


def _read_numbers(table: Table, source: str) -> Array:
    """Numbers [n] of a column; raises LogFormatError that names the row of what is none."""
    column = table.frame[source]
    for line, field in column.dropna().items() if column.dtype.kind not in "fiub" else ():
        try:
            float(field)
        except (TypeError, ValueError):
            raise LogFormatError(
                f"{table.file}:{int(str(line)) + FIRST_ROW}: column '{source}': found"
                f" '{str(field)[:40]}', expected a number",
                hint="repair the row, or leave it out",
            ) from None
    return np.asarray(column.to_numpy(dtype=np.float64), dtype=np.float64)


def read_values(
    table: Table, source: str, name: str, recipe: Recipe, seconds: Array | None
) -> MappedColumn:
    """Canonical values [n] of a column: sign · (scale · value + offset), converted to the unit of
    its name.

    Counts per sample become counts per second by the interval of the recipe or of the log's own
    time [s]. Raises LogFormatError, FrameError or RecipeError.
    """
    column = recipe.columns.get(name) or ColumnMapping(source=source)
    raw = _read_numbers(table, source)
    unit, target = _resolve_unit(table, source, column, name), units.column_unit(name)
    raw, notes = _blank_sentinels(raw, recipe, unit, source, table)
    reading: tuple[str, ...] = ()
    if column.wraps_at is not None:
        raw, reading = _unwrap(raw, column.wraps_at, source)
    if column.accumulated:
        raw = np.concatenate([[np.nan], np.diff(raw)])
    values = units.scaled(raw, column.scale, offset=column.offset)
    per_sample = unit == "1/sample"
    if per_sample:
        spacings = None if seconds is None else np.diff(seconds, prepend=np.nan)
        interval = spacings if column.interval_s is None else column.interval_s
        if interval is None:
            raise RecipeError(
                f"{table.file}: counts per sample need the interval of a sample",
                hint=f"give interval_s in [columns.{name}], or map time_s",
            )
        values = values / interval
        if column.interval_s is not None and spacings is not None and spacings.size > 1:
            spacing_s = float(np.nanmedian(spacings))
            ratio = spacing_s / column.interval_s
            if spacing_s > 0.0 and abs(ratio - 1.0) >= _SPACING:
                note = (
                    f"column '{name}': rows are {spacing_s:g} s apart, interval_s says that each"
                    f" one counts {column.interval_s:g} s: rates are {ratio:.4g} times those of a"
                    " log of every sample"
                )
                notes = (*notes, note)
        unit = "1/s"
    try:
        values = units.convert(values, unit, target, gravity_mps2=recipe.site.gravity_mps2)
    except RecipeError as error:
        raise RecipeError(
            f"{table.file}: column '{source}': {error.message}",
            hint=error.hint,
            at=("columns", name, "unit"),
        ) from None
    if unit != target and not column.unit:
        unit_by_name = _unit_of_name(source, target)
        if unit_by_name in {"", unit}:
            reading += (f"column '{source}': {unit}, as the log states",)
        else:
            doubt = (
                f"column '{source}': {unit}, as the log states, though its name says {unit_by_name}"
            )
            reading += (Guess(f"{doubt} (guessed)"),)
    first_lost = column.accumulated or (per_sample and column.interval_s is None)
    return MappedColumn(values if column.sign == 1 else -values, notes, reading, first_lost)


def _unwrap(raw: Array, modulus: float, source: str) -> tuple[Array, tuple[str, ...]]:
    """A counter [n] that starts again at a modulus, made continuous (a step beyond half the modulus
    is a wrap), and a text on the number of wraps.
    """
    step = np.diff(raw)
    wraps = np.where(np.isfinite(step), np.round(step / modulus), 0.0)
    count = int(np.count_nonzero(wraps))
    text = f"column '{source}': {count} wrap{'s' * (count > 1)} at {modulus:g} made continuous"
    continuous = raw - modulus * np.concatenate([[0.0], np.cumsum(wraps)])
    return continuous, (text,) if count else ()


def _blank_sentinels(
    raw: Array, recipe: Recipe, unit: str, source: str, table: Table
) -> tuple[Array, tuple[str, ...]]:
    """Values with NaN for those that mean "no value", and a note on how many, the first, its
    line.
    """
    counted = units.TABLE[unit].dimension in {"count", "count rate", "count per sample", "time"}
    values = [
        *_SENTINELS,
        *(() if counted else _SENTINELS_BUT_COUNTS),
        *(entry for entry in recipe.logs.sentinels if not isinstance(entry, str)),
    ]
    # fmin and fmax pass over what is missing; most columns lie far inside all sentinels
    low, high = (float(end.reduce(raw)) if raw.size else 0.0 for end in (np.fmin, np.fmax))
    if not any(low <= value <= high for value in values):
        return raw, ()
    hit = np.isin(raw, values)
    if not hit.any():
        return raw, ()
    first = int(np.argmax(hit))
    note = (
        f"column '{source}': {int(hit.sum())} × no value, the first {raw[first]:g} in line"
        f" {int(table.frame.index[first]) + 2}"
    )
    return np.where(hit, np.nan, raw), (note,)


def unmap_values(
    values: Array, column: ColumnMapping, name: str, recipe: Recipe, header_unit: str = ""
) -> Array:
    """Values of a canonical column in the log's own unit and sign: the inverse of the mapping.

    `header_unit` is the one that the log's header states, for a mapping without a unit.
    """
    target = units.column_unit(name)
    converted = units.convert(
        column.sign * values,
        target,
        column.unit or header_unit or target,
        gravity_mps2=recipe.site.gravity_mps2,
    )
    return (converted - column.offset) / column.scale

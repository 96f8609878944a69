"""The columns of a whole log → canonical columns, by the recipe's mapping, corrections and
exclusions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import FrameError, RecipeError
from calibkit.frame import Log, Origin, require
from calibkit.ingest import column_values
from calibkit.ingest.column_values import MappedColumn
from calibkit.readers import parts, registry

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.readers.table import Table
    from calibkit.recipe import Exclude, Recipe
    from calibkit.recipe.tables import Correction


def log_name(file: str) -> str:
    """Name of a log: its file without the suffix."""
    return file.rsplit(".", 1)[0]


def read_file(
    recipe: Recipe, path: Path, file: str, needed: Sequence[str], optional: Sequence[str] = ()
) -> Log:
    """Read one file and map it to canonical columns; raises LogFormatError, FrameError or
    RecipeError.
    """
    sources = {name: column.source for name, column in recipe.columns.items()}
    timed = recipe.columns.get("time_s")
    written = {timed.source} if timed and (timed.time_format or timed.date) else set()
    wanted = {sources.get(name, name) for name in (*needed, *optional)} - written
    read = parts.read if recipe.logs.split else registry.read
    return map_log(recipe, read(path, file, recipe.logs, wanted), needed, optional)


def map_log(
    recipe: Recipe,
    table: Table,
    needed: Sequence[str],
    optional: Sequence[str] = (),
    *,
    whole: bool = True,
) -> Log:
    """Map a log, or a chunk of one, to canonical columns; raises as `read_file`."""
    import pandas as pd

    file = table.file
    mapped = _map_columns(recipe, table, needed, optional)
    require(file, mapped, needed)
    notes = [*table.notes, *(note for column in mapped.values() for note in column.notes)]
    reading = [*table.reading, *(text for column in mapped.values() for text in column.reading)]
    # an unconverted column is a view of the table, which stays in memory for it: a copy where most
    # of the table is not needed
    many = table.frame.shape[1] > 2 * len(mapped)
    kept = {name: mapped[name].numbers for name in (*needed, *optional) if name in mapped}
    frame = pd.DataFrame(kept, index=table.frame.index, copy=many)
    if counted := [name for name, column in mapped.items() if column.since_row_before]:
        frame = frame.iloc[1:]
        notes.append(f"the first row removed: {', '.join(counted)} are counts since the row before")
    frame, corrections = _correct_references(frame, recipe.correction, file)
    frame, dropped = _drop_incomplete_rows(frame, needed, recipe)
    frame, taken = drop_excluded_rows(frame, recipe.exclude, file)
    taken = {number: rows for number, rows in taken.items() if rows or whole}
    return Log(
        log_name(file),
        file,
        table.sha256,
        len(table.frame),
        frame,
        (*notes, *dropped, *note_exclusions(recipe.exclude, taken, file)),
        (*reading, *corrections),
        table.parts,
        plugins=table.plugins,
        origin=mapped["time_s"].origin if "time_s" in mapped else None,
        excluded_rows=sum(taken.values()),
    )


def _map_columns(
    recipe: Recipe, table: Table, needed: Sequence[str], optional: Sequence[str]
) -> dict[str, MappedColumn]:
    """Canonical name → column of the log, the time first: counts per sample need it."""
    own = _find_columns(recipe, table, needed, optional)
    mapped: dict[str, MappedColumn] = {}
    if "time_s" in own:
        mapped["time_s"] = column_values.read_time(table, own["time_s"], recipe)
    seconds = mapped["time_s"].numbers if "time_s" in mapped else None
    for name, source in own.items():
        if name != "time_s":
            mapped[name] = column_values.read_values(table, source, name, recipe, seconds)
    if recipe.logs.rate_hz is not None and "time_s" in {*own, *needed}:
        if "time_s" in own:
            raise RecipeError(
                f"{table.file}: [logs] rate_hz = {recipe.logs.rate_hz:g}, but column"
                f" '{own['time_s']}' holds the time",
                hint="remove rate_hz, or map time_s to nothing that the log has",
            )
        counted = np.arange(len(table.frame)) / recipe.logs.rate_hz
        mapped["time_s"] = MappedColumn(counted, origin=Origin("numbers"))
    return mapped


def _find_columns(
    recipe: Recipe, table: Table, needed: Sequence[str], optional: Sequence[str]
) -> dict[str, str]:
    """Canonical name → the log's own name of every column that is there.

    Raises MissingColumnError for a needed one that is not.
    """
    sources = {name: column.source for name, column in recipe.columns.items()}
    own = {}
    for name in (*needed, *optional):
        found = column_values.find_column(sources.get(name, name), table)
        if found is not None:
            own[name] = found
        elif name in needed and name in sources:
            require(table.file, table.frame.columns, [sources[name]], of=name)
    present = [*table.frame.columns, *own, *(["time_s"] if recipe.logs.rate_hz else [])]
    require(table.file, dict.fromkeys(present), needed)
    return own


def _correct_references(
    frame: pd.DataFrame, corrections: Sequence[Correction], file: str
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The frame with each column of a reference instrument corrected by its certificate, and one
    text per column: by which certificate and by how much.

    Raises FrameError for an indication outside its certificate, unless the recipe extends the
    corrections of its ends.
    """
    reading = []
    for entry in corrections:
        if entry.column not in frame.columns:
            continue
        indication = frame[entry.column].to_numpy(dtype=np.float64)
        points, unit = np.array(entry.indication), units.column_unit(entry.column)
        outside = (indication < points[0]) | (indication > points[-1])
        if outside.any() and entry.beyond == "refuse":
            row = int(np.argmax(outside))
            raise FrameError(
                f"{file}:{int(frame.index[row]) + 2}: column '{entry.column}': {indication[row]:g}"
                f" {unit}, expected {points[0]:g} to {points[-1]:g}, the range of certificate"
                f" {entry.certificate} ({int(outside.sum())} rows are outside)",
                hint=(
                    'calibrate the instrument over the range that is used, or say beyond = "hold"'
                    " in [[correction]]"
                ),
            )
        added = np.interp(indication, points, np.array(entry.correction))
        frame = frame.assign(**{entry.column: indication + added})
        text = (
            f"column '{entry.column}': corrected by {float(np.nanmin(added)):+.3g} to"
            f" {float(np.nanmax(added)):+.3g} {unit}, certificate {entry.certificate}"
        )
        text += f" of {entry.instrument}" if entry.instrument else ""
        held = f", {int(outside.sum())} rows beyond it with the correction of its end"
        reading.append(text + held if outside.any() else text)
    return frame, tuple(reading)


def drop_excluded_rows(
    frame: pd.DataFrame, excludes: Sequence[Exclude], file: str
) -> tuple[pd.DataFrame, dict[int, int]]:
    """The frame without the ranges that the recipe excludes, its index unchanged, and number of an
    exclusion of this log → rows that it took.
    """
    taken = {}
    for number, exclude in enumerate(excludes):
        if exclude.log not in (file, log_name(file)) or (
            exclude.from_s is None and exclude.to_s is None
        ):
            continue
        require(file, frame.columns, ["time_s"])
        out = frame["time_s"].between(*_excluded_range(exclude))
        taken[number] = int(out.sum())
        frame = frame[~out] if taken[number] else frame
    return frame, taken


def note_exclusions(
    excludes: Sequence[Exclude], taken: Mapping[int, int], file: str
) -> tuple[str, ...]:
    """Notes on exclusions and the rows that they took; RecipeError for one that took none."""
    notes = []
    for number, rows in taken.items():
        exclude = excludes[number]
        low, high = _excluded_range(exclude)
        if not rows:
            raise RecipeError(
                f"[[exclude]] of {file}: no row between {low:g} s and {high:g} s",
                hint="check from_s and to_s",
                at=("exclude", number),
            )
        notes.append(
            f"{rows} rows from {low:g} s to {high:g} s excluded by {exclude.person}:"
            f" {exclude.reason}"
        )
    return tuple(notes)


def _excluded_range(exclude: Exclude) -> tuple[float, float]:
    """Times [s] from and to which an exclusion goes."""
    return (
        -np.inf if exclude.from_s is None else exclude.from_s,
        np.inf if exclude.to_s is None else exclude.to_s,
    )


def _drop_incomplete_rows(
    frame: pd.DataFrame, needed: Sequence[str], recipe: Recipe
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The frame without rows that lack a needed value, where the recipe says so, and a note on how
    many, which and why.
    """
    if recipe.logs.missing == "refuse":
        return frame, ()
    absent = frame[[name for name in needed if name in frame.columns]].isna()
    out = absent.any(axis=1).to_numpy()
    if not out.any():
        return frame, ()
    why = ", ".join(f"{rows} without {name}" for name, rows in absent.sum().items() if rows)
    lines = _format_ranges([int(row) + 2 for row in frame.index[out]])
    return frame[~out], (f'{int(out.sum())} rows removed ({why}), lines {lines}: missing = "drop"',)


def _format_ranges(lines: Sequence[int], most: int = 8) -> str:
    """Lines as ranges: 3, 7-12, 40."""
    runs: list[list[int]] = []
    for line in lines:
        if runs and line == runs[-1][1] + 1:
            runs[-1][1] = line
        else:
            runs.append([line, line])
    ranges = [str(a) if a == b else f"{a}-{b}" for a, b in runs[:most]]
    return ", ".join(ranges) + (f" and {len(runs) - most} more ranges" if len(runs) > most else "")

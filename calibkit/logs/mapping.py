"""The columns of a whole log → canonical columns, by the recipe's mapping, corrections and
exclusions.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import FrameError, RecipeError, format_ranges
from calibkit.logs import column_values
from calibkit.logs.column_values import MappedColumn
from calibkit.readers import parts, registry, scratch_files
from calibkit.readers.table import FIRST_ROW
from calibkit.records.frame import Log, Origin, require, values

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.numeric.arrays import Array, Integers, Mask
    from calibkit.readers.table import Table
    from calibkit.recipe import Exclude, Recipe
    from calibkit.recipe.correction import Correction


_SINCE_ROW_BEFORE = "counts since the row before: the first row has none"
"""Why the first row of a log may be lost."""


def log_name(file: str) -> str:
    """Name of a log: its file without the suffix."""
    return file.rsplit(".", 1)[0]


def read_file(
    recipe: Recipe,
    path: Path,
    file: str,
    required_columns: Sequence[str],
    optional: Sequence[str] = (),
) -> Log:
    """Read one file and map it to canonical columns; raises LogFormatError, FrameError or
    RecipeError.
    """
    sources = {name: column.source for name, column in recipe.columns.items()}
    timed = recipe.columns.get("time_s")
    written = {timed.source} if timed and (timed.time_format or timed.date) else set()
    number_columns = {sources.get(name, name) for name in (*required_columns, *optional)} - written
    read = parts.read if recipe.logs.split else registry.read
    lines: dict[str, frozenset[int]] = {}
    for entry in recipe.exclude:
        for a, b in entry.parts.get("lines", ()):
            # an excluded line may be torn: the reader must pass it over, not refuse it
            lines[entry.log] = lines.get(entry.log, frozenset()) | frozenset(range(a, b + 1))
    logs = recipe.logs.without_lines(lines) if lines else recipe.logs
    return map_log(recipe, read(path, file, logs, number_columns), required_columns, optional)


def map_log(
    recipe: Recipe,
    table: Table,
    required_columns: Sequence[str],
    optional: Sequence[str] = (),
) -> Log:
    """Map a log to canonical columns; raises as `read_file`."""
    import pandas as pd

    file = table.file
    columns = (*required_columns, *optional)
    exclude_keys = {
        key
        for entry in recipe.exclude
        if entry.log in (file, log_name(file))
        for key in entry.parts
    }
    # what is read only because an exclusion states positions or stations
    exclusion_columns = [
        name
        for name in ("position", "station")
        if f"{name}s" in exclude_keys and name not in columns
    ]
    table = _blank_excluded(table, recipe.exclude)
    mapped = _map_columns(recipe, table, required_columns, (*optional, *exclusion_columns))
    require(file, mapped, required_columns)
    notes = [*table.notes, *(note for column in mapped.values() for note in column.notes)]
    elsewhere = recipe.chamber.provides if recipe.chamber is not None else {}
    notes += [
        f"no column '{recipe.columns[name].source}', which the recipe maps: {name} is not read"
        for name in optional
        if name in recipe.columns and name not in mapped and name not in elsewhere
    ]
    reading = [*table.reading, *(text for column in mapped.values() for text in column.reading)]
    # an unconverted column is a view of the table, which stays in memory for it: a copy where most
    # of the table is not needed
    copy = table.frame.shape[1] > 2 * len(mapped)
    numbers = {
        name: mapped[name].numbers for name in (*columns, *exclusion_columns) if name in mapped
    }
    frame, lost = pd.DataFrame(numbers, index=table.frame.index, copy=copy), []
    counted = [name for name, column in mapped.items() if column.since_row_before]
    if counted:
        notes.append(f"the first row removed: {', '.join(counted)} are counts since the row before")
        lost.append((_SINCE_ROW_BEFORE, frame.index[:1].to_numpy()))
        frame = frame.iloc[1:]
    # certificates are of the instrument's own unit: after units and signs, before rows go
    frame, corrections = _correct_references(frame, recipe.correction, file)
    frame, dropped, incomplete = _drop_incomplete_rows(frame, required_columns, recipe)
    frame, excluded_rows = drop_excluded_rows(frame, recipe.exclude, file, table)
    if exclusion_columns:
        frame = frame.drop(columns=exclusion_columns, errors="ignore")
    return Log(
        log_name(file),
        file,
        table.sha256,
        len(table.frame),
        scratch_files.move_like(frame, table.frame),
        (*notes, *dropped, *_note_exclusions(recipe.exclude, excluded_rows, file)),
        (*reading, *corrections),
        table.parts,
        plugins=table.plugins,
        origin=mapped["time_s"].origin if "time_s" in mapped else None,
        lost=(*lost, *incomplete),
        excluded_rows=sum(excluded_rows.values()),
    )


def _map_columns(
    recipe: Recipe, table: Table, required_columns: Sequence[str], optional: Sequence[str]
) -> dict[str, MappedColumn]:
    """Canonical name → column of the log, the time first: counts per sample need it."""
    sources = _find_columns(recipe, table, required_columns, optional)
    mapped: dict[str, MappedColumn] = {}
    rate_hz = recipe.logs.rate_hz
    if "time_s" in sources:
        if rate_hz is not None:
            raise RecipeError(
                f"{table.file}: [logs] rate_hz = {rate_hz:g}, but column"
                f" '{sources['time_s']}' holds the time",
                hint="remove rate_hz, or map time_s to nothing that the log has",
            )
        mapped["time_s"] = column_values.read_time(table, sources["time_s"], recipe)
    elif rate_hz is not None:
        rows = np.arange(len(table.frame)) if table.numbers is None else table.numbers
        mapped["time_s"] = MappedColumn(rows / rate_hz, origin=Origin("numbers"))
    seconds = mapped["time_s"].numbers if "time_s" in mapped else None
    for name, source in sources.items():
        if name != "time_s":
            mapped[name] = column_values.read_values(table, source, name, recipe, seconds)
    return mapped


def _find_columns(
    recipe: Recipe, table: Table, required_columns: Sequence[str], optional: Sequence[str]
) -> dict[str, str]:
    """Canonical name → the log's own name of every column that is there.

    Raises MissingColumnError for a needed one that is not.
    """
    recipe_sources = {name: column.source for name, column in recipe.columns.items()}
    sources = {}
    for name in (*required_columns, *optional):
        source = column_values.find_column(recipe_sources.get(name, name), table)
        if source is not None:
            sources[name] = source
        elif name == "time_s" and recipe.logs.rate_hz is not None:
            continue  # rows are counted instead
        elif name in required_columns and name in recipe_sources:
            require(table.file, table.frame.columns, [recipe_sources[name]], of=name)
    present = [*table.frame.columns, *sources, *(["time_s"] if recipe.logs.rate_hz else [])]
    require(table.file, dict.fromkeys(present), required_columns)
    if "time_s" not in sources and any(
        column_values.needs_time(table, source, name, recipe) for name, source in sources.items()
    ):
        time_source = column_values.find_column(recipe_sources.get("time_s", "time_s"), table)
        if time_source is not None:
            sources["time_s"] = time_source
    return sources


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
        beyond_text = f", {int(outside.sum())} rows beyond it with the correction of its end"
        reading.append(text + beyond_text if outside.any() else text)
    return frame, tuple(reading)


def drop_excluded_rows(
    frame: pd.DataFrame,
    excludes: Sequence[Exclude],
    file: str,
    table: Table | None = None,
) -> tuple[pd.DataFrame, dict[int, int]]:
    """The frame without what the recipe excludes, its index unchanged, and number of an exclusion
    of this log → rows that it took, lines that were no rows included.

    Rows are those of the table that was read; without one each line below the first is a row.
    """
    excluded_rows = {}
    for number, exclude in enumerate(excludes):
        offset = _offset_of_part(exclude.log, file, table)
        if offset is None or exclude.whole:
            continue
        rows: Array | None = None
        if exclude.rows:
            positions = frame.index if table is None else table.frame.index.get_indexer(frame.index)
            if table is not None and table.numbers is not None:
                positions = table.numbers[positions]
            rows = np.asarray(positions, dtype=np.float64) + 1
        excluded = _find_excluded(frame, exclude, file, rows, offset)
        unread = () if table is None else table.left_out
        ranges = exclude.parts.get("lines", ())
        torn = sum(any(a <= line - offset <= b for a, b in ranges) for line in unread)
        excluded_rows[number] = int(excluded.sum()) + torn
        frame = frame[~excluded] if excluded.any() else frame
    return frame, excluded_rows


def _blank_excluded(table: Table, excludes: Sequence[Exclude]) -> Table:
    """The table with the texts of excluded lines missing, whatever they are: they are not read."""
    texts = [name for name, kind in table.frame.dtypes.items() if kind.kind not in "fiub"]
    frame = table.frame
    for exclude in excludes if texts else ():
        offset = _offset_of_part(exclude.log, table.file, table)
        if offset is not None and exclude.lines:
            excluded = _find_excluded(frame, exclude, table.file, None, offset)
            frame = frame.assign(**{str(name): frame[name].mask(excluded, "") for name in texts})
    return replace(table, frame=frame)


def _offset_of_part(log: str, file: str, table: Table | None) -> int | None:
    """What was added to the index of the rows of a log, or of a part of it; None of another log."""
    parts = dict(table.parts) if table is not None else {}
    return parts.get(log, 0 if log in (file, log_name(file)) else None)


def _find_excluded(
    frame: pd.DataFrame, exclude: Exclude, file: str, rows: Array | None, offset: int
) -> Mask:
    """Which rows [n] of a frame an exclusion takes."""
    if exclude.timed:
        require(file, frame.columns, ["time_s"])
        low = -np.inf if exclude.from_s is None else exclude.from_s
        high = np.inf if exclude.to_s is None else exclude.to_s
        inside: Mask = frame["time_s"].between(low, high).to_numpy()
        return inside
    ((key, ranges),) = exclude.parts.items()
    if key == "lines":
        coordinate = np.asarray(frame.index, dtype=np.float64) - offset + FIRST_ROW
    elif rows is not None:
        coordinate = rows
    else:
        require(file, frame.columns, [key.removesuffix("s")])
        coordinate = values(frame, key.removesuffix("s"))
    excluded: Mask = np.any([(a <= coordinate) & (coordinate <= b) for a, b in ranges], axis=0)
    return excluded


def _note_exclusions(
    excludes: Sequence[Exclude], excluded_rows: Mapping[int, int], file: str
) -> tuple[str, ...]:
    """Notes on exclusions and the rows that they took; RecipeError for one that took none."""
    notes = []
    for number, rows in excluded_rows.items():
        exclude = excludes[number]
        part = _describe_part(exclude)
        if not rows:
            raise RecipeError(
                f"[[exclude]] of {file}: no row {part}",
                hint=f"check {' and '.join(exclude.parts) or 'from_s and to_s'}",
                at=("exclude", number),
            )
        notes.append(f"{rows} rows {part} excluded by {exclude.person}: {exclude.reason}")
    return tuple(notes)


def _describe_part(exclude: Exclude) -> str:
    """The part of a log that is left out, in words."""
    for key, ranges in exclude.parts.items():
        ranges_text = ", ".join(f"{a}" if a == b else f"{a}-{b}" for a, b in ranges)
        return f"with number {ranges_text}" if key == "rows" else f"in {key} {ranges_text}"
    if exclude.from_s is not None and exclude.to_s is not None:
        return f"between {exclude.from_s:.12g} s and {exclude.to_s:.12g} s"
    ends = (("from", exclude.from_s), ("up to", exclude.to_s))
    return " ".join(f"{word} {end:.12g} s" for word, end in ends if end is not None)


def _drop_incomplete_rows(
    frame: pd.DataFrame, required_columns: Sequence[str], recipe: Recipe
) -> tuple[pd.DataFrame, tuple[str, ...], list[tuple[str, Integers]]]:
    """The frame without rows that lack a needed value, where the recipe says so, a note on how
    many, which and why, and the rows by the first value that they lack.
    """
    if recipe.logs.missing == "refuse":
        return frame, (), []
    absent = frame[[name for name in required_columns if name in frame.columns]].isna()
    incomplete = absent.any(axis=1).to_numpy()
    if not incomplete.any():
        return frame, (), []
    why = ", ".join(f"{rows} without {name}" for name, rows in absent.sum().items() if rows)
    lines = format_ranges([int(row) + 2 for row in frame.index[incomplete]])
    note = f'{int(incomplete.sum())} rows removed ({why}), lines {lines}: missing = "drop"'
    first = absent[incomplete].idxmax(axis=1)
    lost = [(f"no {name}", rows.index.to_numpy()) for name, rows in first.groupby(first)]
    return frame[~incomplete], (note,), lost

"""A log that is larger than memory should be: read a piece at a time into columns on disk, and
worked on from there.

Its frame is like any other, but its columns lie in scratch files; what a fit computes along them
goes span by span into arrays that lie there too, so that the numbers are those of a log in memory.
Only clean CSV can be read like this.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from calibkit import units
from calibkit.arrays import Array
from calibkit.errors import UsageError
from calibkit.frame import Log, values
from calibkit.ingest import mapping, scratch
from calibkit.numeric.chunks import release
from calibkit.readers import clean
from calibkit.recipe import Recipe

SETTING = "CALIBKIT_LARGEST_LOG_MB"
"""Environment variable: megabytes of a log up to which it is held in memory."""
LARGEST_MB = 1000.0
ROWS = 1 << 19
"""Rows that are read at a time."""


def _largest_in_memory() -> float:
    """Bytes of a log up to which it is held in memory; raises UsageError for a setting that is not
    a number.
    """
    stated = os.environ.get(SETTING, "")
    try:
        megabytes = float(stated) if stated else LARGEST_MB
    except ValueError:
        megabytes = -1.0
    if not megabytes >= 0.0:
        raise UsageError(
            f"{SETTING}={stated}: expected megabytes", hint=f"unset it for {LARGEST_MB:g}"
        )
    return megabytes * 1e6


def read_to_disk(
    recipe: Recipe, path: Path, file: str, needed: Sequence[str], optional: Sequence[str] = ()
) -> Log | None:
    """A large clean log with its columns on disk; none for a log that is held in memory. Raises as
    `ingest.read_log`.
    """
    if (
        not (recipe.along_chunks and can_be_chunked(recipe))
        or not path.is_file()
        or path.stat().st_size <= _largest_in_memory()
    ):
        return None
    scan = clean.scan_file(path, file)
    if scan is None:
        return None
    plain = recipe.model_copy(update={"exclude": ()})
    kept: dict[str, Array] = {}
    lines, row = scratch.allocate_column(scan.rows), 0
    taken: dict[int, int] = {}
    notes: dict[str, None] = {}
    part: Log | None = None
    for table in clean.read_chunks(path, file, scan, ROWS):
        part = mapping.map_log(plain, table, needed, optional)
        frame, out = mapping.drop_excluded_rows(part.frame, recipe.exclude, file)
        kept = kept or {str(name): scratch.allocate_column(scan.rows) for name in frame.columns}
        for name, column in (*kept.items(), ("", lines)):
            column[row : row + len(frame)] = values(frame, name) if name else frame.index.to_numpy()
            release(column)
        row += len(frame)
        taken = {number: taken.get(number, 0) + rows for number, rows in out.items()}
        notes |= dict.fromkeys(part.notes)
    assert part is not None  # noqa: S101 (a clean file has rows)
    noted = (*notes, *mapping.note_exclusions(recipe.exclude, taken, file))
    frame = pd.DataFrame(
        {name: column[:row] for name, column in kept.items()}, index=_index(lines[:row]), copy=False
    )
    return Log(
        part.name,
        file,
        scan.sha256,
        scan.rows,
        frame,
        noted,
        part.reading,
        room=scratch.allocate_column,
    )


def _index(lines: Array) -> pd.Index:
    """Index of rows that were kept: a range where none was left out."""
    first = int(lines[0]) if lines.size else 0
    if not lines.size or lines[-1] - first == lines.size - 1:
        return pd.RangeIndex(first, first + lines.size)
    return pd.Index(lines.astype(np.int64))


def can_be_chunked(recipe: Recipe) -> bool:
    """Whether each row of the recipe's logs can be mapped without the rows before it."""
    stateful = any(
        column.accumulated or column.wraps_at or column.time_format or column.date
        for column in recipe.columns.values()
    )
    plain = (
        recipe.logs.format in ("auto", "csv") and not recipe.logs.names and not recipe.logs.split
    )
    per_sample = any(
        units.known(column.unit) == "1/sample" for column in recipe.columns.values() if column.unit
    )
    return plain and not stateful and not per_sample and recipe.chamber is None

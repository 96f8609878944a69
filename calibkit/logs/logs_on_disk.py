"""A log that is larger than memory should be: read in chunks into columns on disk, and processed
from there.

Its frame is like any other, but its columns lie in scratch files: unnamed, and gone with the array.
A system that runs short of memory writes their pages back; what a fit computes of a few of them at
a time is in memory. Only clean CSV can be read like this.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import OutputError, UsageError
from calibkit.logs import mapping
from calibkit.readers import clean
from calibkit.records.frame import Log, values

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.numeric.arrays import Array, Integers
    from calibkit.recipe import Recipe

SETTING = "CALIBKIT_LARGEST_LOG_MB"
"""Environment variable: megabytes of a log up to which it is held in memory; worked on there, it
takes some four times as much.
"""
LARGEST_MB = 200.0
ROWS = 1 << 19
"""Rows that are read at a time."""


def largest_in_memory() -> float:
    """Bytes of a log up to which it is held in memory; raises UsageError for a setting that is not
    a number.
    """
    setting = os.environ.get(SETTING, "")
    try:
        megabytes = float(setting) if setting else LARGEST_MB
    except ValueError:
        megabytes = -1.0
    if not megabytes >= 0.0:
        raise UsageError(
            f"{SETTING}={setting}: expected megabytes", hint=f"unset it for {LARGEST_MB:g}"
        )
    return megabytes * 1e6


def read_to_disk(
    recipe: Recipe,
    path: Path,
    file: str,
    required_columns: Sequence[str],
    optional: Sequence[str] = (),
) -> Log | None:
    """A large clean log with its columns on disk; None for a log that is held in memory. Raises as
    `log_files.read_log`.
    """
    scan = scan_large_log(recipe, path, file, largest_in_memory())
    if scan is None:
        return None
    import pandas as pd

    without_exclusions = recipe.model_copy(update={"exclude": ()})
    columns_on_disk: dict[str, Array] = {}
    lines, row = _allocate_column(scan.rows), 0
    excluded_rows: dict[int, int] = {}
    notes: dict[str, None] = {}
    lost: list[tuple[str, Integers]] = []
    part: Log | None = None
    for table in clean.read_chunks(path, file, scan, ROWS):
        part = mapping.map_log(without_exclusions, table, required_columns, optional)
        frame, excluded_in_chunk = mapping.drop_excluded_rows(part.frame, recipe.exclude, file)
        columns_on_disk = columns_on_disk or {
            str(name): _allocate_column(scan.rows) for name in frame.columns
        }
        for name, column in (*columns_on_disk.items(), ("", lines)):
            column[row : row + len(frame)] = values(frame, name) if name else frame.index.to_numpy()
        row += len(frame)
        excluded_rows = {
            number: excluded_rows.get(number, 0) + rows
            for number, rows in excluded_in_chunk.items()
        }
        notes |= dict.fromkeys(part.notes)
        lost += part.lost
    assert part is not None  # noqa: S101 (a clean file has rows)
    index = _index(lines[:row])
    columns = {name: column[:row] for name, column in columns_on_disk.items()}
    return replace(
        part,
        rows=scan.rows,
        frame=pd.DataFrame(columns, index, copy=False),
        notes=(*notes, *mapping.note_exclusions(recipe.exclude, excluded_rows, file)),
        lost=tuple(lost),
        excluded_rows=sum(excluded_rows.values()),
    )


def _index(lines: Array) -> pd.Index:
    """Index of the lines [n] of rows, without memory of its own where none is left out."""
    import pandas as pd

    first = int(lines[0]) if lines.size else 0
    if lines.size and lines[-1] != first + lines.size - 1:  # rows were left out
        return pd.Index(lines.astype(np.int64))
    return pd.RangeIndex(first, first + lines.size)


def scan_large_log(recipe: Recipe, path: Path, file: str, largest: float) -> clean.Scan | None:
    """Scan of a clean log of more than `largest` bytes whose rows can each be mapped without the
    rows before it; None for one that is read whole.
    """
    stateful = any(
        column.accumulated
        or column.wraps_at
        or column.time_format
        or column.date
        or (column.unit and units.known(column.unit) == "1/sample")
        for column in recipe.columns.values()
    )
    stateful |= any(entry.positions or entry.stations for entry in recipe.exclude)
    logs = recipe.logs
    plain_csv = logs.format in ("auto", "csv") and not logs.names and not logs.split
    stateful |= logs.rate_hz is not None  # rows are counted
    if stateful or not plain_csv or recipe.chamber is not None:
        return None
    large = path.is_file() and path.stat().st_size > largest
    return clean.scan_file(path, file) if large else None


def _allocate_column(rows: int) -> Array:
    """Room an array [rows], not initialised, in a file of the system's folder for temporary
    files (TMPDIR).

    The file is gone when the array is, and when the process ends, however it ends. Raises
    OutputError where the disk is full.
    """
    size = 8 * max(rows, 1)
    try:
        with tempfile.TemporaryFile(prefix="calibkit-") as file:
            if hasattr(os, "posix_fallocate"):
                # a full disk is an error here, not a signal later
                os.posix_fallocate(file.fileno(), 0, size)
            else:
                file.truncate(size)
            mapped = mmap.mmap(file.fileno(), size)
    except OSError as error:
        raise OutputError(
            f"{tempfile.gettempdir()}: no room for {size / 1e6:.0f} MB of scratch:"
            f" {error.strerror}",
            hint="make room there, or name a folder on a larger disk in TMPDIR",
        ) from None
    return np.frombuffer(mapped, dtype=np.float64, count=rows)

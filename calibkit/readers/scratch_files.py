"""Columns of logs that are larger than memory should be, in scratch files: unnamed, and gone with
the array.

They are arrays like any other. A system that runs short of memory writes their pages back; what a
fit computes of a few of them at a time is in memory.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import OutputError, UsageError

if TYPE_CHECKING:
    import pandas as pd

    from calibkit.numeric.arrays import Array

SETTING = "CALIBKIT_LARGEST_LOG_MB"
"""Environment variable: megabytes of a log up to which it is held in memory; worked on there, it
takes some four times as much.
"""
LARGEST_MB = 200.0


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


def allocate_column(rows: int) -> Array:
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


def move_like(frame: pd.DataFrame, like: pd.DataFrame) -> pd.DataFrame:
    """The frame with its numbers in scratch files, where those of another frame lie there."""
    # a log of which the first column is text is no clean CSV, which alone lies there
    if like.empty or like.dtypes.iloc[0].kind != "f" or not _is_on_disk(like.iloc[:, 0].to_numpy()):
        return frame
    import pandas as pd

    columns = {}
    for name, column in frame.items():
        columns[name] = column.to_numpy()
        if not _is_on_disk(columns[name]):
            columns[name] = allocate_column(len(frame))
            columns[name][:] = column.to_numpy(dtype=np.float64)
    return pd.DataFrame(columns, frame.index, copy=False)


def _is_on_disk(column: Array) -> bool:
    """Whether the memory of an array is that of a scratch file."""
    owner: object = column
    while isinstance(owner, np.ndarray):
        owner = owner.base
    return isinstance(owner.obj if isinstance(owner, memoryview) else owner, mmap.mmap)

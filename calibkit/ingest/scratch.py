"""Arrays on disk, for what memory should not hold: in unnamed files that vanish with the array."""

import mmap
import os
import tempfile

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import OutputError


def allocate_column(rows: int) -> Array:
    """Allocate an array [rows], not initialised, in a file of the system's folder for temporary
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

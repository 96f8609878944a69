"""How the process of a command handles its memory: a library leaves that to the program that uses
it.
"""

import contextlib
import gc
import sys

_TRIM, _MAPPED = -1, -3
"""M_TRIM_THRESHOLD and M_MMAP_THRESHOLD of glibc's mallopt."""
COLUMN = 1 << 24
"""Bytes from which an array is a column of a long log: the system has it back as soon as it is
released.
"""
_COLLECTED = (50_000, 20, 20)
"""Thresholds of Python's garbage collector: objects made, and collections of a younger generation.
"""


def tune_memory() -> None:
    """Set how the process of a command that reads logs handles memory, before it imports its
    libraries.

    Python's own thresholds make it look for cycles among all that was imported dozens of times, and
    find next to none: a tenth of a small fit. glibc by itself keeps columns in its heaps, several
    logs of them, once one of their size was released. Its two bounds are set together: with the
    size of columns alone it would give back the top of a heap after every smaller array.
    """
    gc.set_threshold(*_COLLECTED)
    if sys.platform != "linux":
        return
    import ctypes

    with contextlib.suppress(OSError, AttributeError):  # another C library than glibc
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MAPPED, COLUMN)
        mallopt(_TRIM, 2 * COLUMN)

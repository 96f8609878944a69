"""Whether a log's columns lie in scratch files."""

import mmap

from calibkit.records.frame import values


def on_disk(log):
    """Whether the first column of a log is mapped from a file."""
    base = values(log.frame, str(log.frame.columns[0]))
    while base is not None and not isinstance(base, mmap.mmap):
        base = base.obj if isinstance(base, memoryview) else getattr(base, "base", None)
    return base is not None

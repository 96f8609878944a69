"""Fixtures of logs: whether their columns lie in scratch files."""

import mmap

import pytest

from calibkit.records.frame import values


@pytest.fixture
def is_mapped():
    """Return whether the first column of a log is mapped from a file, as a function."""

    def in_scratch(log):
        base = values(log.frame, str(log.frame.columns[0]))
        while base is not None and not isinstance(base, mmap.mmap):
            base = base.obj if isinstance(base, memoryview) else getattr(base, "base", None)
        return base is not None

    return in_scratch

"""Fixtures of what is written: runs whose firmware is exported."""

import pytest

from outputs.firmware_runs import cached


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    """Return a function that fits one of the runs of `firmware_runs`, once."""
    return lambda name: cached(name, tmp_path_factory)

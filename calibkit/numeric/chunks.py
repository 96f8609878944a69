"""Ranges, means, runs and extremes along long columns."""

from collections.abc import Iterator

import numpy as np

from calibkit.numeric.arrays import Array, Integers, Mask

ROWS = 1 << 17
"""Rows of a chunk: a few columns of this length fit in a processor's cache."""


def ranges(size: int, rows: int = ROWS) -> Iterator[tuple[int, int]]:
    """First row and row after the last of consecutive chunks of so many rows."""
    for start in range(0, size, rows):
        yield start, min(start + rows, size)


def extremes(values: Array) -> tuple[float, float]:
    """Smallest and largest of values [n]; NaN if a value is NaN or if there is no value."""
    if not values.size:
        return float("nan"), float("nan")
    return float(np.min(values)), float(np.max(values))


def extremes_of_present(values: Array) -> tuple[float, float]:
    """Smallest and largest of those values [n] that are not NaN; NaN if there is none."""
    low = np.fmin.reduce(values, initial=np.nan)
    return float(low), float(np.fmax.reduce(values, initial=np.nan))


def block_means(values: Array, rows: int) -> Array:
    """Means [n // rows, …] of consecutive blocks of so many rows of values [n, …]; NaN where a
    block has one.
    """
    whole = values[: len(values) // rows * rows]
    return np.asarray(whole.reshape(-1, rows, *values.shape[1:]).mean(axis=1))


def find_runs(mask: Mask) -> Integers:
    """First row and row after the last [m, 2] of each run of rows for which a mask [n] holds."""
    edges = np.diff(mask, prepend=False, append=False)
    return np.flatnonzero(edges).reshape(-1, 2)

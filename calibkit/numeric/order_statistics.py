"""Medians of columns and of their runs, and the smallest step of a reading."""

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import chunks


def median(values: Array) -> float:
    """Median of values [n]; NaN for no value, or where one is NaN."""
    return float(np.median(values)) if values.size else float("nan")


def run_medians(values: Array, first: Integers) -> Array:
    """Medians [m] of the runs of finite values [n] that begin at rows `first` [m], equal to those
    of `np.median`; every run has a value. Runs of equal size are taken together.
    """
    count = np.diff(np.append(first, values.size))
    medians = np.empty(first.size)
    for size in np.unique(count).tolist():
        of_size = np.flatnonzero(count == size)
        for begin, stop in chunks.ranges(of_size.size, max(1, chunks.ROWS // size)):
            runs = of_size[begin:stop]
            medians[runs] = np.median(values[first[runs, None] + np.arange(size)], axis=1)
    return medians + 0.0  # a zero is positive


def smallest_step(values: Array, *, fine_step: float = 0.0, decimals: int | None = None) -> float:
    """Smallest difference between two distinct values of a column [n], rounded if `decimals` is
    given; 0 if all are equal.

    The search ends at the first difference of at most `fine_step`, so that distinct values of noise
    are not all collected.
    """
    levels, step = np.zeros(0), 0.0
    for start, stop in chunks.ranges(values.size):
        part = values[start:stop]
        new = np.unique(part if decimals is None else np.round(part, decimals))
        if levels.size and np.isin(new, levels, assume_unique=True).all():
            continue
        levels = np.union1d(levels, new)
        step = float(np.min(np.diff(levels))) if levels.size > 1 else 0.0
        if 0.0 < step <= fine_step:
            break
    return step

"""Medians of columns and of their runs, and the smallest step of a reading."""

import math

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric import chunks


def median(values: Array) -> float:
    """Median of values [n]; NaN for no value, or where one is NaN."""
    if not values.size or np.isnan(values.max()):
        return float("nan")
    return float(_median_of_parted(np.partition(values, values.size // 2), values.size))


def run_medians(values: Array, first: Integers) -> Array:
    """Medians [m] of the runs of finite values [n] that begin at rows `first` [m], equal to those
    of `np.median`; every run has a value. Runs of equal size are partitioned together.
    """
    count = np.diff(np.append(first, values.size))
    medians = np.empty(first.size)
    for size in np.unique(count).tolist():
        of_size = np.flatnonzero(count == size)
        for begin, stop in chunks.ranges(of_size.size, max(1, chunks.ROWS // size)):
            runs = of_size[begin:stop]
            part = values[first[runs, None] + np.arange(size)]
            part.partition(size // 2, axis=1)
            medians[runs] = _median_of_parted(part, size)
    return medians + 0.0  # a zero is positive


def median_magnitude(values: Array, centre: float = 0.0) -> float:
    """Median of |values − centre| of values [n]; the mean of the two middle ones for even n.
    `centre` is 0, or the median for the median absolute deviation.

    Raises FitError for no value, or one that is not finite.
    """
    if not values.size:
        raise FitError("no values have a median")
    magnitudes = np.abs(values - centre) if centre else np.abs(values)
    if not math.isfinite(float(magnitudes.max())):
        raise FitError("a value that is not finite has no place in a median", hint="exclude it")
    magnitudes.partition(magnitudes.size // 2)
    return float(_median_of_parted(magnitudes, magnitudes.size))


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


def _median_of_parted(parted: Array, size: int) -> Array:
    """Median along the last axis of values partitioned at index size // 2.

    For even sizes the lower middle value is the maximum of those below: numpy's selection of one
    element is vectorised, that of two is not and takes five times as long.
    """
    upper = parted[..., size // 2]
    return upper if size % 2 else np.asarray((parted[..., : size // 2].max(axis=-1) + upper) / 2.0)

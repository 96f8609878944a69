"""Medians of columns, the smallest step of a reading, and how far values scatter: root mean square,
and the standard deviation that the median absolute deviation stands for.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array, Integers

MAD_TO_SIGMA = 1.4826022185056018
"""Standard deviation of a normal distribution over its median absolute deviation, 1/Φ⁻¹(3/4)."""
MAD_OF_UNIT_NORMAL = 0.6745
"""Median absolute deviation of a normal distribution of unit variance, to the digits that wavelet
thresholds are published with (Donoho & Johnstone 1994).
"""


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
            by_run = values[first[runs, None] + np.arange(size)]
            medians[runs] = np.median(by_run, axis=1, overwrite_input=True)
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
        # finer than anybody asks: noise has as many values as rows
        if 0.0 < step <= fine_step:
            break
    return step


def mad_sigma(deviations: Array) -> float:
    """Standard deviation of normal noise from the median magnitude of deviations [n] from its
    centre: outliers, up to half of the values, hardly move it.
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(deviations), overwrite_input=True))


def rms(values: ArrayLike) -> float:
    """Root mean square of values [n]; NaN for no values."""
    square = np.asarray(values, dtype=np.float64) ** 2
    return float(np.sqrt(np.mean(square))) if square.size else float("nan")


_PARTS, _ROWS_OF_PART = 32, (16, 4096)
"""Parts of a stretch that its noise is measured within, and fewest and most rows of a part."""


def variances_within(residuals: Array, indication: Array) -> Array:
    """Variances [k] of residuals [n] within consecutive parts, none below that of the rounding of
    their indication [n]; their median is the noise where less than half of the parts are disturbed,
    and correlation is part of it.
    """
    fewest_rows, most_rows = _ROWS_OF_PART
    most_parts = max(_PARTS, residuals.size // most_rows)
    count = int(np.clip(residuals.size // fewest_rows, 1, most_parts))
    steps = np.abs(np.diff(indication))
    step = float(np.min(steps, where=steps > 0.0, initial=np.inf))
    # variance of a rectangular distribution one step wide: a quiet counter repeats its value
    rounding = step**2 / 12.0 if np.isfinite(step) else 0.0
    return np.maximum([np.var(part) for part in np.array_split(residuals, count)], rounding)


def over_noise(scatter: float, variances: Iterable[Array]) -> float:
    """A standard deviation over the noise, the root of the median of variances within parts; 0
    where all values are equal.
    """
    noise = float(np.sqrt(np.median(np.concatenate(list(variances)))))
    return scatter / noise if noise > 0.0 else 0.0

"""Block means that a spike cannot move, and weights that keep the temperatures a log dwells at from ruling the fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric import drift
from calibkit.numeric.robust import MAD_TO_SIGMA

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Mask = NDArray[np.bool_]

SPIKE = 5.0
"""Deviation from its block's median, in standard deviations, above which a sample is a spike: 6 of 10 million normal ones."""
BIN_DEGC = 2.5
"""Width of the temperature bins that occupancy is counted in: a model's misfit does not change within it."""


def spikes(indication: Array, index: NDArray[np.int64]) -> Mask:
    """Samples [n] of an indication [n] that stand out of their block (numbered by index [n], ascending).

    A sample is compared with its block's median. The standard deviation is that of the whole log's deviations, by their
    median absolute value, or the block's own where that is larger: where the indication truly moves within a block, nothing
    is a spike. Where most samples are alike (counts of a quiet gyro) the smallest step stands in for it. Of two samples in a
    block neither stands out.
    """
    first, number = _starts(index)
    deviation = np.abs(indication - _medians(indication, first)[number])
    own = _medians(deviation, first)
    steps = deviation[deviation > 0.0]
    whole = float(np.median(deviation)) or (float(steps.min()) if steps.size else 0.0)
    sigma = MAD_TO_SIGMA * np.maximum(own, whole)[number]
    return np.asarray(deviation > SPIKE * sigma)


def _starts(index: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First sample of each block [m], and the block of each sample [n], of ascending indices [n]."""
    new = np.concatenate(([True], index[1:] != index[:-1]))
    return np.flatnonzero(new), np.cumsum(new) - 1


def _medians(values: Array, first: NDArray[np.int64]) -> Array:
    """Median of each block [m] from values [n] whose blocks start at `first`; blocks of one size are partitioned together."""
    count = np.diff(np.append(first, values.size))
    out = np.empty(first.size)
    for size in np.unique(count).tolist():
        same = np.flatnonzero(count == size)
        low, high = (size - 1) // 2, size // 2
        parted = np.partition(values[first[same, None] + np.arange(size)], (low, high), axis=1)
        out[same] = (parted[:, low] + parted[:, high]) / 2.0
    return out


def block_means(time: Array, values: Array, interval_s: float, *, keep: Mask | None = None) -> tuple[Array, Array]:
    """Means [m] of time [s] and values over the model intervals that hold a sample.

    Only samples to keep enter the means of the values; a block of which none is kept has the mean of all.
    Raises FitError when the log is sampled more slowly than the model interval.
    """
    first, number = _starts(drift.block_index(time, interval_s))
    kept = np.ones(time.size) if keep is None else keep.astype(np.float64)
    kept = np.where((np.add.reduceat(kept, first) > 0.0)[number], kept, 1.0)
    means = np.add.reduceat(values * kept, first) / np.add.reduceat(kept, first)
    size = np.diff(np.append(first, time.size))
    return np.add.reduceat(time, first) / size, np.asarray(means, dtype=np.float64)


def counts(temperature: Array, width: float = BIN_DEGC) -> Array:
    """How many of the temperatures [n, °C] lie in each one's own bin of that width: [n]."""
    _, number, count = np.unique(np.floor(temperature / width), return_inverse=True, return_counts=True)
    return np.asarray(count[number], dtype=np.float64)


def weights(count: Array, noise: float, misfit: float) -> Array:
    """Weights [n] of blocks whose temperature is occupied by count [n] blocks, 1 on average.

    The mean over a bin has variance noise²/count from noise and misfit² from the model, which does not average: a bin is
    worth count/(noise² + count misfit²) in all, each of its blocks 1/(noise² + count misfit²). Without misfit all blocks
    count alike; without noise all temperatures do, however long they were dwelt at.
    """
    largest = max(noise, misfit)
    if largest == 0.0:
        return np.ones_like(count)
    raw = 1.0 / ((noise / largest) ** 2 + count * (misfit / largest) ** 2)
    return np.asarray(raw / np.mean(raw), dtype=np.float64)


def misfit(residuals: Array, trust: Array, lags: Sequence[int]) -> float:
    """Misfit [°/h] of a model along one log: root of the mean product of residuals [n] that are some blocks apart.

    White noise drops out of such products; what lasts for longer than the lags does not. `trust` [n] weighs the rows, and the
    mean is 0 where it comes out negative.
    """
    products, shares = 0.0, 0.0
    weighted = residuals * trust
    for lag in lags:
        if lag < residuals.size:
            products += float(weighted[lag:] @ weighted[:-lag])
            shares += float(trust[lag:] @ trust[:-lag])
    return float(np.sqrt(max(products, 0.0) / shares)) if shares > 0.0 else 0.0

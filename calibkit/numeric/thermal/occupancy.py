"""Block means without spikes, and weights that limit the influence of temperatures at which a log
dwells.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import chunks, order_statistics
from calibkit.numeric.dispersion import MAD_TO_SIGMA
from calibkit.numeric.intervals import Intervals

SPIKE = 5.0
"""Deviation from the median of the interval, in standard deviations, above which a sample is a
spike: 6 of 10 million normal samples are.
"""
BIN_DEGC = 2.5
"""Width of the temperature bins for the occupancy [°C]; model misfit is constant within a bin."""


def spikes(indication: Array, held: Intervals) -> Integers:
    """Rows [k] of the spikes in an indication [n].

    A sample is compared with the median of its model interval. The standard deviation is estimated
    from the median absolute deviation over the whole log or over the interval, whichever is larger,
    so that true changes within an interval are not spikes. If most samples equal their median
    (counts of a quiet gyro), the smallest non-zero deviation is used instead. With two samples in
    an interval neither is a spike.
    """
    own, middles, largest = (np.empty(held.first.size) for _ in range(3))
    for among, rows in held.groups():
        first = held.first[among] - rows.start
        middles[among] = order_statistics.run_medians(indication[rows], first)
        away = _deviation(indication[rows], middles[among], held.count[among])
        own[among] = order_statistics.run_medians(away, first)
        largest[among] = np.maximum.reduceat(away, first)
        chunks.release(indication)

    def deviations() -> Iterator[Array]:
        for among, rows in held.groups():
            yield _deviation(indication[rows], middles[among], held.count[among])
            chunks.release(indication)

    whole = order_statistics.median_of_chunks(deviations, held.rows)
    if whole == 0.0:
        whole = min(
            (float(part[part > 0.0].min()) for part in deviations() if part.any()), default=0.0
        )
    limit = SPIKE * MAD_TO_SIGMA * np.maximum(own, whole)
    found = [np.zeros(0, dtype=np.int64)]
    for k in np.flatnonzero(largest > limit).tolist():
        start = int(held.first[k])
        part = indication[start : start + int(held.count[k])]
        found.append(np.flatnonzero(np.abs(part - middles[k]) > limit[k]) + start)
    return np.concatenate(found)


def _deviation(values: Array, middles: Array, count: Integers) -> Array:
    """Absolute deviations [n] of values [n] from the medians [m] of their intervals of `count` [m]
    samples.
    """
    away = np.repeat(middles, count)
    np.subtract(values, away, out=away)
    return np.abs(away, out=away)


def means(values: Array, held: Intervals, *, without: Integers) -> Array:
    """Means [m] of values [n] over the model intervals without the rows `without` [k]; an interval
    with no other rows keeps them.
    """
    found = held.means(values)
    hit, at = np.unique(np.searchsorted(held.first, without, side="right") - 1, return_index=True)
    ends = np.append(at, without.size)
    for k, interval in enumerate(hit.tolist()):
        first, count = int(held.first[interval]), int(held.count[interval])
        kept = np.ones(count, dtype=np.bool_)
        kept[without[ends[k] : ends[k + 1]] - first] = False
        if kept.any():
            found[interval] = np.mean(values[first : first + count][kept])
    return found


def counts(temperature: Array, width: float = BIN_DEGC) -> Array:
    """Numbers [n] of temperatures [n, °C] in the same bin as each."""
    _, number, count = np.unique(
        np.floor(temperature / width), return_inverse=True, return_counts=True
    )
    return np.asarray(count[number], dtype=np.float64)


def weights(count: Array, noise: float, misfit: float) -> Array:
    """Weights [n], mean 1, of blocks whose temperature bins hold `count` [n] blocks.

    The mean over a bin has the variance noise²/count from noise and misfit² from the model, which
    does not average out. A bin therefore has weight count/(noise² + count misfit²) and each of its
    blocks 1/(noise² + count misfit²). Without misfit all blocks have equal weight, without noise
    all bins.
    """
    largest = max(noise, misfit)
    if largest == 0.0:
        return np.ones_like(count)
    raw = 1.0 / ((noise / largest) ** 2 + count * (misfit / largest) ** 2)
    return np.asarray(raw / np.mean(raw), dtype=np.float64)


def misfit(residuals: Array, robust: Array, lags: Sequence[int]) -> float:
    """Misfit [°/h] of a model along one log: root of the mean product of residuals [n, °/h] at the
    given lags [blocks].

    White noise is uncorrelated at these lags; slower deviations remain. The products are weighted
    by the robust weights [n]; a negative mean counts as 0.
    """
    products, shares = 0.0, 0.0
    weighted = residuals * robust
    for lag in lags:
        if lag < residuals.size:
            products += float(weighted[lag:] @ weighted[:-lag])
            shares += float(robust[lag:] @ robust[:-lag])
    return float(np.sqrt(max(products, 0.0) / shares)) if shares > 0.0 else 0.0

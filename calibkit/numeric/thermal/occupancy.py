"""Block means without spikes."""

from collections.abc import Iterator

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import chunks, order_statistics
from calibkit.numeric.dispersion import MAD_TO_SIGMA
from calibkit.numeric.intervals import Intervals

SPIKE = 5.0
"""Deviation from the median of the interval, in standard deviations, above which a sample is a
spike: 6 of 10 million normal samples are.
"""


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

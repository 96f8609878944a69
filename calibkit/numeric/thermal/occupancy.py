"""Block means of an indication without spikes: samples farther from the median of their model
interval than 5 σ, with σ by the median absolute deviation (`spikes`).
"""

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


def spikes(indication: Array, intervals: Intervals) -> Integers:
    """Rows [k] of the spikes in an indication [n].

    A sample is compared with the median of its model interval. The standard deviation is estimated
    from the median absolute deviation over the whole log or over the interval, whichever is larger,
    so that true changes within an interval are not spikes. If most samples equal their median
    (counts of a quiet gyro), the smallest non-zero deviation is used instead. With two samples in
    an interval neither is a spike.
    """
    deviation, middles, largest = (np.empty(intervals.first.size) for _ in range(3))
    for chunk, rows in intervals.groups():
        first = intervals.first[chunk] - rows.start
        middles[chunk] = order_statistics.run_medians(indication[rows], first)
        distances = _deviation(indication[rows], middles[chunk], intervals.count[chunk])
        deviation[chunk] = order_statistics.run_medians(distances, first)
        largest[chunk] = np.maximum.reduceat(distances, first)
        chunks.release(indication)

    def deviations() -> Iterator[Array]:
        for chunk, rows in intervals.groups():
            yield _deviation(indication[rows], middles[chunk], intervals.count[chunk])
            chunks.release(indication)

    log_deviation = order_statistics.median_of_chunks(deviations, intervals.rows)
    if log_deviation == 0.0:
        log_deviation = min(
            (float(part[part > 0.0].min()) for part in deviations() if part.any()), default=0.0
        )
    limit = SPIKE * MAD_TO_SIGMA * np.maximum(deviation, log_deviation)
    rows_of_spikes = [np.zeros(0, dtype=np.int64)]
    for k in np.flatnonzero(largest > limit).tolist():
        start = int(intervals.first[k])
        part = indication[start : start + int(intervals.count[k])]
        rows_of_spikes.append(np.flatnonzero(np.abs(part - middles[k]) > limit[k]) + start)
    return np.concatenate(rows_of_spikes)


def _deviation(values: Array, middles: Array, count: Integers) -> Array:
    """Absolute deviations [n] of values [n] from the medians [m] of their intervals of `count` [m]
    samples.
    """
    distances = np.repeat(middles, count)
    np.subtract(values, distances, out=distances)
    return np.abs(distances, out=distances)


def means(values: Array, intervals: Intervals, *, excluded: Integers) -> Array:
    """Means [m] of values [n] over the model intervals without the `excluded` rows [k]; an interval
    with no other rows keeps them.
    """
    averages = intervals.means(values)
    hit, first_excluded = np.unique(
        np.searchsorted(intervals.first, excluded, side="right") - 1, return_index=True
    )
    ends = np.append(first_excluded, excluded.size)
    for k, interval in enumerate(hit.tolist()):
        first, count = int(intervals.first[interval]), int(intervals.count[interval])
        sound = np.ones(count, dtype=np.bool_)
        sound[excluded[ends[k] : ends[k + 1]] - first] = False
        if sound.any():
            averages[interval] = np.mean(values[first : first + count][sound])
    return averages

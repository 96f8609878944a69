"""Block means of an indication without spikes: samples farther from the median of their model
interval than 5 σ, with σ by the median absolute deviation (`spikes`).
"""

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import order_statistics
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
    middles = order_statistics.run_medians(indication, intervals.first)
    distances = np.abs(indication - np.repeat(middles, intervals.count))
    log_deviation = order_statistics.median(distances)
    if log_deviation == 0.0 and distances.any():
        log_deviation = float(distances[distances > 0.0].min())
    deviation = order_statistics.run_medians(distances, intervals.first)
    limit = SPIKE * MAD_TO_SIGMA * np.maximum(deviation, log_deviation)
    return np.flatnonzero(distances > np.repeat(limit, intervals.count))


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

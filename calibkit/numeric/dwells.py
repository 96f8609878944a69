"""Dwells in continuous logs: where a triad was held still, and the mean and noise of each hold.

A row is still where the standard deviation of the window around it is at most twice that of the
quietest quarter of the log. The error of a mean is s/√n, or that of the means of batches where
these scatter more.
"""

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import chunks, dispersion
from calibkit.numeric.arrays import Array, Integers

STILL_FACTOR = 2.0
"""Windowed noise, over the noise at rest, up to which a sample counts as held still."""
AT_REST_SHARE = 0.25
"""Share of the log that is certainly at rest: its quietest quarter sets the noise at rest."""
BATCHES = 16
"""Batches of a dwell whose means show noise that does not average out."""


def find_dwells(
    indication: Array,
    window: int,
    *,
    threshold: float | None = None,
    shortest: int | None = None,
) -> Integers:
    """Find the intervals in which a triad was held still.

    The noise of a sample is the standard deviation of the window around it, the three axes
    together. A sample is still where that is below twice the noise at rest, which is the
    upper end of the quietest quarter of the log, so a log has to be at rest for a quarter of its
    time or state the threshold.

    Parameters
    ----------
    indication
        [n, 3], rows at even intervals; cut the log at gaps first.
    window
        Rows of the window, about a second.
    threshold
        Noise [unit of the indication] in place of twice the noise at rest.
    shortest
        Rows below which an interval is not a dwell; twice the window when absent.

    Returns
    -------
    [m, 2], first row and the row after the last. Half a window at both ends of every hold is left
    out.

    Raises
    ------
    FitError
        For a log shorter than four windows, or one in which nothing was held still.

    """
    if window < 4 or len(indication) < 4 * window:
        raise FitError(
            f"{len(indication)} rows for windows of {window}",
            hint="a window has 4 rows or more, a log four windows",
        )
    if not np.isfinite(indication).all():
        raise FitError(
            "a value that is not finite reached the search for dwells", hint="cut the log at gaps"
        )
    shortest = 2 * window if shortest is None else shortest
    centre = np.array([dispersion.median(axis) for axis in indication.T])
    windows = len(indication) - window + 1
    # sums that begin anew every so often lose no digits to the rows before a window
    noise = np.concatenate(
        [
            _windowed_noise(indication[a : b + window - 1], window, centre)
            for a, b in chunks.ranges(windows)
        ]
    )
    if threshold is None:
        # a quarter of the log is surely at rest, whatever is done between the positions
        at_rest = float(np.quantile(noise, AT_REST_SHARE))
        # quantised indications can stand still to the last bit, whose noise is the least at rest
        least_noise = at_rest * np.sqrt(12.0)
        steps = [dispersion.smallest_step(axis, fine_step=least_noise) for axis in indication.T]
        last_bit = min((step for step in steps if step > 0.0), default=0.0)
        threshold = STILL_FACTOR * max(at_rest, last_bit / float(np.sqrt(12.0)))
    # a window is quiet only where all of it is: half a window is left out at both ends of a hold
    intervals = chunks.find_runs(noise <= threshold) + window // 2
    intervals = intervals[intervals[:, 1] - intervals[:, 0] >= shortest]
    if not len(intervals):
        raise FitError(
            f"nothing was held still for {shortest} rows (noise limit {threshold:.3g})",
            hint="hold every position longer, or state the noise limit",
        )
    return intervals


def _windowed_noise(indication: Array, window: int, centre: Array) -> Array:
    """Standard deviation [n − window + 1] of sliding windows, the three axes of [n, 3] together
    (root sum of squares).

    `centre` [3] is a value within the indications of each axis.
    """
    centred = indication - centre
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(centred, axis=0)])
    squares = np.concatenate([np.zeros((1, 3)), np.cumsum(centred**2, axis=0)])
    mean = (sums[window:] - sums[:-window]) / window
    variance = (squares[window:] - squares[:-window]) / window - mean**2
    return np.asarray(np.sqrt(np.maximum(np.sum(variance, axis=1), 0.0)), dtype=np.float64)


def cut_dwells(intervals: Integers, rows: int) -> Integers:
    """Cut intervals [m, 2] into parts of `rows` rows, for sweeps that hold one attitude while the
    temperature moves.

    What is left at the end of an interval makes a part of its own when it has half of the rows or
    more, and is left out otherwise.
    """
    cut = [
        (begin, min(begin + rows, stop))
        for start, stop in intervals.tolist()
        for begin in range(start, stop, rows)
        if min(begin + rows, stop) - begin >= (rows + 1) // 2
    ]
    return np.array(cut, dtype=np.int64).reshape(-1, 2)


def average_dwells(columns: Array, intervals: Integers) -> tuple[Array, Array]:
    """Means [m, c] of columns [n, c] over intervals [m, 2] of at least two rows, and their standard
    errors [m, c].
    """
    lengths = intervals[:, 1] - intervals[:, 0]
    if len(intervals) == 0 or lengths.min() < 2:
        raise FitError(
            "a dwell of fewer than two rows has no noise", hint="hold every position longer"
        )
    means, errors = [], []
    for start, stop in intervals.tolist():
        mean = columns[start:stop].mean(axis=0)
        centred = columns[start:stop] - mean
        error = centred.std(axis=0, ddof=1) / np.sqrt(stop - start)
        if stop - start >= 4 * BATCHES:
            # the larger of independent rows' and of batch means'
            batches = chunks.block_means(centred, (stop - start) // BATCHES)[:BATCHES]
            error = np.maximum(error, batches.std(axis=0, ddof=1) / BATCHES**0.5)
        means.append(mean)
        errors.append(error)
    return np.array(means), np.array(errors)

"""Dwells in continuous logs: where a triad was held still, and the mean and noise of each hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Intervals = NDArray[np.int64]

STILL_FACTOR = 2.0
"""Windowed noise, over the noise at rest, up to which a sample counts as held still."""
AT_REST_SHARE = 0.25
"""Share of the log that is certainly at rest: its quietest quarter sets the noise at rest."""
BATCHES = 16
"""Batches of a dwell whose means show noise that does not average out."""


@dataclass(frozen=True, slots=True)
class Dwells:
    """Means of columns over held intervals."""

    intervals: Intervals
    """[m, 2], first row and the row after the last."""
    mean: Array
    """[m, c], unit of the column."""
    standard_deviation: Array
    """[m, c], of single rows."""
    standard_error: Array
    """[m, c], of the mean: from batch means where they scatter more than independent rows would."""
    drift: Array
    """[m, c], mean of the second half minus mean of the first: a hold that creeps has many standard errors of it."""


def still(
    indication: Array,
    window: int,
    *,
    factor: float = STILL_FACTOR,
    threshold: float | None = None,
    shortest: int | None = None,
) -> Intervals:
    """Find the intervals in which a triad was held still.

    The noise of a sample is the standard deviation of the window around it, the three axes together. A sample is still
    where that is below `factor` times the noise at rest, which is the upper end of the quietest quarter of the log, so a
    log has to be at rest for a quarter of its time or state the threshold.

    Parameters
    ----------
    indication
        [n, 3], rows at even intervals; cut the log at gaps first.
    window
        Rows of the window, about a second.
    factor
        Of the noise at rest.
    threshold
        Noise [unit of the indication] in place of factor times noise at rest.
    shortest
        Rows below which an interval is not a dwell; twice the window when absent.

    Returns
    -------
    [m, 2], first row and the row after the last. Half a window at both ends of every hold is left out.

    Raises
    ------
    FitError
        For a log shorter than four windows, or one in which nothing was held still.

    """
    if window < 4 or len(indication) < 4 * window:
        raise FitError(
            f"{len(indication)} rows for windows of {window}", hint="a window has 4 rows or more, a log four windows"
        )
    if not np.isfinite(indication).all():
        raise FitError("a value that is not finite reached the search for dwells", hint="cut the log at gaps")
    shortest = 2 * window if shortest is None else shortest
    noise = windowed_noise(indication, window)
    # quantised indications can stand still to the last bit: the noise at rest is not below that of the last bit
    at_rest = max(float(np.quantile(noise, AT_REST_SHARE)), _resolution(indication) / np.sqrt(12.0))
    limit = factor * at_rest if threshold is None else threshold
    held = np.zeros(len(indication) + 2, dtype=np.int8)
    middle = 1 + window // 2
    held[middle : middle + noise.size] = noise <= limit
    edges = np.diff(held)
    intervals = np.column_stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)])
    intervals = intervals[intervals[:, 1] - intervals[:, 0] >= shortest]
    if not len(intervals):
        raise FitError(
            f"nothing was held still for {shortest} rows (noise limit {limit:.3g})",
            hint="hold every position longer, or state the noise limit",
        )
    return intervals.astype(np.int64)


def windowed_noise(indication: Array, window: int) -> Array:
    """Standard deviation [n − window + 1] of sliding windows, the three axes of [n, 3] together (root sum of squares)."""
    centred = indication - np.median(indication, axis=0)
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(centred, axis=0)])
    squares = np.concatenate([np.zeros((1, 3)), np.cumsum(centred**2, axis=0)])
    mean = (sums[window:] - sums[:-window]) / window
    variance = (squares[window:] - squares[:-window]) / window - mean**2
    return np.asarray(np.sqrt(np.maximum(np.sum(variance, axis=1), 0.0)), dtype=np.float64)


def pieces(intervals: Intervals, rows: int) -> Intervals:
    """Cut intervals [m, 2] into pieces of `rows` rows, for sweeps that hold one attitude while the temperature moves.

    What is left at the end of an interval makes a piece of its own when it has half of the rows or more, and is left
    out otherwise.
    """
    cut = [
        (begin, min(begin + rows, stop))
        for start, stop in intervals.tolist()
        for begin in range(start, stop, rows)
        if min(begin + rows, stop) - begin >= (rows + 1) // 2
    ]
    return np.array(cut, dtype=np.int64).reshape(-1, 2)


def averages(columns: Array, intervals: Intervals) -> Dwells:
    """Means, noise and creep of columns [n, c] over intervals [m, 2] of at least two rows."""
    lengths = intervals[:, 1] - intervals[:, 0]
    if len(intervals) == 0 or lengths.min() < 2:
        raise FitError("a dwell of fewer than two rows has no noise", hint="hold every position longer")
    held = [columns[start:stop] for start, stop in intervals.tolist()]
    return Dwells(
        intervals=intervals,
        mean=np.array([rows.mean(axis=0) for rows in held]),
        standard_deviation=np.array([rows.std(axis=0, ddof=1) for rows in held]),
        standard_error=np.array([_standard_error(rows) for rows in held]),
        drift=np.array([rows[len(rows) // 2 :].mean(axis=0) - rows[: len(rows) // 2].mean(axis=0) for rows in held]),
    )


def _standard_error(rows: Array) -> Array:
    """Standard error [c] of the mean of rows [k, c], the larger of independent rows' and of batch means'."""
    independent = rows.std(axis=0, ddof=1) / np.sqrt(len(rows))
    if len(rows) < 4 * BATCHES:
        return np.asarray(independent, dtype=np.float64)
    batch = len(rows) // BATCHES
    means = rows[: batch * BATCHES].reshape(BATCHES, batch, -1).mean(axis=1)
    return np.asarray(np.maximum(independent, means.std(axis=0, ddof=1) / np.sqrt(BATCHES)), dtype=np.float64)


def _resolution(indication: Array) -> float:
    """Smallest step between different indications, the last bit of quantised ones."""
    steps = [np.diff(np.unique(axis)) for axis in indication.T]
    return float(min((step.min() for step in steps if step.size), default=0.0))

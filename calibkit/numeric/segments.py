"""Soaks and ramps of a temperature log, and the rate at which the temperature changes.

The rate is the least-squares slope (n Σ t T - Σ t Σ T)/(n Σ t² - (Σ t)²) over the window that ends
at each sample; a ramp is where its magnitude stays above a limit.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from calibkit.numeric import chunks, dispersion
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_MINUTE

COARSE_DEGC_MIN = 0.3
"""Slope [°C/min] that one quantisation step within the window may cause: the rate that separates a
ramp from a soak.
"""
FINEST_DEGC_MIN = 0.1
"""Slope [°C/min] that one step of a coarsely quantised thermometer causes in the longest window."""
MOVED = 4.0
"""Quantisation steps that a window must span: the slope of that many steps is right within 5 %."""
MOST_IN_WINDOW = 500
"""Rows of a window beyond which the slope is that of means: it is no better known by more."""
UNSEEN_STEPS = 2.0
"""Expected quantisation steps since the last change of the reading above which the temperature is
at rest; noise near the next step is allowed for.
"""


@dataclass(frozen=True, slots=True)
class Segment:
    """A soak or a ramp: rows start … stop − 1 and the measured temperature rate [°C/min]."""

    kind: Literal["soak", "ramp"]
    start: int
    stop: int
    rate: float


def causal_slope(time: Array, temperature: Array, window_s: float) -> Array:
    """Slope [°C/min] of temperature [n, °C] over time [n, s] by least squares over the window that
    ends at each sample.

    The slope is causal: only samples up to an instant enter. It is 0 until half a window has
    passed. A window of tens of seconds suppresses the quantisation steps of the thermometer. Where
    a window has more than MOST_IN_WINDOW rows, the slope is that of means of rows, and each row has
    that of the means before it.
    """
    usual = window_s * time.size / max(float(time[-1] - time[0]), window_s)
    of_mean = max(int(usual / MOST_IN_WINDOW), 1)
    if of_mean > 1:
        mean_time, mean_degc = (chunks.block_means(x, of_mean) for x in (time, temperature))
        # each row has the slope of the means before it: its own mean holds later rows
        of_means = np.append(0.0, causal_slope(mean_time, mean_degc, window_s))
        return np.repeat(of_means, of_mean)[1 : time.size + 1]
    slope, begin = np.empty(time.size), 0
    for a, b in chunks.ranges(time.size):
        # sums that begin near the windows lose no digits to the rows before them
        starts = time[a:b] - window_s * (1.0 + 1e-9)
        begin += int(np.searchsorted(time[begin:b], starts[0], side="left"))
        middle = (begin + b) // 2
        t = (time[begin:b] - time[middle]) / SECONDS_PER_MINUTE
        v = temperature[begin:b] - temperature[middle]
        first = np.searchsorted(time[begin:b], starts, side="left")
        count = np.arange(a - begin + 1, b - begin + 1) - first
        sums = []
        for x in (t, v, t * t, t * v):
            total = np.zeros(x.size + 1)
            np.cumsum(x, out=total[1:])
            sums.append(total[a - begin + 1 :] - total[first])
        st, sv, stt, stv = sums
        spread = count * stt - st * st
        lasts_s = time[a:b] - time[begin:b][first]
        started = (count >= 3) & (lasts_s >= window_s / 2.0) & (spread > 0.0)
        moving = (count * stv - st * sv) / np.where(started, spread, 1.0)
        slope[a:b] = np.where(started, moving, 0.0)
    return slope


def quantum(temperature: Array, *, fine_step: float = 0.0) -> float:
    """Quantisation step [°C] of thermometer readings [n, °C]; 0 if all readings are equal."""
    return dispersion.smallest_step(temperature, fine_step=fine_step, decimals=6)


def coarse(temperature: Array, window_s: float) -> bool:
    """Whether one quantisation step changes the slope over a window by over COARSE_DEGC_MIN."""
    return (
        quantum(temperature, fine_step=COARSE_DEGC_MIN * window_s / SECONDS_PER_MINUTE)
        * SECONDS_PER_MINUTE
        / window_s
        > COARSE_DEGC_MIN
    )


def measured_slope(time: Array, temperature: Array, window_s: float) -> Array:
    """Causal slope [n, °C/min] of thermometer readings [n, °C], over longer windows if the
    quantisation is coarse.

    The window at each sample is the first of window_s, 2 window_s, 4 window_s, … in which the
    reading changes by MOVED steps; in the longest, one step is a slope of FINEST_DEGC_MIN. The
    slope is 0 where the reading has not changed for so long that this slope would have produced
    UNSEEN_STEPS steps. Only samples up to an instant enter.
    """
    if not coarse(temperature, window_s):
        return causal_slope(time, temperature, window_s)
    step = quantum(temperature)
    windows = [window_s]
    # a longer window would smear the end of a ramp over its soak
    while 2.0 * windows[-1] <= step * SECONDS_PER_MINUTE / FINEST_DEGC_MIN * (1.0 + 1e-9):
        windows.append(2.0 * windows[-1])
    slope = causal_slope(time, temperature, windows[-1])
    for window in windows[-2::-1]:
        first = np.searchsorted(time, time - window * (1.0 + 1e-9), side="left")
        has_moved = np.abs(temperature - temperature[first]) >= MOVED * step * (1.0 - 1e-9)
        slope = np.where(has_moved, causal_slope(time, temperature, window), slope)
    changed = np.diff(temperature, prepend=temperature[:1]) != 0.0
    since = np.maximum.accumulate(np.where(changed, time, time[0]))
    unseen = np.abs(slope) * (time - since) > UNSEEN_STEPS * step * SECONDS_PER_MINUTE
    return np.where(unseen, 0.0, slope)


def segments(
    slope: Array, temperature: Array, *, ramp_min: float, min_span: float, merge: int
) -> list[Segment]:
    """Cut a log [n] into ramps and soaks.

    A ramp is a run of rows whose slope [°C/min] keeps one sign at or above ramp_min and whose
    temperature changes by at least min_span [°C]; runs of the same sign are merged if at most
    `merge` rows lie between. All else is soak.
    """
    # start, stop and direction of each run of one sign
    direction = (slope >= ramp_min).astype(np.int8) - (slope <= -ramp_min)
    # before the first row stands no direction, which begins a run
    bounds = np.flatnonzero(np.diff(direction, prepend=np.int8(2)))
    runs: list[tuple[int, int, float]] = []
    for start, stop in pairwise([*bounds.tolist(), slope.size]):
        way = float(direction[start])
        if runs and runs[-1][2] == way and start - runs[-1][1] <= merge:
            runs[-1] = (runs[-1][0], stop, way)
        elif way:
            runs.append((start, stop, way))
    ends = np.array([(start, stop - 1) for start, stop, _ in runs], dtype=np.int64).reshape(-1, 2)
    spans = np.ptp(temperature[ends], axis=1).tolist()
    ramps = [
        Segment("ramp", start, stop, dispersion.median(slope[start:stop]))
        for (start, stop, _), span in zip(runs, spans, strict=True)
        if span >= min_span
    ]
    return _with_soaks(ramps, slope)


def pinned(
    time: Array, temperature: Array, slope: Array, ramps: list[tuple[int, int]]
) -> list[Segment]:
    """Segments of a log [n] with given ramps (first row and row after the last); all else is soak.

    The rate of a ramp is the slope [°C/min] of the straight line through its temperatures [°C] over
    time [s].
    """
    moving = [Segment("ramp", a, b, straight_slope(time[a:b], temperature[a:b])) for a, b in ramps]
    return _with_soaks(moving, slope)


def straight_slope(time: Array, temperature: Array) -> float:
    """Slope [°C/min] of the least-squares line through temperatures [n, °C] over time [n, s]."""
    t = time - time.mean()
    return SECONDS_PER_MINUTE * float(t @ (temperature - temperature.mean())) / float(t @ t)


def _with_soaks(ramps: list[Segment], slope: Array) -> list[Segment]:
    """The ramps with the soaks between them, covering every row once."""
    segments_of_log: list[Segment] = []
    row = 0
    for ramp in [*ramps, Segment("ramp", slope.size, slope.size, 0.0)]:  # the last has no rows
        if ramp.start > row:
            rate = dispersion.median(slope[row : ramp.start])
            segments_of_log.append(Segment("soak", row, ramp.start, rate))
        segments_of_log.append(ramp)
        row = ramp.stop
    return segments_of_log[:-1]

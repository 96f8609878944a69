"""Soaks and ramps of a temperature log, and the rate at which the temperature changes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


COARSE_DEGC_MIN = 0.3
"""Rate [°C/min] that one step of a thermometer within the window may amount to: what tells a ramp from a soak."""
FINEST_DEGC_MIN = 0.1
"""Rate [°C/min] that one step of a coarse thermometer amounts to in the longest window."""
MOVED = 4.0
"""Steps of a coarse thermometer that a window must hold: the slope of a staircase of so many is right within 5 %."""
UNSEEN_STEPS = 2.0
"""Steps that cannot pass unseen since the last change of a reading, noise about the next one included."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A held condition: rows start … stop − 1, its kind and its measured temperature rate [°C/min]."""

    kind: Literal["soak", "ramp"]
    start: int
    stop: int
    rate: float


def causal_slope(time: Array, temperature: Array, window_s: float) -> Array:
    """Slope [°C/min] of temperature [n, °C] over time [n, s] by least squares over the window that ends at each sample.

    Only samples at or before an instant enter its slope; where less than half a window has passed, the slope is 0.
    A window of tens of seconds keeps the steps of a quantised thermometer out of the rate.
    """
    t = (time - time[time.size // 2]) / 60.0
    v = temperature - temperature.mean()
    first = np.searchsorted(time, time - window_s * (1.0 + 1e-9), side="left")
    last = np.arange(1, time.size + 1)
    count, st, sv, stt, stv = (_window_sums(x, first, last) for x in (np.ones_like(t), t, v, t * t, t * v))
    spread = count * stt - st * st
    started = (count >= 3) & (time - time[first] >= window_s / 2.0) & (spread > 0.0)
    slope = (count * stv - st * sv) / np.where(started, spread, 1.0)
    return np.asarray(np.where(started, slope, 0.0), dtype=np.float64)


def quantum(temperature: Array) -> float:
    """Step [°C] in which a thermometer reads [n, °C]: the smallest difference of two readings; 0 where all are alike."""
    levels = np.unique(np.round(temperature, 6))
    return float(np.min(np.diff(levels))) if levels.size > 1 else 0.0


def coarse(temperature: Array, window_s: float) -> bool:
    """Whether a thermometer's steps show in slopes over a window: one of them is more than COARSE_DEGC_MIN."""
    return quantum(temperature) * 60.0 / window_s > COARSE_DEGC_MIN


def measured_slope(time: Array, temperature: Array, window_s: float) -> Array:
    """Slope [n, °C/min] of a thermometer's readings [n, °C]: `causal_slope`, over longer windows where the steps are coarse.

    Of windows of window_s and its doubles the first is taken in which the reading moved by MOVED steps, at most one in which a
    step is FINEST_DEGC_MIN. A reading that has stood still for so long that the slope would have made
    UNSEEN_STEPS steps of it has come to rest: its slope is 0. Only samples at or before an instant enter.
    """
    step = quantum(temperature)
    if not coarse(temperature, window_s):
        return causal_slope(time, temperature, window_s)
    slope = np.zeros(time.size)
    open_rows = np.ones(time.size, dtype=bool)
    longest = step * 60.0 / FINEST_DEGC_MIN
    window = window_s
    while open_rows.any():
        last = 2.0 * window > longest * (1.0 + 1e-9)
        before = np.searchsorted(time, time - window * (1.0 + 1e-9), side="left")
        moved = np.abs(temperature - temperature[before]) >= MOVED * step * (1.0 - 1e-9)
        chosen = open_rows & (moved | last)
        if chosen.any():
            slope[chosen] = causal_slope(time, temperature, window)[chosen]
        open_rows &= ~chosen
        window *= 2.0
    changed = np.concatenate([[0], np.flatnonzero(np.diff(temperature)) + 1])
    since = time - time[changed[np.searchsorted(changed, np.arange(time.size), side="right") - 1]]
    return np.where(np.abs(slope) * since > UNSEEN_STEPS * step * 60.0, 0.0, slope)


def _window_sums(x: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> Array:
    """Sums of x over rows first … last − 1 of every window."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    return np.asarray(total[last] - total[first], dtype=np.float64)


def segments(slope: Array, temperature: Array, *, ramp_min: float, min_span: float, merge: int) -> list[Segment]:
    """Cut a log [n] into ramps and soaks.

    A ramp is a run of rows whose slope [°C/min] keeps one sign at or above ramp_min and whose temperature spans at
    least min_span [°C]; two such runs of one sign that are at most `merge` rows apart are one. All else is soak.
    """
    sign = np.where(np.abs(slope) >= ramp_min, np.sign(slope), 0.0)
    runs = _merged(_runs(sign), merge)
    ramps = [
        Segment("ramp", start, stop, float(np.median(slope[start:stop])))
        for start, stop, direction in runs
        if direction != 0.0 and abs(temperature[stop - 1] - temperature[start]) >= min_span
    ]
    return _with_soaks(ramps, slope)


def pinned(time: Array, temperature: Array, slope: Array, ramps: list[tuple[int, int]]) -> list[Segment]:
    """Segments of a log [n] whose ramps are known as first row and row after the last; all else is soak.

    The rate of a ramp is the slope [°C/min] of the straight line through its temperatures [°C] over time [s].
    """
    moving = []
    for start, stop in ramps:
        minutes = (time[start:stop] - time[start]) / 60.0
        rate = float(np.polyfit(minutes - minutes.mean(), temperature[start:stop], 1)[0])
        moving.append(Segment("ramp", start, stop, rate))
    return _with_soaks(moving, slope)


def _runs(sign: Array) -> list[tuple[int, int, float]]:
    """Start, stop and value of each run of equal values."""
    edges = np.flatnonzero(np.diff(sign)) + 1
    bounds = [0, *edges.tolist(), sign.size]
    return [(start, stop, float(sign[start])) for start, stop in pairwise(bounds)]


def _merged(runs: list[tuple[int, int, float]], merge: int) -> list[tuple[int, int, float]]:
    """Runs in motion, two of one direction joined where at most `merge` rows of standstill part them."""
    joined: list[tuple[int, int, float]] = []
    for start, stop, direction in runs:
        if direction == 0.0:
            continue
        if joined and joined[-1][2] == direction and start - joined[-1][1] <= merge:
            joined[-1] = (joined[-1][0], stop, direction)
        else:
            joined.append((start, stop, direction))
    return joined


def _with_soaks(ramps: list[Segment], slope: Array) -> list[Segment]:
    """The ramps with the soaks between them, covering every row once."""
    whole: list[Segment] = []
    row = 0
    for ramp in ramps:
        if ramp.start > row:
            whole.append(Segment("soak", row, ramp.start, float(np.median(slope[row : ramp.start]))))
        whole.append(ramp)
        row = ramp.stop
    if row < slope.size:
        whole.append(Segment("soak", row, slope.size, float(np.median(slope[row:]))))
    return whole

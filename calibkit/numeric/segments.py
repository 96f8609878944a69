"""Soaks and ramps of a temperature log, and the rate at which the temperature changes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.native import kernels
from calibkit.numeric import chunks, order_statistics

Allocate = Callable[[int], Array]
"""Allocates an array for so many values."""

COARSE_DEGC_MIN = 0.3
"""Rate [°C/min] that one step of a thermometer within the window may amount to: what separates a
ramp from a soak.
"""
FINEST_DEGC_MIN = 0.1
"""Rate [°C/min] that one step of a coarse thermometer amounts to in the longest window."""
MOVED = 4.0
"""Steps of a coarse thermometer that a window must hold: the slope of a staircase of so many is
right within 5 %.
"""
UNSEEN_STEPS = 2.0
"""Steps that cannot pass unseen since the last change of a reading, noise about the next one
included.
"""


@dataclass(frozen=True, slots=True)
class Segment:
    """A held condition: rows start … stop − 1, its kind and its measured temperature rate
    [°C/min].
    """

    kind: Literal["soak", "ramp"]
    start: int
    stop: int
    rate: float


def causal_slope(
    time: Array, temperature: Array, window_s: float, *, allocate: Allocate = np.empty
) -> Array:
    """Slope [°C/min] of temperature [n, °C] over time [n, s] by least squares over the window that
    ends at each sample.

    Only samples at or before an instant enter its slope; where less than half a window has passed,
    the slope is 0. A window of tens of seconds keeps the steps of a quantised thermometer out of
    the rate. `allocate` makes the result.
    """
    slope = allocate(time.size)
    row = 0
    for start, stop in chunks.ranges_along(time, temperature, slope):
        # windows end in this chunk and begin in it or before it
        row += int(
            np.searchsorted(time[row:stop], time[start] - window_s * (1.0 + 1e-9), side="left")
        )
        slope[start:stop] = _slopes(time[row:stop], temperature[row:stop], window_s, start - row)
    return slope


def _slopes(time: Array, temperature: Array, window_s: float, skipped: int) -> Array:
    """Slopes [°C/min] at the samples after the first `skipped` ones of a section [n] that holds
    all their windows.
    """
    library = kernels()
    if library is not None:
        time, temperature = (np.ascontiguousarray(x, dtype=np.float64) for x in (time, temperature))
        slope, reach = np.empty(time.size - skipped), window_s * (1.0 + 1e-9)
        series = time.ctypes.data, temperature.ctypes.data, time.size, skipped
        if library.calibkit_slopes(*series, reach, window_s / 2.0, slope.ctypes.data) == 0:
            return slope
    return _slopes_of_arrays(time, temperature, window_s, skipped)


def _slopes_of_arrays(time: Array, temperature: Array, window_s: float, skipped: int) -> Array:
    """As `_slopes`, where there are no compiled kernels or the time runs backwards."""
    ends = time[skipped:]
    first = _first_in_window(time, ends - window_s * (1.0 + 1e-9), skipped)
    t = (time - time[time.size // 2]) / SECONDS_PER_MINUTE
    v = temperature - temperature[temperature.size // 2]
    last = np.arange(skipped + 1, time.size + 1)
    count = (
        float(last[0] - first.start)
        if isinstance(first, slice)
        else (last - first).astype(np.float64)
    )
    st, sv, stt, stv = (_window_sums(x, first, skipped) for x in (t, v, t * t, t * v))
    spread = count * stt - st * st
    started = (count >= 3) & (ends - time[first] >= window_s / 2.0) & (spread > 0.0)
    slope = (count * stv - st * sv) / np.where(started, spread, 1.0)
    return np.asarray(np.where(started, slope, 0.0), dtype=np.float64)


def _first_in_window(time: Array, begins: Array, skipped: int) -> Integers | slice:
    """First sample of a section [n] at or after each instant [m], that of sample skipped + k being
    the k-th.

    They are a slice where the clock is so steady that they follow each other.
    """
    # samples of a steady clock lie equally many rows behind: testing a guess takes less
    # time than a search
    behind = skipped + begins.size - 1 - int(np.searchsorted(time, begins[-1], side="left"))
    steady = slice(skipped - behind, skipped - behind + begins.size)
    if steady.start > 0 and bool(
        np.all(time[steady] >= begins) and np.all(time[steady.start - 1 : steady.stop - 1] < begins)
    ):
        return steady
    guess = np.maximum(np.arange(skipped, skipped + begins.size) - behind, 0)
    right = (time[guess] >= begins) & ((guess == 0) | (time[guess - 1] < begins))
    wrong = np.flatnonzero(~right)
    guess[wrong] = np.searchsorted(time, begins[wrong], side="left")
    return guess


def quantum(temperature: Array, *, enough: float = 0.0) -> float:
    """Step [°C] in which a thermometer reads [n, °C]; 0 where all readings are alike."""
    return order_statistics.smallest_step(temperature, enough=enough, decimals=6)


def coarse(temperature: Array, window_s: float) -> bool:
    """Whether a thermometer's steps show in slopes over a window: one of them is more than
    COARSE_DEGC_MIN.
    """
    return (
        quantum(temperature, enough=COARSE_DEGC_MIN * window_s / SECONDS_PER_MINUTE)
        * SECONDS_PER_MINUTE
        / window_s
        > COARSE_DEGC_MIN
    )


def measured_slope(
    time: Array, temperature: Array, window_s: float, *, allocate: Allocate = np.empty
) -> Array:
    """Slope [n, °C/min] of a thermometer's readings [n, °C]: `causal_slope`, over longer windows
    where the steps are coarse.

    Of windows of window_s and its doubles the first is taken in which the reading moved by MOVED
    steps, at most one in which a step is FINEST_DEGC_MIN. A reading that has stood still for so
    long that the slope would have made UNSEEN_STEPS steps of it has come to rest: its slope is 0.
    Only samples at or before an instant enter.
    """
    if not coarse(temperature, window_s):
        return causal_slope(time, temperature, window_s, allocate=allocate)
    step = quantum(temperature)
    windows = [window_s]
    while 2.0 * windows[-1] <= step * SECONDS_PER_MINUTE / FINEST_DEGC_MIN * (1.0 + 1e-9):
        windows.append(2.0 * windows[-1])
    slope = allocate(time.size)
    row, changed = 0, float(time[0])
    for start, stop in chunks.ranges_along(time, temperature, slope):
        row += int(
            np.searchsorted(time[row:stop], time[start] - windows[-1] * (1.0 + 1e-9), side="left")
        )
        seen = time[row:stop], temperature[row:stop]
        part = _coarse_slopes(*seen, windows, step, start - row)
        other = (
            np.diff(
                temperature[max(start - 1, 0) : stop],
                prepend=temperature[start] if start == 0 else [],
            )
            != 0.0
        )
        since = np.maximum.accumulate(np.where(other, time[start:stop], changed))
        changed = float(since[-1])
        unseen = (
            np.abs(part) * (time[start:stop] - since) > UNSEEN_STEPS * step * SECONDS_PER_MINUTE
        )
        slope[start:stop] = np.where(unseen, 0.0, part)
    return slope


def _coarse_slopes(
    time: Array, temperature: Array, windows: Sequence[float], step: float, skipped: int
) -> Array:
    """Slopes at the samples after the first `skipped` of a section, each over the first window in
    which the reading moved.
    """
    slope = np.zeros(time.size - skipped)
    unsettled = np.ones(slope.size, dtype=bool)
    for window in windows:
        first = _first_in_window(time, time[skipped:] - window * (1.0 + 1e-9), skipped)
        moved = np.abs(temperature[skipped:] - temperature[first]) >= MOVED * step * (1.0 - 1e-9)
        chosen = unsettled & moved if window != windows[-1] else unsettled
        if chosen.any():
            slope[chosen] = _slopes(time, temperature, window, skipped)[chosen]
        unsettled = unsettled & ~chosen
    return slope


def _window_sums(x: Array, first: Integers | slice, skipped: int) -> Array:
    """Sums of x [n] over the rows from `first` [m] to sample skipped + k, the k-th window's
    last.
    """
    total = np.empty(x.size + 1)
    total[0] = 0.0
    np.cumsum(x, out=total[1:])
    return np.asarray(total[skipped + 1 :] - total[first], dtype=np.float64)


def segments(
    slope: Array, temperature: Array, *, ramp_min: float, min_span: float, merge: int
) -> list[Segment]:
    """Cut a log [n] into ramps and soaks.

    A ramp is a run of rows whose slope [°C/min] keeps one sign at or above ramp_min and whose
    temperature spans at least min_span [°C]; two such runs of one sign that are at most `merge`
    rows apart are one. All else is soak.
    """
    runs = _merged(_runs(slope, ramp_min), merge)
    ramps = [
        Segment("ramp", start, stop, order_statistics.median(slope[start:stop]))
        for start, stop, direction in runs
        if direction != 0.0 and abs(temperature[stop - 1] - temperature[start]) >= min_span
    ]
    return _with_soaks(ramps, slope)


def pinned(
    time: Array, temperature: Array, slope: Array, ramps: list[tuple[int, int]]
) -> list[Segment]:
    """Segments of a log [n] whose ramps are known as first row and row after the last; all else is
    soak.

    The rate of a ramp is the slope [°C/min] of the straight line through its temperatures [°C] over
    time [s].
    """
    moving = [Segment("ramp", a, b, _straight_slope(time[a:b], temperature[a:b])) for a, b in ramps]
    return _with_soaks(moving, slope)


def _straight_slope(time: Array, temperature: Array) -> float:
    """Slope [°C/min] of the least-squares line through temperatures [n, °C] over time [n, s]."""
    centre, level = chunks.mean(time), chunks.mean(temperature)
    above = product = 0.0
    for a, b in chunks.ranges_along(time, temperature):
        t = time[a:b] - centre
        above, product = above + float(t @ t), product + float(t @ (temperature[a:b] - level))
    return SECONDS_PER_MINUTE * product / above


def _runs(slope: Array, ramp_min: float) -> list[tuple[int, int, float]]:
    """Start, stop and direction of each run of slopes [n] that keep one sign at or above ramp_min,
    or stay below it.
    """
    bounds: list[int] = []
    directions: list[float] = []
    for start, stop in chunks.ranges_along(slope):
        part = slope[start:stop]
        # one byte a row; 2 is no direction: the first row begins a run
        sign = (part >= ramp_min).astype(np.int8) - (part <= -ramp_min).astype(np.int8)
        edges = chunks.changed_rows(sign, directions[-1] if directions else 2.0)
        bounds += (edges + start).tolist()
        directions += sign[edges].astype(np.float64).tolist()
    return [
        (start, stop, way)
        for (start, stop), way in zip(pairwise([*bounds, slope.size]), directions, strict=True)
    ]


def _merged(runs: list[tuple[int, int, float]], merge: int) -> list[tuple[int, int, float]]:
    """Runs in motion, two of one direction merged where at most `merge` rows of standstill part
    them.
    """
    merged: list[tuple[int, int, float]] = []
    for start, stop, direction in runs:
        if direction == 0.0:
            continue
        if merged and merged[-1][2] == direction and start - merged[-1][1] <= merge:
            merged[-1] = (merged[-1][0], stop, direction)
        else:
            merged.append((start, stop, direction))
    return merged


def _with_soaks(ramps: list[Segment], slope: Array) -> list[Segment]:
    """The ramps with the soaks between them, covering every row once."""
    whole: list[Segment] = []
    row = 0
    for ramp in [*ramps, Segment("ramp", slope.size, slope.size, 0.0)]:  # the last has no rows
        if ramp.start > row:
            rate = order_statistics.median(slope[row : ramp.start])
            whole.append(Segment("soak", row, ramp.start, rate))
        whole.append(ramp)
        row = ramp.stop
    return whole[:-1]

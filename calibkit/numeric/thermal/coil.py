"""Drivers of the bias models along a log: what a level model reads of the log, and what a lagged
model makes of the case temperature alone.

    level    T the case temperature, G = T_case − T_env, their rates by `level_drivers`
    lagged   τ_o T_o' = T_s − T_o,   τ_i T_i' = T_o − T_i,   solved exactly between samples

Rates of a level model are the slopes, at the newest sample, of least-squares parabolas over a
trailing window: causal, without delay, and insensitive to the steps of a quantised thermometer.
Those of a coil, T_o' = (T_s − T_o)/τ_o and T_i' = (T_o − T_i)/τ_i, follow from the equations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.numeric.thermal.terms import Drivers

WINDOW_S = 90.0
"""Trailing window of the rates [s]: a step of 0.0625 °C changes them by less than 0.1 °C/min."""
LEAST_SAMPLES = 4
"""Samples that a parabola and one degree of freedom need."""
CHUNK = 1 << 20
"""Largest number of window elements in memory at a time."""


def _end_slope(time: Array, values: Array, window_s: float = WINDOW_S) -> Array:
    """Rate [n, 1/min] of values [n] at each time [n, s]: slope of the least-squares parabola over
    the trailing window at its newest sample.

    The rate is causal; a straight line would give the rate of half a window before. It is 0 until
    half a window has passed: the log is taken to start at rest. Uneven sampling and gaps are
    allowed.
    """
    # the window has both ends in it; rounding of even stamps must not drop one
    first = np.searchsorted(time, time - window_s * (1.0 + 1e-9), side="left")
    width = int(np.max(np.arange(time.size) - first)) + 1
    rows = max(1, CHUNK // width)
    slope = np.zeros(time.size)
    for start in range(0, time.size, rows):
        ends = np.arange(start, min(start + rows, time.size))
        # the normal equations of a parabola in x = (t − t_end)/window
        window_rows = ends[:, None] - np.arange(width)
        inside = (window_rows >= first[ends][:, None]).astype(np.float64)
        window_rows = np.maximum(window_rows, first[ends][:, None])
        x = (time[window_rows] - time[ends][:, None]) / window_s
        y = (values[window_rows] - values[ends][:, None]) * inside
        powers = [inside, inside * x]
        for _ in range(3):
            powers.append(powers[-1] * x)
        s0, s1, s2, s3, s4 = (np.sum(power, axis=1) for power in powers)
        v0, v1, v2 = np.sum(y, axis=1), np.sum(y * x, axis=1), np.sum(y * powers[2], axis=1)
        # slope at x = 0 by Cramer's rule
        minors = (s1 * s4 - s2 * s3, s0 * s4 - s2 * s2, s0 * s3 - s1 * s2)
        determinant = s0 * (s2 * s4 - s3 * s3) - s1 * (s1 * s4 - s2 * s3) + s2 * (s1 * s3 - s2 * s2)
        # a shorter start would differentiate noise; the log is taken to begin at rest
        started = (s0 >= LEAST_SAMPLES) & (x[:, -1] <= -0.5) & (determinant > 0.0)
        at_end = (-minors[0] * v0 + minors[1] * v1 - minors[2] * v2) / np.where(
            started, determinant, 1.0
        )
        slope[ends] = np.where(started, at_end, 0.0) / window_s
    return slope * SECONDS_PER_MINUTE


def level_drivers(time: Array, case: Array, env: Array, window_s: float = WINDOW_S) -> Drivers:
    """Drivers [n] of a log: case temperature and its gradient to the chamber air, with their rates.

    Raises FitError if the log is sampled too slowly for the window: all rates would be 0.
    """
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    if step * (LEAST_SAMPLES - 1) > window_s * (1.0 + 1e-9):
        raise FitError(
            f"sampled every {step:g} s, the rates of the level model are taken over {window_s:g} s",
            hint=(
                f"use a log that is sampled at least every {window_s / (LEAST_SAMPLES - 1):g} s, or"
                " a longer window"
            ),
        )
    gradient = case - env
    return Drivers(
        case, _end_slope(time, case, window_s), gradient, _end_slope(time, gradient, window_s)
    )


LONGEST_EXPONENT = 200.0
"""Largest exponent of one cumulative sum of decays: e^200 squared does not overflow."""


@dataclass(frozen=True, slots=True)
class Path:
    """Case temperatures of L logs, one per row, linear between samples; short logs are padded with
    steps of no length.
    """

    start: Array
    """[L], first case temperature [°C] of each log."""
    rise: Array
    """[L, n], case temperature above the first [°C]."""
    step: Array
    """[L, n − 1], length of each step [s]."""
    change: Array
    """[L, n − 1], change of the case temperature over each step [°C]."""
    inside: Mask
    """[L, n], which of the instants are samples, not padding."""

    def drivers(self, tau_outer: float, tau_inner: float | None) -> Drivers:
        """Drivers [n] of all logs in sequence for the lags [s]; without an inner lag the coil is
        one mass without gradient.

        Both temperatures start at the first case temperature of a log, as after a long soak. With
        the case temperature linear between samples, the solution is exact for any step and gap:
        with m the slope over a step h and a = exp(−h/τ), T_o ← a T_o + x1 − a x0 − m τ_o (1 − a),
        where x0 and x1 are the case temperatures at both ends. The inner one, with b = exp(−h/τ_i):
        T_i ← b T_i + x1 − b x0 − m (τ_o + τ_i) (1 − b) + (T_o − x0 + m τ_o) · `_carried`.
        """
        h, x = self.step, self.rise[:, :-1]
        # slope of the case over a step; padding has steps of no length
        m = self.change / np.where(h > 0.0, h, 1.0)
        decay = np.exp(-h / tau_outer)
        ramp_lag = m * tau_outer
        outer = _decaying(h / tau_outer, self.change - (ramp_lag - x) * (1.0 - decay))
        rate = ((self.rise - outer) / tau_outer)[self.inside] * SECONDS_PER_MINUTE
        outer_degc = (outer + self.start[:, None])[self.inside]
        if tau_inner is None:
            none = np.zeros_like(outer_degc)
            return Drivers(outer_degc, rate, none, none)
        line = x - ramp_lag - m * tau_inner
        from_outer = (outer[:, :-1] - x + ramp_lag) * _carried(h, tau_outer, tau_inner)
        inner = _decaying(h / tau_inner, self.change - line * np.expm1(-h / tau_inner) + from_outer)
        gradient = outer_degc - (inner + self.start[:, None])[self.inside]
        return Drivers(outer_degc, rate, gradient, rate - gradient / tau_inner * SECONDS_PER_MINUTE)


FOLLOWED_DEGC = (-70.0, 110.0)
"""Case temperatures that lags follow, whatever was fitted; beyond them a reading is a fault."""


def followed_range(low: float, high: float) -> tuple[float, float]:
    """Case temperatures [°C] that lags of a model follow that was fitted from low to high [°C]: an
    eighth of its range beyond, and all of FOLLOWED_DEGC.
    """
    margin = (high - low) / 8.0
    # firmware follows the case over the same range, so that lags agree
    return min(FOLLOWED_DEGC[0], low - margin), max(FOLLOWED_DEGC[1], high + margin)


RUN_UP_S = 36_000.0
"""Duration of the run-up at a constant rate that is assumed before a span: longer than any lag."""
APART_S = 1e8
"""Time between two spans across which lags are not carried."""


def path_of_spans(logs: Sequence[tuple[Array, Array, Sequence[tuple[int, float]]]]) -> Path:
    """Path of logs, each given by its time [n, s], case temperature [n, °C] and the first rows of
    its spans with the rate [°C/min] at which the temperature came to each; lags are not carried
    from span to span.
    """
    with_run_ups = []
    for time, case, spans in logs:
        first = np.array([row for row, _ in spans], dtype=np.int64)
        rate = np.array([rate for _, rate in spans]) / SECONDS_PER_MINUTE
        later = np.zeros(time.size)
        # lags decay to nothing in between, so that a run-up alone decides how a span begins
        later[first[1:]] = APART_S
        separated_time = time + np.cumsum(later)
        with_run_ups.append(
            (
                np.insert(separated_time, first, separated_time[first] - RUN_UP_S),
                np.insert(case, first, case[first] - RUN_UP_S * rate),
                np.insert(np.ones(time.size, dtype=bool), first, values=False),
            )
        )
    joined = path([(time, case) for time, case, _ in with_run_ups])
    inside = joined.inside.copy()
    for row, (time, _, is_sample) in enumerate(with_run_ups):
        inside[row, : time.size] = is_sample
    return replace(joined, inside=inside)


def path(logs: Sequence[tuple[Array, Array]]) -> Path:
    """Path of logs, each given by its time [n, s] and case temperature [n, °C]."""
    longest = max(time.size for time, _ in logs)
    step, change = np.zeros((len(logs), longest - 1)), np.zeros((len(logs), longest - 1))
    inside = np.zeros((len(logs), longest), dtype=bool)
    for row, (time, case) in enumerate(logs):
        step[row, : time.size - 1], change[row, : time.size - 1] = np.diff(time), np.diff(case)
        inside[row, : time.size] = True
    rise = np.concatenate([np.zeros((len(logs), 1)), np.cumsum(change, axis=1)], axis=1)
    return Path(np.array([case[0] for _, case in logs]), rise, step, change, inside)


def _carried(h: Array, tau_outer: float, tau_inner: float) -> Array:
    """Response of the inner lag after h [s] to a difference of 1 across the outer lag, which
    decays; τ_o = τ_i is allowed.
    """
    # the difference of two decays over that of their rates loses its digits where the lags are
    # alike
    d = h * abs(1.0 / tau_inner - 1.0 / tau_outer)
    # (1 − exp(−d))/d, which is 1 at d = 0
    ratio = np.where(d > 0.0, -np.expm1(-d) / np.where(d > 0.0, d, 1.0), 1.0)
    return np.asarray(
        h / tau_inner * np.exp(-h / max(tau_outer, tau_inner)) * ratio, dtype=np.float64
    )


def _decaying(exponent: Array, supply: Array) -> Array:
    """States [L, n + 1] of s_k = exp(−exponent_k) s_{k−1} + supply_k from s_0 = 0, by cumulative
    sums that cannot overflow.
    """
    passed = np.cumsum(exponent, axis=1)
    state = np.zeros((exponent.shape[0], exponent.shape[1] + 1))
    start, steps = 0, exponent.shape[1]
    while start < steps:
        base = passed[:, start - 1 : start] if start else np.zeros((exponent.shape[0], 1))
        furthest = (passed[:, start:] - base).max(axis=0)
        stop = start + max(int(np.searchsorted(furthest, LONGEST_EXPONENT, side="right")), 1)
        if stop == start + 1:
            state[:, stop] = np.exp(-exponent[:, start]) * state[:, start] + supply[:, start]
        else:
            # s_k = exp(-passed_k) Σ exp(passed_i) supply_i, in pieces whose exponent stays in
            # range
            grown = np.exp(passed[:, start:stop] - base)
            sums = np.cumsum(grown * supply[:, start:stop], axis=1)
            state[:, start + 1 : stop + 1] = (state[:, start : start + 1] + sums) / grown
        start = stop
    return state


def settled(case: Array, rate: Array, tau_outer: float, tau_inner: float = 0.0) -> Drivers:
    """Drivers [n] at case temperatures [n, °C] on steady ramps r [n, °C/min], transients over: T_o
    = T_s − τ_o r, G = τ_i r.
    """
    per_second = rate / SECONDS_PER_MINUTE
    return Drivers(case - tau_outer * per_second, rate, tau_inner * per_second, np.zeros_like(rate))

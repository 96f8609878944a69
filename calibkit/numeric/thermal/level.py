"""The `level` model: drift as a function of case temperature, its gradient to the chamber air, and
the rates of both.

T is the case temperature, G = T_case − T_env. Their rates are the slopes, at the newest sample, of
least-squares parabolas over a trailing window: causal, without delay, and insensitive to the steps
of a quantised thermometer.
"""

import numpy as np

from calibkit.arrays import Array
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.errors import FitError
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
        started = (s0 >= LEAST_SAMPLES) & (x[:, -1] <= -0.5) & (determinant > 0.0)
        at_end = (-minors[0] * v0 + minors[1] * v1 - minors[2] * v2) / np.where(
            started, determinant, 1.0
        )
        slope[ends] = np.where(started, at_end, 0.0) / window_s
    return slope * SECONDS_PER_MINUTE


def drivers(time: Array, case: Array, env: Array, window_s: float = WINDOW_S) -> Drivers:
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

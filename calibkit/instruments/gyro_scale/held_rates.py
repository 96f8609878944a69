"""Held rates of a rate-table log: rows in which the table holds a rate, without acceleration and
settling.

    max Ω − min Ω ≤ max(relative · max|Ω|, floor, 10 σ, 3.5 q)     over a window of rows

σ is the noise of the rate, from the smallest fifth of its second differences, which excludes steady
acceleration and steps; q the quantum between whose multiples a logged rate flickers. Overlapping
windows make a held rate, of which the settling time and the first and last interval are left out.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.constants import REVOLUTION_DEG
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.recipe import PlateauSpec
from calibkit.numeric import chunks, order_statistics
from calibkit.numeric.dispersion import MAD_TO_SIGMA

FIFTH_TO_SIGMA = 1.0 / 0.2533471031357997
"""Standard deviation of normal noise over the 0.2 quantile of its magnitude."""
NOISE_RANGE = 10.0
"""Largest peak-to-peak range of a held rate, in standard deviations of the rate's noise."""
QUANTA = 3.5
"""Largest range, in quanta, that a rate flickering between quantised values adds."""
FLICKER = 0.02
"""Least share of the rows at which a quantised rate must flicker."""
SOON = 8
"""Rows within which a flicker must reverse."""
SMALL = 5e-3
"""Change of rate, relative to the largest rate, above which it is a step of the table and not a
flicker.
"""
GAP = 3.0
"""Sampling interval, in median intervals, above which a gap ends the held rate."""
ANGLE_SLACK = 10.0
"""Factor on the allowed range for the rate from the table angle, which includes the jitter of the
time stamps.
"""
NO_RATE_HINT = (
    "check that the rate column is the table's, or allow shorter plateaus or a wider range of rate;"
    " where each row is the mean over a held rate: plateaus.one_row = true"
)


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of the table in the n rows of a log and the sampling intervals that end at them."""

    time_s: Array
    """Strictly increasing."""
    rate_dps: Array
    """Commanded or measured."""
    interval_s: Array
    turn_deg: Array
    """Turn in the interval."""
    middle_rad: Array
    """Angle in mid-interval."""
    angle_logged: bool

    @classmethod
    def of(
        cls,
        time_s: Array,
        rate_dps: Array,
        angle_deg: Array | None = None,
    ) -> Self:
        """Motion by the logged angle, of any wrapping, unwrapped about the turn that the rate lets
        expect; without one, by the rate.
        """
        interval = np.diff(time_s, prepend=2.0 * time_s[0] - time_s[1])
        turn_deg = expected = rate_dps * interval
        end_angle = np.cumsum(expected)
        if angle_deg is not None:
            end_angle = angle_deg
            steps = np.diff(angle_deg, prepend=angle_deg[0] - expected[0]) - expected
            turn_deg = expected + np.remainder(steps + 180.0, REVOLUTION_DEG) - 180.0
        middle = np.radians(end_angle - turn_deg / 2.0)
        return cls(time_s, rate_dps, interval, turn_deg, middle, angle_deg is not None)


def find(motion: Motion, rules: PlateauSpec) -> Integers:
    """First row and one past the last row [p, 2] of each held rate, by the rate and, where it is
    logged, by the angle too.

    Raises FitError where no rate is held.
    """
    time_s, rate_dps = motion.time_s, motion.rate_dps
    interval = order_statistics.median(motion.interval_s)
    window = max(rules.shortest_samples, int(np.ceil(rules.shortest_s / interval)))
    quantum, windows = 0.0, np.zeros(0, dtype=np.bool_)
    if time_s.size >= window:
        quantum = QUANTA * _quantum(rate_dps)
        # windows that contain no gap
        gaps = np.concatenate(([0], np.cumsum(motion.interval_s[1:] > GAP * interval)))
        windows = gaps[window - 1 :] == gaps[: gaps.size - window + 1]
        windows &= _is_held(rate_dps, window, rules.relative, max(rules.floor_dps, quantum))
        if motion.angle_logged:
            # a commanded rate steps at once, while the table takes its time: only the angle shows
            # that
            by_turn, wide = motion.turn_deg / motion.interval_s, ANGLE_SLACK * rules.relative
            floor_dps = max(rules.floor_dps, QUANTA * _quantum(by_turn))
            windows &= _is_held(by_turn, window, wide, floor_dps)
    fewest, spans, covered = max(rules.shortest_samples // 2, 2), [], 0
    for first_window, end in chunks.find_runs(windows).tolist():
        # rows that two runs of windows share belong to the first
        begin, covered = max(first_window, covered), end - 1 + window
        if covered <= begin:
            continue
        first, stop = _steady(rate_dps, begin, covered, rules, quantum)
        # without its settling time and without its first and last sampling interval
        wait = min(rules.settle_s, 0.25 * float(time_s[stop - 1] - time_s[first]))
        first_settled = int(np.searchsorted(time_s, time_s[first] + wait, side="right"))
        first, stop = max(first_settled, first + 1), stop - 1
        if stop - first >= fewest:
            spans.append((first, stop))
    if not spans:
        low, high = chunks.extremes(rate_dps)
        span = f"{time_s.size} rows with table rates of {low:g} to {high:g} °/s"
        angle_text = ", by table rate and table angle together" if motion.angle_logged else ""
        raise FitError(
            f"no held rate of {rules.shortest_s:g} s in {span}{angle_text}", hint=NO_RATE_HINT
        )
    return np.array(spans, dtype=np.int64)


def _is_held(rate: Array, window: int, relative: float, floor_dps: float) -> Mask:
    """Mask [n − window + 1] of the windows over which a rate [n, °/s] is held."""
    # small second differences: excludes steady acceleration and the steps between short holds
    bends = np.abs(np.diff(rate, 2))
    noise = FIFTH_TO_SIGMA * float(np.quantile(bends, 0.2)) / np.sqrt(6.0)
    held = np.empty(rate.size - window + 1, dtype=np.bool_)
    for a, b in chunks.ranges(held.size):  # a log's extremes take as much memory as the log
        part = rate[a : b + window - 1]
        highest, lowest = (_of_windows(end, part, window) for end in (np.maximum, np.minimum))
        range_limit = relative * np.maximum(np.abs(highest), np.abs(lowest))
        limit = np.maximum(range_limit, max(floor_dps, NOISE_RANGE * noise))
        held[a:b] = highest - lowest <= limit
    return held


def _of_windows(extreme: np.ufunc, values: Array, window: int) -> Array:
    """np.maximum or np.minimum of each window of values [n]: [n − window + 1], of two windows half
    as long each time.
    """
    width = 1
    while width < window:
        step = min(width, window - width)
        values = extreme(values[:-step], values[step:])
        width += step
    return values


def _quantum(rate: Array) -> float:
    """Resolution [°/s] of a logged rate [n] that flickers between neighbouring values; 0 where it
    does not.

    A flicker is the smallest change there is, small against the rates, frequent, and soon taken
    back.
    """
    steps = np.diff(rate)
    changes = np.abs(steps)
    quantum = float(np.min(changes, where=changes > 0.0, initial=np.inf))
    if not quantum < SMALL * float(np.max(np.abs(rate))):
        return 0.0
    rows = np.flatnonzero(steps)
    change = steps[rows]
    flicker = np.abs(change) < 1.5 * quantum
    taken_back = (change[1:] * change[:-1] < 0.0) & (np.diff(rows) < SOON)
    count = int(np.count_nonzero(flicker[1:] & flicker[:-1] & taken_back))
    return quantum if count > FLICKER * rate.size else 0.0


def _steady(
    rate: Array, first: int, stop: int, rules: PlateauSpec, quantum: float
) -> tuple[int, int]:
    """First and end row of the longest stretch of a span whose rate stays near the span's median; a
    slow creep at its ends is cut off.
    """
    part = rate[first:stop]
    middle = order_statistics.median(part)
    noise = MAD_TO_SIGMA * order_statistics.median_magnitude(part, middle)
    departure_limit = max(
        rules.relative * abs(middle), rules.floor_dps, NOISE_RANGE * noise, quantum
    )
    steady_runs = chunks.find_runs(np.abs(part - middle) <= departure_limit)
    begin, end = steady_runs[np.argmax(steady_runs[:, 1] - steady_runs[:, 0])].tolist()
    return first + begin, first + end

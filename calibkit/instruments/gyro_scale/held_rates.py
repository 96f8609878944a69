"""Held rates of a rate-table log: rows in which the table holds a rate, without acceleration and
settling.

    max Ω − min Ω ≤ max(relative · max|Ω|, floor, 10 σ, 3.5 q)     over a window of rows

σ is the noise of the rate, from the smallest fifth of its second differences, which excludes steady
acceleration and steps; q the quantum between whose multiples a logged rate flickers. Overlapping
windows make a held rate, of which the settling time and the first and last interval are left out.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.constants import REVOLUTION_DEG
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.recipe import PlateauSpec
from calibkit.numeric import chunks, order_statistics
from calibkit.numeric.dispersion import MAD_TO_SIGMA

Allocate = Callable[[int], Array]
Series = Callable[[int, int], Array]
"""Function that returns the values of rows first … stop − 1."""

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
        *,
        allocate: Allocate = np.empty,
    ) -> Self:
        """Motion by the logged angle, of any wrapping, unwrapped about the turn that the rate lets
        expect; without one, by the rate. `allocate` makes the arrays.
        """
        interval, turn_deg, middle = (allocate(time_s.size) for _ in range(3))
        angle = 0.0
        for a, b in chunks.ranges_along(time_s, rate_dps, interval, turn_deg, middle):
            interval[a:b] = np.diff(
                time_s[max(a - 1, 0) : b], prepend=[] if a else 2.0 * time_s[0] - time_s[1]
            )
            expected = rate_dps[a:b] * interval[a:b]
            if angle_deg is None:
                turn_deg[a:b] = expected
                end_angle = expected.copy()
                end_angle[0] += angle
                np.cumsum(end_angle, out=end_angle)
                angle = float(end_angle[-1])
                middle[a:b] = np.radians(end_angle - expected / 2.0)
                continue
            before = [] if a else angle_deg[0] - expected[0]
            step = np.diff(angle_deg[max(a - 1, 0) : b], prepend=before)
            turn_deg[a:b] = expected + np.remainder(step - expected + 180.0, REVOLUTION_DEG) - 180.0
            middle[a:b] = np.radians(angle_deg[a:b] - turn_deg[a:b] / 2.0)
            chunks.release(angle_deg)
        return cls(time_s, rate_dps, interval, turn_deg, middle, angle_deg is not None)

    def by_turn(self, first: int, stop: int) -> Array:
        """Rate [°/s] by the turn in the intervals that end at rows first … stop − 1."""
        chunks.release(self.turn_deg, self.interval_s)
        return self.turn_deg[first:stop] / self.interval_s[first:stop]

    def release(self) -> None:
        """Release the memory pages of columns that are mapped from files."""
        chunks.release(self.interval_s, self.turn_deg, self.middle_rad, self.rate_dps)


def find(motion: Motion, rules: PlateauSpec) -> Integers:
    """First row and one past the last row [p, 2] of each held rate, by the rate and, where it is
    logged, by the angle too.

    Raises FitError where no rate is held.
    """
    time_s, rate_dps = motion.time_s, motion.rate_dps
    interval = order_statistics.median(motion.interval_s)
    window = max(rules.shortest_samples, int(np.ceil(rules.shortest_s / interval)))
    rate_criterion, quantum = _stillness(
        chunks.row_reader(rate_dps), time_s.size, window, rules.relative, rules.floor_dps
    )
    criteria = [rate_criterion]
    if motion.angle_logged:
        # a commanded rate steps at once, while the table takes its time: only the angle shows that
        wide = ANGLE_SLACK * rules.relative
        criteria.append(_stillness(motion.by_turn, time_s.size, window, wide, rules.floor_dps)[0])

    def is_held(first: int, stop: int) -> Mask:
        # windows that contain no gap
        step = motion.interval_s[first : stop + window - 1]
        gaps = np.concatenate(([0], np.cumsum(step[1:] > GAP * interval)))
        windows = np.asarray(gaps[window - 1 :] == gaps[: gaps.size - window + 1], dtype=np.bool_)
        for criterion in criteria:
            windows &= criterion(first, stop)
        chunks.release(rate_dps, motion.turn_deg, motion.interval_s)
        return windows

    runs = chunks.find_runs(max(time_s.size - window + 1, 0), is_held).tolist()
    fewest, spans, covered = max(rules.shortest_samples // 2, 2), [], 0
    for first_window, end in runs:
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
    chunks.release(time_s)
    if not spans:
        low, high = chunks.extremes(rate_dps)
        span = f"{time_s.size} rows with table rates of {low:g} to {high:g} °/s"
        angle_text = ", by table rate and table angle together" if motion.angle_logged else ""
        raise FitError(
            f"no held rate of {rules.shortest_s:g} s in {span}{angle_text}", hint=NO_RATE_HINT
        )
    return np.array(spans, dtype=np.int64)


def _stillness(
    rate: Series, rows: int, window: int, relative: float, floor_dps: float
) -> tuple[Callable[[int, int], Mask], float]:
    """Function to the mask of windows, beginning in rows first … stop − 1, over which a rate of so
    many rows is held; and the range [°/s] that flicker between its quantised values may add.
    """
    noise = quantum = 0.0
    if rows >= window:

        def bends() -> Iterator[Array]:
            return (np.abs(np.diff(rate(a, b + 2), 2)) for a, b in chunks.ranges(rows - 2))

        # small second differences: excludes steady acceleration and the steps between short holds
        fewest = order_statistics.quantile_of_chunks(bends, rows - 2, 0.2)
        noise, quantum = FIFTH_TO_SIGMA * fewest / np.sqrt(6.0), QUANTA * _quantum(rate, rows)

    def is_held(first: int, stop: int) -> Mask:
        values = rate(first, stop + window - 1)
        highest, lowest = (
            _of_windows(extreme, values, window) for extreme in (np.maximum, np.minimum)
        )
        range_limit = np.maximum(relative * np.maximum(np.abs(highest), np.abs(lowest)), floor_dps)
        range_limit = np.maximum(range_limit, max(NOISE_RANGE * noise, quantum))
        return np.asarray(highest - lowest <= range_limit, dtype=np.bool_)

    return is_held, quantum


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


def _quantum(rate: Series, rows: int) -> float:
    """Resolution [°/s] of a logged rate that flickers between neighbouring values; 0 where it does
    not.

    A flicker is the smallest change there is, small against the rates, frequent, and soon taken
    back.
    """
    quantum, largest = np.inf, 0.0
    for a, b in chunks.ranges(rows):
        part = rate(a, min(b + 1, rows))
        change = np.abs(np.diff(part))
        quantum = min(quantum, float(np.min(change, where=change > 0.0, initial=np.inf)))
        largest = max(largest, float(np.max(np.abs(part))))
    if not quantum < SMALL * largest:
        return 0.0
    back, last, before = 0, -SOON, 0.0
    for a, b in chunks.ranges(rows - 1):
        step = np.diff(rate(a, b + 1))
        change_rows = np.flatnonzero(step)
        if not change_rows.size:
            continue
        change = np.concatenate(([before], step[change_rows]))
        row = np.concatenate(([last], change_rows + a))
        flicker = np.abs(change) < 1.5 * quantum
        reversed_soon = (
            flicker[1:] & flicker[:-1] & (change[1:] * change[:-1] < 0.0) & (np.diff(row) < SOON)
        )
        back += int(np.count_nonzero(reversed_soon))
        last, before = int(row[-1]), float(change[-1])
    return quantum if back > FLICKER * rows else 0.0


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
    steady_runs = chunks.find_runs(
        part.size, lambda a, b: np.abs(part[a:b] - middle) <= departure_limit
    )
    begin, end = steady_runs[np.argmax(steady_runs[:, 1] - steady_runs[:, 0])].tolist()
    chunks.release(rate)
    return first + begin, first + end

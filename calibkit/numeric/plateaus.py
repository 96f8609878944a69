"""Rate plateaus of a rate-table log: where the table holds a rate, without acceleration and settling."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Counts = NDArray[np.int64]

REVOLUTION_DEG = 360.0
MAD_TO_SIGMA = 1.0 / 0.6744897501960817
"""Standard deviation of normal noise over its median absolute deviation."""
FIFTH_TO_SIGMA = 1.0 / 0.2533471031357997
"""The same over its 0.2 quantile."""
NOISE_RANGE = 10.0
"""Peak-to-peak range of the rate, in standard deviations of its noise, that a held rate may show."""
QUANTA = 3.5
"""Range that a flickering resolution may add, in quanta."""
FLICKER = 0.02
"""Share of the rows at which a rate must flicker."""
SOON = 8
"""Rows within which a flicker is taken back."""
SMALL = 5e-3
"""Of the largest rate, above which a change is a step of the table."""
GAP = 3.0
"""Sampling intervals, in medians, that end a plateau: nobody knows what the table did meanwhile."""

ANGLE_SLACK = 10.0
"""How much more the rate from the table angle may range: the jitter of the time stamps is in it."""


@dataclass(frozen=True, slots=True)
class Rules:
    """What counts as a held rate."""

    shortest_s: float = 2.0
    """Shortest plateau."""
    shortest_samples: int = 8
    settle_s: float = 1.0
    """Dropped after each change of rate; at most a quarter of the plateau."""
    relative: float = 1e-3
    """Range of the rate within `shortest_s`, of the rate."""
    floor_dps: float = 1e-4
    """The same near zero rate [°/s]."""


DEFAULT_RULES = Rules()


@dataclass(frozen=True, slots=True)
class Turn:
    """What the table did in each sampling interval that ends at a row: turn [n] [°], angle in its middle [n] [rad]."""

    interval_s: Array
    turn_deg: Array
    middle_rad: Array
    logged: bool


def find(
    time_s: Array, table_rate_dps: Array, *, table_angle_deg: Array | None = None, rules: Rules = DEFAULT_RULES
) -> Counts:
    """Rows of the held rates of a rate-table log, without acceleration and settling.

    Parameters
    ----------
    time_s : [n] [s], strictly increasing.
    table_rate_dps : [n] [°/s], commanded or measured.
    table_angle_deg : [n] [°], of any wrapping; where logged, the rate that it gives must be held too.
    rules : what counts as held.

    Returns
    -------
    [p, 2], first row and one past the last row of each plateau.

    Raises
    ------
    FitError
        Times that do not increase, values that are not finite, or no held rate at all.

    """
    _require_record(time_s, table_rate_dps)
    turn = turn_of(time_s, table_rate_dps, table_angle_deg)
    interval = float(np.median(turn.interval_s))
    window = max(rules.shortest_samples, int(np.ceil(rules.shortest_s / interval)))
    held = _held(table_rate_dps, window, rules) & _unbroken(turn.interval_s, window, interval)
    if turn.logged:
        # a commanded rate steps at once, while the table takes its time: only the angle shows that
        held &= _held(turn.turn_deg / turn.interval_s, window, replace(rules, relative=ANGLE_SLACK * rules.relative))
    spans = [_steady(table_rate_dps, *run, rules) for run in _joined(_true_runs(held), window)]
    trimmed = [_settled(time_s, *span, rules) for span in spans]
    kept = [(first, stop) for first, stop in trimmed if stop - first >= max(rules.shortest_samples // 2, 2)]
    if not kept:
        raise FitError(
            f"no held rate of {rules.shortest_s:g} s in {time_s.size} rows "
            f"with table rates of {table_rate_dps.min():g} to {table_rate_dps.max():g} °/s"
            + (", by table rate and table angle together" if turn.logged else ""),
            hint="check that the rate column is the table's, or allow shorter plateaus or a wider range of rate",
        )
    return np.array(kept, dtype=np.int64)


def _require_record(time_s: Array, table_rate_dps: Array) -> None:
    """Refuse times that do not increase and table rates that are not finite."""
    if time_s.size < 4 or time_s.size != table_rate_dps.size:
        raise FitError(f"{time_s.size} times and {table_rate_dps.size} table rates, expected at least four of each")
    if not (np.isfinite(time_s).all() and np.isfinite(table_rate_dps).all()):
        raise FitError("a time or a table rate is not finite", hint="exclude the rows that hold it")
    if not (np.diff(time_s) > 0.0).all():
        row = int(np.flatnonzero(np.diff(time_s) <= 0.0)[0]) + 1
        raise FitError(f"time does not increase in row {row}", hint="split the log there, or repair its clock")


def turn_of(time_s: Array, table_rate_dps: Array, table_angle_deg: Array | None) -> Turn:
    """Turn of the table in each interval.

    From the logged angle, unwrapped about the turn that the rate lets expect; without one, from the rate.
    """
    interval = np.diff(time_s, prepend=2.0 * time_s[0] - time_s[1])
    expected = table_rate_dps * interval
    if table_angle_deg is None:
        angle = np.cumsum(expected)
        return Turn(interval, expected, np.radians(angle - expected / 2.0), logged=False)
    if not np.isfinite(table_angle_deg).all():
        raise FitError("a table angle is not finite", hint="exclude the rows that hold it")
    step = np.diff(table_angle_deg, prepend=table_angle_deg[0] - expected[0])
    turned = expected + np.remainder(step - expected + 180.0, REVOLUTION_DEG) - 180.0
    return Turn(interval, turned, np.radians(table_angle_deg - turned / 2.0), logged=True)


def _held(rate: Array, window: int, rules: Rules) -> NDArray[np.bool_]:
    """Whether the rate [n] is held over the window that begins at each of the first n − window + 1 rows."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    if rate.size < window:
        return np.zeros(0, dtype=np.bool_)
    # second differences, the smaller ones: neither a steady acceleration nor many short plateaus are noise
    noise = FIFTH_TO_SIGMA * float(np.quantile(np.abs(np.diff(rate, 2)), 0.2)) / np.sqrt(6.0)
    begin = slice(window // 2, window // 2 + rate.size - window + 1)
    highest, lowest = maximum_filter1d(rate, window)[begin], minimum_filter1d(rate, window)[begin]
    allowed = np.maximum(rules.relative * np.maximum(np.abs(highest), np.abs(lowest)), rules.floor_dps)
    loose = max(NOISE_RANGE * noise, QUANTA * _quantum(rate))
    return np.asarray(highest - lowest <= np.maximum(allowed, loose), dtype=np.bool_)


def _quantum(rate: Array) -> float:
    """Resolution of a logged rate that flickers between neighbouring values; 0 where it does not.

    A flicker is the smallest change there is, small against the rates, frequent, and soon taken back.
    """
    change = np.diff(rate)
    rows = np.flatnonzero(change)
    change = change[rows]
    if change.size < 2:
        return 0.0
    quantum = float(np.min(np.abs(change)))
    flicker = np.abs(change) < 1.5 * quantum
    back = flicker[1:] & flicker[:-1] & (change[1:] * change[:-1] < 0.0) & (np.diff(rows) < SOON)
    frequent = back.sum() > FLICKER * rate.size
    return quantum if frequent and quantum < SMALL * float(np.max(np.abs(rate))) else 0.0


def _unbroken(interval_s: Array, window: int, median_s: float) -> NDArray[np.bool_]:
    """Whether the window that begins at each row has no gap in it."""
    gaps = np.concatenate(([0], np.cumsum(interval_s[1:] > GAP * median_s)))
    return np.asarray(gaps[window - 1 :] == gaps[: gaps.size - window + 1], dtype=np.bool_)


def _true_runs(held: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one past the last index of each run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], held.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _joined(runs: list[tuple[int, int]], window: int) -> list[tuple[int, int]]:
    """Rows that runs of held windows cover; where two share rows, the first keeps them."""
    spans: list[tuple[int, int]] = []
    for begin, end in runs:
        first = max(begin, spans[-1][1]) if spans else begin
        if end - 1 + window > first:
            spans.append((first, end - 1 + window))
    return spans


def _steady(rate: Array, first: int, stop: int, rules: Rules) -> tuple[int, int]:
    """Longest stretch of a span whose rate stays by its median: a slow creep into or out of it is cut off."""
    part = rate[first:stop]
    middle = float(np.median(part))
    noise = MAD_TO_SIGMA * float(np.median(np.abs(part - middle)))
    allowed = max(rules.relative * abs(middle), rules.floor_dps, NOISE_RANGE * noise, QUANTA * _quantum(rate))
    begin, end = max(_true_runs(np.abs(part - middle) <= allowed), key=lambda run: run[1] - run[0])
    return first + begin, first + end


def _settled(time_s: Array, first: int, stop: int, rules: Rules) -> tuple[int, int]:
    """Span without its settling time, without its first interval, which began before it, and without its last."""
    wait = min(rules.settle_s, 0.25 * float(time_s[stop - 1] - time_s[first]))
    begin = max(int(np.searchsorted(time_s, time_s[first] + wait, side="right")), first + 1)
    return begin, stop - 1

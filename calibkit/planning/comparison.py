"""Logs compared with the schedule of their plan: which actions are missing, and which differ.

A dwell or rate is found by rows that are near its temperature, its direction of gravity and its
rate; a ramp by its end and by its slope in the middle.
"""

from collections.abc import Callable, Iterator

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.frame import Log, values
from calibkit.numeric import attitude
from calibkit.planning.schedule import Action, Schedule

NEAR_DEGC = 5.0
"""Largest difference of a case temperature [°C] from the set point of the chamber."""
NEAR_DEG = 1.0
"""Largest angle [°] between a planned and a logged direction of gravity."""
NEAR_RATE = 0.02
"""Largest relative difference of a held rate of the table."""
NEAR_RAMP = 0.2
"""Largest relative difference of the rate of a ramp; the case lags the chamber at its ends."""
MIDDLE = (0.3, 0.7)
"""Part of a ramp in which its rate is measured, by temperature."""
ONE_ROW = 3
"""Rows per planned dwell up to which a row is a dwell."""


def find_differences(schedule: Schedule, read: Callable[[str], Log | None]) -> Iterator[str]:
    """Actions of a schedule that logs lack, and those that differ, one text each; `read` gives a
    log by its name, None where there is none.
    """
    for name, planned in schedule.by_log().items():
        log = read(name)
        if log is None:
            kinds = {action.action for action in planned}
            yield f"{name}: planned, with {len(planned)} actions ({', '.join(sorted(kinds))})"
            continue
        counted: dict[str, tuple[Mask, int]] = {}
        for action in planned:
            if action.action in ("dwell", "rate"):
                action_text, rows = _find_rows(log, action)
                counted[action_text] = rows, counted.get(action_text, (rows, 0))[1] + 1
            elif action.action == "ramp":
                yield from _compare_ramp(log, action)
        # of a log with a row for each dwell the rows are counted
        times_planned = sum(times for _, times in counted.values())
        for action_text, (rows, times) in counted.items():
            logged = int(rows.sum())
            if not logged:
                yield f"{log.file}: {action_text}"
            elif len(log.frame) <= ONE_ROW * times_planned and logged < times:
                yield f"{log.file}: {action_text}, {logged} of {times} times"


def _find_rows(log: Log, action: Action) -> tuple[str, Mask]:
    """A planned dwell or held rate in words, as far as a log tells it from others, and the rows
    that are at it.
    """
    level_text = f"{action.set_degc:g} °C"
    rows_near = ~(np.abs(_column(log, "temp_case_degc") - action.set_degc) > NEAR_DEGC)
    if action.action == "rate":
        rate_error = np.abs(_column(log, "table_rate_dps") - action.table_rate_dps)
        rows_near &= rate_error <= NEAR_RATE * abs(action.table_rate_dps)
        return f"rate {action.table_rate_dps:+g} °/s at {level_text}", rows_near
    if "inclination_deg" not in log.frame.columns:
        return f"dwell at {level_text}", rows_near
    tilt, roll = action.inclination_deg, action.toolface_deg
    logged_roll = _column(log, "toolface_deg") + _column(log, "position_deg", 0.0)
    planned = attitude.gravity_vector(np.array([tilt]), np.array([roll]))[0]
    logged = attitude.gravity_vector(_column(log, "inclination_deg"), logged_roll)
    rows_near &= logged @ planned >= np.cos(np.radians(NEAR_DEG))
    return f"dwell at inclination {tilt:g}°, toolface {roll:g}°, {level_text}", rows_near


def _compare_ramp(log: Log, action: Action) -> Iterator[str]:
    """A ramp that ends elsewhere, or has another rate; of a case that lags, the end alone."""
    time, degc = _column(log, "time_s"), _column(log, "temp_env_degc")
    lags = not np.isfinite(degc).any()
    if lags:
        degc = _column(log, "temp_case_degc")
    if not np.isfinite(degc).any():
        return
    end = float(np.nanmax(degc) if action.ramp_degc_per_min > 0.0 else np.nanmin(degc))
    planned = f"{log.file}: ramp of {action.ramp_degc_per_min:+g} °C/min to {action.set_degc:g} °C"
    if not abs(end - action.set_degc) <= NEAR_DEGC:
        yield f"{planned}; it ends at {end:.1f} °C"
    elif not lags:
        share = (degc - degc[0]) / (action.set_degc - degc[0] or np.nan)
        first, last = (int(np.argmax(share >= part)) for part in MIDDLE)
        if last <= first:
            yield f"{planned}; there is no ramp"
            return
        rate = (degc[last] - degc[first]) / (time[last] - time[first]) * SECONDS_PER_MINUTE
        if not abs(rate / action.ramp_degc_per_min - 1.0) <= NEAR_RAMP:
            yield f"{planned}; its rate is {rate:+.3g} °C/min"


def _column(log: Log, name: str, otherwise: float = np.nan) -> Array:
    """A column of a log; a constant where it has none."""
    if name not in log.frame.columns:
        return np.full(len(log.frame), otherwise)
    return np.asarray(values(log.frame, name), dtype=np.float64)

"""Logs compared with the schedule of their plan: which actions are missing, and which differ.

A dwell or rate is found by rows that are near its temperature, its direction of gravity and its
rate; a ramp by its end and by its slope in the middle.
"""

from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from calibkit.numeric import attitude
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.planning.schedule import Action, Schedule
from calibkit.records.frame import Log, values

NEAR_DEGC = 5.0
"""Largest difference of a case temperature [°C] from the set point of the chamber."""


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
        # Dwells and held rates in words, as far as the log tells them from others: how often each
        # is planned, and how many rows are at it. What is not logged differs from nothing.
        times, logged = Counter[str](), dict[str, int]()
        case_degc, table_rate_dps, tilt_deg, roll_deg = (
            values(log.frame, column, np.nan)
            for column in ("temp_case_degc", "table_rate_dps", "inclination_deg", "toolface_deg")
        )
        turned_deg = roll_deg + values(log.frame, "position_deg", 0.0)
        direction = attitude.gravity_vector(tilt_deg, turned_deg)
        for action in planned:
            near = ~(np.abs(case_degc - action.set_degc) > NEAR_DEGC)
            if action.action == "ramp":
                yield from _compare_ramp(log, action)
                continue
            if action.action == "rate":
                rate = action.table_rate_dps
                near &= np.abs(table_rate_dps - rate) <= 0.02 * abs(rate)
                words = f"rate {rate:+g} °/s at"
            elif action.action == "dwell" and "inclination_deg" in log.frame:
                tilt, roll = action.inclination_deg, action.toolface_deg
                planned_direction = attitude.gravity_vector(np.array([tilt]), np.array([roll]))[0]
                near &= direction @ planned_direction >= np.cos(np.radians(1.0))
                words = f"dwell at inclination {tilt:g}°, toolface {roll:g}°,"
            elif action.action == "dwell":
                words = "dwell at"
            else:
                continue
            words = f"{words} {action.set_degc:g} °C"
            times[words] += 1
            logged[words] = int(near.sum())
        # of a log with a row for each dwell the rows are counted
        few_rows = len(log.frame) <= 3 * times.total()
        for words, rows in logged.items():
            if not rows:
                yield f"{log.file}: {words}"
            elif few_rows and rows < times[words]:
                yield f"{log.file}: {words}, {rows} of {times[words]} times"


def _compare_ramp(log: Log, action: Action) -> Iterator[str]:
    """A ramp that ends elsewhere, or has another rate; of a case, which lags the chamber, the end
    alone.
    """
    time, degc = values(log.frame, "time_s", np.nan), values(log.frame, "temp_env_degc", np.nan)
    lags = not np.isfinite(degc).any()
    if lags:
        degc = values(log.frame, "temp_case_degc", np.nan)
    if not np.isfinite(degc).any():
        return
    end = float(np.nanmax(degc) if action.ramp_degc_per_min > 0.0 else np.nanmin(degc))
    planned = f"{log.file}: ramp of {action.ramp_degc_per_min:+g} °C/min to {action.set_degc:g} °C"
    if not abs(end - action.set_degc) <= NEAR_DEGC:
        yield f"{planned}; it ends at {end:.1f} °C"
    elif not lags:
        # its rate is measured in the middle, from 30 to 70 % of the way
        share = (degc - degc[0]) / (action.set_degc - degc[0] or np.nan)
        first, last = (int(np.argmax(share >= part)) for part in (0.3, 0.7))
        minutes = (time[last] - time[first]) / SECONDS_PER_MINUTE
        rate = (degc[last] - degc[first]) / minutes if last > first else 0.0
        if not abs(rate / action.ramp_degc_per_min - 1.0) <= 0.2:
            yield f"{planned}; its rate is {rate:+.3g} °C/min"

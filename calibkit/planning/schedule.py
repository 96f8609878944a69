"""The actions of a campaign in time: ramps, soaks, dwells, rates, remountings.

`Clock` adds them one after the other, waits where a person is needed, and holds each soak until the
device has followed the chamber (`Equipment.soak_s`).
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from math import copysign
from typing import Any, Literal

from calibkit.errors import CoefficientError
from calibkit.numeric.constants import SECONDS_PER_HOUR, SECONDS_PER_MINUTE
from calibkit.planning.equipment import Device, Equipment, Fixture

Kind = Literal["mount", "ramp", "soak", "dwell", "rate", "remount", "wait"]
NONE = float("nan")
DAY_S = 24.0 * SECONDS_PER_HOUR


@dataclass(frozen=True, slots=True)
class Action:
    """One row of a schedule; NaN where a quantity has no part in the action."""

    start_s: float
    action: Kind
    set_degc: float
    """Set point of the chamber at the end of the action."""
    ramp_degc_per_min: float = NONE
    inclination_deg: float = NONE
    toolface_deg: float = NONE
    azimuth_deg: float = NONE
    table_rate_dps: float = NONE
    duration_s: float = 0.0
    log: str = ""
    """Log that the action is recorded in; empty where nothing is."""

    @property
    def end_s(self) -> float:
        """End of the action."""
        return self.start_s + self.duration_s

    @property
    def start_degc(self) -> float:
        """Set point of the chamber at the start of the action."""
        rate = self.ramp_degc_per_min if self.action == "ramp" else 0.0
        return self.set_degc - rate * self.duration_s / SECONDS_PER_MINUTE


@dataclass(frozen=True, slots=True)
class Schedule:
    """Actions in their order."""

    actions: tuple[Action, ...]
    operator_h: float = 0.0
    """Hours in which a person is needed."""

    @property
    def hours(self) -> float:
        """Length of the campaign."""
        return self.actions[-1].end_s / SECONDS_PER_HOUR if self.actions else 0.0

    def by_log(self) -> dict[str, list[Action]]:
        """Log → the actions that it records, in their order."""
        logs: dict[str, list[Action]] = {}
        for action in self.actions:
            if action.log:
                logs.setdefault(action.log, []).append(action)
        return logs

    def recorded(self, kind: Kind) -> tuple[Action, ...]:
        """Actions of a kind that a log records."""
        return tuple(action for action in self.actions if action.action == kind and action.log)

    def to_csv(self) -> bytes:
        """One action per row; an empty field where a quantity has no part in it."""
        from pandas import DataFrame  # a slow import

        rows = DataFrame(
            map(asdict, self.actions), columns=[field.name for field in fields(Action)]
        )
        return rows.to_csv(index=False, float_format="%.10g", lineterminator="\n").encode()


def read_schedule(text: str, name: str) -> Schedule:
    """Schedule of a CSV text; CoefficientError for one that calibkit did not write."""
    names = [field.name for field in fields(Action)]
    rows = list(csv.reader(io.StringIO(text)))
    # the first plans were without azimuths
    if not rows or rows[0] not in (names, [name for name in names if name != "azimuth_deg"]):
        raise CoefficientError(
            f"{name}: not a schedule: its first line is not {','.join(names)}",
            hint="restore the file that calibkit plan wrote",
        )
    actions = []
    for number, row in enumerate(rows[1:], start=2):
        try:
            cells: dict[str, Any] = dict(zip(rows[0], row, strict=True))
            for key in cells.keys() - {"action", "log"}:
                cells[key] = float(cells[key] or NONE)
            actions.append(Action(**cells))
        except ValueError:
            raise CoefficientError(
                f"{name}:{number}: not an action of a schedule",
                hint="restore the file that calibkit plan wrote",
            ) from None
    return Schedule(tuple(actions))


class Clock:
    """Builds a schedule action by action, from the first working hour of a day at room
    temperature.
    """

    def __init__(self, equipment: Equipment) -> None:
        self.equipment = equipment
        # moves of a fixture or of a table, which are no actions, are added to it
        self.now_s = 0.0
        self.degc = equipment.chamber.room_degc
        self._operator_s = 0.0
        self._actions: list[Action] = []

    def add(self, kind: Kind, duration_s: float, log: str = "", **quantities: float) -> None:
        """An action of a length [s] at the temperature that is reached, after mounting where it is
        the first; quantities as an `Action` has them. Nothing where it takes no time.
        """
        if duration_s <= 0.0:
            return
        if not self._actions and kind != "mount":
            mount_s = self.equipment.operator.mount_h * SECONDS_PER_HOUR
            self._operator_s += mount_s
            self.add("mount", mount_s)
        degc = self.equipment.chamber.room_degc if kind == "mount" else self.degc
        action = Action(self.now_s, kind, degc, duration_s=duration_s, log=log, **quantities)
        self._actions.append(action)
        self.now_s += duration_s

    def attend(self, duration_s: float) -> None:
        """Wait until a person is there for an action of a length [s], and count it."""
        person = self.equipment.operator
        day = (person.to_h - person.from_h) * SECONDS_PER_HOUR
        # time counts from the first working hour of a day
        time_of_day_s = self.now_s % DAY_S
        if time_of_day_s + duration_s > day:
            self.add("wait", DAY_S - time_of_day_s)
        self._operator_s += duration_s

    def ramp(self, degc: float, rate: float, log: str = "") -> None:
        """Ramp to a temperature [°C] at an unsigned rate [°C/min]."""
        change = degc - self.degc
        self.degc = degc
        signed = copysign(rate, change)
        self.add("ramp", abs(change) / rate * SECONDS_PER_MINUTE, log, ramp_degc_per_min=signed)

    def settle(
        self, device: Device, degc: float, log: str = "", *, shortest_s: float = 0.0
    ) -> None:
        """Ramp to a temperature [°C] as fast as a device may, and hold it until the device is
        there.
        """
        rate, change = self.equipment.fastest(device), degc - self.degc
        self.ramp(float(degc), rate, log)
        self.add("soak", max(self.equipment.soak_s(device, change, rate), shortest_s), log)

    def dwell(self, fixture: Fixture, spot: Sequence[float], duration_s: float, log: str) -> None:
        """Move to an attitude, with a person where the fixture needs one, and hold it: inclination
        and toolface [°], and azimuth [°] where it matters.
        """
        if fixture.attended:
            self.attend(fixture.move_s + duration_s)
        self.now_s += fixture.move_s
        names = ("inclination_deg", "toolface_deg", "azimuth_deg")
        self.add("dwell", duration_s, log, **dict(zip(names, spot, strict=False)))

    def remount(self, rate: float) -> None:
        """Go to room temperature at a rate [°C/min] and mount the device anew."""
        self.ramp(self.equipment.chamber.room_degc, rate)
        remount_s = self.equipment.operator.remount_h * SECONDS_PER_HOUR
        self.attend(remount_s)
        self.add("remount", remount_s)

    def schedule(self) -> Schedule:
        """What was built."""
        return Schedule(tuple(self._actions), self._operator_s / SECONDS_PER_HOUR)

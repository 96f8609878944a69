"""What a plan is asked for, the campaigns among which it chooses, and what they will give."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from calibkit import units
from calibkit.errors import RecipeError, UsageError
from calibkit.frame import values
from calibkit.planning.schedule import Schedule

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from calibkit.coefficients import Record, StageResult
    from calibkit.frame import Log
    from calibkit.planning.equipment import Equipment

COVERAGE = 2.0
"""Coverage factor of U in plans: the sizes of shared errors are assumed, not estimated."""
WITHHELD = "withheld/"
"""Folder of the logs that a fit does not see."""
ADDED = "added_"
"""Names of logs that are added to a campaign begin with this."""
_WISH = re.compile(r"^\s*(?P<name>.+?)\s*<=\s*(?P<value>[-+.\deE]+)\s*(?P<unit>\S+)\s*$")


class Progress(Protocol):
    """Passes items through and may show how far one is."""

    def __call__(self, items: Sequence[str], what: str) -> Iterable[str]:
        """Yield the items."""
        ...


@dataclass(frozen=True, slots=True)
class Wish:
    """Largest expanded uncertainty of a result over the range of use."""

    name: str
    value: float
    unit: str

    @classmethod
    def parse(cls, text: str, offered: Mapping[str, str]) -> Wish:
        """Wish of a text "NAME<=VALUE UNIT", in the unit in which the result is offered; UsageError
        for another text, name or unit.
        """
        match = _WISH.match(text)
        names = ", ".join(f"{name} [{unit}]" for name, unit in offered.items())
        try:
            value = float(match["value"]) if match else 0.0
        except ValueError:
            value = 0.0
        if match is None or not 0.0 < value < float("inf"):
            fault = 'expected "NAME<=VALUE UNIT"'
        elif match["name"] not in offered:
            fault = f"no result '{match['name']}'"
        else:
            unit = offered[match["name"]]
            asked = units.ALIASES.get(match["unit"], match["unit"])
            try:
                factor = 1.0 if asked == unit else units.difference_factor(asked, unit)
                return cls(match["name"], value * factor, unit)
            except RecipeError:
                fault = f"'{asked}' is no unit of '{match['name']}'"
        raise UsageError(f"--want '{text}': {fault}", hint=f"results: {names}") from None


@dataclass(frozen=True, slots=True)
class Task:
    """What a plan is asked for."""

    equipment: Equipment
    wishes: tuple[str, ...] = ()
    within_h: float | None = None
    range_degc: tuple[float, float] | None = None
    attitudes: str = "two-axis"
    """Name of a fixture, or a file of attitudes."""
    spots: tuple[tuple[float, float], ...] = ()
    """Inclination and toolface [°] of the attitudes of a file."""
    remountings: int = 0
    seed: int = 1
    restarts: int = 3
    earlier: Mapping[str, Record | StageResult] | None = None
    """Coefficient files of an earlier run of this type of device."""
    have: tuple[Log, ...] = ()
    """Logs of what is measured already."""
    withheld: bool = False
    """Whether logs are withheld already."""
    progress: Progress = lambda items, _: items

    def name_log(self, name: str) -> str:
        """Name of a log of the plan, which no measured log has."""
        prefix = ADDED if self.have else ""
        while any(prefix and Path(log.file).name.startswith(prefix) for log in self.have):
            prefix += ADDED
        return prefix + name


def measured_range(logs: Iterable[Log]) -> tuple[float, float] | None:
    """Lowest and highest case temperature [°C] of logs; None where none is logged."""
    name = "temp_case_degc"
    logged = [values(log.frame, name) for log in logs if name in log.frame.columns]
    ends = [(float(np.nanmin(degc)), float(np.nanmax(degc))) for degc in logged if degc.size]
    return (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None


def count(number: int, noun: str) -> str:
    """A number of things in words."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


@dataclass(frozen=True, slots=True)
class Design:
    """A campaign that could be run."""

    label: str
    """What it is, in a few words."""
    schedule: Schedule
    logs: tuple[str, ...]
    """Names of its logs, as a recipe lists them."""
    rows: Any
    """What the instrument predicts its uncertainty from."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """What a simulation of it needs beside the schedule."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Keys and tables of its recipe with other values."""
    choice: Any = None
    """What the instrument made it from."""


NOTHING = Design("nothing to add to what is measured", Schedule(()), (), None)
"""A campaign that adds nothing to what is measured."""


@dataclass(frozen=True, slots=True)
class Predicted:
    """Predicted uncertainty of a result."""

    name: str
    unit: str
    u: float
    """Root mean square of the standard uncertainty over the range of use."""
    largest_u: float
    """Largest standard uncertainty in the range of use."""
    limits: Mapping[str, float]
    """Source → its share of the mean variance; sums to 1."""

    @property
    def expanded(self) -> float:
        """Expanded uncertainty, the largest in the range of use."""
        return COVERAGE * self.largest_u


@dataclass(frozen=True, slots=True)
class Candidate:
    """A campaign with what it will give."""

    design: Design
    results: Mapping[str, Predicted]
    """By name."""

    @property
    def hours(self) -> float:
        """How long it takes."""
        return self.design.schedule.hours

    def expanded(self, name: str) -> float:
        """Expanded uncertainty of a result."""
        return self.results[name].expanded

    def meets(self, wishes: Sequence[Wish]) -> bool:
        """Whether every wish is met."""
        return all(self.expanded(wish.name) <= wish.value for wish in wishes)

    def excess(self, wishes: Sequence[Wish]) -> float:
        """Largest U relative to what is wished."""
        return max(self.expanded(wish.name) / wish.value for wish in wishes)


@dataclass(frozen=True, slots=True)
class Coefficient:
    """Predicted standard uncertainty of a coefficient."""

    model: str
    name: str
    unit: str
    standard_uncertainty: float

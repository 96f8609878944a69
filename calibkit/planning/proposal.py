"""What a plan is asked for, the campaigns among which it chooses, and what it proposes."""

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

    from calibkit.arrays import Array
    from calibkit.coefficients import Record, StageResult
    from calibkit.frame import Log
    from calibkit.planning.equipment import Equipment
    from calibkit.recipe.tables import ErrorComponent

COVERAGE = 2.0
"""Coverage factor of U in plans: the sizes of shared errors are assumed, not estimated."""
WITHHELD = "withheld/"
"""Folder of the logs that a fit does not see."""
ADDED = "added_"
"""Names of logs that are added to a campaign begin with this."""
ONE_LEVEL_DEGC = 5.0
"""Temperatures nearer than this are one of a campaign."""
NOTHING = "nothing to add to what is measured"
"""Label of an empty campaign."""
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
        found = _WISH.match(text)
        names = ", ".join(f"{name} [{unit}]" for name, unit in offered.items())
        try:
            value = float(found["value"]) if found else 0.0
        except ValueError:
            value = 0.0
        if found is None or not 0.0 < value < float("inf"):
            raise UsageError(
                f"--want '{text}': expected \"NAME<=VALUE UNIT\"", hint=f"results: {names}"
            )
        if found["name"] not in offered:
            raise UsageError(
                f"--want '{text}': no result '{found['name']}'", hint=f"results: {names}"
            )
        unit = offered[found["name"]]
        own = units.ALIASES.get(found["unit"], found["unit"])
        try:
            factor = 1.0 if own == unit else units.difference_factor(own, unit)
        except RecipeError:
            raise UsageError(
                f"--want '{text}': '{own}' is no unit of '{found['name']}'",
                hint=f"results: {names}",
            ) from None
        return cls(found["name"], value * factor, unit)


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
    found = [values(log.frame, name) for log in logs if name in log.frame.columns]
    ends = [(float(np.nanmin(one)), float(np.nanmax(one))) for one in found if one.size]
    return (min(low for low, _ in ends), max(high for _, high in ends)) if ends else None


def cover_range(
    temperatures: Iterable[float], fewest: int, range_degc: tuple[float, float]
) -> bool:
    """Whether temperatures [°C] reach both ends of a range of use, and at least so many differ."""
    found = np.sort(np.fromiter(temperatures, dtype=np.float64))
    ends = np.array(range_degc) + np.array([1.0, -1.0]) * ONE_LEVEL_DEGC
    reached = found.size and found[0] <= ends[0] and found[-1] >= ends[1]
    return bool(reached and 1 + np.sum(np.diff(found) > ONE_LEVEL_DEGC) >= fewest)


def count(number: int, noun: str) -> str:
    """A number of things in words."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


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

    @classmethod
    def of(cls, name: str, unit: str, parts: Mapping[str, Array]) -> Predicted:
        """Uncertainty of a result from the variances [m] over the range of use that noise and each
        source leave.
        """
        whole = np.sum([*parts.values()], axis=0)
        mean = float(whole.mean())
        limits = {source: float(part.mean()) / mean for source, part in parts.items()}
        return cls(name, unit, float(np.sqrt(mean)), float(np.sqrt(whole.max())), limits)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty, the largest in the range of use."""
        return COVERAGE * self.largest_u


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
    how: Any = None
    """What the instrument made it from."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """What a simulation of it needs beside the schedule."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Keys and tables of its recipe with other values."""

    @classmethod
    def nothing(cls) -> Design:
        """A campaign that adds nothing to what is measured."""
        return cls(NOTHING, Schedule(()), (), None)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A campaign with what it will give."""

    design: Design
    largest_u: Mapping[str, float]
    """Result → largest standard uncertainty in the range of use."""

    @property
    def label(self) -> str:
        """What it is, in a few words."""
        return self.design.label

    @property
    def hours(self) -> float:
        """How long it takes."""
        return self.design.schedule.hours

    def meets(self, wishes: Sequence[Wish]) -> bool:
        """Whether every wish is met."""
        return all(COVERAGE * self.largest_u[wish.name] <= wish.value for wish in wishes)

    def excess(self, names: Mapping[str, float]) -> float:
        """Largest U relative to the value of each name."""
        return max(COVERAGE * self.largest_u[name] / value for name, value in names.items())


@dataclass(frozen=True, slots=True)
class Coefficient:
    """Predicted standard uncertainty of a coefficient."""

    model: str
    name: str
    unit: str
    standard_uncertainty: float


@dataclass(frozen=True, slots=True)
class Proposal:
    """A campaign with what it will give."""

    label: str
    schedule: Schedule
    results: tuple[Predicted, ...]
    coefficients: tuple[Coefficient, ...]
    range_degc: tuple[float, float]
    """Range of use."""
    recipe: str
    """Text of the recipe by which its logs are fitted."""
    noise: float
    noise_unit: str
    components: tuple[ErrorComponent, ...]
    """Shared errors that were assumed."""
    curve: tuple[Candidate, ...] = ()
    """Campaigns none of which another one beats in both hours and uncertainty."""
    usual: tuple[Candidate, ...] = ()
    """Usual campaigns, for comparison."""
    notes: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    """What a simulation of the campaign needs beside the schedule."""


def find_front(candidates: Iterable[Candidate], name: str) -> list[Candidate]:
    """Campaigns none of which another beats in hours and in the uncertainty of a result, by
    hours.
    """
    front: list[Candidate] = []
    for one in sorted(candidates, key=lambda one: (one.hours, one.largest_u[name])):
        if one.largest_u[name] < (front[-1].largest_u[name] if front else float("inf")):
            front.append(one)
    return front


def choose(
    candidates: Sequence[Candidate], wishes: Sequence[Wish], within_h: float | None, name: str
) -> Candidate:
    """The campaign of the fewest hours that meets the wishes, or of the least uncertainty of a
    result within hours; where none meets them, the one that comes nearest within the hours.
    """
    inside = [one for one in candidates if within_h is None or one.hours <= within_h]
    inside = inside or [min(candidates, key=lambda one: one.hours)]
    meeting = [one for one in inside if one.meets(wishes)]
    if not wishes and within_h is not None:
        return min(inside, key=lambda one: (one.largest_u[name], one.hours))
    if meeting:
        return min(meeting, key=lambda one: (one.hours, one.largest_u[name]))
    targets = {wish.name: wish.value for wish in wishes}
    return min(inside, key=lambda one: one.excess(targets))

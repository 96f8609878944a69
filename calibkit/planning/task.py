"""What a plan is asked for, and what it assumes before anything is measured: noise, errors that
rows share, range of use.

Noise of a mean over t seconds is that of the device over `noise_s` times √(noise_s/t): it is white.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calibkit import units as units_of
from calibkit.arrays import Array
from calibkit.coefficients import Record, StageResult
from calibkit.errors import RecipeError, UsageError
from calibkit.fit.shared import Shared
from calibkit.frame import Log, values
from calibkit.planning.equipment import Device, Equipment
from calibkit.recipe import Recipe
from calibkit.recipe.shared_errors import state_sizes
from calibkit.recipe.tables import ErrorComponent, Errors

ADDED = "added_"
"""Names of logs that are added to a campaign begin with this."""
EARLIER_DOF = 20.0
"""Degrees of freedom of what an earlier run found."""

Units: TypeAlias = "Mapping[tuple[str, str], str]"
"""(group, effect) → unit of its standard deviation in a fit."""


def parse_wishes(texts: Iterable[str], result_units: Mapping[str, str]) -> dict[str, float]:
    """Result → largest expanded uncertainty over the range of use, in the unit in which the result
    is offered, of texts "NAME<=VALUE UNIT"; UsageError for another text, name or unit.
    """
    wishes = {}
    for name, (value, wish_unit) in units_of.parse_limits(texts, "--want").items():
        fault, factor = "" if name in result_units else f"no result '{name}'", 1.0
        if not fault and wish_unit != result_units[name]:
            try:
                factor = units_of.difference_factor(wish_unit, result_units[name])
            except RecipeError:
                fault = f"'{wish_unit}' is no unit of '{name}'"
        if fault:
            names = ", ".join(f"{name} [{unit}]" for name, unit in result_units.items())
            raise UsageError(f"--want: {fault}", hint=f"results: {names}")
        wishes[name] = value * factor
    return wishes


@dataclass(frozen=True, slots=True)
class Task:
    """What a plan is asked for."""

    equipment: Equipment
    wishes: tuple[str, ...] = ()
    within_h: float | None = None
    range_degc: tuple[float, float] | None = None
    attitudes: str = ""
    """Name of a fixture of the equipment; empty for the usual one."""
    earlier: Mapping[str, Record | StageResult] | None = None
    """Coefficient files of an earlier run of this type of device."""
    have: tuple[Log, ...] = ()
    """Logs of what is measured already."""
    withheld: bool = False
    """Whether logs are withheld already."""

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


@dataclass(frozen=True, slots=True)
class Assumed:
    """What a plan assumes of a device."""

    device: Device
    noise: float
    """Of the mean over `device.noise_s`."""
    range_degc: tuple[float, float]
    errors: Mapping[tuple[str, str], ErrorComponent]
    """(group, effect) → its size in the unit of a fit."""
    notes: tuple[str, ...]

    def noise_of(self, length_s: float) -> float:
        """Standard deviation of the mean over a time [s]."""
        return self.noise * float(np.sqrt(self.device.noise_s / length_s))

    def size(self, group: str, effect: str) -> float:
        """Standard deviation of an error in the unit of a fit; 0 where none is assumed."""
        assumed_error = self.errors.get((group, effect))
        return assumed_error.value if assumed_error else 0.0

    @property
    def middle_half(self) -> tuple[float, float]:
        """Middle and half-width [°C] of the range of use, whose width is taken as 1 °C at least."""
        low, high = self.range_degc
        return (low + high) / 2.0, max(high - low, 1.0) / 2.0

    def mapped(self, degc: Array) -> Array:
        """Temperatures [n] [°C] mapped from the range of use to [-1, 1]."""
        middle, half = self.middle_half
        return np.asarray((degc - middle) / half)

    @property
    def stated(self) -> Errors:
        """As a recipe states them; rows need not have all of them, as those that others had."""
        # not checked as a recipe's: a recipe need not be able to state them
        components = tuple(self.errors.values())
        return Errors.model_construct(groups="auto", source="history", component=components)

    def state(self, shared: Iterable[Shared]) -> list[Shared]:
        """Shared errors with the sizes that are assumed."""
        return state_sizes(self.stated, list(shared))


def assume(
    spec: Recipe,
    task: Task,
    device: Device,
    units: Units,
    *,
    default_degc: tuple[float, float] | None = None,
    earlier: Sequence[ErrorComponent] = (),
    noise: float | None = None,
) -> Assumed:
    """Assumptions of a plan: errors of the equipment, over them those of an earlier run, over these
    what the recipe states; so the noise. Without a default the campaign is at the reference
    temperature.

    Raises UsageError for an error that the procedure does not have, and for a range that the
    chamber does not reach, or that is asked of a campaign at one temperature; measured logs may
    have one.
    """
    notes: tuple[str, ...] = ()
    if default_degc is None:
        if task.range_degc and not task.have:
            raise UsageError(
                f"--range: a campaign of {spec.procedure} is at one temperature",
                hint="state reference_temp_degc in the recipe, and no --range",
            )
        low = high = spec.reference_temp_degc
    else:
        low, high = task.range_degc or default_degc
        chamber = task.equipment.chamber
        if not chamber.low_degc <= low < high <= chamber.high_degc:
            raise UsageError(
                f"--range {low:g} {high:g}: the chamber reaches {chamber.low_degc:g} to"
                f" {chamber.high_degc:g} °C",
                hint="state a range within it, the lower end first",
            )
        if not task.range_degc:
            notes = (f"no --range: planned for {low:g} to {high:g} °C",)
    earlier = [error for error in earlier if (error.group, error.effect) in units]
    if task.earlier is not None:
        sizes = [
            f"{error.effect} of the {error.group} {error.value:.2g} {error.unit}"
            for error in earlier
        ]
        sizes += [f"noise {noise:.2g} {device.noise_unit}"] if noise else []
        notes = (f"of that run: {', '.join(sizes) or 'nothing that was seen'}", *notes)
    errors = (*device.component, *earlier, *spec.errors.component)
    by_name = name_errors(errors, units, spec.procedure)
    return Assumed(device, noise or device.noise, (low, high), by_name, notes)


def name_errors(
    errors: Iterable[ErrorComponent], units: Units, procedure: str
) -> dict[tuple[str, str], ErrorComponent]:
    """(group, effect) → its last error, in the unit of a fit; UsageError for an error that the
    procedure does not have.
    """
    by_name = {}
    for error in errors:
        name = error.group, error.effect
        if name not in units:
            raise UsageError(
                f"component '{error.effect}' of group '{error.group}' is no error of {procedure}",
                hint=f"there are {', '.join(f'{effect} of {group}' for group, effect in units)}",
            )
        in_unit = {"value": error.value_in(units[name]), "unit": units[name]}
        by_name[name] = error.model_copy(update=in_unit)
    return by_name


def read_earlier(task: Task, procedure: str, *files: str) -> list[Record | StageResult]:
    """Coefficient files of an earlier run, none without a run; UsageError for a run that has none
    of them.
    """
    if task.earlier is None:
        return []
    records = [task.earlier[file] for file in files if file in task.earlier]
    if not records:
        raise UsageError(f"that run has no {' or '.join(files)}", hint=f"name a run of {procedure}")
    return records


def seen_errors(records: Iterable[Record | StageResult]) -> list[ErrorComponent]:
    """Shared errors of the models of an earlier run where they were seen, the largest of each."""
    components = [
        component for record in records for model in record.models for component in model.components
    ]
    largest = {}
    for component in sorted(components, key=lambda component: component.value):
        if component.value > component.standard_uncertainty:
            largest[component.group, component.effect] = ErrorComponent(
                group=component.group,
                effect=component.effect,
                value=component.value,
                unit=component.unit,
                dof=EARLIER_DOF,
            )
    return [*largest.values()]

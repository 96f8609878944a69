"""What a plan assumes before anything is measured: noise, errors that rows share, range of use."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from calibkit.errors import UsageError
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from calibkit.coefficients import Model
    from calibkit.fit.shared import Shared
    from calibkit.planning.equipment import Device
    from calibkit.planning.proposal import Task
    from calibkit.recipe import Recipe

EARLIER_DOF = 20.0
"""Degrees of freedom of what an earlier run found."""

Units: TypeAlias = "Mapping[tuple[str, str], str]"
"""(group, effect) → unit of its standard deviation in a fit."""


@dataclass(frozen=True, slots=True)
class Assumed:
    """What a plan assumes of a device."""

    device: Device
    noise: float
    """Of the mean over `device.noise_s`."""
    range_degc: tuple[float, float]
    components: tuple[ErrorComponent, ...]
    units: Units
    passed_on: Collection[tuple[str, str]]
    """Errors that the recipe of a campaign states."""
    notes: tuple[str, ...]

    def noise_of(self, length_s: float) -> float:
        """Standard deviation of the mean over a time [s]."""
        return self.noise * float(np.sqrt(self.device.noise_s / length_s))

    def size(self, group: str, effect: str) -> float:
        """Standard deviation of an error in the unit of a fit; 0 where none is assumed."""
        return sum(
            one.value_in(self.units[group, effect])
            for one in self.components
            if (one.group, one.effect) == (group, effect)
        )

    def state(self, shared: Iterable[Shared]) -> list[Shared]:
        """Shared errors with the sizes that are assumed."""
        stated = {(one.group, one.effect): one for one in self.components}
        return [
            replace(error, size=known.value_in(error.unit), size_dof=known.dof, optional=False)
            if (known := stated.get((error.group, error.effect)))
            else error
            for error in shared
        ]


def assume(
    spec: Recipe,
    task: Task,
    device: Device,
    units: Units,
    *,
    default_degc: tuple[float, float] | None = None,
    passed_on: Collection[tuple[str, str]] | None = None,
    earlier: Iterable[ErrorComponent] = (),
    noise: float | None = None,
    notes: tuple[str, ...] = (),
) -> Assumed:
    """Assumptions of a plan: errors of the equipment, over them those of an earlier run, over these
    what the recipe states; the recipe of the campaign states those that `passed_on` names, all
    without it. Without a default the campaign is at the reference temperature.

    Raises UsageError for an error that the procedure does not have, and for a range that the
    chamber does not reach, or that is asked of a campaign at one temperature; measured logs may
    have one.
    """
    if default_degc is None:
        if task.range_degc and not task.have:
            raise UsageError(
                f"--range: a campaign of {spec.procedure} is at one temperature",
                hint="state reference_temp_degc in the recipe, and no --range",
            )
        low = high = spec.reference_temp_degc
    else:
        low, high = task.range_degc or default_degc
        task.equipment.require_reached(low, high)
        if not task.range_degc:
            notes = (*notes, f"no --range: planned for {low:g} to {high:g} °C")
    every = (*device.component, *earlier, *spec.errors.component)
    stated = {(one.group, one.effect): one for one in every}
    for group, effect in stated:
        if (group, effect) not in units:
            raise UsageError(
                f"component '{effect}' of group '{group}' is no error of {spec.procedure}",
                hint=f"there are {', '.join(f'{e} of {g}' for g, e in units)}",
            )
    noise = device.noise if noise is None else noise
    passed_on = units if passed_on is None else passed_on
    return Assumed(device, noise, (low, high), tuple(stated.values()), units, passed_on, notes)


def read_sizes(document: Mapping[str, Any], units: Units) -> dict[tuple[str, str], float]:
    """Standard deviation of each error that a plan may assume, 0 where it assumed none."""
    sizes = dict.fromkeys(units, 0.0)
    for stated in map(ErrorComponent.model_validate, document["components"]):
        sizes[stated.group, stated.effect] = stated.value_in(units[stated.group, stated.effect])
    return sizes


def read_errors(task: Task, file: str, procedure: str) -> list[ErrorComponent]:
    """Shared errors that the models in a file of an earlier run saw, none without a run; UsageError
    for a run of another procedure.
    """
    if task.earlier is None:
        return []
    if file not in task.earlier:
        raise UsageError(f"that run has no {file}", hint=f"name a run of {procedure}")
    return seen_errors(task.earlier[file].models)


def seen_errors(models: Iterable[Model]) -> list[ErrorComponent]:
    """Shared errors of the models of an earlier run where they were seen, the largest of each."""
    listed = [one for model in models for one in model.components]
    seen = {
        (one.group, one.effect): one
        for one in sorted(listed, key=lambda one: one.value)
        if one.value > one.standard_uncertainty
    }
    return [
        ErrorComponent(
            group=one.group, effect=one.effect, value=one.value, unit=one.unit, dof=EARLIER_DOF
        )
        for one in seen.values()
    ]

"""What a plan assumes before anything is measured: noise, errors that rows share, range of use."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from calibkit.errors import UsageError
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.coefficients import Record, StageResult
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
    notes: tuple[str, ...]

    def noise_of(self, length_s: float) -> float:
        """Standard deviation of the mean over a time [s]."""
        return self.noise * float(np.sqrt(self.device.noise_s / length_s))

    def size(self, group: str, effect: str) -> float:
        """Standard deviation of an error in the unit of a fit; 0 where none is assumed."""
        return sum(
            error.value_in(self.units[group, effect])
            for error in self.components
            if (error.group, error.effect) == (group, effect)
        )

    def mapped(self, degc: Array) -> Array:
        """Temperatures [n] [°C] mapped from the range of use to [-1, 1]."""
        low, high = self.range_degc
        return np.asarray((2.0 * degc - low - high) / max(high - low, 1.0))

    def state(self, shared: Iterable[Shared]) -> list[Shared]:
        """Shared errors with the sizes that are assumed."""
        stated = {(error.group, error.effect): error for error in self.components}
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
    earlier: Sequence[ErrorComponent] = (),
    noise: float | None = None,
    notes: tuple[str, ...] = (),
) -> Assumed:
    """Assumptions of a plan: errors of the equipment, over them those of an earlier run, over these
    what the recipe states; so the noise. Without a default the campaign is at the reference
    temperature.

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
    if task.earlier is not None:
        sizes = [
            f"{error.effect} of the {error.group} {error.value:.2g} {error.unit}"
            for error in earlier
        ]
        sizes += [f"noise {noise:.2g} {device.noise_unit}"] if noise else []
        notes = (f"of that run: {', '.join(sizes) or 'nothing that was seen'}", *notes)
    every = (*device.component, *earlier, *spec.errors.component)
    stated = {(error.group, error.effect): error for error in every}
    for group, effect in stated:
        if (group, effect) not in units:
            raise UsageError(
                f"component '{effect}' of group '{group}' is no error of {spec.procedure}",
                hint=f"there are {', '.join(f'{e} of {g}' for g, e in units)}",
            )
    return Assumed(device, noise or device.noise, (low, high), tuple(stated.values()), units, notes)


def read_sizes(document: Mapping[str, Any], units: Units) -> dict[tuple[str, str], float]:
    """Standard deviation of each error that a plan may assume, 0 where it assumed none."""
    sizes = dict.fromkeys(units, 0.0)
    for stated in map(ErrorComponent.model_validate, document["components"]):
        sizes[stated.group, stated.effect] = stated.value_in(units[stated.group, stated.effect])
    return sizes


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
    components = [one for record in records for model in record.models for one in model.components]
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

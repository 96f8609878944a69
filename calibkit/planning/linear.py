"""What plans of linear models share: errors that are assumed, temperatures in their order, results
by the information of a campaign.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import UsageError
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.components import Known
from calibkit.planning.proposal import Candidate, Predicted
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from typing import Any

    from calibkit.arrays import Array
    from calibkit.coefficients import Record, StageResult
    from calibkit.numeric.information import Information
    from calibkit.planning.equipment import Device
    from calibkit.planning.proposal import Task
    from calibkit.recipe import Recipe

EARLIER_DOF = 20.0
"""Degrees of freedom of what an earlier run found."""
LEVELS = 25
"""Temperatures of use at which an uncertainty is predicted."""
USUAL_LEVELS = 9
"""Temperatures of a usual campaign."""
MOST_ADDED = 3
"""Temperatures that are added to what is measured, of which every choice is tried."""


def assume_errors(
    spec: Recipe,
    device: Device,
    earlier: Iterable[ErrorComponent],
    units: Mapping[tuple[str, str], str],
) -> dict[tuple[str, str], ErrorComponent]:
    """Shared errors by (group, effect): those of the equipment, over them those of an earlier run,
    over these what the recipe states; UsageError for one that the procedure does not have.
    """
    every = (*device.component, *earlier, *spec.errors.component)
    stated = {(one.group, one.effect): one for one in every}
    unknown = [name for name in stated if name not in units]
    if unknown:
        group, effect = unknown[0]
        raise UsageError(
            f"component '{effect}' of group '{group}' is no error of {spec.procedure}",
            hint=f"there are {', '.join(f'{e} of {g}' for g, e in units)}",
        )
    return stated


def known_sizes(
    components: Iterable[ErrorComponent], units: Mapping[tuple[str, str], str]
) -> dict[tuple[str, str], Known]:
    """Sizes of shared errors by (group, effect), in the units of a fit."""
    return {
        name: Known(one.value_in(units[name]), one.dof)
        for one in components
        for name in [(one.group, one.effect)]
    }


def read_sizes(
    document: Mapping[str, Any], units: Mapping[tuple[str, str], str]
) -> dict[tuple[str, str], float]:
    """Standard deviation of each error that a plan may assume, 0 where it assumed none."""
    stated = map(ErrorComponent.model_validate, document["components"])
    sizes = {name: known.value for name, known in known_sizes(stated, units).items()}
    return dict.fromkeys(units, 0.0) | sizes


def read_components(
    records: Mapping[str, Record | StageResult], file: str, procedure: str
) -> Iterator[ErrorComponent]:
    """Shared errors of an earlier run where they were seen, the largest of each; UsageError for a
    run of another procedure.
    """
    if file not in records:
        raise UsageError(f"that run has no {file}", hint=f"name a run of {procedure}")
    seen = {
        (one.group, one.effect): one
        for one in sorted(
            (one for model in records[file].models for one in model.components),
            key=lambda one: one.value,
        )
        if one.value > one.standard_uncertainty
    }
    for (group, effect), one in seen.items():
        yield ErrorComponent(
            group=group, effect=effect, value=one.value, unit=one.unit, dof=EARLIER_DOF
        )


def refuse_range(task: Task, procedure: str) -> None:
    """Raise UsageError for a range of use asked of a campaign at one temperature; logs that are
    measured may have one.
    """
    if task.range_degc and not task.have:
        raise UsageError(
            f"--range: a campaign of {procedure} is at one temperature",
            hint="state reference_temp_degc in the recipe, and no --range",
        )


def list_levels(
    task: Task, order: int, more: int, range_degc: tuple[float, float]
) -> Iterator[list[int]]:
    """Temperatures of campaigns of all sizes, lowest first: from one more than an order needs, with
    progress.
    """
    low, high = np.ceil(range_degc[0]), np.floor(range_degc[1])
    sizes = range(order + 2, order + 2 + more + 1)
    labels = [f"{size} temperatures" for size in sizes]
    for size, _ in zip(sizes, task.progress(labels, "searching"), strict=True):
        yield polynomial.space_levels(low, high, size)


def list_usual_levels(range_degc: tuple[float, float]) -> tuple[int, ...]:
    """Temperatures of a usual campaign, from low to high."""
    return tuple(np.rint(np.linspace(*range_degc, USUAL_LEVELS)).astype(int).tolist())


def choose_some(levels: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Every choice of temperatures that may be added to what is measured."""
    for number in range(1, min(len(levels), MOST_ADDED) + 1):
        yield from combinations(levels, number)


def order_there_and_back(levels: Sequence[int]) -> tuple[int, ...]:
    """Temperatures, lowest first, in the order of a campaign: every second one on the way back to
    the first, so that drift is told from temperature on a way that is no longer.
    """
    return (*levels[::2], *levels[1::2][::-1], levels[0])


def raw_uncertainties(
    information: Information, order: int, range_degc: tuple[float, float]
) -> list[float]:
    """Predicted standard uncertainties of the coefficients of a polynomial in powers of °C."""
    to_raw = polynomial.to_raw_powers(*polynomial.middle_and_half(np.array(range_degc)), order)
    zeros = np.zeros(order + 1)
    _, covariance = polynomial.in_raw_powers(zeros, information.covariance, to_raw)
    return [float(u) for u in np.sqrt(np.diag(covariance))]


def find_largest(slopes: Mapping[str, Array], covariance: Array) -> dict[str, float]:
    """Result → largest standard uncertainty of its combinations [m, p] of coefficients."""
    return {
        name: float(np.sqrt(np.einsum("mp,pq,mq->m", rows, covariance, rows).max()))
        for name, rows in slopes.items()
    }


@dataclass(frozen=True, slots=True)
class Results:
    """Results of a campaign as combinations of its coefficients."""

    units: Mapping[str, str]
    """Result → unit."""
    slopes: Mapping[str, Array]
    """Result → derivatives [m, p] over the range of use."""

    def predict(self, information: Information) -> tuple[Predicted, ...]:
        """Predicted uncertainty of each result."""
        return tuple(
            Predicted.of(name, unit, information.variances(self.slopes[name]))
            for name, unit in self.units.items()
        )

    def candidate(
        self,
        label: str,
        hours: float,
        information: Information,
        design: Any,  # noqa: ANN401 (as Candidate's)
    ) -> Candidate | None:
        """A campaign with its uncertainties; None where it does not determine all."""
        if not information.determined:
            return None
        largest = find_largest(self.slopes, information.covariance)
        return Candidate(label, hours, largest, design)

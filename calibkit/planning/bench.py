"""What a plan is asked for, what it assumes, which campaigns there are, and what each will tell.

An instrument states its campaigns and what the rows of each will tell by the equation of its fit: a
`Bench`. What is measured already is the campaign `NOTHING` added. Of every design the variance of
each result is predicted, g Cov gᵀ over the range of use (`search` chooses among them).

Temperatures are those at which a polynomial of order n is determined best, the extremes of the
Chebyshev polynomial T_m, m > n: x_k = cos(π k/m), mapped to the range (`polynomial.space_levels`).
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from calibkit.errors import UsageError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.numeric.arrays import Array
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.equipment import Equipment
from calibkit.planning.schedule import Schedule
from calibkit.recipe.tables import ErrorComponent
from calibkit.records.coefficients import Record, StageResult
from calibkit.records.forms import power_unit
from calibkit.records.frame import Log

COVERAGE = 2.0
"""Coverage factor of U in plans: the sizes of shared errors are assumed, not estimated."""
WITHHELD = "withheld/"
"""Folder of the logs that a fit does not see."""
ADDED = "added_"
"""Names of logs that are added to a campaign begin with this."""
NOISE = "noise"
"""Source of what is not shared."""
LEVELS = 25
"""Temperatures of use at which an uncertainty is predicted."""
ONE_LEVEL_DEGC = 5.0
"""Temperatures nearer than this are one of a campaign."""

Units = Mapping[tuple[str, str], str]
"""(group, effect) → unit of its standard deviation in a fit."""
Sources = dict[str, Array]
"""Source of errors → variance [m] that it leaves in a result over the range of use."""
Tour = tuple[int, ...]
"""Temperatures [°C] in the order in which they are gone to."""


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


@dataclass(frozen=True, slots=True)
class Predicted:
    """Predicted uncertainty of a result."""

    name: str
    unit: str
    u: float
    """Root mean square of the standard uncertainty over the range of use."""
    expanded: float
    """Expanded uncertainty, the largest in the range of use."""
    limits: Mapping[str, float]
    """Source → its share of the mean variance; sums to 1."""


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
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Keys and tables of its recipe with other values."""
    results: Mapping[str, Predicted] = field(default_factory=dict)
    """What it will give, by name; none before that is predicted."""

    @property
    def hours(self) -> float:
        """How long it takes."""
        return self.schedule.hours

    def expanded(self, name: str) -> float:
        """Expanded uncertainty of a result."""
        return self.results[name].expanded


NOTHING = Design("nothing to add to what is measured", Schedule(()), (), None)
"""A campaign that adds nothing to what is measured."""


@dataclass(frozen=True, slots=True)
class PredictedCoefficient:
    """Predicted standard uncertainty of a coefficient."""

    model: str
    name: str
    unit: str
    standard_uncertainty: float


class Bench(ABC):
    """Campaigns of one recipe that go from temperature to temperature and measure the same at each,
    and what they will tell: by `fit` and `slopes`, or by `variances` where a result is not one of
    linear combinations of the parameters of one fit.
    """

    results: Mapping[str, str]
    """Results that are predicted, with their units; the first is the one that is sought."""
    units: Units
    """Of the errors that can be assumed."""
    default_degc: tuple[float, float] | None = None
    """Range of use where none is asked for; None for a campaign at the reference temperature."""
    device_name: str = ""
    """Table of the equipment that states the device, where it is not that of the procedure."""
    noise_unit: str | None = None
    """Unit in which the device has to state its noise; None for any."""
    files: tuple[str, ...] = ()
    """Coefficient files of which an earlier run needs one."""
    order: int = 0
    """Highest power of temperature of what is fitted."""
    reference_degc: float | None = None
    """Temperature that takes the place of the nearest one between the ends of the range."""
    polynomials: Sequence[tuple[str, str, str, int]] = ()
    """Polynomials of temperature, of the first parameters of `fit`, for the temperature mapped from
    the range of use to [-1, 1]: model, letter and unit of the coefficients in powers of °C, and how
    many there are.
    """
    not_stated: Collection[tuple[str, str]] = ()
    """(group, effect) of errors that its recipe cannot state, or its fit does not take from it."""

    def __init__(self, spec: Any, task: Task) -> None:  # noqa: ANN401 (any recipe)
        """Assume errors of the equipment, over them those of an earlier run, over these what the
        recipe states; so the noise.

        UsageError for a run that states none, for an error that the procedure does not have, and
        for a range that the chamber does not reach, or that is asked of a campaign at one
        temperature; measured logs may have one.
        """
        self.spec, self.task = spec, task
        procedure, notes = spec.procedure, list[str]()
        name = self.device_name or procedure
        self.device = device = task.equipment.known_device(name, self.noise_unit)
        errors, noise = [*device.component], device.noise
        if task.earlier is not None:
            records = [task.earlier[file] for file in self.files if file in task.earlier]
            if self.files and not records:
                raise UsageError(
                    f"that run has no {' or '.join(self.files)}",
                    hint=f"name a run of {procedure}",
                )
            earlier, earlier_noise = self.errors_of_run(records)
            earlier = [error for error in earlier if (error.group, error.effect) in self.units]
            sizes = [f"{name_source(error)} {error.value:.2g} {error.unit}" for error in earlier]
            if earlier_noise:
                noise = earlier_noise
                sizes.append(f"noise {noise:.2g} {device.noise_unit}")
            notes.append(f"of that run: {', '.join(sizes) or 'nothing that was seen'}")
            errors += earlier
        if self.default_degc is None:
            if task.range_degc and not task.have:
                raise UsageError(
                    f"--range: a campaign of {procedure} is at one temperature",
                    hint="state reference_temp_degc in the recipe, and no --range",
                )
            self.range_degc = (spec.reference_temp_degc, spec.reference_temp_degc)
        else:
            self.range_degc = task.range_degc or self.default_degc
            (low, high), chamber = self.range_degc, task.equipment.chamber
            if not chamber.low_degc <= low < high <= chamber.high_degc:
                raise UsageError(
                    f"--range {low:g} {high:g}: the chamber reaches {chamber.low_degc:g} to"
                    f" {chamber.high_degc:g} °C",
                    hint="state a range within it, the lower end first",
                )
            if not task.range_degc:
                notes.append(f"no --range: planned for {low:g} to {high:g} °C")
        component = name_errors([*errors, *spec.errors.component], self.units, procedure)
        self.device = device.model_copy(update={"noise": noise, "component": component})
        self.assumptions = tuple(notes)

    @property
    def middle_half(self) -> tuple[float, float]:
        """Middle and half-width [°C] of the range of use, whose width is taken as 1 °C at least."""
        low, high = self.range_degc
        return (low + high) / 2.0, max(high - low, 1.0) / 2.0

    def mapped(self, degc: Array) -> Array:
        """Temperatures [n] [°C] mapped from the range of use to [-1, 1]."""
        middle, half = self.middle_half
        return np.asarray((degc - middle) / half)

    @abstractmethod
    def rows_of_logs(self, logs: Sequence[Log]) -> Any:  # noqa: ANN401 (as of `fit`)
        """Rows of logs that are measured already; FitError for logs that a plan cannot use."""

    @abstractmethod
    def design(self, degc: Tour, choice: Any, dwell_s: float) -> Design:  # noqa: ANN401 (a choice)
        """A campaign: one of `choices` at temperatures in their order, each part for a time [s]."""

    def fit(self, rows: Any) -> Fit:  # noqa: ANN401 (the instrument's own rows)
        """What rows will tell of the parameters; FitError where they do not determine them."""
        raise NotImplementedError

    @cached_property
    def slopes(self) -> Mapping[str, Array]:
        """Result → its derivatives [m, p] over the range of use by the parameters of `fit`."""
        raise NotImplementedError

    def variances(self, rows: Any) -> Mapping[str, Sources]:  # noqa: ANN401 (as of `fit`)
        """Result → what limits it."""
        fit = self.fit(rows)
        return {name: split_variance(fit, slopes) for name, slopes in self.slopes.items()}

    def choices(self) -> Iterable[Any]:
        """What may be measured at each temperature: attitudes, rates, stations, power-ons."""
        return (None,)

    def temperatures(self, rows: Any) -> Iterable[Array]:  # noqa: ANN401 (as of `fit`)
        """Temperatures [°C] of rows, or of several parts of which each has to span the range."""
        return [rows.temperature]

    def notes(self, campaign: Design) -> Iterable[str]:  # noqa: ARG002 (an instrument may use it)
        """What is to be said of a campaign beside the assumptions."""
        return ()

    def errors_of_run(
        self, records: Sequence[Record | StageResult]
    ) -> tuple[list[ErrorComponent], float | None]:
        """Errors of an earlier run that are assumed, by default those of its models that are above
        their standard uncertainty, the largest of each; and its noise over `noise_s` of the device,
        None for that of the equipment.
        """
        models = [model for record in records for model in record.models]
        components = [component for model in models for component in model.components]
        largest = {}
        for component in sorted(components, key=lambda component: component.value):
            if component.value > component.standard_uncertainty:
                error = component.group, component.effect
                largest[error] = earlier_error(*error, component.value, component.unit)
        return [*largest.values()], None

    @cached_property
    def have(self) -> Any:  # noqa: ANN401 (as of `fit`)
        """Rows that are measured already; None without any."""
        return self.rows_of_logs(self.task.have) if self.task.have else None

    def rows(self, design: Design) -> Any:  # noqa: ANN401 (as of `fit`)
        """Rows of what is measured already and of a design."""
        return join([self.have, design.rows])

    def tours(self) -> list[Tour]:
        """Temperatures at which a polynomial is determined best: of one more than the order needs
        first, then of up to four more; beside what is measured, which may have the others, also
        every choice of up to three of those of the first tour. Where both ends of the range are one
        temperature, that is it.
        """
        low, high = self.range_degc
        if low == high:
            return [(round(low),)]
        low, high = np.ceil(low), np.floor(high)
        tours: list[Tour] = []
        for size in range(self.order + 2, self.order + 7):
            levels = polynomial.space_levels(low, high, size)
            if self.reference_degc is not None and low < round(self.reference_degc) < high:
                reference = round(self.reference_degc)
                nearest = min(range(1, size - 1), key=lambda k: abs(levels[k] - reference))
                levels[nearest] = reference
            # every second one on the way back: as long as straight there and back, and drift is
            # separated from temperature
            tours.append((*levels[::2], *levels[1::2][::-1], levels[0]))
        if self.task.have:
            first = tours[0][:-1]
            for number in range(1, min(len(first), 3) + 1):
                tours += combinations(first, number)
        return tours

    def covers(self, rows: Any) -> bool:  # noqa: ANN401 (as of `fit`)
        """Whether rows reach both ends of the range of use, with a temperature more than the order
        needs, or one where the range is one.
        """
        low, high = self.range_degc
        fewest = self.order + 2 if high - low > ONE_LEVEL_DEGC else 1
        for degc in map(np.sort, self.temperatures(rows)):
            reached = (
                degc.size and degc[0] <= low + ONE_LEVEL_DEGC and degc[-1] >= high - ONE_LEVEL_DEGC
            )
            if not reached or 1 + np.sum(np.diff(degc) > ONE_LEVEL_DEGC) < fewest:
                return False
        return True

    def passed_on(self, campaign: Design) -> list[ErrorComponent]:
        """Assumed errors that the recipe of a campaign states: those that its fit will have."""
        groups = self.spec.error_groups
        sources = {source for result in campaign.results.values() for source in result.limits}
        return [
            error
            for error in self.device.component
            if error.group in groups
            and name_source(error) in sources
            and (error.group, error.effect) not in self.not_stated
        ]

    def predict(self, rows: Any) -> dict[str, Predicted]:  # noqa: ANN401 (as of `fit`)
        """What rows will give."""
        results = {}
        for name, parts in self.variances(rows).items():
            total = total_variance(parts)
            mean, expanded = float(total.mean()), COVERAGE * float(np.sqrt(total.max()))
            limits = {source: float(part.mean()) / mean for source, part in parts.items()}
            u = float(np.sqrt(mean))
            results[name] = Predicted(name, self.results[name], u, expanded, limits)
        return results

    def coefficients(self, rows: Any) -> Iterable[PredictedCoefficient]:  # noqa: ANN401 (as of `fit`)
        """Predicted standard uncertainties of the coefficients, by default of `polynomials`."""
        to_raw = polynomial.to_raw_powers(*self.middle_half, self.order).astype(np.float64)
        u = self.fit(rows).of(lambda p: to_raw @ p[: self.order + 1]).u.tolist()
        for model, letter, unit, number in self.polynomials:
            for k, size in enumerate(u[:number]):
                yield PredictedCoefficient(model, f"{letter}{k}", power_unit(unit, "degC", k), size)


def earlier_error(group: str, effect: str, value: float, unit: str) -> ErrorComponent:
    """An error of an earlier run, which is taken to have found it with 20 degrees of freedom."""
    return ErrorComponent(group=group, effect=effect, value=value, unit=unit, dof=20.0)


def name_errors(
    errors: Iterable[ErrorComponent], units: Units, procedure: str
) -> tuple[ErrorComponent, ...]:
    """The last error of each (group, effect), in the unit of a fit; UsageError for an error that
    the procedure does not have.
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
    return tuple(by_name.values())


def join(parts: Iterable[Any]) -> Any:  # noqa: ANN401 (rows of an instrument)
    """Rows, arrays by name, one after the other; numbers of logs and runs go on from those before.
    Parts that are None are none, and None is what there is without any.
    """
    present_parts: list[Any] = [part for part in parts if part is not None] or [None]
    first = present_parts[0]
    for other in present_parts[1:]:
        arrays = {}
        for name in (part.name for part in fields(first)):
            a, b = getattr(first, name), getattr(other, name)
            if name in ("log", "run"):
                b = b + a.max(initial=-1) + 1
            arrays[name] = np.concatenate([a, b]) if isinstance(b, np.ndarray) else a + b
        first = replace(first, **arrays)
    return first


def split_variance(fit: Fit, slopes: Array, priors: Sequence[str] = ()) -> Sources:
    """Variance [m] that noise, named priors and each shared error of a predicted fit leave in
    combinations [m, p] of its parameters.
    """
    shared = [name_source(size.error) for size in fit.shared]
    by_size = np.sum((slopes @ fit.slopes) * slopes, axis=2)
    return dict(zip([NOISE, *priors, *shared], fit.variances[:, None] * by_size, strict=True))


def draw_errors(
    shared: Sequence[Shared], rng: np.random.Generator
) -> tuple[Array, dict[str, list[list[float]]]]:
    """Sum [n] of shared errors in the residuals of n simulated rows, each drawn by its size, and
    the errors [levels, k] of each by name.
    """
    total, drawn = np.zeros(len(shared[0].level) if shared else 0), {}
    for error in shared:
        b = rng.normal(0.0, error.size or 0.0, (error.levels, error.width))
        total += error.along(b)
        drawn[name_source(error)] = b.tolist()
    return total, drawn


def name_source(error: Shared | ErrorComponent) -> str:
    """A shared error in words."""
    return f"{error.effect} of the {error.group}"


def total_variance(sources: Sources) -> Array:
    """Variance [m] of all sources together."""
    return np.asarray(np.sum([*sources.values()], axis=0))


def count(number: int, noun: str) -> str:
    """A number of things in words."""
    return f"{number} {noun}{'' if number == 1 else 's'}"

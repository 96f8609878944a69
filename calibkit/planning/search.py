"""The search for a campaign, the same for all procedures.

An instrument states the campaigns among which is chosen, and what the rows of each will tell: a
`Bench`. What is measured already is the campaign `NOTHING` added.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.forms import power_unit
from calibkit.numeric.least_squares import polynomial
from calibkit.planning.levels import Tour, cover_range, list_tours
from calibkit.planning.schedule import Schedule
from calibkit.planning.task import Assumed, Task, parse_wishes
from calibkit.recipe.tables import ErrorComponent

COVERAGE = 2.0
"""Coverage factor of U in plans: the sizes of shared errors are assumed, not estimated."""
LONGER = 4.0 / 3.0
"""Hours of the longer campaign that is offered beside a plan, relative to the plan's."""
WORTH = 0.99
"""Uncertainty, relative to that of the plan, below which more hours buy something."""
WITHHELD = "withheld/"
"""Folder of the logs that a fit does not see."""
NUMBERED = ("log", "run")
"""Fields of rows that count from 0 in each of several parts."""
NOISE = "noise"
"""Source of what is not shared."""

Sources = dict[str, "Array"]
"""Source of errors → variance [m] that it leaves in a result over the range of use."""


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

    def excess(self, wishes: Mapping[str, float]) -> float:
        """Largest U relative to what is wished: at most 1 where every wish is met."""
        return max((self.expanded(name) / value for name, value in wishes.items()), default=0.0)


NOTHING = Design("nothing to add to what is measured", Schedule(()), (), None)
"""A campaign that adds nothing to what is measured."""


@dataclass(frozen=True, slots=True)
class PredictedCoefficient:
    """Predicted standard uncertainty of a coefficient."""

    model: str
    name: str
    unit: str
    standard_uncertainty: float


@dataclass(frozen=True, slots=True)
class Proposal:
    """The campaign that is chosen, beside others."""

    campaign: Design
    wishes: Mapping[str, float]
    """Result → wished expanded uncertainty in its unit."""
    assumed: Assumed
    coefficients: tuple[PredictedCoefficient, ...]
    curve: tuple[Design, ...]
    """Campaigns none of which another one beats in both hours and uncertainty."""
    notes: tuple[str, ...]

    @property
    def results(self) -> tuple[Predicted, ...]:
        """What the campaign will give."""
        return tuple(self.campaign.results.values())

    @property
    def longer_campaign(self) -> Design | None:
        """The best campaign of a third more hours, and of a plan of none the best that is as short
        as any; None where they buy nothing.
        """
        sought = self.sought
        shortest = min(
            (campaign.hours for campaign in self.curve if campaign.hours > 0.0), default=0.0
        )
        hours = self.campaign.hours * LONGER or shortest
        better = [
            campaign
            for campaign in self.curve
            if campaign.hours <= hours and campaign.expanded(sought.name) < WORTH * sought.expanded
        ]
        return min(better, key=lambda campaign: campaign.expanded(sought.name), default=None)

    @property
    def sought(self) -> Predicted:
        """The result that is wished first, or the first of all."""
        return self.campaign.results[next(iter(self.wishes or self.campaign.results))]


@dataclass(frozen=True)
class Bench(ABC):
    """Campaigns of one recipe, and what they will tell: by `fit` and `slopes`, or by `variances`
    where a result is not one of linear combinations of the parameters of one fit.
    """

    spec: Any
    """The recipe."""
    task: Task
    assumed: Assumed
    results: Mapping[str, str]
    """Results that are predicted, with their units; the first is the one that is sought."""
    have: Any
    """Rows that are measured already; None without any."""

    @abstractmethod
    def designs(self) -> Iterable[Design]:
        """Campaigns among which is chosen."""

    @abstractmethod
    def coefficients(self, design: Design) -> Iterable[PredictedCoefficient]:
        """Predicted standard uncertainties of the coefficients."""

    def fit(self, rows: Any) -> Fit:  # noqa: ANN401 (the instrument's own rows)
        """What rows will tell of the parameters; FitError where they do not determine them."""
        raise NotImplementedError

    @cached_property
    def slopes(self) -> Mapping[str, Array]:
        """Result → its derivatives [m, p] over the range of use by the parameters of `fit`."""
        raise NotImplementedError

    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Result → what limits it, of a design and what is measured already."""
        fit = self.fit(self.rows(design))
        return {name: split_variance(fit, slopes) for name, slopes in self.slopes.items()}

    def covers(self, design: Design) -> bool:  # noqa: ARG002 (an instrument may state it)
        """Whether the rows reach all of the range, with one more than the coefficients need."""
        return True

    def rows(self, design: Design) -> Any:  # noqa: ANN401 (the instrument's own rows)
        """Rows of what is measured already and of a design."""
        return join([self.have, design.rows])

    def passed_on(self, campaign: Design) -> list[ErrorComponent]:
        """Assumed errors that the recipe of a campaign states: those that its fit will have."""
        groups = self.spec.error_groups
        sources = {source for result in campaign.results.values() for source in result.limits}
        return [
            error
            for error in self.assumed.errors.values()
            if error.group in groups and name_source(error) in sources
        ]

    def notes(self, campaign: Design) -> Iterable[str]:  # noqa: ARG002 (as `covers`)
        """What is to be said of a campaign beside the assumptions."""
        return ()

    def predict(self, design: Design) -> Design:
        """A design with its uncertainties."""
        results = {}
        for name, parts in self.variances(design).items():
            total = total_variance(parts)
            mean = float(total.mean())
            limits = {source: float(part.mean()) / mean for source, part in parts.items()}
            u, largest_u = float(np.sqrt(mean)), float(np.sqrt(total.max()))
            results[name] = Predicted(name, self.results[name], u, largest_u, limits)
        return replace(design, results=results)


@dataclass(frozen=True)
class TourBench(Bench):
    """Campaigns that go from temperature to temperature, and measure the same at each."""

    order: int
    """Highest power of temperature of what is fitted."""

    @abstractmethod
    def choices(self) -> Iterable[Any]:
        """What may be measured at each temperature: attitudes, rates, stations, power-ons."""

    @abstractmethod
    def design(self, degc: Tour, choice: Any, dwell_s: float) -> Design:  # noqa: ANN401 (a choice)
        """A campaign: one of `choices` at temperatures in their order, each part for a time [s]."""

    def temperatures(self, rows: Any) -> Iterable[Array]:  # noqa: ANN401 (as of `rows`)
        """Temperatures [°C] of rows, or of several parts of which each has to span the range."""
        return [rows.temperature]

    def tours(self) -> list[Tour]:
        """Temperatures of campaigns, beside what is measured also of those that it lacks."""
        return list_tours(self.order, self.assumed.range_degc, subsets=bool(self.task.have))

    def designs(self) -> Iterable[Design]:
        """Every choice at the temperatures of every tour, for every time."""
        tours, lengths = self.tours(), self.assumed.device.dwell_s
        for choice, degc, dwell_s in product(self.choices(), tours, lengths):
            yield self.design(degc, choice, dwell_s)

    def covers(self, design: Design) -> bool:
        """Whether both ends of the range are reached, with a temperature more than the order
        needs.
        """
        span, parts = self.assumed.range_degc, self.temperatures(self.rows(design))
        return all(cover_range(degc, self.order + 2, span) for degc in parts)

    def powers_of_degc(
        self, model: str, letter: str, unit: str, fit: Fit, count: int
    ) -> Iterator[PredictedCoefficient]:
        """First coefficients of a polynomial in powers of °C, by the fit of all of them, the first
        of its parameters, for the temperature mapped from the range of use to [-1, 1].
        """
        to_raw = polynomial.to_raw_powers(*self.assumed.middle_half, self.order).astype(np.float64)
        u = fit.of(lambda p: to_raw @ p[: self.order + 1]).u
        for k, size in enumerate(u[:count].tolist()):
            yield PredictedCoefficient(model, f"{letter}{k}", power_unit(unit, "degC", k), size)


def propose(bench: Bench) -> Proposal:
    """Cheapest campaign that meets the wishes, or the best within hours; the wishes may be not
    met.
    """
    task, assumed = bench.task, bench.assumed
    wishes = parse_wishes(task.wishes, bench.results)
    name = next(iter(wishes or bench.results))
    designs = [*([NOTHING] if task.have else []), *bench.designs()]
    candidates = []
    for design in designs:
        # a design that does not determine all over the range is none
        with suppress(FitError):
            if bench.covers(design):
                candidates.append(bench.predict(design))
    if not candidates:
        raise FitError(
            "no campaign determines all over the range",
            hint="plan without --have, for a narrower --range, for another fixture (--attitudes),"
            " or lower the orders of the recipe",
        )
    best = choose(candidates, wishes, task.within_h, name)
    errors = [error.model_dump(mode="json") for error in bench.passed_on(best)]
    if errors:
        best = replace(best, changes={"errors": {"component": errors}, **best.changes})
    return Proposal(
        best,
        wishes,
        assumed,
        tuple(bench.coefficients(best)),
        tuple(find_front(candidates, name)),
        (*bench.notes(best), *assumed.notes),
    )


def judge(bench: Bench) -> tuple[Predicted, ...]:
    """What the logs that are measured tell; empty where they do not determine all."""
    try:
        return tuple(bench.predict(NOTHING).results.values()) if bench.task.have else ()
    except FitError:
        return ()


def find_front(candidates: Iterable[Design], name: str) -> list[Design]:
    """Campaigns none of which another beats in hours and in the uncertainty of a result, by
    hours.
    """
    front: list[Design] = []
    for campaign in sorted(
        candidates, key=lambda campaign: (campaign.hours, campaign.expanded(name))
    ):
        if not front or campaign.expanded(name) < front[-1].expanded(name):
            front.append(campaign)
    return front


def choose(
    candidates: Sequence[Design], wishes: Mapping[str, float], within_h: float | None, name: str
) -> Design:
    """The campaign of the fewest hours that meets the wishes, or of the least uncertainty of a
    result within hours; where none meets them, the one that comes nearest within the hours.
    """
    inside = [campaign for campaign in candidates if within_h is None or campaign.hours <= within_h]
    inside = inside or [min(candidates, key=lambda campaign: campaign.hours)]
    if not wishes and within_h is not None:
        return min(inside, key=lambda campaign: (campaign.expanded(name), campaign.hours))
    meeting = [campaign for campaign in inside if campaign.excess(wishes) <= 1.0]
    if meeting:
        return min(meeting, key=lambda campaign: (campaign.hours, campaign.expanded(name)))
    return min(inside, key=lambda campaign: campaign.excess(wishes))


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
            if name in NUMBERED:
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


def name_source(error: Shared | ErrorComponent) -> str:
    """A shared error in words."""
    return f"{error.effect} of the {error.group}"


def total_variance(sources: Sources) -> Array:
    """Variance [m] of all sources together."""
    return np.asarray(np.sum([*sources.values()], axis=0))


def count(number: int, noun: str) -> str:
    """A number of things in words."""
    return f"{number} {noun}{'' if number == 1 else 's'}"

"""The search for a campaign, the same for all procedures.

An instrument states its campaigns and what the rows of each will tell by the equation of its fit: a
`Bench`. What is measured already is the campaign `NOTHING` added. Of every design the variance of
each result is predicted, g Cov gᵀ over the range of use, and the cheapest that meets the wishes is
chosen.

Temperatures are those at which a polynomial of order n is determined best, the extremes of the
Chebyshev polynomial T_m, m > n: x_k = cos(π k/m), mapped to the range (`polynomial.space_levels`).
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.forms import power_unit
from calibkit.numeric.least_squares import polynomial
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
LEVELS = 25
"""Temperatures of use at which an uncertainty is predicted."""
MORE_LEVELS = 4
"""Temperatures of a campaign at most beyond one more than the order needs."""
MOST_ADDED = 3
"""Temperatures that are added to what is measured, of which every choice is tried."""
ONE_LEVEL_DEGC = 5.0
"""Temperatures nearer than this are one of a campaign."""

Sources = dict[str, "Array"]
"""Source of errors → variance [m] that it leaves in a result over the range of use."""
Tour = tuple[int, ...]
"""Temperatures [°C] in the order in which they are gone to."""


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
    sought: Predicted
    """The result that is wished first, or the first of all."""
    assumed: Assumed
    coefficients: tuple[PredictedCoefficient, ...]
    curve: tuple[Design, ...]
    """Campaigns none of which another one beats in both hours and uncertainty."""
    longer: Design | None
    """The best campaign of a third more hours, and of a plan of none the best that is as short as
    any; None where they buy nothing.
    """
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Bench(ABC):
    """Campaigns of one recipe that go from temperature to temperature and measure the same at each,
    and what they will tell: by `fit` and `slopes`, or by `variances` where a result is not one of
    linear combinations of the parameters of one fit.
    """

    spec: Any
    """The recipe."""
    task: Task
    assumed: Assumed
    results: Mapping[str, str]
    """Results that are predicted, with their units; the first is the one that is sought."""
    have: Any
    """Rows that are measured already; None without any."""
    order: int = 0
    """Highest power of temperature of what is fitted."""
    reference_degc: float | None = None
    """Temperature that takes the place of the nearest one between the ends of the range."""

    @abstractmethod
    def design(self, degc: Tour, choice: Any, dwell_s: float) -> Design:  # noqa: ANN401 (a choice)
        """A campaign: one of `choices` at temperatures in their order, each part for a time [s]."""

    @abstractmethod
    def coefficients(self, rows: Any) -> Iterable[PredictedCoefficient]:  # noqa: ANN401 (its own)
        """Predicted standard uncertainties of the coefficients."""

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

    def tours(self) -> list[Tour]:
        """Temperatures at which a polynomial is determined best: of one more than the order needs
        first, then of more; beside what is measured, which may have the others, also every choice
        of those of the first tour. Where both ends of the range are one temperature, that is it.
        """
        if self.assumed.range_degc[0] == self.assumed.range_degc[1]:
            return [(round(self.assumed.range_degc[0]),)]
        low, high = np.ceil(self.assumed.range_degc[0]), np.floor(self.assumed.range_degc[1])
        tours: list[Tour] = []
        for size in range(self.order + 2, self.order + 3 + MORE_LEVELS):
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
            for number in range(1, min(len(first), MOST_ADDED) + 1):
                tours += combinations(first, number)
        return tours

    def designs(self) -> Iterable[Design]:
        """Every choice at the temperatures of every tour, for every time."""
        tours, lengths = self.tours(), self.assumed.device.dwell_s
        for choice, degc, dwell_s in product(self.choices(), tours, lengths):
            yield self.design(degc, choice, dwell_s)

    def rows(self, design: Design) -> Any:  # noqa: ANN401 (as of `fit`)
        """Rows of what is measured already and of a design."""
        return join([self.have, design.rows])

    def temperatures(self, rows: Any) -> Iterable[Array]:  # noqa: ANN401 (as of `fit`)
        """Temperatures [°C] of rows, or of several parts of which each has to span the range."""
        return [rows.temperature]

    def covers(self, rows: Any) -> bool:  # noqa: ANN401 (as of `fit`)
        """Whether rows reach both ends of the range of use, with a temperature more than the order
        needs, or one where the range is one.
        """
        low, high = self.assumed.range_degc
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
            for error in self.assumed.errors.values()
            if error.group in groups and name_source(error) in sources
        ]

    def notes(self, campaign: Design) -> Iterable[str]:  # noqa: ARG002 (an instrument may use it)
        """What is to be said of a campaign beside the assumptions."""
        return ()

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
    task, wishes = bench.task, parse_wishes(bench.task.wishes, bench.results)
    name = next(iter(wishes or bench.results))
    candidates = []
    for design in (*([NOTHING] if task.have else []), *bench.designs()):
        # a design that does not determine all over the range is none
        with suppress(FitError):
            rows = bench.rows(design)
            if bench.covers(rows):
                candidates.append(replace(design, results=bench.predict(rows)))
    if not candidates:
        raise FitError(
            "no campaign determines all over the range",
            hint="plan without --have, for a narrower --range, for another fixture (--attitudes),"
            " or lower the orders of the recipe",
        )
    best, curve = choose(candidates, wishes, task.within_h, name), find_front(candidates, name)
    errors = [error.model_dump(mode="json") for error in bench.passed_on(best)]
    if errors:
        best = replace(best, changes={"errors": {"component": errors}, **best.changes})
    shortest = min((campaign.hours for campaign in curve if campaign.hours > 0.0), default=0.0)
    longer = [campaign for campaign in curve if campaign.hours <= (best.hours * LONGER or shortest)]
    better = [
        campaign for campaign in longer if campaign.expanded(name) < WORTH * best.expanded(name)
    ]
    return Proposal(
        best,
        wishes,
        best.results[name],
        bench.assumed,
        tuple(bench.coefficients(bench.rows(best))),
        tuple(curve),
        min(better, key=lambda campaign: campaign.expanded(name), default=None),
        (*bench.notes(best), *bench.assumed.notes),
    )


def judge(bench: Bench) -> tuple[Predicted, ...]:
    """What the logs that are measured tell; empty where they do not determine all."""
    try:
        return tuple(bench.predict(bench.have).values()) if bench.task.have else ()
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

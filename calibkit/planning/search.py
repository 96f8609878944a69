"""The search for a campaign, the same for all procedures.

An instrument states the campaigns among which is chosen, and what the rows of each will tell: a
`Bench`. What is measured already is the campaign `NOTHING` added.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import FitError
from calibkit.planning.proposal import (
    NOTHING,
    Candidate,
    Coefficient,
    Design,
    Predicted,
    Wish,
)
from calibkit.planning.recipe_text import write_recipe

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.fit.solve import Fit
    from calibkit.planning.assumptions import Assumed
    from calibkit.planning.proposal import Task
    from calibkit.planning.schedule import Schedule
    from calibkit.recipe.tables import ErrorComponent

NOISE = "noise"
"""Source of what is not shared."""

Sources = dict[str, "Array"]
"""Source of errors → variance [m] that it leaves in a result over the range of use."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """The campaign that is chosen, beside others."""

    campaign: Candidate
    wishes: tuple[Wish, ...]
    """In the units of the results."""
    assumed: Assumed
    coefficients: tuple[Coefficient, ...]
    recipe: str
    """Text of the recipe by which its logs are fitted."""
    curve: tuple[Candidate, ...]
    """Campaigns none of which another one beats in both hours and uncertainty."""
    usual: tuple[Candidate, ...]
    """Usual campaigns, for comparison."""
    notes: tuple[str, ...]

    @property
    def schedule(self) -> Schedule:
        """Actions of the campaign."""
        return self.campaign.design.schedule

    @property
    def results(self) -> tuple[Predicted, ...]:
        """What the campaign will give."""
        return tuple(self.campaign.results.values())

    @property
    def sought(self) -> Predicted:
        """The result that is wished first, or the first of all."""
        name = self.wishes[0].name if self.wishes else self.results[0].name
        return self.campaign.results[name]

    def wanted(self, name: str) -> float | None:
        """Wished expanded uncertainty of a result, None where none is."""
        return {wish.name: wish.value for wish in self.wishes}.get(name)


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
    def sizes(self) -> Mapping[str, Iterable[Design]]:
        """Size of campaigns in words → campaigns of this size."""

    @abstractmethod
    def coefficients(self, design: Design) -> Iterable[Coefficient]:
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

    def usual(self) -> Iterable[Design]:
        """Usual campaigns, for comparison."""
        return ()

    def covers(self, design: Design) -> bool:  # noqa: ARG002 (an instrument may state it)
        """Whether the rows reach all of the range, with one more than the coefficients need."""
        return True

    def rows(self, design: Design) -> Any:  # noqa: ANN401 (the instrument's own rows)
        """Rows of what is measured already and of a design."""
        return join(*(rows for rows in (self.have, design.rows) if rows is not None))

    def passed_on(self, design: Design) -> list[ErrorComponent]:  # noqa: ARG002 (as `covers`)
        """Assumed errors that the recipe of a campaign states."""
        groups = self.spec.error_groups
        return [error for error in self.assumed.components if error.group in groups]

    def notes(self, campaign: Candidate) -> Iterable[str]:  # noqa: ARG002 (as `covers`)
        """What is to be said of a campaign beside the assumptions."""
        return ()

    def smaller(self, design: Design) -> Design | None:  # noqa: ARG002 (as `covers`)
        """A design with a little less, where wishes may be met with it."""
        return None

    def candidate(self, design: Design) -> Candidate | None:
        """A design with its uncertainties; None where it does not determine all over the range."""
        try:
            return self.predict(design) if self.covers(design) else None
        except FitError:
            return None

    def predict(self, design: Design) -> Candidate:
        """A design with its uncertainties."""
        results = {}
        for name, parts in self.variances(design).items():
            total = whole(parts)
            mean = float(total.mean())
            limits = {source: float(part.mean()) / mean for source, part in parts.items()}
            u, largest_u = float(np.sqrt(mean)), float(np.sqrt(total.max()))
            results[name] = Predicted(name, self.results[name], u, largest_u, limits)
        return Candidate(design, results)


def propose(bench: Bench) -> Proposal:
    """Cheapest campaign that meets the wishes, or the best within hours; the wishes may be not
    met.
    """
    task, assumed = bench.task, bench.assumed
    wishes = tuple(Wish.parse(text, bench.results) for text in task.wishes)
    name = wishes[0].name if wishes else next(iter(bench.results))
    candidates = list(_list_candidates(bench))
    if not candidates:
        raise FitError(
            f"no campaign with {task.remountings} remountings determines all over the range",
            hint="plan without --have, for a narrower --range, for more --remountings, or lower the"
            " orders of the recipe",
        )
    best = choose(candidates, wishes, task.within_h, name)
    while wishes and best.meets(wishes) and (design := bench.smaller(best.design)):
        tried = bench.candidate(design)
        if tried is None or not tried.meets(wishes):
            break
        best = tried
    usual = () if task.have else map(bench.candidate, bench.usual())
    return Proposal(
        best,
        wishes,
        assumed,
        tuple(bench.coefficients(best.design)),
        write_recipe(bench.spec, best.design, bench.passed_on(best.design), added=bool(task.have)),
        tuple(find_front(candidates, name)),
        tuple(campaign for campaign in usual if campaign),
        (*bench.notes(best), *assumed.notes),
    )


def _list_candidates(bench: Bench) -> Iterator[Candidate]:
    """Campaigns that determine all over the range: none but what is measured, then all sizes, with
    progress.
    """
    if bench.task.have and (measured := bench.candidate(NOTHING)):
        yield measured
    sizes = bench.sizes()
    for size in bench.task.progress([*sizes], "searching"):
        for design in sizes[size]:
            if campaign := bench.candidate(design):
                yield campaign


def judge(bench: Bench) -> tuple[Predicted, ...]:
    """What the logs that are measured tell; empty where they do not determine all."""
    try:
        return tuple(bench.predict(NOTHING).results.values()) if bench.task.have else ()
    except FitError:
        return ()


def find_front(candidates: Iterable[Candidate], name: str) -> list[Candidate]:
    """Campaigns none of which another beats in hours and in the uncertainty of a result, by
    hours.
    """
    front: list[Candidate] = []
    for campaign in sorted(
        candidates, key=lambda campaign: (campaign.hours, campaign.expanded(name))
    ):
        if not front or campaign.expanded(name) < front[-1].expanded(name):
            front.append(campaign)
    return front


def choose(
    candidates: Sequence[Candidate], wishes: Sequence[Wish], within_h: float | None, name: str
) -> Candidate:
    """The campaign of the fewest hours that meets the wishes, or of the least uncertainty of a
    result within hours; where none meets them, the one that comes nearest within the hours.
    """
    inside = [campaign for campaign in candidates if within_h is None or campaign.hours <= within_h]
    inside = inside or [min(candidates, key=lambda campaign: campaign.hours)]
    if not wishes and within_h is not None:
        return min(inside, key=lambda campaign: (campaign.expanded(name), campaign.hours))
    meeting = [campaign for campaign in inside if campaign.meets(wishes)]
    if meeting:
        return min(meeting, key=lambda campaign: (campaign.hours, campaign.expanded(name)))
    return min(inside, key=lambda campaign: campaign.excess(wishes))


def join(*parts: Any) -> Any:  # noqa: ANN401 (rows of an instrument)
    """Rows, arrays by name, one after the other; numbers of levels go on from those before."""
    first, *others = parts
    for other in others:
        arrays = {}
        for name in (field.name for field in fields(first)):
            a, b = getattr(first, name), getattr(other, name)
            if isinstance(b, np.ndarray) and np.issubdtype(b.dtype, np.integer):
                b = b + a.max(initial=-1) + 1
            arrays[name] = np.concatenate([a, b]) if isinstance(b, np.ndarray) else a + b
        first = replace(first, **arrays)
    return first


def split_variance(fit: Fit, slopes: Array, priors: Sequence[str] = ()) -> Sources:
    """Variance [m] that noise, named priors and each shared error of a predicted fit leave in
    combinations [m, p] of its parameters.
    """
    shared = [f"{size.error.effect} of the {size.error.group}" for size in fit.shared]
    by_size = np.sum((slopes @ fit.slopes) * slopes, axis=2)
    return dict(zip([NOISE, *priors, *shared], fit.variances[:, None] * by_size, strict=True))


def whole(sources: Sources) -> Array:
    """Variance [m] of all sources together."""
    return np.asarray(np.sum([*sources.values()], axis=0))

"""The search for a campaign, the same for all procedures.

An instrument states the campaigns among which is chosen, and what the rows of each will tell: a
`Bench`. What is measured already is the campaign `NOTHING` added.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import FitError
from calibkit.planning import recipe_text
from calibkit.planning.proposal import (
    Candidate,
    Coefficient,
    Design,
    Predicted,
    Proposal,
    Wish,
    choose,
    find_front,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from calibkit.arrays import Array
    from calibkit.fit.solve import Fit
    from calibkit.planning.assumptions import Assumed
    from calibkit.planning.proposal import Task

NOISE = "noise"
"""Source of what is not shared."""

Sources = dict[str, "Array"]
"""Source of errors → variance [m] that it leaves in a result over the range of use."""


@dataclass(frozen=True)
class Bench(ABC):
    """Campaigns of one recipe, and what they will tell."""

    spec: Any
    """The recipe."""
    task: Task
    assumed: Assumed
    results: Mapping[str, str]
    """Results that are predicted, with their units; the first is the one that is sought."""
    have: Any
    """Rows that are measured already; None without any."""

    @abstractmethod
    def designs(self) -> Iterator[Design]:
        """Campaigns of all sizes; beside what is measured, also `NOTHING`."""

    def usual(self) -> Iterator[Design]:
        """Usual campaigns, for comparison."""
        return iter(())

    def covers(self, design: Design) -> bool:  # noqa: ARG002 (an instrument may state it)
        """Whether the rows reach all of the range, with one more than the coefficients need."""
        return True

    def rows(self, design: Design) -> Any:  # noqa: ANN401 (the instrument's own rows)
        """Rows of what is measured already and of a design."""
        both = [rows for rows in (self.have, design.rows) if rows is not None]
        return join(*both)

    @abstractmethod
    def variances(self, design: Design) -> Mapping[str, Sources]:
        """Result → what limits it, of a design and what is measured already; FitError where they do
        not determine it.
        """

    @abstractmethod
    def coefficients(self, design: Design) -> Iterator[Coefficient]:
        """Predicted standard uncertainties of the coefficients."""

    def notes(self, design: Design) -> Iterable[str]:  # noqa: ARG002 (as `covers`)
        """What is to be said of a campaign."""
        return self.assumed.notes

    def smaller(self, design: Design) -> Design | None:  # noqa: ARG002 (as `covers`)
        """A design with a little less, where wishes may be met with it."""
        return None

    def candidate(self, design: Design) -> Candidate | None:
        """A design with its uncertainties; None where it does not determine all over the range."""
        try:
            if not self.covers(design):
                return None
            by_result = self.variances(design)
        except FitError:
            return None
        largest = {name: float(np.sqrt(whole(parts).max())) for name, parts in by_result.items()}
        return Candidate(design, largest)

    def predict(self, design: Design) -> tuple[Predicted, ...]:
        """Predicted uncertainty of each result."""
        by_result = self.variances(design)
        return tuple(
            Predicted.of(name, unit, by_result[name]) for name, unit in self.results.items()
        )


def propose(bench: Bench) -> tuple[Proposal, tuple[Wish, ...]]:
    """Cheapest campaign that meets the wishes, or the best within hours; the wishes in the units of
    the results, which may be not met.
    """
    task, assumed = bench.task, bench.assumed
    wishes = tuple(Wish.parse(text, bench.results) for text in task.wishes)
    name = wishes[0].name if wishes else next(iter(bench.results))
    candidates = [one for design in bench.designs() if (one := bench.candidate(design))]
    if not candidates:
        raise FitError(
            f"no campaign with {task.remountings} remountings determines all over the range",
            hint="plan without --have, for a narrower --range, for more --remountings, or lower the"
            " orders of the recipe",
        )
    best = choose(candidates, wishes, task.within_h, name)
    if wishes and best.meets(wishes):
        while smaller := bench.smaller(best.design):
            tried = bench.candidate(smaller)
            if tried is None or not tried.meets(wishes):
                break
            best = tried
    design = best.design
    usual = (one for other in bench.usual() if (one := bench.candidate(other)))
    proposal = Proposal(
        design.label,
        design.schedule,
        bench.predict(design),
        tuple(bench.coefficients(design)),
        assumed.range_degc,
        recipe_text.write_recipe(
            bench.spec,
            design.logs,
            [one for one in assumed.components if (one.group, one.effect) in assumed.passed_on],
            design.changes,
            added=bool(task.have),
        ),
        assumed.noise,
        assumed.device.noise_unit,
        assumed.components,
        tuple(find_front(candidates, name)),
        () if task.have else tuple(usual),
        tuple(bench.notes(design)),
        design.settings,
    )
    return proposal, wishes


def judge(bench: Bench) -> tuple[Predicted, ...]:
    """What the logs that are measured tell; empty where they do not determine all."""
    try:
        return bench.predict(Design.nothing()) if bench.task.have else ()
    except FitError:
        return ()


def join(*parts: Any) -> Any:  # noqa: ANN401 (rows of an instrument)
    """Rows, arrays by name, one after the other; numbers of levels go on from those before."""
    first, *others = parts
    for other in others:
        arrays = {}
        for name in (field.name for field in fields(first)):
            a, b = getattr(first, name), getattr(other, name)
            if np.issubdtype(b.dtype, np.integer):
                b = b + a.max(initial=-1) + 1
            arrays[name] = np.concatenate([a, b])
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

"""The search for a campaign, the same for all procedures: every choice at the temperatures of every
tour, for every time. The cheapest that meets the wishes is chosen, or the best within hours.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

from calibkit import units
from calibkit.errors import FitError, RecipeError, UsageError
from calibkit.planning.bench import (
    NOTHING,
    Bench,
    Design,
    Predicted,
    PredictedCoefficient,
)


@dataclass(frozen=True, slots=True)
class Proposal:
    """The campaign that is chosen, beside others."""

    bench: Bench
    campaign: Design
    wishes: Mapping[str, float]
    """Result → wished expanded uncertainty in its unit."""
    sought: Predicted
    """The result that is wished first, or the first of all."""
    coefficients: tuple[PredictedCoefficient, ...]
    curve: tuple[Design, ...]
    """Campaigns none of which another one beats in both hours and uncertainty."""
    longer: Design | None
    """The best campaign of a third more hours, and of a plan of none the best that is as short as
    any; None where they buy nothing.
    """
    notes: tuple[str, ...]


def propose(bench: Bench) -> Proposal:
    """Cheapest campaign that meets the wishes, or the best within hours; the wishes may be not
    met.
    """
    task, wishes = bench.task, parse_wishes(bench.task.wishes, bench.results)
    name = next(iter(wishes or bench.results))
    candidates, designs = [], [NOTHING] if bench.have is not None else []
    for choice, degc, dwell_s in product(bench.choices(), bench.tours(), bench.device.dwell_s):
        designs.append(bench.design(degc, choice, dwell_s))
    for design in designs:
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
    # of a third more hours, by at least a hundredth
    longer = [
        campaign
        for campaign in curve
        if campaign.hours <= (best.hours * 4.0 / 3.0 or shortest)
        and campaign.expanded(name) < 0.99 * best.expanded(name)
    ]
    return Proposal(
        bench,
        best,
        wishes,
        best.results[name],
        tuple(bench.coefficients(bench.rows(best))),
        tuple(curve),
        min(longer, key=lambda campaign: campaign.expanded(name), default=None),
        (*bench.notes(best), *bench.assumptions),
    )


def parse_wishes(texts: Iterable[str], result_units: Mapping[str, str]) -> dict[str, float]:
    """Result → largest expanded uncertainty over the range of use, in the unit in which the result
    is offered, of texts "NAME<=VALUE UNIT"; UsageError for another text, name or unit.
    """
    wishes = {}
    for name, (value, wish_unit) in units.parse_limits(texts, "--want").items():
        fault, factor = "" if name in result_units else f"no result '{name}'", 1.0
        if not fault and wish_unit != result_units[name]:
            try:
                factor = units.difference_factor(wish_unit, result_units[name])
            except RecipeError:
                fault = f"'{wish_unit}' is no unit of '{name}'"
        if fault:
            names = ", ".join(f"{name} [{unit}]" for name, unit in result_units.items())
            raise UsageError(f"--want: {fault}", hint=f"results: {names}")
        wishes[name] = value * factor
    return wishes


def judge(bench: Bench) -> tuple[Predicted, ...]:
    """What the logs that are measured tell; empty where they do not determine all."""
    try:
        return () if bench.have is None else tuple(bench.predict(bench.have).values())
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

    def excess(campaign: Design) -> float:
        # the largest U relative to what is wished: at most 1 where every wish is met
        return max((campaign.expanded(wish) / u for wish, u in wishes.items()), default=0.0)

    inside = [campaign for campaign in candidates if within_h is None or campaign.hours <= within_h]
    inside = inside or [min(candidates, key=lambda campaign: campaign.hours)]
    if not wishes and within_h is not None:
        return min(inside, key=lambda campaign: (campaign.expanded(name), campaign.hours))
    meeting = [campaign for campaign in inside if excess(campaign) <= 1.0]
    if meeting:
        return min(meeting, key=lambda campaign: (campaign.hours, campaign.expanded(name)))
    return min(inside, key=excess)

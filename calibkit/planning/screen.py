"""The first screen of a plan: hours, U, what limits it, what a third more hours would buy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit.coefficients import at_most
from calibkit.planning.document import third_more
from calibkit.planning.proposal import COVERAGE, Predicted, Proposal, Wish
from calibkit.report.overview import Overview, concise
from calibkit.report.summary import Summary
from calibkit.report.table import Column, Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.coefficients import Criterion

_NAMED = 3
"""Sources of uncertainty that the screen names."""


def summarize(
    proposal: Proposal, wishes: Sequence[Wish], title: str, within_h: float | None
) -> Summary:
    """What is printed of a plan; its verdict is that on the wishes and on the hours."""
    results = {one.name: one for one in proposal.results}
    criteria = tuple(
        at_most(f"U of {wish.name}", results[wish.name].expanded, wish.value, wish.unit)
        for wish in wishes
    )
    if within_h is not None:
        criteria += (at_most("chamber time", proposal.schedule.hours, within_h, "h"),)
    first = results[wishes[0].name] if wishes else proposal.results[0]
    schedule = proposal.schedule
    person = f", {_last(schedule.operator_h)} with a person" if schedule.operator_h else ""
    largest = sorted(first.limits.items(), key=lambda item: -item[1])[:_NAMED]
    limits = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in largest)
    return Summary(
        f"Plan: {title}",
        (_tabulate(proposal, wishes),),
        proposal.notes,
        criteria,
        conclusion=_conclude(criteria, schedule.hours),
        overview=Overview(
            f"{_last(schedule.hours)} of the chamber{person}: {proposal.label}.",
            (
                f"What limits {first.name}: {limits} of the variance.",
                _describe_more(proposal, first),
            ),
        ),
    )


def _last(hours: float) -> str:
    """A length of time in hours, below one in minutes."""
    return f"{60.0 * hours:.0f} min" if 0.0 < hours < 1.0 else f"{hours:.1f} h"


def _conclude(criteria: Sequence[Criterion], hours: float) -> str:
    """Whether the wishes are met, and by what."""
    failed = [one for one in criteria if not one.passed]
    head = "cannot be met" if failed else "met" if criteria else "planned"
    reached = [
        f"{one.name} {concise(one.value)} {one.unit}, wanted at most {concise(one.limit)}"
        for one in failed or criteria
    ]
    return f"{head}: {'; '.join(reached) or _last(hours)}"


def _describe_more(proposal: Proposal, first: Predicted) -> str:
    """What a third more hours would buy."""
    more = third_more(proposal, first.name)
    what = "A third more hours" if proposal.schedule.actions else "A small addition"
    if more is None:
        return f"{what} would buy nothing."
    bought = COVERAGE * more.largest_u[first.name]
    return (
        f"{what} would buy U {concise(bought)} {first.unit} in {_last(more.hours)}: {more.label}."
    )


def _tabulate(proposal: Proposal, wishes: Sequence[Wish]) -> Table:
    """Predicted uncertainty of each result beside the wanted one."""
    numbers = (Column(head, ".3g") for head in ("u, rms", "U, largest", "wanted U"))
    columns: tuple[Column | str, ...] = ("result", *numbers, "unit")
    wanted = {wish.name: wish.value for wish in wishes}
    rows = tuple(
        (one.name, one.u, one.expanded, wanted.get(one.name), one.unit) for one in proposal.results
    )
    return Table("Predicted uncertainty over the range of use (k = 2)", columns, rows)

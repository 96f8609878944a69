"""The first screen of a plan: hours, U, what limits it, what a third more hours would buy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit.coefficients import at_most
from calibkit.planning.document import third_more
from calibkit.report.overview import Overview, concise
from calibkit.report.summary import Summary
from calibkit.report.table import Column, Table

if TYPE_CHECKING:
    from calibkit.planning.search import Proposal

_NAMED = 3
"""Sources of uncertainty that the screen names."""


def summarize(proposal: Proposal, title: str, within_h: float | None) -> Summary:
    """What is printed of a plan; its verdict is that on the wishes and on the hours."""
    schedule, sought, more = proposal.schedule, proposal.sought, third_more(proposal)
    criteria = tuple(
        at_most(f"U of {wish.name}", proposal.campaign.expanded(wish.name), wish.value, wish.unit)
        for wish in proposal.wishes
    )
    if within_h is not None:
        criteria += (at_most("chamber time", schedule.hours, within_h, "h"),)
    failed = [one for one in criteria if not one.passed]
    head = "cannot be met" if failed else "met" if criteria else "planned"
    reached = [
        f"{one.name} {concise(one.value)} {one.unit}, wanted at most {concise(one.limit)}"
        for one in failed or criteria
    ]
    person = f", {_last(schedule.operator_h)} with a person" if schedule.operator_h else ""
    largest = sorted(sought.limits.items(), key=lambda item: -item[1])[:_NAMED]
    limits = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in largest)
    bought = "nothing"
    if more is not None:
        u, hours = concise(more.expanded(sought.name)), _last(more.hours)
        bought = f"U {u} {sought.unit} in {hours}: {more.design.label}"
    what = "A third more hours" if schedule.actions else "A small addition"
    numbers = [Column(head, ".3g") for head in ("u, rms", "U, largest", "wanted U")]
    results = Table(
        "Predicted uncertainty over the range of use (k = 2)",
        ("result", *numbers, "unit"),
        tuple(
            (one.name, one.u, one.expanded, proposal.wanted(one.name), one.unit)
            for one in proposal.results
        ),
    )
    return Summary(
        f"Plan: {title}",
        (results,),
        proposal.notes,
        criteria,
        conclusion=f"{head}: {'; '.join(reached) or _last(schedule.hours)}",
        overview=Overview(
            f"{_last(schedule.hours)} of the chamber{person}: {proposal.campaign.design.label}.",
            (
                f"What limits {sought.name}: {limits} of the variance.",
                f"{what} would buy {bought}.",
            ),
        ),
    )


def _last(hours: float) -> str:
    """A length of time in hours, below one in minutes."""
    return f"{60.0 * hours:.0f} min" if 0.0 < hours < 1.0 else f"{hours:.1f} h"

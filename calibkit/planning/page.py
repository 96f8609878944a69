"""plan.html: the campaign over time, its attitudes or rates, uncertainty against hours, predicted
and wanted uncertainty.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR, SECONDS_PER_MINUTE
from calibkit.planning.search import WITHHELD, name_source
from calibkit.report import figures, html, svg
from calibkit.report.html_tables import summary_table
from calibkit.report.markup import Markup, element, join_markup
from calibkit.report.table import Column, Table, tabulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from calibkit.planning.schedule import Schedule
    from calibkit.planning.search import Candidate, Proposal
    from calibkit.report.summary import Summary

SHOWN = 2.0
"""Hours that are drawn, relative to those of the plan, beyond which little is gained."""
RECORDED = "#cc3311"
"""Colour of what a log records."""


def make_page(summary: Summary, proposal: Proposal) -> bytes:
    """The page as UTF-8; it loads nothing."""
    drawn = [_draw_time(proposal.schedule)] if proposal.schedule.actions else []
    drawn += _draw_attitudes(proposal.schedule)
    drawn.append(_draw_hours(proposal))
    figures.settle(drawn)
    drawings, _ = svg.inline(drawn)
    shown = [
        element("figure", Markup(drawing), element("figcaption", figure.get_suptitle()))
        for drawing, figure in zip(drawings, drawn, strict=True)
    ]
    kind = summary.verdict if summary.criteria else "open"
    top = [
        element("header", element("h1", summary.title)),
        element("p", element("strong", summary.last_line), class_=f"band {kind}"),
    ]
    notes = [element("li", note) for note in proposal.notes]
    tables = _make_tables(proposal)
    parts = {
        "Predicted uncertainty": [summary_table(summary.tables[0]), tables["limits"]],
        "The campaign": shown[:-1],
        "Uncertainty against hours": [shown[-1], tables["campaigns"]],
        "Coefficients": [tables["coefficients"]],
        "Assumptions": [tables["errors"], element("ul", join_markup(notes))],
    }
    sections = [
        element("section", element("h2", head), join_markup(made)) for head, made in parts.items()
    ]
    return html.whole_page(
        summary.title, [*top, element("main", join_markup(sections), id="content")]
    )


def _draw_time(schedule: Schedule) -> Figure:
    """Set point over time, and what logs record of it."""
    figure, (ax,) = figures.page(1, 1, title="Set point of the chamber over time", height=3.6)
    hours, degc = list[float](), list[float]()
    for action in schedule.actions:
        ramp = action.ramp_degc_per_min if action.action == "ramp" else 0.0
        climbed = ramp * action.duration_s / SECONDS_PER_MINUTE
        hours += [action.start_s / SECONDS_PER_HOUR, action.end_s / SECONDS_PER_HOUR]
        degc += [action.set_degc - climbed, action.set_degc]
        if action.log:
            ax.plot(hours[-2:], degc[-2:], color=RECORDED, linewidth=4.0)
    ax.plot(hours, degc, color="#4477aa", linewidth=1.2)
    ax.set_xlabel("time [h] (thick: recorded)")
    ax.set_ylabel("set point [°C]")
    return figure


def _draw_attitudes(schedule: Schedule) -> list[Figure]:
    """Inclination over toolface, or over azimuth where it matters; nothing without attitudes."""
    dwells = schedule.recorded("dwell")
    if not dwells:
        return []
    figure, (ax,) = figures.page(
        1, 1, title="Attitudes (filled: fitted, open: withheld)", height=4.2
    )
    azimuths = np.isfinite(dwells[0].azimuth_deg)
    for one in dwells:
        inside = "none" if one.log.startswith(WITHHELD) else RECORDED
        turn = one.azimuth_deg if azimuths else one.toolface_deg
        ax.plot([turn], [one.inclination_deg], "o", color=RECORDED, markerfacecolor=inside)
    ax.set_xlabel("azimuth [°]" if azimuths else "toolface [°]")
    ax.set_ylabel("inclination [°]")
    return [figure]


def _draw_hours(proposal: Proposal) -> Figure:
    """U against hours: campaigns of the search, this plan, what is wanted."""
    name, unit = proposal.sought.name, proposal.sought.unit
    figure, (ax,) = figures.page(
        1, 1, title=f"U (k = 2, largest in the range) of {name} against hours", height=4.2
    )

    def draw(campaigns: Sequence[Candidate], style: str, colour: str, label: str) -> None:
        hours = [campaign.hours for campaign in campaigns]
        ax.plot(
            hours,
            [campaign.expanded(name) for campaign in campaigns],
            style,
            color=colour,
            label=label,
        )

    draw(proposal.curve, "-", "#4477aa", "best campaigns of the search")
    draw([proposal.campaign], "o", "#cc3311", "this plan")
    if (wanted := proposal.wanted(name)) is not None:
        ax.axhline(wanted, color="#777777", linestyle="--", label="wanted")
    if proposal.schedule.hours > 0.0:
        ax.set_xlim(right=SHOWN * proposal.schedule.hours)
    ax.set_xlabel("chamber time [h]")
    ax.set_ylabel(f"U [{unit}]")
    ax.legend(loc="upper right")
    return figure


def _make_tables(proposal: Proposal) -> dict[str, Markup]:
    """Tables of the page, by what they show."""
    sources = dict.fromkeys(source for result in proposal.results for source in result.limits)
    shares: list[tuple[str | float, ...]] = [
        (source, *(100.0 * result.limits.get(source, 0.0) for result in proposal.results))
        for source in sources
    ]
    sought, assumed = proposal.sought, proposal.assumed
    best = [(one.design.label, one.hours, one.expanded(sought.name)) for one in proposal.curve]
    errors: list[tuple[str | float | None, ...]]
    errors = [("noise", assumed.noise, assumed.device.noise_unit, None)]
    errors += [(name_source(one), one.value, one.unit, one.dof) for one in assumed.components]
    by_result = [Column(result.name, ".1f") for result in proposal.results]
    U, u = Column(f"U [{sought.unit}]", ".3g"), Column("u", ".3g", key="standard_uncertainty")
    size, dof = Column("standard deviation", ".3g"), Column("degrees of freedom", "g", missing="")
    names = "model", Column("coefficient", key="name"), u, "unit"
    tables = {
        "limits": Table("Shares of the mean variance [%]", ("source", *by_result), tuple(shares)),
        "campaigns": Table(
            "Campaigns that no other one beats in both hours and U",
            ("campaign", Column("h", ".1f"), U),
            tuple(best),
        ),
        "coefficients": tabulate("Predicted standard uncertainties", names, proposal.coefficients),
        "errors": Table("Assumed errors", ("error", size, "unit", dof), tuple(errors)),
    }
    return {name: summary_table(table) for name, table in tables.items()}

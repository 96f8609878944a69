"""What people see of a plan: the first screen, with what limits the uncertainty and what a third
more hours would buy, and plan.html, with the campaign over time, its attitudes, and uncertainty
against hours.
"""

import numpy as np
from matplotlib.figure import Figure

from calibkit.coefficients import at_most
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.planning.schedule import Schedule
from calibkit.planning.search import WITHHELD, Proposal, name_source
from calibkit.report import figures, html, svg
from calibkit.report.html_tables import summary_table
from calibkit.report.markup import Markup, element, join_markup
from calibkit.report.overview import Overview, concise
from calibkit.report.summary import Summary
from calibkit.report.table import Column, Table, tabulate

NAMED = 3
"""Sources of uncertainty that the screen names."""
SHOWN = 2.0
"""Hours that are drawn, relative to those of the plan, beyond which little is gained."""
RECORDED = "#cc3311"
"""Colour of what a log records."""


def summarize(proposal: Proposal, title: str, within_h: float | None) -> Summary:
    """What is printed of a plan; its verdict is that on the wishes and on the hours."""
    schedule, sought, longer = proposal.campaign.schedule, proposal.sought, proposal.longer_campaign
    criteria = tuple(
        at_most(f"U of {result.name}", result.expanded, proposal.wishes[result.name], result.unit)
        for result in map(proposal.campaign.results.__getitem__, proposal.wishes)
    )
    if within_h is not None:
        criteria += (at_most("chamber time", schedule.hours, within_h, "h"),)
    failed = [criterion for criterion in criteria if not criterion.passed]
    head = "cannot be met" if failed else "met" if criteria else "planned"
    reached = [
        f"{criterion.name} {concise(criterion.value)} {criterion.unit},"
        f" wanted at most {concise(criterion.limit)}"
        for criterion in failed or criteria
    ]
    person = f", {_duration(schedule.operator_h)} with a person" if schedule.operator_h else ""
    largest = sorted(sought.limits.items(), key=lambda item: -item[1])[:NAMED]
    limits = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in largest)
    bought = "nothing"
    if longer is not None:
        u, hours = concise(longer.expanded(sought.name)), _duration(longer.hours)
        bought = f"U {u} {sought.unit} in {hours}: {longer.label}"
    addition = "A third more hours" if schedule.actions else "A small addition"
    numbers = [Column(name, ".3g") for name in ("u, rms", "U, largest", "wanted U")]
    results = Table(
        "Predicted uncertainty over the range of use (k = 2)",
        ("result", *numbers, "unit"),
        tuple(
            (result.name, result.u, result.expanded, proposal.wishes.get(result.name), result.unit)
            for result in proposal.results
        ),
    )
    return Summary(
        f"Plan: {title}",
        (results,),
        proposal.notes,
        criteria,
        conclusion=f"{head}: {'; '.join(reached) or _duration(schedule.hours)}",
        overview=Overview(
            f"{_duration(schedule.hours)} of the chamber{person}: {proposal.campaign.label}.",
            (
                f"What limits {sought.name}: {limits} of the variance.",
                f"{addition} would buy {bought}.",
            ),
        ),
    )


def _duration(hours: float) -> str:
    """A length of time in hours, below one in minutes."""
    return f"{60.0 * hours:.0f} min" if 0.0 < hours < 1.0 else f"{hours:.1f} h"


def make_page(summary: Summary, proposal: Proposal) -> bytes:
    """The page as UTF-8; it loads nothing."""
    schedule, sought, assumed = proposal.campaign.schedule, proposal.sought, proposal.assumed
    drawn = [_draw_time(schedule)] if schedule.actions else []
    if schedule.recorded("dwell"):
        drawn.append(_draw_attitudes(schedule))
    drawn.append(_draw_hours(proposal))
    figures.settle(drawn)
    drawings, _ = svg.inline(drawn)
    figure_elements = [
        element("figure", Markup(drawing), element("figcaption", figure.get_suptitle()))
        for drawing, figure in zip(drawings, drawn, strict=True)
    ]
    kind = summary.verdict if summary.criteria else "open"
    top = [
        element("header", element("h1", summary.title)),
        element("p", element("strong", summary.last_line), class_=f"band {kind}"),
    ]
    sources = dict.fromkeys(source for result in proposal.results for source in result.limits)
    shares = Table(
        "Shares of the mean variance [%]",
        ("source", *(Column(result.name, ".1f") for result in proposal.results)),
        tuple(
            (source, *(100.0 * result.limits.get(source, 0.0) for result in proposal.results))
            for source in sources
        ),
    )
    campaigns = Table(
        "Campaigns that no other one beats in both hours and U",
        ("campaign", Column("h", ".1f"), Column(f"U [{sought.unit}]", ".3g")),
        tuple(
            (campaign.label, campaign.hours, campaign.expanded(sought.name))
            for campaign in proposal.curve
        ),
    )
    coefficients = tabulate(
        "Predicted standard uncertainties",
        (
            "model",
            Column("coefficient", key="name"),
            Column("u", ".3g", key="standard_uncertainty"),
            "unit",
        ),
        proposal.coefficients,
    )
    size, dof = Column("standard deviation", ".3g"), Column("degrees of freedom", "g", missing="")
    errors = Table(
        "Assumed errors",
        ("error", size, "unit", dof),
        (
            ("noise", assumed.noise, assumed.device.noise_unit, None),
            *((name_source(e), e.value, e.unit, e.dof) for e in assumed.errors.values()),
        ),
    )
    notes = element("ul", join_markup([element("li", note) for note in proposal.notes]))
    parts = {
        "Predicted uncertainty": [summary_table(summary.tables[0]), summary_table(shares)],
        "The campaign": figure_elements[:-1],
        "Uncertainty against hours": [figure_elements[-1], summary_table(campaigns)],
        "Coefficients": [summary_table(coefficients)],
        "Assumptions": [summary_table(errors), notes],
    }
    sections = [
        element("section", element("h2", head), join_markup(content))
        for head, content in parts.items()
    ]
    return html.whole_page(
        summary.title, [*top, element("main", join_markup(sections), id="content")]
    )


def _draw_time(schedule: Schedule) -> Figure:
    """Set point over time, and what logs record of it."""
    figure, (ax,) = figures.page(1, 1, title="Set point of the chamber over time", height=3.6)
    hours, degc = list[float](), list[float]()
    for action in schedule.actions:
        hours += [action.start_s / SECONDS_PER_HOUR, action.end_s / SECONDS_PER_HOUR]
        degc += [action.start_degc, action.set_degc]
        if action.log:
            ax.plot(hours[-2:], degc[-2:], color=RECORDED, linewidth=4.0)
    ax.plot(hours, degc, color="#4477aa", linewidth=1.2)
    ax.set_xlabel("time [h] (thick: recorded)")
    ax.set_ylabel("set point [°C]")
    return figure


def _draw_attitudes(schedule: Schedule) -> Figure:
    """Inclination over toolface, or over azimuth where it matters."""
    figure, (ax,) = figures.page(
        1, 1, title="Attitudes (filled: fitted, open: withheld)", height=4.2
    )
    dwells = schedule.recorded("dwell")
    azimuths = np.isfinite(dwells[0].azimuth_deg)
    for dwell in dwells:
        inside = "none" if dwell.log.startswith(WITHHELD) else RECORDED
        turn = dwell.azimuth_deg if azimuths else dwell.toolface_deg
        ax.plot([turn], [dwell.inclination_deg], "o", color=RECORDED, markerfacecolor=inside)
    ax.set_xlabel("azimuth [°]" if azimuths else "toolface [°]")
    ax.set_ylabel("inclination [°]")
    return figure


def _draw_hours(proposal: Proposal) -> Figure:
    """U against hours: campaigns of the search, this plan, what is wanted."""
    name, unit = proposal.sought.name, proposal.sought.unit
    figure, (ax,) = figures.page(
        1, 1, title=f"U (k = 2, largest in the range) of {name} against hours", height=4.2
    )
    for campaigns, style, colour, label in (
        (proposal.curve, "-", "#4477aa", "best campaigns of the search"),
        ((proposal.campaign,), "o", "#cc3311", "this plan"),
    ):
        hours = [campaign.hours for campaign in campaigns]
        expanded = [campaign.expanded(name) for campaign in campaigns]
        ax.plot(hours, expanded, style, color=colour, label=label)
    if name in proposal.wishes:
        ax.axhline(proposal.wishes[name], color="#777777", linestyle="--", label="wanted")
    if proposal.campaign.hours > 0.0:
        ax.set_xlim(right=SHOWN * proposal.campaign.hours)
    ax.set_xlabel("chamber time [h]")
    ax.set_ylabel(f"U [{unit}]")
    ax.legend(loc="upper right")
    return figure

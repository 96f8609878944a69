"""plan.html: the campaign over time, its attitudes or rates, uncertainty against hours, predicted
and wanted uncertainty.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric import attitude
from calibkit.report import figures, html, svg
from calibkit.report.html_tables import summary_table
from calibkit.report.markup import Markup, element, join_markup
from calibkit.report.table import Column, Table, tabulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.planning.proposal import Candidate
    from calibkit.planning.schedule import Schedule
    from calibkit.planning.search import Proposal
    from calibkit.report.summary import Summary

SHOWN = 2.0
"""Hours that are drawn, relative to those of the plan, beyond which little is gained."""
_COLOURS = {"dwell": "#cc3311", "rate": "#cc3311", "ramp": "#4477aa", "soak": "#999933"}


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
    parts = {
        "Predicted uncertainty": [summary_table(summary.tables[0]), _limits(proposal)],
        "The campaign": shown[:-1],
        "Uncertainty against hours": [shown[-1], _campaigns(proposal)],
        "Coefficients": [_coefficients(proposal)],
        "Assumptions": [_assumptions(proposal), element("ul", join_markup(notes))],
    }
    sections = [
        element("section", element("h2", head), join_markup(made)) for head, made in parts.items()
    ]
    return html.whole_page(
        summary.title, [*top, element("main", join_markup(sections), id="content")]
    )


def _draw_time(schedule: Schedule) -> Figure:
    """Set point over time, with the actions."""
    figure, (ax,) = figures.page(1, 1, title="Set point of the chamber over time", height=3.6)
    named: set[str] = set()
    for action in schedule.actions:
        begin, end = action.start_s / 3600.0, action.end_s / 3600.0
        climbed = (
            action.ramp_degc_per_min * action.duration_s / 60.0 if action.action == "ramp" else 0.0
        )
        colour = _COLOURS.get(action.action, "#777777")
        label = "_" if action.action in named else str(action.action)
        named.add(action.action)
        width = 3.0 if action.action in ("dwell", "rate") else 1.2
        degc = [action.set_degc - climbed, action.set_degc]
        ax.plot([begin, end], degc, color=colour, linewidth=width, label=label)
    ax.set_xlabel("time [h]")
    ax.set_ylabel("set point [°C]")
    ax.legend(loc="upper right")
    return figure


def _draw_attitudes(schedule: Schedule) -> list[Figure]:
    """Directions of gravity in the tool on both halves of a sphere; nothing without attitudes."""
    dwells = schedule.recorded("dwell")
    if not dwells:
        return []
    figure, axes = figures.page(
        1, 2, title="Direction of gravity in the tool (filled: fitted, open: withheld)", height=4.6
    )
    spots = sorted({(action.inclination_deg, action.toolface_deg, action.log) for action in dwells})
    for ax, side, name in zip(axes, (1.0, -1.0), ("along +z", "along −z"), strict=True):
        _draw_half(ax, side, spots, dwells[0].log)
        ax.set_title(f"half of the sphere {name}", loc="left")
    return [figure]


def _draw_half(
    ax: Axes, side: float, spots: Sequence[tuple[float, float, str]], fitted: str
) -> None:
    """One half of the sphere, seen along its axis."""
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    for tilt in (30.0, 60.0, 90.0):
        size = np.sin(np.radians(tilt))
        ax.plot(size * np.cos(turn), size * np.sin(turn), color="#bbbbbb", linewidth=0.6)
    for tilt, roll, log in spots:
        x, y, z = attitude.gravity_vector(np.array([tilt]), np.array([roll]))[0].tolist()
        if side * z >= -1e-9:
            inside = "#cc3311" if log == fitted else "none"
            ax.plot([x], [y], "o", color="#cc3311", markerfacecolor=inside, markersize=7)
    ax.set_aspect("equal")
    ax.set_xlabel("x [g]")
    ax.set_ylabel("y [g]")


def _draw_hours(proposal: Proposal) -> Figure:
    """U against hours: campaigns of the search, the usual ones, this plan, what is wanted."""
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
    if proposal.usual:
        draw(proposal.usual, "s", "#999933", "usual campaigns")
    for campaign in proposal.usual:
        ax.annotate(
            campaign.design.label.split(",")[0],
            (campaign.hours, campaign.expanded(name)),
            fontsize=7,
        )
    draw([proposal.campaign], "o", "#cc3311", "this plan")
    if (wanted := proposal.wanted(name)) is not None:
        ax.axhline(wanted, color="#777777", linestyle="--", label="wanted")
    shown = max(
        SHOWN * proposal.schedule.hours, *(campaign.hours for campaign in proposal.usual), 0.0
    )
    if shown > 0.0:
        ax.set_xlim(right=1.1 * shown)
    ax.set_xlabel("chamber time [h]")
    ax.set_ylabel(f"U [{unit}]")
    ax.legend(loc="upper right")
    return figure


def _limits(proposal: Proposal) -> Markup:
    """What the uncertainty of each result consists of."""
    sources = dict.fromkeys(source for result in proposal.results for source in result.limits)
    columns = [Column(result.name, ".1f") for result in proposal.results]
    rows: list[tuple[str | float, ...]] = []
    for source in sources:
        shares = [100.0 * result.limits.get(source, 0.0) for result in proposal.results]
        rows.append((source, *shares))
    return summary_table(
        Table("Shares of the mean variance [%]", ("source", *columns), tuple(rows))
    )


def _campaigns(proposal: Proposal) -> Markup:
    """Campaigns of the search and usual ones."""
    sought = proposal.sought
    columns = "campaign", Column("h", ".1f"), Column(f"U [{sought.unit}]", ".3g")
    rows = tuple(
        (campaign.design.label, campaign.hours, campaign.expanded(sought.name))
        for campaign in (*proposal.usual, *proposal.curve)
    )
    return summary_table(Table("Usual campaigns, then those of the search", columns, rows))


def _coefficients(proposal: Proposal) -> Markup:
    """Predicted standard uncertainty of each coefficient."""
    u = Column("u", ".3g", key="standard_uncertainty")
    columns = "model", Column("coefficient", key="name"), u, "unit"
    return summary_table(
        tabulate("Predicted standard uncertainties", columns, proposal.coefficients)
    )


def _assumptions(proposal: Proposal) -> Markup:
    """Noise and shared errors that were assumed."""
    assumed = proposal.assumed
    size, dof = Column("standard deviation", ".3g"), Column("degrees of freedom", "g", missing="")
    rows: list[tuple[str | float | None, ...]]
    rows = [("noise", assumed.noise, assumed.device.noise_unit, None)]
    rows += [
        (f"{error.effect} of the {error.group}", error.value, error.unit, error.dof)
        for error in assumed.components
    ]
    return summary_table(Table("Assumed errors", ("error", size, "unit", dof), tuple(rows)))

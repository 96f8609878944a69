"""plan.html: the campaign over time, its attitudes or rates, uncertainty against hours, predicted
and wanted uncertainty.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric import attitude
from calibkit.planning.proposal import COVERAGE, Candidate, Proposal, Wish
from calibkit.report import figures, html, html_tables, svg
from calibkit.report.markup import Markup, element, join_markup
from calibkit.report.overview import concise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.planning.schedule import Schedule
    from calibkit.report.summary import Summary

SHOWN = 2.0
"""Hours that are drawn, relative to those of the plan, beyond which little is gained."""
_COLOURS = {"dwell": "#cc3311", "rate": "#cc3311", "ramp": "#4477aa", "soak": "#999933"}


def make_page(summary: Summary, proposal: Proposal, wishes: Sequence[Wish]) -> bytes:
    """The page as UTF-8; it loads nothing."""
    drawn = [_draw_time(proposal.schedule)] if proposal.schedule.actions else []
    drawn += _draw_attitudes(proposal.schedule)
    name = wishes[0].name if wishes else proposal.results[0].name
    drawn.append(_draw_hours(proposal, wishes, name))
    figures.settle(drawn)
    captions = [one.get_suptitle() for one in drawn]
    drawings, _ = svg.inline(drawn)
    shown = [
        element("figure", Markup(drawing), element("figcaption", caption))
        for drawing, caption in zip(drawings, captions, strict=True)
    ]
    kind = summary.verdict if summary.criteria else "open"
    top = [
        element("header", element("h1", summary.title)),
        element("p", element("strong", summary.last_line), class_=f"band {kind}"),
    ]
    parts = {
        "Predicted uncertainty": [_results(proposal, wishes), _limits(proposal)],
        "The campaign": shown[:-1],
        "Uncertainty against hours": [shown[-1], _campaigns(proposal, name)],
        "Coefficients": [_coefficients(proposal)],
        "Assumptions": [_assumptions(proposal)],
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
    for one in schedule.actions:
        begin, end = one.start_s / 3600.0, one.end_s / 3600.0
        climbed = one.ramp_degc_per_min * one.duration_s / 60.0 if one.action == "ramp" else 0.0
        colour = _COLOURS.get(one.action, "#777777")
        label = "_" if one.action in named else str(one.action)
        named.add(one.action)
        width = 3.0 if one.action in ("dwell", "rate") else 1.2
        degc = [one.set_degc - climbed, one.set_degc]
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
    spots = sorted({(one.inclination_deg, one.toolface_deg, one.log) for one in dwells})
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


def _draw_hours(proposal: Proposal, wishes: Sequence[Wish], name: str) -> Figure:
    """U against hours: campaigns of the search, the usual ones, this plan, what is wanted."""
    figure, (ax,) = figures.page(
        1, 1, title=f"U (k = 2, largest in the range) of {name} against hours", height=4.2
    )
    unit = next(one.unit for one in proposal.results if one.name == name)

    def spread(found: Sequence[Candidate]) -> tuple[list[float], list[float]]:
        return (
            [one.hours for one in found],
            [COVERAGE * one.largest_u[name] for one in found],
        )

    ax.plot(*spread(proposal.curve), "-", color="#4477aa", label="best campaigns of the search")
    if proposal.usual:
        ax.plot(*spread(proposal.usual), "s", color="#999933", label="usual campaigns")
    for one in proposal.usual:
        text = one.label.split(",")[0]
        ax.annotate(text, (one.hours, COVERAGE * one.largest_u[name]), fontsize=7)
    own = next(one.expanded for one in proposal.results if one.name == name)
    ax.plot([proposal.schedule.hours], [own], "o", color="#cc3311", label="this plan")
    for wish in wishes:
        if wish.name == name:
            ax.axhline(wish.value, color="#777777", linestyle="--", label="wanted")
    shown = [SHOWN * proposal.schedule.hours, *(one.hours for one in proposal.usual)]
    if max(shown) > 0.0:
        ax.set_xlim(right=1.1 * max(shown))
    ax.set_xlabel("chamber time [h]")
    ax.set_ylabel(f"U [{unit}]")
    ax.legend(loc="upper right")
    return figure


def _results(proposal: Proposal, wishes: Sequence[Wish]) -> Markup:
    """Predicted U beside the wanted one."""
    wanted = {wish.name: wish.value for wish in wishes}
    rows = [
        (
            one.name,
            concise(one.u),
            concise(one.expanded),
            concise(wanted[one.name]) if one.name in wanted else "-",
            one.unit,
        )
        for one in proposal.results
    ]
    heads = ("result", "u (rms over the range)", "U (k = 2, largest)", "wanted U", "unit")
    return html_tables.list_rows("Predicted and wanted", heads, rows, (1, 2, 3))


def _limits(proposal: Proposal) -> Markup:
    """What the uncertainty of each result consists of."""
    sources = dict.fromkeys(source for one in proposal.results for source in one.limits)
    rows = [
        (source, *(f"{100.0 * one.limits.get(source, 0.0):.1f}" for one in proposal.results))
        for source in sources
    ]
    heads = ("source", *(one.name for one in proposal.results))
    return html_tables.list_rows(
        "Shares of the mean variance [%]", heads, rows, range(1, len(heads))
    )


def _campaigns(proposal: Proposal, name: str) -> Markup:
    """Campaigns of the search and usual ones."""
    rows = [
        (one.label, f"{one.hours:.1f}", concise(COVERAGE * one.largest_u[name]))
        for one in (*proposal.usual, *proposal.curve)
    ]
    unit = next(one.unit for one in proposal.results if one.name == name)
    return html_tables.list_rows(
        "Usual campaigns, then those of the search", ("campaign", "h", f"U [{unit}]"), rows, (1, 2)
    )


def _coefficients(proposal: Proposal) -> Markup:
    """Predicted standard uncertainty of each coefficient."""
    rows = [
        (one.model, one.name, f"{one.standard_uncertainty:.3g}", one.unit)
        for one in proposal.coefficients
    ]
    heads = ("model", "coefficient", "u", "unit")
    return html_tables.list_rows("Predicted standard uncertainties", heads, rows, (2,))


def _assumptions(proposal: Proposal) -> Markup:
    """Noise and shared errors that were assumed."""
    rows = [("noise", f"{proposal.noise:.3g}", proposal.noise_unit, "")]
    rows += [
        (f"{one.effect} of the {one.group}", f"{one.value:.3g}", one.unit, f"{one.dof:g}")
        for one in proposal.components
    ]
    heads = ("error", "standard deviation", "unit", "degrees of freedom")
    table = html_tables.list_rows("Assumed errors", heads, rows, (1, 3))
    notes = [element("li", note) for note in proposal.notes]
    return join_markup([table, element("ul", join_markup(notes))] if notes else [table])

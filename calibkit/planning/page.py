"""What people see of a plan: the first screen, with what limits the uncertainty and what a third
more hours would buy, its tables in full, and plan.html, which draws the campaign over time, its
attitudes, and uncertainty against hours above the same tables.
"""

import numpy as np

from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.planning.bench import WITHHELD, name_source
from calibkit.planning.search import Proposal
from calibkit.records.coefficients import at_most
from calibkit.report import figures, page, svg
from calibkit.report.blocks import Block, Chart, Findings, Heading, Page, Standing, Text
from calibkit.report.overview import Overview, concise
from calibkit.report.summary import Summary
from calibkit.report.table import Column, Table, tabulate


def summarize(proposal: Proposal, title: str, within_h: float | None) -> Summary:
    """What is printed of a plan; its verdict is that on the wishes and on the hours."""
    schedule, sought, longer = proposal.campaign.schedule, proposal.sought, proposal.longer
    results, device = proposal.campaign.results, proposal.bench.device
    criteria = tuple(
        at_most(f"U of {name}", results[name].expanded, wish, results[name].unit)
        for name, wish in proposal.wishes.items()
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
    largest = sorted(sought.limits.items(), key=lambda item: -item[1])[:3]
    limits = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in largest)
    bought = "nothing"
    if longer is not None:
        u, hours = concise(longer.expanded(sought.name)), _duration(longer.hours)
        bought = f"U {u} {sought.unit} in {hours}: {longer.label}"
    addition = "A third more hours" if schedule.actions else "A small addition"
    predicted = Table(
        "Predicted uncertainty over the range of use (k = 2)",
        ("result", *(Column(name, ".3g") for name in ("u, rms", "U, largest", "wanted U")), "unit"),
        tuple(
            (result.name, result.u, result.expanded, proposal.wishes.get(name), result.unit)
            for name, result in results.items()
        ),
    )
    sources = dict.fromkeys(source for result in results.values() for source in result.limits)
    shares = Table(
        "Shares of the mean variance [%]",
        ("source", *(Column(name, ".1f") for name in results)),
        tuple(
            (source, *(100.0 * result.limits.get(source, 0.0) for result in results.values()))
            for source in sources
        ),
    )
    campaigns = Table(
        "Campaigns that no other one beats in both hours and U",
        ("campaign", Column("h", ".1f"), Column(f"U [{sought.unit}]", ".3g")),
        tuple((other.label, other.hours, other.expanded(sought.name)) for other in proposal.curve),
    )
    size_of_u = Column("u", ".3g", key="standard_uncertainty")
    coefficients = tabulate(
        "Predicted standard uncertainties",
        ("model", Column("coefficient", key="name"), size_of_u, "unit"),
        proposal.coefficients,
    )
    size, dof = Column("standard deviation", ".3g"), Column("degrees of freedom", "g", missing="")
    errors = Table(
        "Assumed errors",
        ("error", size, "unit", dof),
        (
            ("noise", device.noise, device.noise_unit, None),
            *((name_source(e), e.value, e.unit, e.dof) for e in device.component),
        ),
    )
    return Summary(
        f"Plan: {title}",
        (predicted, shares, campaigns, coefficients, errors),
        proposal.notes,
        criteria,
        conclusion=f"{head}: {'; '.join(reached) or _duration(schedule.hours)}",
        overview=Overview(
            f"{_duration(schedule.hours)} of the chamber{person}: {proposal.campaign.label}.",
            (
                f"What limits {sought.name}: {limits} of the variance.",
                f"{addition} would buy {bought}.",
            ),
            table=predicted,
        ),
    )


def _duration(hours: float) -> str:
    """A length of time in hours, below one in minutes."""
    return f"{60.0 * hours:.0f} min" if 0.0 < hours < 1.0 else f"{hours:.1f} h"


def make_page(summary: Summary, proposal: Proposal) -> bytes:
    """The page as UTF-8, which loads nothing: set point over time with what logs record of it,
    attitudes where there are any, U against hours, and all tables.
    """
    schedule, name, unit = proposal.campaign.schedule, proposal.sought.name, proposal.sought.unit
    dwells = schedule.recorded("dwell")
    count = 1 + bool(schedule.actions) + bool(dwells)
    figure, axes = figures.page(count, 1, title="The campaign", height=4.0 * count)
    if schedule.actions:
        ax, hours, degc = axes[0], list[float](), list[float]()
        for action in schedule.actions:
            hours += [action.start_s / SECONDS_PER_HOUR, action.end_s / SECONDS_PER_HOUR]
            degc += [action.start_degc, action.set_degc]
            if action.log:
                ax.plot(hours[-2:], degc[-2:], color=figures.ALERT, linewidth=4.0)
        ax.plot(hours, degc, color=figures.DENOISED)
        ax.set(xlabel="time [h] (thick: recorded)", ylabel="set point of the chamber [°C]")
    if dwells:
        azimuths = np.isfinite(dwells[0].azimuth_deg)
        for dwell in dwells:
            inside = "none" if dwell.log.startswith(WITHHELD) else figures.ALERT
            turn = dwell.azimuth_deg if azimuths else dwell.toolface_deg
            axes[1].plot(turn, dwell.inclination_deg, "o", color=figures.ALERT, mfc=inside)
        label = "azimuth" if azimuths else "toolface"
        axes[1].set(
            xlabel=f"{label} [°] (filled: fitted, open: withheld)", ylabel="inclination [°]"
        )
    ax, curve = axes[-1], proposal.curve
    expanded = [other.expanded(name) for other in curve]
    ax.plot([other.hours for other in curve], expanded, label="best campaigns of the search")
    ax.plot(schedule.hours, proposal.sought.expanded, "o", color=figures.ALERT, label="this plan")
    if name in proposal.wishes:
        ax.axhline(proposal.wishes[name], color=figures.MUTED, linestyle="--", label="wanted")
    if schedule.hours > 0.0:
        # beyond twice the hours of the plan little is gained
        ax.set_xlim(right=2.0 * schedule.hours)
    ax.set(xlabel="chamber time [h]", ylabel=f"U of {name} (k = 2, largest in the range) [{unit}]")
    ax.legend(loc="upper right")
    figures.settle([figure])
    (drawing,), _ = svg.inline([figure])
    blocks: list[Block] = [
        Heading("The campaign"),
        *map(Text, (summary.overview.sentence, *summary.overview.facts)),
        Chart(drawing, "The campaign"),
        Heading("Numbers"),
        *summary.tables,
        Heading("Assumptions"),
        Findings(summary.flags),
    ]
    standing: Standing = "open" if summary.verdict == "no verdict" else summary.verdict
    return page.render(Page(summary.title, summary.last_line, standing, tuple(blocks)))

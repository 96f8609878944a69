"""Drift of a device's coefficients over years: one panel per quantity, twelve per page."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING

from calibkit.errors import UsageError
from calibkit.history.timeline import YEAR_DAYS
from calibkit.numeric import gum
from calibkit.report.figures import ALERT, DENOISED, MUTED, page, pdf, png

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.history.timeline import Determination, NumberSeries, Timeline

ROWS, COLUMNS = 4, 3
SUFFIXES = (".pdf", ".png")


def render(timeline: Timeline, suffix: str, first: Sequence[Figure] = ()) -> bytes:
    """Figure of a timeline as PDF (the pages that come first, then as many as it needs) or PNG (the
    first page).
    """
    if suffix not in SUFFIXES:
        raise UsageError(
            f"--figure: a file ending in '{suffix}'",
            hint=f"name one ending in {' or '.join(SUFFIXES)}",
        )
    if not timeline.series and not first:
        raise UsageError(
            f"{timeline.serial}: no quantity with an uncertainty was determined twice",
            hint="a figure needs two revisions",
        )
    step = ROWS * COLUMNS
    blocks = [
        timeline.series[start : start + step] for start in range(0, len(timeline.series), step)
    ]
    pages = [*first, *(_page(timeline.serial, block) for block in blocks)]
    return png(pages[0]) if suffix == ".png" else pdf(pages)


def _page(serial: str, block: Sequence[NumberSeries]) -> Figure:
    """One page of panels."""
    title = (
        f"{serial}: coefficients over time, bars U (type A), line: weighted slope where"
        " three dates or more"
    )
    rows = -(-len(block) // COLUMNS)
    figure, axes = page(rows, COLUMNS, title=title, height=0.8 + 2.4 * rows)
    for ax, series in zip(axes, block, strict=False):
        _panel(ax, series)
    for ax in axes[len(block) :]:
        ax.set_visible(False)
    return figure


def _factor(point: Determination) -> float:
    """Coverage factor of a point's uncertainty; 2 where its degrees of freedom are not stated."""
    return (
        2.0 if point.effective_dof is None else gum.coverage_factor(max(point.effective_dof, 1.0))
    )


def _panel(ax: Axes, series: NumberSeries) -> None:
    """One quantity: change from its first determination against date; rejected runs are hollow."""
    first = series.points[0].value
    for point in series.points:
        date = dt.date.fromisoformat(point.effective_from)
        ax.errorbar(
            [date.toordinal()],
            [point.value - first],
            _factor(point) * point.standard_uncertainty,
            fmt="o",
            ms=4.5,
            capsize=3,
            color=DENOISED,
            mfc="none" if point.verdict == "rejected" else DENOISED,
        )
        ax.annotate(f"r{point.revision:03d}", (date.toordinal(), point.value - first), (4, 4),
                    textcoords="offset points", fontsize=6.5, color=MUTED)  # fmt: skip
    _line(ax, series)
    _dates(ax, series)
    quantity = series.quantity
    colour = ALERT if series.overall.verdict == "moved" else MUTED
    name = ".".join(filter(None, (quantity.model, quantity.name)))
    ax.set_title(f"{name}: {series.overall.in_u:+.3g} u", fontsize=8.5, color=colour)
    ax.set_ylabel(f"change [{quantity.unit}]", fontsize=7.5)


def _line(ax: Axes, series: NumberSeries) -> None:
    """The weighted straight line through the determinations that were not rejected."""
    trend = series.trend
    if trend is None:
        return
    import numpy as np

    days = np.array(
        [dt.date.fromisoformat(p.effective_from).toordinal() for p in series.points],
        dtype=np.float64,
    )
    line = (
        trend.intercept
        + trend.slope * (days / YEAR_DAYS - trend.middle_year)
        - series.points[0].value
    )
    ax.plot(days, line, color=MUTED, lw=0.9, ls="--")


def _dates(ax: Axes, series: NumberSeries) -> None:
    """At most four dates on the abscissa, first and last among them."""
    days = sorted(
        {dt.date.fromisoformat(point.effective_from).toordinal() for point in series.points}
    )
    labelled_days = (
        days if len(days) <= 4 else [days[round(k * (len(days) - 1) / 3)] for k in range(4)]
    )
    ax.set_xticks(
        labelled_days, [dt.date.fromordinal(day).isoformat() for day in labelled_days], fontsize=6.5
    )
    ax.margins(x=0.15)
    ax.tick_params(axis="y", labelsize=7)

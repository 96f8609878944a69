"""Control charts of a fleet: one page per key figure, one point per device, centre line, limits and
named outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.control import FEWEST
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, drawing, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.numeric.arrays import Array
    from calibkit.numeric.control import Control


MOST_NAMES = 40
"""Units up to which each has its serial below the axis."""
MOST_NAMED = 12
"""Outliers up to which each has its serial beside its point."""
WINDOW = 2.0
"""Half of the drawn range, in distances of the limits from the centre line."""
MARGIN = 0.05
"""Room above and below the drawn range, of it."""
EDGE_PT, GAP_PT, LINE_PT = 8.0, 4.0, 14.0
"""Room at the edge of the page, between words, and of a line of words."""
TOP_PT = 48.0
"""Room of the titles of page and chart."""
LONGEST = 32
"""Letters of a serial that stand in a chart."""
WORDS_SIZE, SERIAL_SIZE, TICK_SIZE = 8.0, 7.0, 9.0


@dataclass(frozen=True, slots=True)
class ControlChart:
    """One key figure of the units that have it, in the order of their serials."""

    name: str
    unit: str
    serials: tuple[str, ...]
    values: Array
    standard_uncertainties: Array
    """[n], in the unit of the values; 0 where none is stated."""
    control: Control
    acceptance: float
    """Acceptance limit that all these units share; NaN where there is none."""
    units: int
    """Units of the fleet, with this figure or without."""


def pages(title: str, charts: Sequence[ControlChart]) -> list[Figure]:
    """One page per chart."""
    figures = []
    for chart in charts:
        figure, (axes,) = page(1, 1, title=title, height=5.5)
        _settle(figure, axes, _draw(axes, chart))
        figures.append(figure)
    return figures


def _settle(figure: Figure, ax: Axes, words: Sequence[str]) -> None:
    """Give a chart the margins that its words need; a layout that is searched for takes as long as
    the page itself.
    """
    ticks = ax.yaxis.get_major_formatter().format_ticks(ax.yaxis.get_majorticklocs())  # type: ignore[arg-type] # an array
    serials = [label.get_text() for label in ax.get_xticklabels()]
    left = EDGE_PT + LINE_PT + GAP_PT + _width(ticks, TICK_SIZE) + 2.0 * GAP_PT
    bottom = EDGE_PT + LINE_PT + GAP_PT + _width(serials, SERIAL_SIZE) + 2.0 * GAP_PT
    right = GAP_PT + _width(words, WORDS_SIZE) + EDGE_PT
    width, height = (72.0 * inches for inches in figure.get_size_inches())
    figure.set_layout_engine("none")
    ax.set_position(
        (
            left / width,
            bottom / height,
            1.0 - (left + right) / width,
            1.0 - (bottom + TOP_PT) / height,
        )
    )


def _width(texts: Sequence[str], size: float) -> float:
    """Length of the longest of some texts [pt]: of those with the most letters."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=size)
    with drawing():
        return max(
            text_to_path.get_text_width_height_descent(text, font, ismath=False)[0]
            for text in sorted(texts, key=len)[-3:]
        )


def _draw(ax: Axes, chart: ControlChart) -> list[str]:
    """One chart, and the words beside it; what stands far outside is a triangle at the edge, so
    that others keep their spread.
    """
    positions = np.arange(1, len(chart.serials) + 1)
    outliers = list(chart.control.outliers)
    low, high = _window(chart)
    clipped_values = np.clip(chart.values, low, high)
    inside = clipped_values == chart.values
    if np.any(chart.standard_uncertainties > 0.0):
        errors = 2.0 * chart.standard_uncertainties[inside]
        ax.errorbar(
            positions[inside],
            clipped_values[inside],
            errors,
            fmt="none",
            ecolor=MUTED,
            elinewidth=0.8,
        )
    ax.plot(positions[inside], clipped_values[inside], ".", ms=5, color=DENOISED)
    for outside, marker in ((chart.values > high, "^"), (chart.values < low, "v")):
        ax.plot(
            positions[outside], clipped_values[outside], marker, ms=6, color=ALERT, clip_on=False
        )
    ringed = [k for k in outliers if inside[k]]
    ax.plot(positions[ringed], clipped_values[ringed], "o", ms=6, mfc="none", color=ALERT)
    for k in outliers[:MOST_NAMED]:
        _name(ax, chart, k, float(clipped_values[k]))
    if math.isfinite(low):
        ax.set_ylim(low - MARGIN * (high - low), high + MARGIN * (high - low))
    _name_serials(ax, chart.serials)
    ax.set_title(chart.name, loc="left")
    ax.set_ylabel(chart.unit)
    ax.set_xlabel(_explanation(chart), color=INK)
    return _draw_lines(ax, chart)


def _window(chart: ControlChart) -> tuple[float, float]:
    """Range of values that is drawn: twice the distance of the limits, where there are limits."""
    centre = chart.control.centre
    low, high = (centre + WINDOW * (end - centre) for end in chart.control.ends)
    return low, high


def _name(ax: Axes, chart: ControlChart, k: int, height: float) -> None:
    """Serial, value and robust z beside an outlier."""
    left = k <= len(chart.serials) // 2
    ax.annotate(
        f"{_short(chart.serials[k])}: {chart.values[k]:.6g}, z = {chart.control.z[k]:.1f}",
        (k + 1, height),
        xytext=(8 if left else -8, 0),
        textcoords="offset points",
        ha="left" if left else "right",
        va="center",
        color=ALERT,
    )


def _draw_lines(ax: Axes, chart: ControlChart) -> list[str]:
    """Centre line, control limits and the acceptance limit, each with its value; returns the words
    beside them.
    """
    control = chart.control
    ax.axhline(control.centre, color=GOOD)
    lines = [(control.centre, GOOD, f"median {control.centre:.6g}")]
    if math.isfinite(control.limit):
        for sign, value in zip("−+", control.ends, strict=True):
            ax.axhline(value, color=ALERT, ls="--")
            lines.append((value, ALERT, f"z = {sign}{control.limit:.2f}: {value:.6g}"))
    if math.isfinite(chart.acceptance):
        ax.axhline(chart.acceptance, color=INK, ls=":")
        lines.append((chart.acceptance, INK, f"acceptance limit {chart.acceptance:.6g}"))
    for value, colour, words in lines:
        ax.annotate(
            words,
            (1.0, value),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            color=colour,
            va="center",
            fontsize=WORDS_SIZE,
        )
    return [words for _, _, words in lines]


def _name_serials(ax: Axes, serials: Sequence[str]) -> None:
    """Serials below the axis, every so many where there are many."""
    step = -(-len(serials) // MOST_NAMES)
    labelled_indices = list(range(0, len(serials), step))
    ax.set_xticks(
        [k + 1 for k in labelled_indices],
        [_short(serials[k]) for k in labelled_indices],
        rotation=90,
        fontsize=SERIAL_SIZE,
    )
    ax.set_xlim(0.0, len(serials) + 1.0)
    ax.grid(visible=False, axis="x")


def _short(serial: str) -> str:
    """A serial as it stands in a chart: the table has the whole."""
    return serial if len(serial) <= LONGEST else f"{serial[: LONGEST - 1]}…"


def _explanation(chart: ControlChart) -> str:
    """What σ is, or why no limits are drawn."""
    count = f"{len(chart.serials)} of {chart.units} units"
    if chart.control.sigma == 0.0:
        return (
            f"{count}; more than half of the values are equal: no device can be judged by their"
            " spread"
        )
    if not math.isfinite(chart.control.limit):
        return f"{count}; fewer than {FEWEST}: no device can be judged by their spread"
    limits_note = (
        "; limits of a device of usual uncertainty" if np.any(chart.standard_uncertainties) else ""
    )
    return f"{count}; σ = {chart.control.sigma:.4g} by median absolute deviation{limits_note}"

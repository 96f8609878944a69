"""Control charts of a fleet: a page a key figure, one point a unit, with centre line, limits and named outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.control import FEWEST
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from calibkit.numeric.control import Control

    Array = NDArray[np.float64]

MOST_NAMES = 40
"""Units up to which each has its serial below the axis."""
MOST_NAMED = 12
"""Outliers up to which each has its serial beside its point."""
WINDOW = 2.0
"""Half of the drawn range, in distances of the limits from the centre line."""
MARGIN = 0.05
"""Room above and below the drawn range, of it."""


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
    """One page a chart."""
    figures = []
    for chart in charts:
        figure, (axes,) = page(1, 1, title=title, height=5.5)
        _draw(axes, chart)
        figures.append(figure)
    return figures


def _draw(ax: Axes, chart: ControlChart) -> None:
    """One chart; what stands far outside is drawn as a triangle at the edge, so that the others keep their spread."""
    at = np.arange(1, len(chart.serials) + 1)
    outliers = list(chart.control.outliers)
    low, high = _window(chart)
    shown = np.clip(chart.values, low, high)
    inside = shown == chart.values
    if np.any(chart.standard_uncertainties > 0.0):
        errors = 2.0 * chart.standard_uncertainties[inside]
        ax.errorbar(at[inside], shown[inside], errors, fmt="none", ecolor=MUTED, elinewidth=0.8)
    ax.plot(at[inside], shown[inside], ".", ms=5, color=DENOISED)
    ax.plot(at[chart.values > high], shown[chart.values > high], "^", ms=6, color=ALERT, clip_on=False)
    ax.plot(at[chart.values < low], shown[chart.values < low], "v", ms=6, color=ALERT, clip_on=False)
    ringed = [k for k in outliers if inside[k]]
    ax.plot(at[ringed], shown[ringed], "o", ms=6, mfc="none", color=ALERT)
    for k in outliers[:MOST_NAMED]:
        _name(ax, chart, k, float(shown[k]))
    if math.isfinite(low):
        ax.set_ylim(low - MARGIN * (high - low), high + MARGIN * (high - low))
    _lines(ax, chart)
    _serials(ax, chart.serials)
    ax.set_title(chart.name, loc="left")
    ax.set_ylabel(chart.unit)
    ax.set_xlabel(_said(chart))
    ax.xaxis.label.set_color(INK)


def _window(chart: ControlChart) -> tuple[float, float]:
    """Range of values that is drawn: twice the distance of the limits, where there are limits."""
    half = WINDOW * chart.control.limit * chart.control.sigma
    if chart.control.sigma == 0.0 or not math.isfinite(half):
        return -math.inf, math.inf
    return chart.control.centre - half, chart.control.centre + half


def _name(ax: Axes, chart: ControlChart, k: int, height: float) -> None:
    """Serial, value and robust z beside an outlier."""
    left = k <= len(chart.serials) // 2
    ax.annotate(
        f"{chart.serials[k]}: {chart.values[k]:.6g}, z = {chart.control.z[k]:.1f}",
        (k + 1, height),
        xytext=(8 if left else -8, 0),
        textcoords="offset points",
        ha="left" if left else "right",
        va="center",
        color=ALERT,
    )


def _lines(ax: Axes, chart: ControlChart) -> None:
    """Centre line, control limits and the acceptance limit, each with its value."""
    control = chart.control
    ax.axhline(control.centre, color=GOOD)
    lines = [(control.centre, GOOD, f"median {control.centre:.6g}")]
    if math.isfinite(control.limit):
        for sign in (-1.0, 1.0):
            value = control.centre + sign * control.limit * control.sigma
            ax.axhline(value, color=ALERT, ls="--")
            lines.append((value, ALERT, f"{'+' if sign > 0.0 else '−'}{control.limit:.2f} σ  {value:.6g}"))
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
            fontsize=8,
        )


def _serials(ax: Axes, serials: Sequence[str]) -> None:
    """Serials below the axis, every so many where there are many."""
    step = -(-len(serials) // MOST_NAMES)
    at = list(range(0, len(serials), step))
    ax.set_xticks([k + 1 for k in at], [serials[k] for k in at], rotation=90, fontsize=7)
    ax.set_xlim(0.0, len(serials) + 1.0)
    ax.grid(visible=False, axis="x")


def _said(chart: ControlChart) -> str:
    """What the lines are, or why there are none."""
    count = f"{len(chart.serials)} of {chart.units} units"
    if chart.control.sigma == 0.0:
        return f"{count}; more than half of the values are equal: no unit can be judged by their spread"
    if not math.isfinite(chart.control.limit):
        return f"{count}; fewer than {FEWEST}: no unit can be judged by their spread"
    return f"{count}; σ = {chart.control.sigma:.4g} by median absolute deviation"

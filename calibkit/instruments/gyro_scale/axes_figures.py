"""Figures of gyros over three table axes: lines of each gyro, angles and misalignment with their
intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.instruments.gyro_scale import figures
from calibkit.instruments.gyro_scale.figures import COLOURS, MARKERS
from calibkit.report.figures import MUTED, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.arrays import Array


@dataclass(frozen=True, slots=True)
class Curve:
    """A quantity in every set of runs [q] with its standard uncertainty, and its polynomial over
    temperature, or empty.
    """

    name: str
    value: Array
    standard_uncertainty: Array
    grid: Array
    curve: Array


@dataclass(frozen=True, slots=True)
class AxesReport:
    """All that the figures show."""

    lines: figures.GyroReport
    temperature: Array
    """[q, °C], NaN where it was not logged."""
    angles: tuple[Curve, ...]
    """90° less each angle between two input axes [°]."""
    misalignment: tuple[Curve, ...]
    """Components of the input axes across the axis that each senses most [mrad]."""


def pages(title: str, report: AxesReport) -> list[Figure]:
    """Scale-factor errors, K over temperature, angles and misalignment."""
    figure, (left, right) = page(1, 2, title=f"{title}: input axes", height=5.2)
    _panel(left, report, report.angles)
    left.set(title="90° - angle between input axes, bars k = 2", ylabel="[°]")
    _panel(right, report, report.misalignment)
    right.set(title="input axes across their main axis, bars k = 2", ylabel="[mrad]")
    return [*figures.pages(title, report.lines), figure]


def _panel(ax: Axes, report: AxesReport, curves: tuple[Curve, ...]) -> None:
    """Values with bars against temperature, or side by side at one temperature."""
    ax.axhline(0.0, color=MUTED, lw=0.6)
    if not curves:
        ax.text(
            0.5,
            0.5,
            "one gyro: nothing to compare",
            transform=ax.transAxes,
            ha="center",
            color=MUTED,
        )
        return
    single = report.temperature.size == 1
    for k, one in enumerate(curves):
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        where = np.array([float(k)]) if single else report.temperature
        bar = 2.0 * one.standard_uncertainty
        ax.errorbar(
            where, one.value, bar, fmt=marker, ms=5, capsize=4, color=colour, label=one.name
        )
        if one.grid.size:
            ax.plot(one.grid, one.curve, color=colour, lw=0.9)
    if single:
        ax.set_xticks(range(len(curves)), [one.name for one in curves])
        ax.set_xlim(-0.6, len(curves) - 0.4)
    else:
        ax.set_xlabel("case temperature [°C]")
        ax.margins(y=0.25)
        ax.legend(loc="upper center", ncols=3)

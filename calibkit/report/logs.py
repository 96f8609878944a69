"""Figure of a log as it was read: every column, its held conditions shaded, its findings marked,
its occupancy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from calibkit.report.figures import ALERT, DENOISED, MUTED, RAW, page
from calibkit.report.svg import extremes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.numeric.arrays import Array


POINTS = 4000
"""Points of a curve: more than a page shows."""
SHADES = {
    "soak": "#bbccee",
    "ramp": "#ffcccc",
    "rate": "#ccddaa",
    "dwell": "#eeeebb",
    "station": "#cceeff",
}
"""Kind of held condition → its shade (after Tol, pale scheme)."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A column along the log: abscissa [m] and values [m], of many values the extremes of short
    pieces.
    """

    name: str
    abscissa: Array
    values: Array

    @classmethod
    def thinned(cls, name: str, abscissa: Array, values: Array) -> Self:
        """Curve of a column; missing values are left out."""
        good = np.isfinite(values) & np.isfinite(abscissa)
        abscissa, values = abscissa[good], values[good]
        if values.size > POINTS:
            indices = extremes(abscissa, values, POINTS)
            abscissa, values = abscissa[indices], values[indices]
        return cls(name, abscissa, values)


@dataclass(frozen=True, slots=True)
class LogFigure:
    """All that the figure of one log shows."""

    file: str
    axis: str
    curves: tuple[Curve, ...]
    conditions: tuple[tuple[str, float, float], ...]
    marks: tuple[tuple[float, str, str], ...]
    occupancy: tuple[tuple[float, float, float], ...]

    def draw(self) -> Figure:
        """Page of one log: panels of the columns below each other, and the temperature occupancy
        where there is one.
        """
        curves = self.curves[:9]
        count = max(1, len(curves)) + (1 if len(self.occupancy) > 1 else 0)
        figure, axes = page(count, 1, title=self.file, height=1.0 + 1.7 * count)
        for ax, curve in zip(axes, curves, strict=False):
            _panel(ax, self, curve)
        if curves:
            axes[len(curves) - 1].set_xlabel(self.axis)
            _key(axes[0], self)
        if len(self.occupancy) > 1:
            _occupancy(axes[-1], self)
        return figure


def _panel(ax: Axes, log: LogFigure, curve: Curve) -> None:
    """One column, with shaded conditions and marked findings."""
    for kind, first, last in log.conditions:
        ax.axvspan(first, last, color=SHADES.get(kind, "#dddddd"), lw=0, alpha=0.6)
    if curve.values.size <= 400:
        ax.plot(curve.abscissa, curve.values, ".", ms=3, color=DENOISED)
    else:
        middle = (curve.values[1:] + curve.values[:-1]) / 2.0
        ax.plot(curve.abscissa, curve.values, color=RAW, lw=0.7)
        ax.plot(curve.abscissa[1:], middle, color=DENOISED, lw=0.7)
    for number, (x, _, severity) in enumerate(log.marks, start=1):
        colour = ALERT if severity == "refuse" else MUTED
        ax.axvline(x, color=colour, lw=1.0, ls="--")
        ax.annotate(
            str(number), (x, 1.0), xycoords=("data", "axes fraction"), fontsize=7, color=colour
        )
    ax.set_ylabel(curve.name, fontsize=7)


def _key(ax: Axes, log: LogFigure) -> None:
    """Legend of the shades, and the names of the marks."""
    handles = [
        ax.axvspan(np.nan, np.nan, color=SHADES.get(kind, "#dddddd"), label=kind)
        for kind in dict.fromkeys(kind for kind, _, _ in log.conditions)
    ]
    if handles:
        ax.legend(handles=handles, loc="upper right", ncols=len(handles))
    if log.marks:
        names = (f"{number} {name}" for number, (_, name, _) in enumerate(log.marks, start=1))
        ax.set_title(", ".join(names), fontsize=8, color=ALERT)


def _occupancy(ax: Axes, log: LogFigure) -> None:
    """Share of the rows over temperature."""
    low, high, share = np.array(log.occupancy).T
    ax.bar(low, 100.0 * share, width=high - low, align="edge", color=RAW, edgecolor="white")
    ax.set_xlabel("temperature [°C]")
    ax.set_ylabel("share of rows [%]", fontsize=7)

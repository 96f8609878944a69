"""Figures of biases against their abscissa."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.frame import share_unit
from calibkit.report.documents import Drawn
from calibkit.report.figures import GOOD, INK, RAW, page
from calibkit.units import column_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.arrays import Array
    from calibkit.instruments import Fitted


@dataclass(frozen=True, slots=True)
class BiasCurve:
    """One channel: bin means of the indication over the abscissa, and the polynomial there."""

    name: str
    abscissa: Array
    indication: Array
    polynomial: Array


@dataclass(frozen=True, slots=True)
class BiasReport:
    """All that the figures show."""

    abscissa: str
    curves: tuple[BiasCurve, ...]

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per bin of a channel: means of the indication less the
        polynomial, in the channel's unit.
        """
        parts = {
            "channel": [np.full(c.abscissa.size, c.name, dtype=object) for c in self.curves],
            self.abscissa: [curve.abscissa for curve in self.curves],
            "indication": [curve.indication for curve in self.curves],
            "residual": [curve.indication - curve.polynomial for curve in self.curves],
        }
        stated = (column_unit(curve.name) for curve in self.curves)
        units = share_unit(("indication", "residual"), stated)
        return {name: np.concatenate(columns) for name, columns in parts.items()} | {"units": units}


def pages(title: str, report: BiasReport) -> list[Figure]:
    """Up to three channels in a row, as many rows as it takes."""
    columns = min(3, len(report.curves))
    rows = -(-len(report.curves) // columns)
    figure, axes = page(
        rows, columns, title=f"{title}: bias against {report.abscissa}", height=1.2 + 2.6 * rows
    )
    for ax, curve in zip(axes, report.curves, strict=False):
        ax.plot(
            curve.abscissa, curve.indication, ".", ms=3, color=RAW, label="means of the indication"
        )
        ax.plot(curve.abscissa, curve.polynomial, color=GOOD, label="polynomial")
        ax.set(title=curve.name, xlabel=report.abscissa)
        ax.xaxis.label.set_color(INK)
    axes[0].legend(loc="best")
    for ax in axes[len(report.curves) :]:
        ax.set_visible(False)
    return [figure]


def draw(title: str, fitted: Fitted[BiasReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages(title, fitted.drawing)), fitted.summary)

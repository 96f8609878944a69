"""Figures of a north-seeking inclinometer: s(T), azimuth error against C, stations before and after
correction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, MUTED, RAW, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.arrays import Array, Mask
    from calibkit.instruments import Fitted
    from calibkit.report.table import Table


@dataclass(frozen=True, slots=True)
class ScaleCurve:
    """Roots of s of one gyro [n] with standard uncertainties, mask of the roots used in the fit,
    and s(T) on a grid.
    """

    axis: str
    label: str
    abscissa: Array
    root: Array
    root_uncertainty: Array
    used: Mask
    grid: Array
    s: Array
    standard_uncertainty: Array


@dataclass(frozen=True, slots=True)
class SeekingReport:
    """Data of the figures: C, azimuth error before and after correction, azimuth shift by s and its
    uncertainty, each [n].
    """

    curves: tuple[ScaleCurve, ...]
    label: Array
    before: Array
    after: Array
    shift: Array
    standard_uncertainty: Array
    table: Table

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per station: azimuth less the reference azimuth, NaN
        where there is none, over C.
        """
        return {
            "station": [row[0] for row in self.table.rows],
            "c": self.label,
            "residual_before_deg": self.before,
            "residual_deg": self.after,
            "standard_uncertainty_deg": self.standard_uncertainty,
        }


def draw_pages(title: str, report: SeekingReport) -> list[Figure]:
    """Page of azimuth error against C, which shows the verdict, and page of s(T)."""
    return [_draw_azimuth(title, report), _draw_scale(title, report)]


def _draw_scale(title: str, report: SeekingReport) -> Figure:
    """s(T) of each gyro with its uncertainty band, over the roots that were used in the fit."""
    count = len(report.curves)
    figure, axes = page(
        count, 1, title=f"{title}: in-situ scale factor s", height=1.0 + 3.4 * count
    )
    for ax, curve in zip(axes, report.curves, strict=True):
        known, u = np.isfinite(curve.root), curve.root_uncertainty
        bars = 2.0 * np.where(np.isfinite(u), u, 0.0)
        for chosen, colour, name in (
            (curve.used, DENOISED, "roots used"),
            (~curve.used, RAW, "roots not used"),
        ):
            there = known & chosen
            if there.any():
                ax.errorbar(
                    curve.abscissa[there],
                    curve.root[there],
                    bars[there],
                    fmt="o",
                    ms=3,
                    lw=0.8,
                    color=colour,
                    label=name,
                )
        low, high = (curve.s + sign * 2.0 * curve.standard_uncertainty for sign in (-1.0, 1.0))
        ax.fill_between(curve.grid, low, high, color=GOOD, alpha=0.2, lw=0)
        ax.plot(curve.grid, curve.s, color=GOOD, label="s(T), band k = 2")
        ax.set(title=f"gyro {curve.axis}: bars k = 2", xlabel=curve.label, ylabel="s [1]")
        ax.ticklabel_format(useOffset=False)
        # axis limits cover s(T) and the roots used; a root near C = 0 may lie far outside
        used = curve.used & known
        least = min([*(curve.root - bars)[used], *low])
        most = max([*(curve.root + bars)[used], *high])
        margin = 0.06 * (most - least) + 1e-6
        ax.set_ylim(least - margin, most + margin)
        ax.legend(loc="best", ncols=3)
    return figure


def _draw_azimuth(title: str, report: SeekingReport) -> Figure:
    """Azimuth error before and after correction against C; without a reference azimuth, the azimuth
    shift that s causes.
    """
    against = bool(np.isfinite(report.after).any())
    figure, axes = page(2, 1, title=f"{title}: azimuth against C = cos α cos θ + sin α sin θ cos ψ")
    bars = 2.0 * report.standard_uncertainty
    if against:
        axes[0].plot(report.label, report.before, "o", ms=4, color=RAW, label="s = 1")
        axes[0].errorbar(
            report.label,
            report.after,
            bars,
            fmt="o",
            ms=4,
            lw=0.8,
            color=GOOD,
            label="corrected, bars k = 2",
        )
        axes[0].legend(loc="best", ncols=2)
        axes[0].set(title="error against the reference", xlabel="C", ylabel="azimuth error [°]")
    else:
        axes[0].errorbar(
            report.label,
            report.shift,
            bars,
            fmt="o",
            ms=4,
            lw=0.8,
            color=DENOISED,
        )
        axes[0].set(
            title="change of the azimuth by the scale factor s (no reference azimuth), bars k = 2",
            xlabel="C",
            ylabel="azimuth − azimuth with s = 1 [°]",
        )
    axes[0].axhline(0.0, color=MUTED, lw=0.6)
    axes[1].plot(report.label, bars, "o", ms=4, color=ALERT)
    axes[1].set(title="stated uncertainty of the azimuth, k = 2", xlabel="C", ylabel="U [°]")
    axes[1].set_ylim(bottom=0.0)
    return figure


def draw(title: str, fitted: Fitted[SeekingReport]) -> Drawn:
    """Figures of a fit, and its summary with the table of all stations."""
    first, _, *others = fitted.summary.tables
    whole = replace(fitted.summary, tables=(first, fitted.drawing.table, *others))
    return Drawn(tuple(draw_pages(title, fitted.drawing)), whole)

"""Figures of a gyro's thermal run: logs, coefficients over temperature rate, residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR
from calibkit.numeric import chunks
from calibkit.numeric.dispersion import rms
from calibkit.report.documents import Drawn
from calibkit.report.figures import DENOISED, GOOD, INK, MUTED, RAW, SIDES, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.arrays import Array
    from calibkit.instruments import Fitted
    from calibkit.instruments.fog_thermal.compensate import LogFigures
    from calibkit.instruments.fog_thermal.numeric import published
    from calibkit.instruments.fog_thermal.numeric.drift_figures import Hysteresis
    from calibkit.instruments.fog_thermal.ramps import PreparedLog


SHOWN, GAP_H = 12, 0.2
"""Logs in the figure of drift before and after, and hours between two of them."""
COEFFICIENTS = ("a0 [°/h]", "a1 [°/h/K]", "a2 [°/h/K²]")


@dataclass(frozen=True, slots=True)
class DriftReport:
    """Data of all figures."""

    title: str
    interval_s: float
    logs: tuple[PreparedLog, ...]
    compensated: tuple[LogFigures, ...]
    """Of each log."""
    ramps: tuple[published.RampFit, ...] = ()
    polynomials: tuple[published.RatePolynomial, ...] = ()
    polynomials_exported: bool = False
    hysteresis: tuple[tuple[str, Hysteresis], ...] = ()
    """Hysteresis curves and their labels."""

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per model interval: the compensated indication about the
        mean of its log.
        """
        parts = {
            "run": [np.full(log.raw.time.size, log.name, dtype=object) for log in self.logs],
            "time_s": [log.raw.time for log in self.logs],
            "temp_case_degc": [log.raw.case for log in self.logs],
            "gyro_dph": [log.raw.indication for log in self.logs],
            "residual_dph": [log.output - log.output.mean() for log in self.compensated],
        }
        return {name: np.concatenate(columns) for name, columns in parts.items()}


def pages(report: DriftReport) -> list[Figure]:
    """Pages of the report: drift before and after, which shows the verdict, coefficients over rate,
    residuals.
    """
    return [before_after_page(report), _coefficients_page(report), _residual_page(report)]


def before_after_page(report: DriftReport) -> Figure:
    """Drift of the first logs before and after compensation and denoised, one log after the other,
    with what noise alone gives, above the case temperature.
    """
    first_logs = report.logs[:SHOWN]
    truncation = (
        f" (the first {SHOWN} of {len(report.logs)} logs)" if len(report.logs) > SHOWN else ""
    )
    figure, axes = page(
        2, 1, title=f"{report.title}: drift before and after compensation{truncation}", height=6.0
    )
    group, start = max(1, round(100.0 / report.interval_s)), 0.0
    for number, (log, compensated) in enumerate(zip(first_logs, report.compensated, strict=False)):
        passed = start + (log.raw.time - log.raw.time[0]) / SECONDS_PER_HOUR
        smooth, hours = log.denoised.indication, _means(passed, group)
        legend = "denoised" if number == 0 else "_nolegend_"
        axes[0].plot(passed, smooth - smooth.mean(), color=DENOISED, lw=0.8, zorder=3, label=legend)
        curves = (
            (log.raw.indication, RAW, 2.0, "before"),
            (compensated.output, GOOD, 1.2, "after"),
        )
        for values, colour, width, label in curves:
            drift = _means(values - values.mean(), group)
            legend = label if number == 0 else "_nolegend_"
            axes[0].plot(hours, drift, color=colour, lw=width, label=legend)
        axes[1].plot(hours, _means(log.raw.case, group), color=INK)
        start = float(hours[-1]) + GAP_H
    band = 2.0 * rms([log.split.noise for log in report.compensated])
    if band > 0.0:
        axes[0].axhspan(-band, band, color=DENOISED, alpha=0.2, lw=0, label="noise alone (k = 2)")
    axes[0].legend(loc="best", ncols=4)
    axes[0].set(
        ylabel="drift [°/h]", title="100 s means, each log about its mean, one log after the other"
    )
    axes[1].set(xlabel="time [h]", ylabel="case temperature [°C]")
    return figure


def _coefficients_page(report: DriftReport) -> Figure:
    """a_j over temperature rate with error bars (k = 2), and the polynomials over their fitted
    ranges.
    """
    figure, axes = page(
        3, 1, title=f"{report.title}: drift coefficients per {report.interval_s:g} s interval"
    )
    for j, ax in enumerate(axes):
        for ramp in report.ramps:
            colour = SIDES["heating" if ramp.rate > 0.0 else "cooling"]
            ax.errorbar(
                ramp.rate,
                ramp.coefficients[j],
                2.0 * ramp.standard_uncertainty[j],
                fmt="o",
                ms=4,
                capsize=3,
                color=colour,
            )
        for polynomial in report.polynomials:
            rate, colour = np.linspace(*polynomial.rates, 101), SIDES[polynomial.side]
            a = polynomial.evaluate(rate)
            ax.plot(rate, a[:, j], color=colour, ls="-" if report.polynomials_exported else "--")
            ax.axvspan(*polynomial.rates, color=colour, alpha=0.06, lw=0)
        ax.axhline(0.0, color=MUTED, lw=0.6)
        ax.set(
            xlabel="temperature rate [°C/min]",
            ylabel=COEFFICIENTS[j],
            title=f"a{j}: bars k = 2, dashed: not exported",
        )
    return figure


def _residual_page(report: DriftReport) -> Figure:
    """Residuals after compensation (the mean of each log removed) over case temperature, and the
    hysteresis.
    """
    rows = 2 if report.hysteresis else 1
    figure, axes = page(
        rows,
        1,
        title=f"{report.title}: residual after compensation, 100 s means",
        height=2.8 * rows + 2.0,
    )
    group = max(1, round(100.0 / report.interval_s))
    for log, compensated in zip(report.logs, report.compensated, strict=True):
        case, output = log.raw.case, compensated.output
        left = _means(output - output.mean(), group)
        colour = SIDES["heating" if case[-1] > case[0] else "cooling"]
        axes[0].plot(_means(case, group), left, color=colour, lw=0.9, alpha=0.8)
    axes[0].set(
        xlabel="case temperature [°C]", ylabel="residual [°/h]", title="red: heating, blue: cooling"
    )
    if report.hysteresis:
        for (name, side), colour in zip(report.hysteresis, (RAW, DENOISED), strict=False):
            axes[1].errorbar(
                side.temperature,
                side.difference,
                2.0 * side.standard_uncertainty,
                fmt="o",
                ms=4,
                capsize=3,
                color=colour,
                label=name,
            )
        axes[1].legend(loc="best")
        axes[1].axhline(0.0, color=MUTED, lw=0.6)
        axes[1].set(
            xlabel="case temperature [°C]",
            ylabel="cooling − heating [°/h]",
            title="hysteresis: bars k = 2",
        )
    return figure


def _means(values: Array, group: int) -> Array:
    """Means of values [n] over whole groups, or the values themselves if no group is whole."""
    return chunks.block_means(values, group) if values.size >= group else values


def draw(title: str, fitted: Fitted[DriftReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages(replace(fitted.drawing, title=title))), fitted.summary)

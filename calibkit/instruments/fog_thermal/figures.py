"""Figures of a gyro's thermal run: logs, coefficients over temperature rate, residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.constants import SECONDS_PER_HOUR
from calibkit.numeric import chunks
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, SIDES, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.arrays import Array
    from calibkit.instruments import Fitted
    from calibkit.instruments.fog_thermal.numeric import published
    from calibkit.instruments.fog_thermal.numeric.drift_figures import NoiseSplit
    from calibkit.instruments.fog_thermal.numeric.hysteresis import Hysteresis


SHOWN, GAP_H = 12, 0.2
"""Logs in the figure of drift before and after, and hours between two of them."""
COEFFICIENTS = ("a0 [°/h]", "a1 [°/h/K]", "a2 [°/h/K²]")


@dataclass(frozen=True, slots=True)
class DriftLog:
    """Block means [n] of a log: time [s], case temperature [°C], raw, denoised and compensated
    indication [°/h].
    """

    name: str
    time: Array
    temperature: Array
    raw: Array
    denoised: Array
    compensated: Array


@dataclass(frozen=True, slots=True)
class TestedModel:
    """Drift rms on ramps left out of the fit of one model, raw and after compensation [°/h]."""

    name: str
    raw: float
    left: float
    split: NoiseSplit
    """Noise and drift in what is left."""
    exported: bool

    @property
    def share(self) -> float:
        """Ratio of the drift rms after compensation to raw [1]."""
        return self.left / self.raw


@dataclass(frozen=True, slots=True)
class DriftReport:
    """Data of all figures."""

    title: str
    interval_s: float
    logs: tuple[DriftLog, ...]
    ramps: tuple[published.RampFit, ...]
    polynomials: tuple[published.RatePolynomial, ...]
    tested: tuple[TestedModel, ...]
    polynomials_exported: bool = False
    hysteresis: tuple[tuple[str, Hysteresis], ...] = ()
    """Hysteresis curves and their labels."""
    noise: float = 0.0
    """What noise alone gives of the 100 s means (rms) [°/h]."""

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per model interval: the compensated indication about the
        mean of its log.
        """
        parts = {
            "run": [np.full(log.time.size, log.name, dtype=object) for log in self.logs],
            "time_s": [log.time for log in self.logs],
            "temp_case_degc": [log.temperature for log in self.logs],
            "gyro_dph": [log.raw for log in self.logs],
            "residual_dph": [log.compensated - log.compensated.mean() for log in self.logs],
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
    for number, log in enumerate(first_logs):
        passed = start + (log.time - log.time[0]) / SECONDS_PER_HOUR
        smooth, hours = log.denoised - log.denoised.mean(), _means(passed, group)
        legend = "denoised" if number == 0 else "_nolegend_"
        axes[0].plot(passed, smooth, color=DENOISED, lw=0.8, zorder=3, label=legend)
        curves = ((log.raw, RAW, 2.0, "before"), (log.compensated, GOOD, 1.2, "after"))
        for values, colour, width, label in curves:
            drift = _means(values - values.mean(), group)
            legend = label if number == 0 else "_nolegend_"
            axes[0].plot(hours, drift, color=colour, lw=width, label=legend)
        axes[1].plot(hours, _means(log.temperature, group), color=INK)
        start = float(hours[-1]) + GAP_H
    band = 2.0 * report.noise
    if band > 0.0:
        axes[0].axhspan(-band, band, color=DENOISED, alpha=0.2, lw=0, label="noise alone (k = 2)")
    axes[0].legend(loc="best", ncols=4)
    axes[0].set(
        ylabel="drift [°/h]", title="100 s means, each log about its mean, one log after the other"
    )
    axes[1].set(xlabel="time [h]", ylabel="case temperature [°C]")
    return figure


def _coefficients_page(report: DriftReport) -> Figure:
    """a_j over temperature rate with error bars (k = 2), the polynomials over their fitted ranges,
    and the test results.
    """
    figure, axes = page(
        2, 2, title=f"{report.title}: drift coefficients per {report.interval_s:g} s interval"
    )
    for j, ax in enumerate(axes[:3]):
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
    # each tested model's share of the raw drift on left-out ramps; raw is 1
    ax = axes[3]
    ordered = sorted(report.tested, key=lambda entry: -entry.share)
    ax.barh(
        [entry.name for entry in ordered],
        [min(entry.share, 3.0) for entry in ordered],
        color=[GOOD if entry.exported else RAW for entry in ordered],
        height=0.7,
    )
    for row, entry in enumerate(ordered):
        ax.text(
            min(entry.share, 3.0) + 0.03,
            row,
            f"{entry.share:.3g}",
            va="center",
            fontsize=8,
            color=INK,
        )
        ax.plot([entry.split.noise / entry.raw] * 2, [row - 0.35, row + 0.35], color=INK, lw=1.2)
    ax.axvline(1.0, color=ALERT, ls="--", lw=0.9)
    ax.set(
        xlabel="drift left on withheld ramps, share of raw (dashed: raw)",
        title="each ramp left out (green: exported, bar: noise alone)",
    )
    ax.set_xlim(0.0, 3.4)
    ax.grid(visible=False, axis="y")
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
    for log in report.logs:
        left = _means(log.compensated - log.compensated.mean(), group)
        colour = SIDES["heating" if log.temperature[-1] > log.temperature[0] else "cooling"]
        axes[0].plot(_means(log.temperature, group), left, color=colour, lw=0.9, alpha=0.8)
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

"""Figures of gyros on a rate table: scale-factor error against rate, K over temperature, γ with its
interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import ARCSECONDS_PER_DEGREE
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.arrays import Array


COLOURS = (DENOISED, ALERT, GOOD, "#aa3377", "#ccbb44", "#66ccee")
"""Of the runs in order; told apart by their markers too."""
MARKERS = "osD^v<>P"
PANELS = 3
"""Rows of panels on one page."""


@dataclass(frozen=True, slots=True)
class LineCurve:
    """One gyro in one run: held rates [p, °/s], residual and its standard uncertainty [p], relative
    deviation [p, ppm].
    """

    gyro: str
    run: str
    rate: Array
    residual_ppm: Array
    u_residual_ppm: Array
    deviation_ppm: Array
    u_deviation_ppm: Array


@dataclass(frozen=True, slots=True)
class TemperatureCurve:
    """K of one gyro [q, ppm from the reference] at temperatures [q, °C] and the polynomial with its
    uncertainty.
    """

    gyro: str
    temperature: Array
    K_ppm: Array
    u_ppm: Array
    grid: Array
    curve_ppm: Array
    u_curve_ppm: Array


@dataclass(frozen=True, slots=True)
class GammaPoint:
    """One determination of γ with its standard uncertainty."""

    name: str
    gamma: float
    standard_uncertainty: float


@dataclass(frozen=True, slots=True)
class PairAngle:
    """γ as indicated, by both gyros, and α with its 95 % interval [°]."""

    points: tuple[GammaPoint, ...]
    alpha_deg: float
    interval_deg: tuple[float, float]
    side: str


@dataclass(frozen=True, slots=True)
class GyroReport:
    """All that the figures show."""

    lines: tuple[LineCurve, ...]
    temperatures: tuple[TemperatureCurve, ...]
    pair: PairAngle | None


def pages(title: str, report: GyroReport) -> list[Figure]:
    """Scale-factor error of every gyro, K over temperature where it varies, γ of a pair."""
    gyros = list(dict.fromkeys(line.gyro for line in report.lines))
    figures = [
        error_page(title, report, gyros[start : start + PANELS])
        for start in range(0, len(gyros), PANELS)
    ]
    if report.temperatures:
        figures.append(temperature_page(title, report.temperatures))
    if report.pair is not None:
        figures.append(gamma_page(title, report.pair))
    return figures


def error_page(title: str, report: GyroReport, gyros: list[str]) -> Figure:
    """Residuals of the line over full scale, and the relative deviation of each rate, one row a
    gyro.
    """
    figure, axes = page(
        len(gyros),
        2,
        title=f"{title}: scale-factor error against rate",
        height=1.4 + 3.3 * len(gyros),
    )
    for row, gyro in enumerate(gyros):
        lines = [line for line in report.lines if line.gyro == gyro]
        left, right = axes[2 * row], axes[2 * row + 1]
        for k, line in enumerate(lines):
            colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
            bars: Any = {
                "ms": 3.5,
                "capsize": 2,
                "elinewidth": 0.7,
                "alpha": 0.85,
                "color": colour,
                "marker": marker,
            }
            order = np.argsort(line.rate)
            bar = 2.0 * line.u_residual_ppm[order]
            left.errorbar(
                line.rate[order], line.residual_ppm[order], bar, label=line.run, lw=0.8, **bars
            )
            for side, fill in ((line.rate > 0.0, colour), (line.rate < 0.0, "white")):
                turning = np.flatnonzero(side & np.isfinite(line.deviation_ppm))
                bar = 2.0 * line.u_deviation_ppm[turning]
                right.errorbar(
                    np.abs(line.rate[turning]),
                    line.deviation_ppm[turning],
                    bar,
                    ls="",
                    markerfacecolor=fill,
                    **bars,
                )
        for ax in (left, right):
            ax.axhline(0.0, color=MUTED, lw=0.6)
        left.set(title=f"gyro {gyro}: (F - F_fit)/max|F|, bars k = 2", ylabel="[ppm of full scale]")
        left.set_xlabel("table rate [°/s]")
        right.set(
            title=f"gyro {gyro}: (F - F_fit)/|K·rate|, bars k = 2", ylabel="[ppm of the rate]"
        )
        right.set_xlabel("|table rate| [°/s], negative rates open")
        right.set_xscale("log")
        right.xaxis.set_major_formatter("{x:g}")
        _decades(right, lines)
        low, high = left.get_ylim()
        left.set_ylim(low, high + 0.12 * (high - low) * -(-len(lines) // 3))
        left.legend(loc="upper center", ncols=3)
    return figure


def _decades(ax: Axes, lines: list[LineCurve]) -> None:
    """Scale that shows both the few ppm of fast rates and the noise of slow ones, with round
    labels.
    """
    reach = max(
        float(np.nanmax(np.abs(line.deviation_ppm) + 2.0 * line.u_deviation_ppm)) for line in lines
    )
    if reach < 20.0:
        return
    ax.set_yscale("symlog", linthresh=10.0)
    ticks = [10.0**k for k in range(1, int(np.ceil(np.log10(reach))) + 1)]
    ax.set_yticks([-tick for tick in reversed(ticks)] + [0.0, *ticks])
    ax.set_yticklabels([f"{tick:g}" for tick in [-t for t in reversed(ticks)] + [0.0, *ticks]])
    ax.minorticks_off()


def temperature_page(title: str, curves: tuple[TemperatureCurve, ...]) -> Figure:
    """K of every run over case temperature with the polynomial, and what it leaves, one row a
    gyro.
    """
    rows = len(curves)
    figure, axes = page(
        rows, 2, title=f"{title}: scale factor over temperature", height=1.4 + 3.4 * rows
    )
    for row, curve in enumerate(curves):
        left, right = axes[2 * row], axes[2 * row + 1]
        left.plot(curve.grid, curve.curve_ppm, color=GOOD, label="polynomial")
        left.plot(curve.temperature, curve.K_ppm, "o", ms=4, color=DENOISED, label="runs")
        residual = curve.K_ppm - np.interp(curve.temperature, curve.grid, curve.curve_ppm)
        band = 2.0 * curve.u_curve_ppm
        right.fill_between(
            curve.grid, -band, band, color=RAW, alpha=0.5, lw=0, label="polynomial, k = 2"
        )
        right.errorbar(
            curve.temperature,
            residual,
            2.0 * curve.u_ppm,
            fmt="o",
            ms=4,
            capsize=3,
            color=DENOISED,
            label="runs, k = 2",
        )
        for ax in (left, right):
            ax.axhline(0.0, color=MUTED, lw=0.6)
            ax.set_xlabel("case temperature [°C]")
            ax.legend(loc="best")
        left.set(title=f"gyro {curve.gyro}", ylabel="K/K_reference - 1 [ppm]")
        right.set(title=f"gyro {curve.gyro}: K - polynomial", ylabel="[ppm]")
    return figure


def gamma_page(title: str, pair: PairAngle) -> Figure:
    """γ by both gyros with 95 % bars about the first, and α with its interval."""
    figure, axes = page(1, 2, title=f"{title}: gamma and alpha, {pair.side} side", height=4.6)
    left, right = axes
    first = pair.points[0].gamma
    for k, point in enumerate(pair.points):
        offset = (point.gamma - first) * 1e6
        left.errorbar(
            k,
            offset,
            1.96e6 * point.standard_uncertainty,
            fmt="o",
            ms=6,
            capsize=5,
            color=COLOURS[k],
        )
        text = f"{point.gamma:.8f} ± {point.standard_uncertainty:.1e}"
        left.annotate(
            text, (k, offset), xytext=(9, 6), textcoords="offset points", color=INK, fontsize=8
        )
    left.axhline(0.0, color=MUTED, lw=0.6)
    left.set_xticks(range(len(pair.points)), [point.name for point in pair.points])
    left.set_xlim(-0.4, len(pair.points) - 0.2)
    left.set(title=f"gamma from {first:.8f}, bars 95 %", ylabel="[1e-6]")
    low, high = pair.interval_deg
    right.errorbar(
        0.0,
        0.0,
        xerr=[
            [(pair.alpha_deg - low) * ARCSECONDS_PER_DEGREE],
            [(high - pair.alpha_deg) * ARCSECONDS_PER_DEGREE],
        ],
        fmt="D",
        ms=6,
        capsize=6,
        color=DENOISED,
    )
    right.set_yticks([])
    right.set(
        title=f"alpha {pair.alpha_deg:.6f}°, 95 % {low:.6f}° to {high:.6f}°",
        xlabel='from alpha ["]',
    )
    right.set_ylim(-1.0, 1.0)
    return figure

"""Figures of gyros on a rate table: scale-factor error against rate, K over temperature, γ with its
interval, angles and misalignment of input axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import ARCSECONDS_PER_DEGREE
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.numeric import gum
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.instruments import Fitted
    from calibkit.instruments.gyro_scale.curves import (
        Curve,
        GyroReport,
        LineCurve,
    )
    from calibkit.instruments.gyro_scale.numeric.pair import GyroPair

COLOURS = (DENOISED, ALERT, GOOD, "#aa3377", "#ccbb44", "#66ccee")
"""Colours of the runs in order; markers distinguish them too."""
MARKERS = "osD^v<>P"
PANELS = 3
"""Rows of panels on one page."""


def draw_pages(title: str, report: GyroReport) -> tuple[Figure, ...]:
    """K over temperature where it varies, which shows the verdict, scale-factor error of every
    gyro, γ of a pair, input axes of a triad.
    """
    gyros = list(dict.fromkeys(line.gyro for line in report.lines))
    figures = [
        _draw_errors(title, report.lines, gyros[start : start + PANELS])
        for start in range(0, len(gyros), PANELS)
    ]
    if report.temperatures:
        figures.insert(0, _draw_temperatures(title, report.temperatures))
    if report.pair is not None:
        figures.append(_draw_gamma(title, report.pair))
    if report.misalignment:
        figures.append(_draw_axes(title, report))
    return tuple(figures)


def _mark(number: int) -> tuple[str, str]:
    """Colour and marker of the series with an index."""
    return COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]


def _draw_errors(title: str, lines: tuple[LineCurve, ...], gyros: list[str]) -> Figure:
    """Residuals of the line in ppm of full scale, and relative deviation at each rate, one row of
    panels per gyro.
    """
    figure, axes = page(
        len(gyros),
        2,
        title=f"{title}: scale-factor error against rate",
        height=1.4 + 3.3 * len(gyros),
    )
    for row, gyro in enumerate(gyros):
        own = [line for line in lines if line.gyro == gyro]
        left, right = axes[2 * row], axes[2 * row + 1]
        for k, line in enumerate(own):
            _draw_line(left, right, line, k)
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
        _set_decades(right, own)
        low, high = left.get_ylim()
        left.set_ylim(low, high + 0.12 * (high - low) * -(-len(own) // 3))
        left.legend(loc="upper center", ncols=3)
    return figure


def _draw_line(left: Axes, right: Axes, line: LineCurve, number: int) -> None:
    """Draw the errors of one run: left in ppm of full scale, right in ppm of each rate."""
    colour, marker = _mark(number)
    bars: Any = {
        "ms": 3.5,
        "capsize": 2,
        "elinewidth": 0.7,
        "alpha": 0.85,
        "color": colour,
        "marker": marker,
    }
    rate = line.line.rate_dps
    order = np.argsort(rate)
    residual, u_residual = line.of_full_scale_ppm
    left.errorbar(
        rate[order], residual[order], 2.0 * u_residual[order], label=line.run, lw=0.8, **bars
    )
    deviation, u_deviation = line.line.per_point_ppm, line.line.u_per_point_ppm
    for side, fill in ((rate > 0.0, colour), (rate < 0.0, "white")):
        turning = np.flatnonzero(side & np.isfinite(deviation))
        right.errorbar(
            np.abs(rate[turning]),
            deviation[turning],
            2.0 * u_deviation[turning],
            ls="",
            markerfacecolor=fill,
            **bars,
        )


def _set_decades(ax: Axes, lines: list[LineCurve]) -> None:
    """Set a scale that shows both the few ppm of fast rates and the noise of slow ones, with round
    tick labels.
    """
    reach = max(
        float(np.nanmax(np.abs(one.line.per_point_ppm) + 2.0 * one.line.u_per_point_ppm))
        for one in lines
    )
    if reach < 20.0:
        return
    ax.set_yscale("symlog", linthresh=10.0)
    ticks = [10.0**k for k in range(1, int(np.ceil(np.log10(reach))) + 1)]
    ax.set_yticks([-tick for tick in reversed(ticks)] + [0.0, *ticks])
    ax.set_yticklabels([f"{tick:g}" for tick in [-t for t in reversed(ticks)] + [0.0, *ticks]])
    ax.minorticks_off()


def _draw_temperatures(title: str, curves: tuple[Curve, ...]) -> Figure:
    """K of every run against case temperature with the fitted polynomial, and its residuals, one
    row of panels per gyro.
    """
    rows = len(curves)
    figure, axes = page(
        rows, 2, title=f"{title}: scale factor over temperature", height=1.4 + 3.4 * rows
    )
    for row, curve in enumerate(curves):
        left, right = axes[2 * row], axes[2 * row + 1]
        left.plot(curve.grid, curve.curve, color=GOOD, label="polynomial")
        left.plot(curve.temperature, curve.value, "o", ms=4, color=DENOISED, label="runs")
        residual = curve.value - np.interp(curve.temperature, curve.grid, curve.curve)
        band = curve.coverage_factor * curve.u_curve
        right.fill_between(curve.grid, -band, band, color=RAW, alpha=0.5, lw=0)
        right.errorbar(
            curve.temperature,
            residual,
            2.0 * curve.standard_uncertainty,
            fmt="o",
            ms=4,
            capsize=3,
            color=DENOISED,
        )
        for ax in (left, right):
            ax.axhline(0.0, color=MUTED, lw=0.6)
            ax.set_xlabel("case temperature [°C]")
        left.legend(loc="best")
        left.set(title=f"gyro {curve.name}", ylabel="K/K_reference - 1 [ppm]")
        right.set(title=f"gyro {curve.name}: band U, bars k = 2", ylabel="K - polynomial [ppm]")
    return figure


def _draw_gamma(title: str, pair: GyroPair) -> Figure:
    """Both estimates of γ with 95 % bars relative to the first, and α with its interval."""
    figure, (left, right) = page(
        1, 2, title=f"{title}: gamma and alpha, {pair.side} side", height=4.6
    )
    first = pair.gamma_indicated
    points = {
        "B about A's axis": (first, float(pair.standard_uncertainty[2])),
        "A about B's axis": (float(pair.gamma_from_a.value), float(pair.gamma_from_a.u)),
    }
    factor = gum.coverage_factor(pair.dof[2], probability=0.95)
    for k, (gamma, u) in enumerate(points.values()):
        offset = (gamma - first) * PPM
        bar = factor * PPM * u
        left.errorbar(k, offset, bar, fmt="o", ms=6, capsize=5, color=COLOURS[k])
        text = f"{gamma:.8f} ± {u:.1e}"
        left.annotate(
            text, (k, offset), xytext=(9, 6), textcoords="offset points", color=INK, fontsize=8
        )
    left.axhline(0.0, color=MUTED, lw=0.6)
    left.set_xticks(range(len(points)), list(points))
    left.set_xlim(-0.4, len(points) - 0.2)
    left.set(title=f"gamma from {first:.8f}, bars 95 %", ylabel="[1e-6]")
    low, high = pair.alpha_interval_deg
    reach = [
        [(pair.alpha_deg - low) * ARCSECONDS_PER_DEGREE],
        [(high - pair.alpha_deg) * ARCSECONDS_PER_DEGREE],
    ]
    right.errorbar(0.0, 0.0, xerr=reach, fmt="D", ms=6, capsize=6, color=DENOISED)
    right.set_yticks([])
    right.set(
        title=f"alpha {pair.alpha_deg:.6f}°, 95 % {low:.6f}° to {high:.6f}°",
        xlabel='from alpha ["]',
    )
    right.set_ylim(-1.0, 1.0)
    return figure


def _draw_axes(title: str, report: GyroReport) -> Figure:
    """Angles between input axes, and components of the input axes across their main axes."""
    figure, (left, right) = page(1, 2, title=f"{title}: input axes", height=5.2)
    _draw_sets(left, report.angles)
    left.set(title="90° - angle between input axes, bars U", ylabel="[°]")
    _draw_sets(right, report.misalignment)
    right.set(title="input axes across their main axis, bars U", ylabel="[mrad]")
    return figure


def _draw_sets(ax: Axes, curves: tuple[Curve, ...]) -> None:
    """Values with uncertainty bars against temperature, or side by side at a single temperature."""
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
    single = curves[0].temperature.size == 1
    for k, one in enumerate(curves):
        colour, marker = _mark(k)
        where = np.array([float(k)]) if single else one.temperature
        bar = one.coverage_factor * one.standard_uncertainty
        order = np.argsort(where)
        points = where[order], one.value[order], bar[order]
        ax.errorbar(*points, marker=marker, ms=5, lw=0.9, capsize=4, color=colour, label=one.name)
    if single:
        ax.set_xticks(range(len(curves)), [one.name for one in curves])
        ax.set_xlim(-0.6, len(curves) - 0.4)
    else:
        ax.set_xlabel("case temperature [°C]")
        ax.margins(y=0.25)
        ax.legend(loc="upper center", ncols=3)


def draw(title: str, fitted: Fitted[GyroReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(draw_pages(title, fitted.drawing), fitted.summary)

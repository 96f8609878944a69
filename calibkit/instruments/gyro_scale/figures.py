"""Figures of gyros on a rate table: scale-factor error against rate, K over temperature, γ with its
interval, angles and misalignment of input axes.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.constants import ARCSECONDS_PER_DEGREE
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.published import PPM
from calibkit.numeric import gum
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.arrays import Array
    from calibkit.coefficients import Coefficient, Model
    from calibkit.instruments import Fitted
    from calibkit.instruments.gyro_scale.campaign import AxesSet, Campaign, Channel
    from calibkit.instruments.gyro_scale.published import Line

    RunLine = tuple[Channel, str, Line]
    """A gyro, the name of a run, and the published line of both."""

COLOURS = (DENOISED, ALERT, GOOD, "#aa3377", "#ccbb44", "#66ccee")
"""Colours of the runs in order; markers distinguish them too."""
MARKERS = "osD^v<>P"
PANELS = 3
"""Rows of panels on one page."""
MRAD = 1e3


def draw(title: str, fitted: Fitted[Campaign]) -> Drawn:
    """Figures and summary of a fit: K over temperature where it varies, which shows the verdict,
    scale-factor error of every gyro, γ of a pair, input axes of a triad.
    """
    campaign = fitted.drawing
    lines = [(channel, run.log.name, line) for channel, run, line in campaign.own_lines()]
    gyros = [channel.gyro for channel in campaign.own]
    figures = [
        _draw_errors(title, lines, gyros[start : start + PANELS])
        for start in range(0, len(gyros), PANELS)
    ]
    if any(channel.curves for channel in campaign.own):
        figures.insert(0, _draw_temperatures(title, campaign))
    if campaign.pair is not None:
        figures.append(_draw_gamma(title, campaign.pair, campaign.pair_figures))
    if campaign.sets:
        figures.append(_draw_axes(title, campaign))
    return Drawn(tuple(figures), fitted.summary)


def _mark(number: int) -> tuple[str, str]:
    """Colour and marker of the series with an index."""
    return COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]


def _draw_errors(title: str, lines: Sequence[RunLine], gyros: Sequence[str]) -> Figure:
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
        own = [(run, line) for channel, run, line in lines if channel.gyro == gyro]
        left, right = axes[2 * row], axes[2 * row + 1]
        for k, (run, line) in enumerate(own):
            _draw_line(left, right, run, line, _mark(k))
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
        _set_decades(right, [line for _, line in own])
        low, high = left.get_ylim()
        left.set_ylim(low, high + 0.12 * (high - low) * -(-len(own) // 3))
        left.legend(loc="upper center", ncols=3)
    return figure


def _draw_line(left: Axes, right: Axes, run: str, line: Line, mark: tuple[str, str]) -> None:
    """Draw the errors of one run: left in ppm of full scale, right in ppm of each rate."""
    colour, marker = mark
    bars: Any = {
        "ms": 3.5,
        "capsize": 2,
        "elinewidth": 0.7,
        "alpha": 0.85,
        "color": colour,
        "marker": marker,
    }
    rate = line.rate_dps
    order = np.argsort(rate)
    residual, u_residual = line.of_full_scale_ppm
    left.errorbar(rate[order], residual[order], 2.0 * u_residual[order], label=run, lw=0.8, **bars)
    deviation, u_deviation = line.per_point_ppm, line.u_per_point_ppm
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


def _set_decades(ax: Axes, lines: Sequence[Line]) -> None:
    """Set a scale that shows both the few ppm of fast rates and the noise of slow ones, with round
    tick labels.
    """
    reach = max(
        float(np.nanmax(np.abs(line.per_point_ppm) + 2.0 * line.u_per_point_ppm)) for line in lines
    )
    if reach < 20.0:
        return
    ax.set_yscale("symlog", linthresh=10.0)
    ticks = [10.0**k for k in range(1, int(np.ceil(np.log10(reach))) + 1)]
    ax.set_yticks([-tick for tick in reversed(ticks)] + [0.0, *ticks])
    ax.set_yticklabels([f"{tick:g}" for tick in [-t for t in reversed(ticks)] + [0.0, *ticks]])
    ax.minorticks_off()


def _draw_temperatures(title: str, campaign: Campaign) -> Figure:
    """K of every run against case temperature with the fitted polynomial, and its residuals, one
    row of panels per gyro.
    """
    channels = [channel for channel in campaign.own if channel.curves]
    rows = len(channels)
    figure, axes = page(
        rows, 2, title=f"{title}: scale factor over temperature", height=1.4 + 3.4 * rows
    )
    for row, channel in enumerate(channels):
        left, right = axes[2 * row], axes[2 * row + 1]
        fit = channel.curves[0]
        grid = np.linspace(*fit.valid[forms.TEMPERATURE], 101)
        at = {forms.TEMPERATURE: grid}
        curve, u_curve = POLYNOMIAL.evaluate(fit, at), POLYNOMIAL.standard_uncertainty(fit, at)
        temperature = np.array([run.temp_degc for run in channel.runs])
        K = campaign.run_lines.of_runs(channel.runs, channel.gyro)
        if channel.mean is not None:
            reference = channel.mean.value("K")
        else:
            reference = campaign.reference.model.value(f"S_{channel.gyro}{channel.axis}")
        ppm = PPM / reference
        left.plot(grid, (curve - reference) * ppm, color=GOOD, label="polynomial")
        left.plot(temperature, (K.value - reference) * ppm, "o", ms=4, color=DENOISED, label="runs")
        residual = (K.value - np.interp(temperature, grid, curve)) * ppm
        band = gum.coverage_factor(fit.dof) * u_curve * abs(ppm)
        right.fill_between(grid, -band, band, color=RAW, alpha=0.5, lw=0)
        right.errorbar(
            temperature,
            residual,
            2.0 * K.u * abs(ppm),
            fmt="o",
            ms=4,
            capsize=3,
            color=DENOISED,
        )
        for ax in (left, right):
            ax.axhline(0.0, color=MUTED, lw=0.6)
            ax.set_xlabel("case temperature [°C]")
        left.legend(loc="best")
        left.set(title=f"gyro {channel.gyro}", ylabel="K/K_reference - 1 [ppm]")
        right.set(title=f"gyro {channel.gyro}: band U, bars k = 2", ylabel="K - polynomial [ppm]")
    return figure


def _draw_gamma(title: str, pair: Model, figures: Sequence[Coefficient]) -> Figure:
    """Both estimates of γ with 95 % bars relative to the first, and α with its interval."""
    _, _, gamma_of_pair, alpha = pair.coefficients
    side = "same" if gamma_of_pair.value >= 0.0 else "opposite"
    figure, (left, right) = page(1, 2, title=f"{title}: gamma and alpha, {side} side", height=4.6)
    of_pair = {one.name: one for one in figures}
    about_a, about_b = of_pair["gamma_indicated"], of_pair["gamma_from_a_about_b"]
    first = about_a.value
    points = {
        "B about A's axis": (first, about_a.standard_uncertainty),
        "A about B's axis": (about_b.value, about_b.standard_uncertainty),
    }
    factor = gum.coverage_factor(pair.dof_of(gamma_of_pair), probability=0.95)
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
    low, high = of_pair["alpha_low_95_deg"].value, of_pair["alpha_high_95_deg"].value
    reach = [
        [(alpha.value - low) * ARCSECONDS_PER_DEGREE],
        [(high - alpha.value) * ARCSECONDS_PER_DEGREE],
    ]
    right.errorbar(0.0, 0.0, xerr=reach, fmt="D", ms=6, capsize=6, color=DENOISED)
    right.set_yticks([])
    right.set(
        title=f"alpha {alpha.value:.6f}°, 95 % {low:.6f}° to {high:.6f}°",
        xlabel='from alpha ["]',
    )
    right.set_ylim(-1.0, 1.0)
    return figure


def _draw_axes(title: str, campaign: Campaign) -> Figure:
    """Angles between input axes, and components of the input axes across their main axes."""
    figure, (left, right) = page(1, 2, title=f"{title}: input axes", height=5.2)
    sets, own = campaign.sets, campaign.own
    angles: dict[str, Array] = {}
    for g, h in combinations([channel.gyro for channel in own], 2):
        errors = [one.figures[f"orthogonality_error_deg.{g}_{h}"] for one in sets]
        factor = gum.coverage_factor(min(error.effective_dof or np.inf for error in errors))
        angles[f"{g}, {h}"] = np.array(
            [(error.value, factor * error.standard_uncertainty) for error in errors]
        )
    _draw_sets(left, sets, angles)
    left.set(title="90° - angle between input axes, bars U", ylabel="[°]")
    across: dict[str, Array] = {}
    for channel in own:
        for axis in forms.AXES:
            if axis != channel.axis:
                shares = [one.figures[f"misalignment.{channel.gyro}{axis}"] for one in sets]
                across[f"{channel.gyro} to {axis}"] = MRAD * np.array(
                    [(share.value, 2.0 * share.standard_uncertainty) for share in shares]
                )
    _draw_sets(right, sets, across)
    right.set(title="input axes across their main axis, bars U", ylabel="[mrad]")
    return figure


def _draw_sets(ax: Axes, sets: Sequence[AxesSet], series: dict[str, Array]) -> None:
    """Values and bars [sets, 2] by name against temperature, or side by side at a single
    temperature.
    """
    ax.axhline(0.0, color=MUTED, lw=0.6)
    if not series:
        ax.text(
            0.5,
            0.5,
            "one gyro: nothing to compare",
            transform=ax.transAxes,
            ha="center",
            color=MUTED,
        )
        return
    single = len(sets) == 1
    for k, (name, values) in enumerate(series.items()):
        colour, marker = _mark(k)
        where = np.array([float(k)]) if single else np.array([one.temp_degc for one in sets])
        order = np.argsort(where)
        points = where[order], values[order, 0], values[order, 1]
        ax.errorbar(*points, marker=marker, ms=5, lw=0.9, capsize=4, color=colour, label=name)
    if single:
        ax.set_xticks(range(len(series)), list(series))
        ax.set_xlim(-0.6, len(series) - 0.4)
    else:
        ax.set_xlabel("case temperature [°C]")
        ax.margins(y=0.25)
        ax.legend(loc="upper center", ncols=3)

"""Figures of gyros on a rate table, panels for each gyro: what the held rates leave of the
best straight line, and K over temperature with what the runs leave of it.

    (F_j − F̂_j)/max |F_j|,   F̂_j = K Ω_j + F0                                 (`published`, (1))

Angles between gyros, a value each at a temperature, stand in the tables alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.published import PPM
from calibkit.numeric import gum
from calibkit.records.forms import POLYNOMIAL
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, MUTED, RAW, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from calibkit.instruments import Fitted
    from calibkit.instruments.gyro_scale.coefficient_files import CampaignFit, Channel
    from calibkit.instruments.gyro_scale.published import Line
    from calibkit.instruments.gyro_scale.table_runs import TableRun

COLOURS = (DENOISED, ALERT, GOOD, "#aa3377", "#ccbb44", "#66ccee")
"""Colours of the runs in order; markers distinguish them too."""
MARKERS = "osD^v<>P"
PANELS = 3
"""Rows of panels on one page."""


def draw(title: str, fitted: Fitted[CampaignFit]) -> Drawn:
    """Figures and summary of a fit: K over temperature first where it varies, as it shows the
    verdict.
    """
    campaign = fitted.drawing
    figures = []
    if any(channel.curves for channel in campaign.own_channels):
        figures.append(_draw_temperatures(title, campaign))
    lines = [*campaign.own_lines()]
    for start in range(0, len(campaign.own_channels), PANELS):
        gyros = [channel.gyro for channel in campaign.own_channels[start : start + PANELS]]
        figures.append(_draw_errors(title, lines, gyros))
    return Drawn(tuple(figures), fitted.summary)


def _draw_errors(
    title: str, lines: Sequence[tuple[Channel, TableRun, Line]], gyros: Sequence[str]
) -> Figure:
    """Residuals of the lines in ppm of full scale."""
    height = 1.4 + 3.3 * len(gyros)
    title = f"{title}: scale-factor error against rate"
    figure, axes = page(len(gyros), 1, title=title, height=height)
    for gyro, ax in zip(gyros, axes, strict=True):
        runs = [(run.log.name, line) for channel, run, line in lines if channel.gyro == gyro]
        for k, (run, line) in enumerate(runs):
            order, (residual, u) = np.argsort(line.rate_dps), line.of_full_scale_ppm
            ax.errorbar(
                line.rate_dps[order],
                residual[order],
                2.0 * u[order],
                label=run,
                color=COLOURS[k % len(COLOURS)],
                marker=MARKERS[k % len(MARKERS)],
                ms=3.5,
                lw=0.8,
                elinewidth=0.7,
                alpha=0.85,
            )
        ax.axhline(0.0, color=MUTED, lw=0.6)
        ax.set(title=f"gyro {gyro}: (F - F_fit)/max|F|, bars k = 2", ylabel="[ppm of full scale]")
        ax.set_xlabel("table rate [°/s]")
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.12 * (high - low) * -(-len(runs) // 3))
        ax.legend(loc="upper center", ncols=3)
    return figure


def _draw_temperatures(title: str, campaign: CampaignFit) -> Figure:
    """K of every run against case temperature with the fitted polynomial, and its residuals."""
    channels = [channel for channel in campaign.own_channels if channel.curves]
    height = 1.4 + 3.4 * len(channels)
    title = f"{title}: scale factor over temperature"
    figure, axes = page(len(channels), 2, title=title, height=height)
    for channel, left, right in zip(channels, axes[::2], axes[1::2], strict=True):
        polynomial = channel.curves[0]
        grid = np.linspace(*polynomial.valid[forms.TEMPERATURE], 101)
        inputs = {forms.TEMPERATURE: grid}
        curve = POLYNOMIAL.evaluate(polynomial, inputs)
        temperature = np.array([run.temp_degc for run in channel.runs])
        K = campaign.run_lines.of_runs(channel.runs, channel.gyro)
        if channel.mean is not None:
            reference = channel.mean.value("K")
        else:
            reference = campaign.reference.model.value(f"S_{channel.gyro}{channel.axis}")
        ppm = PPM / reference
        left.plot(grid, (curve - reference) * ppm, color=GOOD, label="polynomial")
        left.plot(temperature, (K.value - reference) * ppm, "o", ms=4, color=DENOISED, label="runs")
        u_curve = POLYNOMIAL.standard_uncertainty(polynomial, inputs)
        U = gum.coverage_factor(polynomial.dof) * u_curve * abs(ppm)
        right.fill_between(grid, -U, U, color=RAW, alpha=0.5, lw=0)
        residual, bar = (K.value - np.interp(temperature, grid, curve)) * ppm, 2.0 * K.u * abs(ppm)
        right.errorbar(temperature, residual, bar, fmt="o", ms=4, capsize=3, color=DENOISED)
        for ax in (left, right):
            ax.axhline(0.0, color=MUTED, lw=0.6)
            ax.set_xlabel("case temperature [°C]")
        left.legend(loc="best")
        left.set(title=f"gyro {channel.gyro}", ylabel="K/K_reference - 1 [ppm]")
        right.set(title=f"gyro {channel.gyro}: band U, bars k = 2", ylabel="K - polynomial [ppm]")
    return figure

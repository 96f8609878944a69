"""Figures of biases over temperature: logs before and after compensation, coefficients over the
rate of ramps, residuals, polynomials against their abscissa.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.numeric import chunks
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.numeric.dispersion import rms
from calibkit.records.frame import share_unit
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, INK, MUTED, RAW, SIDES, page
from calibkit.units import column_unit, unit_mark

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from calibkit.instruments import Fitted
    from calibkit.instruments.bias.at_rest import Hysteresis
    from calibkit.instruments.bias.compensate import LogFigures
    from calibkit.instruments.bias.numeric import published
    from calibkit.instruments.bias.power_ons import PowerOn
    from calibkit.instruments.bias.ramps import PreparedLog
    from calibkit.numeric.arrays import Array


ON_A_PAGE = 3
"""Channels of one page of terms, and polynomials side by side."""
MOST_POINTS = 1500
"""Points of one curve."""


@dataclass(frozen=True, slots=True)
class BiasCurve:
    """One channel: bin means of the indication over the abscissa, and the polynomial there."""

    name: str
    abscissa: Array
    indication: Array
    polynomial: Array


@dataclass(frozen=True, slots=True)
class BiasReport:
    """All that the figures of polynomials show."""

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
        channel_units = (column_unit(curve.name) for curve in self.curves)
        units = share_unit(("indication", "residual"), channel_units)
        return {name: np.concatenate(columns) for name, columns in parts.items()} | {"units": units}

    def pages(self, title: str) -> list[Figure]:
        """Up to three channels in a row, as many rows as it takes."""
        columns = min(ON_A_PAGE, len(self.curves))
        rows = -(-len(self.curves) // columns)
        heading, height = f"{title}: bias against {self.abscissa}", 1.2 + 2.6 * rows
        figure, axes = page(rows, columns, title=heading, height=height)
        for ax, curve in zip(axes, self.curves, strict=False):
            x, y = curve.abscissa, curve.indication
            ax.plot(x, y, ".", ms=3, color=RAW, label="means of the indication")
            ax.plot(x, curve.polynomial, color=GOOD, label="polynomial")
            ax.set(title=curve.name, xlabel=self.abscissa)
            ax.xaxis.label.set_color(INK)
        axes[0].legend(loc="best")
        for ax in axes[len(self.curves) :]:
            ax.set_visible(False)
        return [figure]


@dataclass(frozen=True, slots=True)
class ChannelCurves:
    """One channel: its indication and what the model leaves of it [n] in each power-on, about the
    turn-on bias.
    """

    name: str
    unit: str
    raw: tuple[Array, ...]
    left: tuple[Array, ...]


@dataclass(frozen=True, slots=True)
class ThermalReport:
    """All that the figures of terms show."""

    power_ons: tuple[PowerOn, ...]
    channels: tuple[ChannelCurves, ...]

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per model interval: what the model leaves of each
        channel, about the turn-on bias.
        """
        blocks = [power_on.blocks for power_on in self.power_ons]
        numbers = [np.full(log.time.size, k) for k, log in enumerate(blocks, start=1)]
        columns = {
            "power_on": np.concatenate(numbers),
            "time_s": np.concatenate([log.time - log.time[0] for log in blocks]),
            "temp_case_degc": np.concatenate([log.case for log in blocks]),
            "withheld": np.concatenate([power_on.withheld for power_on in self.power_ons]),
        }
        left = {
            f"residual_{channel.name}": np.concatenate(channel.left) for channel in self.channels
        }
        return {**columns, **left}

    def pages(self, title: str) -> list[Figure]:
        """Pages of three channels each, with the temperature below."""
        starts = range(0, len(self.channels), ON_A_PAGE)
        return [self._page(title, self.channels[k : k + ON_A_PAGE]) for k in starts]

    def _page(self, title: str, channels: Sequence[ChannelCurves]) -> Figure:
        """One page: of each channel a panel over time, power-on after power-on, and one over
        temperature.
        """
        rows = len(channels) + 1
        heading, height = f"{title}: bias before and after compensation", 1.2 + 2.2 * rows
        figure, axes = page(rows, 2, title=heading, height=height)
        temperature_axes, start, courses = axes[2 * len(channels)], 0.0, []
        for power_on in self.power_ons:
            plotted_rows = slice(None, None, max(1, power_on.fitted.size // MOST_POINTS))
            minutes = (power_on.blocks.time - power_on.blocks.time[0]) / 60.0
            courses.append((plotted_rows, minutes[plotted_rows] + start, power_on))
            start += float(minutes[-1]) * 1.02
        for k, channel in enumerate(channels):
            over_time, over_temperature = axes[2 * k], axes[2 * k + 1]
            for number, (plotted_rows, minutes, power_on) in enumerate(courses):
                raw, left = channel.raw[number][plotted_rows], channel.left[number][plotted_rows]
                before, after = ("before", "after") if number == 0 else (None, None)
                for values, colour, label in ((raw, RAW, before), (left, GOOD, after)):
                    over_time.plot(minutes, values, color=colour, lw=0.8, label=label)
                    over_temperature.plot(
                        power_on.blocks.case[plotted_rows], values, ".", ms=2, color=colour
                    )
                withheld = power_on.withheld[plotted_rows]
                if withheld.any():
                    over_time.plot(
                        minutes[withheld], left[withheld], ".", ms=2, color=ALERT, label="withheld"
                    )
            unit = f"[{unit_mark(channel.unit)}]"
            over_time.set(
                title=channel.name, xlabel="time [min]", ylabel=f"less turn-on bias {unit}"
            )
            over_temperature.set(title=channel.name, xlabel="temperature [°C]")
        for plotted_rows, minutes, power_on in courses:
            temperature_axes.plot(minutes, power_on.blocks.case[plotted_rows], color=INK)
        temperature_axes.set(title="temperature", xlabel="time [min]", ylabel="temperature [°C]")
        axes[-1].set_visible(False)
        axes[0].legend(loc="best", ncols=3)
        return figure


def _means(values: Array, group: int) -> Array:
    """Means of values [n] over whole groups, or the values themselves if no group is whole."""
    return chunks.block_means(values, group) if values.size >= group else values


SHOWN, GAP_H = 12, 0.2
"""Logs in the figure of drift before and after, and hours between two of them."""
COEFFICIENTS = ("a0 [°/h]", "a1 [°/h/K]", "a2 [°/h/K²]")


@dataclass(frozen=True, slots=True)
class DriftReport:
    """All that the figures of ramps show."""

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

    def pages(self, title: str) -> list[Figure]:
        """Drift before and after, which shows the verdict, coefficients over rate, residuals."""
        return [self.before_after(title), self._coefficients(title), self._residuals(title)]

    def before_after(self, title: str) -> Figure:
        """Drift of the first logs before and after compensation and denoised, one log after the
        other, with what noise alone gives, above the case temperature.
        """
        first_logs = self.logs[:SHOWN]
        truncation = (
            f" (the first {SHOWN} of {len(self.logs)} logs)" if len(self.logs) > SHOWN else ""
        )
        figure, axes = page(
            2, 1, title=f"{title}: drift before and after compensation{truncation}", height=6.0
        )
        group, start = max(1, round(100.0 / self.interval_s)), 0.0
        for number, (log, compensated) in enumerate(
            zip(first_logs, self.compensated, strict=False)
        ):
            passed = start + (log.raw.time - log.raw.time[0]) / SECONDS_PER_HOUR
            smooth, hours = log.denoised.indication, _means(passed, group)
            legend = "denoised" if number == 0 else "_nolegend_"
            axes[0].plot(
                passed, smooth - smooth.mean(), color=DENOISED, lw=0.8, zorder=3, label=legend
            )
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
        band = 2.0 * rms([log.split.noise for log in self.compensated])
        if band > 0.0:
            axes[0].axhspan(
                -band, band, color=DENOISED, alpha=0.2, lw=0, label="noise alone (k = 2)"
            )
        axes[0].legend(loc="best", ncols=4)
        axes[0].set(
            ylabel="drift [°/h]",
            title="100 s means, each log about its mean, one log after the other",
        )
        axes[1].set(xlabel="time [h]", ylabel="case temperature [°C]")
        return figure

    def _coefficients(self, title: str) -> Figure:
        """a_j over temperature rate with error bars (k = 2), and the polynomials over their fitted
        ranges.
        """
        figure, axes = page(
            3, 1, title=f"{title}: drift coefficients per {self.interval_s:g} s interval"
        )
        for j, ax in enumerate(axes):
            for ramp in self.ramps:
                colour = SIDES["heating" if ramp.rate > 0.0 else "cooling"]
                ax.errorbar(
                    ramp.rate,
                    ramp.coefficients[j],
                    2.0 * np.sqrt(ramp.covariance[j, j]),
                    fmt="o",
                    ms=4,
                    capsize=3,
                    color=colour,
                )
            for polynomial in self.polynomials:
                rate, colour = np.linspace(*polynomial.rates, 101), SIDES[polynomial.side]
                a = polynomial.evaluate(rate)
                ax.plot(rate, a[:, j], color=colour, ls="-" if self.polynomials_exported else "--")
                ax.axvspan(*polynomial.rates, color=colour, alpha=0.06, lw=0)
            ax.axhline(0.0, color=MUTED, lw=0.6)
            ax.set(
                xlabel="temperature rate [°C/min]",
                ylabel=COEFFICIENTS[j],
                title=f"a{j}: bars k = 2, dashed: not exported",
            )
        return figure

    def _residuals(self, title: str) -> Figure:
        """Residuals after compensation (the mean of each log removed) over case temperature, and
        the hysteresis.
        """
        rows = 2 if self.hysteresis else 1
        figure, axes = page(
            rows,
            1,
            title=f"{title}: residual after compensation, 100 s means",
            height=2.8 * rows + 2.0,
        )
        group = max(1, round(100.0 / self.interval_s))
        for log, compensated in zip(self.logs, self.compensated, strict=True):
            case, output = log.raw.case, compensated.output
            left = _means(output - output.mean(), group)
            colour = SIDES["heating" if case[-1] > case[0] else "cooling"]
            axes[0].plot(_means(case, group), left, color=colour, lw=0.9, alpha=0.8)
        axes[0].set(
            xlabel="case temperature [°C]",
            ylabel="residual [°/h]",
            title="red: heating, blue: cooling",
        )
        if self.hysteresis:
            for (name, side), colour in zip(self.hysteresis, (RAW, DENOISED), strict=False):
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


def draw(title: str, fitted: Fitted[BiasReport | ThermalReport | DriftReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(fitted.drawing.pages(title)), fitted.summary)

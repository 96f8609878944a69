"""Figures of biases: polynomials against their abscissa; terms before and after compensation, over
time and over temperature.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.words import unit_mark
from calibkit.frame import share_unit
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, GOOD, INK, RAW, page
from calibkit.units import column_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from calibkit.arrays import Array, Mask
    from calibkit.instruments import Fitted

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
class Course:
    """One power-on: time [n, min], temperature [n, °C] and where [n] blocks were not fitted."""

    minutes: Array
    temperature: Array
    withheld: Mask


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

    courses: tuple[Course, ...]
    channels: tuple[ChannelCurves, ...]

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per model interval: what the model leaves of each
        channel, about the turn-on bias.
        """
        numbers = [
            np.full(course.minutes.size, k) for k, course in enumerate(self.courses, start=1)
        ]
        columns = {
            "power_on": np.concatenate(numbers),
            "time_s": np.concatenate([60.0 * course.minutes for course in self.courses]),
            "temp_case_degc": np.concatenate([course.temperature for course in self.courses]),
            "withheld": np.concatenate([course.withheld for course in self.courses]),
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
        starts = [0.0]
        for course in self.courses:
            starts.append(starts[-1] + float(course.minutes[-1]) * 1.02)
        for k, channel in enumerate(channels):
            over_time, over_temperature = axes[2 * k], axes[2 * k + 1]
            for number, course in enumerate(self.courses):
                plotted_rows = slice(None, None, max(1, course.minutes.size // MOST_POINTS))
                minutes = course.minutes[plotted_rows] + starts[number]
                raw, left = channel.raw[number][plotted_rows], channel.left[number][plotted_rows]
                before, after = ("before", "after") if number == 0 else (None, None)
                for values, colour, label in ((raw, RAW, before), (left, GOOD, after)):
                    over_time.plot(minutes, values, color=colour, lw=0.8, label=label)
                    over_temperature.plot(
                        course.temperature[plotted_rows], values, ".", ms=2, color=colour
                    )
                withheld = course.withheld[plotted_rows]
                if withheld.any():
                    over_time.plot(
                        minutes[withheld], left[withheld], ".", ms=2, color=ALERT, label="withheld"
                    )
            unit = f"[{unit_mark(channel.unit)}]"
            over_time.set(
                title=channel.name, xlabel="time [min]", ylabel=f"less turn-on bias {unit}"
            )
            over_temperature.set(title=channel.name, xlabel="temperature [°C]")
        temperature_axes = axes[2 * len(channels)]
        for course, start in zip(self.courses, starts, strict=False):
            plotted_rows = slice(None, None, max(1, course.minutes.size // MOST_POINTS))
            temperature_axes.plot(
                course.minutes[plotted_rows] + start, course.temperature[plotted_rows], color=INK
            )
        temperature_axes.set(title="temperature", xlabel="time [min]", ylabel="temperature [°C]")
        axes[-1].set_visible(False)
        axes[0].legend(loc="best", ncols=3)
        return figure


def draw(title: str, fitted: Fitted[BiasReport | ThermalReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(fitted.drawing.pages(title)), fitted.summary)

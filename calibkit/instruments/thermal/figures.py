"""Figures of biases before and after compensation, over time and over temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.certificate.words import unit_mark
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, GOOD, INK, RAW, page

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.arrays import Array, Mask
    from calibkit.instruments import Fitted

ON_A_PAGE = 3
"""Channels of one page."""
MOST_POINTS = 1500
"""Points of one curve."""


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
    """All that the figures show."""

    courses: tuple[Course, ...]
    channels: tuple[ChannelCurves, ...]

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per model interval: what the model leaves of each
        channel, about the turn-on bias.
        """
        numbers = [np.full(one.minutes.size, k) for k, one in enumerate(self.courses, start=1)]
        columns = {
            "power_on": np.concatenate(numbers),
            "time_s": np.concatenate([60.0 * one.minutes for one in self.courses]),
            "temp_case_degc": np.concatenate([one.temperature for one in self.courses]),
            "withheld": np.concatenate([one.withheld for one in self.courses]),
        }
        left = {f"residual_{one.name}": np.concatenate(one.left) for one in self.channels}
        return {**columns, **left}


def pages(title: str, report: ThermalReport) -> list[Figure]:
    """Pages of three channels each, with the temperature below."""
    starts = range(0, len(report.channels), ON_A_PAGE)
    return [_page(title, report, report.channels[k : k + ON_A_PAGE]) for k in starts]


def _page(title: str, report: ThermalReport, channels: Sequence[ChannelCurves]) -> Figure:
    """One page."""
    rows = len(channels) + 1
    figure, axes = page(
        rows, 2, title=f"{title}: bias before and after compensation", height=1.2 + 2.2 * rows
    )
    offsets = [0.0]
    for course in report.courses:
        offsets.append(offsets[-1] + float(course.minutes[-1]) * 1.02)
    for k, channel in enumerate(channels):
        _draw_channel(axes[2 * k], axes[2 * k + 1], channel, report.courses, offsets)
    below = axes[2 * len(channels)]
    for course, offset in zip(report.courses, offsets, strict=False):
        every = max(1, course.minutes.size // MOST_POINTS)
        below.plot(course.minutes[::every] + offset, course.temperature[::every], color=INK)
    below.set(title="temperature", xlabel="time [min]", ylabel="temperature [°C]")
    axes[-1].set_visible(False)
    axes[0].legend(loc="best", ncols=3)
    return figure


def _draw_channel(
    over_time: Axes,
    over_temperature: Axes,
    channel: ChannelCurves,
    courses: Sequence[Course],
    offsets: Sequence[float],
) -> None:
    """Both panels of one channel."""
    each = zip(courses, offsets, channel.raw, channel.left, strict=False)
    for k, (course, offset, raw, left) in enumerate(each):
        every = max(1, course.minutes.size // MOST_POINTS)
        minutes, temperature = course.minutes[::every] + offset, course.temperature[::every]
        first = k == 0
        for values, colour, label in ((raw, RAW, "before"), (left, GOOD, "after")):
            over_time.plot(
                minutes, values[::every], color=colour, lw=0.8, label=label if first else None
            )
            over_temperature.plot(temperature, values[::every], ".", ms=2, color=colour)
        out = course.withheld[::every]
        if out.any():
            over_time.plot(
                minutes[out], left[::every][out], ".", ms=2, color=ALERT, label="withheld"
            )
    unit = f"[{unit_mark(channel.unit)}]"
    over_time.set(title=channel.name, xlabel="time [min]", ylabel=f"less turn-on bias {unit}")
    over_temperature.set(title=channel.name, xlabel="temperature [°C]")


def draw(title: str, fitted: Fitted[ThermalReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages(title, fitted.drawing)), fitted.summary)

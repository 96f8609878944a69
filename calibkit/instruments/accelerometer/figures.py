"""Figures of a triad: residuals against temperature, coverage of the sphere, attitude errors before
and after.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.report.figures import ALERT, DENOISED, GOOD, MUTED, RAW, page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.arrays import Array


@dataclass(frozen=True, slots=True)
class TriadReport:
    """Dwells: temperature [n, °C], indication [n, 3, g], residual [n, 3 or 1, g], angle errors
    before and after [n, °].
    """

    temperature: Array
    indication: Array
    residual: Array
    inclination_before: Array
    inclination_after: Array
    toolface_before: Array
    toolface_after: Array
    inclination: Array
    toolface_range_deg: tuple[float, float]


def pages(title: str, report: TriadReport) -> list[Figure]:
    """Residuals and coverage, then the attitude errors where there is a reference attitude."""
    first = [residual_page(title, report)]
    return first if np.isnan(report.inclination).all() else [*first, attitude_page(title, report)]


def residual_page(title: str, report: TriadReport) -> Figure:
    """Residual of each component against temperature, and which attitudes were held."""
    figure, axes = page(2, 2, title=f"{title}: residual after correction, and the attitudes held")
    names = ("x", "y", "z") if report.residual.shape[1] == 3 else ("| |G| - g |",)
    for k, name in enumerate(names):
        axes[k].plot(report.temperature, 1e6 * report.residual[:, k], ".", ms=3, color=DENOISED)
        axes[k].axhline(0.0, color=MUTED, lw=0.6)
        axes[k].set(title=f"residual {name}", xlabel="case temperature [°C]", ylabel="[µg]")
    for ax in axes[len(names) : 3]:
        ax.set_visible(False)
    _coverage(axes[3], report.indication)
    return figure


def _coverage(ax: Axes, indication: Array) -> None:
    """Directions of gravity in the triad, equal-area: the sphere's poles are the top and bottom
    edges.
    """
    unit = indication / np.linalg.norm(indication, axis=1)[:, None]
    ax.plot(
        np.degrees(np.arctan2(unit[:, 1], unit[:, 0])),
        unit[:, 2],
        "o",
        ms=3,
        color=ALERT,
        alpha=0.5,
    )
    ax.set(xlim=(-190, 190), ylim=(-1.1, 1.1), title="attitudes held (equal-area)")
    ax.set(xlabel="direction of gravity about z [°]", ylabel="component along z")


def attitude_page(title: str, report: TriadReport) -> Figure:
    """Inclination and toolface errors before and after, against inclination and temperature."""
    low, high = report.toolface_range_deg
    figure, axes = page(2, 2, title=f"{title}: attitude errors before (grey) and after (green)")
    pairs = (
        ("inclination", report.inclination_before, report.inclination_after),
        (
            f"toolface ({low:g}-{high:g}° inclination)",
            report.toolface_before,
            report.toolface_after,
        ),
    )
    for row, (name, before, after) in enumerate(pairs):
        for column, (abscissa, label) in enumerate(
            ((report.inclination, "inclination [°]"), (report.temperature, "case temperature [°C]"))
        ):
            ax = axes[2 * row + column]
            ax.plot(abscissa, before, ".", ms=3, color=RAW)
            ax.plot(abscissa, after, ".", ms=3, color=GOOD)
            ax.set(title=f"{name} error", xlabel=label, ylabel="[°]")
            ax.set_yscale("symlog", linthresh=0.01)
    return figure

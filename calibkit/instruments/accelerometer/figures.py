"""Figures of a triad: residuals against temperature, coverage of attitudes on the sphere, attitude
errors before and after correction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.instruments.accelerometer import certificate
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, MUTED, RAW, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from calibkit.instruments import Fitted
    from calibkit.instruments.accelerometer.corrections import DwellErrors
    from calibkit.instruments.accelerometer.dwells import DwellSet
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe


@dataclass(frozen=True, slots=True)
class TriadReport:
    """Dwells with their errors before and after the correction that the recipe names."""

    dwells: DwellSet
    before: DwellErrors
    after: DwellErrors
    spec: AccelerometerRecipe

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per dwell: what the correction leaves of the components,
        or of the length, of gravity, and of the attitude.
        """
        dwells, left = self.dwells, self.after.residual
        names = ("x", "y", "z") if left.shape[1] == 3 else ("length",)
        columns: dict[str, Any] = {
            "dwell": dwells.place,
            "temp_case_degc": dwells.temperature,
            "inclination_deg": dwells.inclination,
            "toolface_deg": dwells.toolface,
            **{f"residual_{name}_g": left[:, k] for k, name in enumerate(names)},
        }
        if self.after.figures:
            columns["residual_inclination_deg"] = self.after.inclination_deg
            columns["residual_toolface_deg"] = self.after.toolface_deg
        return columns


def _draw_residuals(title: str, report: TriadReport) -> Figure:
    """Residual of each component against temperature, and the measured attitudes on an equal-area
    map.
    """
    figure, axes = page(2, 2, title=f"{title}: residual after correction, and the attitudes held")
    dwells, residual = report.dwells, report.after.residual
    names = ("x", "y", "z") if residual.shape[1] == 3 else ("|G| - g",)
    for k, name in enumerate(names):
        axes[k].plot(dwells.temperature, 1e6 * residual[:, k], ".", ms=3, color=DENOISED)
        axes[k].axhline(0.0, color=MUTED, lw=0.6)
        axes[k].set(title=f"residual {name}", xlabel="case temperature [°C]", ylabel="[µg]")
    for ax in axes[len(names) : 3]:
        ax.set_visible(False)
    # directions of gravity in the triad's frame, equal-area: the sphere's poles are top and bottom
    unit = dwells.indication / np.linalg.norm(dwells.indication, axis=1)[:, None]
    longitude_deg = np.degrees(np.arctan2(unit[:, 1], unit[:, 0]))
    axes[3].plot(longitude_deg, unit[:, 2], "o", ms=3, color=ALERT, alpha=0.5)
    axes[3].set(xlim=(-190, 190), ylim=(-1.1, 1.1), title="attitudes held (equal-area)")
    axes[3].set(xlabel="direction of gravity about z [°]", ylabel="component along z")
    return figure


def _draw_angles(title: str, report: TriadReport) -> Figure:
    """Inclination and toolface errors before and after correction, against inclination and
    temperature.
    """
    before, after = report.before, report.after
    low, high = report.spec.toolface_range_deg
    figure, axes = page(2, 2, title=f"{title}: attitude errors before (grey) and after (green)")
    toolface = f"toolface ({low:g}-{high:g}° inclination)"
    pairs = (
        ("inclination", before.inclination_deg, after.inclination_deg),
        (toolface, before.toolface_deg, after.toolface_deg),
    )
    abscissae = (
        (report.dwells.inclination, "inclination [°]"),
        (report.dwells.temperature, "case temperature [°C]"),
    )
    for row, (name, grey, green) in enumerate(pairs):
        for column, (abscissa, label) in enumerate(abscissae):
            ax = axes[2 * row + column]
            ax.plot(abscissa, grey, ".", ms=3, color=RAW)
            ax.plot(abscissa, green, ".", ms=3, color=GOOD)
            ax.set(title=f"{name} error", xlabel=label, ylabel="[°]")
            ax.set_yscale("symlog", linthresh=0.01)
    return figure


def draw(title: str, fitted: Fitted[TriadReport]) -> Drawn:
    """Page of attitude errors, which shows the verdict, where there is a reference attitude, page
    of residuals and coverage, and the summary with every result.
    """
    report = fitted.drawing
    results = tabulate_fit(fitted.results, report.spec, fitted.sensitivities, certificate.blocks)
    full_summary = replace(fitted.summary, tables=(*results, *fitted.summary.tables))
    residuals = _draw_residuals(title, report)
    if not report.after.figures:
        return Drawn((residuals,), full_summary)
    return Drawn((_draw_angles(title, report), residuals), full_summary)

"""Figures of a triad: residuals against temperature, coverage of attitudes on the sphere, attitude
errors before and after correction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.instruments.accelerometer import certificate
from calibkit.report.documents import Drawn
from calibkit.report.figures import ALERT, DENOISED, GOOD, MUTED, RAW, page

if TYPE_CHECKING:
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


def draw(title: str, fitted: Fitted[TriadReport]) -> Drawn:
    """Page of attitude errors, which shows the verdict, where there is a reference attitude, page
    of residuals and coverage, and the summary with every result.
    """
    report = fitted.drawing
    dwells, before, after = report.dwells, report.before, report.after
    results = tabulate_fit(fitted.results, report.spec, fitted.sensitivities, certificate.blocks)
    full_summary = replace(fitted.summary, tables=(*results, *fitted.summary.tables))

    # Residual of each component against temperature.
    residuals, axes = page(
        2, 2, title=f"{title}: residual after correction, and the attitudes held"
    )
    names = ("x", "y", "z") if after.residual.shape[1] == 3 else ("|G| - g",)
    for ax, name, residual in zip(axes, names, after.residual.T, strict=False):
        ax.plot(dwells.temperature, 1e6 * residual, ".", ms=3, color=DENOISED)
        ax.axhline(0.0, color=MUTED, lw=0.6)
        ax.set(title=f"residual {name}", xlabel="case temperature [°C]", ylabel="[µg]")
    for ax in axes[len(names) : 3]:
        ax.set_visible(False)
    # directions of gravity in the triad's frame, equal-area: the sphere's poles are top and bottom
    unit = dwells.indication / np.linalg.norm(dwells.indication, axis=1)[:, None]
    longitude_deg = np.degrees(np.arctan2(unit[:, 1], unit[:, 0]))
    axes[3].plot(longitude_deg, unit[:, 2], "o", ms=3, color=ALERT, alpha=0.5)
    axes[3].set(xlim=(-190, 190), ylim=(-1.1, 1.1), title="attitudes held (equal-area)")
    axes[3].set(xlabel="direction of gravity about z [°]", ylabel="component along z")
    if not after.figures:
        return Drawn((residuals,), full_summary)

    # Errors of inclination and toolface before and after, against inclination and temperature.
    low, high = report.spec.toolface_range_deg
    angles, axes = page(2, 2, title=f"{title}: attitude errors before (grey) and after (green)")
    toolface = f"toolface ({low:g}-{high:g}° inclination)"
    pairs = (
        ("inclination", before.inclination_deg, after.inclination_deg),
        (toolface, before.toolface_deg, after.toolface_deg),
    )
    abscissae = (
        (dwells.inclination, "inclination [°]"),
        (dwells.temperature, "case temperature [°C]"),
    )
    for ax, ((name, grey, green), (abscissa, label)) in zip(
        axes, product(pairs, abscissae), strict=True
    ):
        ax.plot(abscissa, grey, ".", ms=3, color=RAW)
        ax.plot(abscissa, green, ".", ms=3, color=GOOD)
        ax.set(title=f"{name} error", xlabel=label, ylabel="[°]")
        ax.set_yscale("symlog", linthresh=0.01)
    return Drawn((angles, residuals), full_summary)

"""Figures of a north-seeking inclinometer: s(T), azimuth error against C, stations before and after
correction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.instruments.inclinometer import published
from calibkit.instruments.inclinometer.errors import tabulate_stations
from calibkit.numeric.attitude import wrapped
from calibkit.report.documents import Drawn
from calibkit.report.figures import DENOISED, GOOD, MUTED, RAW, page

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.arrays import Array
    from calibkit.instruments import Fitted
    from calibkit.instruments.inclinometer.errors import AngleErrors
    from calibkit.instruments.inclinometer.published import Sensor
    from calibkit.instruments.inclinometer.scale_fit import ScaleFit
    from calibkit.instruments.inclinometer.solve import SolvedStations
    from calibkit.instruments.inclinometer.stations import Stations


@dataclass(frozen=True, slots=True)
class SeekingReport:
    """What the figures show: s(T) of each gyro, and the stations that were solved."""

    fits: Mapping[Sensor, ScaleFit]
    stations: Stations
    seen: SolvedStations
    errors: AngleErrors
    latitude_deg: float

    @property
    def c(self) -> Array:
        """C = cos α cos θ + sin α sin θ cos ψ [n] of the stations, by latitude α, inclination θ and
        azimuth ψ: near zero, s is badly determined.
        """
        inclination, azimuth = self.seen.combined.inclination_deg, self.seen.combined.azimuth_deg
        return published.root_label(np.radians(inclination), np.radians(azimuth), self.latitude_deg)

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per station: azimuth less the reference azimuth, NaN
        where there is none, over C.
        """
        errors = self.errors
        return {
            "station": list(self.stations.names),
            "c": self.c,
            "residual_before_deg": errors.before,
            "residual_deg": errors.after,
            "standard_uncertainty_deg": errors.standard_uncertainty,
        }


def draw(title: str, fitted: Fitted[SeekingReport]) -> Drawn:
    """Azimuth error before and after correction against C, which shows the verdict, or without a
    reference azimuth what s changes; s(T) of each gyro; and the summary with all stations.
    """
    report, count = fitted.drawing, len(fitted.drawing.fits)
    errors, combined, C = report.errors, report.seen.combined, report.c
    table = tabulate_stations(report.stations, report.seen, errors)
    full_summary = replace(fitted.summary, tables=(table, *fitted.summary.tables[1:]))
    against_c = f"{title}: azimuth against C = cos α cos θ + sin α sin θ cos ψ"
    azimuth, (ax,) = page(1, 1, title=against_c, height=4.4)
    bars = 2.0 * errors.standard_uncertainty
    if np.isfinite(errors.after).any():
        ax.plot(C, errors.before, "o", ms=4, color=RAW, label="s = 1")
        label = "corrected, bars k = 2"
        ax.errorbar(C, errors.after, bars, fmt="o", ms=4, lw=0.8, color=GOOD, label=label)
        ax.legend(loc="best", ncols=2)
        ax.set(title="error against the reference", ylabel="azimuth error [°]")
    else:
        shift = wrapped(combined.azimuth_deg - combined.uncorrected_deg)
        ax.errorbar(C, shift, bars, fmt="o", ms=4, lw=0.8, color=DENOISED)
        ax.set(
            title="change of the azimuth by the scale factor s (no reference azimuth), bars k = 2",
            ylabel="azimuth − azimuth with s = 1 [°]",
        )
    ax.set_xlabel("C")
    ax.axhline(0.0, color=MUTED, lw=0.6)
    scales, axes = page(
        count, 1, title=f"{title}: in-situ scale factor s", height=1.0 + 3.4 * count
    )
    # s(T) of each gyro with its uncertainty band, over the roots; against the station's number
    # where there are no temperatures
    for scale_axes, axis in zip(axes, report.fits, strict=True):
        fit, pair, stations = report.fits[axis], report.seen.solutions[axis], report.stations
        valid, count = fit.model.valid, len(stations.names)
        x = np.arange(1.0, count + 1.0) if valid is None else stations.temperature
        grid = np.linspace(1.0, float(count), 2) if valid is None else np.linspace(*valid, 101)
        measured, u = np.isfinite(pair.s_root), pair.s_root_uncertainty
        bars = 2.0 * np.where(np.isfinite(u), u, 0.0)
        for points_of, colour, name in (
            (measured & fit.used, DENOISED, "roots used"),
            (measured & ~fit.used, RAW, "roots not used"),
        ):
            if points_of.any():
                points = x[points_of], pair.s_root[points_of], bars[points_of]
                scale_axes.errorbar(*points, fmt="o", ms=3, lw=0.8, color=colour, label=name)
        prior = fit.model.prior(grid)  # s(T) as a station that was not fitted would take it
        low, high = (prior.s + sign * 2.0 * prior.standard_uncertainty for sign in (-1.0, 1.0))
        scale_axes.fill_between(grid, low, high, color=GOOD, alpha=0.2, lw=0)
        scale_axes.plot(grid, prior.s, color=GOOD, label="s(T), band k = 2")
        label = "station" if valid is None else "case temperature [°C]"
        scale_axes.set(title=f"gyro {axis}: bars k = 2", xlabel=label, ylabel="s [1]")
        scale_axes.ticklabel_format(useOffset=False)
        # axis limits cover s(T) and the roots used; a root near C = 0 may lie far outside
        used = fit.used & measured
        lowest = min([*(pair.s_root - bars)[used], *low])
        highest = max([*(pair.s_root + bars)[used], *high])
        margin = 0.06 * (highest - lowest) + 1e-6
        scale_axes.set_ylim(lowest - margin, highest + margin)
        scale_axes.legend(loc="best", ncols=3)
    return Drawn((azimuth, scales), full_summary)

"""What the report of a north-seeking inclinometer shows: tables and the first screen, stations and
their errors against the reference before and after correction; figures, s(T) and the azimuth error
against C.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibkit.instruments import Fitted
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.scale_fit import ScaleFit
from calibkit.instruments.inclinometer.solve import AngleErrors, SolvedStations
from calibkit.numeric.arrays import Array
from calibkit.numeric.attitude import wrapped
from calibkit.numeric.dispersion import rms
from calibkit.records.coefficients import at_most
from calibkit.report.documents import Drawn
from calibkit.report.figures import DENOISED, GOOD, MUTED, RAW, page
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table

SHOWN = 40
"""Stations listed on the console; report.txt lists all."""
COVERAGE = 2.0
"""Coverage factor of the stated uncertainty U (GUM 6.3.3)."""
EXPANDED = f"U (k = {COVERAGE:g})"
"""Its name in tables."""
TITLE = "Stations before (s = 1) and after"
COMPUTED = 1e-9
"""Standard uncertainty of a root of s below which the readings are taken for computed, not measured
ones: they close exactly (r₀ − r₉₀ + r₁₈₀ − r₂₇₀ = 0), and U by such a noise would be 0.
"""
UNTESTED = (
    "the [acceptance] limits of angles were not tested: the logs have no azimuth_deg to test them"
    " on"
)


def tabulate_stations(solved: SolvedStations) -> Table:
    """Table of the azimuth before and after correction, a row for each station."""
    angles = solved.errors

    def fixed(values: Array, decimals: int = 3) -> list[str]:
        return [f"{v:.{decimals}f}" if np.isfinite(v) else "-" for v in values.tolist()]

    U = [f"{COVERAGE * u:#.2g}" for u in angles.standard_uncertainty.tolist()]
    columns = {
        "station": solved.stations.names,
        "incl. [°]": fixed(solved.combined.inclination_deg),
        "toolface [°]": fixed(solved.combined.toolface_deg),
        "azimuth, uncorrected [°]": fixed(solved.combined.uncorrected_deg),
        "azimuth [°]": fixed(solved.combined.azimuth_deg),
        f"{EXPANDED} [°]": np.where(solved.refused, "refused", U).tolist(),
        **{f"s {axis}": fixed(pair.s, 6) for axis, pair in solved.solutions.items()},
    }
    if angles.known.any():
        columns |= {
            "error s=1 [°]": fixed(angles.before),
            "error [°]": fixed(angles.after),
        }
    return Table(TITLE, tuple(columns), tuple(zip(*columns.values(), strict=True)))


def tabulate_errors(angles: AngleErrors, title: str) -> Table:
    """Table of the errors over all stations, before and after correction; s does not affect
    inclination and toolface.
    """
    cells = tuple(
        (name, f"{sizes[1, 2]:.0f}", *(number(size, 3) for size in sizes[:, :2].T.ravel().tolist()))
        for name, sizes in angles.sizes.items()
        if sizes[1, 2] or name == "azimuth"
    )
    heads = ("", "stations", "rms, s = 1 [°]", "rms [°]", "largest, s = 1 [°]", "largest [°]")
    return Table(title, heads, cells)


def summarize(
    fits: Mapping[Sensor, ScaleFit],
    solved: SolvedStations,
    flags: tuple[str, ...],
    spec: InclinometerRecipe,
    results: Sequence[Table],
) -> Summary:
    """Summary of a fit, as the console shows it, with the tables of its results at the end."""
    table, count, angles = tabulate_stations(solved), solved.refused.size, solved.errors
    if count > SHOWN:
        title = f"{TITLE} (the first {SHOWN} of {count}, all in report.txt)"
        table = replace(table, title=title, rows=table.rows[:SHOWN])
    tables = [table]
    if angles.known.any():
        title = "Errors against the reference, each station by the s(T) of the others"
        tables.append(tabulate_errors(angles, title))
    tables += results
    criteria, limits = angles.criteria(spec), spec.acceptance
    limited = any(limit is not None for name, limit in limits if name.endswith("_deg"))
    untested = limited and not criteria
    for axis, scale in fits.items():
        u = solved.solutions[axis].s_root_uncertainty[scale.used]
        if limits.max_residual_over_noise is not None and u.min() > COMPUTED:
            of_model = scale.model.prior(np.nan_to_num(solved.stations.temperature)).s
            left = (solved.solutions[axis].s_root - of_model)[scale.used]
            name = f"gyro {axis}: residual over noise"
            criteria += (at_most(name, rms(left / u), limits.max_residual_over_noise, "1"),)
    conclusion = ""
    if untested and criteria:
        flags = (*flags, UNTESTED)
    elif untested:
        conclusion = f"No verdict: {UNTESTED}"

    # first screen: U of the azimuths, what s changes, errors where the azimuths are known
    with_result, facts = ~solved.refused, list[str]()
    U = COVERAGE * angles.standard_uncertainty[with_result]
    if not U.size:
        first = Overview("No station has a result.", (), (), table)
        return Summary(spec.title, tuple(tables), flags, criteria, conclusion, first)
    shifts = wrapped(solved.combined.azimuth_deg - solved.combined.uncorrected_deg)[with_result]
    largest_shift = float(np.fmax.reduce(np.abs(shifts)))
    values = [
        KeyValue(f"median {EXPANDED} of the azimuth", float(np.median(U)), "°"),
        KeyValue(f"largest {EXPANDED} of the azimuth", float(U.max()), "°"),
        KeyValue("largest change of the azimuth by the correction", largest_shift, "°"),
    ]
    sentence = (
        f"Azimuth of {U.size} of {count} stations: {EXPANDED} {U.min():.2g}° to {U.max():.2g}°,"
        f" median {np.median(U):.2g}°; the in-situ scale factor changes it by up to"
        f" {largest_shift:.2g}°."
    )
    if angles.known.any():
        before, after = angles.sizes["azimuth"][:, 0].tolist()
        facts.append(
            f"Azimuth error against the reference (rms): {before:.3g}° before, {after:.3g}° after,"
            " each station by the s(T) of the others."
        )
        values.insert(0, KeyValue("azimuth error (rms), after", after, "°"))
    first = Overview(sentence, tuple(facts), tuple(values), table)
    return Summary(spec.title, tuple(tables), flags, criteria, conclusion, first)


@dataclass(frozen=True, slots=True)
class SeekingReport:
    """What the figures show: s(T) of each gyro, and the stations that were solved."""

    fits: Mapping[Sensor, ScaleFit]
    solved: SolvedStations

    def residuals(self) -> dict[str, Any]:
        """Columns of a tidy table, one row per station: azimuth less the reference azimuth, NaN
        where there is none, over C.
        """
        errors = self.solved.errors
        return {
            "station": list(self.solved.stations.names),
            "c": self.solved.c,
            "residual_before_deg": errors.before,
            "residual_deg": errors.after,
            "standard_uncertainty_deg": errors.standard_uncertainty,
        }


def draw(title: str, fitted: Fitted[SeekingReport]) -> Drawn:
    """Azimuth error before and after correction against C, which shows the verdict, or without a
    reference azimuth what s changes; s(T) of each gyro; and the summary with all stations.
    """
    fits, solved = fitted.drawing.fits, fitted.drawing.solved
    errors, combined, C, count = solved.errors, solved.combined, solved.c, len(fits)
    table = tabulate_stations(solved)
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
    for scale_axes, axis in zip(axes, fits, strict=True):
        fit, pair, stations = fits[axis], solved.solutions[axis], solved.stations
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

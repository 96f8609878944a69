"""Errors of solved stations: against the reference before and after correction, what a recipe
accepts of them, and how tables, the first screen of a fit and a validation.json state them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Criterion, at_most, over_u
from calibkit.fit.unseen import unseen
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.scale_fit import ScaleFit
from calibkit.instruments.inclinometer.solve import SolvedStations
from calibkit.instruments.inclinometer.stations import Stations
from calibkit.numeric.attitude import wrapped
from calibkit.numeric.dispersion import rms
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table

TURNED = 5.0
"""Standard uncertainties above which unseen azimuths are turned together; 260 simulated tools had
at most 3.4.
"""
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


@dataclass(frozen=True, slots=True)
class AngleErrors:
    """Errors [n] [°] against the reference; NaN without reference or result. `before` is the
    azimuth error with s = 1.
    """

    inclination: Array
    toolface: Array
    before: Array
    after: Array
    standard_uncertainty: Array
    """Of the corrected azimuth [n] [°]."""
    noise: Array
    """The same without what the mounting of the sensors adds [n] [°]."""
    stated: Array
    """What the recipe states of the mounting, or of the reference [n] [°]."""
    by_turn: Array
    """Derivative of the azimuth by a turn of the gyros against the accelerometers [n] [°/°]."""

    @property
    def known(self) -> Mask:
        """Mask [n] of the stations with a reference azimuth and a result."""
        return np.isfinite(self.after) & np.isfinite(self.before)

    @property
    def sizes(self) -> dict[str, Array]:
        """Angle → root mean square and largest size [°] of its errors and their number [2, 3], with
        s = 1 and corrected, which does not affect inclination and toolface; NaN without any.
        """
        by_angle = {
            "azimuth": np.where(self.known, [self.before, self.after], np.nan),
            "inclination": np.array([self.inclination] * 2),
            "toolface": np.array([self.toolface] * 2),
        }
        sizes = {}
        for name, stages in by_angle.items():
            finite = [errors[np.isfinite(errors)] for errors in stages]
            largest = [np.fmax.reduce(np.abs(errors), initial=np.nan) for errors in finite]
            counts = [errors.size for errors in finite]
            sizes[name] = np.column_stack([[*map(rms, finite)], largest, counts])
        return sizes

    def turn(self) -> tuple[float, float]:
        """Turn of the gyros against the accelerometers, or of the reference azimuths, that the
        errors of the known stations share, and its standard uncertainty [°].

            β = Σ (s e / u²) / Σ (s² / u²),   u(β)² = 1 / Σ (s² / u²) + (rms v / rms s)²

        e azimuth errors, s their derivatives by a turn, u their noise, v what the recipe states.
        """
        slope, u, with_reference = self.by_turn, self.noise, self.known
        weight = np.where(with_reference, slope / u**2, 0.0)
        power = float(np.nansum(weight * slope))
        shared = rms(self.stated[with_reference]) / rms(slope[with_reference])
        return float(np.nansum(weight * self.after)) / power, float(np.hypot(power**-0.5, shared))

    def judge_uncertainty(self, name: str) -> Criterion:
        """Criterion that azimuth errors of unseen stations are as large as stated; s(T) is common
        to all stations, so that all azimuths may err alike.
        """
        u = self.standard_uncertainty[self.known]
        comparison = unseen(self.after[self.known], u[:, None])
        return over_u(f"{name}: rms azimuth error", comparison.to_object())

    def criteria(self, spec: InclinometerRecipe) -> tuple[Criterion, ...]:
        """Criteria of the recipe's acceptance limits."""
        limits, sizes = spec.acceptance, self.sizes
        tests = [("azimuth rms", sizes["azimuth"][1, 0], limits.max_azimuth_rms_deg)]
        for name in sizes:
            limit = getattr(limits, f"max_{name}_error_deg")
            tests.append((f"largest {name} error", sizes[name][1, 1], limit))
        return tuple(
            at_most(name, float(size), limit, "deg")
            for name, size, limit in tests
            if limit is not None and np.isfinite(size)
        )

    @classmethod
    @np.errstate(divide="ignore", invalid="ignore")
    def compare(cls, stations: Stations, solved: SolvedStations) -> Self:
        """Errors of all stations."""
        reference, combined = stations.reference, solved.combined
        return cls(
            np.where(solved.refused, np.nan, combined.inclination_deg - reference[:, 0]),
            wrapped(combined.toolface_deg - reference[:, 1]),
            wrapped(combined.uncorrected_deg - reference[:, 2]),
            wrapped(combined.azimuth_deg - reference[:, 2]),
            combined.standard_uncertainty[:, 2],
            np.sqrt(combined.covariance[:, 2, 2] - solved.mounted_variance),
            np.sqrt(solved.stated_variance),
            solved.by_turn,
        )


def tabulate_stations(stations: Stations, solved: SolvedStations, angles: AngleErrors) -> Table:
    """Table of the azimuth before and after correction, a row for each station."""

    def fixed(values: Array, decimals: int = 3) -> list[str]:
        return [f"{v:.{decimals}f}" if np.isfinite(v) else "-" for v in values.tolist()]

    U = [f"{COVERAGE * u:#.2g}" for u in angles.standard_uncertainty.tolist()]
    columns = {
        "station": stations.names,
        "incl. [°]": fixed(solved.combined.inclination_deg),
        "toolface [°]": fixed(solved.combined.toolface_deg),
        "azimuth s=1 [°]": fixed(solved.combined.uncorrected_deg),
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
    stations: Stations,
    solved: SolvedStations,
    angles: AngleErrors,
    flags: tuple[str, ...],
    spec: InclinometerRecipe,
    results: Sequence[Table],
) -> Summary:
    """Summary of a fit, as the console shows it, with the tables of its results at the end."""
    table, count = tabulate_stations(stations, solved, angles), len(stations.names)
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
            of_model = scale.model.prior(np.nan_to_num(stations.temperature)).s
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

"""Solved stations → angle errors before and after, with what the summary, the figures and a
validation need.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import at_most
from calibkit.instruments.inclinometer.figures import ScaleCurve, SeekingReport
from calibkit.instruments.inclinometer.numeric import published
from calibkit.numeric import dispersion
from calibkit.numeric.attitude import wrapped
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table, number_or_none

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.arrays import Array, Mask
    from calibkit.coefficients import Criterion
    from calibkit.instruments.inclinometer.numeric.published import Sensor
    from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
    from calibkit.instruments.inclinometer.solve import ScaleFit, Seen
    from calibkit.instruments.inclinometer.stations import Stations


SHOWN = 40
"""Stations that the console shows; report.txt shows all."""
COVERAGE = 2.0
"""Coverage factor of the stated uncertainty U (GUM 6.3.3)."""


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors [n] [°] against the reference, NaN where there is none or no result; before is with s
    = 1.
    """

    inclination: Array
    toolface: Array
    before: Array
    after: Array
    standard_uncertainty: Array
    """Of the azimuth after."""

    @property
    def known(self) -> Mask:
        """Stations with a reference azimuth and a result."""
        return np.isfinite(self.after) & np.isfinite(self.before)

    @property
    def excess(self) -> Array:
        """By how many of its standard uncertainties the azimuth came out worse than uncorrected."""
        known = self.known
        worse = np.abs(self.after[known]) - np.abs(self.before[known])
        return np.asarray(worse / self.standard_uncertainty[known], dtype=np.float64)


def errors(stations: Stations, seen: Seen) -> Errors:
    """Errors of all stations."""
    reference, joined = stations.reference, seen.joined
    with np.errstate(invalid="ignore"):
        return Errors(
            np.where(seen.refused, np.nan, joined.inclination_deg - reference[:, 0]),
            wrapped(joined.toolface_deg - reference[:, 1]),
            wrapped(joined.uncorrected_deg - reference[:, 2]),
            wrapped(joined.azimuth_deg - reference[:, 2]),
            joined.standard_uncertainty[:, 2],
        )


def rms(values: Array) -> float:
    """Root mean square of the finite values, NaN where there is none."""
    return dispersion.rms(values[np.isfinite(values)])


def azimuth_rms(stations: Stations, seen: Seen) -> tuple[int, float, float]:
    """Number of stations with a reference azimuth and a result, rms of their error [°] before and
    after.
    """
    found = errors(stations, seen)
    return int(found.known.sum()), rms(found.before[found.known]), rms(found.after[found.known])


def criteria(found: Errors, spec: InclinometerRecipe, *, unseen: bool) -> tuple[Criterion, ...]:
    """Acceptance limits of the recipe; on unseen stations also that none came out worse than it
    was.
    """
    limits, known = spec.acceptance, found.known
    tests = [
        ("azimuth rms", rms(found.after[known]), limits.max_azimuth_rms_deg),
        ("largest azimuth error", _largest(found.after), limits.max_azimuth_error_deg),
        (
            "largest inclination error",
            _largest(found.inclination),
            limits.max_inclination_error_deg,
        ),
        ("largest toolface error", _largest(found.toolface), limits.max_toolface_error_deg),
    ]
    made = [
        at_most(name, value, limit, "deg")
        for name, value, limit in tests
        if limit is not None and np.isfinite(value)
    ]
    if unseen and found.excess.size:
        worst, limit = float(found.excess.max()), simultaneous(found.excess.size)
        made.append(at_most("azimuth worse than uncorrected, over its u", worst, limit, "1"))
    return tuple(made)


def worse(file: str, found: Errors) -> list[str]:
    """Flag of a log whose azimuths the correction made worse as a whole."""
    before, after = rms(found.before[found.known]), rms(found.after[found.known])
    if not after > before:
        return []
    said = f"{file}: the azimuth's rms error is {after:.3g}° corrected, {before:.3g}° uncorrected"
    return [
        (
            f"{said}: s(T) does not hold here; see site.latitude_deg, the gyros, and the reference"
            " azimuths"
        )
    ]


def simultaneous(count: int) -> float:
    """Coverage factor that the largest of so many normal errors keeps in 95 % of cases
    (Bonferroni).
    """
    from scipy.special import ndtri

    return float(ndtri(1.0 - 0.05 / (2.0 * count)))


def _largest(values: Array) -> float:
    """Largest magnitude of the finite values, NaN where there is none."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if finite.size else float("nan")


def station_table(stations: Stations, seen: Seen, title: str) -> Table:
    """Azimuth before and after, station by station."""
    joined, found = seen.joined, errors(stations, seen)
    against = bool(found.known.any())
    heads = [
        "station",
        "incl. [°]",
        "toolface [°]",
        "azimuth s=1 [°]",
        "azimuth [°]",
        "U (k = 2) [°]",
    ]
    heads += [f"s {axis}" for axis in seen.solutions]
    heads += ["error s=1 [°]", "error [°]"] if against else []
    rows = []
    for k, name in enumerate(stations.names):
        cells = [
            name,
            _fixed(joined.inclination_deg[k], 3),
            _fixed(joined.toolface_deg[k], 3),
            _fixed(joined.uncorrected_deg[k], 3),
            _fixed(joined.azimuth_deg[k], 3),
            (
                f"{COVERAGE * found.standard_uncertainty[k]:#.2g}"
                if not seen.refused[k]
                else "refused"
            ),
            *(_fixed(pair.s[k], 6) for pair in seen.solutions.values()),
        ]
        cells += [_fixed(found.before[k], 3), _fixed(found.after[k], 3)] if against else []
        rows.append(tuple(cells))
    return Table(title, tuple(heads), tuple(rows))


def _fixed(value: float, decimals: int) -> str:
    """A number in fixed decimals, a dash where there is none."""
    return f"{value:.{decimals}f}" if np.isfinite(value) else "-"


def shortened(table: Table) -> Table:
    """A table of at most so many rows as a console shows."""
    if len(table.rows) <= SHOWN:
        return table
    title = f"{table.title} (the first {SHOWN} of {len(table.rows)}, all in report.txt)"
    return Table(title, table.columns, table.rows[:SHOWN])


def error_table(found: Errors, title: str) -> Table:
    """Errors of all stations together, before and after; the correction of s does not touch
    inclination and toolface.
    """
    known = found.known
    rows = [("azimuth", found.before[known], found.after[known])]
    rows += [
        (name, values[np.isfinite(values)], values[np.isfinite(values)])
        for name, values in (("inclination", found.inclination), ("toolface", found.toolface))
        if np.isfinite(values).any()
    ]
    cells = tuple(
        (
            name,
            str(after.size),
            *(number(v, 3) for v in (rms(before), rms(after), _largest(before), _largest(after))),
        )
        for name, before, after in rows
    )
    heads = ("", "stations", "rms, s = 1 [°]", "rms [°]", "largest, s = 1 [°]", "largest [°]")
    return Table(title, heads, cells)


def scale_table(fits: Mapping[Sensor, ScaleFit]) -> Table:
    """s(T) of each gyro."""
    rows = []
    for axis, scale in fits.items():
        model = scale.model
        uncertainty = np.sqrt(np.clip(np.diag(model.covariance), 0.0, None))
        text = ", ".join(
            f"s{k} {value:.8g} ± {u:.1g}"
            for k, (value, u) in enumerate(zip(model.coefficients, uncertainty, strict=True))
        )
        valid = "-" if model.valid is None else f"{model.valid[0]:.1f} to {model.valid[1]:.1f}"
        rows.append(
            (
                axis,
                text,
                f"{model.scatter:.1e}",
                valid,
                f"{int(scale.used.sum())} of {scale.used.size}",
            )
        )
    heads = (
        "gyro",
        "coefficients for °C (± standard uncertainty, type A)",
        "scatter",
        "valid [°C]",
        "roots used",
    )
    return Table("In-situ scale factor s(T)", heads, tuple(rows))


def summary(
    fits: Mapping[Sensor, ScaleFit],
    stations: Stations,
    seen: Seen,
    flags: tuple[str, ...],
    spec: InclinometerRecipe,
) -> Summary:
    """What the console says of a fit."""
    found = errors(stations, seen)
    tables = [scale_table(fits), shortened(station_table(stations, seen, TITLE))]
    if found.known.any():
        tables.append(
            error_table(
                found, "Errors against the reference, each station by the s(T) of the others"
            )
        )
    return Summary(spec.title, tuple(tables), flags, criteria(found, spec, unseen=False))


TITLE = "Stations before (s = 1) and after"


def drawing(
    fits: Mapping[Sensor, ScaleFit], stations: Stations, seen: Seen, spec: InclinometerRecipe
) -> SeekingReport:
    """What the figures show."""
    found = errors(stations, seen)
    curves = tuple(_curve(axis, scale, stations, seen) for axis, scale in fits.items())
    label = published.label(
        np.radians(seen.joined.inclination_deg),
        np.radians(seen.joined.azimuth_deg),
        spec.site.latitude_deg,
    )
    shift = wrapped(seen.joined.azimuth_deg - seen.joined.uncorrected_deg)
    table = station_table(stations, seen, TITLE)
    return SeekingReport(
        curves, label, found.before, found.after, shift, found.standard_uncertainty, table
    )


def _curve(axis: Sensor, scale: ScaleFit, stations: Stations, seen: Seen) -> ScaleCurve:
    """s(T) of one gyro with the roots that carried it; against the station's number without
    temperatures.
    """
    pair, valid = seen.solutions[axis], scale.model.valid
    count = len(stations.names)
    abscissa = np.arange(1.0, count + 1.0) if valid is None else stations.temperature
    grid = np.linspace(1.0, float(count), 2) if valid is None else np.linspace(*valid, 101)
    prior = scale.model.prior(grid)
    return ScaleCurve(
        axis,
        "station" if valid is None else "case temperature [°C]",
        abscissa,
        pair.s_root,
        pair.s_root_uncertainty,
        scale.used,
        grid,
        prior.s,
        prior.standard_uncertainty,
    )


def entry(
    file: str, sha256: str, rows: int, stations: Stations, seen: Seen, found: Errors
) -> dict[str, object]:
    """JSON object of one validated log."""
    known = found.known
    before, after = found.before[known], found.after[known]
    angles = {
        f"{name}_{figure}_deg": number_or_none(value)
        for name, values in (("inclination", found.inclination), ("toolface", found.toolface))
        for figure, value in (("rms", rms(values)), ("max", _largest(values)))
    }
    return {
        "name": file,
        "sha256": sha256,
        "rows": rows,
        "stations_used": int((~seen.refused).sum()),
        "stations_refused": int(seen.refused.sum()),
        "before": {
            "azimuth_rms_deg": number_or_none(rms(before)),
            "azimuth_max_deg": number_or_none(_largest(before)),
            **angles,
        },
        "after": {
            "azimuth_rms_deg": number_or_none(rms(after)),
            "azimuth_max_deg": number_or_none(_largest(after)),
            **angles,
        },
        "worse_than_uncorrected_over_u": number_or_none(
            float(found.excess.max()) if found.excess.size else float("nan")
        ),
        "stations": [_station(k, stations, seen, found) for k in range(len(stations.names))],
    }


def _station(k: int, stations: Stations, seen: Seen, found: Errors) -> dict[str, object]:
    """JSON object of one station."""
    return {
        "station": stations.names[k],
        "azimuth_error_before_deg": number_or_none(float(found.before[k])),
        "azimuth_error_after_deg": number_or_none(float(found.after[k])),
        "azimuth_standard_uncertainty_deg": number_or_none(float(found.standard_uncertainty[k])),
        "refused": seen.joined.status[k],
    }


def pooled(parts: Sequence[Errors]) -> Errors:
    """Errors of all logs together."""
    return Errors(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("inclination", "toolface", "before", "after", "standard_uncertainty")
        )
    )

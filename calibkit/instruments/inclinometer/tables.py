"""Results of an inclinometer run: tables, summary, data of the figures and JSON of its stations."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibkit.coefficients import at_most
from calibkit.instruments.inclinometer.errors import (
    AngleErrors,
    largest,
    rms,
)
from calibkit.instruments.inclinometer.forms import ScaleFit
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.solve import SolvedStations
from calibkit.instruments.inclinometer.stations import Stations
from calibkit.numeric.attitude import wrapped
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table, number_or_none

SHOWN = 40
"""Stations listed on the console; report.txt lists all."""
COVERAGE = 2.0
"""Coverage factor of the stated uncertainty U (GUM 6.3.3)."""
TITLE = "Stations before (s = 1) and after"


def tabulate_stations(stations: Stations, seen: SolvedStations) -> Table:
    """Table of the azimuth before and after correction, a row for each station."""
    combined, found = seen.combined, AngleErrors.compare(stations, seen)
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
            _format_fixed(combined.inclination_deg[k], 3),
            _format_fixed(combined.toolface_deg[k], 3),
            _format_fixed(combined.uncorrected_deg[k], 3),
            _format_fixed(combined.azimuth_deg[k], 3),
            (
                f"{COVERAGE * found.standard_uncertainty[k]:#.2g}"
                if not seen.refused[k]
                else "refused"
            ),
            *(_format_fixed(pair.s[k], 6) for pair in seen.solutions.values()),
        ]
        cells += (
            [_format_fixed(found.before[k], 3), _format_fixed(found.after[k], 3)] if against else []
        )
        rows.append(tuple(cells))
    return Table(TITLE, tuple(heads), tuple(rows))


def _format_fixed(value: float, decimals: int) -> str:
    """A number with fixed decimals; a dash for NaN."""
    return f"{value:.{decimals}f}" if np.isfinite(value) else "-"


def tabulate_errors(found: AngleErrors, title: str) -> Table:
    """Table of the errors over all stations, before and after correction; s does not affect
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
            *(number(v, 3) for v in (rms(before), rms(after), largest(before), largest(after))),
        )
        for name, before, after in rows
    )
    heads = ("", "stations", "rms, s = 1 [°]", "rms [°]", "largest, s = 1 [°]", "largest [°]")
    return Table(title, heads, cells)


def _tabulate_scale(fits: Mapping[Sensor, ScaleFit]) -> Table:
    """Table of what s(T) of each gyro was fitted to."""
    rows = []
    for axis, scale in fits.items():
        model = scale.model
        valid = "-" if model.valid is None else f"{model.valid[0]:.1f} to {model.valid[1]:.1f}"
        rows.append(
            (
                axis,
                f"{model.scatter:.1e}",
                valid,
                f"{int(scale.used.sum())} of {scale.used.size}",
            )
        )
    heads = ("gyro", "scatter", "valid [°C]", "roots used")
    return Table("Roots of the in-situ scale factor s(T)", heads, tuple(rows))


COMPUTED = 1e-9
"""Standard uncertainty of a root of s below which the readings are taken for computed, not measured
ones: they close exactly (r₀ − r₉₀ + r₁₈₀ − r₂₇₀ = 0), and U by such a noise would be 0.
"""
UNTESTED = (
    "the [acceptance] limits of angles were not tested: the logs have no azimuth_deg to test them"
    " on"
)


def summarize(
    fits: Mapping[Sensor, ScaleFit],
    stations: Stations,
    seen: SolvedStations,
    flags: tuple[str, ...],
    spec: InclinometerRecipe,
    results: Sequence[Table],
) -> Summary:
    """Summary of a fit, as the console shows it, with the tables of its results at the end."""
    found = AngleErrors.compare(stations, seen)
    table, count = tabulate_stations(stations, seen), len(stations.names)
    if count > SHOWN:
        title = f"{TITLE} (the first {SHOWN} of {count}, all in report.txt)"
        table = replace(table, title=title, rows=table.rows[:SHOWN])
    tables = [_tabulate_scale(fits), table]
    if found.known.any():
        tables.append(
            tabulate_errors(
                found, "Errors against the reference, each station by the s(T) of the others"
            )
        )
    tables += results
    criteria, limits = found.criteria(spec), spec.acceptance
    stated = any(limit is not None for name, limit in limits if name.endswith("_deg"))
    untested = stated and not criteria
    if limits.max_residual_over_noise is not None:
        criteria += tuple(
            at_most(
                f"gyro {axis}: residual over noise",
                rms(
                    (pair.s_root - scale.model.prior(np.nan_to_num(stations.temperature)).s)[
                        scale.used
                    ]
                    / pair.s_root_uncertainty[scale.used]
                ),
                limits.max_residual_over_noise,
                "1",
            )
            for axis, scale in fits.items()
            for pair in [seen.solutions[axis]]
            if pair.s_root_uncertainty[scale.used].min() > COMPUTED
        )
    if untested and criteria:
        flags = (*flags, UNTESTED)
    conclusion = f"No verdict: {UNTESTED}" if untested and not criteria else ""
    first = _summarize_azimuths(found, stations, seen, tables)
    return Summary(spec.title, tuple(tables), flags, criteria, conclusion, first)


def _summarize_azimuths(
    found: AngleErrors, stations: Stations, seen: SolvedStations, tables: Sequence[Table]
) -> Overview:
    """First screen: U of the azimuths, what the in-situ scale factor changes, errors where the
    azimuths are known.
    """
    solved = ~seen.refused
    U = COVERAGE * found.standard_uncertainty[solved]
    if not U.size:
        return Overview("No station has a result.", (), (), tables[1])
    shift = wrapped(seen.combined.azimuth_deg - seen.combined.uncorrected_deg)[solved]
    values = [
        KeyValue("median U (k = 2) of the azimuth", float(np.median(U)), "°"),
        KeyValue("largest U (k = 2) of the azimuth", float(U.max()), "°"),
        KeyValue("largest change of the azimuth by the correction", largest(shift), "°"),
    ]
    sentence = (
        f"Azimuth of {U.size} of {len(stations.names)} stations: U (k = 2) {U.min():.2g}° to"
        f" {U.max():.2g}°, median {np.median(U):.2g}°; the in-situ scale factor changes it by up to"
        f" {largest(shift):.2g}°."
    )
    facts = []
    if found.known.any():
        before, after = rms(found.before[found.known]), rms(found.after[found.known])
        facts.append(
            f"Azimuth error against the reference (rms): {before:.3g}° before, {after:.3g}° after,"
            " each station by the s(T) of the others."
        )
        values.insert(0, KeyValue("azimuth error (rms), after", after, "°"))
    return Overview(sentence, tuple(facts), tuple(values), tables[1])


def list_validation(
    file: str, sha256: str, rows: int, stations: Stations, seen: SolvedStations, found: AngleErrors
) -> dict[str, object]:
    """JSON object of one validated log."""
    angles = {
        f"{name}_{figure}_deg": number_or_none(value)
        for name, values in (("inclination", found.inclination), ("toolface", found.toolface))
        for figure, value in (("rms", rms(values)), ("max", largest(values)))
    }
    azimuth = {
        when: {
            "azimuth_rms_deg": number_or_none(rms(values[found.known])),
            "azimuth_max_deg": number_or_none(largest(values[found.known])),
            **angles,
        }
        for when, values in (("before", found.before), ("after", found.after))
    }
    return {
        "name": file,
        "sha256": sha256,
        "rows": rows,
        "stations_used": int((~seen.refused).sum()),
        "stations_refused": int(seen.refused.sum()),
        **azimuth,
        "worse_than_uncorrected_over_u": number_or_none(
            float(found.excess.max()) if found.excess.size else float("nan")
        ),
        "stations": [
            {
                "station": name,
                "azimuth_error_before_deg": number_or_none(float(found.before[k])),
                "azimuth_error_after_deg": number_or_none(float(found.after[k])),
                "azimuth_standard_uncertainty_deg": number_or_none(
                    float(found.standard_uncertainty[k])
                ),
                "refused": seen.combined.status[k],
            }
            for k, name in enumerate(stations.names)
        ],
    }

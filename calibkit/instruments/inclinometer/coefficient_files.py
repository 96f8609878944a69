"""s(T) of each gyro ↔ inclinometer_scale.json."""

from collections.abc import Iterable, Mapping

import numpy as np

from calibkit.coefficients import Condition, Figure, Record, StageResult
from calibkit.errors import CoefficientError
from calibkit.instruments.inclinometer.errors import AngleErrors, rms
from calibkit.instruments.inclinometer.forms import (
    FILE,
    ScaleFit,
    ScaleModel,
)
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.root_choice import root_slopes
from calibkit.instruments.inclinometer.solve import WRONG, SolvedStations
from calibkit.instruments.inclinometer.stations import Stations

FEW = 5
"""Degrees of freedom below which an estimated noise or scatter is flagged as uncertain."""
SCATTERS = 3.0
"""Scatter of s, in standard uncertainties of a root, above which it is flagged; 16 simulated
sensors showed 0 to 1.6.
"""
SIGNIFICANT, LEAST_DEG = 4.0, 0.03
"""Least offset of the latitude that is reported, in standard uncertainties and in degrees."""
FEWEST = 5
"""Fewest stations, beyond the number of coefficients of s(T), for an estimate of the latitude."""


def make_result(
    fits: Mapping[Sensor, ScaleFit],
    stations: Stations,
    seen: SolvedStations,
    notes: Iterable[str],
    spec: InclinometerRecipe,
    gravity_mps2: float | None,
) -> StageResult:
    """Coefficient file of a fit."""
    site = [
        Condition("latitude", spec.site.latitude_deg, "deg", spec.site.latitude_uncertainty_deg)
    ]
    if gravity_mps2 is not None:
        site.append(Condition("local_gravity", gravity_mps2, "m/s^2"))
    return StageResult(
        "inclinometer_scale",
        tuple(scale.write(axis) for axis, scale in fits.items()),
        _figures(fits, stations, seen, spec),
        (*notes, *_flag_fits(fits), *flag_stations(stations, seen)),
        tuple(site),
    )


def _figures(
    fits: Mapping[Sensor, ScaleFit],
    stations: Stations,
    seen: SolvedStations,
    spec: InclinometerRecipe,
) -> tuple[Figure, ...]:
    """Scale factors at the reference temperature, number of stations used, and azimuth errors
    before and after correction.
    """
    figures = []
    for axis, scale in fits.items():
        at, valid = spec.reference_temp_degc, scale.model.valid
        prior = scale.model.prior(np.array([at if valid is None else np.clip(at, *valid)]))
        figures += [
            Figure(f"s_{axis}", float(prior.s[0]), "1", float(prior.standard_uncertainty[0])),
            Figure(f"roots_used_{axis}", float(scale.used.sum()), "1", 0.0),
        ]
    refused, found = int(seen.refused.sum()), AngleErrors.compare(stations, seen)
    figures += [
        Figure("stations_used", float(seen.refused.size - refused), "1", 0.0),
        Figure("stations_refused", float(refused), "1", 0.0),
    ]
    for when, errors in (("before", found.before), ("after", found.after)):
        if found.known.any():
            value = rms(errors[found.known])
            u = float(value * np.sqrt(1.0 / (2.0 * found.known.sum())))
            figures.append(Figure(f"azimuth_rms_{when}", value, "deg", u))
    return tuple(figures)


def _flag_fits(fits: Mapping[Sensor, ScaleFit]) -> list[str]:
    """Flags of noises and scatters that are estimated from too few degrees of freedom, and flags
    and remarks of the fits, with the axis of the gyro.
    """
    flags = []
    for axis, scale in fits.items():
        if scale.model.noise.dof < FEW:
            flags.append(
                f"{axis}: the noise of a reading is known from {scale.model.noise.dof} degrees of"
                " freedom: state stations.gyro_noise_dph and stations.accel_noise_g"
            )
        if scale.dof < FEW:
            flags.append(
                f"{axis}: s(T) has {scale.dof} degrees of freedom: its scatter is hardly known"
            )
    for axis, scale in fits.items():
        flags += [type(flag)(f"{axis}: {flag}") for flag in scale.flags]
    return flags


def flag_latitude(
    fits: Mapping[Sensor, ScaleFit],
    stations: Stations,
    seen: SolvedStations,
    spec: InclinometerRecipe,
) -> list[str]:
    """Flags of gyros with more scatter of s than their readings explain; each states the latitude
    that would explain it, or other causes.
    """
    flags, stated = [], spec.site.latitude_deg
    for axis, fit in fits.items():
        u = seen.solutions[axis].s_root_uncertainty[fit.used]
        expected = float(np.median(u)) if u.size else 0.0
        if not expected or fit.over is None or fit.model.scatter <= SCATTERS * expected:
            continue
        what = (
            f"{axis}: s scatters by {fit.model.scatter:.1e} beyond its readings, which are good for"
            f" {expected:.1e}"
        )
        # the root at the recipe's latitude is s(T) - ds/dα × offset
        pair, parts = seen.solutions[axis], stations.components[axis]
        latitude = np.full(pair.s.size, stated)
        by_latitude = np.radians(root_slopes(parts, latitude, pair.root >= 0)[:, 4])
        offset, u_offset = fit.over.further_error(-by_latitude, FEWEST)
        reason = (
            "see that site.latitude_deg is right and the gyro does not change from station to"
            " station"
            if abs(offset) < max(SIGNIFICANT * u_offset, LEAST_DEG)
            else f"the stations fit a latitude of {stated + offset:.2f}° ± {u_offset:.2f}°,"
            f" site.latitude_deg says {stated:g}°"
        )
        flags.append(f"{what} ({fit.model.scatter / expected:.1f} times): {reason}")
    return flags


def flag_stations(stations: Stations, seen: SolvedStations) -> tuple[str, ...]:
    """Flags of the stations, refused stations first; stations with the same flag share a line."""
    contradicted = int(seen.contradicted.sum())
    lines = []
    if 2 * contradicted > len(stations.names):
        lines.append(f"{contradicted} of {len(stations.names)} stations contradict s(T): {WRONG}")
    refused, flagged = [], []
    for name, reason, flags in zip(
        stations.names, seen.combined.status, seen.combined.flags, strict=True
    ):
        if reason:
            refused.append((name, f"refused: {reason}"))
        else:
            flagged += [(name, flag) for flag in flags]
    named: dict[str, list[str]] = {}
    for name, text in (*refused, *flagged):
        named.setdefault(text, []).append(name)
    lines += [
        f"station{'s' if len(names) > 1 else ''} {', '.join(names)}: {text}"
        for text, names in named.items()
    ]
    return tuple(lines)


def flag_temperatures(
    file: str, stations: Stations, found: Mapping[Sensor, ScaleModel]
) -> tuple[str, ...]:
    """Flags of stations without a temperature or outside the calibration's temperature range."""
    valid = next(iter(found.values())).valid
    if valid is None:
        return ()
    low, high = valid
    unknown = ~np.isfinite(stations.temperature)
    flags = []
    if unknown.any():
        flags.append(
            f"{file}: {int(unknown.sum())} of {unknown.size} stations have no temp_case_degc: their"
            f" s may be any of s(T) over {low:.1f} to {high:.1f} °C"
        )
    outside = ~unknown & ((stations.temperature < low) | (stations.temperature > high))
    if outside.any():
        flags.append(
            f"{file}: temperature clamped to {low:.1f} to {high:.1f} °C at {int(outside.sum())} of"
            f" {unknown.size} stations"
        )
    return tuple(flags)


def read_models(
    records: Mapping[str, Record], spec: InclinometerRecipe
) -> dict[Sensor, ScaleModel]:
    """s(T) of each gyro that the recipe reads, from the coefficient file of a run; raises
    CoefficientError for a missing gyro.
    """
    if FILE not in records:
        raise CoefficientError(f"the run holds no {FILE}", hint="it is not a run of inclinometer")
    return {axis: ScaleModel.read(records[FILE].model(axis)) for axis in spec.axes}

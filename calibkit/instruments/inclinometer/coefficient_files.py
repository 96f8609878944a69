"""s(T) of each gyro ↔ inclinometer_scale.json, and how it moves with errors of the inputs."""

from collections.abc import Iterable, Mapping

import numpy as np

from calibkit.coefficients import Condition, Figure, StageResult
from calibkit.instruments.inclinometer.forms import TEMPERATURE
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.root_choice import ROOT_DISAGREES
from calibkit.instruments.inclinometer.scale_fit import ScaleFit
from calibkit.instruments.inclinometer.solve import WRONG, SolvedStations
from calibkit.instruments.inclinometer.stations import Stations
from calibkit.sensitivities import ROUNDING, InputError, Sensitivity, of_thermometer

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
REFUSED = "refused: "
"""How the flag of a refused station begins."""
LATITUDE_STEP_DEG, SHARE = 1e-3, 1e-5


def make_result(
    fits: Mapping[Sensor, ScaleFit],
    stations: Stations,
    solved: SolvedStations,
    notes: Iterable[str],
    spec: InclinometerRecipe,
) -> StageResult:
    """Coefficient file of a fit: s(T), scale factors at the reference temperature, numbers of roots
    and stations used, azimuth errors before and after correction; flags of noises and scatters
    that are large, or estimated from too few degrees of freedom.
    """
    figures, of_scatter, of_few_dof, of_fits = [], [], [], []
    for axis, scale in fits.items():
        # more scatter of s than the readings explain: the latitude that would explain it, if the
        # stations agree on one, or other causes
        pair, stated_deg = solved.solutions[axis], spec.site.latitude_deg
        u = pair.s_root_uncertainty[scale.used]
        expected = float(np.median(u)) if u.size else 0.0
        if expected and scale.fit is not None and scale.model.scatter > SCATTERS * expected:
            error_deg, u_deg = scale.latitude_error(FEWEST)
            reason = (
                "see that site.latitude_deg is right and the gyro does not change from station to"
                " station"
                if abs(error_deg) < max(SIGNIFICANT * u_deg, LEAST_DEG)
                else f"the stations fit a latitude of {stated_deg - error_deg:.2f}° ± {u_deg:.2f}°,"
                f" site.latitude_deg says {stated_deg:g}°"
            )
            of_scatter.append(
                f"{axis}: s scatters by {scale.model.scatter:.1e} beyond its readings, which are"
                f" good for {expected:.1e} ({scale.model.scatter / expected:.1f} times): {reason}"
            )
        degc, valid, noise = (
            spec.reference_temp_degc,
            scale.model.valid,
            scale.model.noise,
        )
        prior = scale.model.prior(np.array([degc if valid is None else np.clip(degc, *valid)]))
        figures += [
            Figure(f"s_{axis}", float(prior.s[0]), "1", float(prior.standard_uncertainty[0])),
            Figure(f"roots_used_{axis}", float(scale.used.sum()), "1", 0.0),
        ]
        if noise.dof < FEW:
            of_few_dof.append(
                f"{axis}: the noise of a reading is known from {noise.dof} degrees of freedom:"
                " state stations.gyro_noise_dph and stations.accel_noise_g"
            )
        if scale.dof < FEW:
            of_few_dof.append(
                f"{axis}: s(T) has {scale.dof} degrees of freedom: its scatter is hardly known"
            )
        of_fits += [type(flag)(f"{axis}: {flag}") for flag in scale.flags]
    refused = int(solved.refused.sum())
    figures += [
        Figure("stations_used", float(solved.refused.size - refused), "1", 0.0),
        Figure("stations_refused", float(refused), "1", 0.0),
    ]
    count_known = int(solved.errors.known.sum())
    if count_known:
        share = float(np.sqrt(1.0 / (2.0 * count_known)))
        of_azimuth = solved.errors.sizes["azimuth"][:, 0]
        for stage, value in zip(("before", "after"), of_azimuth, strict=True):
            figures.append(
                Figure(f"azimuth_rms_{stage}", float(value), "deg", float(value * share))
            )
    place, gravity = spec.site, spec.site.local_gravity()
    site = [Condition("latitude", place.latitude_deg, "deg", place.latitude_uncertainty_deg)]
    if gravity is not None:
        site.append(Condition("local_gravity", gravity, "m/s^2"))
    return StageResult(
        "inclinometer_scale",
        tuple(scale.write(axis) for axis, scale in fits.items()),
        tuple(figures),
        (*notes, *of_scatter, *of_few_dof, *of_fits, *flag_stations(stations, solved)),
        tuple(site),
    )


def flag_stations(stations: Stations, solved: SolvedStations) -> tuple[str, ...]:
    """Flags of the stations, refused stations first; stations with the same flag share a line."""
    # stations where a root differs significantly from its prior, or is impossible
    contradicted = np.zeros(len(stations.names), dtype=np.bool_)
    for axis, pair in solved.solutions.items():
        prior = solved.priors[axis]
        limit = ROOT_DISAGREES * np.hypot(pair.s_root_uncertainty, prior.standard_uncertainty)
        departs = np.abs(pair.s_root - prior.s) > limit
        contradicted |= departs | [WRONG in reason for reason in pair.status]
    lines, count = list[str](), int(contradicted.sum())
    if 2 * count > contradicted.size:
        lines.append(f"{count} of {contradicted.size} stations contradict s(T): {WRONG}")
    combined, texts = solved.combined, list[tuple[str, str]]()
    for name, reason, flags in zip(stations.names, combined.status, combined.flags, strict=True):
        texts += [(name, flag) for flag in ([f"{REFUSED}{reason}"] if reason else flags)]
    texts.sort(key=lambda text: not text[1].startswith(REFUSED))
    stations_of_flag: dict[str, list[str]] = {}
    for name, text in texts:
        stations_of_flag.setdefault(text, []).append(name)
    lines += [
        f"station{'s' if len(names) > 1 else ''} {', '.join(names)}: {text}"
        for text, names in stations_of_flag.items()
    ]
    return tuple(lines)


def find_sensitivities(
    fits: Mapping[Sensor, ScaleFit], stations: Stations, spec: InclinometerRecipe
) -> tuple[Sensitivity, ...]:
    """How s(T) of every gyro moves with errors of the latitude, the thermometer and the gyros, the
    weights of the fit held. A turn of all positions alike moves no root.
    """
    errors = [
        InputError("latitude_deg", "offset", LATITUDE_STEP_DEG),
        *(InputError(f"gyro_{axis}_dph", "scale", SHARE) for axis in spec.axes),
    ]
    known_degc = stations.temperature[np.isfinite(stations.temperature)]
    if known_degc.size:
        errors += of_thermometer(TEMPERATURE, float(known_degc.min()), float(known_degc.max()))
    sensitivities = []
    for error in errors:
        derivatives: dict[str, float] = {}
        for axis, fit in fits.items():
            if error.input in ("gyro_x_dph", "gyro_y_dph") and error.input != f"gyro_{axis}_dph":
                continue
            s, change = fit.model.coefficients, fit.moved_by(error)
            degc = spec.reference_temp_degc
            powers = np.clip(degc, *(fit.model.valid or (degc, degc))) ** np.arange(s.size)
            names = [*(f"{axis}.s{k}" for k in range(s.size)), f"s_{axis}"]
            values = np.append(change, powers @ change)
            moved = np.abs(values * error.step) > ROUNDING * np.abs(np.append(s, s[0]))
            for k in np.flatnonzero(moved).tolist():
                derivatives[f"inclinometer_scale.{names[k]}"] = float(values[k])
        sensitivities.append(Sensitivity(error.input, error.kind, derivatives))
    # in the order of earlier runs: latitude, positions, gyros, thermometer
    sensitivities.insert(1, Sensitivity("position_deg", "offset", {}))
    return tuple(sensitivities)

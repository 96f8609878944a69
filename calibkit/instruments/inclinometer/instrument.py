"""Four-position inclinometer: stations → inclinometer_scale.json.

Half differences of opposite positions have no bias (step B). Gravity gives inclination and toolface
of a station, and s, the in-situ scale factor, is what makes the measured rate as long as the
earth's horizontal rate is (C, D); s(T) is fitted to the stations of all logs. A corrected rate is s
times the indication; the azimuth follows from it (E, F). `fit` finds s(T), `correct` and `validate`
use it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.check import copies
from calibkit.errors import CoefficientError, FitError, FrameError
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.inclinometer import (
    certificate,
    dwells,
    figures,
    published,
    solve,
    stations as inclinometer_stations,
)
from calibkit.instruments.inclinometer.forms import FILE, SCALE, TEMPERATURE, ScaleModel
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.root_choice import ROOT_DISAGREES
from calibkit.instruments.inclinometer.scale_fit import ScaleFit
from calibkit.instruments.inclinometer.solve import WRONG, SolvedStations
from calibkit.logs import log_files, write_back
from calibkit.logs.evidence import Evidence
from calibkit.logs.recipe_text import RecipeChoice
from calibkit.logs.write_back import Applied
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import REVOLUTION_DEG
from calibkit.records.coefficients import Condition, Figure, Input, Record, StageResult, at_most
from calibkit.records.frame import Log, refuse, values
from calibkit.records.left_out import LeftOut
from calibkit.records.sensitivities import ROUNDING, InputError, Sensitivity, of_thermometer
from calibkit.report.summary import Summary
from calibkit.report.table import number_or_none

if TYPE_CHECKING:
    from pandas import DataFrame

Recipe = InclinometerRecipe
KEY_FIGURES = (r"inclinometer_scale\.s_\w", r"inclinometer_scale\.\w\.(s\d|residual_rms)")
FORMS = (SCALE,)
PROPOSED = (
    *(
        "station",
        "position_deg",
        "time_s",
        "temp_case_degc",
        "inclination_deg",
        "toolface_deg",
        "azimuth_deg",
    ),
    *(f"{kind}_{axis}_{word}" for axis in "xy" for kind, word, _ in published.SENSORS),
)
"""Columns that a proposed recipe maps where the logs have them."""
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
faults = inclinometer_stations.examine
results = certificate.results


def read(spec: InclinometerRecipe, data: Path, file: str) -> Log:
    """One log in canonical columns; m/s² become g by the site's gravity."""
    columns = [
        "position_deg",
        *(f"{kind}_{axis}_{unit}" for kind, unit, _ in published.SENSORS for axis in spec.axes),
    ]
    if spec.stations.gyro_ramp:
        columns.append("time_s")
    if spec.root.choice == "heading":
        columns.append("azimuth_deg")
    further_columns = ("station", "time_s", TEMPERATURE, *inclinometer_stations.REFERENCE)
    optional = tuple(name for name in further_columns if name not in columns)
    return log_files.read_log(spec.on_site(), data / file, file, tuple(columns), optional)


def fit(
    spec: InclinometerRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[figures.SeekingReport]:
    """Fit s(T) of each gyro to the stations of all logs together."""
    logs = list(
        copies.refuse_copies(
            log_files.read_ahead(progress(files, "reading"), lambda file: read(spec, data, file))
        )
    )
    admitted, findings = inclinometer_stations.admit_logs(logs, spec)
    rows = inclinometer_stations.gather_rows(admitted, spec.on_site())
    stations = inclinometer_stations.solve_components(rows, spec)
    try:
        fits, solved = solve.fit_scale(stations, spec)
    except FitError as error:
        mistakes = _find_mistakes(rows, spec)
        hint = f"the stations agree if {' or if '.join(mistakes)}" if mistakes else error.hint
        raise FitError(error.message, hint=hint) from None
    notes = [f"{log.file}: {note}" for log in logs for note in log.notes]
    notes += [str(finding) for finding in findings if finding.flagged]
    result = _make_result(fits, solved, notes, spec)
    influences = _find_sensitivities(fits, stations.temperature, spec.on_site())
    result_tables = tabulate_fit([result], spec, influences, certificate.blocks)
    left_out = []
    for axis, status in stations.status.items():
        count = sum(map(bool, status))
        if count:
            left_out.append(LeftOut("stations", count, len(status), "unsolved", axis))
    return Fitted(
        (result,),
        tuple(Input.of(log) for log in logs),
        figures.summarize(fits, solved, result.flags, spec, result_tables),
        figures.SeekingReport(fits, solved),
        sensitivities=influences,
        left_out=tuple(left_out),
    )


def _find_mistakes(rows: "DataFrame", spec: InclinometerRecipe) -> list[str]:
    """Which sign, exchange of two columns or sense of the positions, corrected alone, lets the
    stations of `rows` agree.
    """
    corrected = {
        "position_deg counts the other way: see its sign in [columns]": rows.assign(
            position_deg=-rows["position_deg"] % REVOLUTION_DEG
        )
    }
    for kind, word, _ in published.SENSORS:
        columns = [f"{kind}_{axis}_{word}" for axis in spec.axes]
        for column in columns:
            turned = rows.assign(**{column: -rows[column]})
            corrected[f"the sign of {column} is turned: see sign in [columns]"] = turned
        if len(columns) == 2:
            exchanged = rows.rename(columns=dict(zip(columns, columns[::-1], strict=True)))
            corrected[f"{' and '.join(columns)} are exchanged: see from in [columns]"] = exchanged
    mistakes = []
    for mistake, mended in corrected.items():
        try:
            solve.fit_scale(inclinometer_stations.solve_components(mended, spec), spec)
        except FitError:
            continue
        mistakes.append(mistake)
    return mistakes


def _make_result(
    fits: Mapping[Sensor, ScaleFit],
    solved: SolvedStations,
    notes: Iterable[str],
    spec: InclinometerRecipe,
) -> StageResult:
    """Coefficient file of a fit: s(T), scale factors at the reference temperature, numbers of roots
    and stations used, azimuth errors before and after correction; flags of noises and scatters
    that are large, or estimated from too few degrees of freedom.
    """
    figures, flags = list[Figure](), [*notes]
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
            flags.append(
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
            flags.append(
                f"{axis}: the noise of a reading is known from {noise.dof} degrees of freedom:"
                " state stations.gyro_noise_dph and stations.accel_noise_g"
            )
        if scale.dof < FEW:
            flags.append(
                f"{axis}: s(T) has {scale.dof} degrees of freedom: its scatter is hardly known"
            )
        flags += [type(flag)(f"{axis}: {flag}") for flag in scale.flags]
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
        (*flags, *_flag_stations(solved)),
        tuple(site),
    )


def _find_sensitivities(
    fits: Mapping[Sensor, ScaleFit], temp_degc: Array, spec: InclinometerRecipe
) -> tuple[Sensitivity, ...]:
    """How s(T) of every gyro moves with errors of the latitude, the thermometer and the gyros, the
    weights of the fit held. A turn of all positions alike moves no root.
    """
    errors = [
        InputError("latitude_deg", "offset", LATITUDE_STEP_DEG),
        *(InputError(f"gyro_{axis}_dph", "scale", SHARE) for axis in spec.axes),
    ]
    known_degc = temp_degc[np.isfinite(temp_degc)]
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


def _flag_stations(solved: SolvedStations) -> tuple[str, ...]:
    """Flags of the stations, refused stations first; stations with the same flag share a line."""
    # stations where a root differs significantly from its prior, or is impossible
    contradicted = np.zeros(solved.refused.size, dtype=np.bool_)
    for axis, pair in solved.solutions.items():
        prior = solved.priors[axis]
        limit = ROOT_DISAGREES * np.hypot(pair.s_root_uncertainty, prior.standard_uncertainty)
        departs = np.abs(pair.s_root - prior.s) > limit
        contradicted |= departs | [WRONG in reason for reason in pair.status]
    lines, count = list[str](), int(contradicted.sum())
    if 2 * count > contradicted.size:
        lines.append(f"{count} of {contradicted.size} stations contradict s(T): {WRONG}")
    combined, texts = solved.combined, list[tuple[str, str]]()
    for name, reason, flags in zip(
        solved.stations.names, combined.status, combined.flags, strict=True
    ):
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


def _seek(
    spec: InclinometerRecipe, records: Mapping[str, Record], log: Log
) -> tuple[SolvedStations, tuple[str, ...]]:
    """Stations of a log with one row per position, solved with a run's s(T), and their flags."""
    if FILE not in records:
        raise CoefficientError(f"the run holds no {FILE}", hint="it is not a run of inclinometer")
    models = {axis: ScaleModel.read(records[FILE].model(axis)) for axis in spec.axes}
    rows = inclinometer_stations.gather_rows([log], spec.on_site())
    stations = inclinometer_stations.solve_components(
        rows, spec, {axis: model.noise for axis, model in models.items()}
    )
    solved = solve.seek_north(stations, models, spec)
    solved.require_consistent(log.file)
    flags, valid, degc = list[str](), models[spec.axes[0]].valid, stations.temperature
    if valid is not None:
        low, high = valid
        unknown, outside = int(np.isnan(degc).sum()), int(((degc < low) | (degc > high)).sum())
        if unknown:
            flags.append(
                f"{log.file}: {unknown} of {degc.size} stations have no temp_case_degc: their"
                f" s may be any of s(T) over {low:.1f} to {high:.1f} °C"
            )
        if outside:
            flags.append(
                f"{log.file}: temperature clamped to {low:.1f} to {high:.1f} °C at {outside} of"
                f" {degc.size} stations"
            )
    return solved, (*flags, *_flag_stations(solved))


def correct(spec: InclinometerRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Correct the rates of every row, in the log's own unit, and add the station's angles to its
    rows.
    """
    # Rows with a missing reading are read, as NaN, rather than dropped: then the pair that lost it
    # has no station there, and the other pair, if there is one, gives its angles.
    refuse_missing = {"logs": spec.logs.model_copy(update={"missing": "refuse"})}
    log = read(spec.model_copy(update=refuse_missing), data.parent, data.name)
    refuse(inclinometer_stations.find_unusable(log, spec))
    dwelt = dwells.find_dwells(log, spec)
    refuse(dwelt.findings)
    solved, flags = _seek(spec, records, dwelt.log)
    stations = solved.stations
    columns = {}
    for axis, solution in solved.solutions.items():
        # a station without a result is corrected by the s(T) of the calibration
        s = np.where(np.isfinite(solution.s), solution.s, solved.priors[axis].s)
        name = f"gyro_{axis}_dph"
        columns[name] = dwelt.along(s[stations.row_station], log) * values(log.frame, name)
    absent = log.frame[list(columns)].isna()
    first_absent = absent[absent.any(axis=1)].idxmax(axis=1)
    lost = [
        (f"no {name}", rows.index.to_numpy()) for name, rows in first_absent.groupby(first_absent)
    ]
    log = replace(log, lost=(*log.lost, *lost))
    combined = solved.combined
    angles = {
        "inclination_deg": combined.inclination_deg,
        "toolface_deg": combined.toolface_deg,
        "azimuth_deg": combined.azimuth_deg,
    }
    if spec.output.azimuth_uncertainty:
        angles["azimuth_standard_uncertainty_deg"] = combined.standard_uncertainty[:, 2]
    angles_shown = {name: np.where(solved.refused, np.nan, angle) for name, angle in angles.items()}
    if spec.output.rows == "station":
        # a row for each station: its number and time, its angles, or why it has none
        first = np.unique(stations.row_station, return_index=True)[1]
        frame = dwelt.log.frame
        shown = [name for name in ("station", "time_s") if name in frame.columns]
        table = {name: values(frame, name)[first] for name in shown}
        table |= {TEMPERATURE: stations.temperature, **angles_shown}
        return write_back.tabulate(spec, log, table, solved.combined.status), flags
    # nor have rows that were recorded while the tool was being turned
    derived = {
        name: dwelt.along(angle[stations.row_station], log, standing=True)
        for name, angle in angles_shown.items()
    }
    return write_back.rewrite_log(spec.on_site(), data, log, columns, derived), flags


def validate(
    spec: InclinometerRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Angle errors before and after correction on stations that were not used in the fit."""
    entries, flags, tables, parts, criteria = [], [], [], [], []
    for log in logs:
        file = log.file
        (admitted,), _ = inclinometer_stations.admit_logs([log], spec)
        solved, station_flags = _seek(spec, records, admitted)
        angles = solved.errors
        if not angles.known.any():
            raise FrameError(
                f"{file}: no station has both a reference azimuth and a result",
                hint="add a column azimuth_deg, or map one under [columns.azimuth_deg]",
            )
        u = angles.standard_uncertainty
        worse = ((np.abs(angles.after) - np.abs(angles.before)) / u)[angles.known]
        columns = zip(solved.stations.names, angles.before, angles.after, u, strict=True)
        entries.append(
            {
                "name": file,
                "sha256": log.sha256,
                "rows": log.rows,
                "stations_used": int((~solved.refused).sum()),
                "stations_refused": int(solved.refused.sum()),
                **{
                    stage: {
                        f"{angle}_{name}_deg": number_or_none(float(size))
                        for angle, sizes in angles.sizes.items()
                        for name, size in zip(("rms", "max"), sizes[k, :2], strict=True)
                    }
                    for k, stage in enumerate(("before", "after"))
                },
                "worse_than_uncorrected_over_u": number_or_none(
                    float(np.fmax.reduce(worse, initial=np.nan))
                ),
                "stations": [
                    {
                        "station": name,
                        "azimuth_error_before_deg": number_or_none(float(before)),
                        "azimuth_error_after_deg": number_or_none(float(after)),
                        "azimuth_standard_uncertainty_deg": number_or_none(float(of_azimuth)),
                        "refused": reason,
                    }
                    for (name, before, after, of_azimuth), reason in zip(
                        columns, solved.combined.status, strict=True
                    )
                ],
            }
        )
        tables.append(figures.tabulate_errors(angles, f"{file}: errors against the reference"))
        flags += [f"{file}: {note}" for note in log.notes] + list(station_flags)
        rms_before, rms_after = angles.sizes["azimuth"][:, 0]  # behind it stands the largest
        if rms_after > rms_before:
            flags.append(
                f"{file}: the azimuth's rms error is {rms_after:.3g}° corrected, {rms_before:.3g}°"
                " uncorrected: s(T) does not hold here; see site.latitude_deg, the gyros, and the"
                " reference azimuths"
            )
        angle, u_angle = angles.turn()
        turn_over_u = abs(angle) / u_angle
        if turn_over_u > solve.TURNED:
            flags.append(
                f"{file}: the azimuths are turned together by {angle:.3f}° ± {u_angle:.2g}°,"
                " expected 0°: the gyros are turned against the accelerometers, or the reference"
                " is; align them, or state what is known of the reference in [[type_b]] with"
                " quantity = 'azimuth_deg'"
            )
        parts.append(angles)
        name = f"{file}: turn that azimuths share, over its u"
        criteria.append(angles.judge_uncertainty(file))
        criteria.append(at_most(name, turn_over_u, solve.TURNED, "1", "calibkit"))
    pooled = (
        np.concatenate([getattr(part, field.name) for part in parts])
        for field in fields(solve.AngleErrors)
    )
    all_criteria = (*criteria, *solve.AngleErrors(*pooled).criteria(spec))
    return {"logs": entries}, Summary("", tuple(tables), tuple(flags), all_criteria)


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Choice of the inclinometer recipe for logs with gyros, a rotation about the tool axis, and
    times or stations.
    """
    columns = evidence.columns
    if "position_deg" in columns and {"station", "time_s"} & columns.keys() and evidence.gyros():
        reason = "gyros beside rotations about the tool axis, with stations or times"
        return evidence.choose("inclinometer", PROPOSED, reason=reason)
    return None

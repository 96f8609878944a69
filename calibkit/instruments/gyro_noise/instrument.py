"""Noise of gyros and accelerometers at rest: records → Allan deviation, noise terms, bias
stability → gyro_noise.json.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calibkit.check import copies
from calibkit.errors import CalibkitError, FitError, UsageError
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.gyro_noise import certificate, deviations, forms
from calibkit.instruments.gyro_noise.deviations import NoiseFigures
from calibkit.instruments.gyro_noise.figures import NoiseReport, summarize, validation_entry
from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe
from calibkit.logs import log_files
from calibkit.logs.evidence import Evidence
from calibkit.logs.recipe_text import RecipeChoice
from calibkit.logs.write_back import Applied
from calibkit.numeric.constants import STANDARD_GRAVITY_MPS2
from calibkit.records.coefficients import Condition, Figure, Input, Record, StageResult
from calibkit.records.frame import Examined, Finding, Log, refuse, values
from calibkit.records.left_out import LeftOut
from calibkit.records.sensitivities import Sensitivity
from calibkit.report.summary import Summary

TEMPERATURES = ("temp_case_degc", "temp_env_degc")
REFERENCES = {"inclination_deg", "toolface_deg", "position", "station", "position_deg"}
"""Columns that say in which attitude a sensor was."""
ACCELERATION = r"accel_[a-z0-9]+_g"
BLOCKS = 50
"""Parts of a log in whose medians an accelerometer that was turned shows it."""
STILL_G = 0.02
"""Change [g] of these medians up to which an accelerometer stood still."""
LONG_S = 600.0
"""Duration [s] from which a steady temperature shows that nothing changed: no chamber ramps so
slowly.
"""

Recipe = GyroNoiseRecipe
FORMS = ()
STAGE = "gyro_noise"
results = certificate.results
KEY_FIGURES = (r"gyro_noise\.(?!allan_deviation|wavelet_deviation).+",)


def read(spec: GyroNoiseRecipe, data: Path, file: str) -> Log:
    """One log in canonical columns; the case temperature is read where the log has it."""
    return log_files.read_log(
        spec, data / file, file, ("time_s", *spec.noise.columns), (deviations.CASE,)
    )


def faults(spec: GyroNoiseRecipe, log: Log) -> Examined:
    """Find what is wrong with one log."""
    findings = deviations.find_faults(log, spec)
    if not any(finding.refused for finding in findings):
        try:
            deviations.place_on_grid(log)
        except FitError as error:
            findings.append(Finding.of(error))
    return Examined(tuple(findings))


def _estimate(
    spec: GyroNoiseRecipe, logs: Iterable[Log]
) -> tuple[list[NoiseFigures], StageResult, tuple[Sensitivity, ...]]:
    """Noise of every record in logs, the content of gyro_noise.json, and how its figures move with
    the scale of an indication, to which each is in proportion, and with its offset, which the mean
    alone feels.
    """
    records, flags = list[NoiseFigures](), list[str]()
    for log in logs:
        findings = deviations.find_faults(log, spec)
        refuse(findings)
        places, source = deviations.place_on_grid(log), Input.of(log)
        flags += [f"{log.file}: {note}" for note in log.notes]
        flags += [str(finding) for finding in findings if finding.flagged]
        for column in spec.noise.columns:
            records.append(deviations.estimate_noise(log, source, column, places, spec))
            flags += records[-1].flags
    figures: list[Figure] = []
    scales: dict[str, dict[str, float]] = {column: {} for column in spec.noise.columns}
    offsets: dict[str, dict[str, float]] = {column: {} for column in spec.noise.columns}
    for noise in records:
        of_record = deviations.list_figures(noise)
        figures += of_record
        scales[noise.column] |= {f"{STAGE}.{figure.name}": figure.value for figure in of_record}
        offsets[noise.column][f"{STAGE}.{of_record[0].name}"] = 1.0
    probability = Condition(forms.PROBABILITY, spec.noise.probability, "1")
    result = StageResult(
        STAGE, figures=tuple(figures), flags=tuple(flags), conditions=(probability,)
    )
    # deviations are differences of means: an offset drops out of them
    sensitivities = [Sensitivity(column, "scale", scales[column]) for column in scales]
    sensitivities += [Sensitivity(column, "offset", offsets[column]) for column in offsets]
    return records, result, tuple(sensitivities)


def fit(
    spec: GyroNoiseRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[NoiseReport]:
    """Estimate the noise of every record."""
    in_turn = log_files.read_ahead(
        progress(files, "reading and averaging"), lambda file: read(spec, data, file)
    )
    records, result, sensitivities = _estimate(spec, copies.refuse_copies(in_turn))
    gaps = [
        LeftOut("samples", noise.missing, noise.curve.samples, "missing", noise.log.name)
        for noise in records
        if noise.missing
    ]
    return Fitted(
        (result,),
        tuple(dict.fromkeys(noise.log for noise in records)),
        summarize(spec.title, records, result, sensitivities, spec),
        NoiseReport(tuple(records)),
        sensitivities=sensitivities,
        left_out=tuple(gaps),
    )


def correct(
    spec: GyroNoiseRecipe,
    records: Mapping[str, Record],  # noqa: ARG001 (the protocol's shape)
    data: Path,  # noqa: ARG001 (the same)
) -> Applied:
    """Refuse: noise is stated, not compensated."""
    raise UsageError(
        f"a run of {spec.procedure} holds nothing to compensate with",
        hint="apply a run of fog_thermal",
    )


def validate(
    spec: GyroNoiseRecipe,
    records: Mapping[str, Record],  # noqa: ARG001 (the protocol's shape)
    logs: Iterable[Log],
) -> tuple[dict[str, Any], Summary]:
    """Noise of records that were not fitted, with the limits of the recipe."""
    unseen, result, sensitivities = _estimate(spec, logs)
    entries = []
    for log in dict.fromkeys(noise.log for noise in unseen):
        of_log = [validation_entry(noise) for noise in unseen if noise.log == log]
        entries.append(
            {"name": log.name, "sha256": log.sha256, "rows": log.rows, "records": of_log}
        )
    return {"logs": entries}, summarize("", unseen, result, sensitivities, spec)


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Recipe for logs with times and rates of gyros, or one log of accelerometers that stood still
    and have no reference; in neither does the temperature change.
    """
    accelerations = [name for name in evidence.columns if re.fullmatch(ACCELERATION, name)]
    columns = [*evidence.gyros("dph"), *accelerations]
    without_temperature = evidence.second_logger and not evidence.columns.keys() & set(TEMPERATURES)
    has_positions = len(evidence.group.files) > 1 or bool(evidence.columns.keys() & REFERENCES)
    was_turned = evidence.turned or (bool(accelerations) and has_positions)
    if "time_s" not in evidence.columns or not columns or without_temperature or was_turned:
        return None
    keys = {} if columns == ["gyro_dph"] else {"columns": json.dumps(columns)}
    reason = "sensors at rest at a steady temperature"
    read = ("time_s", *TEMPERATURES, *columns)
    choice = evidence.choose("gyro_noise", read, keys=keys, reason=reason)
    spec = evidence.recipe(choice)
    if not isinstance(spec, GyroNoiseRecipe):
        return None
    # enough rows for noise, and in no log an acceleration or a temperature that changes; whether a
    # sensor stood still, any gravity tells
    site = spec.site.model_copy(update={"gravity_mps2": STANDARD_GRAVITY_MPS2})
    with_gravity = spec.model_copy(update={"site": site})
    for file in evidence.group.files:
        try:
            log = log_files.read_log(
                with_gravity, evidence.folder / file, file, ("time_s", *columns), TEMPERATURES
            )
        except CalibkitError:
            return None
        logged = [values(log.frame, name) for name in TEMPERATURES if name in log.frame.columns]
        # in a short log a temperature is steady also on a ramp
        long = float(np.ptp(values(log.frame, "time_s"))) >= LONG_S
        steady = all(float(np.ptp(degc)) <= deviations.STEADY_DEGC for degc in logged)
        if len(log.frame) < spec.noise.min_rows or (logged and not (long and steady)):
            return None
        for name in accelerations:
            data = values(log.frame, name)
            blocks = np.array_split(data[~np.isnan(data)], BLOCKS)
            # medians: a knock is no turn
            if np.ptp([np.median(block) for block in blocks if block.size]) > STILL_G:
                return None
    return replace(
        choice,
        remark=(
            "# Taken for sensors at rest, for want of anything that says they moved: of a gyro a"
            " log cannot show it."
        ),
    )

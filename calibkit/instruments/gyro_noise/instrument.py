"""Noise of gyros and accelerometers at rest: records → Allan deviation, noise terms, bias
stability → gyro_noise.json.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.check import copies
from calibkit.coefficients import Condition, Figure, Input, Record, StageResult
from calibkit.constants import STANDARD_GRAVITY_MPS2
from calibkit.errors import CalibkitError, FitError, UsageError
from calibkit.frame import Examined, Finding, Log, refuse, values
from calibkit.ingest import logs as ingest
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.gyro_noise import certificate, deviations, forms
from calibkit.instruments.gyro_noise.figures import NoiseReport, summarize, validation_entry
from calibkit.instruments.gyro_noise.recipe import ACCELEROMETER, GyroNoiseRecipe, find_sensor
from calibkit.left_out import LeftOut
from calibkit.sensitivities import Sensitivity

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.ingest.evidence import Evidence
    from calibkit.ingest.logs import LogReader
    from calibkit.ingest.recipe_text import RecipeChoice
    from calibkit.ingest.write_back import Applied
    from calibkit.instruments.gyro_noise.deviations import NoiseFigures
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


def read(spec: GyroNoiseRecipe, data: Path, file: str, reader: LogReader = ingest.read_log) -> Log:
    """One log in canonical columns; the case temperature is read where the log has it."""
    return reader(spec, data / file, file, ("time_s", *spec.noise.columns), (deviations.CASE,))


def faults(spec: GyroNoiseRecipe, log: Log) -> Examined:
    """Find what is wrong with one log."""
    findings = deviations.find_faults(log, spec)
    if not any(finding.refused for finding in findings):
        try:
            deviations.place_on_grid(log)
        except FitError as error:
            findings.append(Finding.of(error))
    return Examined(tuple(findings))


def _figures(spec: GyroNoiseRecipe, log: Log) -> tuple[list[NoiseFigures], list[str]]:
    """Figures of every record in a log, and the flags of the log and of its records."""
    findings = deviations.find_faults(log, spec)
    refuse(findings)
    places = deviations.place_on_grid(log)
    figures = [
        deviations.estimate_noise(log, column, places, spec) for column in spec.noise.columns
    ]
    return figures, [
        *(f"{log.file}: {note}" for note in log.notes),
        *(str(finding) for finding in findings if finding.flagged),
        *(flag for noise in figures for flag in noise.flags),
    ]


def fit(
    spec: GyroNoiseRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[NoiseReport]:
    """Estimate the noise of every record."""
    inputs, figures, flags, gaps = [], [], [], []
    for log in copies.refuse_copies(
        ingest.read_ahead(
            progress(files, "reading and averaging"), lambda file: read(spec, data, file)
        )
    ):
        of_log, flags_of_log = _figures(spec, log)
        inputs.append(Input.of(log))
        figures += of_log
        flags += flags_of_log
        for noise in of_log:
            if noise.missing:
                samples = noise.curve.samples
                gaps.append(LeftOut("samples", noise.missing, samples, "missing", log.file))
    # each figure is in proportion to the scale of the indication; only the mean feels an offset
    scales: dict[str, dict[str, float]] = {column: {} for column in spec.noise.columns}
    offsets: dict[str, dict[str, float]] = {column: {} for column in spec.noise.columns}
    stage_figures: list[Figure] = []
    for noise in figures:
        of_record, column = deviations.list_figures(noise), noise.column
        stage_figures += of_record
        scales[column] |= {f"{STAGE}.{figure.name}": figure.value for figure in of_record}
        offsets[column][f"{STAGE}.{of_record[0].name}"] = 1.0
    conditions = (Condition(forms.PROBABILITY, spec.noise.probability, "1"),)
    result = StageResult(
        STAGE, figures=tuple(stage_figures), flags=tuple(flags), conditions=conditions
    )
    sensitivities = [Sensitivity(column, "scale", scales[column]) for column in scales]
    sensitivities += [Sensitivity(column, "offset", offsets[column]) for column in offsets]
    return Fitted(
        (result,),
        tuple(inputs),
        summarize(spec.title, figures, flags, spec.acceptance),
        NoiseReport(tuple(figures)),
        sensitivities=tuple(sensitivities),
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
    """Noise of records that were not fitted, held against the recipe's limits."""
    entries, figures, flags = [], [], []
    for log in logs:
        of_log, flags_of_log = _figures(spec, log)
        entries.append(
            {
                "name": log.file,
                "sha256": log.sha256,
                "rows": log.rows,
                "records": [validation_entry(noise) for noise in of_log],
            }
        )
        figures += of_log
        flags += flags_of_log
    return {"logs": entries}, summarize("", figures, flags, spec.acceptance)


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
    try:
        if not all(_is_steady(spec, evidence.folder, file) for file in evidence.group.files):
            return None
    except CalibkitError:
        return None
    return replace(
        choice,
        remark=(
            "# Taken for sensors at rest, for want of anything that says they moved: of a gyro a"
            " log cannot show it."
        ),
    )


def _is_steady(spec: GyroNoiseRecipe, folder: Path, file: str) -> bool:
    """Whether one log has rows enough for noise, and no acceleration and no temperature in it
    changes.
    """
    columns = ("time_s", *spec.noise.columns)
    # whether a sensor stood still, any gravity tells
    site = spec.site.model_copy(update={"gravity_mps2": STANDARD_GRAVITY_MPS2})
    with_gravity = spec.model_copy(update={"site": site})
    frame = ingest.read_log(with_gravity, folder / file, file, columns, TEMPERATURES).frame
    if len(frame) < spec.noise.min_rows:
        return False
    for name in spec.noise.columns:
        if find_sensor(name) is ACCELEROMETER:
            data = values(frame, name)
            blocks = np.array_split(data[~np.isnan(data)], BLOCKS)
            if np.ptp([np.median(block) for block in blocks if block.size]) > STILL_G:
                return False
    logged = [values(frame, name) for name in TEMPERATURES if name in frame.columns]
    long = float(np.ptp(values(frame, "time_s"))) >= LONG_S
    return not logged or (
        long and all(float(np.ptp(temperature)) <= deviations.STEADY_DEGC for temperature in logged)
    )

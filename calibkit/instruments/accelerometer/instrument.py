"""Triaxial accelerometer: dwells → accel_k.json, accel_q.json, accel_affine.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.check import copies
from calibkit.errors import FitError, RecipeError
from calibkit.instruments import Fitted
from calibkit.instruments.accelerometer import (
    corrections,
    dwells as triad_dwells,
    findings,
    forms,
    plausibility,
)
from calibkit.instruments.accelerometer.corrections import Correction, DwellErrors
from calibkit.instruments.accelerometer.figures import TriadReport
from calibkit.instruments.accelerometer.fit import find_sensitivities, fit_triad
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.logs import log_files, write_back
from calibkit.numeric import attitude
from calibkit.numeric.dispersion import rms
from calibkit.records.coefficients import Criterion, Input
from calibkit.records.frame import refuse, require, values
from calibkit.records.left_out import LeftOut
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.run import list_components
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.instruments import Progress
    from calibkit.instruments.accelerometer.dwells import DwellSet
    from calibkit.instruments.accelerometer.triad import Triad
    from calibkit.logs.write_back import Applied
    from calibkit.records.coefficients import Record, StageResult
    from calibkit.records.frame import Log
    from calibkit.report.table import Table

CORRECTIONS = {"accel_k": "K-factor", "accel_affine": "affine"}
"""Stage → name of its correction in the table of errors."""

Recipe = AccelerometerRecipe
FORMS = forms.FORMS
KEY_FIGURES = (
    r"accel_k\.accel_\w\.(K\d|residual_rms)",
    r"accel_q\.triad\.(Q\d|residual_rms)",
    r"accel_affine\.triad\.(k_\w0|z_\w0|m_\w\w0|b_\w0|residual_rms)",
)
faults = plausibility.examine


def read(spec: AccelerometerRecipe, data: Path, file: str) -> Log:
    """One log in canonical columns; m/s² become g by the site's gravity."""
    angles: tuple[str, ...] = (forms.TEMPERATURE, *triad_dwells.ATTITUDE)
    required: tuple[str, ...] = (*angles, *forms.COMPONENTS)
    optional: tuple[str, ...] = ("time_s",)
    if spec.reference.kind == "magnitude":
        required, optional = forms.COMPONENTS, (*angles, "time_s")
    if spec.dwells.mode == "series":
        required, optional = ("time_s", *required), optional[:-1]
    return log_files.read_log(spec.on_site(), data / file, file, required, optional)


def fit(
    spec: AccelerometerRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[TriadReport]:
    """Fit K-factor, Q-factor and the triad to the dwells of all logs together."""
    refuse_recipe(spec)
    in_turn = log_files.read_ahead(progress(files, "reading"), lambda file: read(spec, data, file))
    logs = list(copies.refuse_copies(in_turn))
    dwells = plausibility.read_plausible(logs, spec)
    triad, results = fit_triad(dwells, spec)
    influences = find_sensitivities(triad, results, dwells, spec)
    # what follows is shown, and changes no number
    report, summary = summarise(triad, results, dwells, spec)
    suspects = len(triad.suspects)
    left_out = LeftOut("positions", suspects, len(dwells.place), "outlier")
    return Fitted(
        results,
        tuple(Input.of(log) for log in logs),
        summary,
        report,
        lacks=spec.k.not_fitted if results[0].stage == "accel_k" else (),
        sensitivities=influences,
        left_out=(left_out,) if suspects else (),
    )


def refuse_recipe(spec: AccelerometerRecipe) -> None:
    """Raise RecipeError for terms without an effect, and FitError for what 0.2 offered and this fit
    has no more: here and not in the recipe, because a run of 0.2 with such a recipe is read.
    """
    for term in ("second_order", "third_order", "tilt", "fixture"):
        if getattr(spec.affine, term) and not spec.affine.enabled:
            raise RecipeError(
                f"affine.{term} = true has no effect beside affine.enabled = false",
                hint="remove one of the two",
                at=("affine", term),
            )
    no_more = (
        (spec.compensation == "kq", corrections.MIXED, corrections.IN_STEAD),
        (
            spec.k.groups == "log",
            "k.groups = 'log': K has no covariance of its own from logs left out any more",
            "remove it: errors that dwells of a soak or an attitude share are estimated",
        ),
        (
            spec.affine.enabled and spec.affine.cross_order > 1,
            "affine.cross_order above 1: cross-axis terms are linear in temperature at most",
            "state 1",
        ),
    )
    for is_asked, message, hint in no_more:
        if is_asked:
            raise FitError(message, hint=hint)


def summarise(
    triad: Triad, results: Sequence[StageResult], dwells: DwellSet, spec: AccelerometerRecipe
) -> tuple[TriadReport, Summary]:
    """Errors of the dwells that were fitted before and after correction, as drawn and as printed,
    and whether they are accepted.
    """
    suspects = triad.suspects
    counted = dwells.without(suspects) if suspects else dwells
    raw = DwellErrors.compare(counted, spec)
    by_stage = {
        result.stage: DwellErrors.compare(counted, spec, Correction(result.models))
        for result in results
        if result.stage in CORRECTIONS
    }
    stage = corrections.COMPENSATIONS[spec.compensation]
    corrected = by_stage[stage]
    out = f", {len(suspects)} left out" if suspects else ""
    compared = corrections.tabulate_errors(
        {"indication": raw} | {CORRECTIONS[name]: after for name, after in by_stage.items()},
        spec,
        f"The fitted dwells before and after{out}",
    )
    components = list_components("Errors that dwells share", results[-1].models[:1])
    tables = [components] if components.rows else []
    tables.append(compared)
    remarks = findings.remark_on_dwells(dwells, spec)
    flags = dict.fromkeys((*dwells.flags, *remarks, *triad.flags))
    criteria = (*corrected.judge_errors(spec), *findings.judge_unexplained(triad, dwells))
    before, after = (1e6 * errors.residual_rms_g for errors in (raw, corrected))
    sentence = (
        f"Residual of {len(counted.place)} dwells{out} (rms): {before:.0f} µg before,"
        f" {after:.0f} µg after the {CORRECTIONS[stage]} correction."
    )
    key_values = [
        KeyValue("residual rms, before", before, "µg"),
        KeyValue("residual rms, after", after, "µg"),
    ]
    if corrected.figures:
        tilt = corrected.figures["inclination_max_deg"]
        key_values.append(KeyValue("largest inclination error, after", tilt, "°"))
    noises = [p.value for p in results[-1].models[0].parameters if p.name.startswith("noise_")]
    if noises:
        key_values.append(KeyValue("noise of the dwells", 1e6 * rms(noises), "µg"))
    overview = Overview(sentence, (), tuple(key_values), compared)
    summary = Summary(spec.title, tuple(tables), tuple(flags), criteria, overview=overview)
    return TriadReport(counted, raw, corrected, spec), summary


def correct(spec: AccelerometerRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Correct every row of a log, in the log's own unit and sign, and add inclination and
    toolface.
    """
    lengths = spec.model_copy(
        update={"reference": spec.reference.model_copy(update={"kind": "magnitude"})}
    )
    columns_beside = (forms.TEMPERATURE, *triad_dwells.ATTITUDE, "time_s")
    log = log_files.read_log(spec.on_site(), data, data.name, forms.COMPONENTS, columns_beside)
    refuse(triad_dwells.find_faults(log, lengths))
    correction = corrections.find_correction(spec.compensation, records.values())
    low, high = correction.models[0].valid[forms.TEMPERATURE]
    if high > low:  # else temperature changes nothing
        require(log.file, log.frame.columns, [forms.TEMPERATURE])
    temperature = values(log.frame, forms.TEMPERATURE, low)
    logged = log.frame[[*forms.COMPONENTS]].to_numpy(dtype=np.float64)
    indication = attitude.gravity_positive(logged, spec.reference.convention)
    vector = correction(indication, temperature)
    outside = correction.readings(indication, temperature)[1].mean()
    clamped = (
        f"{log.file}: temperature clamped to {low:.1f} … {high:.1f} °C over"
        f" {100.0 * outside:.1f} % of the rows"
    )
    own_sign = attitude.gravity_positive(vector, spec.reference.convention)
    columns = dict(zip(forms.COMPONENTS, own_sign.T, strict=True))
    found_angles = attitude.inclination(vector), attitude.toolface(vector)
    angles = dict(zip(triad_dwells.ATTITUDE, found_angles, strict=True))
    applied = write_back.rewrite_log(spec.on_site(), data, log, columns, angles)
    return applied, (clamped,) if outside > 0.0 else ()


def validate(
    spec: AccelerometerRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Attitude errors before and after correction on dwells that were not used in the fit."""
    correction = corrections.find_correction(spec.compensation, records.values())
    entries: list[dict[str, object]] = []
    tables: list[Table] = []
    flags: list[str] = []
    criteria: list[Criterion] = []
    for log in logs:
        dwells = triad_dwells.collect_dwells([log], spec)
        before = DwellErrors.compare(dwells, spec)
        after = DwellErrors.compare(dwells, spec, correction)
        entries.append(
            {
                "name": log.file,
                "sha256": log.sha256,
                "rows": log.rows,
                "before": corrections.list_errors(before, spec),
                "after": corrections.list_errors(after, spec),
            }
        )
        compared = {"indication": before, "corrected": after}
        tables.append(corrections.tabulate_errors(compared, spec, log.file))
        criteria += [
            after.judge_uncertainty(log.file, dwells, correction, spec.type_b),
            *after.judge_errors(spec, correction),
        ]
        flags += (*dwells.flags, *map(str, plausibility.find_implausible(dwells, spec)[1]))
        outside = correction.readings(dwells.indication, dwells.temperature)[1].mean()
        if outside > 0.0:
            flags.append(
                f"{log.file}: temperature clamped over {100.0 * outside:.1f} % of the dwells"
            )
    return {"logs": entries}, Summary("", tuple(tables), tuple(flags), tuple(criteria))

"""Thermal drift of a fibre-optic gyro: ramps → denoise.json, drift.json, drift_rate.json.

A log is denoised, cut into soaks and ramps, and averaged over the model interval (`ramps`). The
published scheme and models of the rate itself (`numeric.choice`) are fitted without each ramp or
rate in turn; what leaves least there is exported (`drift_choice`), with the bias at rest
(`at_rest`) and the uncertainty of what is taken off (`compensate`).
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.check import copies, find_unusable, flag_bridged_gaps, magnitude, thermometers
from calibkit.errors import FitError
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.bias import (
    at_rest,
    certificate,
    compensate,
    drift_choice,
    figures,
    forms,
    ramps,
    sensitivities,
    tables,
)
from calibkit.instruments.bias.recipe import FogThermalRecipe
from calibkit.logs import log_files, two_loggers, write_back
from calibkit.numeric.dispersion import rms
from calibkit.recipe import type_b
from calibkit.records.coefficients import (
    Criterion,
    Record,
    StageResult,
    at_least,
    at_most,
    over_stated_u,
)
from calibkit.records.frame import Finding, Log, refuse, values
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.logs.evidence import Evidence
    from calibkit.logs.recipe_text import RecipeChoice
    from calibkit.logs.write_back import Applied
    from calibkit.report.table import Table

Recipe = FogThermalRecipe
KEY_FIGURES = (
    r"drift\..+\.(a\d|residual_rms)",
    r"drift_rate\..+\.([abcsghw]\d+|s_\w+|tau_\w+|residual_rms)",
    r"drift_rate\.(raw_drift_rms|drift_rms_before|drift_rms_after|rate_gain_recursive)\..+",
)
FORMS = (forms.PER_RAMP, forms.OVER_RATES, *forms.ON_LEVELS.values())
faults = ramps.examine


def fit(
    spec: FogThermalRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[figures.DriftReport]:
    """Fit the drift coefficients of every ramp, their polynomials over temperature rate and the
    models of the rate itself, and export what leaves least of the drift of left-out ramps.
    """
    logs, comparisons = _prepare(spec, data, progress(files, "reading and denoising"))
    fitted, undetermined = drift_choice.fit_ramps(logs, spec.drift)
    # polynomials over the rate need the coefficients of every ramp
    sides = drift_choice.choose_sides([] if undetermined else fitted, spec.drift)
    levels = drift_choice.choose_on_levels(logs, spec.drift)
    export = drift_choice.widen_by_turn_on(drift_choice.decide(sides, levels, spec), logs)
    model = export.model
    compensated = [compensate.LogFigures.summarize(log.name, log.raw, model) for log in logs]
    rest = at_rest.state_bias(model, logs, spec)
    interval_s = spec.drift.interval_s
    drift = StageResult(
        "drift",
        models=tuple(forms.write_ramp(item.ramp.name, item.fit, interval_s) for item in fitted),
        flags=(*(flag for log in logs for flag in log.flags), *undetermined),
    )
    exported = export.result(compensated, spec)
    exported = replace(
        exported,
        figures=(*exported.figures, *rest.figures),
        conditions=at_rest.conditions(spec),
        flags=(*exported.flags, *drift_choice.flag_worse(export, compensated), *rest.flags),
    )
    one_way = drift_choice.flag_one_way(logs, model)
    flags = [*drift.flags, *exported.flags, *_flag_idle(spec), *one_way, *comparisons]
    influences = (*sensitivities.find(exported), *sensitivities.find_of_ramps(fitted, spec.drift))
    along_logs = compensate.state_along_logs(model, logs, spec.type_b)
    noise = tuple(figure for log in logs for figure in log.noise)
    denoised = StageResult("denoise", figures=noise, flags=() if noise else ("denoising is off",))
    return Fitted(
        (denoised, drift, exported),
        tuple(log.source for log in logs),
        Summary(
            spec.title,
            (
                *_tabulate(logs, export, rest, spec),
                *tabulate_fit([exported, drift], spec, influences, certificate.blocks),
            ),
            tuple(dict.fromkeys(flags)),
            _judge_fit(spec, export, compensated),
            overview=tables.summarize_fit(logs, compensated, export, along_logs, rest.at_rest),
        ),
        figures.DriftReport(
            model.interval_s,
            tuple(logs),
            tuple(compensated),
            tuple(item.fit for item in fitted),
            tuple(side.polynomial for side in sides if side.polynomial is not None),
            bool(model.polynomials),
            tuple(rest.hysteresis),
        ),
        (*along_logs, *rest.uncertainty),
        (*export.untested, *one_way),
        model.exported,
        sensitivities=influences,
    )


def _tabulate(
    logs: Sequence[ramps.PreparedLog],
    export: drift_choice.Export,
    rest: at_rest.StatedBias,
    spec: FogThermalRecipe,
) -> list[Table]:
    """Tables of what tested models leave, and of fitted logs within what is stated of them."""
    covered = {
        log.name: compensate.check_coverage(export.model, log.raw, spec.type_b, rest.figures)
        for log in logs
    }
    return [tables.tabulate_tested(export), *tables.coverage_tables(covered, "fitted")]


def _flag_idle(spec: FogThermalRecipe) -> list[str]:
    """Flag of type B terms that change nothing."""
    idle = [
        term.name
        for term in spec.type_b
        if not type_b.enters(term, compensate.RESULT, compensate.THERMOMETERS)
    ]
    unused = f"type B terms that do not enter the compensated rate: {', '.join(idle)}"
    return [unused] if idle else []


def _judge_fit(
    spec: FogThermalRecipe,
    export: drift_choice.Export,
    compensated: Sequence[compensate.LogFigures],
) -> tuple[Criterion, ...]:
    """Criteria of a fit: the drift is reduced on left-out ramps, or on the fitted ones where none
    was left out.
    """
    name, reduction = "drift reduction on withheld ramps", 1.0
    if export.errors:
        # ramps that took no part in the fit: the fitted ones would flatter it
        reduction = 1.0 / drift_choice.share_of_raw(export.errors)
    elif export.model.exported:
        name = "drift reduction on the fitted ramps alone"
        reduction = drift_reduction(compensated)
    left_out = [(errors.pooled, export.left_out_noise) for errors in export.errors]
    return judge(spec, export.model, compensated, (name, reduction), over_noise=left_out)


def _prepare(
    spec: FogThermalRecipe, data: Path, files: Iterable[str]
) -> tuple[list[ramps.PreparedLog], list[str]]:
    """Prepared logs, each read and checked while the previous one is denoised, and flags of what
    comparing them shows.
    """
    findings: dict[str, list[Finding]] = {}

    def checked(file: str) -> Log:
        log = read(spec, data, file)
        findings[file] = ramps.find_faults(log, spec)
        return log

    logs = [
        ramps.prepare(log, spec, findings[log.file])
        for log in copies.refuse_copies(log_files.read_ahead(files, checked))
    ]
    levels, slopes, rates, driven = {}, {}, {}, {}
    for log in logs:
        name, raw = log.source.name, log.raw
        levels[name] = magnitude.measure_level(raw.indication)
        slopes[name] = magnitude.fit_drift_slope(raw.case, raw.indication)
        # a log of several ramps has no rate of its own to compare with its name or with other logs
        if len(log.ramps) == 1:
            rates[name] = log.ramps[0].rate
            lag = thermometers.measure_lag(raw.time, raw.case, raw.case - raw.gradient)
            driven[name] = rates[name], float(np.ptp(raw.time)), lag
    refuse([finding for _, finding in magnitude.find_turned_logs(levels)])
    comparisons = (
        *magnitude.find_compensated_logs(slopes),
        *thermometers.check_rates_in_names(rates),
        *thermometers.find_late(driven),
    )
    return logs, [str(finding) for _, finding in comparisons]


def read(spec: FogThermalRecipe, data: Path, file: str) -> Log:
    """One log in canonical columns."""
    return log_files.read_log(spec, data / file, file, ramps.COLUMNS)


def drift_reduction(logs: Sequence[compensate.LogFigures]) -> float:
    """Ratio of the drift rms of logs before to that after compensation."""
    return rms([log.before for log in logs]) / rms([log.after for log in logs])


def judge(
    spec: FogThermalRecipe,
    model: compensate.DriftModel,
    logs: Sequence[compensate.LogFigures],
    reduction: tuple[str, float] | None,
    *,
    over_noise: Sequence[tuple[float, float]] = (),
    covered: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> tuple[Criterion, ...]:
    """Acceptance criteria of fits and validations, each where the recipe limits it.

    They are the reduction of the drift by its name; whether errors of 100 s means of the `covered`
    logs are as large as stated, which no limit needs, and the share of them within U; the drift rms
    that is left over the noise alone, of pairs of both or of the logs; the largest drift rms after
    compensation; and the rate gain.

    Raises FitError where no noise can be separated from what is left.
    """
    limits, criteria = spec.acceptance, []
    if limits.min_reduction is not None and reduction is not None:
        criteria.append(at_least(*reduction, limits.min_reduction, "1"))
    criteria += over_stated_u((f"{name}: rms error", entry) for name, entry in covered.items())
    compared = [entry for entry in covered.values() if "means_of_100_s" in entry]
    if limits.min_share_within_uncertainty is not None and compared:
        share = np.average(
            [entry["share_within_expanded_uncertainty"] for entry in compared],
            # shares of logs count by their lengths
            weights=[entry["means_of_100_s"] for entry in compared],
        )
        name = "share of 100 s means within their uncertainty"
        criteria.append(at_least(name, float(share), limits.min_share_within_uncertainty, "1"))
    if limits.max_residual_over_noise is not None:
        pairs = over_noise or [(log.after, log.split.noise) for log in logs]
        left, noise = (rms(column) for column in zip(*pairs, strict=True))
        if left > 0.0 and noise == 0.0:
            raise FitError(
                f"the noise cannot be separated from the drift that is left, {left:.3g} deg/h rms,"
                " expected their ratio for max_residual_over_noise ="
                f" {limits.max_residual_over_noise:g}",
                hint="log longer ramps or soaks, or state [acceptance] max_drift_rms_dph in its"
                " place",
            )
        ratio = left / noise if left > 0.0 else 0.0
        criteria.append(at_most("residual over noise", ratio, limits.max_residual_over_noise, "1"))
    if limits.max_drift_rms_dph is not None:
        largest = max(log.after for log in logs)
        criteria.append(
            at_most("largest drift rms after", largest, limits.max_drift_rms_dph, "deg/h")
        )
    # the other forms do not integrate, and pass a constant rate as it is
    if model.mode == "recursive" and model.exported:
        off = max(abs(log.gain_recursive - 1.0) for log in logs)
        criteria.append(at_most("rate gain off 1 by", off, limits.rate_gain_tolerance, "1"))
    return tuple(criteria)


def correct(spec: FogThermalRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Compensate every row of a log; the indication keeps its unit and sign in the log."""
    model = compensate.DriftModel.read(records, spec)
    log = log_files.read_log(spec, data, data.name, model.columns)
    refuse(find_unusable(log, 3))
    output, flags = compensate.compensate_log(log, model, spec)
    gyro = values(log.frame, "gyro_dph")
    drift = gyro - output
    flags = (*flag_bridged_gaps(log), *magnitude.flag_missing_drift(log.file, drift, gyro), *flags)
    added = {"gyro_drift_dph": drift} if spec.output.drift else {}
    if spec.output.rate_uncertainty:
        # of the drift taken off, without noise
        _, blocks = ramps.block_means(log, spec, rated=False)
        standard = compensate.along_blocks(model, blocks, spec.type_b).standard
        time = values(log.frame, "time_s")
        # drift is slow: u between model intervals is a line
        added["gyro_standard_uncertainty_dph"] = np.interp(time, blocks.time, standard)
    return write_back.rewrite_log(spec, data, log, {"gyro_dph": output}, added), flags


def validate(
    spec: FogThermalRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Validation: drift rms before and after, rate gain and coverage of the uncertainty on logs
    that were not fitted.
    """
    model = compensate.DriftModel.read(records, spec)
    figures_of_run = records[forms.FILE].figures
    compensated, entries = [], []
    for log in logs:
        refuse(find_unusable(log, 3))
        _, blocks = ramps.block_means(log, spec, rated=bool(model.polynomials))
        log_figures = compensate.LogFigures.summarize(log.name, blocks, model)
        compensated.append(log_figures)
        output, _ = compensate.compensate_log(log, model, spec)
        within = compensate.check_coverage(model, blocks, spec.type_b, figures_of_run)
        entries.append(tables.validation_entry(log, log_figures, model.mode, output, within))
    flags = tuple(flag for log in compensated for flag in log.flags)
    flags += model.thermal.flags if model.thermal is not None else ()
    if not model.exported:
        flags = ("the run exports no drift term: before and after are the same", *flags)
    if model.mode == "one_step":
        flags = (
            "one_step removes the true rate (rate gain 0); the table shows the recursive form",
            *flags,
        )
    covered: dict[str, Any] = {
        log.name: entry["uncertainty"] for log, entry in zip(compensated, entries, strict=True)
    }
    # off the rate at rest of the fit by more than turn-on biases of the fitted logs and U explain
    flags += tuple(
        f"{name}: the compensated rate is {entry['offset']:+.3g} deg/h off the rate at rest of the"
        f" fit, expected within {entry['offset_expanded_uncertainty']:.2g} deg/h by the turn-on"
        " biases of the fitted logs and U: another attitude or place, or a bias that changed"
        for name, entry in covered.items()
        if "offset" in entry and abs(entry["offset"]) > entry["offset_expanded_uncertainty"]
    )
    reduction = ("drift reduction", drift_reduction(compensated)) if model.exported else None
    criteria = judge(
        spec,
        model,
        compensated,
        reduction,
        covered={entry["name"]: entry["uncertainty"] for entry in entries},
    )
    first_screen = tables.summarize_validation(compensated, entries)
    summary_tables = (
        *filter(None, [first_screen.table]),
        *tables.coverage_tables(covered, "validated"),
    )
    return {"logs": entries}, Summary("", summary_tables, flags, criteria, overview=first_screen)


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Proposed recipe for a log with time, case and chamber temperature and a gyro (the first of
    several), of which a second logger may have the chamber's; None otherwise.
    """
    gyros, columns = evidence.gyros(), evidence.columns
    chamber = None if "temp_env_degc" in columns else two_loggers.propose_chamber(evidence)
    case = "temp_case_degc"
    if not gyros or evidence.turned or not {"time_s", case} <= columns.keys():
        return None
    if not evidence.warms(case) or (chamber is None and "temp_env_degc" not in columns):
        return None
    first, *other_gyros = gyros.items()
    base = {name: column for name, column in columns.items() if name not in gyros}
    reason = "a gyro beside case and chamber temperatures"
    chosen_columns = base | {"gyro_dph": first[1]}
    tables, joined = chamber or ("", ())
    if chamber:
        reason = f"a gyro and its temperature beside a second logger's ({joined[0]})"
    choice = evidence.choose("fog_thermal", ramps.COLUMNS, chosen_columns, reason=reason)
    return replace(choice.with_others(other_gyros), tables=tables, joined=joined)

"""Thermal drift of a fibre-optic gyro: ramps → denoise.json, drift.json, drift_rate.json."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.check import bridged, copies, magnitude, thermometers
from calibkit.coefficients import at_least, at_most
from calibkit.errors import CoefficientError
from calibkit.frame import refuse, values
from calibkit.ingest import logs as ingest
from calibkit.ingest import write_back
from calibkit.instruments import Fitted, Instrument
from calibkit.instruments.fog_thermal import (
    bias,
    compensate,
    decision,
    gradient_file,
    level_file,
    noise,
    uncertainty,
)
from calibkit.instruments.fog_thermal import figures as pages
from calibkit.instruments.fog_thermal import ramps as fog_ramps
from calibkit.instruments.fog_thermal import tables as fog_report
from calibkit.instruments.fog_thermal.numeric import gradient
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.numeric.dispersion import rms
from calibkit.report.documents import Drawn
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Criterion, Record
    from calibkit.frame import Examined, Finding, Log
    from calibkit.ingest.logs import Reader
    from calibkit.ingest.proposal import Choice, Evidence
    from calibkit.ingest.write_back import Applied
    from calibkit.instruments import Firmware, Progress
    from calibkit.simulate.campaign import Campaign


def fit(
    spec: FogThermalRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[pages.DriftReport]:
    """Fit the drift coefficients of every ramp and their polynomials over temperature rate."""
    prepared = _prepared(spec, data, progress(files, "reading and denoising"))
    ramps = gradient_file.fit_ramps(prepared, spec.drift)
    choices = gradient_file.choose(ramps, spec.drift)
    levels = level_file.choose(prepared, spec.drift)
    export = decision.decide(choices, levels, spec)
    model = export.model
    figures = [compensate.figures_of(log.name, log.raw, model) for log in prepared]
    rest, left = bias.at_rest(model, prepared, spec), bias.hysteresis(model, prepared)
    exported = decision.result(export, choices, levels, figures, spec)
    more = (*bias.figures(rest), *bias.hysteresis_figures(left))
    results = (
        fog_ramps.denoise_result(prepared),
        gradient_file.drift_result(ramps, spec.drift),
        replace(
            exported,
            figures=(*exported.figures, *more),
            conditions=bias.conditions(spec),
            flags=(*exported.flags, *bias.flags(rest, spec)),
        ),
    )
    flags = [flag for result in results[1:] for flag in result.flags]
    stated = uncertainty.stated(model, prepared, spec.type_b)
    flags += uncertainty.unused(spec.type_b)
    slopes = {
        log.source.name: magnitude.drift_slope(log.raw.case, log.raw.indication) for log in prepared
    }
    flags += [str(finding) for _, finding in magnitude.compensated_before(slopes)]
    rates = {log.source.name: log.ramps[0].rate for log in prepared if len(log.ramps) == 1}
    flags += [str(finding) for _, finding in thermometers.named(rates)]
    tested = fog_report.tested(choices, levels, export)
    criteria = _fit_criteria(spec, export, figures)
    summary = fog_report.summary(spec.title, figures, ramps, tested, stated, flags, criteria)
    summary = replace(
        summary, tables=(*summary.tables, *bias.tables(rest), *bias.hysteresis_tables(left))
    )
    report = fog_report.drift_report(
        spec.title or spec.procedure, prepared, ramps, choices, tested, model
    )
    report = replace(report, hysteresis=fog_report.hysteresis_view(left))
    sources = tuple(log.source for log in prepared)
    uncertainties = (*uncertainty.document(stated), *bias.uncertainty(rest, spec))
    return Fitted(results, sources, summary, report, uncertainties)


def _prepared(
    spec: FogThermalRecipe, data: Path, files: Iterable[str]
) -> list[fog_ramps.PreparedLog]:
    """Logs as later stages need them; each is read and checked while the one before it is
    denoised.
    """
    findings: dict[str, list[Finding]] = {}

    def checked(file: str) -> Log:
        log = read(spec, data, file)
        findings[file] = fog_ramps.findings(log, spec)
        return log

    logs = copies.distinct(ingest.read_ahead(files, checked))
    return [fog_ramps.prepare(log, spec, findings[log.file]) for log in logs]


def read(spec: FogThermalRecipe, data: Path, file: str, reader: Reader = ingest.read_log) -> Log:
    """One log in canonical columns."""
    return reader(spec, data / file, file, fog_ramps.COLUMNS)


def _fit_criteria(
    spec: FogThermalRecipe, export: decision.Export, figures: Sequence[compensate.LogFigures]
) -> tuple[Criterion, ...]:
    """Acceptance limits of a fit: on withheld ramps where they could be tested, and the rate gain
    of what is exported.
    """
    least = spec.acceptance.min_reduction
    criteria = []
    if least is not None:
        reduction = 1.0 if export.share_of_raw is None else 1.0 / export.share_of_raw
        criteria.append(at_least("drift reduction on withheld ramps", reduction, least, "1"))
    if export.model.exported:
        criteria.append(_worst_share(figures))
    return (*criteria, *_common_criteria(spec, figures, export.model))


def _worst_share(figures: Sequence[compensate.LogFigures]) -> Criterion:
    """No log may come out of compensation worse than it went in."""
    worst = max(log.after / log.before for log in figures)
    return at_most("largest after/before of a log", worst, 1.0, "1")


def _common_criteria(
    spec: FogThermalRecipe, figures: Sequence[compensate.LogFigures], model: compensate.DriftModel
) -> tuple[Criterion, ...]:
    """Limits that fits and validations share: the largest drift left, and the rate gain of the
    chosen compensation.
    """
    limits = spec.acceptance
    criteria: list[Criterion] = []
    if limits.max_drift_rms_dph is not None:
        worst = max(log.after for log in figures)
        criteria.append(
            at_most("largest drift rms after", worst, limits.max_drift_rms_dph, "deg/h")
        )
    if model.mode == "recursive" and model.exported:
        off = max(abs(log.gain_recursive - 1.0) for log in figures)
        criteria.append(at_most("rate gain off 1 by", off, limits.rate_gain_tolerance, "1"))
    return tuple(criteria)


def examine(spec: FogThermalRecipe, log: Log) -> Examined:
    """Find what is wrong with one log, all that would stop a fit, and its soaks and ramps."""
    return fog_ramps.examine(log, spec)


def _model(spec: FogThermalRecipe, records: Mapping[str, Record]) -> compensate.DriftModel:
    """Drift model of a run's files."""
    if "drift_rate.json" not in records:
        raise CoefficientError(
            "the run holds no drift_rate.json", hint="it is not a run of fog_thermal"
        )
    return compensate.model_from(records["drift_rate.json"], spec)


def apply(spec: FogThermalRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Compensate every row of a log; the indication keeps the log's own unit and sign."""
    model = _model(spec, records)
    log = ingest.read_log(spec, data, data.name, fog_ramps.COLUMNS)
    refuse(fog_ramps.usable(log))
    output, flags = compensate.compensated(log, model, spec)
    gyro = values(log.frame, "gyro_dph")
    flags = (
        *bridged(log),
        *magnitude.undrifting(log.file, compensate.taken_off(log, output), gyro),
        *flags,
    )
    added = {}
    if spec.output.rate_uncertainty:
        added["gyro_standard_uncertainty_dph"] = compensate.uncertainty(log, model, spec)
    return write_back.rewrite_log(spec, data, {"gyro_dph": output}, added), flags


def validate(
    spec: FogThermalRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Drift rms before and after, and the rate gain, of logs that were not fitted."""
    model = _model(spec, records)
    figures, entries = [], []
    for log in logs:
        refuse(fog_ramps.usable(log))
        time, case, env, gyro = (values(log.frame, column) for column in fog_ramps.COLUMNS)
        _, slope = fog_ramps.cut(log, spec)
        blocks = gradient.blocks(time, case, env, gyro, slope, model.interval_s)
        found = compensate.figures_of(log.name, blocks, model)
        figures.append(found)
        output, _ = compensate.compensated(log, model, spec)
        stated = uncertainty.coverage(model, blocks, spec.type_b)
        entry = fog_report.validation_entry(log, found, model) | {"uncertainty": stated}
        entries.append(entry | {"allan_deviation": noise.residual(time, gyro, output)})
    flags = tuple(flag for log in figures for flag in log.flags)
    flags += model.thermal.flags if model.thermal is not None else ()
    if not model.exported:
        flags = ("the run exports no drift term: before and after are the same", *flags)
    if model.mode == "one_step":
        flags = (
            "one_step removes the true rate (rate gain 0); the table shows the recursive form",
            *flags,
        )
    shares = _validation_criteria(spec, figures) if model.exported else ()
    criteria = (*shares, *_covered(spec, entries), *_common_criteria(spec, figures, model))
    tables = (fog_report.before_after_table(figures), *fog_report.coverage_tables(entries))
    return {"logs": entries}, Summary("", tables, flags, criteria)


def _covered(spec: FogThermalRecipe, logs: Sequence[Mapping[str, Any]]) -> tuple[Criterion, ...]:
    """The limit on how many 100 s means are as near to their log's mean as the stated uncertainty
    says.
    """
    least = spec.acceptance.min_share_within_uncertainty
    stated = [log["uncertainty"] for log in logs if "means_of_100_s" in log["uncertainty"]]
    if least is None or not stated:
        return ()
    counts = [entry["means_of_100_s"] for entry in stated]
    share = float(
        np.average([entry["share_within_expanded_uncertainty"] for entry in stated], weights=counts)
    )
    return (at_least("share of 100 s means within their uncertainty", share, least, "1"),)


def _validation_criteria(
    spec: FogThermalRecipe, figures: Sequence[compensate.LogFigures]
) -> tuple[Criterion, ...]:
    """No log may come out worse than raw, and the reduction limit holds for the logs together."""
    criteria = [_worst_share(figures)]
    least = spec.acceptance.min_reduction
    if least is not None:
        before = rms([log.before for log in figures])
        after = rms([log.after for log in figures])
        reduction = float(before / after)
        criteria.append(at_least("drift reduction", reduction, least, "1"))
    return tuple(criteria)


def draw(title: str, fitted: Fitted[pages.DriftReport]) -> Drawn:
    """Figures and summary of a fit."""
    return Drawn(tuple(pages.pages(replace(fitted.drawing, title=title))), fitted.summary)


def _certificate(stated: Stated) -> tuple[Block, ...]:
    """Blocks of results on a certificate."""
    from calibkit.instruments.fog_thermal.certificate import blocks

    return blocks(stated)


def _firmware() -> Firmware[FogThermalRecipe]:
    """How a run becomes firmware."""
    from calibkit.instruments.fog_thermal.firmware import FIRMWARE

    return FIRMWARE


def _simulate(seed: int) -> Campaign:
    """Simulated campaign."""
    from calibkit.instruments.fog_thermal.simulate import campaign

    return campaign(seed)


def _propose(evidence: Evidence) -> Choice | None:
    """Recipe for logs of this kind."""
    from calibkit.instruments.fog_thermal.propose import propose

    return propose(evidence)


INSTRUMENT = Instrument(
    recipe=FogThermalRecipe,
    read=read,
    examine=examine,
    fit=fit,
    draw=draw,
    validate=validate,
    apply=apply,
    certificate=_certificate,
    firmware=_firmware,
    key_figures=(
        r"drift\..+\.(a\d|residual_rms)",
        r"drift_rate\..+\.([bcs]\w+|tau_\w+|residual_rms)",
        r"drift_rate\.(raw_drift_rms|drift_rms_before|drift_rms_after|rate_gain_recursive)\..+",
    ),
    campaigns={"fog_thermal": _simulate},
    propose=_propose,
)

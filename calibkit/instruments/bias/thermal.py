"""Bias of the channels of a static instrument against one thermometer: logs → thermal.json.

    y = b_0 + b_1 T + b_2 T² + b_3 T³ + s_r dT/dt + s_G G + s_Tr T dT/dt + turn-on bias

T is the thermometer's temperature or one that lags behind it, G its excess over a second lag. Logs
become `power_ons`, these a model of each `channels`, whose terms `choice` takes.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from calibkit import check as checks, units
from calibkit.check import copies
from calibkit.coefficients import Input, Record
from calibkit.frame import Examined, Finding, Log, refuse
from calibkit.ingest import logs as ingest, write_back
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.bias import (
    channels,
    compensate,
    forms,
    power_ons,
    sensitivities,
    tables,
)
from calibkit.instruments.bias.figures import Course, ThermalReport
from calibkit.instruments.bias.recipe import EFFECT, GROUP, ThermalRecipe

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.ingest.evidence import Evidence
    from calibkit.ingest.logs import LogReader
    from calibkit.ingest.recipe_text import RecipeChoice
    from calibkit.ingest.write_back import Applied
    from calibkit.report.summary import Summary

Recipe = ThermalRecipe
KEY_FIGURES = (r"thermal\..+\.([bs]\w*|tau_\w+|residual_rms)",)
FORMS = (forms.BIAS_LEVEL, forms.BIAS_LAGGED)
prepare_plan = simulate_plan = None
"""The campaigns that a plan of this package chooses are of `bias_temperature`."""
SHIPPED = [f"gyro_{axis}_dph" for axis in "xyz"] + [f"accel_{axis}_g" for axis in "xyz"]
"""Channels of the shipped recipe."""


def read(spec: ThermalRecipe, data: Path, file: str, reader: LogReader = ingest.read_log) -> Log:
    """One log in the recipe's columns."""
    return reader(spec, data / file, file, (*power_ons.COLUMNS, *spec.thermal.channels))


def _find_unusable(spec: ThermalRecipe, log: Log, min_rows: int) -> list[Finding]:
    """What is wrong with a log whose clock was mended, for compensation."""
    findings = [
        *checks.find_too_few_rows(log, min_rows),
        *checks.find_missing_values(log, list(log.frame.columns)),
    ]
    if any(finding.refused for finding in findings):
        return findings
    findings += checks.find_unordered_times(log)
    findings += checks.find_implausible_temperatures(log, [power_ons.CASE])
    for name in spec.thermal.channels:
        if name.endswith("_dph"):
            findings += checks.find_implausible_rates(log, name)
    return findings


def _find_faults(spec: ThermalRecipe, log: Log) -> list[Finding]:
    """What is wrong with a log whose clock was mended, for a fit."""
    findings = _find_unusable(spec, log, spec.thermal.min_rows)
    if any(finding.refused for finding in findings):
        return findings
    findings += checks.find_constant_columns(log, [power_ons.CASE, *spec.thermal.channels])
    if any(finding.refused for finding in findings):
        return findings
    findings += checks.series.check_temperature(log, power_ons.CASE)
    findings += checks.thermometers.find_lost_sign(log, power_ons.CASE)
    for column in spec.still_columns():
        findings += checks.series.check_indication(log, column, units.column_unit(column))
    # an instrument that is left alone may warm as slowly as it likes
    findings += checks.magnitude.check_time_unit(log, power_ons.CASE, "the case", slowest=0.0)
    findings += checks.magnitude.find_compensated_names(log, spec, spec.still_columns())
    return findings


def faults(spec: ThermalRecipe, log: Log) -> Examined:
    """Find what is wrong with one log."""
    return Examined(tuple(_find_faults(spec, power_ons.mend_clock(log, spec.thermal))))


def fit(
    spec: ThermalRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[ThermalReport]:
    """Fit every channel over the power-ons of all logs: bias + powers of T + terms of its rate, by
    a level or a lagged model, as many terms as left-out stretches ask for (`channels`).
    """
    raw, logs, flags = [], [], []
    for log in copies.refuse_copies(
        ingest.read_ahead(progress(files, "reading"), lambda file: read(spec, data, file))
    ):
        mended = power_ons.mend_clock(log, spec.thermal)
        findings = _find_faults(spec, mended)
        refuse(findings)
        raw.append(log)
        logs.append(mended)
        flags += [f"{log.file}: {note}" for note in mended.notes]
        flags += [str(finding) for finding in findings if finding.flagged]
    power_ons.refuse_little_change(logs, spec.thermal)
    interval_s = power_ons.choose_interval(logs, spec.thermal)
    found_power_ons = power_ons.find_power_ons(logs, raw, spec.thermal, interval_s)
    found_power_ons, notes = power_ons.cut_stretches(found_power_ons, interval_s)
    flags += [*notes, *(note for power_on in found_power_ons for note in power_on.notes)]
    fitted = [
        channels.fit_channel(name, found_power_ons, spec, interval_s)
        for name in progress(spec.thermal.channels, "fitting")
    ]
    flags += [flag for channel in fitted for flag in channel.flags]
    if len(found_power_ons) == 1 and not spec.errors.component:
        flags.append(
            f"{EFFECT} of the {GROUP}: one {GROUP} cannot show how another differs, so it is in no"
            " uncertainty; log more of them, or state the size in [[errors.component]]"
        )
    flags = list(dict.fromkeys(flags))
    result = channels.result(fitted, interval_s, flags)
    courses = tuple(
        Course(
            (power_on.blocks.time - power_on.blocks.time[0]) / 60.0,
            power_on.blocks.case,
            ~power_on.fitted,
        )
        for power_on in found_power_ons
    )
    return Fitted(
        (result,),
        tuple(Input.of(log) for log in raw),
        tables.fit_summary(spec, fitted, flags),
        ThermalReport(courses, tuple(channel.curves for channel in fitted)),
        exports=any(channel.varies for channel in fitted),
        sensitivities=sensitivities.find(result),
    )


def correct(spec: ThermalRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Take the bias of each channel, zero at the reference, out of every row."""
    models = compensate.read_models(records, spec)
    log = read(spec, data.parent, data.name)
    mended = power_ons.mend_clock(log, spec.thermal)
    refuse(_find_unusable(spec, mended, 1))
    columns, added, flags = compensate.compensate_channels(mended, log, models, spec)
    return write_back.rewrite_log(spec, data, log, columns, added), flags


def validate(
    spec: ThermalRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Rms of every channel before and after, and coverage of the uncertainty, on logs that were
    not fitted.
    """
    models, entries = compensate.read_models(records, spec), []
    for log in logs:
        mended = power_ons.mend_clock(log, spec.thermal)
        refuse(_find_unusable(spec, mended, 3))
        entries.append(compensate.channel_entry(mended, log, models, spec))
    title = "Rms about the turn-on biases, and 100 s means within U and noise (95 % expected)"
    return {"logs": entries}, tables.validation_summary(
        entries, title, "rms error", min_reduction=spec.acceptance.min_reduction
    )


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Choice of the recipe for channels at rest beside one temperature that goes up and down; a
    single warm-up determines no more than a polynomial.
    """
    if not (evidence.cycles("temp_case_degc") or evidence.cycles("temp_env_degc")):
        return None

    def keys_of(channel_names: Sequence[str]) -> dict[str, str]:
        as_shipped = sorted(channel_names) == sorted(SHIPPED)
        return {} if as_shipped else {"channels": json.dumps(list(channel_names))}

    return evidence.choose_at_rest("thermal", keys_of)

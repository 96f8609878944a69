"""Bias of the channels of a static instrument against one thermometer: logs → thermal.json.

    y = b_j + b_1 T + b_2 T² + b_3 T³ + s_r dT/dt + s_G G + s_Tr T dT/dt

T is the thermometer's temperature or one that lags behind it, G its excess over a second lag, b_j
the level of power-on j with its turn-on bias. Logs become `power_ons`; of each channel the terms
are chosen that leave the smallest errors on stretches that were left out of the fit
(`numeric.choice`). What lasts in these errors, beyond the noise and the uncertainty of the
coefficients, is the model error. Where a temperature leaves the fitted range, the terms go on for a
third of it (`evaluate_wide`).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import check as checks, units
from calibkit.check import copies
from calibkit.errors import FitError
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.bias import compensate, forms, power_ons, sensitivities, tables
from calibkit.instruments.bias.figures import ChannelCurves, ThermalReport
from calibkit.instruments.bias.numeric import choice
from calibkit.instruments.bias.recipe import EFFECT, GROUP, ThermalRecipe
from calibkit.logs import log_files, write_back
from calibkit.numeric import chunks, dispersion
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares.fit import linear
from calibkit.numeric.thermal.evaluate import evaluate_wide
from calibkit.numeric.thermal.left_out import (
    blocks_per_figure,
)
from calibkit.numeric.thermal.pooled_fit import Stack
from calibkit.records.coefficients import (
    Component,
    Criterion,
    Figure,
    Input,
    Parameter,
    Record,
    StageResult,
    at_least,
    at_most,
)
from calibkit.records.frame import Examined, Finding, Log, Remark, refuse
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.summary import Summary, number
from calibkit.report.table import Table
from calibkit.units import unit_mark

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from calibkit.instruments.bias.power_ons import PowerOn
    from calibkit.logs.evidence import Evidence
    from calibkit.logs.recipe_text import RecipeChoice
    from calibkit.logs.write_back import Applied
    from calibkit.numeric.arrays import Array
    from calibkit.numeric.thermal.terms import ThermalModel


Recipe = ThermalRecipe
KEY_FIGURES = (r"thermal\..+\.([bs]\w*|tau_\w+|residual_rms)",)
FORMS = (forms.BIAS_LEVEL, forms.BIAS_LAGGED)
prepare_plan = simulate_plan = None
"""The campaigns that a plan of this package chooses are of `bias_temperature`."""
SHIPPED = [f"gyro_{axis}_dph" for axis in "xyz"] + [f"accel_{axis}_g" for axis in "xyz"]
"""Channels of the shipped recipe."""


def read(spec: ThermalRecipe, data: Path, file: str) -> Log:
    """One log in the recipe's columns."""
    return log_files.read_log(spec, data / file, file, (*power_ons.COLUMNS, *spec.thermal.channels))


@checks.in_stages
def _find_faults(spec: ThermalRecipe, log: Log) -> Iterator[list[Finding]]:
    """Yield what is wrong with a log whose clock was mended, for a fit."""
    case, channels = power_ons.CASE, spec.thermal.channels
    yield checks.find_unusable(log, spec.thermal.min_rows)
    yield checks.find_constant_columns(log, [case, *channels])
    findings = [
        *checks.series.check_temperature(log, case),
        *checks.thermometers.find_lost_sign(log, case),
    ]
    for channel in channels:
        findings += checks.series.check_indication(log, channel, units.column_unit(channel))
    # an instrument that is left alone may warm as slowly as it likes
    findings += checks.magnitude.check_time_unit(log, case, "the case", slowest=0.0)
    yield [*findings, *checks.magnitude.find_compensated_names(log, spec, channels)]


def faults(spec: ThermalRecipe, log: Log) -> Examined:
    """Find what is wrong with one log."""
    return Examined(tuple(_find_faults(spec, power_ons.mend_clock(log, spec.thermal))))


def fit(
    spec: ThermalRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[ThermalReport]:
    """Fit every channel over the power-ons of all logs: bias + powers of T + terms of its rate, by
    a level or a lagged model, as many terms as left-out stretches ask for.
    """
    raw, logs, flags = [], [], []
    for log in copies.refuse_copies(
        log_files.read_ahead(progress(files, "reading"), lambda file: read(spec, data, file))
    ):
        mended = power_ons.mend_clock(log, spec.thermal)
        findings = _find_faults(spec, mended)
        refuse(findings)
        raw.append(log)
        logs.append(mended)
        flags += [f"{log.file}: {note}" for note in mended.notes]
        flags += [str(finding) for finding in findings if finding.flagged]
    ends = [log.extremes(power_ons.CASE) for log in logs]
    low, high = min(low for low, _ in ends), max(high for _, high in ends)
    # a slope over a span of the thermometer's noise is noise
    if high - low < spec.thermal.min_span_degc:
        raise FitError(
            f"{', '.join(log.file for log in logs)}: the temperature goes from {low:g} to"
            f" {high:g} °C, expected a change of at least {spec.thermal.min_span_degc:g} °C",
            hint="log the instrument while its temperature changes, or lower [thermal]"
            " min_span_degc",
        )
    # the model interval: stated, or the usual one, or that of the slowest log
    slowest = max(float(np.ceil(log.steps.usual - 1e-6)) for log in logs)
    interval_s = max(power_ons.USUAL_INTERVAL_S, slowest)
    if spec.thermal.interval_s != "auto":
        interval_s = float(spec.thermal.interval_s)
    found_power_ons = power_ons.find_power_ons(logs, raw, spec.thermal, interval_s)
    found_power_ons = power_ons.leave_out_settling(found_power_ons, spec.thermal.channels)
    found_power_ons, notes = power_ons.cut_stretches(found_power_ons, interval_s)
    flags += [*notes, *(note for power_on in found_power_ons for note in power_on.notes)]
    fitted = [
        fit_channel(name, found_power_ons, spec, interval_s)
        for name in progress(spec.thermal.channels, "fitting")
    ]
    flags += [flag for channel in fitted for flag in channel.flags]
    if len(found_power_ons) == 1 and not spec.errors.component:
        flags.append(
            f"only one {GROUP} is logged: how the {EFFECT} repeats is unknown and not in U; log"
            " more of them, or state the size in [[errors.component]]"
        )
    flags = list(dict.fromkeys(flags))
    stage = _write(fitted, interval_s, flags)
    return Fitted(
        (stage,),
        tuple(Input.of(log) for log in raw),
        _summarize(spec, fitted, flags),
        ThermalReport(tuple(found_power_ons), tuple(channel.curves for channel in fitted)),
        exports=any(channel.choice.varies for channel in fitted),
        sensitivities=sensitivities.find(stage),
    )


def correct(spec: ThermalRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Take the bias of each channel, zero at the reference, out of every row."""
    models = compensate.read_models(records, spec)
    log = read(spec, data.parent, data.name)
    mended = power_ons.mend_clock(log, spec.thermal)
    refuse(checks.find_unusable(mended, 1))
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
        refuse(checks.find_unusable(mended, 3))
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


BY_CHANCE = 0.005
"""Chance at which turn-on biases of faultless power-ons are said to follow the temperature."""
NO_TERM = "no drift term needed: no model is clearly better than a constant on left-out stretches"


@dataclass(frozen=True, slots=True)
class FittedChannel:
    """Chosen model of one channel and what it leaves, in the channel's unit."""

    choice: choice.TermChoice
    curves: ChannelCurves
    before: float
    """Rms of the fitted blocks about the turn-on biases, without the model."""
    after: float
    """The same with the model."""
    over_noise: float
    """`after` over the noise within parts of the power-ons."""
    withheld: tuple[float, float] | None
    """Rms of the withheld blocks without and with the model; None where nothing is withheld."""
    case: tuple[float, float]
    """Range of the thermometer in the fitted blocks [°C]."""
    components: tuple[Component, ...]
    flags: tuple[str, ...]
    settles_s: float
    """Longest time since power-on of a warm-up that is left out of the fit."""


def fit_channel(
    name: str, power_ons: Sequence[PowerOn], spec: ThermalRecipe, interval_s: float
) -> FittedChannel:
    """Choose and fit the terms of one channel; raises FitError that names it."""
    stacked = Stack.of_logs([power_on.of_channel(name) for power_on in power_ons])
    family = spec.thermal.model
    candidates = [entry for entry in choice.TERM_CANDIDATES if family in ("auto", entry.form)]
    try:
        channel_choice = choice.choose_terms(
            stacked, candidates, figure_blocks=blocks_per_figure(interval_s)
        )
    except FitError as error:
        raise FitError(f"{name}: {error.message}", hint=error.hint) from None
    # the standard deviation of turn-on biases: as the recipe states it, which replaces what the few
    # power-ons show and is not added to it, else that of the power-ons; none of one power-on
    unit, model, count = units.column_unit(name), channel_choice.model, len(power_ons)
    components: tuple[Component, ...] = ()
    stated = next((entry for entry in spec.errors.component if entry.effect == EFFECT), None)
    if stated is not None:
        value = stated.value_in(unit)
        covariance = model.covariance.copy()
        # the mean of n turn-on biases varies by σ²/n
        covariance[0, 0] += value**2 / count - model.turn_on_variance
        dof = min(stated.dof, float(model.dof))
        model = replace(model, covariance=covariance, constant_dof=dof)
        channel_choice = replace(channel_choice, model=model)
        components = (Component(GROUP, EFFECT, value, unit, 0.0, count),)
    elif count > 1:
        value = float(np.std(model.turn_on, ddof=1))
        # standard deviation of a standard deviation of n normal values
        u = float(value / np.sqrt(2.0 * (count - 1)))
        components = (Component(GROUP, EFFECT, value, unit, u, count),)
    # what a turn-on changes is the level of a power-on: all is shown about that of its fitted rows
    raw: list[Array] = []
    left: list[Array] = []
    variances = []
    for power_on, log in zip(power_ons, stacked.logs, strict=True):
        drift = evaluate_wide(model, log, spec.reference_temp_degc).drift
        for curve, indication in ((raw, log.indication), (left, log.indication - drift)):
            curve.append(np.asarray(indication - indication[power_on.fitted].mean()))
        corrected = (log.indication - drift)[power_on.fitted]
        # noise within parts of a power-on, in which drift hardly moves
        variances.append(dispersion.variances_within(corrected, corrected))
    fitted = np.concatenate([power_on.fitted for power_on in power_ons])
    before_and_after = np.concatenate(raw), np.concatenate(left)
    before, after = (rms(indication[fitted]) for indication in before_and_after)
    withheld, kept = None, np.concatenate([power_on.withheld for power_on in power_ons])
    if kept.any():
        withheld = rms(before_and_after[0][kept]), rms(before_and_after[1][kept])
    no_term = () if channel_choice.varies else (NO_TERM,)
    flags = (
        *model.flags,
        *map(Remark, model.remarks),
        *no_term,
        *_flag_turn_on_drift(name, model, power_ons),
    )
    return FittedChannel(
        channel_choice,
        ChannelCurves(name, unit, tuple(raw), tuple(left)),
        before,
        after,
        dispersion.over_noise(after, variances),
        withheld,
        chunks.extremes(
            np.concatenate([power_on.blocks.case[power_on.fitted] for power_on in power_ons])
        ),
        components,
        tuple(type(flag)(f"{name}: {flag}") for flag in flags),
        max(power_on.settles_s for power_on in power_ons),
    )


def _flag_turn_on_drift(
    name: str, model: ThermalModel, power_ons: Sequence[PowerOn]
) -> tuple[str, ...]:
    """Flag that turn-on biases follow the temperatures of the power-ons."""
    from scipy.special import stdtrit

    case = np.array([power_on.blocks.case[power_on.fitted].mean() for power_on in power_ons])
    # two power-ons always lie on a line
    if case.size < 3 or not np.ptp(case):
        return ()
    line = linear(np.column_stack([case - case.mean(), np.ones_like(case)]), model.turn_on)
    slope, u = float(line.coefficients[0]), float(line.standard_uncertainty[0])
    # Student's t: with three power-ons four standard uncertainties are no proof
    if abs(slope) <= stdtrit(line.dof, 1.0 - BY_CHANCE / 2.0) * u:
        return ()
    return (
        (
            f"turn-on biases of {len(power_ons)} power-ons follow their temperatures"
            f" ({slope:+.3g} {units.column_unit(name)}/°C): drift that no power-on shows is not"
            " taken off; where the instrument stayed on, name these logs in [thermal] sessions,"
            " else log ramps"
        ),
    )


def _summarize(
    spec: ThermalRecipe, channels: Sequence[FittedChannel], flags: Sequence[str]
) -> Summary:
    """Summary of a fit: the chosen terms of each channel, the errors of all candidates on left-out
    stretches, and what is left of withheld ones.
    """
    models, withheld, drifts, values = [], [], [], []
    criteria: list[Criterion] = []
    errors: dict[str, list[str]] = {}
    limits = spec.acceptance
    for k, channel in enumerate(channels):
        channel_name, of_channel = channel.curves.name, channel.curves.unit
        factor, unit = (1e6, "µg") if of_channel == "g" else (1.0, unit_mark(of_channel))
        before, after = factor * channel.before, factor * channel.after
        chosen_errors, model = channel.choice.chosen_errors, channel.choice.model
        models.append(
            (
                channel_name,
                chosen_errors.name,
                ", ".join(f"{lag:.0f}" for lag in model.lags),
                number(before),
                number(after),
                number(factor * model.model_error, 2),
                unit,
            )
        )
        for tested in channel.choice.tested:
            row = errors.setdefault(tested.name, [""] * len(channels))
            row[k] = f"{number(tested.pooled, 3)}{' *' if tested is chosen_errors else ''}"
        terms = chosen_errors.name if channel.choice.varies else "no drift term needed"
        drifts.append(
            f"{channel_name}: drift in a power-on (rms) {before:.3g} {unit} before,"
            f" {after:.3g} {unit} after ({terms})."
        )
        values.append(KeyValue(f"drift of {channel_name}, after", after, unit))
        if channel.withheld is not None:
            cells = (number(rms) for rms in channel.withheld)
            withheld.append((channel_name, *cells, of_channel))
        if limits.min_reduction is not None and channel.choice.varies:
            name = f"{channel_name}: reduction on left-out stretches"
            # the first candidate is the constant, that is no compensation
            reduction = channel.choice.tested[0].pooled / chosen_errors.pooled
            criteria.append(at_least(name, reduction, limits.min_reduction, "1"))
        if limits.max_residual_over_noise is not None:
            name, limit = f"{channel_name}: residual over noise", limits.max_residual_over_noise
            criteria.append(at_most(name, channel.over_noise, limit, "1"))
    chosen_terms = Table(
        "Bias of each channel: chosen terms, rms of the intervals about the turn-on biases",
        ("channel", "terms", "lags [s]", "before", "after", "model error", "unit"),
        tuple(models),
    )
    left_out = Table(
        "Errors on stretches left out in turn (100 s means, rms); * chosen: the simplest model"
        " that is as good as the best",
        ("terms", *(f"{entry.curves.name} [{entry.curves.unit}]" for entry in channels)),
        tuple((name, *cells) for name, cells in errors.items()),
    )
    summary_tables = [chosen_terms, left_out]
    if withheld:
        title = "Withheld stretches: rms about the turn-on biases of the fitted ones"
        summary_tables.append(Table(title, ("channel", "before", "after", "unit"), tuple(withheld)))
    first_screen = Overview(drifts[0], tuple(drifts[1:]), tuple(values[:4]), chosen_terms)
    return Summary(
        spec.title, tuple(summary_tables), tuple(flags), tuple(criteria), overview=first_screen
    )


def _write(
    channels: Sequence[FittedChannel], interval_s: float, flags: Sequence[str]
) -> StageResult:
    """thermal.json: one model of each channel, named by it, with its rms before and after, on
    stretches left out by each candidate, and on withheld ones.
    """
    models, figures = [], []
    for channel in channels:
        name, unit = channel.curves.name, channel.curves.unit
        parameters = [
            Parameter(end, value, "degC")
            for end, value in zip(forms.CASE_RANGE, channel.case, strict=True)
        ]
        if channel.settles_s:
            parameters.append(Parameter(forms.SETTLES, channel.settles_s, "s"))
        models.append(
            forms.write_thermal(
                channel.choice.model,
                interval_s,
                name,
                unit,
                components=channel.components,
                extra_parameters=tuple(parameters),
            )
        )
        rms_of = {f"rms_before.{name}": channel.before}
        rms_of[f"rms_after.{name}"] = channel.after
        for tested in channel.choice.tested:
            rms_of[f"left_out_rms.{name}.{tested.name}"] = tested.pooled
        if channel.withheld is not None:
            for stage, value in zip(("before", "after"), channel.withheld, strict=True):
                rms_of[f"withheld_rms_{stage}.{name}"] = value
        figures += [Figure(figure, value, unit, 0.0) for figure, value in rms_of.items()]
    return StageResult("thermal", tuple(models), tuple(figures), flags=tuple(flags))

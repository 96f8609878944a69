"""thermal.json and a log → compensated channels, and what is left of unseen logs.

The bias is evaluated on block means at the model interval, as in the fit, and interpolated to the
rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibkit import thermal_forms, units
from calibkit.arrays import Array
from calibkit.coefficients import Model, Record
from calibkit.errors import CoefficientError
from calibkit.frame import Log, values
from calibkit.instruments.bias import channels, forms, power_ons
from calibkit.instruments.bias.power_ons import PowerOn
from calibkit.instruments.bias.recipe import ThermalRecipe
from calibkit.numeric.dispersion import rms
from calibkit.numeric.thermal import uncertainty
from calibkit.numeric.thermal.evaluate import Evaluation
from calibkit.numeric.thermal.left_out import blocks_per_figure
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.recipe import type_b

FLAGGED_SHARE = 0.005
"""Largest share of a log that may be outside the fitted ranges without a flag."""


def read_models(records: Mapping[str, Record], spec: ThermalRecipe) -> dict[str, Model]:
    """Models of the recipe's channels; CoefficientError for a run without them."""
    if forms.THERMAL not in records:
        raise CoefficientError(
            f"the run holds no {forms.THERMAL}", hint="it is not a run of thermal"
        )
    record = records[forms.THERMAL]
    return {name: record.model(name) for name in spec.thermal.channels}


@dataclass(frozen=True, slots=True)
class ChannelBias:
    """Bias of one channel along the blocks of a power-on, zero at the reference temperature, and
    its uncertainty: of the coefficients, the model error, the ranges and the type B terms of the
    thermometer and the channel.
    """

    power_on: PowerOn
    evaluation: Evaluation
    bias_uncertainty: uncertainty.Along


def follow_bias(log: Log, raw: Log, model: Model, spec: ThermalRecipe) -> list[ChannelBias]:
    """Bias of one channel along each power-on of a log, of which `raw` is as it was read, at the
    model interval, or at the log's own where that is longer.
    """
    fitted, name = thermal_forms.read_terms(model), model.name
    interval_s = max(model.value("interval"), float(np.ceil(log.steps.usual - 1e-6)))
    drifts = []
    for power_on in power_ons.find_power_ons([log], [raw], spec.thermal, interval_s):
        blocks = power_on.of_channel(name)

        def warmer_by(step: float, blocks: ThermalLog = blocks) -> Evaluation:
            warmer_blocks = replace(blocks, case=blocks.case + step, env=blocks.env + step)
            return channels.evaluate_wide(fitted, warmer_blocks, spec.reference_temp_degc)

        case = {power_ons.CASE: lambda step: warmer_by(step).drift}
        effects = type_b.effects_along(spec.type_b, name, blocks.time.size, case)
        evaluation = warmer_by(0.0)
        bias_uncertainty = uncertainty.combine_along(fitted, evaluation, effects)
        drifts.append(ChannelBias(power_on, evaluation, bias_uncertainty))
    return drifts


def compensate_log(
    log: Log, raw: Log, models: Mapping[str, Model], spec: ThermalRecipe
) -> tuple[dict[str, Array], dict[str, Array], tuple[str, ...]]:
    """Compensated channels [rows] of a log, columns that the recipe adds, and flags."""
    columns, added = {}, {}
    flags: list[str] = []
    for name, model in models.items():
        drifts = follow_bias(log, raw, model, spec)
        bias = _to_rows(log, drifts, [drift.evaluation.drift for drift in drifts])
        columns[name] = values(log.frame, name) - bias
        stem, _, unit = name.rpartition("_")
        if spec.output.drift:
            added[f"{stem}_drift_{unit}"] = bias
        if spec.output.rate_uncertainty:
            standard = [drift.bias_uncertainty.standard for drift in drifts]
            added[f"{stem}_standard_uncertainty_{unit}"] = _to_rows(log, drifts, standard)
        flags += _flag_ranges(log.file, model, drifts)
    return columns, added, tuple(dict.fromkeys(flags))


def _to_rows(log: Log, drifts: Sequence[ChannelBias], block_values: Sequence[Array]) -> Array:
    """Values of blocks interpolated to the rows [n] of one log."""
    time = values(log.frame, "time_s")
    rows = np.empty(time.size)
    for drift, of_blocks in zip(drifts, block_values, strict=True):
        for _, first, stop, begins in drift.power_on.spans:
            passed = time[first:stop] - time[first]
            rows[first:stop] = np.interp(begins + passed, drift.power_on.blocks.time, of_blocks)
    return rows


def _flag_ranges(file: str, model: Model, drifts: Sequence[ChannelBias]) -> list[str]:
    """Flags of temperatures and rates outside the fitted ranges, with the share of the log, where
    the model has a term beside the constant; then the notes on the power-ons.
    """
    evaluations = [drift.evaluation for drift in drifts]
    outside = {
        "temperature outside the fitted range": [
            evaluation.temperature_clamped for evaluation in evaluations
        ],
        "temperature rate outside the fitted range": [
            evaluation.rate_clamped | evaluation.gradient_clamped for evaluation in evaluations
        ],
        "temperature changes in a direction that was not fitted": [
            evaluation.unmeasured for evaluation in evaluations
        ],
    }
    flags = []
    if any(thermal_forms.read_terms(model).coefficients[1:]):
        for excess, masks in outside.items():
            share = float(np.mean(np.concatenate(masks)))
            if share > FLAGGED_SHARE:
                flags.append(f"{file}: {model.name}: {excess} over {100.0 * share:.0f} %")
    return [*flags, *(note for drift in drifts for note in drift.power_on.notes)]


def validation_entry(
    log: Log, raw: Log, models: Mapping[str, Model], spec: ThermalRecipe
) -> dict[str, Any]:
    """JSON object of one validated log: rms of every channel about its power-ons before and after,
    and how the errors of 100 s means compare with their uncertainty.
    """
    entries = []
    flags: list[str] = []
    for name, model in models.items():
        drifts = follow_bias(log, raw, model, spec)
        logged = [drift.power_on.indications[name] for drift in drifts]
        left = [y - drift.evaluation.drift for y, drift in zip(logged, drifts, strict=True)]
        before, after = (
            rms(np.concatenate([y - y.mean() for y in parts])) for parts in (logged, left)
        )
        longest = int(np.argmax([y.size for y in left]))
        compared, _, _ = thermal_forms.compare_means(
            left[longest],
            drifts[longest].bias_uncertainty,
            thermal_forms.read_terms(model).noise,
            blocks_per_figure(model.value("interval")),
        )
        entry = {
            "name": name,
            "unit": units.column_unit(name),
            "before": before,
            "after": after,
            "reduction": before / after if after else None,
        }
        entries.append(entry | compared)
        flags += _flag_ranges(log.file, model, drifts)
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "channels": entries,
        "flags": list(dict.fromkeys(flags)),
    }

"""thermal.json and a log → compensated channels, and what is left of unseen logs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibkit import thermal_forms, units
from calibkit.arrays import Array
from calibkit.coefficients import Model, Record
from calibkit.errors import CoefficientError
from calibkit.frame import Log, values
from calibkit.instruments.thermal import channels, forms, power_ons
from calibkit.instruments.thermal.power_ons import PowerOn
from calibkit.instruments.thermal.recipe import ThermalRecipe
from calibkit.numeric import chunks
from calibkit.numeric.dispersion import rms
from calibkit.numeric.thermal import uncertainty
from calibkit.numeric.thermal.evaluate import Evaluation
from calibkit.numeric.thermal.left_out import blocks_per_figure
from calibkit.numeric.thermal.terms import ThermalModel
from calibkit.recipe.type_b import RELATIVE

CASE_STEP_DEGC = 0.05
"""Change of the temperature for the numerical derivative of the bias."""
FLAGGED_SHARE = 0.005
"""Largest share of a log that may be outside the fitted ranges without a flag."""


def read_models(records: Mapping[str, Record], spec: ThermalRecipe) -> dict[str, Model]:
    """Models of the recipe's channels; CoefficientError for a run without them."""
    if forms.FILE not in records:
        raise CoefficientError(f"the run holds no {forms.FILE}", hint="it is not a run of thermal")
    record = records[forms.FILE]
    return {name: record.model(name) for name in spec.thermal.channels}


def average_log(log: Log, raw: Log, interval_s: float, spec: ThermalRecipe) -> list[PowerOn]:
    """Power-ons of one log at a model interval, or at the log's own where that is longer."""
    own = max(interval_s, float(np.ceil(log.steps.usual - 1e-6)))
    return power_ons.find_power_ons([log], [raw], spec.thermal, own)


@dataclass(frozen=True, slots=True)
class Drift:
    """Bias of one channel along the blocks of a power-on, zero at the reference temperature, and
    the uncertainties of the bias and of the bias less its mean.
    """

    evaluation: Evaluation
    along: uncertainty.Along
    about_mean: uncertainty.Along


def follow_bias(model: ThermalModel, one: PowerOn, name: str, spec: ThermalRecipe) -> Drift:
    """Bias of one channel along a power-on with its uncertainty: coefficients, model error, ranges
    and the type B terms of the thermometer and the channel.
    """
    log = one.of_channel(name)

    def shifted(step: float) -> Evaluation:
        moved = replace(log, case=log.case + step, env=log.env + step)
        return channels.evaluate_wide(model, moved, spec.reference_temp_degc)

    effects = []
    for term in spec.type_b:
        u, dof = term.u_of(0.0), np.inf if term.dof is None else term.dof
        if term.quantity == power_ons.CASE and term.unit not in RELATIVE:
            change = shifted(CASE_STEP_DEGC).drift - shifted(-CASE_STEP_DEGC).drift
            effects.append((term.name, change / (2.0 * CASE_STEP_DEGC) * u, dof))
        elif term.quantity == name and term.unit not in RELATIVE:
            effects.append((term.name, np.full(log.time.size, u), dof))
    evaluation = shifted(0.0)
    return Drift(
        evaluation,
        uncertainty.combine_along(model, evaluation, effects),
        uncertainty.combine_along(model, evaluation, effects, about_mean=True),
    )


def compensate_log(
    log: Log, raw: Log, models: Mapping[str, Model], spec: ThermalRecipe
) -> tuple[dict[str, Array], dict[str, Array], tuple[str, ...]]:
    """Compensated channels [rows] of a log, columns that the recipe adds, and flags.

    The bias is evaluated on block means at the model interval, as in the fit, and interpolated to
    the rows.
    """
    columns, added = {}, {}
    flags: list[str] = []
    for name, model in models.items():
        fitted = thermal_forms.read_terms(model)
        found = average_log(log, raw, model.value("interval"), spec)
        drifts = [follow_bias(fitted, one, name, spec) for one in found]
        bias = _to_rows(log, found, [drift.evaluation.drift for drift in drifts])
        logged, columns[name] = values(log.frame, name), log.allocate(bias.size)
        for a, b in chunks.ranges_along(logged, bias, columns[name]):
            np.subtract(logged[a:b], bias[a:b], out=columns[name][a:b])
        stem, _, unit = name.rpartition("_")
        if spec.output.drift:
            added[f"{stem}_drift_{unit}"] = bias
        if spec.output.rate_uncertainty:
            standard = [drift.along.standard for drift in drifts]
            added[f"{stem}_standard_uncertainty_{unit}"] = _to_rows(log, found, standard)
        if any(fitted.coefficients[1:]):
            flags += _flag_ranges(log.file, name, [drift.evaluation for drift in drifts])
        flags += [note for one in found for note in one.notes]
    return columns, added, tuple(dict.fromkeys(flags))


def _to_rows(log: Log, found: Sequence[PowerOn], along: Sequence[Array]) -> Array:
    """Values of blocks interpolated to the rows [n] of one log."""
    time = values(log.frame, "time_s")
    rows = log.allocate(time.size)
    for one, blocks in zip(found, along, strict=True):
        for _, first, stop, begins in one.spans:
            own, made, origin = time[first:stop], rows[first:stop], float(time[first])
            for a, b in chunks.ranges_along(own, made):
                made[a:b] = np.interp(begins + own[a:b] - origin, one.blocks.time, blocks)
    return rows


def _flag_ranges(file: str, name: str, found: Sequence[Evaluation]) -> list[str]:
    """Flags of temperatures and rates outside the fitted ranges, with the share of the log."""
    outside = {
        "temperature outside the fitted range": [one.temperature_clamped for one in found],
        "temperature rate outside the fitted range": [
            one.rate_clamped | one.gradient_clamped for one in found
        ],
        "temperature changes in a direction that was not fitted": [one.unmeasured for one in found],
    }
    shares = {what: float(np.mean(np.concatenate(mask))) for what, mask in outside.items()}
    return [
        f"{file}: {name}: {what} over {100.0 * share:.0f} %"
        for what, share in shares.items()
        if share > FLAGGED_SHARE
    ]


def validation_entry(
    log: Log, raw: Log, models: Mapping[str, Model], spec: ThermalRecipe
) -> dict[str, Any]:
    """JSON object of one validated log: rms of every channel about its power-ons before and after,
    and how the errors of 100 s means compare with their uncertainty.
    """
    entries, flags = [], []
    for name, model in models.items():
        fitted, interval_s = thermal_forms.read_terms(model), model.value("interval")
        found = average_log(log, raw, interval_s, spec)
        drifts = [follow_bias(fitted, one, name, spec) for one in found]
        raws = [one.indications[name] for one in found]
        left = [own - drift.evaluation.drift for own, drift in zip(raws, drifts, strict=True)]
        longest = int(np.argmax([own.size for own in left]))
        before, after = (
            rms(np.concatenate([own - own.mean() for own in parts])) for parts in (raws, left)
        )
        entries.append(
            {
                "name": name,
                "unit": units.column_unit(name),
                "before": before,
                "after": after,
                "reduction": before / after if after else None,
            }
            | thermal_forms.compare_means(
                left[longest],
                drifts[longest].along,
                drifts[longest].about_mean,
                fitted.noise,
                blocks_per_figure(interval_s),
            )[0]
        )
        if any(fitted.coefficients[1:]):
            flags += _flag_ranges(log.file, name, [drift.evaluation for drift in drifts])
        flags += [note for one in found for note in one.notes]
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "channels": entries,
        "flags": list(dict.fromkeys(flags)),
    }

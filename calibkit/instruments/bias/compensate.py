"""Coefficients of a run and a log → what is taken off, its uncertainty, and what is left.

    model on levels              ω − D,  D(t) by the temperatures at t and before (`evaluate`)
    published, recursive         ω_k − D_k,  D_k = D_(k−1) + Δ_k (`published.increments`)
    published, one_step          ω_k − (ω_(k−1) + Δ_k), which removes the true rate too

    u² = xᵀ C x + e² + Δ²/3 + h²/3 + Σ type B           (`numeric.thermal.evaluate`)
    |mean of 100 s| ≤ √(U² + (2 u_noise)²) for 95 % of the means

D is evaluated on block means at the model interval, as in the fit, and interpolated to the rows of
the log. Absolutely, the rate at rest of the fit and the turn-on bias of one more log enter too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, cast

import numpy as np

from calibkit import units
from calibkit.errors import CoefficientError, FitError, UsageError
from calibkit.fit.unseen import unseen
from calibkit.instruments.bias import forms, power_ons, ramps
from calibkit.instruments.bias.forms import FILE
from calibkit.instruments.bias.numeric import bank, published
from calibkit.instruments.bias.numeric.bank import OnLevels
from calibkit.instruments.bias.numeric.published import DriftBlocks, RatePolynomial
from calibkit.instruments.bias.power_ons import PowerOn
from calibkit.instruments.bias.ramps import PreparedLog
from calibkit.instruments.bias.recipe import FogThermalRecipe, ThermalRecipe
from calibkit.numeric import chunks, gum
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.numeric.dispersion import rms
from calibkit.numeric.flicker import Flicker
from calibkit.numeric.thermal import evaluate, left_out
from calibkit.numeric.thermal.evaluate import Evaluation, evaluate_wide
from calibkit.numeric.thermal.left_out import blocks_per_figure
from calibkit.numeric.thermal.pooled_fit import BlockNoise, ThermalLog
from calibkit.numeric.thermal.terms import ThermalModel
from calibkit.recipe import TypeB, type_b
from calibkit.records.coefficients import Figure, Model, Record
from calibkit.records.frame import Log, values
from calibkit.report import budget

FLAGGED_SHARE = 0.005
"""Largest share of a log that may be outside the fitted ranges without a flag."""


def compare_means(
    residual: Array, bias_uncertainty: evaluate.Along, noise: BlockNoise, group: int
) -> tuple[dict[str, float], Array, Array]:
    """Errors [n] of a log as means over a group of blocks about the log's mean, against the
    uncertainty of the bias and of the bias less its mean: number of means, the share within U and
    noise, and the size over the standard uncertainty with its limit, as a JSON object; the means
    [m] and the absolute limits [m] of U and noise. Empty for less than two means.
    """
    count = residual.size // group
    if count < 2:
        return {}, np.zeros(0), np.zeros(0)
    (flicker,) = Flicker(count, [0]).about_level(0, count)
    # white noise averages out over the group; flicker noise about the mean of the log does not
    of_noise = noise.white_variance / group + noise.flicker**2 * flicker
    limit, limit_about_mean = (
        # U of the drift beside twice the noise of the mean
        np.sqrt(chunks.block_means(expanded, group) ** 2 + 4.0 * of_noise)
        for expanded in (bias_uncertainty.expanded, bias_uncertainty.expanded_about_mean)
    )
    means = chunks.block_means(residual, group)
    error = means - means.mean()
    # the error of the drift is taken as one pattern along the log
    comparison = unseen(
        error, chunks.block_means(bias_uncertainty.standard, group)[:, None], of_noise
    )
    compared = {
        "means_of_100_s": count,
        "share_within_expanded_uncertainty": float(np.mean(np.abs(error) <= limit_about_mean)),
        **comparison.to_object(),
    }
    return compared, means, limit


def flag_outside(name: str, outside: Mapping[str, Mask]) -> list[str]:
    """Flags of what is outside the fitted ranges along a log, with the share of its blocks."""
    shares = {bound: float(np.mean(mask)) for bound, mask in outside.items()}
    return [
        f"{name}: {bound} over {100.0 * share:.0f} %"
        for bound, share in shares.items()
        if share > FLAGGED_SHARE
    ]


def read_models(records: Mapping[str, Record], spec: ThermalRecipe) -> dict[str, Model]:
    """Models of the recipe's channels; CoefficientError for a run without them."""
    if forms.THERMAL not in records:
        raise CoefficientError(
            f"the run holds no {forms.THERMAL}", hint="it is not a run of thermal"
        )
    record = records[forms.THERMAL]
    return {name: record.model(name) for name in spec.thermal.channels}


def follow_biases(
    log: Log, raw: Log, models: Mapping[str, Model], spec: ThermalRecipe
) -> tuple[list[PowerOn], dict[str, list[evaluate.Along]], tuple[str, ...]]:
    """Power-ons of a log, of which `raw` is as it was read, at the model interval, or at the log's
    own where that is longer; the bias of each channel along each of them, zero at the reference
    temperature, with its uncertainty by coefficients, model error, ranges and the type B terms of
    thermometer and channel; flags of temperatures and rates outside the fitted ranges, with the
    share of the log, and notes on the power-ons.
    """
    intervals_s = [model.value("interval") for model in models.values()]
    # a log that is slower than the fit has no more means than rows
    interval_s = max(*intervals_s, float(np.ceil(log.steps.usual - 1e-6)))
    of_log = power_ons.find_power_ons([log], [raw], spec.thermal, interval_s)
    biases: dict[str, list[evaluate.Along]] = {name: [] for name in models}
    flags: list[str] = []
    for name, model in models.items():
        fitted, evaluations = cast("ThermalModel", forms.read_thermal(model)), []
        for power_on in of_log:
            blocks = power_on.of_channel(name)

            def warmer_by(
                step: float, fitted: ThermalModel = fitted, blocks: ThermalLog = blocks
            ) -> Evaluation:
                # the one thermometer stands for both temperatures
                warmer_blocks = replace(blocks, case=blocks.case + step, env=blocks.env + step)
                return evaluate_wide(fitted, warmer_blocks, spec.reference_temp_degc)

            case = {power_ons.CASE: lambda step, bias=warmer_by: bias(step).drift}
            effects = type_b.effects_along(spec.type_b, name, blocks.time.size, case)
            evaluations.append(warmer_by(0.0))
            biases[name].append(evaluate.combine_along(fitted, evaluations[-1], effects))
        if any(fitted.coefficients[1:]):  # a constant holds everywhere
            outside = {
                "temperature outside the fitted range": np.concatenate(
                    [e.temperature_clamped for e in evaluations]
                ),
                "temperature rate outside the fitted range": np.concatenate(
                    [e.rate_clamped | e.gradient_clamped for e in evaluations]
                ),
                "temperature changes in a direction that was not fitted": np.concatenate(
                    [e.unmeasured for e in evaluations]
                ),
            }
            flags += flag_outside(f"{log.file}: {name}", outside)
        flags += [
            f"{log.file}: {name}: the model does not hold the warm-up in the first"
            f" {parameter.value / SECONDS_PER_MINUTE:.0f} min after power-on"
            for parameter in model.parameters
            if parameter.name == forms.SETTLES
        ]
        flags += [note for power_on in of_log for note in power_on.notes]
    return of_log, biases, tuple(dict.fromkeys(flags))


def compensate_channels(
    log: Log, raw: Log, models: Mapping[str, Model], spec: ThermalRecipe
) -> tuple[dict[str, Array], dict[str, Array], tuple[str, ...]]:
    """Compensated channels [rows] of a log, columns that the recipe adds, and flags."""
    columns, added, time = {}, {}, values(log.frame, "time_s")
    of_log, biases, flags = follow_biases(log, raw, models, spec)
    for name, of_channel in biases.items():
        bias, standard = np.empty((2, time.size))
        for power_on, along in zip(of_log, of_channel, strict=True):
            for first, stop, begins in power_on.spans:
                instants = begins + (time[first:stop] - time[first])
                bias[first:stop] = np.interp(instants, power_on.blocks.time, along.drift)
                standard[first:stop] = np.interp(instants, power_on.blocks.time, along.standard)
        columns[name] = values(log.frame, name) - bias
        stem, _, unit = name.rpartition("_")
        if spec.output.drift:
            added[f"{stem}_drift_{unit}"] = bias
        if spec.output.rate_uncertainty:
            added[f"{stem}_standard_uncertainty_{unit}"] = standard
    return columns, added, flags


def channel_entry(
    log: Log, raw: Log, models: Mapping[str, Model], spec: ThermalRecipe
) -> dict[str, Any]:
    """JSON object of one validated log: rms of every channel about its power-ons before and after,
    and how the errors of 100 s means compare with their uncertainty.
    """
    entries = []
    of_log, biases, flags = follow_biases(log, raw, models, spec)
    for name, model in models.items():
        logged = [power_on.indications[name] for power_on in of_log]
        left = [y - along.drift for y, along in zip(logged, biases[name], strict=True)]
        before, after = (
            rms(np.concatenate([y - y.mean() for y in parts])) for parts in (logged, left)
        )
        longest = int(np.argmax([y.size for y in left]))
        compared, _, _ = compare_means(
            left[longest],
            biases[name][longest],
            forms.read_thermal(model).noise,
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
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "channels": entries,
        "flags": list(flags),
    }


GRADIENT_TERMS = {"s_grad", "s_grad2", "s_grad_rate"}
"""Terms of the gradient between case and chamber air."""
Mode = Literal["recursive", "one_step"]


@dataclass(frozen=True, slots=True)
class DriftAlong:
    """Drift [n, °/h] along block means, its increments [n, °/h] between blocks, and which blocks
    are held or clamped, by what.
    """

    level: Array
    delta: Array
    outside: Mapping[str, Mask]


@dataclass(frozen=True, slots=True)
class DriftModel:
    """Exported drift term: rate polynomials, a level or lagged model, or neither; interval, mode
    and reference temperature.
    """

    polynomials: tuple[RatePolynomial, ...]
    thermal: OnLevels | None
    interval_s: float
    mode: Mode
    reference_temp_degc: float

    @property
    def exported(self) -> bool:
        """Whether there is a drift term at all."""
        return bool(self.polynomials) or self.thermal is not None

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of a log that the model needs: the chamber air where a gradient to it enters."""
        # lagged models and banks take the gradient inside the gyro, from the case alone
        # the published scheme takes the rate and the gradient from the chamber air
        needs_air = bool(self.polynomials)
        if isinstance(self.thermal, ThermalModel) and self.thermal.form == "level":
            needs_air |= not GRADIENT_TERMS.isdisjoint(self.thermal.terms)
        return tuple(name for name in ramps.COLUMNS if needs_air or name != "temp_env_degc")

    @classmethod
    def read(cls, records: Mapping[str, Record], recipe: FogThermalRecipe) -> "DriftModel":
        """Drift model from the coefficient files of a run.

        Raises CoefficientError for a run of another procedure, FitError if the recipe has another
        interval.
        """
        if FILE not in records:
            raise CoefficientError(
                f"the run holds no {FILE}", hint="it is not a run of fog_thermal"
            )
        models, interval_s = records[FILE].models, recipe.drift.interval_s
        for model in models:
            if model.value("interval") != interval_s:
                raise FitError(
                    f"drift.interval_s = {interval_s:g}, the coefficients are per"
                    f" {model.value('interval'):g} s",
                    hint="fit again with that interval",
                )
        return cls(
            tuple(
                forms.read_rates(model) for model in models if model.form == forms.OVER_RATES.name
            ),
            next(
                (forms.read_thermal(model) for model in models if model.form in forms.ON_LEVELS),
                None,
            ),
            interval_s,
            recipe.drift.compensation,
            recipe.reference_temp_degc,
        )

    def drift_along(self, blocks: DriftBlocks) -> DriftAlong:
        """Drift along block means, zero at the reference temperature, which is clamped to the
        fitted range.

        A level or lagged model needs no integration, so that no error accumulates in soaks.
        """
        if self.thermal is not None:
            env = blocks.case - blocks.gradient
            evaluation = bank.evaluate(
                self.thermal, blocks.time, blocks.case, env, self.reference_temp_degc
            )
            drift = evaluation.drift
            outside = {
                "temperature clamped to the fitted range": evaluation.temperature_clamped,
                "temperature rate clamped to the fitted range": evaluation.rate_clamped,
                "gradient clamped to the fitted range": evaluation.gradient_clamped,
                "temperature changes in a direction in which no ramp was fitted": (
                    evaluation.unmeasured
                ),
            }
            return DriftAlong(drift, np.diff(drift, prepend=drift[:1]), outside)
        steps = published.increments(self.polynomials, blocks.gradient, blocks.rate)
        if not self.polynomials:
            return DriftAlong(np.zeros_like(steps.delta), steps.delta, {})
        coldest, hottest = zip(*(polynomial.case for polynomial in self.polynomials), strict=True)
        level = published.referenced(
            published.recursive(steps.delta),
            blocks.case,
            self.reference_temp_degc,
            (min(coldest), max(hottest)),
        )
        outside = {
            "drift held in soaks or on a side that was not fitted": steps.drift_held[1:],
            "temperature rate clamped to the fitted range": steps.rate_clamped[1:],
            "gradient clamped to the fitted range": steps.gradient_clamped[1:],
        }
        return DriftAlong(level, steps.delta, outside)


@dataclass(frozen=True, slots=True)
class LogFigures:
    """Drift rms [°/h] of a log before and after compensation, the rate gain [1] of both modes, and
    flags.
    """

    name: str
    before: float
    after: float
    split: left_out.NoiseSplit
    """Noise and drift in the figure after compensation."""
    gain_recursive: float
    gain_one_step: float
    after_one_step: float
    flags: tuple[str, ...]
    output: Array
    """Compensated block means [n, °/h], recursive."""

    @classmethod
    def summarize(cls, name: str, blocks: DriftBlocks, model: DriftModel) -> Self:
        """Figures of one log from its block means."""
        group = blocks_per_figure(model.interval_s)
        drift, indication = model.drift_along(blocks), blocks.indication
        # ω − D, and ω_k − (ω_(k−1) + Δ_k)
        output = indication - drift.level
        one_step = published.one_step(indication, drift.delta)
        return cls(
            name,
            left_out.drift_rms(indication, group),
            left_out.drift_rms(output, group),
            left_out.split_noise([left_out.means_of_groups(output, group)]),
            left_out.rate_gain(lambda w: w - drift.level, indication),
            left_out.rate_gain(lambda w: published.one_step(w, drift.delta), indication),
            left_out.drift_rms(one_step[1:], group),
            tuple(flag_outside(name, drift.outside)),
            output,
        )


def compensate_log(
    log: Log, model: DriftModel, recipe: FogThermalRecipe
) -> tuple[Array, tuple[str, ...]]:
    """Compensated indication [rows, °/h] of a log, without denoising or resampling, and flags.

    The drift is evaluated on block means at the model interval, as in the fit, and interpolated to
    the rows.
    """
    time, gyro = (values(log.frame, column) for column in ("time_s", "gyro_dph"))
    if not model.exported:
        return gyro, ("no drift term: the indication is returned as it is",)
    model_intervals, blocks = ramps.block_means(log, recipe, rated=bool(model.polynomials))
    drift = model.drift_along(blocks)
    flags = tuple(flag_outside(log.file, drift.outside))
    if model.mode == "recursive":
        return gyro - np.interp(time, blocks.time, drift.level), flags
    index = np.repeat(model_intervals.number, model_intervals.count)
    # ω_{k-1} + Δ̂_k of the interval that a row lies in, as published
    predicted = blocks.indication[np.maximum(index - 1, 0)] + drift.delta[index]
    return gyro - predicted, (*flags, "one_step: the true rate is removed (rate gain 0)")


TURN_ON = "turn_on_bias."
"""Figures of the turn-on biases begin with this, and a log's name follows."""
RESULT = "gyro_dph"
"""Name of the compensated rate in type B terms."""
THERMOMETERS = ("temp_case_degc", "temp_env_degc")
POINTS = 5
"""Number of temperatures at which the uncertainty at rest is stated."""
AT_REST = "at rest"


def along_blocks(
    model: DriftModel,
    blocks: DriftBlocks,
    terms: Sequence[TypeB],
    *,
    long_at_rest: bool = False,
) -> evaluate.Along:
    """Uncertainty of the drift along block means: type A, model error, clamping, hysteresis, and
    type B terms; raises UsageError without a model on levels.

    A type B term of temp_case_degc or temp_env_degc is propagated by the derivative of the drift
    for a constant error of that thermometer. A term of the compensated rate (gyro_dph) enters
    directly, one with a sensitivity multiplied by it.
    """
    thermal, reference = model.thermal, model.reference_temp_degc
    if thermal is None:
        exported = (
            "gradient_rate, whose error on other rates is not known"
            if model.polynomials
            else "no drift term"
        )
        raise UsageError(
            f"output.rate_uncertainty: the run exports {exported}: no uncertainty of the"
            " compensated rate can be stated",
            hint="set it to false, or fit with drift.model = 'auto'",
        )
    time, case, env = blocks.time, blocks.case, blocks.case - blocks.gradient

    def warmer_by(of_case: float, of_env: float) -> Evaluation:
        temperatures = case + of_case, env + of_env
        return bank.evaluate(thermal, time, *temperatures, reference, long_at_rest=long_at_rest)

    thermometers = {
        "temp_case_degc": lambda step: warmer_by(step, 0.0).drift,
        "temp_env_degc": lambda step: warmer_by(0.0, step).drift,
    }
    effects = type_b.effects_along(terms, RESULT, time.size, thermometers)
    return evaluate.combine_along(thermal, warmer_by(0.0, 0.0), effects)


def state_along_logs(
    model: DriftModel, logs: Sequence[PreparedLog], terms: Sequence[TypeB]
) -> list[dict[str, Any]]:
    """Uncertainty of the drift as JSON objects: at rest over the fitted temperatures, and where it
    is largest in each log; empty without a model on levels.
    """
    if model.thermal is None:
        return []
    temperatures = np.linspace(*model.thermal.valid.temperature, POINTS).tolist()
    places: list[tuple[str, DriftBlocks]] = []
    for degc in sorted({*temperatures, model.thermal.nearest_fitted(model.reference_temp_degc)}):
        # two instants at rest: what a drift is at one temperature
        still = np.zeros(2)
        resting = DriftBlocks(np.array([0.0, 1.0]), np.full(2, degc), still, still, still)
        places.append((AT_REST, resting))
    entries = []
    for place, blocks in [*places, *((log.name, log.raw) for log in logs)]:
        along = along_blocks(model, blocks, terms, long_at_rest=place == AT_REST)
        row = int(np.argmax(along.standard))
        parts = [
            gum.UncertaintyComponent(
                name, float(along.drift[row]), float(values[row]), kind, dof=dof
            )
            for name, kind, values, dof in along.contributions
        ]
        entry = budget.combine("drift taken off the indication", "deg/h", parts)
        entries.append(entry | {"where": place, "temp_case_degc": float(blocks.case[row])})
    return entries


def check_coverage(
    model: DriftModel, blocks: DriftBlocks, terms: Sequence[TypeB], figures: Sequence[Figure]
) -> dict[str, Any]:
    """JSON object: uncertainties along a log, and the share of its 100 s means within U, about the
    log's mean and absolutely.

    The limit for a mean combines the expanded uncertainty of the drift, about the log's mean that
    of the drift less its mean, with noise: white noise of the blocks and flicker noise, at the
    levels of the fit. Absolutely, a log is compared with the rate at rest that the `figures` of
    drift_rate.json state, and the turn-on bias of one more log is in the limit.
    """
    if model.thermal is None:
        return {"not_available": "the run exports no model on levels"}
    drift_uncertainty = along_blocks(model, blocks, terms)
    entry: dict[str, Any] = {
        "unit": "deg/h",
        "standard_uncertainty_mean": float(drift_uncertainty.standard.mean()),
        "standard_uncertainty_largest": float(drift_uncertainty.standard.max()),
        "expanded_uncertainty_largest": float(drift_uncertainty.expanded.max()),
        "probability": gum.TWO_SIGMA,
    }
    left, noise = blocks.indication - drift_uncertainty.drift, model.thermal.noise
    group = blocks_per_figure(model.interval_s)
    compared, means, limit = compare_means(left, drift_uncertainty, noise, group)
    rest = next((figure for figure in figures if figure.name == "mean_rate_at_reference"), None)
    turn_on = [figure.value for figure in figures if figure.name.startswith(TURN_ON)]
    if compared and rest is not None and len(turn_on) > 1:
        # whether means are as near to the rate at rest as their limits and its own say
        # this log was switched on once more, and its bias is another one
        one_more = gum.coverage_factor(float(len(turn_on) - 1)) * float(np.std(turn_on, ddof=1))
        absolute = np.hypot(limit, np.hypot(one_more, 2.0 * rest.standard_uncertainty))
        entry |= {
            "share_within_absolutely": float(np.mean(np.abs(means - rest.value) <= absolute)),
            "offset": float(means.mean()) - rest.value,
            "offset_expanded_uncertainty": float(absolute.mean()),
        }
    return entry | compared

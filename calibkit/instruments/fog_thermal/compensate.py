"""Drift model of a run and a log → compensated indication, and drift figures before and after.

    model on levels              ω − D,  D(t) by the temperatures at t and before (`evaluate`)
    published, recursive         ω_k − D_k,  D_k = D_(k−1) + Δ_k (`published.increments`)
    published, one_step          ω_k − (ω_(k−1) + Δ_k), which removes the true rate too

D is evaluated on block means at the model interval and interpolated to the rows of the log.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Figure, Record
from calibkit.errors import CoefficientError, FitError
from calibkit.frame import Log, values
from calibkit.instruments.fog_thermal import forms, ramps
from calibkit.instruments.fog_thermal.forms import FILE
from calibkit.instruments.fog_thermal.numeric import bank, drift_figures, published
from calibkit.instruments.fog_thermal.numeric.bank import OnLevels
from calibkit.instruments.fog_thermal.numeric.published import DriftBlocks, RatePolynomial
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.numeric.thermal.left_out import blocks_per_figure
from calibkit.numeric.thermal.terms import ThermalModel

FLAGGED_SHARE = 0.005
"""Largest share of a log that may be held or clamped without a flag."""
GRADIENT_TERMS = {"s_grad", "s_grad2", "s_grad_rate"}
"""Terms of the gradient between case and chamber air."""
Mode = Literal["recursive", "one_step"]


@dataclass(frozen=True, slots=True)
class _Drift:
    """Drift [n, °/h] along block means, its increments [n, °/h] between blocks, and the share of
    blocks at each bound.
    """

    level: Array
    delta: Array
    bounds: Mapping[str, float]

    def flags(self, name: str) -> tuple[str, ...]:
        """Flags of held or clamped quantities along the log `name`, with the share of blocks."""
        return tuple(
            f"{name}: {bound} over {100.0 * share:.0f} %"
            for bound, share in self.bounds.items()
            if share > FLAGGED_SHARE
        )

    def subtract(self, indication: Array, mode: Mode) -> Array:
        """Compensated block means [n, °/h] of an indication [n, °/h]."""
        return (
            published.one_step(indication, self.delta)
            if mode == "one_step"
            else indication - self.level
        )


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

    def drift_along(self, blocks: DriftBlocks) -> _Drift:
        """Drift along block means, zero at the reference temperature, which is clamped to the
        fitted range.

        A level or lagged model needs no integration, so that no error accumulates in soaks.
        """
        if self.thermal is not None:
            evaluation = bank.evaluate(
                self.thermal,
                blocks.time,
                blocks.case,
                blocks.case - blocks.gradient,
                self.reference_temp_degc,
            )
            clamped = {
                "temperature": evaluation.temperature_clamped,
                "temperature rate": evaluation.rate_clamped,
                "gradient": evaluation.gradient_clamped,
            }
            bounds = {
                f"{name} clamped to the fitted range": float(mask.mean())
                for name, mask in clamped.items()
            } | {
                "temperature changes in a direction in which no ramp was fitted": float(
                    evaluation.unmeasured.mean()
                )
            }
            return _Drift(
                evaluation.drift, np.diff(evaluation.drift, prepend=evaluation.drift[:1]), bounds
            )
        steps = published.increments(self.polynomials, blocks.gradient, blocks.rate)
        if not self.polynomials:
            return _Drift(np.zeros_like(steps.delta), steps.delta, {})
        cases = np.array([polynomial.case for polynomial in self.polynomials])
        level = published.referenced(
            published.recursive(steps.delta),
            blocks.case,
            self.reference_temp_degc,
            (float(cases[:, 0].min()), float(cases[:, 1].max())),
        )
        bounds = {
            "drift held in soaks or on a side that was not fitted": float(
                steps.drift_held[1:].mean()
            ),
            "temperature rate clamped to the fitted range": float(steps.rate_clamped[1:].mean()),
            "gradient clamped to the fitted range": float(steps.gradient_clamped[1:].mean()),
        }
        return _Drift(level, steps.delta, bounds)


@dataclass(frozen=True, slots=True)
class LogFigures:
    """Drift rms [°/h] of a log before and after compensation, the rate gain [1] of both modes, and
    flags.
    """

    name: str
    before: float
    after: float
    split: drift_figures.NoiseSplit
    """Noise and drift in the figure after compensation."""
    gain_recursive: float
    gain_one_step: float
    after_one_step: float
    flags: tuple[str, ...]
    output: Array
    """Compensated block means [n, °/h], recursive."""

    @property
    def reduction(self) -> float:
        """Ratio of the drift rms before to that after."""
        return self.before / self.after if self.after > 0.0 else float("inf")

    def figures(self) -> list[Figure]:
        """Figures of drift_rate.json."""
        left, u = self.split.left, self.split.left_uncertainty
        return [
            Figure(f"drift_rms_before.{self.name}", self.before, "deg/h", 0.0),
            Figure(f"drift_rms_after.{self.name}", self.after, "deg/h", 0.0),
            Figure(f"noise_rms.{self.name}", self.split.noise, "deg/h", 0.0),
            Figure(f"drift_left_rms.{self.name}", left, "deg/h", u),
            Figure(f"rate_gain_recursive.{self.name}", self.gain_recursive, "1", 0.0),
            Figure(f"one_step_rms_after.{self.name}", self.after_one_step, "deg/h", 0.0),
            Figure(f"rate_gain_one_step.{self.name}", self.gain_one_step, "1", 0.0),
        ]

    @classmethod
    def summarize(cls, name: str, blocks: DriftBlocks, model: DriftModel) -> Self:
        """Figures of one log from its block means."""
        group = blocks_per_figure(model.interval_s)
        drift, indication = model.drift_along(blocks), blocks.indication
        output = drift.subtract(indication, "recursive")

        def gain(mode: Mode) -> float:
            return drift_figures.rate_gain(lambda w: drift.subtract(w, mode), indication)

        return cls(
            name,
            drift_figures.drift_rms(indication, group),
            drift_figures.drift_rms(output, group),
            drift_figures.split_noise([drift_figures.figure_means(output, group)]),
            gain("recursive"),
            gain("one_step"),
            drift_figures.drift_rms(drift.subtract(indication, "one_step")[1:], group),
            drift.flags(name),
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
    flags = drift.flags(log.file)
    if model.mode == "recursive":
        return gyro - np.interp(time, blocks.time, drift.level), flags
    index = np.repeat(model_intervals.number, model_intervals.count)
    predicted = blocks.indication[np.maximum(index - 1, 0)] + drift.delta[index]
    return gyro - predicted, (*flags, "one_step: the true rate is removed (rate gain 0)")

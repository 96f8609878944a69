"""Drift coefficients and a log → compensated indication, with the figures that say what it is worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from calibkit.coefficients import Figure, StageResult
from calibkit.errors import FitError
from calibkit.frame import values
from calibkit.numeric import compensation, drift
from calibkit.stages import fog_drift, fog_ramps

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from calibkit.coefficients import Record
    from calibkit.frame import Log
    from calibkit.recipe import FogThermalRecipe

    Array = NDArray[np.float64]

Mode = Literal["recursive", "one_step"]


@dataclass(frozen=True, slots=True)
class DriftModel:
    """The exported drift term: its polynomials (none: no drift term), its interval, its mode, its reference."""

    polynomials: tuple[drift.RatePolynomial, ...]
    interval_s: float
    mode: Mode
    reference_temp_degc: float

    def increments(self, blocks: drift.Blocks) -> compensation.Increments:
        """Drift increments along block means, with where the model was held or clamped."""
        return compensation.increments(self.polynomials, blocks.gradient, blocks.rate)

    def level(self, blocks: drift.Blocks, delta: Array) -> Array:
        """Drift [n, °/h], zero at the reference temperature (clamped to the fitted range)."""
        if not self.polynomials:
            return np.zeros_like(delta)
        valid = (min(p.case[0] for p in self.polynomials), max(p.case[1] for p in self.polynomials))
        return compensation.referenced(compensation.recursive(delta), blocks.case, self.reference_temp_degc, valid)

    def output(self, blocks: drift.Blocks, indication: Array, mode: Mode) -> Array:
        """Compensated block means [n, °/h] in the given mode."""
        delta = self.increments(blocks).delta
        if mode == "one_step":
            return compensation.one_step(indication, delta)
        return indication - self.level(blocks, delta)


@dataclass(frozen=True, slots=True)
class LogFigures:
    """Drift rms [°/h] of a log before and after, the gain of both modes for a constant rate, and the flags."""

    name: str
    before: float
    after: float
    gain_recursive: float
    gain_one_step: float
    after_one_step: float
    flags: tuple[str, ...]

    @property
    def reduction(self) -> float:
        """Before divided by after."""
        return self.before / self.after if self.after > 0.0 else float("inf")


def model_of(choices: Sequence[fog_drift.SideChoice], recipe: FogThermalRecipe) -> DriftModel:
    """Drift model of a fit's choices."""
    polynomials = tuple(choice.chosen for choice in choices if choice.chosen is not None)
    return DriftModel(polynomials, recipe.drift.interval_s, recipe.drift.compensation, recipe.reference_temp_degc)


def model_from(record: Record, recipe: FogThermalRecipe) -> DriftModel:
    """Drift model of a drift_rate.json; refuses another interval than the recipe now asks for."""
    polynomials = tuple(fog_drift.rate_polynomial(model) for model in record.models)
    for model in record.models:
        if model.value("interval") != recipe.drift.interval_s:
            raise FitError(
                f"drift.interval_s = {recipe.drift.interval_s:g}, the coefficients are per {model.value('interval'):g} s",
                hint="fit again with that interval",
            )
    return DriftModel(polynomials, recipe.drift.interval_s, recipe.drift.compensation, recipe.reference_temp_degc)


def figures_of(name: str, blocks: drift.Blocks, model: DriftModel) -> LogFigures:
    """Figures of one log from its block means."""
    group = fog_drift.group(model.interval_s)
    steps = model.increments(blocks)
    indication = blocks.indication

    def output(mode: Mode, shifted: Array) -> Array:
        return model.output(blocks, shifted, mode)

    return LogFigures(
        name,
        compensation.drift_rms(indication, group),
        compensation.drift_rms(output("recursive", indication), group),
        compensation.rate_gain(lambda shifted: output("recursive", shifted), indication),
        compensation.rate_gain(lambda shifted: output("one_step", shifted), indication),
        compensation.drift_rms(output("one_step", indication)[1:], group),
        _bounds_flags(name, steps, model),
    )


def _bounds_flags(name: str, steps: compensation.Increments, model: DriftModel) -> tuple[str, ...]:
    """What was held or clamped along a log, in shares of its length."""
    if not model.polynomials:
        return ()
    shares = {
        "drift held in soaks or on a side that was not fitted": steps.held[1:],
        "temperature rate clamped to the fitted range": steps.rate_clamped[1:],
        "gradient clamped to the fitted range": steps.gradient_clamped[1:],
    }
    return tuple(
        f"{name}: {what} over {100.0 * mask.mean():.0f} %" for what, mask in shares.items() if mask.mean() > 0.005
    )


def rate_result(
    choices: Sequence[fog_drift.SideChoice], logs: Sequence[LogFigures], recipe: FogThermalRecipe
) -> StageResult:
    """drift_rate.json: the exported polynomials and every drift figure with its rate gain beside it."""
    figures = list(fog_drift.left_out_figures(choices))
    for log in logs:
        figures += [
            Figure(f"drift_rms_before.{log.name}", log.before, "deg/h", 0.0),
            Figure(f"drift_rms_after.{log.name}", log.after, "deg/h", 0.0),
            Figure(f"rate_gain_recursive.{log.name}", log.gain_recursive, "1", 0.0),
            Figure(f"one_step_rms_after.{log.name}", log.after_one_step, "deg/h", 0.0),
            Figure(f"rate_gain_one_step.{log.name}", log.gain_one_step, "1", 0.0),
        ]
    flags = [flag for choice in choices for flag in choice.flags]
    if recipe.drift.compensation == "one_step":
        flags.append("one_step compensation is a first difference: it removes the true rate (rate gain 0)")
    models = tuple(
        fog_drift.rate_model(choice.chosen, recipe.drift.interval_s) for choice in choices if choice.chosen is not None
    )
    return StageResult("drift_rate", models=models, figures=tuple(figures), flags=tuple(flags))


def compensated(log: Log, model: DriftModel, recipe: FogThermalRecipe) -> tuple[Array, tuple[str, ...]]:
    """Compensated indication [rows, °/h] of a whole log, no row denoised or resampled, and the flags.

    The drift is evaluated on block means at the model interval and interpolated to the rows.
    """
    time, case, env, gyro = (values(log.frame, column) for column in fog_ramps.COLUMNS)
    if not model.polynomials:
        return gyro, ("no drift term: the indication is returned as it is",)
    _, slope = fog_ramps.cut(log.name, time, env, recipe)
    blocks = drift.blocks(time, case, env, gyro, slope, model.interval_s)
    steps = model.increments(blocks)
    flags = _bounds_flags(log.file, steps, model)
    if model.mode == "recursive":
        return gyro - np.interp(time, blocks.time, model.level(blocks, steps.delta)), flags
    index = drift.block_index(time, model.interval_s)
    before = blocks.indication[np.maximum(index - 1, 0)] + steps.delta[index]
    return gyro - before, (*flags, "one_step: the true rate is removed (rate gain 0)")

"""Drift coefficients and a log → compensated indication, with the figures that say what it is
worth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from calibkit.errors import FitError
from calibkit.frame import values
from calibkit.instruments.fog_thermal import gradient_file, level_file, ramps
from calibkit.instruments.fog_thermal import uncertainty as fog_uncertainty
from calibkit.instruments.fog_thermal.numeric import compensation, evaluate, gradient
from calibkit.numeric import chunks, intervals

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.arrays import Array
    from calibkit.coefficients import Record
    from calibkit.frame import Log
    from calibkit.instruments.fog_thermal.numeric.terms import ThermalModel
    from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe


Mode = Literal["recursive", "one_step"]


@dataclass(frozen=True, slots=True)
class Along:
    """Drift [n, °/h] along block means, its increments from block to block, and the share of the
    log of each bound met.
    """

    level: Array
    delta: Array
    bounds: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class DriftModel:
    """The exported drift term: rate polynomials, or a thermal model on levels, or neither;
    interval, mode, reference.
    """

    polynomials: tuple[gradient.RatePolynomial, ...]
    thermal: ThermalModel | None
    interval_s: float
    mode: Mode
    reference_temp_degc: float

    @property
    def exported(self) -> bool:
        """Whether there is a drift term at all."""
        return bool(self.polynomials) or self.thermal is not None

    def along(self, blocks: gradient.Blocks) -> Along:
        """Drift along block means, zero at the reference temperature (clamped to the fitted
        range).
        """
        if self.thermal is not None:
            return self._thermal_along(self.thermal, blocks)
        steps = compensation.increments(self.polynomials, blocks.gradient, blocks.rate)
        if not self.polynomials:
            return Along(np.zeros_like(steps.delta), steps.delta, {})
        valid = (min(p.case[0] for p in self.polynomials), max(p.case[1] for p in self.polynomials))
        total = compensation.recursive(steps.delta)
        level = compensation.referenced(total, blocks.case, self.reference_temp_degc, valid)
        bounds = {
            "drift held in soaks or on a side that was not fitted": float(steps.held[1:].mean()),
            "temperature rate clamped to the fitted range": float(steps.rate_clamped[1:].mean()),
            "gradient clamped to the fitted range": float(steps.gradient_clamped[1:].mean()),
        }
        return Along(level, steps.delta, bounds)

    def _thermal_along(self, thermal: ThermalModel, blocks: gradient.Blocks) -> Along:
        """Drift by a model on levels, which needs no bias reference and forgets nothing in
        soaks.
        """
        env = blocks.case - blocks.gradient
        found = evaluate.evaluate(thermal, blocks.time, blocks.case, env, self.reference_temp_degc)
        bounds = {
            "temperature clamped to the fitted range": float(found.temperature_clamped.mean()),
            "temperature rate clamped to the fitted range": float(found.rate_clamped.mean()),
            "gradient clamped to the fitted range": float(found.gradient_clamped.mean()),
        }
        return Along(found.drift, np.diff(found.drift, prepend=found.drift[:1]), bounds)

    def output(self, along: Along, indication: Array, mode: Mode) -> Array:
        """Compensated block means [n, °/h] in the given mode."""
        return (
            compensation.one_step(indication, along.delta)
            if mode == "one_step"
            else indication - along.level
        )


@dataclass(frozen=True, slots=True)
class LogFigures:
    """Drift rms [°/h] of a log before and after, the gain of both modes for a constant rate, and
    the flags.
    """

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


def model_from(record: Record, recipe: FogThermalRecipe) -> DriftModel:
    """Drift model of a drift_rate.json; refuses another interval than the recipe now asks for."""
    for model in record.models:
        if model.value("interval") != recipe.drift.interval_s:
            raise FitError(
                f"drift.interval_s = {recipe.drift.interval_s:g}, the coefficients are per"
                f" {model.value('interval'):g} s",
                hint="fit again with that interval",
            )
    rates = tuple(
        gradient_file.rate_polynomial(model)
        for model in record.models
        if model.form == "fog-drift-rate/1"
    )
    levels = [
        level_file.thermal_model(model)
        for model in record.models
        if model.form in level_file.FORMS.values()
    ]
    return DriftModel(
        rates,
        levels[0] if levels else None,
        recipe.drift.interval_s,
        recipe.drift.compensation,
        recipe.reference_temp_degc,
    )


def figures_of(name: str, blocks: gradient.Blocks, model: DriftModel) -> LogFigures:
    """Figures of one log from its block means."""
    group = gradient_file.group(model.interval_s)
    along = model.along(blocks)
    indication = blocks.indication

    def output(mode: Mode, shifted: Array) -> Array:
        return model.output(along, shifted, mode)

    return LogFigures(
        name,
        compensation.drift_rms(indication, group),
        compensation.drift_rms(output("recursive", indication), group),
        compensation.rate_gain(lambda shifted: output("recursive", shifted), indication),
        compensation.rate_gain(lambda shifted: output("one_step", shifted), indication),
        compensation.drift_rms(output("one_step", indication)[1:], group),
        _flags(name, along),
    )


def _flags(name: str, along: Along) -> tuple[str, ...]:
    """What was held or clamped along a log, in shares of its length."""
    return tuple(
        f"{name}: {what} over {100.0 * share:.0f} %"
        for what, share in along.bounds.items()
        if share > 0.005
    )


def compensated(
    log: Log, model: DriftModel, recipe: FogThermalRecipe
) -> tuple[Array, tuple[str, ...]]:
    """Compensated indication [rows, °/h] of a whole log, no row denoised or resampled, and the
    flags.

    The drift is evaluated on block means at the model interval, as it was fitted, and interpolated
    to the rows.
    """
    time, case, env, gyro = (values(log.frame, column) for column in ramps.COLUMNS)
    if not model.exported:
        return gyro, ("no drift term: the indication is returned as it is",)
    _, slope = ramps.cut(log, recipe)
    held = intervals.of(time, model.interval_s, log.steps.usual)
    middle, t_case, t_env, mean = (held.means(column) for column in (time, case, env, gyro))
    blocks = gradient.blocks_of(held, middle, t_case, t_env, mean, slope)
    along = model.along(blocks)
    flags = _flags(log.file, along)
    output = log.room(gyro.size)
    if model.mode == "recursive":
        for a, b in chunks.ranges_along(time, gyro, output):
            output[a:b] = gyro[a:b] - np.interp(time[a:b], blocks.time, along.level)
        return output, flags
    for part, rows in held.groups():
        index = np.repeat(held.number[part], held.count[part])
        output[rows] = gyro[rows] - (
            blocks.indication[np.maximum(index - 1, 0)] + along.delta[index]
        )
        chunks.release(gyro, output)
    return output, (*flags, "one_step: the true rate is removed (rate gain 0)")


def taken_off(log: Log, output: Array) -> Array:
    """Drift [rows, °/h] that a compensated indication [rows, °/h] was freed of."""
    gyro, taken = values(log.frame, "gyro_dph"), log.room(output.size)
    for a, b in chunks.ranges_along(gyro, output, taken):
        np.subtract(gyro[a:b], output[a:b], out=taken[a:b])
    return taken


def uncertainty(log: Log, model: DriftModel, recipe: FogThermalRecipe) -> Array:
    """Standard uncertainty [rows, °/h] of the compensated rate: of the drift that was taken off,
    noise not included.
    """
    time, case, env, gyro = (values(log.frame, column) for column in ramps.COLUMNS)
    blocks = gradient.blocks(
        time, case, env, gyro, np.broadcast_to(0.0, time.shape), model.interval_s
    )
    found = fog_uncertainty.of_blocks(model, blocks, recipe.type_b)
    stated = log.room(time.size)
    for a, b in chunks.ranges_along(time, stated):
        stated[a:b] = np.interp(time[a:b], blocks.time, found.standard)
    return stated

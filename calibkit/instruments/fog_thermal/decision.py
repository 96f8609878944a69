"""Choice of the exported drift term (or none) by tests on left-out ramps, and drift_rate.json.

Each family has its share √(Σ s_compensated/Σ s_raw) of the raw drift on the ramps or rates that
were left out of its fit, s the mean squares of 100 s means; that of the smaller share is exported.
Turn-on biases that differ between cooling and heating logs by more than chance add half of the
difference to the model error: e² ← e² + (Δ/2)².
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.coefficients import Figure, StageResult
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.errors import FitError
from calibkit.frame import Remark
from calibkit.instruments.fog_thermal import forms
from calibkit.instruments.fog_thermal.compensate import DriftModel, LogFigures
from calibkit.instruments.fog_thermal.gradient_choice import SideChoice
from calibkit.instruments.fog_thermal.numeric import choice
from calibkit.instruments.fog_thermal.numeric.bank import BankModel, OnLevels
from calibkit.instruments.fog_thermal.numeric.choice import ThermalChoice
from calibkit.instruments.fog_thermal.numeric.drift_figures import split_noise
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe

CHANCE = 4.0
"""Difference of turn-on biases, in standard uncertainties of some six degrees of freedom, up to
which it is chance: beyond it are 0.7 %.
"""
UNSETTLED = 0.2
"""Share of a change of temperature that a soak may leave in the coil without a flag."""
SETTLED_LAGS = 4.0
"""Lags after which 2 % of a coil's difference to the case are left."""


@dataclass(frozen=True, slots=True)
class Export:
    """Exported drift term, its share of the raw drift on left-out ramps (None if not tested), and
    flags with the reason.
    """

    model: DriftModel
    name: str
    share_of_raw: float | None
    flags: tuple[str, ...]

    def result(
        self,
        choices: Sequence[SideChoice],
        levels: ThermalChoice,
        logs: Sequence[LogFigures],
        recipe: FogThermalRecipe,
    ) -> StageResult:
        """drift_rate.json: the exported model, and the drift figures of all tests and logs with
        rate gains.
        """
        figures = []
        for side in choices:
            if side.tested:
                name = f"raw_drift_rms.{side.side}"
                figures.append(Figure(name, side.tested[0].pooled_raw, "deg/h", 0.0))
            for rates in side.tested:
                name = f"leave_one_rate_out_rms.{side.side}.order_{rates.order}"
                figures.append(Figure(name, rates.pooled, "deg/h", 0.0))
        if levels.tested:
            raw = levels.tested[0].pooled_raw
            figures.append(Figure("raw_drift_rms.ramps", raw, "deg/h", 0.0))
        for tested in levels.tested:
            name = f"leave_one_ramp_out_rms.{tested.name}"
            figures.append(Figure(name, tested.pooled, "deg/h", 0.0))
        if levels.chosen_errors is not None:
            left_out = split_noise(levels.chosen_errors.errors)
            figures += [
                Figure("left_out_noise_rms", left_out.noise, "deg/h", 0.0),
                Figure("left_out_drift_rms", left_out.left, "deg/h", left_out.left_uncertainty),
            ]
        for log in logs:
            split = log.split
            figures += [
                Figure(f"drift_rms_before.{log.name}", log.before, "deg/h", 0.0),
                Figure(f"drift_rms_after.{log.name}", log.after, "deg/h", 0.0),
                Figure(f"noise_rms.{log.name}", split.noise, "deg/h", 0.0),
                Figure(f"drift_left_rms.{log.name}", split.left, "deg/h", split.left_uncertainty),
                Figure(f"rate_gain_recursive.{log.name}", log.gain_recursive, "1", 0.0),
                Figure(f"one_step_rms_after.{log.name}", log.after_one_step, "deg/h", 0.0),
                Figure(f"rate_gain_one_step.{log.name}", log.gain_one_step, "1", 0.0),
            ]
        flags = [*self.flags, *(f"not tested: {reason}" for reason in levels.refused)]
        if recipe.drift.compensation == "one_step":
            flags.append(
                "one_step compensation is a first difference: it removes the true rate"
                " (rate gain 0)"
            )
        models = [
            forms.write_rates(polynomial, recipe.drift.interval_s)
            for polynomial in self.model.polynomials
        ]
        if self.model.thermal is not None:
            models.append(forms.write_thermal(self.model.thermal, recipe.drift.interval_s))
        return StageResult(
            "drift_rate", models=tuple(models), figures=tuple(figures), flags=tuple(flags)
        )


def decide(
    choices: Sequence[SideChoice], levels: ThermalChoice, recipe: FogThermalRecipe
) -> Export:
    """Export the scheme with the smallest share of the raw drift on left-out ramps; none if none
    helps. Raises FitError where no scheme could be tested.
    """
    spec, thermal = recipe.drift, levels.model
    rates = tuple(choice.polynomial for choice in choices if choice.polynomial is not None)
    share_rates, share_levels = _share_of_rates(choices), None
    if levels.chosen_errors is not None:
        share_levels = levels.chosen_errors.pooled / levels.chosen_errors.pooled_raw
    if spec.model in ("level", "lagged", "bank"):
        rates = ()
    if rates and thermal is not None:
        if share_rates is not None and share_levels is not None and share_rates < share_levels:
            thermal = None
        else:
            rates = ()
    model = DriftModel(
        rates, thermal, spec.interval_s, spec.compensation, recipe.reference_temp_degc
    )
    if thermal is not None and levels.chosen_errors is not None:
        flags = [*thermal.flags, Remark(f"exported: {levels.reason}")]
        if thermal.entangled:
            flags.append(
                f"uncertainties of {', '.join(thermal.entangled)} hold together, through the"
                " covariance, not singly"
            )
        return Export(model, levels.chosen_errors.name, share_levels, tuple(flags))
    reasons = [flag for side in choices for flag in side.flags]
    if rates:
        return Export(model, "gradient_rate", share_rates, tuple(reasons))
    if levels.reason:
        reasons.append(levels.reason)
    if not levels.tested and not any(side.tested for side in choices):
        raise FitError(
            f"no family of models can be determined: {'; '.join(reasons)}",
            hint=(
                f"measure {choice.LEAST_RAMPS} ramps or more, better at two rates each way, each"
                " from soak to soak"
            ),
        )
    return Export(model, "none", None, (f"no drift term exported: {'; '.join(reasons)}",))


def list_undetermined(choices: Sequence[SideChoice], levels: ThermalChoice) -> list[str]:
    """Why families of models could not be tested with these ramps, a sentence each."""
    untested = [flag for side in choices if not side.tested for flag in side.flags]
    return [*untested, *levels.refused, *([] if levels.tested else filter(None, [levels.reason]))]


def _share_of_rates(choices: Sequence[SideChoice]) -> float | None:
    """Share of the raw drift on left-out rates after compensation by the exported orders, over both
    sides.
    """
    left, raw = 0.0, 0.0
    for side in choices:
        order = None if side.polynomial is None else side.polynomial.order
        for result in side.tested:
            if result.order == order:
                left += float(np.sum(result.squares))
                raw += float(np.sum(result.raw_squares))
    return float(np.sqrt(left / raw)) if raw else None


def compare_turn_on(model: OnLevels, logs: Sequence[PreparedLog]) -> tuple[float, float] | None:
    """Mean turn-on bias of cooling logs less that of heating logs, and its standard uncertainty
    [°/h]; None with fewer than two logs a side, or a log with ramps in both directions.
    """
    ways = [{ramp.rate > 0.0 for ramp in log.ramps} for log in logs]
    heating, cooling = (
        model.turn_on[[way == {warmer} for way in ways]] for warmer in (True, False)
    )
    if any(len(way) != 1 for way in ways) or min(heating.size, cooling.size) < 2:
        return None
    u = np.sqrt(np.var(heating, ddof=1) / heating.size + np.var(cooling, ddof=1) / cooling.size)
    return float(cooling.mean() - heating.mean()), float(u)


def widen_by_turn_on(export: Export, logs: Sequence[PreparedLog]) -> Export:
    """Export whose model error includes half of a difference between the turn-on biases of cooling
    and heating logs that is not chance, with a flag that explains it; short soaks are flagged.

    A turn-on bias does not know the direction of the ramp that follows. A coil that the soaks do
    not settle makes a difference, and so does a hysteresis; the drift at rest is then off by up to
    half of it.
    """
    thermal = export.model.thermal
    if thermal is None:
        return export
    turn_on_difference, short = compare_turn_on(thermal, logs), _flag_short_soaks(thermal, logs)
    if turn_on_difference is None or abs(turn_on_difference[0]) <= CHANCE * turn_on_difference[1]:
        return replace(export, flags=(*export.flags, *short[1:]))
    difference, u = turn_on_difference
    cause = "the gyro has a hysteresis that the model does not follow"
    cause = f"{short[0]}, or {cause}" if short else cause
    wider = replace(thermal, model_error=math.hypot(thermal.model_error, 0.5 * difference))
    flag = (
        f"turn-on biases cooling less heating {difference:+.3f} deg/h (u {u:.2g}), expected 0:"
        f" {cause}; half of it is in the uncertainty"
    )
    return replace(export, model=replace(export.model, thermal=wider), flags=(*export.flags, flag))


def _flag_short_soaks(thermal: OnLevels, logs: Sequence[PreparedLog]) -> tuple[str, ...]:
    """What is said of the shortest soak if the coil's slowest lag does not settle in it: as a
    cause, and as a flag where more than UNSETTLED of a change of temperature is left.
    """
    if isinstance(thermal, BankModel):
        _, lag_s, _ = thermal.static_lag  # the slower of its two lags
    else:
        lag_s = max(thermal.lags, default=0.0)
    soaks = [log.raw.time[-1] - log.raw.time[log.ramps[-1].stop - 1] for log in logs]
    shortest, settling_s = float(min(soaks)), SETTLED_LAGS * lag_s
    if shortest >= settling_s:
        return ()
    minutes, would_do = shortest / SECONDS_PER_MINUTE, settling_s / SECONDS_PER_MINUTE
    left = math.exp(-shortest / lag_s)
    flag = (
        f"soaks of {minutes:.0f} min leave {left:.0%} of a change of temperature in this coil"
        f" ({would_do:.0f} min would do): if a log began before the coil was at rest, drift at rest"
        " is off by more than its uncertainty says. Begin each log at rest, or soak longer"
    )
    cause = f"soaks of {minutes:.0f} min are too short for this coil ({would_do:.0f} min would do)"
    return (cause, flag) if left > UNSETTLED else (cause,)


def flag_one_way(logs: Sequence[PreparedLog], model: DriftModel) -> list[str]:
    """Flag that ramps of one direction alone were measured, and what the drift term is in the
    other.
    """
    ways = {ramp.rate > 0.0 for log in logs for ramp in log.ramps}
    if len(ways) != 1 or not model.exported:
        return []
    measured, other = ("heats", "cooling") if ways == {True} else ("cools", "heating")
    if isinstance(model.thermal, BankModel):
        consequence = "follows from the heat flow in the coil, and its uncertainty grows"
    else:
        consequence = "is not known: it may come out worse than uncorrected"
    statement = f"every ramp {measured}: {other} was not measured; there the drift {consequence}"
    return [f"{statement}. Measure a ramp each way"]

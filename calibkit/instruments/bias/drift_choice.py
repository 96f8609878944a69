"""Choice of the exported drift term (or none) of a gyro by tests on left-out ramps, and
drift_rate.json.

    ω_k - ω_(k-1) = a_0(r) + a_1(r) G_(k-1) + a_2(r) G²_(k-1),   a_j(r) = Σ_m c_jm r^m

is the published scheme (`published`): a_j of each ramp go into drift.json, polynomials a_j(r) of a
side (heating or cooling), of an order that left-out rates choose, are one family of models.
Models on levels (`numeric.choice`) are the other. Each family has its share √(Σ s_compensated/Σ
s_raw) of the raw drift on the ramps or rates that were left out of its fit, s the mean squares of
100 s means; that of the smaller share is exported. Turn-on biases that differ between cooling and
heating logs by more than chance add half of the difference to the model error: e² ← e² + (Δ/2)².
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.bias import forms
from calibkit.instruments.bias.compensate import DriftModel, LogFigures
from calibkit.instruments.bias.numeric import choice, published
from calibkit.instruments.bias.numeric.bank import BankModel, OnLevels
from calibkit.instruments.bias.numeric.choice import ThermalChoice
from calibkit.instruments.bias.ramps import PreparedLog, Ramp
from calibkit.instruments.bias.recipe import HIGHEST_RATE_ORDER, Drift, FogThermalRecipe
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.numeric.thermal.left_out import (
    WORSE,
    LeftOutErrors,
    blocks_per_figure,
    means_of_groups,
    simplest,
    split_noise,
)
from calibkit.records.coefficients import Figure, StageResult
from calibkit.records.frame import Remark

SAME_RATE = 0.1
"""Relative difference up to which two ramps count as one temperature rate."""
MARGIN = 0.9
"""Largest ratio of the pooled error to raw with which an order helps: of several orders one is some
percent better by chance.
"""


@dataclass(frozen=True, slots=True)
class FittedRamp:
    """Ramp, its log, and the fit of its drift coefficients."""

    ramp: Ramp
    log: PreparedLog
    fit: published.RampFit

    def with_soaks(self) -> published.DriftBlocks:
        """Block means of the ramp with the soaks around it: the whole log where it has one ramp."""
        log_ramps = self.log.ramps
        before = [ramp.stop for ramp in log_ramps if ramp.stop <= self.ramp.start]
        after = [ramp.start for ramp in log_ramps if ramp.start >= self.ramp.stop]
        raw = self.log.raw
        return raw.between(max(before, default=0), min(after, default=raw.time.size))


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOutRates(LeftOutErrors):
    """Errors of one order on the logs of rates that were left out, one log for each ramp."""

    side: str
    order: int
    fitted: Array
    """Mean squares [ramps, (°/h)²] of what the model fitted to all rates leaves."""

    @property
    def helps(self) -> bool:
        """Whether the pooled error on left-out ramps is clearly below raw, by MARGIN, and no ramp
        became worse by WORSE, left out or not.

        If the slowest or the fastest rate is left out, the model holds or clamps it; only the fit
        to all rates shows the effect of the model there.
        """
        # a left-out rate at either end is held or clamped, which harms nothing: the fit to all
        # shows what the model does there
        worst = np.maximum(self.squares, self.fitted)
        unharmed = bool(np.all(worst <= WORSE**2 * self.raw_squares))
        return self.pooled <= MARGIN * self.pooled_raw and unharmed


@dataclass(frozen=True, slots=True)
class SideChoice:
    """Leave-one-rate-out results of each order on one side, and the exported polynomial."""

    side: str
    tested: tuple[LeftOutRates, ...]
    polynomial: published.RatePolynomial | None
    flags: tuple[str, ...]


def alone(spec: Drift) -> bool:
    """Whether the recipe asks for the published scheme alone."""
    return spec.model == "gradient_rate" or (spec.model == "auto" and spec.order != "auto")


def fit_ramps(logs: Sequence[PreparedLog], spec: Drift) -> tuple[list[FittedRamp], tuple[str, ...]]:
    """Fit a0, a1, a2 of every ramp, and flags of ramps that cannot determine them: other models are
    fitted all the same, and the scheme is then tested on no ramp. Raises FitError that names the
    log where no other model is asked for.
    """
    fitted, flags = [], []
    for log in logs:
        for ramp in log.ramps:
            raw, denoised = (
                blocks.between(ramp.start, ramp.stop) for blocks in (log.raw, log.denoised)
            )
            try:
                fit = denoised.fit_ramp(ramp.rate, estimate=spec.estimate, raw=raw.indication)
            except FitError as error:
                if alone(spec):
                    raise FitError(f"{log.source.name}: {error.message}", hint=error.hint) from None
                flags.append(f"gradient_rate: not tested: {ramp.name}: {error.message}")
            else:
                fitted.append(FittedRamp(ramp, log, fit))
    return fitted, tuple(flags)


def left_out_rates(
    ramps: Sequence[published.RampFit], logs: Sequence[published.DriftBlocks], side: str, group: int
) -> list[LeftOutRates]:
    """Fit the polynomials of a side without each temperature rate in turn, and compensate the logs
    of that rate as at run time: for every order that the rates can test (four rates cannot test
    the cubic).

    A left-out rate outside the remaining ones is held or clamped as at run time. `group` is the
    number of intervals in one mean of the drift figure.
    """
    # indices of the ramps of each temperature rate, by rising signed rate
    rates: list[list[int]] = []
    for i in sorted(range(len(ramps)), key=lambda i: ramps[i].rate):
        group_rate = ramps[rates[-1][0]].rate if rates else np.inf
        # ramps of one rate are left out together: a twin in the fit would test nothing
        if rates and abs(ramps[i].rate - group_rate) <= SAME_RATE * abs(group_rate):
            rates[-1].append(i)
        else:
            rates.append([i])

    def compensated(polynomial: published.RatePolynomial, log: published.DriftBlocks) -> Array:
        delta = published.increments([polynomial], log.gradient, log.rate).delta
        return means(log.indication - published.recursive(delta))

    def means(output: Array) -> Array:
        drift_means = means_of_groups(output, group)
        return np.asarray(drift_means - drift_means.mean())

    raw = tuple(means(log.indication) for log in logs)
    tested = []
    # without one of n rates n - 2 is the highest order that the others determine
    for order in range(min(len(rates) - 1, HIGHEST_RATE_ORDER + 1)):
        errors = [np.zeros(0)] * len(ramps)
        for left_out_rate in rates:
            remaining_ramps = [
                ramps[i] for rate in rates if rate is not left_out_rate for i in rate
            ]
            polynomial = published.fit_over_rates(remaining_ramps, order, side)
            for i in left_out_rate:
                errors[i] = compensated(polynomial, logs[i])
        all_rates = published.fit_over_rates(ramps, order, side)
        fitted = np.array([np.mean(compensated(all_rates, log) ** 2) for log in logs])
        name = f"gradient_rate {side}, order {order}"
        of_order = LeftOutRates(
            name, tuple(errors), raw, parameters=order, side=side, order=order, fitted=fitted
        )
        tested.append(of_order)
    return tested


def choose_sides(ramps: Sequence[FittedRamp], spec: Drift) -> list[SideChoice]:
    """Polynomials of each side with ramps, or None where the order is not clearly better than no
    compensation, or where the other side has none.
    """
    choices = []
    for side in ("both",) if spec.sides == "joint" else ("heating", "cooling"):
        members = [
            item for item in ramps if side == "both" or (item.fit.rate > 0.0) == (side == "heating")
        ]
        if members:
            choices.append(_choose_side(members, spec, side))
    if all(one_side.polynomial is not None for one_side in choices):
        return choices
    # the recursion of one side alone would follow only half of a thermal cycle, and keep the
    # difference as a bias
    for k, one_side in enumerate(choices):
        if one_side.polynomial is not None:
            reason = "alone it would leave a bias after a thermal cycle"
            flag = f"gradient_rate {one_side.side}: not exported: {reason}"
            choices[k] = replace(one_side, polynomial=None, flags=(*one_side.flags, flag))
    return choices


def _choose_side(members: Sequence[FittedRamp], spec: Drift, side: str) -> SideChoice:
    """Polynomials of one side: those of the recipe's order whatever left-out rates show, with flags
    of what is missing or worse; else of the simplest order that is as good as the best, if any
    helps.
    """
    fits, logs = [item.fit for item in members], [item.with_soaks() for item in members]
    tested = left_out_rates(fits, logs, side, blocks_per_figure(spec.interval_s))
    flags = []
    if spec.order != "auto":
        polynomial = published.fit_over_rates(fits, spec.order, side)
        if polynomial.dof == 0:
            flags.append(
                f"{side}: zero degrees of freedom over the rates: order {spec.order} passes"
                " through every a_j and no rate is left to test it"
            )
        flags += [
            f"{side}: pinned order {spec.order} leaves {result.pooled:.3g} deg/h on left-out rates"
            f" against {result.pooled_raw:.3g} deg/h raw, or makes a ramp worse"
            for result in tested
            if result.order == spec.order and not result.helps
        ]
        return SideChoice(side, tuple(tested), polynomial, tuple(flags))
    helping = [order for order, result in enumerate(tested) if result.helps]
    if helping:
        polynomial = published.fit_over_rates(fits, simplest(tested, helping), side)
        return SideChoice(side, tuple(tested), polynomial, ())
    reason = "one temperature rate only, so that no rate can be left out to test the model"
    if tested:
        best_tested = min(tested, key=lambda result: result.pooled)
        reason = (
            f"leave-one-rate-out leaves {best_tested.pooled:.3g} deg/h at best (order"
            f" {best_tested.order}) against {best_tested.pooled_raw:.3g} deg/h raw, or makes a"
            " ramp worse"
        )
    return SideChoice(side, tuple(tested), None, (f"gradient_rate {side}: not exported: {reason}",))


BY_CHANCE = 0.005
"""Chance at which turn-on biases of a faultless gyro are said to differ by the way."""
UNSETTLED = 0.2
"""Share of a change of temperature that a soak may leave in the coil without a flag."""
SETTLED_LAGS = 4.0
"""Lags after which 2 % of a coil's difference to the case are left."""


@dataclass(frozen=True, slots=True)
class Export:
    """Exported drift term, the errors of all tested models on left-out ramps or rates and those of
    the exported one (of the published scheme of each side; empty where nothing was left out), and
    flags with the reason.
    """

    model: DriftModel
    tested: tuple[LeftOutErrors, ...]
    errors: tuple[LeftOutErrors, ...]
    flags: tuple[str, ...]
    untested: tuple[str, ...] = ()
    """Why families of models could not be tested with these ramps, a sentence each."""

    @property
    def name(self) -> str:
        """Name of the model; none where no drift term is exported."""
        if self.model.polynomials:
            return "gradient_rate"
        return self.errors[0].name if self.model.exported else "none"

    @property
    def left_out_noise(self) -> float:
        """What noise alone gives on left-out ramps [°/h]: that of the model which leaves least of
        it.
        """
        return min((split_noise(errors.errors).noise for errors in self.tested), default=0.0)

    def result(self, logs: Sequence[LogFigures], recipe: FogThermalRecipe) -> StageResult:
        """drift_rate.json: the exported model, and the drift figures of all tests and logs with
        rate gains.
        """
        figures: list[Figure] = []
        for errors in self.tested:
            group, kind, name = "ramps", "ramp", errors.name
            if isinstance(errors, LeftOutRates):
                group, kind, name = errors.side, "rate", f"{errors.side}.order_{errors.order}"
            raw_name = f"raw_drift_rms.{group}"
            if raw_name not in {figure.name for figure in figures}:
                figures.append(Figure(raw_name, errors.pooled_raw, "deg/h", 0.0))
            left_name = f"leave_one_{kind}_out_rms.{name}"
            figures.append(Figure(left_name, errors.pooled, "deg/h", 0.0))
        if self.errors:
            split = split_noise([error for errors in self.errors for error in errors.errors])
            figures += [
                Figure("left_out_noise_rms", split.noise, "deg/h", 0.0),
                Figure("left_out_drift_rms", split.left, "deg/h", split.left_uncertainty),
            ]
        for log in logs:
            for name, value, unit in (
                ("drift_rms_before", log.before, "deg/h"),
                ("drift_rms_after", log.after, "deg/h"),
                ("noise_rms", log.split.noise, "deg/h"),
                ("drift_left_rms", log.split.left, "deg/h"),
                ("rate_gain_recursive", log.gain_recursive, "1"),
                ("one_step_rms_after", log.after_one_step, "deg/h"),
                ("rate_gain_one_step", log.gain_one_step, "1"),
            ):
                u = log.split.left_uncertainty if name == "drift_left_rms" else 0.0
                figures.append(Figure(f"{name}.{log.name}", value, unit, u))
        flags = [*self.flags]
        if recipe.drift.compensation == "one_step":
            flags.append(
                "one_step compensation is a first difference: it removes the true rate"
                " (rate gain 0)"
            )
        interval_s = recipe.drift.interval_s
        models = [forms.write_rates(rates, interval_s) for rates in self.model.polynomials]
        if self.model.thermal is not None:
            models.append(forms.write_thermal(self.model.thermal, interval_s))
        return StageResult("drift_rate", tuple(models), tuple(figures), flags=tuple(flags))


def decide(
    choices: Sequence[SideChoice], levels: ThermalChoice, recipe: FogThermalRecipe
) -> Export:
    """Export the scheme with the smallest share of the raw drift on left-out ramps; none if none
    helps. Raises FitError where no scheme could be tested.
    """
    spec, thermal = recipe.drift, levels.model
    polynomials = tuple(side.polynomial for side in choices if side.polynomial is not None)
    of_rates = tuple(
        errors
        for side in choices
        for errors in side.tested
        if side.polynomial is not None and errors.order == side.polynomial.order
    )
    of_levels = () if levels.chosen_errors is None else (levels.chosen_errors,)
    if spec.model in ("level", "lagged", "bank"):
        polynomials = ()
    # by shares of raw, as the one is tested on rates and the other on ramps
    if polynomials and thermal is not None:
        if of_rates and share_of_raw(of_rates) < share_of_raw(of_levels):
            thermal = None
        else:
            polynomials = ()
    tested = (*(errors for side in choices for errors in side.tested), *levels.tested)
    reasons = [flag for side in choices for flag in side.flags]
    untested = [flag for side in choices if not side.tested for flag in side.flags]
    untested += [*levels.refused, *([] if levels.tested else filter(None, [levels.reason]))]
    flags = [*reasons]
    exported_errors: tuple[LeftOutErrors, ...] = of_rates if polynomials else ()
    if thermal is not None:
        flags = [
            *thermal.flags,
            *map(Remark, thermal.remarks),
            Remark(f"exported: {levels.reason}"),
        ]
        exported_errors = of_levels
        if thermal.entangled:
            together = f"uncertainties of {', '.join(thermal.entangled)} hold together"
            flags.append(Remark(f"{together}, through the covariance, not singly"))
    elif not polynomials:
        reasons += filter(None, [levels.reason])
        if not tested:
            raise FitError(
                f"no family of models can be determined: {'; '.join(reasons)}",
                hint=(
                    f"measure {choice.LEAST_RAMPS} ramps or more, better at two rates each way,"
                    " each from soak to soak"
                ),
            )
        flags = [f"no drift term exported: {'; '.join(reasons)}"]
    flags += [f"not tested: {reason}" for reason in levels.refused]
    model = DriftModel(
        polynomials, thermal, spec.interval_s, spec.compensation, recipe.reference_temp_degc
    )
    return Export(model, tested, exported_errors, tuple(flags), tuple(untested))


def choose_on_levels(logs: Sequence[PreparedLog], spec: Drift) -> ThermalChoice:
    """Model of the rate itself, chosen on left-out ramps; none where the published scheme alone is
    asked for.
    """
    if alone(spec):
        return ThermalChoice((), (), None, None, "")
    candidates = [entry for entry in choice.CANDIDATES if spec.model in ("auto", entry.form)]
    blocks = [log.thermal for log in logs]
    return choice.choose(blocks, candidates, figure_blocks=blocks_per_figure(spec.interval_s))


def flag_worse(export: Export, logs: Sequence[LogFigures]) -> list[str]:
    """Flags of logs that are worse with a drift term that no rate was left to test, as of an order
    that the recipe pins.
    """
    return [
        f"{log.name}: drift of {log.before:.3g} deg/h before compensation, {log.after:.3g} deg/h"
        " after, expected less: the exported drift term was tested on no left-out ramp"
        for log in logs
        if export.model.exported and not export.errors and log.after > WORSE * log.before
    ]


def share_of_raw(errors: Sequence[LeftOutErrors]) -> float:
    """Share of the raw drift that is left on what was left out."""
    left = sum(float(np.sum(entry.squares)) for entry in errors)
    return math.sqrt(left / sum(float(np.sum(entry.raw_squares)) for entry in errors))


def compare_turn_on(
    model: OnLevels, logs: Sequence[PreparedLog]
) -> tuple[float, float, float] | None:
    """Mean turn-on bias of cooling logs less that of heating logs, its standard uncertainty, and
    the largest difference by chance [°/h]; None with fewer than two logs a side, or a log with
    ramps in both directions.
    """
    from scipy.special import stdtrit

    ways = [{ramp.rate > 0.0 for ramp in log.ramps} for log in logs]
    heating, cooling = (
        model.turn_on[[way == {warmer} for way in ways]] for warmer in (True, False)
    )
    if any(len(way) != 1 for way in ways) or min(heating.size, cooling.size) < 2:
        return None
    u = np.sqrt(np.var(heating, ddof=1) / heating.size + np.var(cooling, ddof=1) / cooling.size)
    # Student's t: of three logs each way four standard uncertainties are no proof
    by_chance = stdtrit(len(logs) - 2, 1.0 - BY_CHANCE / 2.0) * u
    return float(cooling.mean() - heating.mean()), float(u), float(by_chance)


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
    flags = [*export.flags]
    # whether the slowest lag of the coil settles in the shortest soak
    lags = thermal.static_lag[:2] if isinstance(thermal, BankModel) else thermal.lags
    lag_s = max(lags, default=0.0)
    soaks = [log.raw.time[-1] - log.raw.time[log.ramps[-1].stop - 1] for log in logs]
    shortest, settling_s = float(min(soaks)), SETTLED_LAGS * lag_s
    minutes, would_do = shortest / SECONDS_PER_MINUTE, settling_s / SECONDS_PER_MINUTE
    cause = "the gyro has a hysteresis that the model does not follow"
    if shortest < settling_s:
        cause = (
            f"soaks of {minutes:.0f} min are too short for this coil ({would_do:.0f} min would do),"
            f" or {cause}"
        )
    turn_on_difference = compare_turn_on(thermal, logs)
    if turn_on_difference is not None:
        difference, u, by_chance = turn_on_difference
        if abs(difference) > by_chance:
            # the drift at rest lies between what heating and what cooling logs say
            error = math.hypot(thermal.model_error, 0.5 * difference)
            wider = replace(export.model, thermal=replace(thermal, model_error=error))
            flags.append(
                f"turn-on biases cooling less heating {difference:+.3f} deg/h (u {u:.2g}), expected"
                f" 0: {cause}; half of it is in the uncertainty"
            )
            return replace(export, model=wider, flags=tuple(flags))
    # share of a change of temperature that the slowest lag has still to follow
    left = math.exp(-shortest / lag_s) if shortest < settling_s else 0.0
    if left > UNSETTLED:
        flags.append(
            f"soaks of {minutes:.0f} min leave {left:.0%} of a change of temperature in this coil"
            f" ({would_do:.0f} min would do): if a log began before the coil was at rest, drift at"
            " rest is off by more than its uncertainty says. Begin each log at rest, or soak longer"
        )
    return replace(export, flags=tuple(flags))


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

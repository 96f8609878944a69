"""Power-ons → chosen model of each channel, and thermal.json.

    y = b_j + Σ_k c_k x_k(T, dT/dt, lags of T)

b_j is the level of power-on j with its turn-on bias, x_k are the terms of a level or lagged model
(`numeric.thermal.terms`). Each CANDIDATE is a set of them, of which `choose` takes that with the
smallest errors on stretches that were left out of the fit. What lasts in these errors, beyond the
noise and the uncertainty of c_k, is the model error: e² = mean product of neighbouring errors −
what these explain of it. Where a temperature leaves the fitted range, the terms go on for a third
of it (`REACH`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit import units
from calibkit.arrays import Array, Mask
from calibkit.coefficients import Component, Figure, Parameter, StageResult
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.errors import FitError
from calibkit.instruments.bias import forms
from calibkit.instruments.bias.figures import ChannelCurves
from calibkit.instruments.bias.power_ons import PowerOn
from calibkit.instruments.bias.recipe import EFFECT, GROUP, ThermalRecipe
from calibkit.numeric import chunks, dispersion
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares.fit import linear
from calibkit.numeric.thermal import fits, uncertainty
from calibkit.numeric.thermal.evaluate import evaluate_terms, evaluate_wide
from calibkit.numeric.thermal.left_out import (
    CLEARLY,
    MOVING_DEGC_MIN,
    STATIC,
    Candidate,
    LeftOutErrors,
    blocks_per_figure,
    figure_means,
    leave_out,
    simplest,
    solve,
)
from calibkit.numeric.thermal.pooled_fit import Stack, WhitenedRows
from calibkit.numeric.thermal.terms import ThermalModel

RATES = ("s_rate", "s_temp_rate")
CONSTANT = Candidate("constant", "level", STATIC[:1])
CANDIDATES = (
    Candidate("T", "level", STATIC[:2]),
    Candidate("T²", "level", STATIC[:3]),
    Candidate("T³", "level", STATIC),
    Candidate("T, dT/dt", "level", (*STATIC[:2], "s_rate")),
    Candidate("T³, dT/dt", "level", (*STATIC, "s_rate")),
    Candidate("T³, dT/dt, T·dT/dt", "level", (*STATIC, *RATES)),
    Candidate("lag, T", "lagged", (*STATIC[:2], "s_rate")),
    Candidate("lag, T²", "lagged", (*STATIC[:3], "s_rate")),
    Candidate("lag, T³", "lagged", (*STATIC, "s_rate")),
    Candidate("lag, T³, T·dT/dt", "lagged", (*STATIC, *RATES)),
    Candidate("two lags, T³", "lagged", (*STATIC, "s_grad")),
    Candidate("two lags, T³, dT/dt", "lagged", (*STATIC, "s_rate", "s_grad")),
    Candidate("two lags, T³, dT/dt, T·dT/dt", "lagged", (*STATIC, *RATES, "s_grad")),
)


@dataclass(frozen=True, slots=True)
class Choice:
    """Errors of all candidates on stretches and on pairs of them, left out together, why others
    could not be fitted, the chosen model and its test. What a model misses is seen better by
    leaving out more, what tells models apart by leaving out less.
    """

    tested: tuple[LeftOutErrors, ...]
    refused: tuple[str, ...]
    chosen_errors: LeftOutErrors
    model: ThermalModel

    @property
    def constant(self) -> LeftOutErrors:
        """Test of the bias without any term of temperature."""
        return self.tested[0]


def choose(
    stacked: Stack, candidates: Sequence[Candidate] = CANDIDATES, *, figure_blocks: int
) -> Choice:
    """Fit each candidate without each stretch in turn and choose the simplest within one standard
    error of the smallest error on left-out stretches; the constant where none is clearly below it.

    Raises FitError where no candidate can be fitted.
    """
    pairs = Stack.of_logs([replace(log, part=log.part // 2) for log in stacked.logs])
    basis = fits.level_basis(stacked)
    solved, refused = solve((CONSTANT, *candidates), basis)
    cuts = [(cut, leave_out(cut, basis.rows)) for cut in (stacked, pairs)]
    errors = [_left_out(fit, cuts, figure_blocks) for _, fit in solved]
    tested = [
        LeftOutErrors(candidate.name, left, errors[0], fit.parameters, fit.endless)
        for (candidate, fit), left in zip(solved, errors, strict=True)
    ]
    if len(tested) == 1:
        raise FitError(
            f"no model can be fitted: {'; '.join(refused)}",
            hint="log the instrument while its temperature changes",
        )
    helping = (k for k, test in enumerate(tested) if k and test.pooled <= CLEARLY * test.pooled_raw)
    chosen_number = simplest(tested, (0, *helping))
    model = fits.finish(solved[chosen_number][1])
    of_pairs = errors[chosen_number][len(stacked.ramps) :]
    model = _with_model_error(model, of_pairs, pairs, figure_blocks)
    return Choice(tuple(tested), tuple(refused), tested[chosen_number], model)


def _left_out(
    solution: fits.TermSolution,
    cuts: Sequence[tuple[Stack, tuple[WhitenedRows, ...]]],
    figure_blocks: int,
) -> tuple[Array, ...]:
    """Errors of a candidate on each stretch, then on each pair of them, fitted to all others; the
    turn-on bias is that of the rest of the power-on, or the stretch's own where it has no other.
    """
    sound = solution.rows.sound
    errors = []
    for stacked, remaining_rows in cuts:
        for number, drift in enumerate(solution.leave_out(remaining_rows)):
            left = stacked.indication - drift
            errors.append(_errors(number, left, stacked, sound, figure_blocks))
    return tuple(errors)


def _errors(number: int, left: Array, stacked: Stack, sound: Mask, figure_blocks: int) -> Array:
    """Figure means of indication less prediction [n] over one stretch, less the level of the other
    stretches of its power-on.
    """
    stretch = stacked.ramps[number]
    log = stacked.log_rows[stacked.ramp_log[number]]
    rest_of_power_on = sound[log].copy()
    rest_of_power_on[stretch.start - log.start : stretch.stop - log.start] = False
    means = figure_means(left[stretch], sound[stretch], figure_blocks)
    level = (
        np.average(left[log], weights=rest_of_power_on) if rest_of_power_on.any() else means.mean()
    )
    return np.asarray(means - level, dtype=np.float64)


def _with_model_error(
    model: ThermalModel, of_pairs: Sequence[Array], stacked: Stack, figure_blocks: int
) -> ThermalModel:
    """Model with what lasts in its errors on left-out stretches beyond noise and coefficients: at
    rest or while the temperature changes, whichever is larger.
    """
    rest_degc = model.nearest_fitted(0.0)
    stretches: list[tuple[Array, list[Array], Mask]] = []
    errors = iter(of_pairs)
    for log in stacked.logs:
        sensitivities = evaluate_terms(
            model, log.time, log.case, log.env, rest_degc, log.starts
        ).sensitivities
        parts = uncertainty.explain_parts(model, log, sensitivities, figure_blocks, of_rest=True)
        for rows, covariances in parts:
            error = next(errors)
            if error.size == len(rows):
                minutes = np.maximum(np.ptp(log.time[rows], axis=1), 1.0) / SECONDS_PER_MINUTE
                rate = np.ptp(log.case[rows], axis=1) / minutes
                stretches.append((error, covariances, rate > MOVING_DEGC_MIN))
    sizes = [0.0]
    for moving in (True, False):
        # errors of the runs, and the products of neighbouring ones that noise and coefficients make
        run_errors: list[Array] = []
        products: list[Array] = []
        for error, covariances, changing in stretches:
            for run in _runs(changing == moving):
                run_errors.append(error[run])
                for k, at_lag in zip(uncertainty.NEIGHBOURING, covariances, strict=True):
                    products.append(at_lag[run.start : max(run.stop - k, run.start)])
        if run_errors:
            expected = np.concatenate(products)
            explained = expected.sum() / max(expected.size, 1)
            sizes.append(uncertainty.model_error(run_errors, explained))
    return replace(
        model, model_error=max(sizes), model_error_dof=float(max(len(stacked.ramps) - 1, 1))
    )


def _runs(mask: Mask) -> list[slice]:
    """Runs of a mask [n]."""
    return [slice(first, stop) for first, stop in chunks.find_runs(mask).tolist()]


BY_CHANCE = 0.005
"""Chance at which turn-on biases of faultless power-ons are said to follow the temperature."""
NO_TERM = "no drift term needed: no model is clearly better than a constant on left-out stretches"


@dataclass(frozen=True, slots=True)
class FittedChannel:
    """Chosen model of one channel and what it leaves, in the channel's unit."""

    choice: Choice
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

    @property
    def name(self) -> str:
        """Name of the channel."""
        return self.curves.name

    @property
    def unit(self) -> str:
        """Unit of the channel."""
        return self.curves.unit

    @property
    def varies(self) -> bool:
        """Whether the model has a term beside the constant."""
        return self.choice.chosen_errors is not self.choice.constant


def fit_channel(
    name: str, power_ons: Sequence[PowerOn], spec: ThermalRecipe, interval_s: float
) -> FittedChannel:
    """Choose and fit the terms of one channel; raises FitError that names it."""
    stacked = Stack.of_logs([power_on.of_channel(name) for power_on in power_ons])
    family = spec.thermal.model
    candidates = [candidate for candidate in CANDIDATES if family in ("auto", candidate.form)]
    try:
        channel_choice = choose(stacked, candidates, figure_blocks=blocks_per_figure(interval_s))
    except FitError as error:
        raise FitError(f"{name}: {error.message}", hint=error.hint) from None
    channel_choice, components = _share_turn_on(channel_choice, name, power_ons, spec)
    # what a turn-on changes is the level of a power-on: all is shown about that of its fitted rows
    raw: list[Array] = []
    left: list[Array] = []
    variances = []
    for power_on, log in zip(power_ons, stacked.logs, strict=True):
        drift = evaluate_wide(channel_choice.model, log, spec.reference_temp_degc).drift
        for curve, indication in ((raw, log.indication), (left, log.indication - drift)):
            curve.append(np.asarray(indication - indication[power_on.fitted].mean()))
        corrected = (log.indication - drift)[power_on.fitted]
        variances.append(dispersion.variances_within(corrected, corrected))
    fitted = np.concatenate([power_on.fitted for power_on in power_ons])
    before_and_after = np.concatenate(raw), np.concatenate(left)
    before, after = (rms(indication[fitted]) for indication in before_and_after)
    withheld = None
    if not fitted.all():
        withheld = rms(before_and_after[0][~fitted]), rms(before_and_after[1][~fitted])
    no_term = (NO_TERM,) if channel_choice.chosen_errors is channel_choice.constant else ()
    flags = (
        *channel_choice.model.flags,
        *no_term,
        *_flag_turn_on_drift(name, channel_choice, power_ons),
    )
    return FittedChannel(
        channel_choice,
        ChannelCurves(name, units.column_unit(name), tuple(raw), tuple(left)),
        before,
        after,
        dispersion.over_noise(after, variances),
        withheld,
        chunks.extremes(
            np.concatenate([power_on.blocks.case[power_on.fitted] for power_on in power_ons])
        ),
        components,
        tuple(f"{name}: {flag}" for flag in flags),
    )


def _share_turn_on(
    channel_choice: Choice, name: str, power_ons: Sequence[PowerOn], spec: ThermalRecipe
) -> tuple[Choice, tuple[Component, ...]]:
    """The choice, and the standard deviation of turn-on biases as a component of its model: that
    which the recipe states, whose uncertainty the constant then has, else that of the power-ons;
    none of one power-on.
    """
    unit, model, count = units.column_unit(name), channel_choice.model, len(power_ons)
    stated_component = next(
        (entry for entry in spec.errors.component if entry.effect == EFFECT), None
    )
    if stated_component is not None:
        # the stated size replaces what the few power-ons show, it is not added to it
        value = stated_component.value_in(unit)
        covariance = model.covariance.copy()
        covariance[0, 0] += value**2 / count - model.turn_on_variance
        dof = min(stated_component.dof, float(model.dof))
        model = replace(model, covariance=covariance, constant_dof=dof)
        component = Component(GROUP, EFFECT, value, unit, 0.0, count)
        return replace(channel_choice, model=model), (component,)
    if count < 2:
        return channel_choice, ()
    value = float(np.std(model.turn_on, ddof=1))
    u = value / np.sqrt(2.0 * (count - 1))
    return channel_choice, (Component(GROUP, EFFECT, value, unit, float(u), count),)


def _flag_turn_on_drift(
    name: str, channel_choice: Choice, power_ons: Sequence[PowerOn]
) -> tuple[str, ...]:
    """Flag that turn-on biases follow the temperatures of the power-ons."""
    from scipy.special import stdtrit

    case = np.array([power_on.blocks.case[power_on.fitted].mean() for power_on in power_ons])
    if case.size < 3 or not np.ptp(case):
        return ()
    line = linear(
        np.column_stack([case - case.mean(), np.ones_like(case)]), channel_choice.model.turn_on
    )
    slope, u = float(line.coefficients[0]), float(line.standard_uncertainty[0])
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


def result(
    channels: Sequence[FittedChannel], interval_s: float, flags: Sequence[str]
) -> StageResult:
    """thermal.json: one model of each channel, named by it, with its rms before and after, on
    stretches left out by each candidate, and on withheld ones.
    """
    models, figures = [], []
    for channel in channels:
        model = channel.choice.model
        range_of_case = zip(forms.CASE_RANGE, channel.case, strict=True)
        models.append(
            forms.write_thermal(
                model,
                interval_s,
                channel.name,
                channel.unit,
                components=channel.components,
                extra_parameters=tuple(
                    Parameter(name, value, "degC") for name, value in range_of_case
                ),
            )
        )
        rms_of = {f"rms_before.{channel.name}": channel.before}
        rms_of[f"rms_after.{channel.name}"] = channel.after
        for tested in channel.choice.tested:
            rms_of[f"left_out_rms.{channel.name}.{tested.name}"] = tested.pooled
        if channel.withheld is not None:
            for stage, value in zip(("before", "after"), channel.withheld, strict=True):
                rms_of[f"withheld_rms_{stage}.{channel.name}"] = value
        figures += [Figure(name, value, channel.unit, 0.0) for name, value in rms_of.items()]
    return StageResult("thermal", tuple(models), tuple(figures), flags=tuple(flags))

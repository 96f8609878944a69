"""Power-ons → chosen model of each channel, and thermal.json."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit import thermal_forms, units
from calibkit.arrays import Array, Mask
from calibkit.coefficients import Component, Figure, Model, Parameter, StageResult
from calibkit.errors import FitError
from calibkit.instruments.thermal import forms
from calibkit.instruments.thermal.numeric import choice
from calibkit.instruments.thermal.numeric.choice import Choice
from calibkit.instruments.thermal.power_ons import PowerOn
from calibkit.instruments.thermal.recipe import EFFECT, GROUP, ThermalRecipe
from calibkit.numeric import chunks, dispersion
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares.fit import linear
from calibkit.numeric.thermal.evaluate import Evaluation, evaluate_terms
from calibkit.numeric.thermal.left_out import blocks_per_figure
from calibkit.numeric.thermal.pooled_fit import Stack, ThermalLog
from calibkit.numeric.thermal.terms import ThermalModel, Valid

REACH = 1.0 / 3.0
"""Share of a fitted range by which a model is carried beyond each of its ends; further out it is
held. On left-out quarters of simulated sweeps that go 30 % further than the rest, its error is then
that of the true model; held at the ends it is several times that.
"""
BY_CHANCE = 0.005
"""Chance at which turn-on biases of faultless power-ons are said to follow the temperature."""
NO_TERM = "no drift term needed: no model is clearly better than a constant on left-out stretches"


@dataclass(frozen=True, slots=True)
class FittedChannel:
    """Chosen model of one channel and what it leaves, in the channel's unit."""

    name: str
    choice: Choice
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
    def unit(self) -> str:
        """Unit of the channel."""
        return units.column_unit(self.name)

    @property
    def varies(self) -> bool:
        """Whether the model has a term beside the constant."""
        return self.choice.chosen.candidate is not choice.CONSTANT


def evaluate_wide(model: ThermalModel, log: ThermalLog, reference_degc: float) -> Evaluation:
    """Bias along blocks, carried beyond the fitted ranges by REACH; it is zero at rest at the
    reference temperature, which is clamped to the fitted range.
    """
    wide = Valid(
        *((low - REACH * (high - low), high + REACH * (high - low)) for low, high in model.valid)
    )
    still = model.nearest_fitted(reference_degc)
    within = evaluate_terms(model, log.time, log.case, log.env, still, log.starts)
    found = evaluate_terms(
        replace(model, valid=wide), log.time, log.case, log.env, still, log.starts
    )
    # what the terms add beyond the fitted ranges, which enters the uncertainty; -0 is 0
    beyond = found.drift + found.beyond - within.drift + 0.0
    return replace(within, drift=found.drift, sensitivities=found.sensitivities, beyond=beyond)


def fit_channel(
    name: str, power_ons: Sequence[PowerOn], spec: ThermalRecipe, interval_s: float
) -> FittedChannel:
    """Choose and fit the terms of one channel; raises FitError that names it."""
    stacked = Stack.of_logs([one.of_channel(name) for one in power_ons])
    forms_of = spec.thermal.model
    candidates = [one for one in choice.CANDIDATES if forms_of in ("auto", one.form)]
    try:
        found = choice.choose(stacked, candidates, figure_blocks=blocks_per_figure(interval_s))
    except FitError as error:
        raise FitError(f"{name}: {error.message}", hint=error.hint) from None
    found, components = _share_turn_on(found, name, power_ons, spec)
    left = [
        log.indication - evaluate_wide(found.model, log, spec.reference_temp_degc).drift
        for log in stacked.logs
    ]
    raw = [log.indication for log in stacked.logs]
    masks = [stacked.fitted[rows] for rows in stacked.log_rows]
    variances = (
        dispersion.variances_within(values[mask], values[mask])
        for values, mask in zip(left, masks, strict=True)
    )
    before, after = (rms(_about_level(values, masks, masks)) for values in (raw, left))
    out = [~mask for mask in masks]
    withheld = None
    if not stacked.fitted.all():
        both = [rms(_about_level(values, masks, out)) for values in (raw, left)]
        withheld = both[0], both[1]
    no_term = (NO_TERM,) if found.chosen.candidate is choice.CONSTANT else ()
    flags = (*found.model.flags, *no_term, *_flag_turn_on_drift(name, found, power_ons))
    return FittedChannel(
        name,
        found,
        before,
        after,
        dispersion.over_noise(after, variances),
        withheld,
        chunks.extremes(np.concatenate([one.blocks.case[one.fitted] for one in power_ons])),
        components,
        tuple(f"{name}: {flag}" for flag in flags),
    )


def _about_level(values: Iterable[Array], level: Iterable[Mask], shown: Iterable[Mask]) -> Array:
    """Values [m] of all power-ons at the rows of `shown`, each about its mean over `level`."""
    return np.concatenate(
        [own[rows] - own[mask].mean() for own, mask, rows in zip(values, level, shown, strict=True)]
    )


def _share_turn_on(
    found: Choice, name: str, power_ons: Sequence[PowerOn], spec: ThermalRecipe
) -> tuple[Choice, tuple[Component, ...]]:
    """The choice, and the standard deviation of turn-on biases as a component of its model: that
    which the recipe states, whose uncertainty the constant then has, else that of the power-ons;
    none of one power-on.
    """
    unit, model, count = units.column_unit(name), found.model, len(power_ons)
    stated = next((entry for entry in spec.errors.component if entry.effect == EFFECT), None)
    if stated is not None:
        # the stated size replaces what the few power-ons show, it is not added to it
        value = stated.value_in(unit)
        covariance = model.covariance.copy()
        covariance[0, 0] += value**2 / count - model.turn_on_variance
        dof = min(stated.dof, float(model.dof))
        model = replace(model, covariance=covariance, constant_dof=dof)
        component = Component(GROUP, EFFECT, value, unit, 0.0, count)
        return replace(found, model=model), (component,)
    if count < 2:
        return found, ()
    value = float(np.std(model.turn_on, ddof=1))
    u = value / np.sqrt(2.0 * (count - 1))
    return found, (Component(GROUP, EFFECT, value, unit, float(u), count),)


def _flag_turn_on_drift(name: str, found: Choice, power_ons: Sequence[PowerOn]) -> tuple[str, ...]:
    """Flag that turn-on biases follow the temperatures of the power-ons."""
    from scipy.special import stdtrit

    case = np.array([one.blocks.case[one.fitted].mean() for one in power_ons])
    if case.size < 3 or not np.ptp(case):
        return ()
    line = linear(np.column_stack([case - case.mean(), np.ones_like(case)]), found.model.turn_on)
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


def flag_one_power_on(power_ons: Sequence[PowerOn], spec: ThermalRecipe) -> tuple[str, ...]:
    """Flag that one power-on alone was logged and the recipe states no turn-on bias."""
    if len(power_ons) > 1 or spec.errors.component:
        return ()
    return (
        (
            f"{EFFECT} of the {GROUP}: one {GROUP} cannot show how another differs, so it is in no"
            " uncertainty; log more of them, or state the size in [[errors.component]]"
        ),
    )


def result(
    channels: Sequence[FittedChannel], interval_s: float, flags: Sequence[str]
) -> StageResult:
    """thermal.json: one model of each channel, named by it, with the errors of all candidates."""
    return StageResult(
        "thermal",
        models=tuple(_model(one, interval_s) for one in channels),
        figures=tuple(figure for one in channels for figure in _figures(one)),
        flags=tuple(flags),
    )


def _model(one: FittedChannel, interval_s: float) -> Model:
    """Model of one channel."""
    model = one.choice.model
    form = forms.LEVEL if model.form == "level" else forms.LAGGED
    return thermal_forms.write_terms(
        form,
        one.name,
        model,
        interval_s,
        one.unit,
        components=one.components,
        more=tuple(
            Parameter(name, value, "degC")
            for name, value in zip(forms.CASE_RANGE, one.case, strict=True)
        ),
    )


def _figures(one: FittedChannel) -> list[Figure]:
    """Figures of one channel: rms before and after, on left-out stretches, withheld."""
    both = [
        (f"rms_before.{one.name}", one.before),
        (f"rms_after.{one.name}", one.after),
        *(
            (f"left_out_rms.{one.name}.{tested.candidate.name}", tested.pooled)
            for tested in one.choice.tested
        ),
    ]
    if one.withheld is not None:
        raw, left = one.withheld
        both += [(f"withheld_rms_before.{one.name}", raw), (f"withheld_rms_after.{one.name}", left)]
    return [Figure(name, value, one.unit, 0.0) for name, value in both]

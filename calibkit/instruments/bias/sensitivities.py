"""How coefficients of a bias over temperature move with errors of the thermometers and of the
indication.

    sum of terms    exactly: a sum of powers of T + δ or (1 + ε) T is one of powers of T of the same
                    order, and lags do not change
                    c_k T^k → c_k (T − δ)^k:   ∂c_{k−1}/∂δ = −k c_k
                    T → T/(1 + ε):             ∂c_k/∂ε = −k c_k
    gyro at rest    design(T) δc = −∂ω/∂T · δT, for δT constant or proportional to T
    ramp            a0, a1, a2 refitted to the same intervals with shifted temperatures
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibkit.instruments.bias import forms
from calibkit.instruments.bias.at_rest import RESULT
from calibkit.instruments.bias.drift_choice import FittedRamp
from calibkit.instruments.bias.recipe import Drift
from calibkit.numeric.thermal.terms import CASE, LAGS, RATE
from calibkit.records.coefficients import Model, StageResult
from calibkit.records.sensitivities import (
    InputError,
    Kind,
    Sensitivity,
    differentiate,
    of_thermometer,
)

DEGREE = {"s_grad2": 2, "s_temp_rate": 2}
"""Degree in temperatures of the terms that are neither powers p_k, b_k nor linear."""
TIMED = {"s_rate", "s_temp_rate", "s_grad_rate", *LAGS}
"""Coefficients in proportion to the logged time."""
ENV, GYRO = "temp_env_degc", "gyro_dph"
SHARE = 1e-5
"""Relative error of the indication by which ramps are fitted again."""
POINTS = 41
"""Temperatures at rest over which shifted coefficients are found."""
AT_REST = ("mean_rate_at_reference", RESULT)
"""Figures that move with the level."""


def find(result: StageResult) -> tuple[Sensitivity, ...]:
    """Sensitivities of every coefficient of a model whose value is the bias; none of those that are
    polynomials of the coefficients of ramps.
    """
    sensitivities: list[Sensitivity] = []
    for model in result.models:
        if model.form in forms.ON_LEVELS:
            rest_figures = {f.name: f.value for f in result.figures if f.name in AT_REST}
            sensitivities += _of_levels(result.stage, model, rest_figures)
        elif model.form in forms.FORMS:
            sensitivities += _of_terms(result.stage, model)
        # terms of rates, and lags, are in proportion to the logged time, but lags that are given
        timed = {
            f"{result.stage}.{model.name}.{c.name}": c.value
            for c in model.coefficients
            if c.name in TIMED and c.value and model.form in forms.FORMS
        }
        if timed:
            sensitivities.append(Sensitivity("time_s", "scale", timed))
    return tuple(sensitivities)


def _of_terms(stage: str, model: Model) -> list[Sensitivity]:
    """Sensitivities to an offset, a scale and a span of the abscissa, and to an offset and a scale
    of the channel's own indication.
    """
    abscissa, (low, high) = next(iter(model.valid.items()))
    middle, half = (high + low) / 2.0, (high - low) / 2.0 or 1.0
    value = {c.name: c.value for c in model.coefficients if c.name not in LAGS}
    offset, scale = dict.fromkeys(value, 0.0), {}
    for name, c in value.items():
        power = int(name[1:]) if name[1:].isdigit() else DEGREE.get(name, 1)
        scale[name] = -power * c
        if name == "s_temp_rate":
            # c (T − δ) Ṫ = c T Ṫ − c δ Ṫ
            offset["s_rate"] = -c
        elif name[1:].isdigit() and power:
            offset[f"{name[0]}{power - 1}"] = -power * c
    # a scale error about the middle of the range, by its size at the ends
    span = {name: (scale[name] - middle * offset[name]) / half for name in value}
    constant = next(iter(value))
    errors: tuple[tuple[str, Kind, dict[str, float]], ...] = (
        (abscissa, "offset", offset),
        (abscissa, "scale", scale),
        (abscissa, "span", span),
        (model.name, "offset", {constant: 1.0}),
        (model.name, "scale", value),
    )
    return [
        Sensitivity(
            column, kind, {f"{stage}.{model.name}.{n}": d for n, d in derivatives.items() if d}
        )
        for column, kind, derivatives in errors
    ]


def find_of_ramps(fitted: Sequence[FittedRamp], spec: Drift) -> tuple[Sensitivity, ...]:
    """Sensitivities of a0, a1 and a2 of every ramp to errors of both thermometers, by fits of the
    same intervals, and to the scale of the indication.
    """
    if not fitted:
        return ()
    ramps = [item.log.denoised.between(item.ramp.start, item.ramp.stop) for item in fitted]
    case = np.concatenate([ramp.case for ramp in ramps])
    env = np.concatenate([ramp.case - ramp.gradient for ramp in ramps])

    def refit(error: InputError) -> tuple[StageResult]:
        models = []
        for item, ramp in zip(fitted, ramps, strict=True):
            logged = {CASE: ramp.case, ENV: ramp.case - ramp.gradient, GYRO: ramp.indication}
            if error.input in logged:
                logged[error.input] = error.shift(logged[error.input])
            gradient = logged[CASE] - logged[ENV]
            shifted = ramp._replace(gradient=gradient, indication=logged[GYRO])
            # the last three columns are a0, a1, a2; those before are the constants of the line
            line, _ = shifted.fit_line(estimate=spec.estimate)
            fit = replace(item.fit, coefficients=line.coefficients[-3:])
            models.append(forms.write_ramp(item.ramp.name, fit, spec.interval_s))
        return (StageResult("drift", models=tuple(models)),)

    errors = (
        *of_thermometer(CASE, case.min(), case.max()),
        *of_thermometer(ENV, env.min(), env.max()),
        InputError(GYRO, "scale", SHARE),
    )
    return differentiate(errors, refit(InputError("", "offset", 0.0)), refit)


def _of_levels(stage: str, model: Model, rest_figures: Mapping[str, float]) -> list[Sensitivity]:
    """Sensitivities of one model on levels, and of the rates at `rest`.

    At rest a thermometer that is off by δT gives the drift of T at T + δT: coefficients c change by
    δc with design(T) δc = −∂f/∂T · δT. For δT that is constant, or proportional to T, f is a
    polynomial of the same order, and δc is exact.
    """
    low, high = model.valid[CASE]
    case = np.linspace(low, high, POINTS)
    inputs = {CASE: case, RATE: np.zeros(POINTS)}
    slope = forms.slope_over_case(model, inputs)
    # −1 and 1 at the ends: a span error is off there by its size and not in the middle
    mapped_case = (2.0 * case - high - low) / ((high - low) or 1.0)
    design = forms.ON_LEVELS[model.form].gradient(model, inputs)
    at_rest = [
        k
        for k, c in enumerate(model.coefficients)
        if design[:, k].any() and (c.value or c.standard_uncertainty)
    ]
    # offset and span of the thermometer, offset of the indication
    right_sides = np.column_stack([-slope, -slope * mapped_case, np.ones(POINTS)])
    solved = np.linalg.lstsq(design[:, at_rest], right_sides, rcond=None)[0]
    names = [f"{stage}.{model.name}.{model.coefficients[k].name}" for k in at_rest]
    offset, span, level = (dict(zip(names, column.tolist(), strict=True)) for column in solved.T)
    by_rate = {f"{stage}.{name}": 1.0 for name in rest_figures}
    # all but the lags are proportional to the indication
    proportional = {
        f"{stage}.{model.name}.{c.name}": c.value
        for c in model.coefficients
        if c.value and not c.unit.startswith("s")
    }
    proportional |= {f"{stage}.{name}": value for name, value in rest_figures.items()}
    return [
        Sensitivity(CASE, "offset", offset),
        Sensitivity(CASE, "span", span),
        Sensitivity(GYRO, "offset", level | by_rate),
        Sensitivity(GYRO, "scale", proportional),
    ]

"""Model forms of a bias that depends on temperature, its rate and lagged temperatures, and their
conversion to and from coefficient files.

    level    bias = Σ_k c_k x_k(T, Ṫ, G, Ġ), the nine TERMS of `numeric.thermal.terms`
    lagged   the same of a coil: τ_o Ṫ_o = T − T_o, τ_i Ṫ_i = T_o − T_i, G = T_o − T_i

A lagged model is evaluated in two ways. Its form gives the bias on a steady ramp after the lags
have settled, for certificates. Along a log, `numeric.thermal.evaluate` solves the lags from sample
to sample with the model that `read_terms` returns.
"""

import math
from collections.abc import Mapping

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Component, Model, Parameter
from calibkit.fit import complex_step
from calibkit.fit.complex_step import Numbers
from calibkit.fit.unseen import unseen
from calibkit.forms import Form, Inputs
from calibkit.numeric import chunks
from calibkit.numeric.flicker import Flicker
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.noise import BlockNoise
from calibkit.numeric.thermal.terms import LAGS, TERMS, Drivers, ThermalModel, Valid
from calibkit.numeric.thermal.uncertainty import Along
from calibkit.sensitivities import Sensitivity

CASE = "temp_case_degc"
RATE = "temp_rate_degc_min"
GRADIENT = "gradient_degc"
DRIVERS = (CASE, RATE, GRADIENT, "gradient_rate_degc_min")
"""Input columns of a model, and of its fitted ranges; for a lagged model the latter refer to the
lagged temperatures.
"""
PER = (
    "",
    "/degC",
    "/degC^2",
    "/degC^3",
    "/(degC/min)",
    "/K",
    "/K^2",
    "/degC/(degC/min)",
    "/(K/min)",
)
"""What follows the unit of the bias in the units of TERMS."""
UNKNOWN_DOF = (
    "degrees of freedom of the model error: not in the file, taken as infinite; fit again to have"
    " them"
)


def drivers_at(model: Model, inputs: Mapping[str, Numbers], lags: Numbers | None = None) -> Drivers:
    """Drivers [n] of a model; where it has lags on a steady ramp, with the lags settled: those of
    the model, or others.

    Missing inputs are 0, as at rest.
    """
    zero_rate = np.zeros_like(inputs[CASE])
    lags = _values(model)[len(TERMS) :] if lags is None else lags
    if lags.size:
        return coil.settled(inputs[CASE], inputs.get(RATE, zero_rate), *lags)
    return Drivers(*(inputs.get(column, zero_rate) for column in DRIVERS))


def _values(model: Model) -> Array:
    """Coefficients [9 + lags] of a model."""
    return np.array([coefficient.value for coefficient in model.coefficients])


def _bias(model: Model, inputs: Mapping[str, Numbers], values: Numbers) -> Numbers:
    """Bias [n] by coefficients and lags [9 + lags]."""
    terms, lags = values[: len(TERMS)], values[len(TERMS) :]
    return drivers_at(model, inputs, lags).raw_design() @ terms


def _differentiate(model: Model, inputs: Inputs) -> Array:
    """Derivatives [n, 9 + lags] of the bias by the coefficients and by the lags [1/s]."""
    return complex_step.derivative(lambda values: _bias(model, inputs, values), _values(model))


def sum_of_terms(name: str) -> Form:
    """Form of a level or lagged model."""
    return Form(
        name,
        _differentiate,
        lambda model, inputs: _bias(model, inputs, _values(model)),
        meaning=("interval",),
        further=lambda model, inputs: np.full(inputs[CASE].size, model_error(model)[0]),
    )


def model_error(model: Model) -> tuple[float, float]:
    """Model error on what was left out of the fit, in the unit of the bias, and its degrees of
    freedom; 0 if none is stated.
    """
    values_by_name = {parameter.name: parameter.value for parameter in model.parameters}
    return values_by_name.get("model_error", 0.0), values_by_name.get("model_error_dof", math.inf)


def list_time_errors(stage: str, model: Model) -> tuple[Sensitivity, ...]:
    """Sensitivity of a model on levels to the scale of the time base: terms of rates, and lags, are
    in proportion to the logged time. None of a model whose lags are given.
    """
    timed = {"s_rate", "s_temp_rate", "s_grad_rate", *LAGS}
    derivatives = {
        f"{stage}.{model.name}.{coefficient.name}": coefficient.value
        for coefficient in model.coefficients
        if coefficient.name in timed and coefficient.value
    }
    return (Sensitivity("time_s", "scale", derivatives),) if derivatives else ()


def slope_over_case(model: Model, inputs: Inputs) -> Array:
    """Derivative [n, 1/°C] of the bias by case temperature."""
    warmer = {**inputs, CASE: inputs[CASE] + 1j * complex_step.STEP}
    return np.imag(_bias(model, warmer, _values(model))) / complex_step.STEP


def list_errors(
    noise: BlockNoise, model_error: float, model_error_dof: float, interval_s: float, unit: str
) -> list[Parameter]:
    """Parameters that every model has: interval, noise and model error, in the unit of the bias."""
    return [
        Parameter("interval", interval_s, "s"),
        Parameter("white_variance", noise.white_variance, f"({unit})^2"),
        Parameter("flicker", noise.flicker, unit),
        Parameter("model_error", model_error, unit),
        Parameter("model_error_dof", model_error_dof, "1"),
    ]


def write_terms(
    form: Form,
    name: str,
    model: ThermalModel,
    interval_s: float,
    unit: str,
    *,
    components: tuple[Component, ...] = (),
    extra_parameters: tuple[Parameter, ...] = (),
) -> Model:
    """Model for the coefficient file, in the unit of the bias; terms that were not fitted are 0."""
    terms = [
        (term, value, f"{unit}{per}")
        for term, value, per in zip(TERMS, model.coefficients.tolist(), PER, strict=True)
    ]
    lags = [(lag, value, "s") for lag, value in zip(LAGS, model.lags, strict=False)]
    parameters = list_errors(
        model.noise, model.model_error, model.model_error_dof, interval_s, unit
    )
    if model.form == "level":
        parameters.append(Parameter("window", model.window_s, "s"))
    return form.write(
        name,
        [*terms, *lags],
        model.covariance,
        dof=model.dof,
        residual_rms=model.residual_rms,
        residual_unit=unit,
        valid=dict(zip(DRIVERS, model.valid, strict=True)),
        parameters=(*parameters, *extra_parameters),
        effective_dof=np.array([model.constant_dof, *[model.dof] * (len(terms) + len(lags) - 1)])
        if model.constant_dof < model.dof
        else None,
        components=components,
    )


def read_terms(model: Model) -> ThermalModel:
    """Level or lagged model: the inverse of `write_terms`, without the turn-on biases.

    Older files do not state the degrees of freedom of the model error: these are then infinite, and
    flagged.
    """
    lags = LAGS[: len(model.coefficients) - len(TERMS)]
    dof_is_stated = any(parameter.name == "model_error_dof" for parameter in model.parameters)
    return ThermalModel(
        form="lagged" if lags else "level",
        terms=tuple(
            c.name
            for c in model.coefficients
            if c.name in TERMS and (c.standard_uncertainty > 0.0 or c.value != 0.0)
        ),
        coefficients=np.array([model.value(name) for name in TERMS]),
        lags=tuple(model.value(name) for name in lags),
        covariance=np.array(model.covariance),
        window_s=0.0 if lags else model.value("window"),
        valid=Valid(*(model.valid[column] for column in DRIVERS)),
        turn_on=np.zeros(0),
        turn_on_variance=0.0,
        constant_dof=float(model.dof_of(model.coefficients[0])),
        dof=model.dof,
        residual_rms=model.residual_rms,
        noise=BlockNoise(model.value("white_variance"), model.value("flicker")),
        model_error=model.value("model_error"),
        model_error_dof=model.value("model_error_dof") if dof_is_stated else math.inf,
        entangled=(),
        flags=() if dof_is_stated else (UNKNOWN_DOF,),
    )


def compare_means(
    residual: Array, bias_uncertainty: Along, noise: BlockNoise, group: int
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
    of_noise = noise.white_variance / group + noise.flicker**2 * flicker
    limit, limit_about_mean = (
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

"""Model forms of biases over temperature, and their conversion to and from coefficient files.

    polynomial/1                             Σ_k p_k x^k of any abscissa (`calibkit.records.forms`)
    bias-level/1, fog-drift-level/1          Σ_k c_k x_k(T, Ṫ, G, Ġ), the nine TERMS of `terms`
    bias-lagged/1, fog-drift-lagged/1        the same of a coil: τ_o Ṫ_o = T − T_o,
                                             τ_i Ṫ_i = T_o − T_i, G = T_o − T_i
    fog-drift-bank/1                         bias through a bank of lags (`numeric.bank`)
    fog-drift-gradient/1, fog-drift-rate/1   increment per interval, Σ_j a_j G^j (`published`)

A lagged model or a bank is evaluated in two ways. Its form gives the bias on a steady ramp after
the lags have settled, for certificates. Along a log, for `apply`, `bank.evaluate` solves the lags
from sample to sample with the model that `read_thermal` returns.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibkit.fit.complex_step import STEP, Numbers
from calibkit.instruments.bias.numeric import published
from calibkit.instruments.bias.numeric.bank import (
    SCALE_DEGC,
    STATIC_LAGS,
    Bank,
    BankModel,
    OnLevels,
)
from calibkit.numeric.arrays import Array
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.pooled_fit import BlockNoise
from calibkit.numeric.thermal.terms import (
    CASE,
    DRIVERS,
    GRADIENT,
    LAGS,
    RATE,
    TERMS,
    Drivers,
    ThermalModel,
    Valid,
)
from calibkit.records.coefficients import Component, Model, Parameter
from calibkit.records.forms import POLYNOMIAL, Form, Inputs, power_unit

POLYNOMIALS, THERMAL, FILE = "bias.json", "thermal.json", "drift_rate.json"
"""Coefficient files: of polynomials, of terms, of the exported drift term of a gyro."""
CASE_RANGE = ("case_lowest", "case_highest")
"""Parameters: range of the thermometer in the fitted logs [°C]; what follows it by lags went less
far.
"""
SETTLES = "settles_within"
"""Parameter: time since power-on [s] of a warm-up that the model does not hold; none if it has
none.
"""
GRADIENT_UNITS = ("deg/h", "deg/h/K", "deg/h/K^2")
"""Units of a0, a1 and a2, per model interval."""
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


# The published scheme: increments per interval


def rate_names(order: int) -> list[list[str]]:
    """Names c_jm of the coefficients of a_j, j = 0 … 2, over powers m = 0 … order of the rate."""
    return [[f"c{j}{m}" for m in range(order + 1)] for j in range(3)]


def _rate_products(model: Model, inputs: Inputs) -> Array:
    """Products G^j r^m [n, 3 (M + 1)] of gradient [K] and temperature rate [°C/min]; of one ramp,
    M = 0, the powers of the gradient.
    """
    powers = len(model.coefficients) // 3
    rate = inputs[RATE] if powers > 1 else np.ones_like(inputs[GRADIENT])
    by_rate = np.vander(rate, powers, increasing=True)
    by_gradient = np.vander(inputs[GRADIENT], 3, increasing=True)
    return (by_gradient[:, :, None] * by_rate[:, None, :]).reshape(len(by_rate), -1)


PER_RAMP = Form(
    "fog-drift-gradient/1",
    _rate_products,
    meaning=("interval",),
    measured={"rate": 0.05},
    per_log=True,
)
"""Drift increment per model interval of one ramp: a0 + a1 G + a2 G²."""
OVER_RATES = Form("fog-drift-rate/1", _rate_products, meaning=("interval",))
"""Drift increment per model interval of one side: a0 + a1 G + a2 G² with a_j(r) = Σ_m c_jm r^m."""


def write_ramp(name: str, fit: published.RampFit, interval_s: float) -> Model:
    """Model of one ramp for the coefficient file."""
    return PER_RAMP.write(
        name,
        list(zip(published.TERMS, fit.coefficients.tolist(), GRADIENT_UNITS, strict=True)),
        fit.covariance,
        dof=fit.dof,
        residual_rms=fit.residual_rms,
        residual_unit="deg/h",
        valid={CASE: fit.case, GRADIENT: fit.gradient, RATE: (fit.rate, fit.rate)},
        parameters=(
            Parameter("interval", interval_s, "s"),
            Parameter("rate", fit.rate, "degC/min"),
        ),
    )


def write_rates(polynomial: published.RatePolynomial, interval_s: float) -> Model:
    """Model of the polynomials of one side for the coefficient file, named by the side."""
    coefficients = []
    names = rate_names(polynomial.order)
    for j, unit in enumerate(GRADIENT_UNITS):
        for m, value in enumerate(polynomial.c[j].tolist()):
            coefficients.append((names[j][m], value, power_unit(unit, "degC/min", m)))
    return OVER_RATES.write(
        polynomial.side,
        coefficients,
        polynomial.covariance,
        dof=polynomial.dof,
        residual_rms=polynomial.residual_rms,
        residual_unit="deg/h",
        valid={RATE: polynomial.rates, GRADIENT: polynomial.gradient, CASE: polynomial.case},
        parameters=(
            Parameter("interval", interval_s, "s"),
            Parameter("order", float(polynomial.order), "1"),
            Parameter("slowest_rate", polynomial.slowest, "degC/min"),
        ),
    )


def read_rates(model: Model) -> published.RatePolynomial:
    """Polynomials of one side: the inverse of `write_rates`."""
    names = rate_names(len(model.coefficients) // 3 - 1)
    return published.RatePolynomial(
        model.name,
        np.array([[model.value(name) for name in row] for row in names]),
        np.array(model.covariance),
        model.dof,
        model.residual_rms,
        model.valid[RATE],
        model.value("slowest_rate"),
        model.valid[GRADIENT],
        model.valid[CASE],
    )


# Models on levels: the bias itself


def model_error(model: Model) -> tuple[float, float]:
    """Model error on what was left out of the fit, in the unit of the bias, and its degrees of
    freedom; 0 if none is stated.
    """
    values_by_name = {parameter.name: parameter.value for parameter in model.parameters}
    return values_by_name.get("model_error", 0.0), values_by_name.get("model_error_dof", math.inf)


def _steady(inputs: Mapping[str, Numbers]) -> tuple[Numbers, Numbers]:
    """Case temperature [n, °C] and its rate [n, °C/min]; a rate that is not given is 0."""
    return inputs[CASE], inputs.get(RATE, np.zeros_like(inputs[CASE]))


def _drivers(values: Numbers, inputs: Mapping[str, Numbers]) -> Drivers:
    """Drivers [n] of a level or lagged model of coefficients and lags [9 + lags]; where it has lags
    on a steady ramp, with the lags settled. Missing inputs are 0, as at rest.
    """
    if values.size > len(TERMS):
        return coil.settled(*_steady(inputs), *values[len(TERMS) :])
    return Drivers(*(inputs.get(column, np.zeros_like(inputs[CASE])) for column in DRIVERS))


def _sum_of_terms(_: Model, values: Numbers, inputs: Mapping[str, Numbers]) -> Numbers:
    """Bias [n] by coefficients and lags [9 + lags]."""
    return _drivers(values, inputs).raw_design() @ values[: len(TERMS)]


def _errors_of_terms(model: Model, inputs: Inputs) -> Array:
    """Standard uncertainty [n] by the model error."""
    return np.full(inputs[CASE].size, model_error(model)[0])


BIAS_LEVEL, BIAS_LAGGED, LEVEL, LAGGED = (
    replace(Form.of_equation(name, _sum_of_terms, meaning=("interval",)), further=_errors_of_terms)
    for name in ("bias-level/1", "bias-lagged/1", "fog-drift-level/1", "fog-drift-lagged/1")
)
"""Bias of a channel, and indicated rate of a gyro, as the sum of TERMS: of the case temperature and
its gradient to the air, or of temperatures that lag behind the case.
"""
_NUMBERED = {"tau": "s", "knot": "degC", "width": "degC", "warm_up": "s"}
"""Parameters of a bank that are numbered from 1, in the order of the fields of `Bank`, and their
units.
"""


def read_bank(model: Model) -> Bank:
    """Terms of a bank of lags."""
    parameters = {parameter.name: parameter.value for parameter in model.parameters}
    parts = []
    for name in _NUMBERED:
        numbered = (f"{name}_{k}" for k in range(1, len(parameters) + 1))
        parts.append(
            tuple(parameters[parameter] for parameter in numbered if parameter in parameters)
        )
    return Bank(*parts)


def _bank_rate(model: Model, inputs: Inputs) -> Array:
    """Indicated rate [n, °/h]."""
    fitted = _read_bank_model(model)
    return fitted.bank.columns(fitted.settled(*_steady(inputs))) @ fitted.coefficients


def _errors_of_bank(model: Model, inputs: Inputs) -> Array:
    """Standard uncertainty [n, °/h] by the model error and, at rest, by a hysteresis."""
    spread = np.where(_steady(inputs)[1] == 0.0, hysteresis(model), 0.0)
    return np.asarray(np.hypot(model_error(model)[0], spread / np.sqrt(3.0)))


BANK = Form(
    "fog-drift-bank/1",
    lambda model, inputs: _read_bank_model(model).columns_settled(*_steady(inputs)),
    _bank_rate,
    meaning=("interval",),
    further=_errors_of_bank,
)
"""Indicated rate through a bank of first-order lags of the case temperature."""
ON_LEVELS = {form.name: form for form in (LEVEL, LAGGED, BANK)}
FORMS = {form.name: form for form in (POLYNOMIAL, BIAS_LEVEL, BIAS_LAGGED)} | ON_LEVELS
"""Forms whose result is the bias itself."""


def hysteresis(model: Model) -> float:
    """Half the spread [°/h] of the rate at rest at one temperature by where the gyro came from."""
    return read_bank(model).hysteresis(BANK.read(model)) if model.form == BANK.name else 0.0


def coil_temperature(model: Model, inputs: Inputs) -> Array:
    """Temperature [n, °C] that a model on levels refers to, with its lags settled."""
    if model.form == BANK.name:
        return _read_bank_model(model).settled(*_steady(inputs)).temperature
    return _drivers(ON_LEVELS[model.form].read(model), inputs).temperature


def slope_over_case(model: Model, inputs: Inputs) -> Array:
    """Derivative [n, °/h/°C] of the rate of a model on levels by case temperature."""
    if model.form != BANK.name:
        warmer = {**inputs, CASE: inputs[CASE] + 1j * STEP}
        values = ON_LEVELS[model.form].read(model)
        return np.imag(_sum_of_terms(model, values, warmer)) / STEP
    fitted = _read_bank_model(model)
    drivers = fitted.settled(*_steady(inputs))
    by_layer = drivers.rates @ fitted.coefficients[fitted.bank.part("b")] / SCALE_DEGC
    return fitted.slope_settled(drivers) + by_layer


def write_thermal(
    model: OnLevels,
    interval_s: float,
    channel: str = "",
    unit: str = "deg/h",
    *,
    components: tuple[Component, ...] = (),
    extra_parameters: tuple[Parameter, ...] = (),
) -> Model:
    """Model on levels for the coefficient file, in the unit of the bias: of a channel, or the drift
    of a gyro; terms that were not fitted are 0.
    """
    parameters = [
        Parameter("interval", interval_s, "s"),
        Parameter("white_variance", model.noise.white_variance, f"({unit})^2"),
        Parameter("flicker", model.noise.flicker, unit),
        Parameter("model_error", model.model_error, unit),
        Parameter("model_error_dof", model.model_error_dof, "1"),
    ]
    if isinstance(model, BankModel):
        form, bank = BANK, model.bank
        names = [*bank.terms, *zip(STATIC_LAGS, ("s", "s", "1"), strict=True)]
        values = [*model.coefficients.tolist(), *model.static_lag]
        parameters.append(Parameter("turn_on", model.turn_on_sd, unit))
        parts = (bank.lags, bank.knots, bank.widths, bank.warm_up)
        for (name, of_part), part in zip(_NUMBERED.items(), parts, strict=True):
            for k, value in enumerate(part, start=1):
                parameters.append(Parameter(f"{name}_{k}", value, of_part))
    else:
        level, lagged = (BIAS_LEVEL, BIAS_LAGGED) if channel else (LEVEL, LAGGED)
        form = level if model.form == "level" else lagged
        names = [(term, f"{unit}{per}") for term, per in zip(TERMS, PER, strict=True)]
        names += [(lag, "s") for lag in LAGS[: len(model.lags)]]
        values = [*model.coefficients.tolist(), *model.lags]
        if model.form == "level":
            parameters.append(Parameter("window", model.window_s, "s"))
    columns = DRIVERS[:2] if isinstance(model, BankModel) else DRIVERS
    effective_dof = None
    if model.constant_dof < model.dof:
        effective_dof = np.array([model.constant_dof, *[model.dof] * (len(values) - 1)])
    return form.write(
        channel or "drift",
        [(name, value, of_name) for (name, of_name), value in zip(names, values, strict=True)],
        model.covariance,
        dof=model.dof,
        residual_rms=model.residual_rms,
        residual_unit=unit,
        valid=dict(zip(columns, model.valid, strict=False)),
        parameters=(*parameters, *extra_parameters),
        effective_dof=effective_dof,
        components=components,
    )


def _read_bank_model(model: Model) -> BankModel:
    """Bank of lags."""
    values = BANK.read(model)
    fast, slow, share = values[-len(STATIC_LAGS) :].tolist()
    return BankModel(
        bank=read_bank(model),
        coefficients=values[: -len(STATIC_LAGS)],
        static_lag=(fast, slow, share),
        covariance=np.array(model.covariance),
        valid=Valid(model.valid[CASE], model.valid[RATE], (0.0, 0.0), (0.0, 0.0)),
        turn_on=np.zeros(0),
        turn_on_sd=model.value("turn_on"),
        dof=model.dof,
        residual_rms=model.residual_rms,
        noise=BlockNoise(model.value("white_variance"), model.value("flicker")),
        model_error=model.value("model_error"),
        model_error_dof=model.value("model_error_dof"),
    )


def read_thermal(model: Model) -> OnLevels:
    """Model on levels: the inverse of `write_thermal`, without the turn-on biases of the logs.

    Older files do not state the degrees of freedom of the model error: these are then infinite, and
    flagged.
    """
    if model.form == BANK.name:
        return _read_bank_model(model)
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
        constant_dof=float(model.dof_of(model.coefficients[0])),
        dof=model.dof,
        residual_rms=model.residual_rms,
        noise=BlockNoise(model.value("white_variance"), model.value("flicker")),
        model_error=model.value("model_error"),
        model_error_dof=model.value("model_error_dof") if dof_is_stated else math.inf,
        flags=() if dof_is_stated else (UNKNOWN_DOF,),
    )

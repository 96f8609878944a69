"""Model forms of biases over temperature, and their conversion to and from coefficient files.

    polynomial/1                             Σ_k p_k x^k of any abscissa (`calibkit.forms`)
    bias-level/1, bias-lagged/1              bias of a channel as a sum of nine terms
    fog-drift-gradient/1, fog-drift-rate/1   increment per interval, Σ_j a_j G^j (`published`)
    fog-drift-level/1, fog-drift-lagged/1    rate as a sum of nine terms (`thermal_forms`)
    fog-drift-bank/1                         rate through a bank of lags (`numeric.bank`)

A lagged model or a bank is evaluated in two ways. Its form gives the drift on a steady ramp after
the lags have settled, for certificates. Along a log, for `apply`, `bank.evaluate` solves the
lags from sample to sample with the model that `read_thermal` returns.
"""

import numpy as np

from calibkit import thermal_forms
from calibkit.arrays import Array
from calibkit.coefficients import Model, Parameter
from calibkit.forms import POLYNOMIAL, Form, Inputs, power_unit
from calibkit.instruments.bias.numeric import published
from calibkit.instruments.bias.numeric.bank import (
    SCALE_DEGC,
    STATIC_LAGS,
    Bank,
    BankModel,
    OnLevels,
)
from calibkit.numeric.thermal.noise import BlockNoise
from calibkit.numeric.thermal.terms import Valid
from calibkit.thermal_forms import CASE, GRADIENT, RATE, drivers_at

POLYNOMIALS, THERMAL = "bias.json", "thermal.json"
CASE_RANGE = ("case_lowest", "case_highest")
"""Parameters: range of the thermometer in the fitted logs [°C]; what follows it by lags went less
far.
"""
BIAS_LEVEL = thermal_forms.sum_of_terms("bias-level/1")
"""Bias as the sum of terms of the case temperature and its rate."""
BIAS_LAGGED = thermal_forms.sum_of_terms("bias-lagged/1")
"""Bias as the sum of terms of temperatures that lag behind the case."""
FILE = "drift_rate.json"
"""Coefficient file of the exported drift term."""
GRADIENT_UNITS = ("deg/h", "deg/h/K", "deg/h/K^2")
"""Units of a0, a1 and a2, per model interval."""


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
LEVEL = thermal_forms.sum_of_terms("fog-drift-level/1")
"""Indicated rate as the sum of TERMS of case temperature and gradient to the chamber air."""
LAGGED = thermal_forms.sum_of_terms("fog-drift-lagged/1")
"""Indicated rate as the sum of TERMS of coil temperatures that lag behind the case."""


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


def _steady(inputs: Inputs) -> tuple[Array, Array]:
    """Case temperature [n, °C] and its rate [n, °C/min]; a rate that is not given is 0."""
    return inputs[CASE], inputs.get(RATE, np.zeros_like(inputs[CASE]))


def _bank_rate(model: Model, inputs: Inputs) -> Array:
    """Indicated rate [n, °/h]."""
    fitted = _read_bank_model(model)
    return fitted.bank.columns(fitted.settled(*_steady(inputs))) @ fitted.coefficients


def _bank_extra(model: Model, inputs: Inputs) -> Array:
    """Standard uncertainty [n, °/h] by the model error and, at rest, by a hysteresis."""
    spread = np.where(_steady(inputs)[1] == 0.0, hysteresis(model), 0.0)
    return np.asarray(np.hypot(thermal_forms.model_error(model)[0], spread / np.sqrt(3.0)))


BANK = Form(
    "fog-drift-bank/1",
    lambda model, inputs: _read_bank_model(model).columns_settled(*_steady(inputs)),
    _bank_rate,
    meaning=("interval",),
    further=_bank_extra,
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
    return drivers_at(model, inputs).temperature


def slope_over_case(model: Model, inputs: Inputs) -> Array:
    """Derivative [n, °/h/°C] of the rate of a model on levels by case temperature."""
    if model.form != BANK.name:
        return thermal_forms.slope_over_case(model, inputs)
    fitted = _read_bank_model(model)
    drivers = fitted.settled(*_steady(inputs))
    by_layer = drivers.rates @ fitted.coefficients[fitted.bank.part("b")] / SCALE_DEGC
    return fitted.slope_settled(drivers) + by_layer


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


def write_thermal(model: OnLevels, interval_s: float) -> Model:
    """Level, lagged or bank model for the coefficient file; terms that were not fitted are 0."""
    if isinstance(model, BankModel):
        return _write_bank(model, interval_s)
    form = LEVEL if model.form == "level" else LAGGED
    return thermal_forms.write_terms(form, "drift", model, interval_s, "deg/h")


def _write_bank(model: BankModel, interval_s: float) -> Model:
    """Bank of lags for the coefficient file."""
    bank = model.bank
    parts = (bank.lags, bank.knots, bank.widths, bank.warm_up)
    numbered = []
    for (name, unit), part in zip(_NUMBERED.items(), parts, strict=True):
        numbered += [Parameter(f"{name}_{k}", value, unit) for k, value in enumerate(part, start=1)]
    coefficients = [
        (name, value, unit)
        for (name, unit), value in zip(bank.terms, model.coefficients.tolist(), strict=True)
    ]
    return BANK.write(
        "drift",
        [*coefficients, *zip(STATIC_LAGS, model.static_lag, ("s", "s", "1"), strict=True)],
        model.covariance,
        dof=model.dof,
        residual_rms=model.residual_rms,
        residual_unit="deg/h",
        valid={CASE: model.valid.temperature, RATE: model.valid.rate},
        parameters=(
            *thermal_forms.list_errors(
                model.noise, model.model_error, model.model_error_dof, interval_s, "deg/h"
            ),
            Parameter("turn_on", model.turn_on_sd, "deg/h"),
            *numbered,
        ),
    )


def _read_bank_model(model: Model) -> BankModel:
    """Bank of lags: the inverse of `_write_bank`, without the turn-on biases of the logs."""
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
    """Level, lagged or bank model: the inverse of `write_thermal`, without the turn-on biases of
    the logs.
    """
    if model.form == BANK.name:
        return _read_bank_model(model)
    return thermal_forms.read_terms(model)

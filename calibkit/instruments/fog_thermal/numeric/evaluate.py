"""Drift along a log by a fitted level, lagged or bank model, its sensitivities, and the rows where
a driver was clamped.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.instruments.fog_thermal.numeric import bank, coil, level
from calibkit.instruments.fog_thermal.numeric.bank import BankModel, OnLevels
from calibkit.instruments.fog_thermal.numeric.terms import Drivers, ThermalModel

REFERENCE_DEGC = 25.0
ONE_SIDED = 0.1
"""Share of the largest fitted rate below which a direction counts as not measured."""
RELATIVE_STEP = 1e-3
"""Relative change of a lag for the numerical derivative of the drift."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Drift [n, °/h] along a log, its derivatives, and masks [n] of drivers outside their fitted
    ranges.
    """

    drift: Array
    sensitivities: Array
    """[n, p], derivative of the drift by each coefficient and each lag, as in the covariance."""
    beyond: Array
    """[n, °/h], drift without clamping less drift with clamping."""
    temperature_clamped: Mask
    rate_clamped: Mask
    gradient_clamped: Mask
    unmeasured: Mask
    """The temperature goes in a direction in which none was fitted."""


def _drivers(model: ThermalModel, time: Array, case: Array, env: Array) -> Drivers:
    """Drivers [n] of a log by the model's form; a coil starts at the first case temperature."""
    if model.form == "level":
        return level.drivers(time, case, env, model.window_s)
    return coil.path([(time, case)]).drivers(
        model.lags[0], model.lags[1] if len(model.lags) > 1 else None
    )


def evaluate(
    model: OnLevels,
    time: Array,
    case: Array,
    env: Array,
    reference_degc: float = REFERENCE_DEGC,
) -> Evaluation:
    """Drift along a log, zero at rest (no rate, no gradient) at the reference temperature.

    Parameters
    ----------
    model : a fitted model.
    time, case, env : [n, s], [n, °C], [n, °C], strictly increasing, of any sampling; env does not
        enter a lagged model.
    reference_degc : clamped to the fitted range.

    Notes
    -----
    The drift is causal: only samples up to an instant enter. Outside the fitted ranges of
    temperature, rate and gradient, drivers are clamped and flagged. Lags start in equilibrium at
    the first sample: if the temperature already changes there, the drift is wrong until this
    transient has decayed. The equations of the lags are solved exactly at any sampling; the rates
    of a level model need at least four samples in their window.

    """
    if isinstance(model, BankModel):
        return _evaluate_bank(model, time, case, reference_degc)
    found = _drivers(model, time, case, env)
    inside = _clamp(found, model)
    rest = _design_at_rest(model, reference_degc)
    rows = inside.raw_design() - rest
    by_lag = [_by_lag(model, k, found, inside, (time, case, env)) for k in range(len(model.lags))]
    temperature, rate, gradient, gradient_rate = (
        np.asarray(values != held) for values, held in zip(found, inside, strict=True)
    )
    return Evaluation(
        rows @ model.coefficients,
        np.column_stack([rows, *by_lag]),
        (found.raw_design() - rest - rows) @ model.coefficients,
        temperature,
        rate | gradient_rate,
        gradient,
        _unmeasured(model, found.rate),
    )


def _unmeasured(model: OnLevels, rate: Array) -> Mask:
    """Whether rates [n, °C/min] go in a direction in which no ramp was fitted."""
    low, high = model.valid.rate
    slack = ONE_SIDED * max(-low, high)
    return np.asarray(
        ((rate < -slack) & (low > -2.0 * slack)) | ((rate > slack) & (high < 2.0 * slack))
    )


def _evaluate_bank(model: BankModel, time: Array, case: Array, reference_degc: float) -> Evaluation:
    """Evaluation of a bank model, whose temperature and lagged rates are clamped to the fitted
    ranges, rates to the largest fitted magnitude on either side.
    """
    logs, along = [(time, case)], coil.path([(time, case)])
    lag = np.array([*np.log(model.static_lag[:2]), model.static_lag[2]])
    temperature = bank.static_temperature(along, lag)
    rates = bank.lagged_rates(model.bank, along)
    free = bank.log_drivers(model.bank, logs, temperature, rates)
    largest = max(map(abs, model.valid.rate))
    inside = replace(
        free,
        temperature=np.clip(temperature, *model.valid.temperature),
        rates=np.clip(rates, -largest, largest),
    )
    rest = at_rest(model, reference_degc)[1][: model.coefficients.size]
    rows = model.bank.columns(inside) - rest
    slope = np.where(
        inside.temperature == temperature, model.bank.slope(model.coefficients, inside), 0.0
    )
    by_lag = bank.static_derivatives(along, lag, temperature) * slope[:, None]
    by_lag[:, :2] /= model.static_lag[:2]
    return Evaluation(
        rows @ model.coefficients,
        np.column_stack([rows, by_lag]),
        (model.bank.columns(free) - rest - rows) @ model.coefficients,
        np.asarray(inside.temperature != temperature),
        np.any(inside.rates != rates, axis=1),
        np.zeros(time.size, dtype=bool),
        _unmeasured(model, rates[:, 0]),
    )


def at_rest(model: OnLevels, temperature: float) -> tuple[float, Array]:
    """Indicated rate at rest [°/h] (no rate, no gradient, long after switch-on) at a temperature
    [°C], clamped to the fitted range, and its derivatives [p] as in the covariance.
    """
    if isinstance(model, BankModel):
        still = np.array([model.nearest_fitted(temperature)])
        row = model.bank.columns(
            bank.BankDrivers(
                still,
                *(
                    np.zeros((1, len(part)))
                    for part in (model.bank.lags, model.bank.widths, model.bank.warm_up)
                ),
            )
        )[0]
    else:
        row = _design_at_rest(model, temperature)[0]
    rate = float(row @ model.coefficients)
    return rate, np.pad(row, (0, model.covariance.shape[0] - row.size))


def _clamp(drivers: Drivers, model: ThermalModel) -> Drivers:
    """Drivers [n] clamped to the fitted ranges; a driver that no term of the model uses is not
    clamped.
    """
    terms = set(model.terms)
    used = (
        len(terms) > 1,
        not terms.isdisjoint({"s_rate", "s_temp_rate"}),
        "s_grad" in terms,
        "s_grad_rate" in terms,
    )
    return Drivers(
        *(
            np.clip(values, *span) if enters else values
            for values, span, enters in zip(drivers, model.valid, used, strict=True)
        )
    )


def _design_at_rest(model: ThermalModel, reference_degc: float) -> Array:
    """Design row [1, 9] at rest (no rate, no gradient) at the reference temperature, clamped to the
    fitted range.
    """
    still = np.zeros(1)
    return Drivers(
        np.array([model.nearest_fitted(reference_degc)]), still, still, still
    ).raw_design()


def _by_lag(
    model: ThermalModel, k: int, found: Drivers, inside: Drivers, log: tuple[Array, Array, Array]
) -> Array:
    """Derivative [n, °/h/s] of the drift by the k-th lag; a clamped driver is taken as constant."""
    step = model.lags[k] * RELATIVE_STEP
    moved = _drivers(
        replace(model, lags=tuple(lag + step * (j == k) for j, lag in enumerate(model.lags))), *log
    )
    held = Drivers(
        *(
            np.where(values == limited, after, limited)
            for values, limited, after in zip(found, inside, moved, strict=True)
        )
    )
    return np.asarray(
        (held.raw_design() - inside.raw_design()) @ model.coefficients / step, dtype=np.float64
    )

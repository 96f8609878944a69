"""Drift along a log by a fitted level, lagged or bank model, its sensitivities, and the rows where
a driver was clamped.

    D = [x(t) − x(T_ref, at rest)] c

x are the columns of the model (`thermal.terms`, `bank`), of drivers clamped to their fitted ranges.
"""

from dataclasses import replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.numeric import bank
from calibkit.instruments.fog_thermal.numeric.bank import BankModel, OnLevels
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.evaluate import (
    Evaluation,
    design_at_rest,
    evaluate_terms,
    in_unmeasured_direction,
)

REFERENCE_DEGC = 25.0


def evaluate(
    model: OnLevels,
    time: Array,
    case: Array,
    env: Array,
    reference_degc: float = REFERENCE_DEGC,
    *,
    long_at_rest: bool = False,
) -> Evaluation:
    """Drift along a log, zero at rest (no rate, no gradient) at the reference temperature.

    Parameters
    ----------
    model : a fitted model.
    time, case, env : [n, s], [n, °C], [n, °C], strictly increasing, of any sampling; env does not
        enter a lagged model.
    reference_degc : clamped to the fitted range.
    long_at_rest : the log is at rest long after switch-on, in the middle of a hysteresis.

    Notes
    -----
    The drift is causal: only samples up to an instant enter. Outside the fitted ranges of
    temperature, rate and gradient, drivers are clamped and flagged. Lags start in equilibrium at
    the first sample: if the temperature already changes there, the drift is wrong until this
    transient has decayed. The equations of the lags are solved exactly at any sampling; the rates
    of a level model need at least four samples in their window.

    """
    if not isinstance(model, BankModel):
        return evaluate_terms(model, time, case, env, reference_degc)
    case = np.clip(case, *coil.followed_range(*model.valid.temperature))
    logs, case_path = [(time, case)], coil.path([(time, case)])
    lag = np.array([*np.log(model.static_lag[:2]), model.static_lag[2]])
    temperature = bank.static_temperature(case_path, lag)
    lagged, rates = bank.follow_lags(model.bank, case_path)
    free = bank.log_drivers(model.bank, logs, temperature, (lagged, rates))
    if long_at_rest:
        free = replace(free, play=0.0 * free.play, faded=0.0 * free.faded)
    # rates are clamped to the largest fitted magnitude on either side
    largest = max(map(abs, model.valid.rate))
    inside = replace(
        free,
        temperature=np.clip(temperature, *model.valid.temperature),
        lagged=np.clip(lagged, *model.valid.temperature),
        rates=np.clip(rates, -largest, largest),
    )
    clamped = np.asarray(inside.temperature != temperature)
    rest_row = at_rest(model, reference_degc)[1][: model.coefficients.size]
    columns = model.bank.columns(inside) - rest_row
    slope = np.where(clamped, 0.0, model.bank.slope(model.coefficients, inside))
    by_lag = bank.static_derivatives(case_path, lag, temperature) * slope[:, None]
    by_lag[:, :2] /= model.static_lag[:2]
    return Evaluation(
        columns @ model.coefficients,
        np.column_stack([columns, by_lag]),
        (model.bank.columns(free) - rest_row - columns) @ model.coefficients,
        clamped,
        np.any(inside.rates != rates, axis=1),
        np.zeros(time.size, dtype=bool),
        in_unmeasured_direction(model.valid, rates[:, 0]),
        model.bank.unknown_start(temperature, model.coefficients),
    )


def at_rest(model: OnLevels, temperature: float) -> tuple[float, Array]:
    """Indicated rate at rest [°/h] (no rate, no gradient, long after switch-on) at a temperature
    [°C], clamped to the fitted range, and its derivatives [p] as in the covariance.
    """
    if isinstance(model, BankModel):
        case = np.array([model.nearest_fitted(temperature)])
        row = model.columns_settled(case, np.zeros(1))[0]
    else:
        row = np.zeros(model.covariance.shape[0])
        row[: model.coefficients.size] = design_at_rest(model, temperature)[0]
    return float(row[: model.coefficients.size] @ model.coefficients), row

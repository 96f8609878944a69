"""Bias along a log by a fitted level or lagged model, its sensitivities, and the rows where a
driver was clamped.

    drift = [x(T, Ṫ, ΔT, ΔṪ) − x(T_ref, 0, 0, 0)] c

x are the nine columns of `terms`, of drivers clamped to their fitted ranges. Drivers of a level
model are those of the log, of a lagged model those of a coil that follows the case by its lags.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.numeric.thermal.terms import Drivers, ThermalModel, Valid

ONE_SIDED = 0.1
"""Share of the largest fitted rate from which on a log goes in a direction. A direction whose
fastest fitted rate is less than twice as large was not measured.
"""
RELATIVE_STEP = 1e-3
"""Relative change of a lag for the numerical derivative of the drift."""
REACH = 1.0 / 3.0
"""Share of a fitted range by which a model is carried beyond each of its ends; further out it is
held. On left-out quarters of simulated sweeps that go 30 % further than the rest, its error is then
that of the true model; held at the ends it is several times that.
"""
Spans = Sequence[tuple[int, float]]
"""First rows of spans across which lags are not carried, with the rate [°C/min] before each."""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Drift [n, °/h] along a log, its derivatives, and masks [n] of drivers outside their fitted
    ranges.
    """

    drift: Array
    sensitivities: Array
    """[n, p], derivative of the drift by each coefficient and each lag, as in the covariance."""
    extrapolated_drift: Array
    """[n, °/h], drift without clamping less drift with clamping."""
    temperature_clamped: Mask
    rate_clamped: Mask
    gradient_clamped: Mask
    unmeasured: Mask
    """The temperature goes in a direction in which none was fitted."""
    unknown_start: Array | float = 0.0
    """[n, °/h], half the spread of the drift by what was before the log and is not known."""

    def about_mean(self) -> "Evaluation":
        """The same for the drift less its mean along the log: what is common to all instants of a
        log is no error there.
        """
        return replace(self, sensitivities=self.sensitivities - self.sensitivities.mean(axis=0))


def _drivers(
    model: ThermalModel, time: Array, case: Array, env: Array, spans: Spans = ()
) -> Drivers:
    """Drivers [n] of a log by the model's form; a coil starts at the first case temperature."""
    if model.form == "level":
        return coil.level_drivers(time, case, env, model.window_s)
    return coil.path_of_spans([(time, case, spans)]).drivers(
        model.lags[0], model.lags[1] if len(model.lags) > 1 else None
    )


def evaluate_terms(
    model: ThermalModel,
    time: Array,
    case: Array,
    env: Array,
    reference_degc: float,
    spans: Spans = (),
) -> Evaluation:
    """Drift along a log of times [n, s], case and chamber temperatures [n, °C], zero at rest at the
    reference temperature.

    It is causal: only samples up to an instant enter. Drivers outside the fitted ranges are clamped
    and flagged. Lags start in equilibrium at the first sample, or in a log of spans as these state;
    env does not enter a lagged model. The case is followed within `coil.followed_range`.
    """
    case = np.clip(case, *coil.followed_range(*model.valid.temperature))
    log_drivers = _drivers(model, time, case, env, spans)
    # a driver that no term of the model uses is not clamped
    terms = set(model.terms)
    used = (
        len(terms) > 1,
        not terms.isdisjoint({"s_rate", "s_temp_rate"}),
        "s_grad" in terms,
        "s_grad_rate" in terms,
    )
    clamped = Drivers(
        *(
            np.clip(values, *span) if enters else values
            for values, span, enters in zip(log_drivers, model.valid, used, strict=True)
        )
    )
    rest_row = design_at_rest(model, reference_degc)
    rows = clamped.raw_design() - rest_row
    by_lag = [
        _by_lag(model, k, log_drivers, clamped, (time, case, env, spans))
        for k in range(len(model.lags))
    ]
    temperature, rate, gradient, gradient_rate = (
        np.asarray(values != clamped_values)
        for values, clamped_values in zip(log_drivers, clamped, strict=True)
    )
    return Evaluation(
        rows @ model.coefficients,
        np.column_stack([rows, *by_lag]),
        (log_drivers.raw_design() - rest_row - rows) @ model.coefficients,
        temperature,
        rate | gradient_rate,
        gradient,
        in_unmeasured_direction(model.valid, log_drivers.rate),
    )


def evaluate_wide(model: ThermalModel, log: ThermalLog, reference_degc: float) -> Evaluation:
    """Bias along blocks, carried beyond the fitted ranges by REACH; it is zero at rest at the
    reference temperature, which is clamped to the fitted range.
    """
    wide = Valid(
        *((low - REACH * (high - low), high + REACH * (high - low)) for low, high in model.valid)
    )
    reference = model.nearest_fitted(reference_degc)
    clamped = evaluate_terms(model, log.time, log.case, log.env, reference, log.starts)
    carried = evaluate_terms(
        replace(model, valid=wide), log.time, log.case, log.env, reference, log.starts
    )
    # what the terms add beyond the fitted ranges, which enters the uncertainty; -0 is 0
    extrapolated_drift = carried.drift + carried.extrapolated_drift - clamped.drift + 0.0
    return replace(
        clamped,
        drift=carried.drift,
        sensitivities=carried.sensitivities,
        extrapolated_drift=extrapolated_drift,
    )


def in_unmeasured_direction(valid: Valid, rate: Array) -> Mask:
    """Whether rates [n, °C/min] go in a direction in which none was fitted."""
    low, high = valid.rate
    slack = ONE_SIDED * max(-low, high)
    return np.asarray(
        ((rate < -slack) & (low > -2.0 * slack)) | ((rate > slack) & (high < 2.0 * slack))
    )


def design_at_rest(model: ThermalModel, reference_degc: float) -> Array:
    """Design row [1, 9] at rest (no rate, no gradient) at the reference temperature, clamped to the
    fitted range.
    """
    zero = np.zeros(1)
    return Drivers(np.array([model.nearest_fitted(reference_degc)]), zero, zero, zero).raw_design()


def _by_lag(
    model: ThermalModel,
    k: int,
    log_drivers: Drivers,
    clamped: Drivers,
    log: tuple[Array, Array, Array, Spans],
) -> Array:
    """Derivative [n, °/h/s] of the drift by the k-th lag; a clamped driver is taken as constant."""
    step = model.lags[k] * RELATIVE_STEP
    at_longer_lag = _drivers(
        replace(model, lags=tuple(lag + step * (j == k) for j, lag in enumerate(model.lags))), *log
    )
    clamped_at_longer_lag = Drivers(
        *(
            np.where(values == limited, after, limited)
            for values, limited, after in zip(log_drivers, clamped, at_longer_lag, strict=True)
        )
    )
    return np.asarray(
        (clamped_at_longer_lag.raw_design() - clamped.raw_design()) @ model.coefficients / step,
        dtype=np.float64,
    )

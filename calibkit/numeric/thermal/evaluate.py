"""Bias along a log by a fitted model, and its uncertainty.

    drift = [x(T, Ṫ, ΔT, ΔṪ) − x(T_ref, 0, 0, 0)] c
    u² = xᵀ C x + e² + Δ²/3 + h²/3 + Σ type B

x are the nine columns of `terms`, of drivers clamped to their fitted ranges, and in u² the
derivatives of the bias by coefficients and lags; C is their covariance, e the model error on
stretches that were left out of the fit (`model_error`), Δ the change of the bias by clamping, h
half the spread by an unknown start of a hysteresis. Drivers of a level model are those of the log,
of a lagged model those of a coil that follows the case by its lags.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibkit.numeric import gum
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.flicker import Flicker
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.numeric.thermal.terms import BiasModel, Drivers, ThermalModel, Valid

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
    # beyond it a reading is a fault of the thermometer, which lags would carry on for hours
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
    # by each lag: a clamped driver is taken as constant
    by_lag = []
    for k, lag in enumerate(model.lags):
        longer = (*model.lags[:k], lag + lag * RELATIVE_STEP, *model.lags[k + 1 :])
        at_longer_lag = Drivers(
            *(
                np.where(values == limited, after, limited)
                for values, limited, after in zip(
                    log_drivers,
                    clamped,
                    _drivers(replace(model, lags=longer), time, case, env, spans),
                    strict=True,
                )
            )
        )
        change = (at_longer_lag.raw_design() - clamped.raw_design()) @ model.coefficients
        by_lag.append(change / (lag * RELATIVE_STEP))
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
    # soaks drift a little either way: that is no direction that was measured
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


NEIGHBOURING = (1, 2, 3)
"""Lags, in 100 s means, of the products of left-out errors: 100 to 300 s."""
POSTERIOR_REACH = 6.0
"""Standard errors beyond which the posterior of the model error is negligible."""
POSTERIOR_LEVELS = 2001
Contribution = tuple[str, Literal["A", "B"], Array, float]
"""Name, kind, standard uncertainties [n, °/h] along a log and degrees of freedom."""


def model_error(errors: Sequence[Array], explained: float = 0.0) -> float:
    """Model error [°/h] from the errors [m, °/h] of each left-out ramp: what persists beyond
    `explained` [(°/h)²].

    White noise cancels in the mean product of neighbouring errors; the persistent error of the
    model does not. Neither do flicker noise and the uncertainty of the coefficients, which are
    stated separately: their mean product `explained` is subtracted. The difference may be small or
    negative by chance; the model error is therefore the root mean square over its posterior for a
    flat prior, with the standard error from the scatter of the ramps.
    """
    # sums of the products of neighbouring errors of each ramp, and their numbers
    products, counts = np.zeros((2, len(errors)))
    for ramp, ramp_errors in enumerate(errors):
        for k in NEIGHBOURING:
            if k < ramp_errors.size:
                products[ramp] += float(ramp_errors[k:] @ ramp_errors[: ramp_errors.size - k])
                counts[ramp] += ramp_errors.size - k
    if counts.sum() == 0:
        return 0.0
    mean = float(products.sum() / counts.sum())
    # between ramps, as errors within one ramp go together
    scatter = float(np.sum((products - mean * counts) ** 2)) * counts.size / max(counts.size - 1, 1)
    error = float(np.sqrt(scatter)) / float(counts.sum())
    excess = mean - explained
    if error == 0.0:
        return float(np.sqrt(max(excess, 0.0)))
    levels = np.linspace(0.0, np.sqrt(max(excess, 0.0) + POSTERIOR_REACH * error), POSTERIOR_LEVELS)
    # flat prior on the model error, not on its square, which would favour large ones
    log_share = -0.5 * ((levels**2 - excess) / error) ** 2
    share = np.exp(log_share - log_share.max())
    return float(np.sqrt(share @ levels**2 / share.sum()))


def explained(
    model: BiasModel, logs: Sequence[ThermalLog], sensitivities: Sequence[Array], group: int
) -> float:
    """Mean product [(°/h)²] of neighbouring errors (means over a group of blocks) that type A
    uncertainty and flicker noise cause, with the derivatives [n, p] of the drift along each log.

    The mean of each ramp is removed, as for left-out errors.
    """
    expected_products: list[Array] = []
    for log, derivatives in zip(logs, sensitivities, strict=True):
        for _, by_lag in explain_parts(model, log, derivatives, group, of_rest=False):
            expected_products += by_lag
    products = np.concatenate(expected_products) if expected_products else np.zeros(0)
    return float(products.sum()) / max(products.size, 1)


def explain_parts(
    model: BiasModel, log: ThermalLog, sensitivities: Array, group: int, *, of_rest: bool
) -> Iterator[tuple[Integers, list[Array]]]:
    """Rows [m, group] of the means over blocks of each part of a log, and the covariances [m − k]
    of neighbouring means that type A uncertainty, with the derivatives [n, p] of the drift along
    the log, and flicker noise cause.

    They are taken about the mean of the part or, `of_rest`, about that of the rest of the log.
    """
    numbers = np.unique(log.part)
    rows = [np.flatnonzero(log.part == number) for number in numbers]
    sizes = [min(group, inside.size) for inside in rows]
    grouped = [
        inside[: inside.size // size * size].reshape(-1, size)
        for inside, size in zip(rows, sizes, strict=True)
    ]
    means = [sensitivities[inside].mean(axis=1) for inside in grouped]
    all_means, part = (
        np.concatenate(means),
        np.repeat(numbers, [len(part_means) for part_means in means]),
    )
    flicker = Flicker(len(all_means), NEIGHBOURING)
    for number, inside, s in zip(numbers, grouped, means, strict=True):
        reference = part != number if of_rest and len(numbers) > 1 else part == number
        first = int(np.argmax(part == number))
        deviations = s - all_means[reference].mean(axis=0)
        noise = flicker.about_level(first, first + len(s), of_rest=of_rest)
        covariances = []
        for k, by_flicker in zip(NEIGHBOURING, noise, strict=True):
            before = deviations[: max(len(deviations) - k, 0)]
            of_coefficients = np.einsum("ij,jk,ik->i", deviations[k:], model.covariance, before)
            covariances.append(of_coefficients + model.noise.flicker**2 * by_flicker)
        yield inside, covariances


def contributions(model: BiasModel, evaluation: Evaluation) -> list[Contribution]:
    """Independent contributions to the uncertainty of the drift along a log.

    They are: type A uncertainty of coefficients and lags, propagated (JCGM 100, 5.2.2); the model
    error on left-out ramps; where a driver was clamped, a rectangular distribution whose half
    width is the change of drift by clamping; and one of the states of a hysteresis that the past of
    the log may have left. The type A variance already is the mean over the
    posterior of the noise (`estimate_noise`), so that k = 2 covers 95 %; its degrees of freedom
    count as infinite (Kacker & Jones 2003, Metrologia 40:235).
    """
    type_a = gum.uncertainty_along(evaluation.sensitivities, model.covariance)
    missed = np.full(type_a.size, model.model_error)
    past = np.broadcast_to(evaluation.unknown_start, type_a.shape) / np.sqrt(3.0)
    terms: list[Contribution] = [
        ("coefficients", "A", type_a, np.inf),
        ("model error on ramps left out", "A", missed, model.model_error_dof),
        (
            "beyond the fitted ranges",
            "B",
            np.abs(evaluation.extrapolated_drift) / np.sqrt(3.0),
            np.inf,
        ),
    ]
    if np.any(past):
        terms.append(("hysteresis of what was before", "B", past, np.inf))
    return terms


@dataclass(frozen=True, slots=True)
class Along:
    """Bias [n] along a log, contributions to its uncertainty as those of `contributions`, the
    combined uncertainty [n], and the expanded one [n] of the bias less its mean.
    """

    drift: Array
    contributions: list[Contribution]
    standard: Array
    effective_dof: Array
    expanded: Array
    expanded_about_mean: Array


def combine_along(
    model: BiasModel, evaluation: Evaluation, type_b: Sequence[tuple[str, Array, float]]
) -> Along:
    """Uncertainty of the bias along a log: what the model states, and type B terms by name, effect
    [n] of one standard uncertainty, and degrees of freedom.
    """
    combined = []
    terms: list[Contribution] = []
    for less_mean in (True, False):
        terms = contributions(model, evaluation.about_mean() if less_mean else evaluation)
        for name, effect, dof in type_b:
            terms.append((name, "B", np.abs(effect - effect.mean() if less_mean else effect), dof))
        _, _, parts, dofs = zip(*terms, strict=True)
        combined.append(gum.expand_along(np.stack(parts), np.array(dofs)))
    (_, _, about_mean), along = combined
    return Along(evaluation.drift, terms, *along, about_mean)

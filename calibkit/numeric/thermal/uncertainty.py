"""Uncertainty of a fitted bias: its coefficients, the model's error on stretches that were left
out of the fit, and clamping.

    u² = xᵀ C x + e² + Δ²/3 + h²/3 + Σ type B

x are the derivatives of the bias by coefficients and lags, C their covariance, e the model error
(`model_error`), Δ the change of the bias by clamping, h half the spread by an unknown start of a
hysteresis.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import gum
from calibkit.numeric.flicker import Flicker
from calibkit.numeric.thermal.evaluate import Evaluation
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.numeric.thermal.terms import BiasModel

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
    products, counts = _products(errors)
    if counts.sum() == 0:
        return 0.0
    mean = float(products.sum() / counts.sum())
    scatter = float(np.sum((products - mean * counts) ** 2)) * counts.size / max(counts.size - 1, 1)
    error = float(np.sqrt(scatter)) / float(counts.sum())
    excess = mean - explained
    if error == 0.0:
        return float(np.sqrt(max(excess, 0.0)))
    levels = np.linspace(0.0, np.sqrt(max(excess, 0.0) + POSTERIOR_REACH * error), POSTERIOR_LEVELS)
    log_share = -0.5 * ((levels**2 - excess) / error) ** 2
    share = np.exp(log_share - log_share.max())
    return float(np.sqrt(share @ levels**2 / share.sum()))


def _products(errors: Sequence[Array]) -> tuple[Array, Array]:
    """Sums [ramps] of the products of neighbouring errors of each ramp, and the numbers of products
    [ramps].
    """
    sums, counts = np.zeros(len(errors)), np.zeros(len(errors))
    for ramp, error in enumerate(errors):
        for k in NEIGHBOURING:
            if k < error.size:
                sums[ramp] += float(error[k:] @ error[: error.size - k])
                counts[ramp] += error.size - k
    return sums, counts


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
    posterior of the noise (`noise.estimate`), so that k = 2 covers 95 %; its degrees of freedom
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

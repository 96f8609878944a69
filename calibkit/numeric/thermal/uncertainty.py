"""Uncertainty of a fitted bias: its coefficients, the model's error on stretches that were left
out of the fit, and clamping.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric import chunks, consistency, gum
from calibkit.numeric.thermal.evaluate import Evaluation
from calibkit.numeric.thermal.noise import Flicker, Noise
from calibkit.numeric.thermal.pooled_fit import ThermalLog

NEIGHBOURING = (1, 2, 3)
"""Lags, in 100 s means, of the products of left-out errors: 100 to 300 s."""
POSTERIOR_REACH = 6.0
"""Standard errors beyond which the posterior of the model error is negligible."""
POSTERIOR_LEVELS = 2001


class _Stated(Protocol):
    """A fitted model with its errors."""

    @property
    def covariance(self) -> Array: ...
    @property
    def noise(self) -> Noise: ...
    @property
    def model_error(self) -> float: ...
    @property
    def model_error_dof(self) -> float: ...


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
    sums = [sum(float(e[k:] @ e[: e.size - k]) for k in NEIGHBOURING if k < e.size) for e in errors]
    return np.array(sums), np.array(
        [sum(max(e.size - k, 0) for k in NEIGHBOURING) for e in errors], dtype=np.float64
    )


def explained(
    model: _Stated, logs: Sequence[ThermalLog], sensitivities: Sequence[Array], group: int
) -> float:
    """Mean product [(°/h)²] of neighbouring errors (means over a group of blocks) that type A
    uncertainty and flicker noise cause, with the derivatives [n, p] of the drift along each log.

    The mean of each ramp is removed, as for left-out errors.
    """
    longest = max(log.time.size for log in logs) // group
    flicker, total, count = Flicker(max(longest, 1), NEIGHBOURING), 0.0, 0
    for log, sensitivity in zip(logs, sensitivities, strict=True):
        for part in np.unique(log.part):
            rows = np.flatnonzero(log.part == part)
            whole, first = rows.size // group, int(rows[0]) // group
            if not whole:
                continue
            s = sensitivity[rows[: whole * group]].reshape(whole, group, -1).mean(axis=1)
            s -= s.mean(axis=0)
            last = min(first + whole, longest)
            noise = flicker.about_level(last - whole, last)
            for k, by_flicker in zip(NEIGHBOURING, noise, strict=True):
                total += float(of_coefficients(model, s, k).sum())
                total += model.noise.flicker**2 * float(by_flicker.sum())
                count += by_flicker.size
    return total / count if count else 0.0


def of_coefficients(model: _Stated, sensitivity: Array, lag: int) -> Array:
    """Covariances [m − lag] that the uncertainty of the coefficients gives to values with these
    derivatives [m, p] and those a lag behind them.
    """
    before = sensitivity[: max(len(sensitivity) - lag, 0)]
    product = np.einsum("ij,jk,ik->i", sensitivity[lag:], model.covariance, before)
    return np.asarray(product, dtype=np.float64)


def contributions(model: _Stated, evaluation: Evaluation) -> list[tuple[str, str, Array, float]]:
    """Independent contributions to the uncertainty of the drift along a log, each with its name,
    kind, values [n, °/h] and degrees of freedom.

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
    return [
        ("coefficients", "A", type_a, np.inf),
        ("model error on ramps left out", "A", missed, model.model_error_dof),
        ("beyond the fitted ranges", "B", np.abs(evaluation.beyond) / np.sqrt(3.0), np.inf),
        *([("hysteresis of what was before", "B", past, np.inf)] if np.any(past) else []),
    ]


def compare_means(
    left: Array, standard: Array, expanded: tuple[Array, Array], noise: Noise, group: int
) -> tuple[dict[str, float], Array, Array]:
    """Errors [n] of a log as means over a group of blocks about the log's mean, against their
    standard uncertainty [n] and the expanded ones [n] of the drift and of the drift less its mean:
    number of means, the share within U and noise, and the size over the standard uncertainty with
    its limit, as a JSON object; the means [m] and the absolute limits [m] of U and noise. Empty for
    less than two means.
    """
    count = left.size // group
    if count < 2:
        return {}, np.zeros(0), np.zeros(0)
    (flicker,) = Flicker(count, [0]).about_level(0, count)
    own = noise.white_variance / group + noise.flicker**2 * flicker
    limit, near = (np.sqrt(chunks.block_means(one, group) ** 2 + 4.0 * own) for one in expanded)
    means = chunks.block_means(left, group)
    error = means - means.mean()
    # the error of the drift is taken as one pattern along the log
    judged = consistency.compare_errors(error, chunks.block_means(standard, group)[:, None], own)
    compared = {
        "means_of_100_s": count,
        "share_within_expanded_uncertainty": float(np.mean(np.abs(error) <= near)),
        "rms_error_over_uncertainty": judged.ratio,
        "largest_rms_error_over_uncertainty": judged.limit,
    }
    return compared, means, limit

"""Noise of block means, estimated from the residuals of a fit, and the covariance of the
coefficients that it causes.

    y = b_log + X β + e,   V = Cov e = σ² D⁻¹ + B² K                                         (1)
    -2 log L_R = Σ ln(1 + ρ λ) + ln|Xᵀ V⁻¹ X| + ν ln σ̂²,   ρ = B²/σ²                        (2)

y are means of D rows each, K the kernel of flicker noise along a log, λ its eigenvalues beside D⁻¹:
`flicker.Turned` turns the means of a log so that their variances are σ² (1 + ρ λ). White noise
averages out; flicker noise (bias instability) and model misfit do not and dominate the uncertainty
of drift coefficients. Both are modelled as flicker noise of level B by restricted maximum
likelihood. Unlike a kernel estimate (Newey & West 1987), this keeps correlation that is as long as
the log.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.flicker import Turned, kernel

LEVELS = np.concatenate([np.linspace(0.0, 2.0, 51), np.geomspace(2.0, 200.0, 31)[1:]])
"""Grid of flicker levels, in standard deviations of the white noise of a group."""
MOST_GROUPS = 250
"""Largest number of groups of a log: the size of the matrices that are factored."""
DEPENDENT = 1e-12
"""Eigenvalue of a correlation matrix below which its columns count as dependent."""


@dataclass(frozen=True, slots=True)
class BlockNoise:
    """Variance of the white noise of a row [(°/h)²] and level B of the flicker noise [°/h]."""

    white_variance: float
    flicker: float


def estimate(rotation: Turned, design: Array, indication: Array) -> BlockNoise:
    """White variance of a row and flicker level of blocks with a design [m, k] and indication [m],
    with a free offset of each log and common coefficients.

    The level is the root mean square over the posterior for a flat prior on B over the white noise
    of a group of usual size. The maximum of the likelihood would understate a level near zero, as
    half of the time it lies on the boundary.
    """
    rotated = rotation.rows(np.column_stack([np.ones(indication.size), design, indication]))
    parts = [(rotation.flicker[rows], rotated[rows]) for rows, _ in rotation.parts]
    restricted_fits = [_restricted(parts, float(level) ** 2 / rotation.typical) for level in LEVELS]
    likelihood = np.array([value for value, _ in restricted_fits])
    share = np.exp(-0.5 * (likelihood - likelihood.min())) * np.gradient(LEVELS)
    share /= share.sum()
    white = np.array([variance for _, variance in restricted_fits])
    square = share @ (LEVELS**2 * white)
    return BlockNoise(float(share @ white), float(np.sqrt(square / rotation.typical)))


def _restricted(rotated_logs: Sequence[tuple[Array, Array]], ratio: float) -> tuple[float, float]:
    """(2) at a ratio ρ, and the white variance that maximises it, of logs that are turned: λ [m] of
    each, and its rows [m, 1 + k + 1] of a level, of the design and of the indication.
    """
    size = rotated_logs[0][1].shape[1] - 1
    total = np.zeros((size, size))
    determinant, rows = 0.0, 0
    for eigenvalues, rotated in rotated_logs:
        spread = 1.0 + ratio * eigenvalues
        moment = (rotated / spread[:, None]).T @ rotated
        total += moment[1:, 1:] - np.outer(moment[0, 1:], moment[0, 1:]) / moment[0, 0]
        determinant += float(np.sum(np.log(spread)) + np.log(moment[0, 0]))
        rows += spread.size - 1
    length = np.sqrt(np.maximum(np.diag(total)[:-1], 0.0))
    length = np.where(length > 0.0, length, 1.0)
    gram_values, vectors = np.linalg.eigh(total[:-1, :-1] / np.outer(length, length))
    gram_values = np.maximum(gram_values, DEPENDENT)
    turned_right = vectors.T @ (total[:-1, -1] / length)
    square = float(total[-1, -1] - np.sum(turned_right**2 / gram_values))
    dof = max(rows - size + 1, 1)
    variance = max(square, np.finfo(float).tiny) / dof
    determinant += float(np.sum(np.log(gram_values)) + 2.0 * np.sum(np.log(length)))
    return determinant + dof * float(np.log(variance)), variance


def covariance_of(estimator: Array, design: Array, indication: Array) -> Array:
    """Covariance [p, p] of what an estimator P [p, n] makes of an indication [n], σ² P Pᵀ +
    B² P K Pᵀ; the noise is that about a design [n, k], whose first column is 1.
    """
    starts = np.arange(0, indication.size, -(-indication.size // MOST_GROUPS))
    count = np.diff(np.append(starts, indication.size)).astype(np.float64)
    sums = np.add.reduceat(np.column_stack([design[:, 1:], indication]), starts, axis=0)
    means = sums / count[:, None]
    rotation = Turned.of_logs(np.zeros_like(starts), np.arange(count.size), count)
    noise = estimate(rotation, means[:, :-1], means[:, -1])
    P = np.add.reduceat(estimator, starts, axis=1)
    of_flicker = noise.flicker**2 * P @ kernel(count.size) @ P.T
    return np.asarray(noise.white_variance * estimator @ estimator.T + of_flicker, dtype=np.float64)

"""Noise of block means along logs, estimated from what a fit leaves, and the covariance that
follows for the coefficients.

White noise averages away; flicker (bias instability) and what a model leaves do not, and it is they
that drift coefficients suffer from. Their covariance function is taken as that of flicker noise,
whose level B is found by restricted maximum likelihood: unlike a kernel estimate (Newey & West
1987) it does not lose the correlation that is as long as the log.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array

LEVELS = np.concatenate([np.linspace(0.0, 2.0, 51), np.geomspace(2.0, 200.0, 31)[1:]])
"""Flicker levels that are compared, in standard deviations of the white noise of a group."""
FINER = 8
"""Samples of flicker noise in an interval whose mean is meant: with 100 the variogram is 2 % lower.
"""
MOST_GROUPS = 250
"""Most groups of a log: matrices of that size are factored."""
DEPENDENT = 1e-12
"""Eigenvalue of a correlation matrix below which its columns count as dependent."""
GROUP = 10
"""Blocks in a group where logs are short: flicker is what the averages of some minutes show."""


@dataclass(frozen=True, slots=True)
class _Grouped:
    """One log averaged over groups of rows: design [m, k], indication [m], sums of weights [m] and
    of their squares [m].

    `bread` and `white` [1 + k, 1 + k] are Z'WZ and Z'W²Z of its rows, Z being (1, design), W their
    weights.
    """

    design: Array
    indication: Array
    weight: Array
    square: Array
    bread: Array
    white: Array

    @property
    def effective(self) -> Array:
        """Number [m] of equally weighted rows whose mean is as noisy as that of the group."""
        return self.weight**2 / self.square


@dataclass(frozen=True, slots=True)
class Noise:
    """Variance of the white noise of a row [(°/h)²] and level B [°/h] of the flicker noise of the
    groups.
    """

    white_variance: float
    flicker: float


def group_rows(design: Array, indication: Array, weights: Array) -> _Grouped:
    """Weighted means of a log's design [n, k] and indication [n] over groups of rows; a rest joins
    the last group.
    """
    n = indication.size
    size = max(GROUP, -(-n // MOST_GROUPS))
    starts = np.arange(max(n // size, 1)) * size
    weight = np.add.reduceat(weights, starts)
    usable = np.where(weight > 0.0, weight, 1.0)
    means = np.add.reduceat(design * weights[:, None], starts) / usable[:, None]
    values = np.add.reduceat(indication * weights, starts) / usable
    full = weight > 0.0
    squares = np.add.reduceat(weights**2, starts)[full]
    z = np.column_stack([np.ones(n), design])
    weighted = z * weights[:, None]
    return _Grouped(
        means[full], values[full], weight[full], squares, weighted.T @ z, weighted.T @ weighted
    )


def flicker_kernel(count: int) -> Array:
    """Covariance [count, count] of means of flicker noise of level 1 over equal intervals, the
    noise starting with the log.

    Half-order integration of white noise (Kasdin 1995, Proc. IEEE 83(5):802, α = 1); the level is
    free of the interval. An offset that is older than the log is its turn-on bias.
    """
    fine = count * FINER
    lags = np.arange(1, fine)
    summed = np.concatenate(
        ([0.0], np.cumsum(np.concatenate(([1.0], np.cumprod((lags - 0.5) / lags)))))
    )
    passed = (np.arange(count)[:, None] + 1) * FINER - np.arange(fine)
    means = (summed[np.maximum(passed, 0)] - summed[np.maximum(passed - FINER, 0)]) / FINER
    return np.asarray(means @ means.T, dtype=np.float64)


def estimate(logs: Sequence[_Grouped]) -> Noise:
    """White variance and flicker level of the residuals of logs, each with a free offset and all
    with common coefficients.

    The level is the root mean square over its posterior for a flat prior on B: near zero, where the
    likelihood has its maximum on the boundary half of the time, the maximum would understate it.
    """
    typical = float(np.median(np.concatenate([log.effective for log in logs])))
    kernel = flicker_kernel(max(log.weight.size for log in logs))
    turned = [_turned(log, typical, kernel) for log in logs]
    found = [_restricted(turned, float(level) ** 2) for level in LEVELS]
    likelihood = np.array([value for value, _ in found])
    share = np.exp(-0.5 * (likelihood - likelihood.min())) * np.gradient(LEVELS)
    share /= share.sum()
    white = np.array([variance for _, variance in found])
    return Noise(float(share @ white), float(np.sqrt(share @ (LEVELS**2 * white) / typical)))


def _turned(log: _Grouped, typical: float, kernel: Array) -> tuple[Array, Array]:
    """Flicker variances [m] and (1, design, indication) [m, k + 2] along the principal axes of
    flicker against white noise.

    Flicker of level one is worth the white noise of a group of `typical` rows.
    """
    root = np.sqrt(log.effective)
    values, vectors = np.linalg.eigh(
        kernel[: root.size, : root.size] * np.outer(root, root) / typical
    )
    whole = np.column_stack([np.ones(root.size), log.design, log.indication]) * root[:, None]
    return np.maximum(values, 0.0), np.asarray(vectors.T @ whole, dtype=np.float64)


def _restricted(turned: Sequence[tuple[Array, Array]], ratio: float) -> tuple[float, float]:
    """−2 log restricted likelihood of a flicker variance ratio, the white variance profiled out,
    and that variance.
    """
    size = turned[0][1].shape[1] - 1
    total = np.zeros((size, size))
    determinant, rows = 0.0, 0
    for values, whole in turned:
        spread = 1.0 + ratio * values
        moment = (whole / spread[:, None]).T @ whole
        total += moment[1:, 1:] - np.outer(moment[0, 1:], moment[0, 1:]) / moment[0, 0]
        determinant += float(np.sum(np.log(spread)) + np.log(moment[0, 0]))
        rows += spread.size - 1
    length = np.sqrt(np.diag(total)[:-1])
    values, vectors = np.linalg.eigh(total[:-1, :-1] / np.outer(length, length))
    values = np.maximum(values, DEPENDENT)
    turned_right = vectors.T @ (total[:-1, -1] / length)
    square = float(total[-1, -1] - np.sum(turned_right**2 / values))
    dof = max(rows - size + 1, 1)
    variance = max(square, np.finfo(float).tiny) / dof
    determinant += float(np.sum(np.log(values)) + 2.0 * np.sum(np.log(length)))
    return determinant + dof * float(np.log(variance)), variance


def covariance(logs: Sequence[_Grouped], noise: Noise) -> Array:
    """Covariance [L + k, L + k] of the offsets of L logs and the k coefficients of a weighted fit
    under that noise.

    (Z'WZ)⁻¹ Z'W Ω W Z (Z'WZ)⁻¹ with Ω white noise of the rows and flicker noise of the groups, each
    log by itself.
    """
    count = len(logs)
    size = count + logs[0].design.shape[1]
    bread, meat = np.zeros((size, size)), np.zeros((size, size))
    kernel = flicker_kernel(max(log.weight.size for log in logs))
    for number, log in enumerate(logs):
        m = log.weight.size
        place = np.ix_(*[np.r_[number, count:size]] * 2)
        z = np.column_stack([np.ones(m), log.design]) * log.weight[:, None]
        bread[place] += log.bread
        meat[place] += noise.white_variance * log.white
        meat[place] += noise.flicker**2 * z.T @ kernel[:m, :m] @ z
    length = np.sqrt(np.diag(bread))
    outer = np.outer(length, length)
    inverse = np.linalg.pinv(bread / outer, rcond=DEPENDENT, hermitian=True) / outer
    return np.asarray(inverse @ meat @ inverse, dtype=np.float64)

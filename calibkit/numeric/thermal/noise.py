"""Noise of block means, estimated from the residuals of a fit, and the covariance of the
coefficients that it causes.

White noise averages out; flicker noise (bias instability) and model misfit do not and dominate the
uncertainty of drift coefficients. Both are modelled as flicker noise of level B, estimated by
restricted maximum likelihood. Unlike a kernel estimate (Newey & West 1987), this keeps correlation
that is as long as the log.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.thermal import pooled_moments

LEVELS = np.concatenate([np.linspace(0.0, 2.0, 51), np.geomspace(2.0, 200.0, 31)[1:]])
"""Grid of flicker levels, in standard deviations of the white noise of a group."""
FINER = 8
"""Samples of flicker noise per averaging interval; with 100 the variogram is 2 % lower."""
MOST_GROUPS = 250
"""Largest number of groups of a log: the size of the matrices that are factored."""
DEPENDENT = 1e-12
"""Eigenvalue of a correlation matrix below which its columns count as dependent."""
GROUP = 10
"""Fewest blocks in a group: flicker noise shows in averages of some minutes."""


@dataclass(frozen=True, slots=True)
class _Grouped:
    """One log averaged over m groups of rows: design [m, k], indication [m], sums of the weights
    [m] and of their squares [m].

    `bread` and `white` [1 + k, 1 + k] are Z'WZ and Z'W²Z of its rows, with Z = (1, design) and
    weights W.
    """

    design: Array
    indication: Array
    weight: Array
    square: Array
    bread: Array
    white: Array

    @property
    def effective(self) -> Array:
        """Effective number of rows [m]: that of equally weighted rows whose mean has the same
        noise.
        """
        return self.weight**2 / self.square


@dataclass(frozen=True, slots=True)
class Noise:
    """Variance of the white noise of a row [(°/h)²] and level B of the flicker noise [°/h]."""

    white_variance: float
    flicker: float


def group_rows(design: Array, indication: Array, weights: Array) -> _Grouped:
    """Weighted means of a log's design [n, k] and indication [n] over groups of rows; the last
    group holds the remainder.
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
    """Covariance [count, count] of interval means of flicker noise of level 1 that starts with the
    log.

    The noise is white noise integrated to order one half (Kasdin 1995, Proc. IEEE 83(5):802, α =
    1); the level does not depend on the interval. Any older offset is part of the log's turn-on
    bias.
    """
    passed = (np.arange(count)[:, None] + 1) * FINER - np.arange(count * FINER)
    means = np.append(0.0, _responses(count))[np.maximum(passed, 0)]
    return np.asarray(means @ means.T, dtype=np.float64)


def _responses(count: int) -> Array:
    """What a sample of the white noise adds to the mean of FINER samples of flicker noise that
    ends 1, 2, … samples after it began [count · FINER].
    """
    lags = np.arange(1, count * FINER)
    summed = np.cumsum(np.concatenate(([1.0], np.cumprod((lags - 0.5) / lags))))
    summed[FINER:] -= summed[:-FINER].copy()
    return np.asarray(summed / FINER, dtype=np.float64)


class Flicker:
    """What `flicker_kernel` holds of any number of interval means at some lags, in memory that
    grows with their number alone.

    The noise has no memory of where a log begins: a covariance is a sum of products of the response
    with itself, over as many samples as have passed.
    """

    def __init__(self, count: int, lags: Sequence[int]) -> None:
        self._count = count
        self._response = _responses(count)
        self._ends = np.cumsum(self._response.reshape(-1, FINER), axis=0).ravel()
        self._size = 1 << (2 * self._response.size - 1).bit_length()
        self._spectrum = np.fft.rfft(self._response, self._size)
        self._at_lags = [(lag, self._covariances(lag)) for lag in lags]

    @cached_property
    def _whole(self) -> Array:
        """Sums [count] of the covariances of each mean with all of them."""
        return self._sums(0, self._count)

    def _covariances(self, lag: int) -> Array:
        """Covariances [count − lag] between each mean and the one `lag` behind it."""
        h = self._response
        products = h[: max(h.size - lag * FINER, 0)] * h[lag * FINER :]
        return np.asarray(np.cumsum(products)[FINER - 1 :: FINER], dtype=np.float64)

    def _sums(self, first: int, stop: int) -> Array:
        """Sums [count] of the covariances of each mean with the means first … stop − 1."""
        from_each = np.zeros(self._response.size)
        from_each[: stop * FINER] = self._ends[: stop * FINER][::-1]
        from_each[: first * FINER] -= self._ends[: first * FINER][::-1]
        passed = np.fft.irfft(self._spectrum * np.fft.rfft(from_each, self._size), self._size)
        return np.asarray(passed[FINER - 1 : from_each.size : FINER], dtype=np.float64)

    def about_level(self, first: int, stop: int, *, of_rest: bool = False) -> list[Array]:
        """Covariances [stop − first − lag], one array for each lag, of the means first … stop − 1
        less their own mean, or less that `of_rest`, the other means, if there are any.
        """
        own, inside = self._sums(first, stop), np.zeros(self._count, dtype=np.bool_)
        inside[first:stop] = True
        level = inside
        if of_rest and not inside.all():
            own, level = self._whole - own, ~inside
        with_level = own / np.count_nonzero(level)
        of_level, beside = float(with_level[level].mean()), with_level[first:stop]
        return [
            covariances[first : max(stop - lag, first)]
            - beside[: max(beside.size - lag, 0)]
            - beside[lag:]
            + of_level
            for lag, covariances in self._at_lags
        ]


def estimate(logs: Sequence[_Grouped]) -> Noise:
    """White variance and flicker level of the residuals of logs with a free offset each and common
    coefficients.

    The level is the root mean square over the posterior for a flat prior on B. The maximum of the
    likelihood would understate a level near zero, as half of the time it lies on the boundary.
    """
    typical = float(np.median(np.concatenate([log.effective for log in logs])))
    kernel = flicker_kernel(max(log.weight.size for log in logs))
    turned = [_to_eigenbasis(log, typical, kernel) for log in logs]
    found = [_restricted(turned, float(level) ** 2) for level in LEVELS]
    likelihood = np.array([value for value, _ in found])
    share = np.exp(-0.5 * (likelihood - likelihood.min())) * np.gradient(LEVELS)
    share /= share.sum()
    white = np.array([variance for _, variance in found])
    return Noise(float(share @ white), float(np.sqrt(share @ (LEVELS**2 * white) / typical)))


def _to_eigenbasis(log: _Grouped, typical: float, kernel: Array) -> tuple[Array, Array]:
    """Flicker variances [m] and (1, design, indication) [m, k + 2] in the eigenbasis of flicker
    noise relative to white noise.

    Flicker noise of level 1 is scaled to the white noise of a group of `typical` rows.
    """
    root = np.sqrt(log.effective)
    values, vectors = np.linalg.eigh(
        kernel[: root.size, : root.size] * np.outer(root, root) / typical
    )
    whole = np.column_stack([np.ones(root.size), log.design, log.indication]) * root[:, None]
    return np.maximum(values, 0.0), np.asarray(vectors.T @ whole, dtype=np.float64)


def _restricted(turned: Sequence[tuple[Array, Array]], ratio: float) -> tuple[float, float]:
    """−2 log restricted likelihood at a ratio of flicker to white variance, and the white variance
    that maximises it.
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


def covariance(logs: Sequence[_Grouped], noise: Noise, alike: float = 0.0) -> Array:
    """Covariance [L + k, L + k] of the L offsets and the k coefficients of a weighted fit for the
    given noise.

    It is H Z'W Ω W Z H' with the estimator H; Ω is white noise of the rows plus flicker noise of
    the groups, independent between logs. With turn-on biases that are `alike`, the coefficients
    err by these too. Offsets are the mean residuals of the logs.
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
    sums, own = np.diag(bread)[:count], slice(count, None)
    means = bread[:count, own] / sums[:, None]
    between = np.zeros((size - count, count))
    pooled = bread[own, own] - (sums * means.T) @ means
    if alike:
        weight, apart = pooled_moments.between_logs(sums, means, alike)
        between = weight * apart.T
        pooled += between @ apart
    length = np.sqrt(np.diag(pooled))
    outer = np.outer(length, length)
    inverse = np.linalg.pinv(pooled / outer, rcond=DEPENDENT, hermitian=True) / outer
    whole = np.vstack([-means, np.eye(size - count)]) @ inverse
    estimator = whole @ np.hstack([between / sums - means.T, np.eye(size - count)])
    estimator[:count, :count] += np.diag(1.0 / sums)
    found = estimator @ meat @ estimator.T
    if alike:
        by_turn_on = whole @ between
        found += noise.white_variance / alike * by_turn_on @ by_turn_on.T
    return np.asarray(found, dtype=np.float64)

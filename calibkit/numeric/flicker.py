"""Flicker noise of means over equal intervals, and logs turned to where it has no memory.

Flicker noise is white noise integrated to order one half (Kasdin 1995, Proc. IEEE 83(5):802,
α = 1) that starts with the log; any older offset is part of the log's turn-on bias. Its level does
not depend on the interval.

    y_i = Σ_k h_k w_(i-k),   h_0 = 1,  h_k = h_(k-1) (k - ½)/k           w white noise
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calibkit.numeric.arrays import Array, Integers

FINER = 8
"""Samples of flicker noise per averaging interval; with 100 the variogram is 2 % lower."""


@lru_cache(maxsize=8)
def kernel(count: int) -> Array:
    """Covariance [count, count] of interval means of flicker noise of level 1; it is not writable,
    as callers share it.
    """
    passed = (np.arange(count)[:, None] + 1) * FINER - np.arange(count * FINER)
    means = np.append(0.0, _responses(count))[np.maximum(passed, 0)]
    covariance = np.asarray(means @ means.T, dtype=np.float64)
    covariance.setflags(write=False)
    return covariance


def _responses(count: int) -> Array:
    """What a sample of the white noise adds to the mean of FINER samples of flicker noise that
    ends 1, 2, … samples after it began [count · FINER].
    """
    lags = np.arange(1, count * FINER)
    # h_k = h_(k-1) (k - ½)/k, summed over the samples of a mean
    summed = np.cumsum(np.concatenate(([1.0], np.cumprod((lags - 0.5) / lags))))
    summed[FINER:] -= summed[:-FINER].copy()
    return np.asarray(summed / FINER, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Turned:
    """Means of m blocks of logs, turned so that white and flicker noise of them are independent.

        V = σ² D⁻¹ + B² K,   D^½ K D^½ = U Λ Uᵀ:   rows Uᵀ D^½ y have variances σ² + B² λ

    D are the numbers of rows of the blocks, K the flicker kernel of each log.
    """

    parts: tuple[tuple[slice, Array], ...]
    """Blocks of each log, and Uᵀ D^½ of them."""
    flicker: Array
    """λ [m]."""
    typical: float
    """Rows of a usual block."""

    @classmethod
    def of_logs(cls, log: Integers, place: Integers, count: Array) -> "Turned":
        """Logs by the number [m, ascending] of the log of each block, its place [m] in the log,
        some of which may be missing, and its rows [m].
        """
        ends = np.cumsum(np.bincount(log))
        parts, variances = [], []
        for first, stop in zip(np.append(0, ends[:-1]), ends, strict=True):
            places, counts = (tuple(values[first:stop].tolist()) for values in (place, count))
            turn, flicker = _turn(places, counts)
            parts.append((slice(first, stop), turn))
            variances.append(flicker)
        return cls(tuple(parts), np.concatenate(variances), float(np.median(count)))

    def rows(self, means: Array) -> Array:
        """Turned rows [m] or [m, k] of block means."""
        return np.concatenate([turn @ means[rows] for rows, turn in self.parts])


@lru_cache(maxsize=32)
def _turn(place: tuple[int, ...], count: tuple[float, ...]) -> tuple[Array, Array]:
    """Uᵀ D^½ [m, m] and λ [m] of the blocks of one log; many logs are alike."""
    root, places_of_log = np.sqrt(count), np.ix_(place, place)
    # D^½ K D^½ = U Λ Uᵀ; rounding makes a zero eigenvalue negative
    values, vectors = np.linalg.eigh(kernel(place[-1] + 1)[places_of_log] * np.outer(root, root))
    return np.asarray(vectors.T * root, dtype=np.float64), np.maximum(values, 0.0)


class Flicker:
    """What `kernel` holds of any number of interval means at some lags, in memory that grows with
    their number alone: K = H Hᵀ, H the response of each mean to the samples of white noise.

    The noise has no memory of where a log begins: a covariance is a sum of products of the response
    with itself, over as many samples as have passed.
    """

    def __init__(self, count: int, lags: Sequence[int]) -> None:
        self._response = h = _responses(count)
        self._size = 1 << (2 * h.size - 1).bit_length()
        self._spectrum = np.fft.rfft(h, self._size)
        # lag, and covariances [count − lag] between each mean and the one `lag` behind it
        self._at_lags: list[tuple[int, Array]] = []
        for lag in lags:
            products = h[: max(h.size - lag * FINER, 0)] * h[lag * FINER :]
            self._at_lags.append((lag, np.cumsum(products)[FINER - 1 :: FINER]))

    def about_level(self, first: int, stop: int, *, of_rest: bool = False) -> list[Array]:
        """Covariances [stop − first − lag], one array for each lag, of the means first … stop − 1
        less their own mean, or less that `of_rest`, the other means, if there are any.
        """
        samples = self._response.size
        inside = np.zeros(samples // FINER, dtype=np.bool_)
        inside[first:stop] = True
        level = ~inside if of_rest and not inside.all() else inside
        # covariances K w of each mean with the level, w its weights: v = Hᵀ w, then H v
        weights = np.zeros(samples)
        weights[FINER - 1 :: FINER] = level / np.count_nonzero(level)
        spectrum_of_noise = np.fft.rfft(weights, self._size) * self._spectrum.conj()
        of_noise = np.fft.irfft(spectrum_of_noise, self._size)[:samples]
        spectrum_of_means = np.fft.rfft(of_noise, self._size) * self._spectrum
        with_level = np.fft.irfft(spectrum_of_means, self._size)[FINER - 1 : samples : FINER]
        of_level, own_level = float(with_level[level].mean()), with_level[first:stop]
        return [
            covariances[first : max(stop - lag, first)]
            - own_level[: max(own_level.size - lag, 0)]
            - own_level[lag:]
            + of_level
            for lag, covariances in self._at_lags
        ]

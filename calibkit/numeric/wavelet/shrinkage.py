"""Noise of wavelet details, thresholds that separate noise from signal, and rules that apply
them.
"""

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Literal

import numpy as np
import pywt

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array
from calibkit.numeric.dispersion import MAD_OF_UNIT_NORMAL

Threshold = Literal["universal", "sure", "bayes", "minimax"]
Rule = Literal["soft", "hard", "garrote", "firm"]

MINIMAX_FROM = 32
"""Smallest number of details for which the minimax threshold is not zero."""


def estimate_noise(details: Array) -> float:
    """Standard deviation of the noise in details [n], by their median absolute value / 0.6745 [unit
    of the details].

    Zero when half of the details or more are exactly zero: no noise is visible, so nothing will be
    removed.

    Raises
    ------
    FitError : no details, or one that is not finite.

    Notes
    -----
    Donoho & Johnstone 1994. Details of noise have zero mean, so the deviation is taken from zero.
    """
    if not (details.size and np.isfinite(details).all()):
        raise FitError("no values, or one that is not finite, show no noise", hint="exclude it")
    return float(np.median(np.abs(details), overwrite_input=True)) / MAD_OF_UNIT_NORMAL


@lru_cache(maxsize=64)
def noise_gains(bank: str, levels: int) -> Array:
    """Standard deviation of the details of unit white noise at each level [levels], by a filter
    bank of PyWavelets.

    With r_j the autocorrelation of the filters of j levels to the approximation, r_0 = δ, and a, b
    those of the low-pass and of the high-pass filter,

        gain²_(j+1) = Σ_k b_k r_j(k),   r_(j+1)(k) = Σ_m a_m r_j(2 k + m)
    """
    wavelet = pywt.Wavelet(bank)
    low, high = (np.correlate(taps, taps, "full") for taps in (wavelet.dec_lo, wavelet.dec_hi))
    lags = np.arange(low.size) - low.size // 2
    gains, noise = np.empty(levels), (lags == 0).astype(np.float64)
    for j in range(levels):
        gains[j] = math.sqrt(high @ noise)
        # beyond the lags of the filters nothing is correlated
        wide = np.pad(noise, low.size)
        noise = np.array([low @ wide[low.size + low.size // 2 + 2 * k + lags] for k in lags])
    return gains


def _universal(_details: Array, noise: float, count: int) -> float:
    """Threshold σ √(2 ln N) that the noise of N samples hardly ever exceeds (Donoho & Johnstone
    1994).

    Parameters
    ----------
    noise : standard deviation σ of their noise [unit of the details].
    count : samples N of the whole signal.
    """
    return noise * math.sqrt(2.0 * math.log(max(count, 1)))


def _minimax(details: Array, noise: float, _count: int) -> float:
    """Threshold σ (0.3936 + 0.1829 log₂ n) of least worst-case risk; 0 for n ≤ 32 (Donoho &
    Johnstone 1994).
    """
    return (
        noise * (0.3936 + 0.1829 * math.log2(details.size)) if details.size > MINIMAX_FROM else 0.0
    )


def _bayes(details: Array, noise: float, _count: int) -> float:
    """Threshold σ²/σ_x, σ_x² = mean d² − σ² the variance of the signal in details [n] (Chang, Yu &
    Vetterli 2000).

    Where the details hold no more than the noise, their largest magnitude: all of them go.
    """
    if details.size == 0 or noise == 0.0:
        return 0.0
    excess = float(details @ details) / details.size - noise**2
    return noise**2 / math.sqrt(excess) if excess > 0.0 else float(np.max(np.abs(details)))


def _sure(details: Array, noise: float, _count: int) -> float:
    """Threshold that minimises Stein's unbiased estimate of the risk of soft shrinkage, or the
    universal one.

    Parameters
    ----------
    details : [n] of one level.
    noise : standard deviation σ of their noise [unit of the details].

    Notes
    -----
    SureShrink's hybrid rule (Donoho & Johnstone 1995): where the level is sparse, mean (d/σ)² − 1 ≤
    (log₂ n)^1.5/√n, the risk estimate is too noisy to be minimised and the universal threshold of
    the level, σ √(2 ln n), is taken; elsewhere the minimiser over the magnitudes |d| of SURE(t) = n
    − 2 #{|d/σ| ≤ t} + Σ min(|d/σ|, t)², never above the universal threshold.
    """
    n = details.size
    if n == 0 or noise == 0.0:
        return 0.0
    # above it noise hardly ever lies: a higher threshold removes signal alone
    ceiling = math.sqrt(2.0 * math.log(n))
    squares = np.sort((details / noise) ** 2)
    if float(np.mean(squares)) - 1.0 <= math.log2(n) ** 1.5 / math.sqrt(n):
        return noise * ceiling
    # at a threshold between two magnitudes the risk falls with it: its minimum is at a magnitude
    killed = np.arange(1, n + 1)
    risk = n - 2.0 * killed + np.cumsum(squares) + (n - killed) * squares
    return noise * min(math.sqrt(float(squares[np.argmin(risk)])), ceiling)


def _soft(details: Array, threshold: float) -> Array:
    """Pull every detail [n] towards zero by the threshold, the smaller ones to zero."""
    return details - np.clip(details, -threshold, threshold)


def _hard(details: Array, threshold: float) -> Array:
    """Keep the details [n] above the threshold as they are, set the others to zero."""
    return np.where(np.abs(details) > threshold, details, 0.0)


def _garrote(details: Array, threshold: float) -> Array:
    """Set d to d − t²/d above the threshold, to zero below: continuous, and nearly d where d is
    large (Gao 1998).
    """
    large = np.abs(details) > threshold
    return np.where(large, details - threshold**2 / np.where(large, details, 1.0), 0.0)


def _firm(details: Array, threshold: float) -> Array:
    """Set details [n] below t to zero, keep those above 2 t, and join both by a straight line (Gao
    & Bruce 1997).
    """
    magnitude, shrunk = np.abs(details), np.zeros_like(details)
    # a line from 0 at t to 2 t at 2 t: continuous, and large details keep their size
    kept = np.flatnonzero(magnitude > threshold)  # hardly any at fine levels
    smaller = np.minimum(2.0 * (magnitude[kept] - threshold), magnitude[kept])
    shrunk[kept] = np.copysign(smaller, details[kept])
    return shrunk


THRESHOLDS: Mapping[Threshold, Callable[[Array, float, int], float]] = {
    "universal": _universal,
    "sure": _sure,
    "bayes": _bayes,
    "minimax": _minimax,
}
RULES: Mapping[Rule, Callable[[Array, float], Array]] = {
    "soft": _soft,
    "hard": _hard,
    "garrote": _garrote,
    "firm": _firm,
}

"""Noise of gyro indications and the resolution of what is logged; coefficients as in IEEE Std
952.
"""

import math

import numpy as np

from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_HOUR


def angle_random_walk(
    N: float, count: int, rng: np.random.Generator, *, interval_s: float = 1.0
) -> Array:
    """White rate noise [count] [°/h] whose integral walks by N [°/√h]; Allan deviation N/√τ (IEEE
    Std 952, annex C).
    """
    return rng.normal(0.0, N * math.sqrt(SECONDS_PER_HOUR / interval_s), count)


def flicker(B: float, count: int, rng: np.random.Generator) -> Array:
    """1/f rate noise [count] [°/h] of bias instability B [°/h]; the Allan deviation is flat at B
    √(2 ln 2/π).

    Half-order integration of white noise (Kasdin, "Discrete simulation of colored noise", Proc.
    IEEE 83(5):802, 1995, recursion of section III.B with α = 1). Its one-sided density is σ²/(πf),
    that of IEEE Std 952 is B²/(πf), so σ = B whatever the interval. The noise starts from zero with
    the log: an offset older than the log is turn-on bias.
    """
    lags = np.arange(1, count)
    response = np.concatenate(([1.0], np.cumprod((lags - 0.5) / lags)))[:count]
    white = rng.normal(0.0, B, count)
    padded = 2 * count
    return np.fft.irfft(np.fft.rfft(response, padded) * np.fft.rfft(white, padded), padded)[:count]


def rate_random_walk(
    K: float, count: int, rng: np.random.Generator, *, interval_s: float = 1.0
) -> Array:
    """Rate [count] [°/h] that walks by K [°/h/√h] from zero; Allan deviation K √(τ/3) (IEEE Std
    952, annex C).
    """
    return np.cumsum(rng.normal(0.0, K * math.sqrt(interval_s / SECONDS_PER_HOUR), count))


def pulses(rate: Array, resolution: float) -> Array:
    """Rate [n] as whole pulses an interval, each worth `resolution`, in the unit of the rate.

    The angle below one pulse is carried into the next interval, as a pulse counter does: the summed
    angle is never off by a pulse or more. With Q = resolution · interval/√12 the Allan variance
    gains 3Q²/τ² (IEEE Std 952, annex C).
    """
    counts = np.floor(np.cumsum(rate) / resolution)
    return np.diff(counts, prepend=0.0) * resolution


def reading(quantity: Array, resolution: float, noise: float, rng: np.random.Generator) -> Array:
    """Thermometer reading [n]: the quantity with white noise of a standard deviation, rounded to
    the resolution.
    """
    return np.round((quantity + rng.normal(0.0, noise, len(quantity))) / resolution) * resolution

"""Responses of `gyro-response/1`, odd polynomials and the sine of an open-loop gyro, and rates from
the indications of any response.
"""

from collections.abc import Callable

import numpy as np

from calibkit.arrays import Array

NEWTON_STEPS = 20
"""More than enough: each doubles the digits of a rate."""


def _odd_powers(count: int) -> list[int]:
    """Powers of the coefficients of an odd polynomial: 0, 1, 3, 5, …."""
    return [0, *range(1, 2 * count - 2, 2)]


def evaluate(coefficients: Array, rate_dps: Array, *, is_sine: bool) -> Array:
    """Indication [n] of a response at rates [n] [°/s]."""
    if is_sine:
        zero, slope, scale = coefficients
        return np.asarray(zero + slope * scale * np.sin(rate_dps / scale), dtype=np.float64)
    return np.asarray(
        sum(
            c * rate_dps**k
            for c, k in zip(coefficients, _odd_powers(coefficients.size), strict=True)
        )
    )


def gradient(coefficients: Array, rate_dps: Array, *, is_sine: bool) -> Array:
    """Derivatives [n, p] of the indication by the coefficients, at rates [n] [°/s]."""
    if not is_sine:
        return np.asarray(rate_dps[:, None] ** _odd_powers(coefficients.size), dtype=np.float64)
    _, slope, scale = coefficients
    phase = rate_dps / scale
    bend = slope * (np.sin(phase) - phase * np.cos(phase))
    return np.column_stack((np.ones_like(phase), scale * np.sin(phase), bend))


def invert(curve: Callable[[Array], Array], limits: tuple[float, float], indicated: Array) -> Array:
    """Rates [n] at which a response, a function of rates [n], gives indicated rates [n] [°/s], by
    Newton's steps; outside the fitted rates the correction at the nearer limit is kept.
    """
    low, high = limits
    at_low, at_high = (curve(np.full(indicated.shape, limit)) for limit in limits)
    inside = np.clip(indicated, at_low, at_high)
    rate = low + (inside - at_low) / (at_high - at_low) * (high - low)
    step = 1e-4 * (high - low)
    for _ in range(NEWTON_STEPS):
        slope = (curve(rate + step) - curve(rate - step)) / (2.0 * step)
        before = rate
        rate = np.clip(rate - (curve(rate) - inside) / slope, low, high)
        if np.max(np.abs(rate - before), initial=0.0) <= 1e-14 * (high - low):
            break
    return np.asarray(rate + (indicated - inside), dtype=np.float64)

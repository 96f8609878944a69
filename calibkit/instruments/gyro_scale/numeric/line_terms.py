"""Shapes of a response that is no straight line over the rate, by number."""

import numpy as np

from calibkit.arrays import Array

ASYMMETRY = 1
"""Number of the shape |Ω|; the others are powers of the rate."""
BOTH_WAYS = 2.0
"""Range of the signs of rates of both directions."""


def turns_both_ways(rate_dps: Array) -> bool:
    """Whether rates of both directions are among [n]."""
    return bool(np.ptp(np.sign(rate_dps)) == BOTH_WAYS)


def shape(number: int, rate_dps: Array, fastest_dps: float) -> Array:
    """Shape [n]; powers are of the rate over the fastest one."""
    if number == ASYMMETRY:
        return np.abs(rate_dps)
    return np.asarray((rate_dps / fastest_dps) ** number)

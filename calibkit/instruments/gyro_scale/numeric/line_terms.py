"""Shapes of a response that is no straight line over the rate."""

import numpy as np

from calibkit.arrays import Array

ASYMMETRY = "asymmetry"
CURVATURE = "curvature"
"""Shapes by name: |Ω|, and with its number a power of the rate."""
BOTH_WAYS = 2.0
"""Range of the signs of rates of both directions."""


def turns_both_ways(rate_dps: Array) -> bool:
    """Whether rates of both directions are among [n]."""
    return bool(np.ptp(np.sign(rate_dps)) == BOTH_WAYS)


def shape(name: str, rate_dps: Array, fastest_dps: float) -> Array:
    """Shape [n] by its name; powers are of the rate over the fastest one."""
    if name == ASYMMETRY:
        return np.abs(rate_dps)
    return np.asarray((rate_dps / fastest_dps) ** int(name.removeprefix(CURVATURE)))

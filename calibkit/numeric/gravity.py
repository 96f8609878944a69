"""Local gravity where no gravimeter has been."""

import math

from calibkit.errors import FitError

EQUATOR_MPS2 = 9.7803253359
"""Normal gravity at the equator of WGS 84 [m/s²]."""
SOMIGLIANA = 0.00193185265241
"""Somigliana's constant k of WGS 84 [1]."""
ECCENTRICITY_SQUARED = 0.00669437999014
"""First eccentricity squared of WGS 84 [1]."""
FREE_AIR = 3.086e-6
"""Free-air gradient [1/s²]."""


def local_gravity(latitude_deg: float, height_m: float = 0.0) -> float:
    """Normal gravity [m/s²] at a geodetic latitude [°] and a height above the ellipsoid [m].

    Raises
    ------
    FitError
        For a latitude beyond ±90°, or a value that is not finite.

    Notes
    -----
    Somigliana (1929) with the WGS 84 constants and the free-air gradient: γ = γ_e (1 + k sin²φ)/√(1
    − e² sin²φ) − 3.086e-6 h. Local anomalies are of the order of 5e-4 m/s² (50 ppm): measure where
    that matters.

    """
    if not (math.isfinite(height_m) and -90.0 <= latitude_deg <= 90.0):
        raise FitError(
            f"no gravity at latitude {latitude_deg:g}° and height {height_m:g} m",
            hint="latitude_deg lies between -90 and 90, height_m is a number of metres",
        )
    square = math.sin(math.radians(latitude_deg)) ** 2
    normal = (
        EQUATOR_MPS2 * (1.0 + SOMIGLIANA * square) / math.sqrt(1.0 - ECCENTRICITY_SQUARED * square)
    )
    return normal - FREE_AIR * height_m

"""The earth's rotation as a gyro at rest sees it, and its gravity where no gravimeter has been.

    ω = ω_e (cos α, 0, -sin α)                               north, east, down
    γ = γ_e (1 + k sin²α)/√(1 - e² sin²α) - 3.086e-6 h       Somigliana (1929), WGS 84

α is the geodetic latitude, h the height above the ellipsoid [m].
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import EARTH_RATE_DPH

EQUATOR_MPS2 = 9.7803253359
"""Normal gravity at the equator of WGS 84 [m/s²]."""
SOMIGLIANA = 0.00193185265241
"""Somigliana's constant k of WGS 84 [1]."""
ECCENTRICITY_SQUARED = 0.00669437999014
"""First eccentricity squared of WGS 84 [1]."""
FREE_AIR = 3.086e-6
"""Free-air gradient [1/s²]."""


def vertical_rate(latitude_deg: ArrayLike) -> Array:
    """Component of the earth's rate about the upward vertical [°/h]: ω_e sin α, positive in the
    north.
    """
    return np.asarray(EARTH_RATE_DPH * np.sin(np.radians(latitude_deg)), dtype=np.float64)


def north_east_down(latitude_deg: ArrayLike) -> Array:
    """Earth's rate [..., 3] [°/h] in the axes north, east, down: ω_e (cos α, 0, −sin α)."""
    alpha = np.radians(latitude_deg)
    directions = np.stack((np.cos(alpha), np.zeros_like(alpha), -np.sin(alpha)), axis=-1)
    return np.asarray(EARTH_RATE_DPH * directions, dtype=np.float64)


def along_axis(latitude_deg: ArrayLike, elevation_deg: ArrayLike, azimuth_deg: ArrayLike) -> Array:
    """Earth's rate [°/h] along an axis at an elevation above the horizontal and an azimuth from
    north [°].

    ω_e (sin α sin el + cos α cos el cos az): vertical_rate for an axis that points up.
    """
    alpha, el, az = (np.radians(angle) for angle in (latitude_deg, elevation_deg, azimuth_deg))
    cos_angle = np.sin(alpha) * np.sin(el) + np.cos(alpha) * np.cos(el) * np.cos(az)
    return np.asarray(EARTH_RATE_DPH * cos_angle, dtype=np.float64)


def along_axis_slopes(latitude_deg: float, elevation_deg: float, azimuth_deg: float) -> Array:
    """Derivatives [3] of `along_axis` by latitude, elevation and azimuth [°/h/°]."""
    alpha, el, az = np.radians([latitude_deg, elevation_deg, azimuth_deg])
    slopes = (
        np.cos(alpha) * np.sin(el) - np.sin(alpha) * np.cos(el) * np.cos(az),
        np.sin(alpha) * np.cos(el) - np.cos(alpha) * np.sin(el) * np.cos(az),
        -np.cos(alpha) * np.cos(el) * np.sin(az),
    )
    return np.radians(EARTH_RATE_DPH * np.array(slopes))


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
    # the geodetic latitude is that of the normal to the ellipsoid, so Somigliana's formula holds
    # without a conversion
    square = math.sin(math.radians(latitude_deg)) ** 2
    normal = (
        EQUATOR_MPS2 * (1.0 + SOMIGLIANA * square) / math.sqrt(1.0 - ECCENTRICITY_SQUARED * square)
    )
    return normal - FREE_AIR * height_m

"""The earth's rotation as a gyro at rest sees it, and its gravity where no gravimeter has been."""

import math

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array
from calibkit.constants import EARTH_RATE_DPH
from calibkit.errors import FitError

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


def _horizontal_rate(latitude_deg: ArrayLike) -> Array:
    """Component of the earth's rate about the horizontal that points north [°/h]: ω_e cos α."""
    return np.asarray(EARTH_RATE_DPH * np.cos(np.radians(latitude_deg)), dtype=np.float64)


def north_east_down(latitude_deg: ArrayLike) -> Array:
    """Earth's rate [..., 3] [°/h] in the axes north, east, down: ω_e (cos α, 0, −sin α)."""
    north, up = _horizontal_rate(latitude_deg), vertical_rate(latitude_deg)
    return np.stack((north, np.zeros_like(north), -up), axis=-1)


def along_axis(
    latitude_deg: ArrayLike, elevation_deg: ArrayLike, azimuth_deg: ArrayLike = 0.0
) -> Array:
    """Earth's rate [°/h] along an axis at an elevation above the horizontal and an azimuth from
    north [°].

    ω_e (sin α sin el + cos α cos el cos az): vertical_rate for an axis that points up.
    """
    el, az = np.radians(elevation_deg), np.radians(azimuth_deg)
    along = vertical_rate(latitude_deg) * np.sin(el) + _horizontal_rate(latitude_deg) * np.cos(
        el
    ) * np.cos(az)
    return np.asarray(along, dtype=np.float64)


def along_axis_by_latitude(
    latitude_deg: ArrayLike, elevation_deg: ArrayLike, azimuth_deg: ArrayLike = 0.0
) -> Array:
    """Derivative of `along_axis` by latitude [°/h/°]: ω_e (cos α sin el − sin α cos el cos az)
    π/180.
    """
    el, az = np.radians(elevation_deg), np.radians(azimuth_deg)
    north, up = _horizontal_rate(latitude_deg), vertical_rate(latitude_deg)
    return np.asarray(
        np.radians(north * np.sin(el) - up * np.cos(el) * np.cos(az)), dtype=np.float64
    )


def along_axis_by_attitude(
    latitude_deg: float, elevation_deg: float, azimuth_deg: float = 0.0
) -> tuple[float, float]:
    """Derivatives of `along_axis` by elevation and by azimuth of the axis [°/h/°]: ω_e (sin α cos
    el − cos α sin el cos az) π/180 and −ω_e cos α cos el sin az π/180.
    """
    el, az = np.radians(elevation_deg), np.radians(azimuth_deg)
    north, up = _horizontal_rate(latitude_deg), vertical_rate(latitude_deg)
    by_elevation = np.radians(up * np.cos(el) - north * np.sin(el) * np.cos(az))
    return float(by_elevation), float(np.radians(-north * np.cos(el) * np.sin(az)))


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

"""The earth's rotation as a gyro at rest sees it."""

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array
from calibkit.constants import EARTH_RATE_DPH


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

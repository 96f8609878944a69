"""Derivatives of θ, φ, s and ψ: steps C to F as one function of what they are made of."""

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.instruments.inclinometer import published
from calibkit.instruments.inclinometer.published import Components

ROOT = 4
"""Row of the root among the results."""


def seek_north(inputs: Numbers, plus: Mask, weight: Array) -> Numbers:
    """θ, φ, s = w s± + rest, ψ and the root s± [5, n] from g_x, g_y [g], ω_x, ω_y [°/h], α and the
    rest of s [6, n]; angles in rad, plus and weight [n] say which root and its w.
    """
    accel_x, accel_y, gyro_x, gyro_y, latitude, rest = inputs
    attitude = published.attitude(accel_x, accel_y)
    roots = published.scale_roots(gyro_x, gyro_y, attitude, latitude * 180.0 / np.pi)
    root = np.where(plus, roots.plus, roots.minus)
    # a root that is not used may be no number
    s = np.where(weight > 0.0, weight * root, 0.0) + rest
    psi = published.azimuth(accel_x, accel_y, s * gyro_x, s * gyro_y, latitude * 180.0 / np.pi)
    return np.stack([attitude.inclination, attitude.toolface, s, psi, root])


def slopes(parts: Components, latitude_deg: Array, plus: Mask, weight: Array, rest: Array) -> Array:
    """Derivatives [n, 5, 6] of the results of `seek_north` by its inputs."""
    inputs = np.stack(
        [
            *(parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y),
            *(np.radians(latitude_deg), rest),
        ]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        by_input = derivative(
            lambda step: seek_north(inputs + step[:, None], plus, weight), np.zeros(6)
        )
    return np.moveaxis(by_input, 1, 0)


def root_slopes(parts: Components, latitude_deg: Array, plus: Mask) -> Array:
    """Derivatives [n, 5] of roots s± by g_x, g_y [1/g], ω_x, ω_y [h/°], α [1/rad]."""
    ones = np.ones(plus.size)
    return slopes(parts, latitude_deg, plus, ones, 0.0 * ones)[:, ROOT, :5]

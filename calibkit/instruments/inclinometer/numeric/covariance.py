"""Uncertainty of θ, φ, s and ψ: steps C to F as one function of what they are made of, and its
derivatives.
"""

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.instruments.inclinometer import published
from calibkit.instruments.inclinometer.published import Components

ROOT, AZIMUTH = 4, 3
"""Rows of the results."""
UNITS = np.array([np.degrees(1.0), np.degrees(1.0), 1.0, np.degrees(1.0)])
"""Degrees of θ, φ and ψ."""


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
        found = derivative(
            lambda step: seek_north(inputs + step[:, None], plus, weight), np.zeros(6)
        )
    return np.moveaxis(found, 1, 0)


def root_slopes(parts: Components, latitude_deg: Array, plus: Mask) -> Array:
    """Derivatives [n, 5] of roots s± by g_x, g_y [1/g], ω_x, ω_y [h/°], α [1/rad]."""
    ones = np.ones(plus.size)
    return slopes(parts, latitude_deg, plus, ones, 0.0 * ones)[:, ROOT, :5]


def covariance(
    parts: Components,
    latitude_deg: Array,
    latitude_uncertainty_deg: float,
    plus: Mask,
    weight: Array,
    prior: Array,
    prior_uncertainty: Array,
) -> tuple[Array, Array]:
    """Covariance [n, 4, 4] of θ [°], φ [°], s, ψ [°], to first order, by errors of this sensor pair
    alone; and changes [n, 4] by an error of the latitude, which all sensor pairs share, as large
    as its standard uncertainty.

    parts : components and their covariance; plus, weight : which root, and its weight in s [n];
    prior, prior_uncertainty : of s [n].
    """
    jacobian = slopes(parts, latitude_deg, plus, weight, (1.0 - weight) * prior)
    jacobian = jacobian[:, :4] * UNITS[:, None]
    inputs = np.zeros((weight.size, 6, 6))
    inputs[:, :4, :4] = parts.covariance
    inputs[:, 5, 5] = ((1.0 - weight) * prior_uncertainty) ** 2
    by_latitude = jacobian[:, :, 4] * np.radians(latitude_uncertainty_deg)
    with np.errstate(invalid="ignore"):
        return np.asarray(jacobian @ inputs @ np.swapaxes(jacobian, 1, 2)), by_latitude

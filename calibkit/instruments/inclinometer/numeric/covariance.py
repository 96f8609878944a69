"""Propagation of the uncertainties of components, latitude and prior of s to θ, φ, s and ψ."""

import numpy as np

from calibkit.arrays import Array
from calibkit.constants import EARTH_RATE_DPH
from calibkit.instruments.inclinometer.numeric import published
from calibkit.instruments.inclinometer.numeric.published import Attitude, Components


def _inner_jacobian(parts: Components, found: Attitude) -> tuple[Array, Array, Array]:
    """A, B [n] and the derivatives [n, 5, 5] of θ, φ, A, B, α by g_x, g_y [g], ω_x, ω_y [°/h], α
    [rad].
    """
    A, B = published.level_rates(parts.gyro_x, parts.gyro_y, found.toolface)
    cosine, sine = np.cos(found.toolface), np.sin(found.toolface)
    level = np.hypot(parts.accel_x, parts.accel_y)
    jacobian = np.zeros((level.size, 5, 5))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = 1.0 / (level * np.cos(found.inclination))
        jacobian[:, 0, 0], jacobian[:, 0, 1] = parts.accel_x * slope, parts.accel_y * slope
        jacobian[:, 1, 0], jacobian[:, 1, 1] = parts.accel_y / level**2, -parts.accel_x / level**2
    jacobian[:, 2] = -B[:, None] * jacobian[:, 1]
    jacobian[:, 3] = A[:, None] * jacobian[:, 1]
    jacobian[:, 2, 2], jacobian[:, 2, 3] = cosine / EARTH_RATE_DPH, -sine / EARTH_RATE_DPH
    jacobian[:, 3, 2], jacobian[:, 3, 3] = sine / EARTH_RATE_DPH, cosine / EARTH_RATE_DPH
    jacobian[:, 4, 4] = 1.0
    return A, B, jacobian


def root_gradient(parts: Components, found: Attitude, latitude_deg: Array, s: Array) -> Array:
    """Derivatives [n, 5] of a root s [n] by g_x, g_y [1/g], ω_x, ω_y [h/°], latitude [1/rad].

    Implicit: ds = −df/f_s of f = (s A − sin α sin θ)² + s² B² cos²θ − cos²α cos²θ, f_s = 2 cos α
    cos θ C/s.
    """
    A, B, inner = _inner_jacobian(parts, found)
    latitude = np.radians(latitude_deg)
    sa, ca = np.sin(latitude), np.cos(latitude)
    st, ct = np.sin(found.inclination), np.cos(found.inclination)
    north = s * A - sa * st
    by_inner = np.column_stack(
        (
            -2.0 * (north * sa + s**2 * B**2 * st - ca**2 * st) * ct,
            np.zeros_like(s),
            2.0 * s * north,
            2.0 * s**2 * B * ct**2,
            -2.0 * (north * st - sa * ct**2) * ca,
        )
    )
    f_s = 2.0 * (north * A + s * B**2 * ct**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(
            -np.einsum("ni,nij->nj", by_inner, inner) / f_s[:, None], dtype=np.float64
        )


def _azimuth_gradient(
    parts: Components, found: Attitude, latitude_deg: Array, s: Array
) -> tuple[Array, Array]:
    """Derivatives of ψ (step F): [n, 5] by g_x, g_y, ω_x, ω_y, latitude at constant s, and [n] by
    s.
    """
    A, B, inner = _inner_jacobian(parts, found)
    latitude = np.radians(latitude_deg)
    sa, ca = np.sin(latitude), np.cos(latitude)
    st, ct = np.sin(found.inclination), np.cos(found.inclination)
    east, north = -s * B * ct, s * A - sa * st
    size = east**2 + north**2
    with np.errstate(divide="ignore", invalid="ignore"):
        by_theta = (north * s * B * st + east * sa * ct) / size
        by_inner = np.column_stack(
            (
                by_theta,
                np.zeros_like(s),
                -east * s / size,
                -north * s * ct / size,
                east * ca * st / size,
            )
        )
        by_s = (-north * B * ct - east * A) / size
    return np.einsum("ni,nij->nj", by_inner, inner), np.asarray(by_s, dtype=np.float64)


def angle_slopes(
    parts: Components,
    latitude_deg: Array,
    s: Array,
    s_root: Array,
    weight: Array,
    moved: Array,
) -> tuple[Array, Array]:
    """Derivatives [n] of a root [1/°] and of ψ [°/°] by an angle about the tool axis that moves
    g_x, g_y, ω_x, ω_y by `moved` [n, 4] a radian; s, s_root, weight as for `covariance`.
    """
    found = published.attitude(parts.accel_x, parts.accel_y)
    direct, by_s = _azimuth_gradient(parts, found, latitude_deg, s)
    of_root = root_gradient(parts, found, latitude_deg, s_root)
    # the gradient of a root may be infinite, and 0 · ∞ is NaN
    with np.errstate(invalid="ignore"):
        by_root, by_azimuth = (np.sum(each[:, :4] * moved, axis=1) for each in (of_root, direct))
        along = np.where(weight > 0.0, weight * by_root, 0.0)
    return np.radians(by_root), by_azimuth + by_s * along


def covariance(
    parts: Components,
    found: Attitude,
    latitude_deg: Array,
    latitude_uncertainty_deg: float,
    s: Array,
    s_root: Array,
    weight: Array,
    prior_uncertainty: Array,
) -> tuple[Array, Array]:
    """Covariance [n, 4, 4] of θ [°], φ [°], s, ψ [°], to first order, by errors of this sensor pair
    alone; and changes [n, 4] by an error of the latitude, which all sensor pairs share, as large
    as its standard uncertainty.

    parts : components and their covariance; s, s_root, weight : the scale factor used, its root,
    and the root's weight in it [n]; prior_uncertainty : of the prior of s [n].
    """
    inputs = np.zeros((s.size, 6, 6))
    inputs[:, :4, :4] = parts.covariance
    inputs[:, 5, 5] = prior_uncertainty**2
    _, _, inner = _inner_jacobian(parts, found)
    jacobian = np.zeros((s.size, 4, 6))
    jacobian[:, :2, :5] = inner[:, :2]
    gradient = root_gradient(parts, found, latitude_deg, s_root)
    # the gradient of an unused root may be infinite, and 0 · ∞ is NaN
    jacobian[:, 2, :5] = weight[:, None] * np.where((weight > 0.0)[:, None], gradient, 0.0)
    jacobian[:, 2, 5] = 1.0 - weight
    direct, by_s = _azimuth_gradient(parts, found, latitude_deg, s)
    jacobian[:, 3] = by_s[:, None] * jacobian[:, 2]
    jacobian[:, 3, :5] += direct
    jacobian *= np.array([np.degrees(1.0), np.degrees(1.0), 1.0, np.degrees(1.0)])[:, None]
    by_latitude = jacobian[:, :, 4] * np.radians(latitude_uncertainty_deg)
    with np.errstate(invalid="ignore"):
        return np.asarray(jacobian @ inputs @ np.swapaxes(jacobian, 1, 2)), by_latitude

"""Inclination and high-side toolface of a tool from its gravity vector, with errors and
uncertainty.

Frame: NED, azimuth ψ about z, inclination θ about y, toolface φ about z, passive rotations, so that
the gravity vector in the tool is R_z(φ) R_y(θ) (0, 0, 1) = (−sin θ cos φ, sin θ sin φ, cos θ),
indications positive along gravity.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric.dispersion import rms

Convention = Literal["gravity", "specific_force"]
"""What a positive indication means: "gravity" is positive along gravity, "specific_force" is
positive against it.
"""

TOOLFACE_RANGE_DEG = (10.0, 170.0)
"""Inclinations between which a toolface is quoted unless the caller says otherwise [°]."""


@dataclass(frozen=True, slots=True)
class AttitudeErrors:
    """Attitude errors of dwells against a reference, the toolface only where the inclination allows
    one.
    """

    inclination_error_deg: Array
    """[n], indicated minus reference [°]."""
    toolface_error_deg: Array
    """[n], indicated minus reference in (−180, 180] [°], NaN outside the inclination range."""
    inclination_range_deg: tuple[float, float]
    """Reference inclinations that the toolface figures hold for [°]."""
    inclination_rms_deg: float
    inclination_max_deg: float
    toolface_rms_deg: float
    """NaN when no dwell lies in the range."""
    toolface_max_deg: float
    toolface_scaled_max_deg: float
    """Largest |toolface error| · sin(inclination) in the range [°]: the figure that does not depend
    on the range.
    """


def gravity_positive(indication: Array, convention: Convention) -> Array:
    """Indications [..., 3] as calibkit reads them, positive along gravity, from either sign
    convention.
    """
    if convention == "gravity":
        return indication
    if convention == "specific_force":
        return -indication
    raise FitError(
        f"unknown sign convention {convention!r}", hint='use "gravity" or "specific_force"'
    )


def tool_rotation(inclination_deg: Array, toolface_deg: Array) -> Array:
    """Passive rotations R_z(φ) R_y(θ) [n, 3, 3] from the table's base to the tool; the last column
    is gravity [g].
    """
    theta, phi = np.radians(inclination_deg), np.radians(toolface_deg)
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    rows = ((ct * cp, sp, -st * cp), (-ct * sp, cp, st * sp), (st, np.zeros_like(st), ct))
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


def gravity_vector(inclination_deg: Array, toolface_deg: Array) -> Array:
    """Reference gravity [n, 3] in the tool [g, positive along gravity] at inclinations and
    toolfaces [n] [°].
    """
    theta, phi = np.radians(inclination_deg), np.radians(toolface_deg)
    sine = np.sin(theta)
    return np.stack(
        np.broadcast_arrays(-sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)), axis=-1
    )


def inclination(vector: Array) -> Array:
    """Inclination DEV [n] in [0, 180] [°] of gravity vectors [n, 3] of any length: atan2(√(G_x² +
    G_y²), G_z).
    """
    return np.degrees(np.arctan2(np.hypot(vector[..., 0], vector[..., 1]), vector[..., 2]))


def toolface(vector: Array) -> Array:
    """High-side toolface RB [n] in (−180, 180] [°] of gravity vectors [n, 3] of any length:
    atan2(G_y, −G_x).
    """
    return wrapped(np.degrees(np.arctan2(vector[..., 1], -vector[..., 0])))


def wrapped(angle_deg: Array) -> Array:
    """Angles [n] brought into (−180, 180] [°]."""
    return 180.0 - np.mod(180.0 - angle_deg, 360.0)


def errors(
    vector: Array,
    inclination_deg: Array,
    toolface_deg: Array,
    *,
    inclination_range_deg: tuple[float, float] = TOOLFACE_RANGE_DEG,
) -> AttitudeErrors:
    """Inclination and toolface errors of gravity vectors [n, 3] against reference angles [n] [°].

    Toolface errors grow as 1/sin(inclination): they are given between the two inclinations of the
    range [°] and NaN elsewhere, and their largest value is also given multiplied by
    sin(inclination).
    """
    low, high = inclination_range_deg
    if not 0.0 < low < high < 180.0:
        raise FitError(
            f"a toolface cannot be quoted for inclinations {low:g}..{high:g}°",
            hint=(
                "the range lies inside 0..180°, both ends excluded: there the toolface does not"
                " exist"
            ),
        )
    tilt = inclination(vector) - inclination_deg
    inside = (inclination_deg >= low) & (inclination_deg <= high)
    roll = np.where(inside, wrapped(toolface(vector) - toolface_deg), np.nan)
    scaled = (roll * np.sin(np.radians(inclination_deg)))[inside]
    return AttitudeErrors(
        inclination_error_deg=tilt,
        toolface_error_deg=roll,
        inclination_range_deg=(low, high),
        inclination_rms_deg=rms(tilt),
        inclination_max_deg=_largest(tilt),
        toolface_rms_deg=rms(roll[inside]),
        toolface_max_deg=_largest(roll[inside]),
        toolface_scaled_max_deg=_largest(scaled),
    )


def standard_uncertainty(vector: Array, covariance: Array) -> tuple[Array, Array]:
    """Standard uncertainties [n], [n] [°] of inclination and toolface from the covariance [n, 3, 3]
    of vectors [n, 3].

    First order (GUM 5.2.2); along the vertical the toolface has none and is NaN, and the
    inclination is that of the horizontal components' root mean square.
    """
    gx, gy, gz = np.moveaxis(vector, -1, 0)
    flat, square = np.hypot(gx, gy), np.sum(vector**2, axis=-1)
    upright = flat == 0.0
    radius = np.where(upright, 1.0, flat)
    toward = np.stack([gx * gz / radius, gy * gz / radius, -flat], axis=-1) / square[..., None]
    around = np.stack([gy, -gx, np.zeros_like(gx)], axis=-1) / (radius**2)[..., None]
    tilt = np.einsum("...i,...ij,...j->...", toward, covariance, toward)
    roll = np.einsum("...i,...ij,...j->...", around, covariance, around)
    level = (covariance[..., 0, 0] + covariance[..., 1, 1]) / (2.0 * square)
    inclination_deg = np.degrees(np.sqrt(np.where(upright, level, tilt)))
    return inclination_deg, np.where(upright, np.nan, np.degrees(np.sqrt(roll)))


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values))) if values.size else float("nan")

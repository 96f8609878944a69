"""Inclination and high-side toolface of a tool from its gravity vector, with errors and
uncertainty.

Frame: NED, azimuth ψ about z, inclination θ about y, toolface φ about z, passive rotations, so that
the gravity vector in the tool is R_z(φ) R_y(θ) (0, 0, 1) = (−sin θ cos φ, sin θ sin φ, cos θ),
indications positive along gravity.
"""

from typing import Literal

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array

Convention = Literal["gravity", "specific_force"]
"""What a positive indication means: "gravity" is positive along gravity, "specific_force" is
positive against it.
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


def gravity_vector(inclination_deg: Array, toolface_deg: Array) -> Array:
    """Reference gravity [n, 3] in the tool [g, positive along gravity] at inclinations and
    toolfaces [n] [°].
    """
    theta, phi = np.radians(inclination_deg), np.radians(toolface_deg)
    sine = np.sin(theta)
    return np.stack(
        np.broadcast_arrays(-sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)), axis=-1
    )


def tool_rotation(inclination_deg: Array, toolface_deg: Array) -> Array:
    """Passive rotations R_z(φ) R_y(θ) [n, 3, 3] from the table's base to the tool; their last
    column is the gravity vector [g].
    """
    theta, phi = np.radians(inclination_deg), np.radians(toolface_deg)
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    rows = [[ct * cp, sp, -st * cp], [-ct * sp, cp, st * sp], [st, np.zeros_like(st), ct]]
    return np.moveaxis(np.array(rows), -1, 0)


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

"""Any number of gyros over three table axes: sensitivity vectors, angles between input axes,
misalignment matrix.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, arctan2, length
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value

COLLINEAR = 4.0
"""Distance of an angle from 0° or 180°, in standard uncertainties, below which its first-order
uncertainty is flagged.
"""
PARALLEL = 1e-12
"""Sine of an angle below which every direction across the axes is possible."""


@dataclass(frozen=True, slots=True)
class Triad:
    """Sensitivity vectors of g gyros in the axes of the table."""

    fit: Fit
    """s_g = (K_gx, K_gy, K_gz), gyro by gyro [3 g]: scale factor about each table axis."""
    magnitude: Value
    """|s_g| [g]: scale factor about the gyro's own input axis."""
    misalignment: Value
    """Misalignment matrix [g, 3]: the unit vectors u_g = s_g/|s_g| as rows; the identity for an
    ideal triad.
    """
    angles_deg: Value
    """Angles between the input axes [g, g] [°]; first order, flagged where an angle is within noise
    of 0° or 180°.
    """
    flags: tuple[str, ...]

    @property
    def sensitivity(self) -> Array:
        """[g, 3]."""
        return self.fit.parameters.reshape(-1, 3)

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Numbers of each two gyros."""
        return list(combinations(range(len(self.sensitivity)), 2))


def _unit(p: Numbers) -> Numbers:
    """Unit vectors [g, 3] of sensitivities [3 g]."""
    s = p.reshape(-1, 3)
    return s / length(s)[:, None]


def find(fit: Fit) -> Triad:
    """Angles and misalignment of g gyros from their scale factors about three orthogonal table
    axes, s_g gyro by gyro [3 g].

    Raises
    ------
    FitError
        Values that are not finite, or a gyro that senses none of the axes.

    """
    sensitivity = fit.parameters.reshape(-1, 3)
    count = len(sensitivity)
    if not (np.isfinite(sensitivity).all() and np.isfinite(fit.covariance).all()):
        raise FitError("a sensitivity is not finite", hint="check the run about each axis")
    size = np.linalg.norm(sensitivity, axis=1)
    if not (size > 0.0).all():
        raise FitError(f"gyro {int(np.argmin(size)) + 1} senses none of the three table axes")
    angles, u, dof = (np.zeros((count, count)) for _ in range(3))
    dof += np.inf
    for g in range(count):
        for h in range(g + 1, count):
            one = _value_of_angle(fit, g, h)
            for matrix, number in ((angles, one.value), (u, one.u), (dof, one.dof)):
                matrix[g, h] = matrix[h, g] = float(number)
    near = np.minimum(angles, 180.0 - angles) < COLLINEAR * u
    flags = [
        f"gyros {g + 1} and {h + 1} are collinear within noise"
        for g, h in np.argwhere(np.triu(near, 1))
    ]
    if np.linalg.matrix_rank(sensitivity / size[:, None], tol=1e-6) < 3:
        flags.append("the gyros do not span three axes: the compensation leaves rates out")
    return Triad(
        fit,
        fit.of(lambda p: length(p.reshape(-1, 3))),
        fit.of(_unit),
        Value(angles, u, dof),
        tuple(flags),
    )


def _value_of_angle(fit: Fit, g: int, h: int) -> Value:
    """Angle [°] between two input axes."""
    a, b = _unit(fit.parameters)[[g, h]]
    if np.linalg.norm(np.cross(a, b)) > PARALLEL:

        def angle_deg(p: Numbers) -> Numbers:
            """atan2(|u_g × u_h|, u_g · u_h), which loses no digits near 0° and 180°."""
            u_g, u_h = _unit(p)[[g, h]]
            return arctan2(length(np.cross(u_g, u_h)), np.sum(u_g * u_h)) * 180.0 / np.pi

        return fit.of(angle_deg)
    # every direction across the axis is possible: that of the largest u counts, which is the main
    # axis of the ellipse of the difference, whose covariance follows from three variances
    across = np.linalg.svd(a[None])[2][1:] * 180.0 / np.pi

    def apart(directions: Array) -> Value:
        """Difference [°] of both axes along directions [m, 2] across them."""
        return fit.of(lambda p: directions @ across @ (_unit(p)[g] - _unit(p)[h] * np.sign(a @ b)))

    along_1, along_2, along_both = apart(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])).u ** 2
    mixed = (along_both - along_1 - along_2) / 2.0
    _, main_axes = np.linalg.eigh([[along_1, mixed], [mixed, along_2]])
    worst = apart(main_axes[:, -1:].T)
    angle = np.asarray(0.0 if a @ b > 0.0 else 180.0)
    return Value(angle, worst.u[0], worst.dof[0])

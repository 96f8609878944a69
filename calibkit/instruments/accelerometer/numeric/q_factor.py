"""Non-orthogonality of a triaxial accelerometer: Q-factor, exact and small-angle (Zhou, Hu & Fu
2010).

The x axis is kept and y and z are corrected: e1 is the x axis, e2 lies in the plane of x and y, so
the unit axes x, y, z are the rows of a lower triangular matrix; x is (1, 0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.least_squares import fit as least_squares

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibkit.arrays import Array


NAMES = ("Q1", "Q2", "Q3")
AXES = ("x", "y", "z")
DERIVATIVE_STEP = 1e-5
"""Relative step of central differences: their error is its square."""


@dataclass(frozen=True, slots=True)
class QFit:
    """Q-factor of a triad with the scale, bias and mounting that were fitted with it."""

    coefficients: Array
    """Q1, Q2, Q3 [3] [rad], small-angle, from the axes."""
    covariance: Array
    """[3, 3] [rad²], type A."""
    axes: Array
    """Unit axes x, y, z [3, 3] in the frame e1 = x, lower triangular [1]."""
    rotation: Array
    """[3, 3], from the reference frame to the frame e1 = x: the mounting of the triad, which Q
    leaves alone.
    """
    scale_factor: Array
    """[3], unit of the indication per unit of the reference."""
    bias: Array
    """[3], unit of the indication."""
    residuals: Array
    """[n, 3], unit of the indication."""
    dof: int
    """Of each axis."""
    residual_rms: float
    """Over the degrees of freedom, so that it estimates the noise without bias [unit of the
    indication].
    """
    condition: float

    @property
    def standard_uncertainty(self) -> Array:
        """Of Q1, Q2, Q3 [3] [rad]."""
        return np.sqrt(np.diag(self.covariance))


def exact(axes: Array) -> Array:
    """Exact Q [3, 3]: orthogonal components from components along the unit axes [3, 3] (rows, frame
    e1 = x).

    v1 = m_x; v2 = (m_y − (y·e1) v1)/(y·e2); v3 = (m_z − (z·e1) v1 − (z·e2) v2)/(z·e3): the inverse
    of the axes matrix.
    """
    (_, _, _), (ye1, ye2, _), (ze1, ze2, ze3) = axes.tolist()
    return np.array(
        [
            [1.0, 0.0, 0.0],
            [-ye1 / ye2, 1.0 / ye2, 0.0],
            [(ze2 * ye1 / ye2 - ze1) / ze3, -ze2 / (ye2 * ze3), 1.0 / ze3],
        ]
    )


def small_angle(axes: Array) -> Array:
    """Q1, Q2, Q3 [3] [rad] from unit axes [3, 3]: Q3 = −y·e1, Q1 = −z·e2, Q2 = (y·e1)(z·e2) −
    z·e1.
    """
    ye1, ze1, ze2 = axes[1, 0], axes[2, 0], axes[2, 1]
    return np.array([-ze2, ye1 * ze2 - ze1, -ye1])


def axes_of(coefficients: Array) -> Array:
    """Unit axes [3, 3] that have the small-angle Q1, Q2, Q3 [3] [rad]: the way back from
    `small_angle`.
    """
    q1, q2, q3 = coefficients
    ye1, ze2, ze1 = -q3, -q1, q3 * q1 - q2
    ye2, ze3 = 1.0 - ye1**2, 1.0 - ze1**2 - ze2**2
    if min(ye2, ze3) <= 0.0:
        raise FitError(
            f"Q1, Q2, Q3 = {q1:g}, {q2:g}, {q3:g} rad are no unit axes",
            hint="they are angles in rad",
        )
    return np.array([[1.0, 0.0, 0.0], [ye1, np.sqrt(ye2), 0.0], [ze1, ze2, np.sqrt(ze3)]])


def correct(matrix: Array, indication: Array) -> Array:
    """Orthogonal components [n, 3] from indications [n, 3] and a Q matrix [3, 3], exact or
    small-angle.
    """
    return indication @ matrix.T


def axes_from_sensitivity(sensitivity: Array) -> tuple[Array, Array, Array]:
    """Unit axes [3, 3] in the frame e1 = x, mounting rotation [3, 3] and scale factors [3] of a
    sensitivity matrix.

    Parameters
    ----------
    sensitivity
        [3, 3], row i the sensitivity of axis i to the components of the reference: indication =
        sensitivity · g + bias.

    Returns
    -------
    Axes, rotation and scale factor with sensitivity = diag(scale factor) · axes · rotation.

    Raises
    ------
    FitError
        For axes that lie in a plane, or a left-handed triad: one axis reversed.

    """
    scale = np.linalg.norm(sensitivity, axis=1)
    if not (scale > 0.0).all() or abs(np.linalg.det(sensitivity / scale[:, None])) < 1e-3:
        raise FitError(
            "the three axes lie in one plane",
            hint="check that the columns of the three axes are different",
        )
    unit = sensitivity / scale[:, None]
    # Gram-Schmidt from x on: unit = axes · rotation with axes lower triangular and a positive
    # diagonal
    q, r = np.linalg.qr(unit.T)
    sign = np.sign(np.diag(r))
    axes, rotation = (r * sign[:, None]).T, (q * sign).T
    if np.linalg.det(rotation) < 0.0:
        raise FitError(
            "the triad is left-handed: one axis, or all three, has the wrong sign, two are"
            " exchanged, or toolface runs backwards",
            hint="state reference.convention, or sign and from of the columns, in the recipe",
        )
    return axes, rotation, scale


def fit(indication: Array, reference: Array, *, weights: Array | None = None) -> QFit:
    """Q-factor, scale factor, bias and mounting from indications [n, 3] at reference vectors [n,
    3].

    Each axis is fitted as sensitivity · reference + bias (linear, the reference taken as exact), Q
    is read from the axes: a least-squares fit of the unit-diagonal form itself differs in the
    fourth digit.

    Parameters
    ----------
    indication
        [n, 3], corrected for scale and zero over temperature first where it has any (K-factor
        without cross terms).
    reference
        [n, 3], from `attitude.gravity_vector`.
    weights
        [n] or [n, 3], 1/variance of the indications.

    Raises
    ------
    FitError
        When the attitudes do not determine the sensitivity: fewer than four, or all on one cone.

    """
    if len(reference) < 5:
        raise FitError(
            f"{len(reference)} dwells for four coefficients an axis",
            hint="add attitudes, six or more",
        )
    columns = np.column_stack([reference, np.ones(len(reference))])
    fits = []
    for i, axis in enumerate(AXES):
        names = [*(f"sensitivity of {axis} to {other}" for other in AXES), f"bias of {axis}"]
        weight = None if weights is None else (weights if weights.ndim == 1 else weights[:, i])
        fits.append(least_squares.linear(columns, indication[:, i], weights=weight, names=names))
    parameters = np.concatenate([part.coefficients for part in fits])
    sensitivity = parameters.reshape(3, 4)[:, :3]
    axes, rotation, scale = axes_from_sensitivity(sensitivity)
    covariance = np.zeros((12, 12))
    for i, part in enumerate(fits):
        covariance[4 * i : 4 * i + 4, 4 * i : 4 * i + 4] = part.covariance
    slope = derivative(
        _small_angle_of_parameters, parameters, scale=np.full(12, float(np.max(scale)))
    )
    residuals = np.column_stack([part.residuals for part in fits])
    return QFit(
        coefficients=small_angle(axes),
        covariance=slope @ covariance @ slope.T,
        axes=axes,
        rotation=rotation,
        scale_factor=scale,
        bias=parameters[3::4],
        residuals=residuals,
        dof=fits[0].dof,
        residual_rms=float(
            np.sqrt(
                np.mean([part.residual_rms**2 for part in fits])
                * len(columns)
                / max(fits[0].dof, 1)
            )
        ),
        condition=max(part.condition for part in fits),
    )


def derivative(function: Callable[[Array], Array], at: Array, *, scale: Array) -> Array:
    """Derivative [m, p] of a function at p parameters by central differences of 1e-5 of `scale`
    [p].
    """
    steps = DERIVATIVE_STEP * np.diag(scale)
    columns = [
        (function(at + step) - function(at - step)) / (2.0 * step[i])
        for i, step in enumerate(steps)
    ]
    return np.column_stack(columns)


def _small_angle_of_parameters(parameters: Array) -> Array:
    """Q1, Q2, Q3 of the twelve parameters: three rows of sensitivity and bias."""
    return small_angle(axes_from_sensitivity(parameters.reshape(3, 4)[:, :3])[0])

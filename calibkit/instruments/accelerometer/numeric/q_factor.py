"""Non-orthogonality of a triaxial accelerometer: Q-factor, exact and small-angle (Zhou, Hu & Fu
2010).

The x axis is kept and y and z are corrected: e1 is the x axis, e2 lies in the plane of x and y, so
the unit axes x, y, z are the rows of a lower triangular matrix; x is (1, 0, 0).
"""

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers

NAMES = ("Q1", "Q2", "Q3")


def exact_matrix(axes: Numbers) -> Numbers:
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


def small_angles(axes: Numbers) -> Numbers:
    """Q1, Q2, Q3 [3] [rad] from unit axes [3, 3] in any frame, with e1 = x and e2 in the plane of x
    and y: Q3 = −y·e1, Q1 = −z·e2, Q2 = (y·e1)(z·e2) − z·e1.
    """
    x, y, z = axes
    ye1, ze1 = np.sum(y * x), np.sum(z * x)
    ze2 = (np.sum(z * y) - ye1 * ze1) / np.sqrt(1.0 - ye1**2)
    return np.stack([-ze2, ye1 * ze2 - ze1, -ye1])


def axes_from_angles(coefficients: Numbers) -> Numbers:
    """Unit axes [3, 3] with small angles Q1, Q2, Q3 [3] [rad]: the inverse of `small_angles`."""
    q1, q2, q3 = coefficients
    ye1, ze2, ze1 = -q3, -q1, q3 * q1 - q2
    ye2, ze3 = 1.0 - ye1**2, 1.0 - ze1**2 - ze2**2
    if min(np.real(ye2), np.real(ze3)) <= 0.0:
        raise FitError(
            f"Q1, Q2, Q3 = {q1:g}, {q2:g}, {q3:g} rad are no unit axes",
            hint="they are angles in rad",
        )
    return np.array([[1.0, 0.0, 0.0], [ye1, np.sqrt(ye2), 0.0], [ze1, ze2, np.sqrt(ze3)]])


def axes_from_sensitivity(sensitivity: Array) -> tuple[Array, Array, Array]:
    """Factor a sensitivity matrix into unit axes [3, 3] in the frame e1 = x, mounting rotation [3,
    3] and scale factors [3].

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

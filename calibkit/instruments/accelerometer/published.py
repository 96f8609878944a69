"""K0 … K9 and Q1, Q2, Q3 as published (Zhou, Hu & Fu 2010).

K-factor: scale factor, zero offset and cross-axis terms of one axis, x shown, t in °C:

    G_x' = G_x (K0 + K1 t + K2 t² + K3 t³) − (K4 + K5 t + K6 t² + K7 t³) − K8 G_y − K9 G_z      (1)

K8 and K9 are for x of y and z, for y of z and x, for z of x and y. K = P g, P the pseudo-inverse of
the design: exact on data that the form made. The reference is regressed on the indications, so
noise of the indications is noise of the regressors too; at 20 µg it shifts no coefficient by a
hundredth of its standard uncertainty (Fuller 1987, section 2.2).

Q-factor: non-orthogonality of the axes at one temperature. The x axis is kept and y and z are
corrected: e1 is the x axis, e2 lies in the plane of x and y, so the unit axes x, y, z are the rows
of a lower triangular matrix; x is (1, 0, 0).

    Q3 = −y·e1,   Q1 = −z·e2,   Q2 = (y·e1)(z·e2) − z·e1                                        (2)
"""

import numpy as np

from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers
from calibkit.numeric.arrays import Array

K_NAMES = ("K0", "K1", "K2", "K3", "K4", "K5", "K6", "K7", "K8", "K9")
K_UNITS = (
    *("1", "1/degC", "1/degC2", "1/degC3"),
    *("g", "g/degC", "g/degC2", "g/degC3"),
    *("1", "1"),
)
CROSS = ((1, 2), (2, 0), (0, 1))
"""Indices of the two axes that K8 and K9 multiply, axis by axis: y and z, z and x, x and y."""
Q_NAMES = ("Q1", "Q2", "Q3")


def columns(indication: Array, temperature: Array, axis: int) -> Array:
    """Design matrix [n, 10] of one axis, by (1).

    `temperature` [n] is in the unit that the coefficients are meant for: °C, or mapped to [−1, 1].
    """
    # columns in the order of K0 … K9; K4 … K9 are subtracted in (1)
    powers = np.vander(temperature, 4, increasing=True)
    return np.hstack([indication[:, axis, None] * powers, -powers, -indication[:, CROSS[axis]]])


def exact_matrix(angles: Numbers) -> Numbers:
    """Exact Q [3, 3] of small angles Q1, Q2, Q3 [3] [rad]: orthogonal components v from components
    m along the unit axes (rows, frame e1 = x), the inverse of the axes.

    v1 = m_x; v2 = (m_y − (y·e1) v1)/(y·e2); v3 = (m_z − (z·e1) v1 − (z·e2) v2)/(z·e3).
    """
    return np.asarray(np.linalg.inv(axes_from_angles(angles)))


def small_angles(axes: Numbers) -> Numbers:
    """Q1, Q2, Q3 [3] [rad] from unit axes [3, 3] in any frame, with e1 = x and e2 in the plane of x
    and y: Q3 = −y·e1, Q1 = −z·e2, Q2 = (y·e1)(z·e2) − z·e1.
    """
    x, y, z = axes
    ye1, ze1 = np.sum(y * x), np.sum(z * x)
    # component along e2, which is y less its part along e1
    ze2 = (np.sum(z * y) - ye1 * ze1) / np.sqrt(1.0 - ye1**2)
    return np.stack([-ze2, ye1 * ze2 - ze1, -ye1])


def axes_from_angles(coefficients: Numbers) -> Numbers:
    """Unit axes [3, 3] with small angles Q1, Q2, Q3 [3] [rad]: the inverse of `small_angles`."""
    q1, q2, q3 = coefficients
    ye1, ze2, ze1 = -q3, -q1, q3 * q1 - q2
    # squares of what unit axes have left for their own direction
    ye2, ze3 = 1.0 - ye1**2, 1.0 - ze1**2 - ze2**2
    if min(np.real(ye2), np.real(ze3)) <= 0.0:
        raise FitError(
            f"Q1, Q2, Q3 = {q1:g}, {q2:g}, {q3:g} rad are no unit axes",
            hint="they are angles in rad",
        )
    return np.array([[1.0, 0.0, 0.0], [ye1, np.sqrt(ye2), 0.0], [ze1, ze2, np.sqrt(ze3)]])

"""Scale factor, zero offset and cross-axis terms of a triaxial accelerometer over temperature:
K-factor.

Per axis, linear in ten coefficients (Zhou, Hu & Fu 2010), x shown, t in °C:

    G_x' = G_x (K0 + K1 t + K2 t² + K3 t³) − (K4 + K5 t + K6 t² + K7 t³) − K8 G_y − K9 G_z

K8 and K9 are for x of y and z, for y of z and x, for z of x and y. The reference is regressed on
the indications, so noise of the indications is noise of the regressors too; at 20 µg it shifts no
coefficient by a hundredth of its standard uncertainty (Fuller 1987, section 2.2).
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array

NAMES = ("K0", "K1", "K2", "K3", "K4", "K5", "K6", "K7", "K8", "K9")
CROSS = ((1, 2), (2, 0), (0, 1))
"""Indices of the two axes that K8 and K9 multiply, axis by axis: y and z, z and x, x and y."""


def columns(
    indication: Array, temperature: Array, axis: int, numbers: Sequence[int] = range(10)
) -> Array:
    """Design matrix [n, p] of one axis for the coefficients K with the given indices, in their
    order.

    `temperature` [n] is in the unit that the coefficients are meant for: °C, or mapped to [−1, 1].
    """
    powers = np.vander(temperature, 4, increasing=True)
    scale = indication[:, axis, None] * powers
    design = np.hstack([scale, -powers, -indication[:, CROSS[axis]]])
    return design[:, list(numbers)]

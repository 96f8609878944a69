"""Half-widths that intervals would have if all standard deviations were known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

NORMAL_95 = 1.959963984540054


def half_widths(design: Array, shared: Array, noise: Array | float, combinations: Array) -> Array:
    """95 % half-widths [k] of combinations [k, p] of the coefficients by generalised least squares
    with known variances.

    Parameters
    ----------
    design : [m, p].
    shared : derivatives [m, q] of the observations by shared errors of standard deviation 1.
    noise : standard deviation of the errors that are not shared, [m] or one.
    combinations : [k, p].

    """
    variance = np.diag(np.broadcast_to(np.square(noise), len(design))) + shared @ shared.T
    scale = np.linalg.norm(design, axis=0)
    white = np.linalg.solve(np.linalg.cholesky(variance), design / scale)
    r = np.linalg.qr(white, mode="r")
    across = np.linalg.solve(r.T, (combinations / scale).T)
    return np.asarray(NORMAL_95 * np.linalg.norm(across, axis=0))

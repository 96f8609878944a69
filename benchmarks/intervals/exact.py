"""Half-widths that intervals would have if all standard deviations were known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

NORMAL_95 = 1.959963984540054


def half_widths(
    design: Array,
    shared: Array,
    noise: Array | float,
    combinations: Array,
    own: Array | float = 0.0,
) -> Array:
    """95 % half-widths [k] of combinations [k, p] of the coefficients by generalised least squares
    with known variances.

    Parameters
    ----------
    design : [m, p].
    shared : derivatives [m, q] of the corrected indications by shared errors of standard
        deviation 1.
    noise : standard deviation of the errors that are not shared, [m] or one.
    combinations : [k, p].
    own : derivatives [k, q] of the combinations' own indications by the shared errors, where they
        have them too.

    """
    alone = np.broadcast_to(np.square(noise), len(design))
    scale = np.linalg.norm(design, axis=0)
    weighted = np.linalg.solve(np.diag(alone) + shared @ shared.T, design / scale)
    inverse = np.linalg.solve((design / scale).T @ weighted, weighted.T)
    solver = (combinations / scale) @ inverse
    left = own - solver @ shared
    return np.asarray(NORMAL_95 * np.sqrt(solver**2 @ alone + np.sum(left**2, axis=1)))

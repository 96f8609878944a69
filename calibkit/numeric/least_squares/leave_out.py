"""Errors of a linear fit at rows that it leaves out, and the choice of a model by
these errors.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array

MARGIN = 0.9
"""Factor by which a model with more coefficients must lower the left-out error: by chance alone a
superfluous term often wins by a few per cent.
"""
FREE = 1e-9
"""What is left of 1, at most, by the leverage of a row, or the largest of a group of rows, that
alone determines a coefficient.
"""


def left_out_errors(design: Array, residuals: Array, *, groups: Array) -> Array:
    """Errors [n] at groups of rows that are left out of a linear least-squares fit, without fitting
    again: (I − H_gg)⁻¹ r_g (Allen 1974; Cook & Weisberg 1982).

    Parameters
    ----------
    design
        [n, p].
    residuals
        [n], of the fit.
    groups
        [n], label of the group that each row is left out with.

    Returns
    -------
    [n], in the unit of the residuals; inf where the rows left out alone determine a coefficient.
    """
    q, _ = np.linalg.qr(design)
    errors = np.empty(len(residuals))
    for label in np.unique(groups):
        inside = groups == label
        rows = q[inside]
        rest = np.eye(len(rows)) - rows @ rows.T
        if np.linalg.eigvalsh(rest)[0] <= FREE:
            errors[inside] = np.inf
        else:
            errors[inside] = np.linalg.solve(rest, residuals[inside])
    return errors


def choose_simplest(errors: Sequence[float], margin: float = MARGIN) -> int:
    """Index of the chosen one of several models, the simplest first, by their left-out errors: a
    model with more coefficients must come below `margin` times the error of the best so far.
    """
    best = 0
    for k, error in enumerate(errors):
        if error < margin * errors[best]:
            best = k
    return best

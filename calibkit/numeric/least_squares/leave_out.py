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


def left_out_errors(
    design: Array, residuals: Array, *, weights: Array | None = None, groups: Array | None = None
) -> Array:
    """Errors [n] at rows that are left out of a linear least-squares fit, without fitting again
    (Allen 1974).

    Parameters
    ----------
    design
        [n, p].
    residuals
        [n], of the fit with the same weights.
    weights
        [n], as given to the fit; equal when absent.
    groups
        [n], label of the group that each row is left out with; each row by itself when absent.

    Returns
    -------
    [n], in the unit of the residuals; inf where the rows left out alone determine a coefficient.
    """
    root = np.ones(len(residuals)) if weights is None else np.sqrt(weights)
    q, _ = np.linalg.qr(design * root[:, None])
    if groups is not None:
        errors = np.empty(len(residuals))
        for label in np.unique(groups):
            own = groups == label
            errors[own] = _left_out(q[own], (root * residuals)[own]) / root[own]
        return errors
    free = 1.0 - np.sum(q**2, axis=1)
    return np.where(free > FREE, residuals / np.maximum(free, FREE), np.inf)


def choose_simplest(errors: Sequence[float], margin: float = MARGIN) -> int:
    """Index of the chosen one of several models, the simplest first, by their left-out errors: a
    model with more coefficients must come below `margin` times the error of the best so far.
    """
    best = 0
    for k, error in enumerate(errors):
        if error < margin * errors[best]:
            best = k
    return best


def _left_out(q: Array, residuals: Array) -> Array:
    """Errors [m] of a group left out, from its rows [m, p] of Q and its residuals [m]; inf where
    the group alone determines a coefficient.
    """
    rest = np.eye(len(residuals)) - q @ q.T
    if np.linalg.eigvalsh(rest)[0] <= FREE:
        return np.full(len(residuals), np.inf)
    return np.asarray(np.linalg.solve(rest, residuals), dtype=np.float64)

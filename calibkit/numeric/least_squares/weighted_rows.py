"""What row weights do to a linear fit in orthonormal columns: its solution, the leverage of each
row and the size of its residual.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric.dispersion import mad_sigma

LONGEST_LEVER = 1e14
"""Leverage against all other rows at which the balancing stops, so that a row that alone fixes a
coefficient still does.
"""
WELL_CONDITIONED = 1e-3
"""Pivot, relative to the largest, above which normal equations of an orthonormal basis lose nothing
that matters.
"""
DEPENDENT = 1e-9
"""Pivot, relative to the largest, below which a candidate's rows do not determine the coefficients.
"""


def solve(basis: Array, target: Array, row_weights: Array) -> Array | None:
    """Weighted solution [p], or None when the weighted rows do not determine it."""
    triangle = _triangle(basis, row_weights)
    if triangle is not None:
        half = np.linalg.solve(triangle.T, basis.T @ (row_weights * target))
        return np.asarray(np.linalg.solve(triangle, half), dtype=np.float64)
    root = np.sqrt(row_weights)
    q, r = np.linalg.qr(basis * root[:, None])
    pivots = np.abs(np.diag(r))
    if np.min(pivots) <= DEPENDENT * np.max(pivots):
        return None
    return np.asarray(np.linalg.solve(r, q.T @ (target * root)), dtype=np.float64)


def _triangle(basis: Array, row_weights: Array) -> Array | None:
    """R [p, p] with RᵀR = XᵀWX by Cholesky, or None where that would lose digits.

    The columns are orthonormal, so normal equations lose nothing until the weights take out rows
    that the columns were made of; then the caller factorises the rows themselves.
    """
    gram = (basis * row_weights[:, None]).T @ basis
    try:
        triangle = np.linalg.cholesky(gram).T
    except np.linalg.LinAlgError:
        return None
    pivots = np.diag(triangle)
    return (
        np.asarray(triangle, dtype=np.float64)
        if np.min(pivots) > WELL_CONDITIONED * np.max(pivots)
        else None
    )


def _hat(basis: Array, row_weights: Array) -> Array:
    """Rows X R⁻¹ [n, p] with RᵀR = XᵀWX: their squared lengths are leverages."""
    triangle = _triangle(basis, row_weights)
    if triangle is None:
        triangle = np.asarray(
            np.linalg.qr(basis * np.sqrt(row_weights)[:, None], mode="r"), dtype=np.float64
        )
    return basis @ np.linalg.inv(triangle)


def balance(basis: Array, row_weights: Array) -> Array:
    """Weights [n] that let no row count for far more than the others do, whatever its residual
    (Mallows 1975).

    A row is held back where its leverage against all others exceeds 1 (it counts for more than they
    do together) and four times what is usual in the basis.
    """
    leverage = np.sum(_hat(basis, row_weights) ** 2, axis=1)
    others = leverage / np.maximum(1.0 - row_weights * leverage, 1e-12)
    bound = max(1.0, 4.0 * float(np.median(others)))
    return np.asarray(bound / np.clip(others, bound, bound * LONGEST_LEVER), dtype=np.float64)


def studentise(basis: Array, target: Array, solution: Array, row_weights: Array) -> Array:
    """Residuals [n] over the factor by which the fit itself shrinks them, or widens those that it
    left out.
    """
    hat = _hat(basis, row_weights)
    leverage = np.sum(hat**2, axis=1)
    square = (hat * row_weights[:, None] ** 2).T @ hat
    variance = 1.0 - 2.0 * row_weights * leverage + np.sum(hat @ square * hat, axis=1)
    spread = np.sqrt(np.maximum(variance, 1e-12))
    return np.asarray((target - basis @ solution) / spread, dtype=np.float64)


def ratio(
    basis: Array,
    target: Array,
    solution: Array,
    row_weights: Array,
    scale: float,
    effects: Sequence[Integers],
) -> Array:
    """Sizes [n] of residuals over their scale; of the rows of an effect, over the spread about
    their median.

    A row that is left out is not let in again for standing far from all others: its residual is not
    divided by more than 1.
    """
    residual = target - basis @ solution
    sizes = np.abs(studentise(basis, target, solution, row_weights))
    sizes = np.maximum(sizes, np.abs(residual)) / scale
    for rows in effects:
        own = np.abs(residual[rows] - np.median(residual[rows]))
        sizes[rows] = np.minimum(sizes[rows], own / max(scale, mad_sigma(own)))
    return np.asarray(sizes, dtype=np.float64)

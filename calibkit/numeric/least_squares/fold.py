"""Linear least squares over many rows in the memory of a block.

The triangle R of a QR of [X y] keeps all that a fit needs of the rows; that of the blocks so far
and the next block give that of both (sequential orthogonal factorisation, Lawson & Hanson 1974, ch.
27). Steps of refinement with the residuals of the rows themselves give back the digits that the
folding costs (seminormal equations; Björck 1987).
"""

from collections.abc import Callable, Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric import chunks
from calibkit.numeric.least_squares import fit as least_squares

BLOCK_ROWS = 2048
"""Rows of a block: 150 kilobytes at nine columns, which stay in the cache."""
REFINEMENTS = 2
"""The second reaches the last digit of readings whose mean is large."""


def linear(
    design: Callable[[slice], Array],
    indication: Array,
    *,
    names: Sequence[str] = (),
    allocate: Callable[[int], Array] = np.empty,
) -> least_squares.LinearFit:
    """Fit indication = design · coefficients as `fit.linear` does, in the memory of a block.

    Parameters
    ----------
    design
        Columns [m, p] of a slice of rows.
    indication
        [n].
    names
        What the error calls the coefficients that the data cannot determine.
    allocate
        Makes the array of the residuals [n].

    Raises
    ------
    FitError
        As `fit.linear`.

    """
    rows = len(indication)

    R_of_all = np.empty((0, 0))
    for begin, stop in chunks.ranges(rows, BLOCK_ROWS):
        part = slice(begin, stop)
        block = np.column_stack([design(part), indication[part]])
        stacked = np.concatenate([R_of_all.reshape(-1, block.shape[1]), block])
        R_of_all = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
        chunks.release(indication)
    columns = R_of_all.shape[1] - 1
    solved = least_squares.linear(R_of_all[:, :columns], R_of_all[:, columns], names=names)
    R, residuals = R_of_all[:columns, :columns], allocate(rows)
    coefficients = solved.coefficients
    for _ in range(REFINEMENTS):
        gradient = _subtract(design, indication, coefficients, residuals)
        half = least_squares.triangular(R, gradient, trans="T")
        coefficients = coefficients + least_squares.triangular(R, half)
    _subtract(design, indication, coefficients, residuals)
    # not the sum of squares of the triangle, in which a large mean has cancelled the residuals
    square, dof = float(residuals @ residuals), rows - columns
    inverse = least_squares.triangular(R, np.eye(columns))
    covariance = inverse @ inverse.T * (square / dof if dof else 0.0)
    rms = float(np.sqrt(square / rows))
    return least_squares.LinearFit(coefficients, covariance, dof, rms, solved.condition, residuals)


def _subtract(
    design: Callable[[slice], Array], indication: Array, coefficients: Array, residuals: Array
) -> Array:
    """Write the residuals r [n] of coefficients [p]; the gradient Xᵀ r [p]."""
    gradient = np.zeros(coefficients.size)
    for begin, stop in chunks.ranges(len(indication), BLOCK_ROWS):
        part = slice(begin, stop)
        X = design(part)
        residuals[part] = indication[part] - X @ coefficients
        gradient += X.T @ residuals[part]
        chunks.release(indication, residuals)
    return gradient

"""Least squares over blocks of rows: one small triangle stands for any number of rows.

Well-conditioned rows go into normal equations (`gram`); others into a tall-skinny QR (Demmel,
Grigori, Hoemmen & Langou 2012): every block is factorised together with the triangle so far, so the
digits are those of an orthogonal factorisation. Either way the memory is that of a block, and the
block stays in the cache.
"""

from collections.abc import Callable, Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric import chunks
from calibkit.numeric.least_squares import fit as least_squares, gram

BLOCK_ROWS = 2048
"""Rows of a block that is factorised: 150 kilobytes at nine columns, which stay in the cache."""


def triangle(block: Callable[[slice], Array], rows: int, size: int = BLOCK_ROWS) -> Array:
    """R [min(rows, p), p] of the rows that `block` gives slice by slice, each [m, p]."""
    folded: Array | None = None
    for part in gram.blocks(rows, size):
        stacked = block(part) if folded is None else np.concatenate([folded, block(part)])
        folded = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
    return np.zeros((0, 0)) if folded is None else folded


def reduced(
    design: Callable[[slice], Array],
    indication: Array,
    *,
    weights: Array | None = None,
    names: Sequence[str] = (),
) -> gram.Reduced:
    """Fit indication = design · coefficients as `fit.linear` does, in the memory of a block.

    Parameters
    ----------
    design
        Columns [m, p] of a slice of rows; the slice may have a step. Fastest where each column is
        contiguous.
    indication
        [n].
    weights
        [n], proportional to 1/variance of each row; equal when absent.
    names
        What the error calls the coefficients that the data cannot determine.

    Raises
    ------
    FitError
        As `fit.linear`.

    """
    rows = len(indication)
    found = gram.solve(design, indication, weights)
    if found is not None:
        return found

    def weighted(part: slice) -> Array:
        chunks.release(indication)
        stacked = np.column_stack([design(part), indication[part]])
        return stacked if weights is None else stacked * np.sqrt(weights[part, None])

    whole = triangle(weighted, rows)
    columns = whole.shape[1] - 1
    solved = least_squares.linear(whole[:, :columns], whole[:, columns], names=names)
    coefficients = _corrected(
        design, indication, weights, whole[:columns, :columns], solved.coefficients
    )
    dof = rows - columns
    # the triangle has p + 1 rows, one degree of freedom, and the same sum of squares
    square = float(np.sum(solved.residuals**2))
    covariance = solved.covariance * (solved.dof / max(dof, 1))
    rms = float(np.sqrt(square / float(rows if weights is None else np.sum(weights))))
    return gram.Reduced(coefficients, covariance, dof, rms, solved.condition)


def linear(
    design: Callable[[slice], Array],
    indication: Array,
    *,
    weights: Array | None = None,
    names: Sequence[str] = (),
    allocate: Callable[[int], Array] = np.empty,
) -> least_squares.LinearFit:
    """Fit as `reduced` does, and give the residuals [n] too, in an array that `allocate` makes.

    Raises
    ------
    FitError
        As `fit.linear`.

    """
    found = reduced(design, indication, weights=weights, names=names)
    residuals = gram.residuals(design, indication, found.coefficients, allocate=allocate)
    return least_squares.with_residuals(found, residuals)


def _corrected(
    design: Callable[[slice], Array],
    indication: Array,
    weights: Array | None,
    r: Array,
    coefficients: Array,
) -> Array:
    """Coefficients [p] after one step with the residuals of the rows themselves, by the seminormal
    equations of R [p, p].
    """
    gradient = np.zeros(coefficients.size)
    for part in gram.blocks(len(indication), gram.block_rows(coefficients.size)):
        columns = design(part)
        pulled = indication[part] - columns @ coefficients
        gradient += columns.T @ (pulled if weights is None else pulled * weights[part])
        chunks.release(indication)
    half = least_squares.triangular(r, gradient, trans="T")
    return np.asarray(coefficients + least_squares.triangular(r, half), dtype=np.float64)

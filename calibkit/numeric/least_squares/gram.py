"""Normal equations over blocks of rows, for as long as they lose no digits.

The Gram matrix XᵀX squares the condition number, which costs the digits that an orthogonal
factorisation keeps; it is also many times as fast and never holds more than a block. Two things
make it safe. It is formed about an approximate solution, from the residuals there, so that rounding
touches a small correction only, never the coefficients themselves (one step of iterative
refinement, which is the fixed-precision form of Björck 1987, "Stability analysis of the method of
seminormal equations"). And it is used only where its own eigenvalues show a condition number that
leaves the correction its digits; elsewhere `solve` gives nothing, and the caller factorises the
rows.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric import chunks

TALL = 20_000
"""Rows from which normal equations over blocks are the faster way."""
BLOCK_VALUES = 1 << 16
"""Numbers in the design of a block: half a mebibyte, so that it and what is made of it stay in a
second-level cache.
"""
SAMPLE_ROWS = 4096
"""Evenly spread rows that the approximate solution is fitted to."""
WORST_CONDITION = 1e4
"""Condition number of the scaled columns up to which normal equations are used: a correction keeps
eight digits.
"""
PASSES = 4


@dataclass(frozen=True, slots=True)
class Reduced:
    """What a linear fit leaves of any number of rows: nothing in it grows with them."""

    coefficients: Array
    """[p]."""
    covariance: Array
    """[p, p], type A."""
    dof: int
    residual_rms: float
    """Root of the weighted mean square [unit of the indication]."""
    condition: float
    """Of the columns scaled to unit length, within a power of two each."""

    @property
    def standard_uncertainty(self) -> Array:
        """Square roots of the covariance's diagonal [p]."""
        return np.sqrt(np.diag(self.covariance))


def blocks(rows: int, size: int) -> Iterator[slice]:
    """Slices that cover the rows in order."""
    return (slice(begin, min(begin + size, rows)) for begin in range(0, rows, size))


def block_rows(columns: int) -> int:
    """Rows of a block of so many columns."""
    return max(BLOCK_VALUES // max(columns, 1), 1)


def residuals(
    design: Callable[[slice], Array],
    indication: Array,
    coefficients: Array,
    *,
    allocate: Callable[[int], Array] = np.empty,
) -> Array:
    """Residuals [n] of an indication [n] from coefficients [p] and the columns [m, p] of slices of
    rows.

    `allocate` makes their array.
    """
    left = allocate(len(indication))
    for part in blocks(len(indication), block_rows(coefficients.size)):
        np.matmul(design(part), coefficients, out=left[part])
        np.subtract(indication[part], left[part], out=left[part])
        chunks.release(indication, left)
    return left


def solve(
    design: Callable[[slice], Array], indication: Array, weights: Array | None = None
) -> Reduced | None:
    """Least-squares fit by normal equations; None for fewer than 20,000 rows, where they would lose
    digits, or where a value is not finite.

    Parameters
    ----------
    design
        Columns [m, p] of a slice of rows, which may have a step. Fastest where each column is
        contiguous.
    indication
        [n].
    weights
        [n], proportional to 1/variance of each row; equal when absent.

    Notes
    -----
    At an approximate solution c with residuals r = y − Xc the correction is δ = (XᵀWX)⁻¹ XᵀWr, and
    the sum of squares is rᵀWr − δᵀXᵀWr, of which neither cancels while δ is small; another pass
    follows until it is.
    """
    rows = len(indication)
    found = _sampled(design, indication, weights) if rows >= TALL else None
    if found is None:
        return None
    for _ in range(PASSES):
        gram, gradient, square = _sums(design, indication, weights, found)
        scale = np.sqrt(np.diag(gram))
        if not (np.isfinite(gram).all() and np.isfinite(square) and (scale > 0.0).all()):
            return None
        values, vectors = np.linalg.eigh(gram / scale / scale[:, None])
        if values[0] * WORST_CONDITION**2 <= values[-1]:
            return None
        inverse = (vectors / values) @ vectors.T / scale / scale[:, None]
        step = inverse @ gradient
        found = found + step
        lowered = float(step @ gradient)
        share = float(np.linalg.norm(scale * step)) / max(
            float(np.linalg.norm(scale * found)), 1e-300
        )
        # the correction has a relative error of the squared condition number's roundings
        small = share * float(values[-1] / values[0]) <= 4.0
        if small and (lowered <= square / 2.0 or share <= 1e-15):
            square, dof = max(square - lowered, 0.0), rows - found.size
            rms = float(np.sqrt(square / float(rows if weights is None else np.sum(weights))))
            condition = float(np.sqrt(values[-1] / values[0]))
            return Reduced(found, inverse * (square / dof), dof, rms, condition)
    return None


def matrix(design: Callable[[slice], Array], rows: int) -> Array:
    """Gram matrix XᵀX [p, p] of the columns [m, p] of slices of rows."""
    parts = (design(part) for part in blocks(rows, SAMPLE_ROWS))
    return np.asarray(sum(product(columns, columns) for columns in parts), dtype=np.float64)


def condensed(design: Callable[[slice], Array], rows: int) -> Array:
    """Rows [p, p] with the Gram matrix of all rows: their singular values are right to 1e-8 of the
    largest, no closer.
    """
    values, vectors = np.linalg.eigh(matrix(design, rows))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T, dtype=np.float64)


def _sampled(
    design: Callable[[slice], Array], indication: Array, weights: Array | None
) -> Array | None:
    """Solution [p] for evenly spread rows, of least norm where they do not determine it; None where
    one is not finite.
    """
    part = slice(0, len(indication), 1 + len(indication) // SAMPLE_ROWS)
    root = 1.0 if weights is None else np.sqrt(weights[part])
    rows, target = (design(part).T * root).T, chunks.take_slice(indication, part) * root
    if not (np.isfinite(rows).all() and np.isfinite(target).all()):
        return None
    length = np.linalg.norm(rows, axis=0)
    length[length == 0.0] = 1.0
    return np.asarray(
        np.linalg.lstsq(rows / length, target, rcond=1e-10)[0] / length, dtype=np.float64
    )


def _sums(
    design: Callable[[slice], Array], indication: Array, weights: Array | None, about: Array
) -> tuple[Array, Array, float]:
    """Gram matrix XᵀWX [p, p], gradient XᵀWr [p] and sum of squares rᵀWr of the residuals about
    given coefficients.
    """
    count, size = about.size, block_rows(about.size)
    gram, gradient, square = np.zeros((count, count)), np.zeros(count), 0.0
    buffer = np.empty(min(size, len(indication)))
    for part in blocks(len(indication), size):
        columns, residual = design(part), buffer[: part.stop - part.start]
        np.matmul(columns, about, out=residual)
        np.subtract(indication[part], residual, out=residual)
        weighted, pulled = columns, residual
        if weights is not None:
            weighted, pulled = (columns.T * weights[part]).T, residual * weights[part]
        gram += product(columns, weighted)
        gradient += columns.T @ pulled
        square += float(residual @ pulled)
        chunks.release(indication)
    return gram, gradient, square


def product(columns: Array, weighted: Array) -> Array:
    """Gram matrix XᵀWX [p, p] of a block's columns and weighted columns [m, p].

    Without its last column, which the symmetry gives: for the product of a matrix with itself BLAS
    is asked for half of the entries, and at few columns takes three times as long for them.
    """
    gram = np.empty((columns.shape[1], columns.shape[1]))
    np.matmul(columns.T, weighted[:, :-1], out=gram[:, :-1])
    gram[:-1, -1] = gram[-1, :-1]
    gram[-1, -1] = columns[:, -1] @ weighted[:, -1]
    return gram

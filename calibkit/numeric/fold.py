"""Least squares over blocks of rows: one small triangle holds all that any number of rows say.

Tall-skinny QR (Demmel, Grigori, Hoemmen & Langou 2012): every block is factorised together with the triangle so far, so the
digits are those of an orthogonal factorisation, the memory is that of a block, and the block stays in the cache.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric import fit as least_squares

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

BLOCK_ROWS = 2048
"""Rows of a block: 150 kilobytes at nine columns, which stay in the cache."""


def blocks(rows: int, size: int = BLOCK_ROWS) -> Iterator[slice]:
    """Slices that cover the rows in order."""
    return (slice(begin, min(begin + size, rows)) for begin in range(0, rows, size))


def triangle(block: Callable[[slice], Array], rows: int, size: int = BLOCK_ROWS) -> Array:
    """R [min(rows, p), p] of the rows that `block` gives slice by slice, each [m, p]."""
    folded: Array | None = None
    for part in blocks(rows, size):
        stacked = block(part) if folded is None else np.concatenate([folded, block(part)])
        folded = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
    return np.zeros((0, 0)) if folded is None else folded


def linear(
    design: Callable[[slice], Array], indication: Array, *, weights: Array | None = None, names: Sequence[str] = ()
) -> least_squares.LinearFit:
    """Fit indication = design · coefficients as `fit.linear` does, with the design made block by block.

    Parameters
    ----------
    design
        Columns [m, p] of a slice of rows.
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
    root = np.ones(rows) if weights is None else np.sqrt(weights)
    whole = triangle(lambda part: np.column_stack([design(part), indication[part]]) * root[part, None], rows)
    columns = whole.shape[1] - 1
    reduced = least_squares.linear(whole[:, :columns], whole[:, columns], names=names)
    residuals = np.empty(rows)
    for part in blocks(rows):
        residuals[part] = indication[part] - design(part) @ reduced.coefficients
    # the triangle has p + 1 rows, one degree of freedom, and the same sum of squares
    covariance = reduced.covariance * (reduced.dof / max(rows - columns, 1))
    rms = float(np.sqrt(np.sum((root * residuals) ** 2) / np.sum(root**2)))
    return least_squares.LinearFit(reduced.coefficients, covariance, residuals, rows - columns, rms, reduced.condition)

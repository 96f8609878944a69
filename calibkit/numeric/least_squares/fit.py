"""Linear least squares that loses no digits and names the coefficients that the data cannot
determine.

    X = Q R,   R c = Qᵀ y

The triangle R of a QR of [X y] keeps all that a fit needs of many rows: that of the blocks so far
and the next block give that of both (Lawson & Hanson 1974, ch. 27).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array

RANK_TOLERANCE = 1e-11
"""Smallest singular value, relative to the largest after column scaling, that still counts as
determined.
"""
REFINE_ABOVE = 1e3
"""Condition number of the scaled columns above which the last digits are recovered by refinement.
"""
REFINEMENT_STEPS = 4
BLOCK_ROWS = 2048
"""Rows of a block: 150 kilobytes at nine columns, which stay in the cache."""
BLOCK_REFINEMENTS = 2
"""The second reaches the last digit of readings whose mean is large."""


@dataclass(frozen=True, slots=True)
class LinearFit:
    """A finished linear fit."""

    coefficients: Array
    """[p]."""
    covariance: Array
    """[p, p], type A."""
    dof: int
    residual_rms: float
    """Root of the mean square [unit of the indication]."""
    condition: float
    """Of the columns scaled to unit length, within a power of two each."""
    residuals: Array
    """[n], in the unit of the indication."""

    @property
    def standard_uncertainty(self) -> Array:
        """Square roots of the covariance's diagonal [p]."""
        return np.sqrt(np.diag(self.covariance))


def linear(design: Array, indication: Array, *, names: Sequence[str] = ()) -> LinearFit:
    """Fit indication = design · coefficients by orthogonal factorisation of the scaled columns.

    Parameters
    ----------
    design : [n, p], one column per coefficient.
    indication : [n].
    names : what the error calls the coefficients that the data cannot determine.

    Returns
    -------
    LinearFit, whose covariance is scaled by the residual variance with n − p degrees of freedom
    (zeros when n = p).

    Raises
    ------
    FitError : fewer rows than coefficients, a value that is not finite, or columns that are
        linearly dependent.

    Notes
    -----
    Columns are scaled to unit length, so that rank does not depend on units; rank is read from the
    singular values of R (relative 1e-11, never a cut that grows with n); the solution of an
    ill-conditioned system is refined by residuals in extended precision (Golub & Wilkinson 1966).
    """
    rows, columns = design.shape
    names = tuple(names) or tuple(f"column {j}" for j in range(columns))
    if rows < columns:
        raise FitError(
            f"{rows} rows for {columns} coefficients ({', '.join(names)})",
            hint="add data or lower the order",
        )
    if not (np.isfinite(design).all() and np.isfinite(indication).all()):
        raise FitError(
            "a value that is not finite reached the fit", hint="exclude the rows that hold it"
        )
    scale = _exact_scale(design)
    scaled = design / scale
    q, r = np.linalg.qr(scaled)
    singular = np.linalg.svd(r, compute_uv=False)
    # rank is judged after scaling, so that °C and K, g and mg, give the same answer
    if singular[-1] <= RANK_TOLERANCE * singular[0]:
        loose = undetermined(r, names)
        raise FitError(
            f"the data cannot determine {', '.join(loose)}: rank {rank(r)} of {columns}",
            hint="vary what these terms multiply, or take them out of the model",
        )
    condition = float(singular[0] / singular[-1])
    solution = triangular(r, q.T @ indication)
    if condition > REFINE_ABOVE:
        # residuals in 64 bits of mantissa give back the digits that the condition number costs
        wide = scaled.astype(np.longdouble)
        for _ in range(REFINEMENT_STEPS):
            residual = np.asarray(indication - wide @ solution, dtype=np.float64)
            solution = solution + triangular(r, q.T @ residual)
    coefficients = solution / scale
    residuals = indication - design @ coefficients
    dof = rows - columns
    square = float(np.sum(residuals**2))
    # (XᵀX)⁻¹ = R⁻¹ R⁻ᵀ: XᵀX itself would square the condition number
    inverse = triangular(r, np.eye(columns)) / scale[:, None]
    covariance = inverse @ inverse.T * (square / dof if dof else 0.0)
    rms = float(np.sqrt(square / rows))
    return LinearFit(coefficients, covariance, dof, rms, condition, residuals)


def linear_in_blocks(
    design: Callable[[slice], Array], indication: Array, *, names: Sequence[str] = ()
) -> Array:
    """Coefficients [p] of `linear` of many rows, in the memory of a block; `design` gives the
    columns [m, p] of a slice of rows.

    Steps of refinement with the residuals of the rows themselves give back the digits that the
    folding costs (seminormal equations; Björck 1987). Raises FitError as `linear`.
    """
    folded = np.empty((0, 0))
    blocks = [slice(*ends) for ends in chunks.ranges(len(indication), BLOCK_ROWS)]
    for rows in blocks:
        block = np.column_stack([design(rows), indication[rows]])
        stacked = np.concatenate([folded.reshape(-1, block.shape[1]), block])
        # the triangle of the triangle so far and the next block: all that a fit needs of both
        folded = np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)
    coefficients = linear(folded[:, :-1], folded[:, -1], names=names).coefficients
    R = folded[: coefficients.size, :-1]
    for _ in range(BLOCK_REFINEMENTS):
        gradient = np.zeros(coefficients.size)
        for rows in blocks:
            X = design(rows)
            gradient += X.T @ (indication[rows] - X @ coefficients)
        # seminormal equations Rᵀ R δ = Xᵀ r
        half = triangular(R, gradient, trans="T")
        coefficients = coefficients + triangular(R, half)
    return coefficients


def triangular(r: Array, right: Array, *, trans: Literal["N", "T"] = "N") -> Array:
    """Solution of R x = b, or of Rᵀ x = b with trans = "T", for an upper triangle R [p, p] and b
    [p] or [p, k].
    """
    from scipy.linalg import solve_triangular  # slow to import: logs can be read meanwhile

    return np.asarray(solve_triangular(r, right, trans=trans), dtype=np.float64)


def undetermined(design: Array, names: Sequence[str]) -> list[str]:
    """Names of the coefficients that the columns of design [n, p] leave undetermined; empty when
    all are determined.
    """
    scaled = design / _exact_scale(design)
    r = np.linalg.qr(scaled, mode="r") if design.shape[0] >= design.shape[1] else scaled
    _, singular, vt = np.linalg.svd(r)
    padded = np.zeros(design.shape[1])
    padded[: singular.size] = singular
    # combinations of coefficients that change nothing; whoever takes part in one is not determined
    null = vt[padded <= RANK_TOLERANCE * max(float(padded[0]), np.finfo(float).tiny)]
    involved = np.any(np.abs(null) > 1e-6, axis=0)
    return [name for name, loose in zip(names, involved, strict=True) if loose]


def rank(design: Array) -> int:
    """Numerical rank of design [n, p] after scaling its columns to unit length."""
    singular = np.linalg.svd(design / _exact_scale(design), compute_uv=False)
    return (
        int(np.sum(singular > RANK_TOLERANCE * singular[0]))
        if singular.size and singular[0] > 0.0
        else 0
    )


def _exact_scale(design: Array) -> Array:
    """Powers of two [p] near the columns' lengths: scaling by them rounds nothing."""
    length = np.linalg.norm(design, axis=0)
    return np.asarray(
        np.exp2(np.round(np.log2(np.where(length > 0.0, length, 1.0)))), dtype=np.float64
    )

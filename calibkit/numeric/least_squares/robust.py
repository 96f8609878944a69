"""Linear least squares that a few outliers cannot move, with the suspects named.

Two faults hide an outlier from ordinary residuals: it drags the fit towards itself, the more the
higher its leverage, and several of them hide one another. So the start is the best of Huber's
fit and of fits with rows left out along the principal sensitivity components (Peña & Yohai 1999);
the finish is Tukey's biweight on residuals studentised by leverage, at the scale of the start
(Yohai 1987).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric.dispersion import mad_sigma
from calibkit.numeric.least_squares import fit as least_squares

HUBER = 1.345
"""Studentised residual above which Huber's weights fall: 95 % efficient on normal noise (Huber
1981).
"""
TUKEY = 4.685
"""Studentised residual above which Tukey's weight is 0: 95 % efficient on normal noise (Beaton &
Tukey 1974).
"""
SUSPECT = 4.0
"""Studentised residual above which a row is named: 6 of 100,000 normal rows."""
LEFT_OUT = 0.2
"""Share of the rows that a candidate start leaves out along each component."""
CLEANED = 2.5
"""Studentised residual above which the start's own refinement leaves a row out."""
ITERATIONS = 60
TOLERANCE = 1e-10
"""A change of the fitted values, relative to the noise, that ends an iteration."""
AT_REST = 1e-3
"""A change of nonlinear parameters, in standard uncertainties, that ends their iteration."""
SPARE_ROWS = 5
"""Degrees of freedom below which residuals cannot tell an outlier from a good row."""
ROUNDING = 1e-13
"""Residuals this small, relative to the indications, are rounding: no row is suspect for them."""
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


@dataclass(frozen=True, slots=True)
class _RobustFit:
    """A finished robust fit."""

    fit: least_squares.LinearFit
    """Residuals of all rows; covariance, residual rms, dof and condition of the rows that were
    kept.
    """
    row_weights: Array
    """[n], Tukey's weight: near 1 for a row that is kept, 0 for one that is left out."""
    studentised: Array
    """[n], residual over its own standard deviation."""

    @property
    def suspects(self) -> tuple[int, ...]:
        """Rows, by index, whose residual no noise explains, the worst first."""
        worst_first = np.argsort(-np.abs(self.studentised), kind="stable")
        return tuple(int(i) for i in worst_first if abs(self.studentised[i]) > SUSPECT)


def linear(
    design: Array, indication: Array, *, weights: Array | None = None, names: Sequence[str] = ()
) -> _RobustFit:
    """Fit indication = design · coefficients so that no few rows move it: an MM-estimate.

    Parameters
    ----------
    design
        [n, p], one column a coefficient.
    indication
        [n].
    weights
        [n], proportional to 1/variance of each row; equal when absent.
    names
        What the error calls the coefficients that the data cannot determine.

    Returns
    -------
    RobustFit, whose covariance is Huber's for M-estimates (1981, eq. 7.6.6) over the rows that were
    kept.

    Raises
    ------
    FitError
        As `fit.linear`, also for the rows that remain; and for fewer than p + 5 rows, where none
        can be told to be an outlier.

    """
    rows, columns = design.shape
    whole = least_squares.linear(design, indication, weights=weights, names=names)
    if whole.dof < SPARE_ROWS:
        raise FitError(
            f"{rows} rows for {columns} coefficients cannot show which row is wild",
            hint=(
                f"a robust fit needs at least {columns + SPARE_ROWS} rows: add dwells or use the"
                " plain fit"
            ),
        )
    root = np.ones(rows) if weights is None else np.sqrt(weights)
    weighted = design * root[:, None]
    basis, _ = np.linalg.qr(weighted / np.linalg.norm(weighted, axis=0))
    target = indication * root
    floor = ROUNDING * float(np.max(np.abs(target)))
    solution, row_weights = _start(basis, target, floor)
    scale = max(mad_sigma(_studentised(basis, target, solution, row_weights)), floor)
    solution, row_weights = _reweighted(
        basis, target, solution, row_weights, scale=scale, biweight=True
    )
    studentised = _studentised(basis, target, solution, row_weights) / scale
    kept = np.abs(studentised) < TUKEY
    final = least_squares.linear(
        design[kept],
        indication[kept],
        weights=(root * np.sqrt(row_weights))[kept] ** 2,
        names=names,
    )
    balance = _balanced(basis, row_weights)[kept]
    covariance = _m_covariance(weighted[kept], balance, studentised[kept], scale)
    residuals = indication - design @ final.coefficients
    good = np.abs(studentised) <= SUSPECT
    rms = float(np.sqrt(np.sum((root * residuals)[good] ** 2) / np.sum(root[good] ** 2)))
    finished = least_squares.LinearFit(
        final.coefficients, covariance, int(good.sum()) - columns, rms, final.condition, residuals
    )
    return _RobustFit(finished, row_weights, studentised)


def nonlinear(
    linearised: Callable[[Array], tuple[Array, Array]], start: Array, *, names: Sequence[str] = ()
) -> tuple[Array, _RobustFit]:
    """Robust fit of a nearly linear problem: robust fits of its linearisation until the parameters
    rest.

    Parameters
    ----------
    linearised
        Weighted residuals [n] and derivatives [n, p] at parameters [p].
    start
        [p], the least-squares solution.
    names
        What the error calls the parameters.

    Returns
    -------
    Parameters [p] and the last linear fit, for its covariance and suspects.

    Raises
    ------
    FitError
        As `linear`, and when the parameters do not come to rest.

    """
    parameters = start
    for _ in range(ITERATIONS):
        residual, slopes = linearised(parameters)
        step = linear(slopes, -residual, names=names)
        parameters = parameters + step.fit.coefficients
        if float(np.max(np.abs(step.fit.coefficients) / step.fit.standard_uncertainty)) < AT_REST:
            return parameters, step
    raise FitError(
        "the robust fit does not come to rest", hint="use the plain fit and look at its residuals"
    )


def _start(basis: Array, target: Array, floor: float) -> tuple[Array, Array]:
    """Candidate with the smallest robust scale, refined on the rows that agree with it: solution
    [p], row weights [n].
    """
    candidates = (
        (mad_sigma(_studentised(basis, target, *candidate)), *candidate)
        for candidate in _candidates(basis, target, floor)
    )
    # the first candidate, Huber's, always exists
    start = (0.0, np.zeros(basis.shape[1]), np.ones(len(target)))
    scale, solution, row_weights = min(candidates, key=lambda found: found[0], default=start)
    for _ in range(3):
        agreeing = np.abs(_studentised(basis, target, solution, row_weights)) <= CLEANED * max(
            scale, floor
        )
        refined = _solved(basis, target, agreeing.astype(np.float64))
        if refined is None:
            break
        solution, row_weights = refined, agreeing.astype(np.float64)
        scale = mad_sigma(_studentised(basis, target, solution, row_weights))
    return solution, row_weights


def _candidates(basis: Array, target: Array, floor: float) -> Iterator[tuple[Array, Array]]:
    """Huber's fit, and fits with the extreme rows of each principal sensitivity component left
    out.
    """
    rows, columns = basis.shape
    plain = _solved(basis, target, np.ones(rows))
    if plain is None:
        return
    scale = max(mad_sigma(_studentised(basis, target, plain, np.ones(rows))), floor)
    yield _reweighted(basis, target, plain, np.ones(rows), scale=scale, biweight=False)
    residual = target - basis @ plain
    deleted = residual / np.maximum(1.0 - np.sum(basis**2, axis=1), 1e-12)
    _, vectors = np.linalg.eigh((basis * deleted[:, None] ** 2).T @ basis)
    count = min(int(LEFT_OUT * rows), rows - columns - SPARE_ROWS)
    for component in (basis @ vectors).T:
        for measure in (component, -component, np.abs(component)):
            kept = np.ones(rows)
            kept[np.argsort(measure, kind="stable")[rows - count :]] = 0.0
            solution = _solved(basis, target, kept)
            if solution is not None:
                yield solution, kept


def _reweighted(
    basis: Array,
    target: Array,
    solution: Array,
    row_weights: Array,
    *,
    scale: float,
    biweight: bool,
) -> tuple[Array, Array]:
    """Iteratively reweighted least squares at a fixed scale: solution [p] and row weights [n]."""
    for _ in range(ITERATIONS):
        ratio = np.abs(_studentised(basis, target, solution, row_weights)) / scale
        if biweight:
            # a row that is left out is not let in again for standing far from all others
            ratio = np.maximum(ratio, np.abs(target - basis @ solution) / scale)
            proposed = (1.0 - np.minimum(ratio / TUKEY, 1.0) ** 2) ** 2 * _balanced(
                basis, row_weights
            )
        else:
            proposed = HUBER / np.maximum(ratio, HUBER)
        moved = _solved(basis, target, proposed)
        if moved is None:
            raise FitError(
                "too few rows agree with one another for a robust fit",
                hint="check the references by eye",
            )
        done = float(np.max(np.abs(basis @ (moved - solution)))) <= TOLERANCE * scale
        solution, row_weights = moved, proposed
        if done:
            break
    return solution, row_weights


def _solved(basis: Array, target: Array, row_weights: Array) -> Array | None:
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


def _balanced(basis: Array, row_weights: Array) -> Array:
    """Weights [n] that let no row count for far more than the others do, whatever its residual
    (Mallows 1975).

    A row is held back where its leverage against all others exceeds 1 (it counts for more than they
    do together) and four times what is usual in the basis.
    """
    leverage = np.sum(_hat(basis, row_weights) ** 2, axis=1)
    others = leverage / np.maximum(1.0 - row_weights * leverage, 1e-12)
    bound = max(1.0, 4.0 * float(np.median(others)))
    return np.asarray(bound / np.clip(others, bound, bound * LONGEST_LEVER), dtype=np.float64)


def _studentised(basis: Array, target: Array, solution: Array, row_weights: Array) -> Array:
    """Residuals [n] over the factor by which the fit itself shrinks them, or widens those that it
    left out.
    """
    hat = _hat(basis, row_weights)
    leverage = np.sum(hat**2, axis=1)
    square = (hat * row_weights[:, None] ** 2).T @ hat
    variance = 1.0 - 2.0 * row_weights * leverage + np.sum(hat @ square * hat, axis=1)
    spread = np.sqrt(np.maximum(variance, 1e-12))
    return np.asarray((target - basis @ solution) / spread, dtype=np.float64)


def _m_covariance(design: Array, balance: Array, studentised: Array, scale: float) -> Array:
    """Huber's covariance [p, p] of an M-estimate from the rows [m, p] that were kept, their
    balance and studentised residuals.
    """
    rows, columns = design.shape
    ratio = (studentised / TUKEY) ** 2
    influence = studentised * (1.0 - ratio) ** 2
    slope = (1.0 - ratio) * (1.0 - 5.0 * ratio)
    mean = float(np.mean(slope))
    correction = 1.0 + columns / rows * float(np.var(slope)) / mean**2
    # residuals are studentised already: their mean square needs no n/(n − p)
    variance = (scale * correction / mean) ** 2 * float(np.mean(influence**2))
    length = np.linalg.norm(design, axis=0)
    bread = (
        np.linalg.inv(np.linalg.qr(design / length * np.sqrt(balance)[:, None], mode="r"))
        / length[:, None]
    )
    weighted = design * balance[:, None] @ bread
    return np.asarray(variance * (bread @ (weighted.T @ weighted) @ bread.T), dtype=np.float64)

"""Linear least squares that a few outliers cannot move, an MM-estimate (Yohai 1987).

Several outliers hide one another from ordinary residuals, and one of high leverage hides itself. So
the fit starts where the residuals have the smallest robust scale: the S-estimate (Rousseeuw & Yohai
1984), of which up to half of the rows may be outliers; of few rows it starts from Huber's fit. It
ends with Tukey's biweight at that scale.

    Σ ρ(r/(c s)) = ½ (n - p),   ρ(x) = 1 - (1 - x²)³ to |x| = 1, then 1       scale s of residuals r
    w = (1 - (r/(4.685 s))²)², 0 beyond                                     weights of the last fit
"""

from dataclasses import dataclass

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array
from calibkit.numeric.dispersion import MAD_TO_SIGMA
from calibkit.numeric.least_squares import fit as least_squares

HUBER = 1.345
"""Residual over the scale above which Huber's weights fall: 95 % efficient on normal noise (Huber
1981).
"""
TUKEY = 4.685
"""Residual over the scale above which Tukey's weight is 0: 95 % efficient on normal noise (Beaton &
Tukey 1974).
"""
BISQUARE, LOSS = 1.547645, 0.5
"""Tuning constant of Tukey's loss, and its mean on normal noise, 1 being that of an outlier: the
share of outliers that the S-estimate bears.
"""
ITERATIONS = 60
TOLERANCE = 1e-10
"""A change of the fitted values, relative to the noise, that ends an iteration."""
SPARE_ROWS = 5
"""Degrees of freedom below which residuals cannot tell an outlier from a good row."""
ROUNDING = 1e-13
"""Residuals this small, relative to the indications, are rounding: no row is suspect for them."""
ROWS_A_COEFFICIENT = 5
"""Rows a coefficient from which on an S-estimate is made: of fewer, some agree by chance."""
SETS = 200
"""Sets of rows that are tried: of 10 coefficients and 20 % of outliers one set in ten is clean."""
ENOUGH_ROWS = 400
"""Rows that rank the sets; of more, this many are drawn."""
FOLLOWED, BEST = 30, 4
"""Sets that are followed by a few steps, and to the end."""
FIRST_STEPS, MOST_STEPS = 2, 20
"""Steps towards the agreeing rows before the best are chosen and after it."""
OPEN = 1e-8
"""Eigenvalue of the normal equations, over the sum of weights, below which a set of rows leaves a
direction open: columns are of size 1.
"""
SEED = 2006


@dataclass(frozen=True, slots=True)
class RobustFit:
    """A finished robust fit."""

    coefficients: Array
    """[p]."""
    residuals: Array
    """[n], of all rows, in the unit of the indication."""
    row_weights: Array
    """[n], Tukey's weight: near 1 for a row that is kept, 0 for one that is left out."""


def linear(design: Array, indication: Array) -> RobustFit:
    """Fit indication [n] = design [n, p] · coefficients so that a few wrong rows do not move it.

    The rows have equal noise. The fit states no uncertainty: who needs one fits the rows that have
    a weight again.

    Raises FitError as `fit.linear`; and for fewer than p + 5 rows, too few to find an outlier
    among them.
    """
    rows, columns = design.shape
    least_squares.linear(design, indication)  # refuses what no rows determine
    if rows - columns < SPARE_ROWS:
        raise FitError(
            f"{rows} rows for {columns} coefficients cannot show which row is an outlier",
            hint=(
                f"a robust fit needs at least {columns + SPARE_ROWS} rows: add dwells or use the"
                " plain fit"
            ),
        )
    # sizes of columns in which no single row has a say: the largest may be that of an outlier
    size, largest = np.quantile(np.abs(design), 0.9, axis=0), np.max(np.abs(design), axis=0)
    # a column that is 0 in most rows has its largest for a length
    lengths = np.where(size > OPEN * largest, size, largest)
    basis = design / lengths
    products = _products(basis)
    floor = max(ROUNDING * float(np.max(np.abs(indication))), float(np.finfo(np.float64).tiny))
    too_few = rows < ROWS_A_COEFFICIENT * columns
    solution, scale = (_fit_huber if too_few else _search_s_estimate)(
        basis, products, indication, floor
    )
    weights = np.ones(rows)
    for _ in range(ITERATIONS):
        ratio = np.abs(indication - basis @ solution) / scale
        # Tukey's weights at the scale of the start, which is held: that makes it an MM-estimate
        weights[:] = (1.0 - np.minimum(ratio / TUKEY, 1.0) ** 2) ** 2
        before = solution
        solution = _fit_sets(basis, products, indication, before[None, :], weights[None, :])[0]
        if np.max(np.abs(basis @ (solution - before))) <= TOLERANCE * scale:
            break
    coefficients = solution / lengths
    return RobustFit(coefficients, indication - design @ coefficients, weights)


def _fit_huber(basis: Array, products: Array, target: Array, floor: float) -> tuple[Array, float]:
    """Solution [p] with Huber's weights at the robust scale of its residuals, and that scale."""
    rows, columns = basis.shape
    solution = np.asarray(np.linalg.lstsq(basis, target, rcond=None)[0], dtype=np.float64)
    scale = floor
    for _ in range(ITERATIONS):
        residual_size = np.abs(target - basis @ solution)
        scale = max(
            MAD_TO_SIGMA * float(np.median(residual_size)) * np.sqrt(rows / (rows - columns)), floor
        )
        weights = HUBER / np.maximum(residual_size / scale, HUBER)
        solution = _fit_sets(basis, products, target, solution[None, :], weights[None, :])[0]
    return solution, scale


def _search_s_estimate(
    basis: Array, products: Array, target: Array, floor: float
) -> tuple[Array, float]:
    """Solution [p] whose residuals have the smallest robust scale, and that scale.

    Which rows agree is not known, so many small sets of rows are tried, each fit is drawn a little
    towards the rows that agree with it, and the best few are followed to the end (Salibian-Barrera
    & Yohai 2006). The sets are drawn from a fixed seed: the same rows give the same start.

    Parameters
    ----------
    basis : [n, p], columns of like size.
    products : [n, p²], `_products` of it.
    target : [n].
    floor : scale below which residuals are rounding.

    """
    rows, columns = basis.shape
    rng = np.random.default_rng(SEED)
    drawn_numbers = np.sort(rng.permutation(rows)[:ENOUGH_ROWS])
    drawn_rows, drawn_products, drawn_target = (
        basis[drawn_numbers],
        products[drawn_numbers],
        target[drawn_numbers],
    )
    drawn = np.zeros((SETS, drawn_numbers.size))
    order = np.argsort(rng.random((SETS, drawn_numbers.size)), axis=1)
    np.put_along_axis(drawn, order[:, :columns], 1.0, axis=1)
    least_squares_start = np.asarray(
        np.linalg.lstsq(basis, target, rcond=None)[0][None, :], dtype=np.float64
    )
    candidates = np.concatenate(
        [
            least_squares_start,
            _fit_sets(drawn_rows, drawn_products, drawn_target, least_squares_start, drawn),
        ]
    )
    # ranked by the median residual, which half of the rows being outliers does not move
    typical = np.median(np.abs(drawn_target - candidates @ drawn_rows.T), axis=1)
    candidates = candidates[np.argsort(typical, kind="stable")[:FOLLOWED]]
    scale = _usual_scale(drawn_rows, drawn_target, candidates, floor)
    for _ in range(FIRST_STEPS):
        candidates, scale = _step_towards(
            drawn_rows, drawn_products, drawn_target, candidates, scale, floor
        )
    candidates = candidates[np.argsort(scale, kind="stable")[:BEST]]
    scale = _usual_scale(basis, target, candidates, floor)
    for _ in range(MOST_STEPS):
        candidates, scale = _step_towards(basis, products, target, candidates, scale, floor)
    best = int(np.argmin(scale))
    return np.asarray(candidates[best], dtype=np.float64), float(scale[best])


def _usual_scale(basis: Array, target: Array, candidates: Array, floor: float) -> Array:
    """Scale [k] of the residuals of each of the coefficients [k, p], by their median."""
    residuals = np.abs(target - candidates @ basis.T)
    return np.maximum(MAD_TO_SIGMA * np.median(residuals, axis=1), floor)


def _step_towards(
    basis: Array, products: Array, target: Array, candidates: Array, scale: Array, floor: float
) -> tuple[Array, Array]:
    """Coefficients [k, p] moved towards the rows that agree with each, and the scale [k] of their
    residuals, nearer to that of the S-estimate than the one before.
    """
    ratio = (target - candidates @ basis.T) / BISQUARE
    spare = target.size - basis.shape[1]
    agreement = np.maximum(1.0 - (ratio / scale[:, None]) ** 2, 0.0)
    # the loss of an outlier, 1, over the rows that the coefficients leave free
    loss = target.size - np.sum(agreement**3, axis=1)
    scale = np.maximum(scale * np.sqrt(loss / (LOSS * spare)), floor)
    agreement = np.maximum(1.0 - (ratio / scale[:, None]) ** 2, 0.0)
    return _fit_sets(basis, products, target, candidates, agreement**2), scale


def _products(basis: Array) -> Array:
    """Products of the columns of each row [n, p²]."""
    return np.asarray((basis[:, :, None] * basis[:, None, :]).reshape(len(basis), -1))


def _fit_sets(basis: Array, products: Array, target: Array, starts: Array, weights: Array) -> Array:
    """Weighted least-squares solutions [k, p] for row weights [k, n], in open directions those
    that are near.
    """
    columns = basis.shape[1]
    gram = (weights @ products).reshape(-1, columns, columns)
    pull = (weights * (target - starts @ basis.T)) @ basis
    values, vectors = np.linalg.eigh(gram)
    closed = values > OPEN * np.sum(weights, axis=1)[:, None]
    step = np.einsum("kpi,kp->ki", vectors, pull) / np.where(closed, values, np.inf)
    return np.asarray(starts + np.einsum("kpi,ki->kp", vectors, step), dtype=np.float64)

"""Linear least squares that a few outliers cannot move, an MM-estimate (Yohai 1987).

Several outliers hide one another from ordinary residuals, and one of high leverage hides itself. So
the fit starts where the residuals have the smallest robust scale: the S-estimate (Rousseeuw & Yohai
1984), of which up to half of the rows may be outliers. It ends with Tukey's biweight at that
scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
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
SETS = 200
"""Sets of rows that are tried: of 10 coefficients and 20 % of outliers one set in ten is clean."""
ENOUGH_ROWS = 400
"""Rows that rank the sets; of more, this many are drawn."""
FOLLOWED, BEST = 30, 4
"""Sets that are followed by a few steps, and to the end."""
FIRST_STEPS, MOST_STEPS, SCALE_STEPS = 2, 20, 20
"""Steps towards the agreeing rows before the best are chosen and after it, and of each scale."""
RIDGE = 1e-12
"""Weight of where a search stood, relative to the rows: directions that a set leaves open stay."""
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


def linear(
    design: Array, indication: Array, *, noise: Array | None = None, names: Sequence[str] = ()
) -> RobustFit:
    """Fit indication = design · coefficients so that no few rows move it.

    Parameters
    ----------
    design : [n, p], one column per coefficient.
    indication : [n].
    noise : [n], proportional to the standard deviation of each row; equal when absent.
    names : what the error calls the coefficients that the data cannot determine.

    Returns
    -------
    RobustFit. Its coefficients are where another fit starts that states uncertainties, of the rows
    that have a weight.

    Raises
    ------
    FitError
        As `fit.linear`; and for fewer than p + 5 rows, where none can be told to be an outlier.

    """
    rows, columns = design.shape
    size = np.ones(rows) if noise is None else noise
    # refuses what no rows determine
    least_squares.linear(design, indication, weights=size**-2.0, names=names)
    if rows - columns < SPARE_ROWS:
        raise FitError(
            f"{rows} rows for {columns} coefficients cannot show which row is an outlier",
            hint=(
                f"a robust fit needs at least {columns + SPARE_ROWS} rows: add dwells or use the"
                " plain fit"
            ),
        )
    weighted, target = design / size[:, None], indication / size
    # sizes of columns of which no row has a say: a norm may be that of one outlier
    lengths = np.sqrt(np.mean(np.sort(weighted**2, axis=0)[: -(-rows // 2)], axis=0))
    lengths = np.where(lengths > 0.0, lengths, np.linalg.norm(weighted, axis=0))
    basis = weighted / lengths
    floor = ROUNDING * float(np.max(np.abs(target)))
    solution, scale = _search_s_estimate(basis, target, floor)
    weights = np.ones(rows)
    for _ in range(ITERATIONS):
        ratio = np.abs(target - basis @ solution) / scale
        weights[:] = (1.0 - np.minimum(ratio / TUKEY, 1.0) ** 2) ** 2
        before = solution
        solution = _fit_sets(basis, target, before[None, :], weights[None, :])[0]
        if np.max(np.abs(basis @ (solution - before))) <= TOLERANCE * scale:
            break
    coefficients = solution / lengths
    return RobustFit(coefficients, indication - design @ coefficients, weights)


def _search_s_estimate(basis: Array, target: Array, floor: float) -> tuple[Array, float]:
    """Solution [p] whose residuals have the smallest robust scale, and that scale.

    Which rows agree is not known, so many small sets of rows are tried, each fit is drawn a little
    towards the rows that agree with it, and the best few are followed to the end (Salibian-Barrera
    & Yohai 2006). The sets are drawn from a fixed seed: the same rows give the same start.

    Parameters
    ----------
    basis : [n, p], columns of like size.
    target : [n].
    floor : scale below which residuals are rounding.

    """
    rows, columns = basis.shape
    rng = np.random.default_rng(SEED)
    few = np.sort(rng.permutation(rows)[:ENOUGH_ROWS])
    some, part = basis[few], target[few]
    drawn = np.zeros((SETS, few.size))
    order = np.argsort(rng.random((SETS, few.size)), axis=1)
    np.put_along_axis(drawn, order[:, :columns], 1.0, axis=1)
    plain = np.asarray(np.linalg.lstsq(basis, target, rcond=None)[0][None, :], dtype=np.float64)
    found = np.concatenate([plain, _fit_sets(some, part, plain, drawn)])
    typical = np.median(np.abs(part - found @ some.T), axis=1)
    found = found[np.argsort(typical, kind="stable")[:FOLLOWED]]
    for _ in range(FIRST_STEPS):
        found, scale = _step_towards(some, part, found, floor)
    found = found[np.argsort(scale, kind="stable")[:BEST]]
    for _ in range(MOST_STEPS):
        found, scale = _step_towards(basis, target, found, floor)
    best = int(np.argmin(scale))
    return np.asarray(found[best], dtype=np.float64), float(scale[best])


def _step_towards(basis: Array, target: Array, found: Array, floor: float) -> tuple[Array, Array]:
    """Coefficients [k, p] moved towards the rows that agree with each, and the scale [k] they had
    before.
    """
    residuals = np.abs(target - found @ basis.T)
    scale = np.maximum(MAD_TO_SIGMA * np.median(residuals, axis=1), floor)
    spare = target.size - basis.shape[1]
    for _ in range(SCALE_STEPS):
        ratio = residuals / (BISQUARE * scale[:, None])
        agreement = np.maximum(1.0 - ratio**2, 0.0)
        # the loss of an outlier, 1, over the rows that the coefficients leave free
        loss = target.size - np.sum(agreement**3, axis=1)
        scale = np.maximum(scale * np.sqrt(loss / (LOSS * spare)), floor)
    return _fit_sets(basis, target, found, agreement**2), scale


def _fit_sets(basis: Array, target: Array, near: Array, weights: Array) -> Array:
    """Weighted least-squares solutions [k, p] for row weights [k, n], in open directions those
    that are near.
    """
    rows, columns = basis.shape
    products = (basis[:, :, None] * basis[:, None, :]).reshape(rows, -1)
    gram = (weights @ products).reshape(-1, columns, columns) + RIDGE * np.eye(columns)
    pull = (weights * (target - near @ basis.T)) @ basis
    return np.asarray(near + np.linalg.solve(gram, pull[:, :, None])[:, :, 0], dtype=np.float64)

"""Coefficients whose residuals have the smallest robust scale: an S-estimate (Rousseeuw & Yohai
1984), where a robust fit starts.

Which rows agree is not known, so many small sets of rows are tried, each fit is drawn a little
towards the rows that agree with it, and the best few are followed to the end (Salibian-Barrera &
Yohai 2006). The sets are drawn from a fixed seed: the same rows give the same start.
"""

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.dispersion import MAD_TO_SIGMA

SETS = 200
"""Sets of rows that are tried: of 10 coefficients and 30 % of outliers one set in 35 is clean."""
ENOUGH_ROWS = 400
"""Rows that rank the sets; of more, this many are drawn."""
LARGEST_WORK = 2e7
"""Multiplications of one step of all sets, above which fewer are drawn."""
FEWEST_SETS, FOLLOWED, BEST = 20, 30, 4
"""Sets that are tried at least; candidates that are followed by a few steps, and to the end."""
FIRST_STEPS, MOST_STEPS = 2, 12
"""Steps towards the agreeing rows before the best are chosen, and at most after it."""
AT_REST = 1e-3
"""A change of the smallest scale, relative, that ends a search."""
BISQUARE = 1.547645
"""Tuning constant of Tukey's loss at which half of the rows may be outliers (Rousseeuw & Yohai
1984).
"""
RIDGE = 1e-8
"""Weight of where a search stood, relative to the rows: directions that a set leaves open stay."""
SEED = 2006


def search(basis: Array, target: Array, floor: float) -> Array:
    """Coefficients [p] of the smallest robust scale of target − basis · coefficients.

    Parameters
    ----------
    basis
        [n, p], orthonormal columns.
    target
        [n].
    floor
        Scale below which residuals are rounding.

    """
    rows, columns = basis.shape
    rng = np.random.default_rng(SEED)
    few = np.sort(rng.permutation(rows)[:ENOUGH_ROWS])
    some, part = basis[few] * np.sqrt(rows / few.size), target[few] * np.sqrt(rows / few.size)
    count = int(np.clip(LARGEST_WORK / (few.size * columns**2), FEWEST_SETS, SETS))
    drawn = np.zeros((count, few.size))
    order = np.argsort(rng.random((count, few.size)), axis=1)
    np.put_along_axis(drawn, order[:, :columns], 1.0, axis=1)
    found = _fits(some, part, (basis.T @ target)[None, :], drawn)
    typical = np.median(np.abs(part - found @ some.T), axis=1)
    found = found[np.argsort(typical, kind="stable")[:FOLLOWED]]
    for _ in range(FIRST_STEPS):
        found, scale = _step(some, part, found, floor)
    found, before = found[np.argsort(scale, kind="stable")[:BEST]], np.inf
    for _ in range(MOST_STEPS):
        found, scale = _step(basis, target, found, floor)
        if abs(before - scale.min()) <= AT_REST * scale.min():
            break
        before = scale.min()
    return np.asarray(found[np.argmin(scale)], dtype=np.float64)


def _step(basis: Array, target: Array, found: Array, floor: float) -> tuple[Array, Array]:
    """Coefficients [k, p] moved towards the rows that agree with each, and the scale [k] they had
    before.
    """
    residuals = np.abs(target - found @ basis.T)
    scale = np.maximum(MAD_TO_SIGMA * np.median(residuals, axis=1), floor)
    spare = target.size - basis.shape[1]
    square = residuals * residuals
    for _ in range(3):
        agreement = np.maximum(1.0 - square / (BISQUARE * scale[:, None]) ** 2, 0.0)
        # half of the loss of an outlier, 1, over the rows that the coefficients leave free
        loss = target.size - np.sum(agreement * agreement * agreement, axis=1)
        scale = np.maximum(scale * np.sqrt(loss / (0.5 * spare)), floor)
    return _fits(basis, target, found, agreement * agreement), scale


def _fits(basis: Array, target: Array, near: Array, weights: Array) -> Array:
    """Weighted least-squares solutions [k, p] for row weights [k, n], in open directions those
    that are near.
    """
    rows, columns = basis.shape
    products = (basis[:, :, None] * basis[:, None, :]).reshape(rows, -1)
    gram = (weights @ products).reshape(-1, columns, columns) + RIDGE * np.eye(columns)
    pull = (weights * (target - near @ basis.T)) @ basis
    return np.asarray(near + np.linalg.solve(gram, pull[:, :, None])[:, :, 0], dtype=np.float64)

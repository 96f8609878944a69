"""Linear least squares that a few outliers cannot move, with the suspects named.

Two faults hide an outlier from ordinary residuals: it drags the fit towards itself, the more the
higher its leverage, and several of them hide one another. So the start is the best of Huber's
fit, of fits with rows left out along the principal sensitivity components (Peña & Yohai 1999) and
of the S-estimate; the finish is Tukey's biweight at the scale of the start (Yohai 1987). Rows that
go one way together, because they share an attitude or a temperature, are no outliers: they are kept
and reported.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric.dispersion import MAD_TO_SIGMA, largest_by_chance, mad_sigma
from calibkit.numeric.least_squares import fit as least_squares, structure

HUBER = 1.345
"""Studentised residual above which Huber's weights fall: 95 % efficient on normal noise (Huber
1981).
"""
TUKEY = 4.685
"""Studentised residual above which Tukey's weight is 0: 95 % efficient on normal noise (Beaton &
Tukey 1974).
"""
DOUBTFUL = 4.0
"""Studentised residual above which a row is not believed: 6 of 100,000 normal rows."""
LEFT_OUT = 0.2
"""Share of the rows that a candidate start leaves out along each component."""
CLEANED = 2.5
"""Studentised residual above which the start's own refinement leaves a row out."""
FAR_SMALLER = 0.6
"""Scale of the S-estimate, relative to that of the other starts, below which it is believed."""
ROWS_A_COEFFICIENT = 8
"""Rows a coefficient from which on an S-estimate is tried: of fewer, some agree by chance."""
ITERATIONS = 60
TOLERANCE = 1e-10
"""A change of the fitted values, relative to the noise, that ends an iteration."""
AT_REST = 1e-2
"""A change of fitted values, relative to the noise, that ends the iteration of parameters: they are
a start.
"""
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
SCALE_AT_REST = 1e-3
"""A change of the smallest scale, relative, that ends a search."""
BISQUARE = 1.547645
"""Tuning constant of Tukey's loss at which half of the rows may be outliers (Rousseeuw & Yohai
1984).
"""
RIDGE = 1e-8
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
    ratio: Array
    """[n], size of a residual over its own standard deviation; of rows with structure, over the
    spread within their level.
    """
    scale: float
    """Standard deviation [unit of the indication] of a row of weight 1."""
    structured: tuple[structure.Structure, ...]
    """Levels whose rows stand apart together, and are kept."""

    @property
    def suspects(self) -> tuple[int, ...]:
        """Rows, by index, whose residual neither noise nor the tail of all residuals explains, the
        worst first.
        """
        limit = max(largest_by_chance(self.ratio), DOUBTFUL)
        worst_first = np.argsort(-self.ratio, kind="stable")
        return tuple(int(i) for i in worst_first if self.ratio[i] > limit)


def linear(
    design: Array,
    indication: Array,
    *,
    weights: Array | None = None,
    names: Sequence[str] = (),
    groups: Sequence[Integers] = (),
    near: RobustFit | None = None,
    largest: float = 0.0,
) -> RobustFit:
    """Fit indication = design · coefficients so that no few rows move it: an MM-estimate.

    Parameters
    ----------
    design
        [n, p], one column per coefficient.
    indication
        [n].
    weights
        [n], proportional to 1/variance of each row; equal when absent.
    names
        What the error calls the coefficients that the data cannot determine.
    groups
        Labels [n] of what rows share (attitude, temperature, station, side), −1 for nothing. Where
        two or more rows of a level, and four in ten of them, would be suspects, its rows are held
        against one another: those that go one way together are kept.
    near
        Fit of nearly the same rows, to whose residuals this one is fitted: it starts from its
        weights, at its scale, with its structure.
    largest
        Size of what the indications are differences of, for the rounding that is in them.

    Returns
    -------
    RobustFit. Its coefficients are where another fit starts that states uncertainties, of the rows
    that are no suspects.

    Raises
    ------
    FitError
        As `fit.linear`, also for the rows that remain; and for fewer than p + 5 rows, where none
        can be told to be an outlier.

    """
    rows, columns = design.shape
    # refuses what no rows determine
    least_squares.linear(design, indication, weights=weights, names=names)
    if rows - columns < SPARE_ROWS:
        raise FitError(
            f"{rows} rows for {columns} coefficients cannot show which row is an outlier",
            hint=(
                f"a robust fit needs at least {columns + SPARE_ROWS} rows: add dwells or use the"
                " plain fit"
            ),
        )
    root = np.sqrt(np.ones(rows) if weights is None else weights)
    weighted = design * root[:, None]
    basis, _ = np.linalg.qr(weighted / np.linalg.norm(weighted, axis=0))
    target = indication * root
    floor = ROUNDING * max(float(np.max(np.abs(target))), largest)
    if near is None:
        scale, solution, row_weights = _start(basis, target, floor)
    else:
        scale, solution, row_weights = near.scale, np.zeros(columns), near.row_weights
    found = {(one.group, one.level): one.rows for one in near.structured} if near else {}
    row_weights, ratio = _finish(basis, target, solution, row_weights, scale, groups, found)
    kept = ratio < TUKEY
    final = least_squares.linear(
        design[kept],
        indication[kept],
        weights=(root * np.sqrt(row_weights))[kept] ** 2,
        names=names,
    )
    return RobustFit(
        coefficients=final.coefficients,
        residuals=indication - design @ final.coefficients,
        row_weights=row_weights,
        ratio=ratio,
        scale=scale,
        structured=tuple(structure.Structure(*key, members) for key, members in found.items()),
    )


def nonlinear(
    linearised: Callable[[Array], tuple[Array, Array]],
    start: Array,
    *,
    names: Sequence[str] = (),
    groups: Sequence[Integers] = (),
) -> tuple[Array, RobustFit]:
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
    groups
        As for `linear`.

    Returns
    -------
    Parameters [p] and the last linear fit, for its suspects.

    Raises
    ------
    FitError
        As `linear`, and when the parameters do not come to rest.

    """
    parameters = start
    step: RobustFit | None = None
    moved = np.inf
    for number in range(ITERATIONS):
        residual, slopes = linearised(parameters)
        # the start may be far: a few linearisations are looked at afresh, the others follow them
        near = step if step and (number > 2 or moved <= step.scale) else None
        largest = float(np.max(np.abs(slopes @ parameters)))
        step = linear(slopes, -residual, names=names, groups=groups, near=near, largest=largest)
        parameters = parameters + step.coefficients
        moved = float(np.max(np.abs(slopes @ step.coefficients)))
        if moved <= max(AT_REST * step.scale, ROUNDING * largest):
            return parameters, step
    raise FitError(
        "the robust fit does not come to rest", hint="use the plain fit and look at its residuals"
    )


def _start(basis: Array, target: Array, floor: float) -> tuple[float, Array, Array]:
    """Candidate with the smallest robust scale, refined on the rows that agree with it: scale,
    solution [p], row weights [n].

    The S-estimate, which more outliers cannot move, wins where its scale is far smaller alone: of
    few rows it finds some that agree by chance.
    """
    candidates = (
        (mad_sigma(_studentise(basis, target, *candidate)), *candidate)
        for candidate in _candidates(basis, target, floor)
    )
    # the first candidate, Huber's, always exists
    start = (0.0, np.zeros(basis.shape[1]), np.ones(len(target)))
    _, solution, row_weights = min(candidates, key=lambda found: found[0], default=start)
    best = _refined(basis, target, solution, row_weights, floor)
    if len(target) >= ROWS_A_COEFFICIENT * basis.shape[1]:
        solution = _search_s_estimate(basis, target, floor)
        apart = np.abs(target - basis @ solution)
        agreeing = (apart <= CLEANED * max(mad_sigma(apart), floor)).astype(np.float64)
        other = _refined(basis, target, solution, agreeing, floor)
        best = other if other[0] < FAR_SMALLER * best[0] else best
    return max(best[0], floor), *best[1:]


def _refined(
    basis: Array, target: Array, solution: Array, row_weights: Array, floor: float
) -> tuple[float, Array, Array]:
    """Scale, solution [p] and row weights [n] of a start after some fits to the rows that agree
    with the fit before.
    """
    scale = mad_sigma(_studentise(basis, target, solution, row_weights))
    for _ in range(3):
        agreeing = np.abs(_studentise(basis, target, solution, row_weights)) <= CLEANED * max(
            scale, floor
        )
        refined = _solve(basis, target, agreeing.astype(np.float64))
        if refined is None:
            break
        solution, row_weights = refined, agreeing.astype(np.float64)
        scale = mad_sigma(_studentise(basis, target, solution, row_weights))
    return scale, solution, row_weights


def _candidates(basis: Array, target: Array, floor: float) -> Iterator[tuple[Array, Array]]:
    """Huber's fit, and fits with the extreme rows of each principal sensitivity component left
    out.
    """
    rows, columns = basis.shape
    plain = _solve(basis, target, np.ones(rows))
    if plain is None:
        return
    scale = max(mad_sigma(_studentise(basis, target, plain, np.ones(rows))), floor)
    yield _reweighted(basis, target, plain, np.ones(rows), scale=scale, effects=None)[:2]
    residual = target - basis @ plain
    deleted = residual / np.maximum(1.0 - np.sum(basis**2, axis=1), 1e-12)
    _, vectors = np.linalg.eigh((basis * deleted[:, None] ** 2).T @ basis)
    count = min(int(LEFT_OUT * rows), rows - columns - SPARE_ROWS)
    for component in (basis @ vectors).T:
        for measure in (component, -component, np.abs(component)):
            kept = np.ones(rows)
            kept[np.argsort(measure, kind="stable")[rows - count :]] = 0.0
            solution = _solve(basis, target, kept)
            if solution is not None:
                yield solution, kept


def _finish(
    basis: Array,
    target: Array,
    solution: Array,
    row_weights: Array,
    scale: float,
    groups: Sequence[Integers],
    found: dict[tuple[int, int], Integers],
) -> tuple[Array, Array]:
    """Row weights [n], and the ratios [n] that they are of.

    To the rows `found` of levels with an effect those of each level are added that stand apart;
    what a distant start made of them is forgotten where the fit has come near.
    """
    for near in (bool(found), True):
        effects = None
        while effects is None or len(effects) < len(found):
            effects = tuple(found.values())
            solution, row_weights, determined = _reweighted(
                basis, target, solution, row_weights, scale=scale, effects=effects
            )
            ratio = _explain(basis, target, solution, row_weights, scale, groups, found)
        if near or not found:
            break
        found.clear()
        _explain(basis, target, solution, row_weights, scale, groups, found)
    if not determined:
        raise FitError(
            "too few rows agree with one another for a robust fit",
            hint="check the references by eye",
        )
    return row_weights, ratio


def _explain(
    basis: Array,
    target: Array,
    solution: Array,
    row_weights: Array,
    scale: float,
    groups: Sequence[Integers],
    found: dict[tuple[int, int], Integers],
) -> Array:
    """Ratios [n] at a solution, after the rows of all levels that stand apart were added to
    `found`.
    """
    while True:
        ratio = _ratio(basis, target, solution, row_weights, scale, tuple(found.values()))
        more = structure.find(target - basis @ solution, ratio > DOUBTFUL, groups)
        if more.keys() <= found.keys():
            return ratio
        found |= more


def _reweighted(
    basis: Array,
    target: Array,
    solution: Array,
    row_weights: Array,
    *,
    scale: float,
    effects: Sequence[Integers] | None,
) -> tuple[Array, Array, bool]:
    """Iteratively reweighted least squares at a fixed scale: solution [p], row weights [n], and
    whether they determine it; with Tukey's weights, or Huber's where `effects` is absent.
    """
    for _ in range(ITERATIONS):
        if effects is None:
            apart = np.abs(_studentise(basis, target, solution, row_weights)) / scale
            proposed = HUBER / np.maximum(apart, HUBER)
        else:
            ratio = _ratio(basis, target, solution, row_weights, scale, effects)
            tukey = (1.0 - np.minimum(ratio / TUKEY, 1.0) ** 2) ** 2
            proposed = tukey * _balance(basis, row_weights)
        moved = _solve(basis, target, proposed)
        if moved is None:
            return solution, row_weights, False
        done = float(np.max(np.abs(basis @ (moved - solution)))) <= TOLERANCE * scale
        solution, row_weights = moved, proposed
        if done:
            break
    return solution, row_weights, True


def _solve(basis: Array, target: Array, row_weights: Array) -> Array | None:
    """Weighted solution [p] in orthonormal columns [n, p], or None when the weighted rows do not
    determine it.
    """
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


def _balance(basis: Array, row_weights: Array) -> Array:
    """Weights [n] that let no row count for far more than the others do, whatever its residual
    (Mallows 1975).

    A row is held back where its leverage against all others exceeds 1 (it counts for more than they
    do together) and four times what is usual in the basis.
    """
    leverage = np.sum(_hat(basis, row_weights) ** 2, axis=1)
    others = leverage / np.maximum(1.0 - row_weights * leverage, 1e-12)
    bound = max(1.0, 4.0 * float(np.median(others)))
    return np.asarray(bound / np.clip(others, bound, bound * LONGEST_LEVER), dtype=np.float64)


def _studentise(basis: Array, target: Array, solution: Array, row_weights: Array) -> Array:
    """Residuals [n] over the factor by which the fit itself shrinks them, or widens those that it
    left out.
    """
    hat = _hat(basis, row_weights)
    leverage = np.sum(hat**2, axis=1)
    square = (hat * row_weights[:, None] ** 2).T @ hat
    variance = 1.0 - 2.0 * row_weights * leverage + np.sum(hat @ square * hat, axis=1)
    spread = np.sqrt(np.maximum(variance, 1e-12))
    return np.asarray((target - basis @ solution) / spread, dtype=np.float64)


def _ratio(
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
    sizes = np.abs(_studentise(basis, target, solution, row_weights))
    sizes = np.maximum(sizes, np.abs(residual)) / scale
    for rows in effects:
        own = np.abs(residual[rows] - np.median(residual[rows]))
        sizes[rows] = np.minimum(sizes[rows], own / max(scale, mad_sigma(own)))
    return np.asarray(sizes, dtype=np.float64)


def _search_s_estimate(basis: Array, target: Array, floor: float) -> Array:
    """Coefficients [p] whose residuals, target − basis · coefficients, have the smallest robust
    scale: an S-estimate (Rousseeuw & Yohai 1984).

    Which rows agree is not known, so many small sets of rows are tried, each fit is drawn a little
    towards the rows that agree with it, and the best few are followed to the end (Salibian-Barrera
    & Yohai 2006). The sets are drawn from a fixed seed: the same rows give the same start.

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
    found = _fit_sets(some, part, (basis.T @ target)[None, :], drawn)
    typical = np.median(np.abs(part - found @ some.T), axis=1)
    found = found[np.argsort(typical, kind="stable")[:FOLLOWED]]
    for _ in range(FIRST_STEPS):
        found, scale = _step_towards(some, part, found, floor)
    found, before = found[np.argsort(scale, kind="stable")[:BEST]], np.inf
    for _ in range(MOST_STEPS):
        found, scale = _step_towards(basis, target, found, floor)
        if abs(before - scale.min()) <= SCALE_AT_REST * scale.min():
            break
        before = scale.min()
    return np.asarray(found[np.argmin(scale)], dtype=np.float64)


def _step_towards(basis: Array, target: Array, found: Array, floor: float) -> tuple[Array, Array]:
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
    return _fit_sets(basis, target, found, agreement * agreement), scale


def _fit_sets(basis: Array, target: Array, near: Array, weights: Array) -> Array:
    """Weighted least-squares solutions [k, p] for row weights [k, n], in open directions those
    that are near.
    """
    rows, columns = basis.shape
    products = (basis[:, :, None] * basis[:, None, :]).reshape(rows, -1)
    gram = (weights @ products).reshape(-1, columns, columns) + RIDGE * np.eye(columns)
    pull = (weights * (target - near @ basis.T)) @ basis
    return np.asarray(near + np.linalg.solve(gram, pull[:, :, None])[:, :, 0], dtype=np.float64)

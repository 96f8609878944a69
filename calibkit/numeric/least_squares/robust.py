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
from calibkit.numeric.dispersion import largest_by_chance, mad_sigma
from calibkit.numeric.least_squares import (
    fit as least_squares,
    s_estimate,
    structure,
    weighted_rows,
)

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
        (mad_sigma(weighted_rows.studentise(basis, target, *candidate)), *candidate)
        for candidate in _candidates(basis, target, floor)
    )
    # the first candidate, Huber's, always exists
    start = (0.0, np.zeros(basis.shape[1]), np.ones(len(target)))
    _, solution, row_weights = min(candidates, key=lambda found: found[0], default=start)
    best = _refined(basis, target, solution, row_weights, floor)
    if len(target) >= ROWS_A_COEFFICIENT * basis.shape[1]:
        solution = s_estimate.search(basis, target, floor)
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
    scale = mad_sigma(weighted_rows.studentise(basis, target, solution, row_weights))
    for _ in range(3):
        agreeing = np.abs(
            weighted_rows.studentise(basis, target, solution, row_weights)
        ) <= CLEANED * max(scale, floor)
        refined = weighted_rows.solve(basis, target, agreeing.astype(np.float64))
        if refined is None:
            break
        solution, row_weights = refined, agreeing.astype(np.float64)
        scale = mad_sigma(weighted_rows.studentise(basis, target, solution, row_weights))
    return scale, solution, row_weights


def _candidates(basis: Array, target: Array, floor: float) -> Iterator[tuple[Array, Array]]:
    """Huber's fit, and fits with the extreme rows of each principal sensitivity component left
    out.
    """
    rows, columns = basis.shape
    plain = weighted_rows.solve(basis, target, np.ones(rows))
    if plain is None:
        return
    scale = max(mad_sigma(weighted_rows.studentise(basis, target, plain, np.ones(rows))), floor)
    yield _reweighted(basis, target, plain, np.ones(rows), scale=scale, effects=None)[:2]
    residual = target - basis @ plain
    deleted = residual / np.maximum(1.0 - np.sum(basis**2, axis=1), 1e-12)
    _, vectors = np.linalg.eigh((basis * deleted[:, None] ** 2).T @ basis)
    count = min(int(LEFT_OUT * rows), rows - columns - SPARE_ROWS)
    for component in (basis @ vectors).T:
        for measure in (component, -component, np.abs(component)):
            kept = np.ones(rows)
            kept[np.argsort(measure, kind="stable")[rows - count :]] = 0.0
            solution = weighted_rows.solve(basis, target, kept)
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
        ratio = weighted_rows.ratio(
            basis, target, solution, row_weights, scale, tuple(found.values())
        )
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
            apart = np.abs(weighted_rows.studentise(basis, target, solution, row_weights)) / scale
            proposed = HUBER / np.maximum(apart, HUBER)
        else:
            ratio = weighted_rows.ratio(basis, target, solution, row_weights, scale, effects)
            tukey = (1.0 - np.minimum(ratio / TUKEY, 1.0) ** 2) ** 2
            proposed = tukey * weighted_rows.balance(basis, row_weights)
        moved = weighted_rows.solve(basis, target, proposed)
        if moved is None:
            return solution, row_weights, False
        done = float(np.max(np.abs(basis @ (moved - solution)))) <= TOLERANCE * scale
        solution, row_weights = moved, proposed
        if done:
            break
    return solution, row_weights, True

"""Linear fit to long logs, each with a level of its own, whose noise is autocorrelated.

    y = X p + b_log + Σ_k d_log,k t^k + e          (rows are means of blocks of a log)

b_log is the turn-on bias of a log: random, its variance by restricted likelihood (REML). d are
courses in time, t the time in the log: also random, kept where the likelihood asks for one of them.
e is autocorrelated; what it adds to the covariance of p is found with free b and d of each log by
an estimate that is consistent for such noise (`hac`: heteroscedasticity and autocorrelation), since
the coefficients are combinations of those of that fit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers
from calibkit.fit.shared import Shared
from calibkit.fit.solve import ASKED_FOR, Fit, SharedSize, solve
from calibkit.numeric import chunks, gum
from calibkit.numeric.least_squares import fit as least_squares, hac

MOST_BLOCKS = 4096
"""Blocks of rows of all logs, whose means are fitted; fewer rows are fitted as they are."""
COURSES = 3
"""Highest power of time by which a bias is tried to wander in a log."""
LEAST_LOGS = 4
"""Fewest logs from which the covariance of biases that wander is taken between logs."""
LEAST_BLOCKS = 12
"""Blocks that joining leaves to a log, at least."""
STILL = 0.05
"""Range of an abscissa in a log, relative to that of all logs, below which it is the noise of a
thermometer more than a change: such a log has a level alone.
"""


@dataclass(frozen=True, slots=True)
class LevelFit:
    """Coefficients [p] of a fit with a level of each of q logs."""

    coefficients: Array
    covariance: Array
    effective_dof: Array
    """[m], of combinations of the coefficients."""
    sizes: tuple[SharedSize, ...]
    """Standard deviations of the levels, and of the drifts that were kept."""
    levels: Array
    """[q], about the mean of all logs that the coefficients stand for."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means of consecutive rows of logs, weighted by the root of their relative number."""

    design: Array
    """[k, p]."""
    indication: Array
    """[k]."""
    root: Array
    """[k]."""
    log: Integers
    """[k], number of the log."""
    courses: Array
    """[k, COURSES], polynomials of the number of the row in its log, of mean 0, variance 1 and
    independent of each other.
    """

    @classmethod
    def of(
        cls,
        design: Callable[[slice], Array],
        indication: Array,
        abscissa: Array,
        bounds: Sequence[tuple[int, int]],
    ) -> "Blocks":
        """Means over the rows of logs, each from its first row to before its last: `bounds`."""
        size = -(-len(indication) // MOST_BLOCKS)
        reach = chunks.extremes(abscissa)
        parts, counts = [], []
        for first, stop in bounds:
            own, count = _means(design, indication, first, stop, size)
            low, high = chunks.extremes(abscissa[first:stop])
            if high - low < STILL * (reach[1] - reach[0]):
                own[:, :-1] = np.average(own[:, :-1], axis=0, weights=count)
            parts.append(own)
            counts.append(count)
        whole, rows = np.concatenate(parts), np.concatenate(counts)
        log = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
        return cls._of_means(whole, rows, log)

    @classmethod
    def _of_means(cls, whole: Array, rows: Array, log: Integers) -> "Blocks":
        """Blocks of design and indication [k, p + 1] and numbers of rows [k]."""
        courses = np.concatenate([_courses(int(count)) for count in np.bincount(log)])
        return cls(whole[:, :-1], whole[:, -1], np.sqrt(rows / np.mean(rows)), log, courses)

    def without_memory(self) -> "Blocks":
        """Blocks joined to pairs as long as neighbours are correlated: what is left beside level
        and drift is noise that the likelihood takes as white.
        """
        blocks = self
        while np.bincount(blocks.log).min() >= 2 * LEAST_BLOCKS:
            basis = blocks.basis(blocks.errors("", [""] * (COURSES + 1), ""))
            target = blocks.root * blocks.indication
            left = target - basis @ (basis.T @ target)
            same = np.diff(blocks.log) == 0
            product = float(np.sum((left[1:] * left[:-1])[same]))
            if product <= 2.0 / np.sqrt(left.size) * float(left @ left):
                break
            number = np.concatenate([np.arange(count) for count in np.bincount(blocks.log)])
            start, rows = np.flatnonzero(number % 2 == 0), blocks.root**2
            stacked = np.column_stack([blocks.design, blocks.indication]) * rows[:, None]
            joined = np.add.reduceat(rows, start)
            means = np.add.reduceat(stacked, start, axis=0) / joined[:, None]
            blocks = self._of_means(means, joined, blocks.log[start])
        return blocks

    def errors(self, group: str, names: Sequence[str], unit: str) -> tuple[Shared, ...]:
        """Level of a log and, optional, its courses in time, of one name each, as shared errors."""
        loadings = [np.ones(len(self.log)), *self.courses.T]
        return tuple(
            Shared(
                group=group,
                effect=name,
                level=self.log,
                loading=loading[:, None],
                unit=unit,
                optional=number > 0,
            )
            for number, (name, loading) in enumerate(zip(names, loadings, strict=True))
        )

    def columns(self, error: Shared) -> Array:
        """Columns [k, q] of the weighted blocks by which an error of each log enters them."""
        own = self.log[:, None] == np.arange(self.log[-1] + 1)
        return np.asarray((error.loading.ravel() * self.root)[:, None] * own, dtype=np.float64)

    def basis(self, errors: Sequence[Shared]) -> Array:
        """Orthonormal columns [k, r] that span design and errors of the weighted blocks."""
        whole = np.column_stack([self.design * self.root[:, None], *map(self.columns, errors)])
        u, singular, _ = np.linalg.svd(whole / np.linalg.norm(whole, axis=0), full_matrices=False)
        return np.asarray(u[:, singular > least_squares.RANK_TOLERANCE * singular[0]])


def _courses(count: int) -> Array:
    """Polynomials in time [count, COURSES] of a log; 0 where blocks are too few to tell them."""
    time = np.linspace(-1.0, 1.0, count)
    q, _ = np.linalg.qr(np.vander(time, COURSES + 1, increasing=True))
    found = np.zeros((count, COURSES))
    found[:, : max(q.shape[1] - 1, 0)] = np.sqrt(count) * q[:, 1:]
    return found


def _means(
    design: Callable[[slice], Array], indication: Array, first: int, stop: int, size: int
) -> tuple[Array, Array]:
    """Means [k, p + 1] of design and indication over blocks of rows of one log, and the number of
    rows [k] of each.
    """
    parts = []
    for start, end in chunks.ranges(stop - first, size * max(chunks.ROWS // size, 1)):
        rows = slice(first + start, first + end)
        stacked = np.column_stack([design(rows), indication[rows]])
        parts.append(np.add.reduceat(stacked, np.arange(0, end - start, size), axis=0))
        chunks.release(indication)
    count = np.full(sum(map(len, parts)), float(size))
    count[-1] = stop - first - size * (count.size - 1)
    return np.concatenate(parts) / count[:, None], count


def fit(
    blocks: Blocks, errors: Sequence[Shared], combinations: Array, *, names: Sequence[str] = ()
) -> LevelFit:
    """Fit logs with a level of each, the first of the errors, with the optional ones where the
    likelihood asks for one of them, and degrees of freedom of combinations [m, p].

    Raises
    ------
    FitError
        As `solve`; the levels, whose size is not known, coincide with the coefficients.

    """
    count = blocks.design.shape[1]
    if errors[0].size is None and blocks.basis(errors[:1]).shape[1] == count:
        raise coincidence(errors[0], count, names)

    def residual(p: Numbers) -> Numbers:
        return blocks.design @ p - blocks.indication

    def fit_with(parts: Sequence[Shared]) -> Fit:
        taken = [replace(part, optional=False) for part in parts]
        return solve(residual, np.zeros(count), taken, noise=1.0 / blocks.root, names=names)

    sure = [error for error in errors if not error.optional]
    fitted = fit_with(sure)
    tried = [fit_with([*sure, error]) for error in errors if error.optional]
    if any(fitted.deviance - other.deviance > ASKED_FOR for other in tried):
        # a bias that wanders has more than one course
        fitted = fit_with(errors)
    kept = [size.error for size in fitted.shared]
    basis, noise = blocks.basis(kept), float(np.sqrt(fitted.variances[0]))
    columns = [blocks.columns(error) for error in kept]
    scaled = [column * size.value for column, size in zip(columns, fitted.shared, strict=True)]
    effects = np.column_stack(scaled)
    onto = _combine_rows(blocks, effects / noise)
    if len(kept) > 1 and len(effects.T) >= LEAST_LOGS * len(kept):
        covariance, dof = _between_logs(blocks, onto, effects, noise, combinations)
    else:
        covariance, dof = _by_components(blocks, onto, basis, columns, fitted, combinations)
    levels = fitted.shared[0].errors
    return LevelFit(
        fitted.parameters,
        covariance,
        np.maximum(dof, 1.0),
        fitted.shared,
        levels[:, 0] if len(levels) else np.zeros(errors[0].levels),
    )


def _by_components(
    blocks: Blocks,
    onto: Array,
    basis: Array,
    columns: Sequence[Array],
    fitted: Fit,
    combinations: Array,
) -> tuple[Array, Array]:
    """Covariance [p, p] by noise and by the effects, and degrees of freedom [m]."""
    target = blocks.root * blocks.indication
    own = hac.covariance(
        lambda part: basis[part],
        target - basis @ (basis.T @ target),
        combinations=combinations @ onto @ basis,
    )
    covariance = gum.propagate(onto @ basis, own.covariance)
    variance = gum.variance_along(combinations, covariance)
    spread = variance**2 / own.effective_dof
    for size, column in zip(fitted.shared, columns, strict=True):
        # an effect moves the coefficients; the derivative of their covariance by its variance
        moved = onto @ column
        by_effect = moved @ moved.T
        along = gum.variance_along(combinations, by_effect)
        covariance = covariance + size.value**2 * by_effect
        variance = variance + size.value**2 * along
        spread = spread + (_spread_of_square(size) * along) ** 2 / 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        return covariance, np.where(spread > 0.0, variance**2 / spread, fitted.dof)


def _between_logs(
    blocks: Blocks, onto: Array, effects: Array, noise: float, combinations: Array
) -> tuple[Array, Array]:
    """Covariance [p, p] by what the residuals of each log move the coefficients by, whatever their
    course, and degrees of freedom [m].

    With the estimator P (`onto`) and the residuals r_j of log j, V = Σ_j (F P r_j)(F P r_j)ᵀ. The
    factor F makes its mean that of errors which are the effects [k, r] and white noise (Bell &
    McCaffrey 2002), and the degrees of freedom are those of such errors (Satterthwaite).
    """
    design = blocks.design * blocks.root[:, None]
    target = blocks.root * blocks.indication
    own = blocks.log == np.arange(blocks.log[-1] + 1)[:, None]
    parts = onto[:, None, :] * own
    sums = parts @ (target - design @ (onto @ target))
    # what an error of each kind moves the sums by
    of_noise = noise * (parts - parts @ design @ onto)
    kinds = np.concatenate([parts @ (effects - design @ (onto @ effects)), of_noise], axis=2)
    wanted = np.column_stack([onto @ effects, noise * onto])
    factor = hac.matching_factor(wanted @ wanted.T, np.einsum("pqr,sqr->ps", kinds, kinds))
    moved = factor @ sums
    along = np.einsum("mp,pqr->mqr", combinations @ factor, kinds)
    products = along @ np.swapaxes(along, 1, 2)
    dof = np.trace(products, axis1=1, axis2=2) ** 2 / np.sum(products**2, axis=(1, 2))
    return moved @ moved.T, np.asarray(dof, dtype=np.float64)


def _spread_of_square(size: SharedSize) -> float:
    """Standard uncertainty of the square of a size, of which that of the root was made."""
    value, u = size.value, size.u
    return 2.0 * value * u if value > 2.0 * u else u**2


def coincidence(error: Shared, count: int, names: Sequence[str]) -> FitError:
    """Refusal of levels that the coefficients, `count` of them, hold already."""
    return FitError(
        f"the {error.effect} of each {error.group} cannot be told from {', '.join(names)}:"
        f" {error.levels} of them, each at one value of the abscissa, expected more"
        f" than {count}, or changes of the abscissa within each",
        hint="measure more of them, lower the order, or state how much the"
        f" {error.effect} differs in [[errors.component]]",
    )


def _combine_rows(blocks: Blocks, effects: Array) -> Array:
    """Matrix [p, k] by which generalised least squares makes the coefficients of the weighted
    blocks; effects [k, r] are in standard deviations, over that of the noise.
    """
    weighted = blocks.design * blocks.root[:, None]
    inner = np.eye(effects.shape[1]) + effects.T @ effects
    left = weighted - effects @ np.linalg.solve(inner, effects.T @ weighted)
    size = np.sqrt(np.abs(np.einsum("kp,kp->p", weighted, left)))
    inner = (weighted / size).T @ (left / size)
    return np.asarray(np.linalg.solve(inner, (left / size).T) / size[:, None], dtype=np.float64)

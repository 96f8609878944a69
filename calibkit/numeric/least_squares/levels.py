"""Linear fit to long logs, each with a level of its own, whose noise is autocorrelated.

A turn-on bias is common to a log: it is a random effect, with restricted likelihood of the means of
blocks of rows. What the noise adds to the covariance is that of the fit with a free level of each
log (`hac`), of which the coefficients are combinations.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric import chunks, gum
from calibkit.numeric.least_squares import components, fit as least_squares, hac
from calibkit.numeric.least_squares.components import Component, Effect

MOST_BLOCKS = 4096
"""Blocks of rows of all logs, whose means are fitted; fewer rows are fitted as they are."""
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
    component: Component
    """Standard deviation of the levels."""
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
        return cls(whole[:, :-1], whole[:, -1], np.sqrt(rows / np.mean(rows)), log)

    def effect(self, group: str, name: str) -> Effect:
        """The level of a log as an effect."""
        return Effect(group, name, self.log, np.ones(len(self.log)))

    def basis(self) -> Array:
        """Orthonormal columns [k, r] that span design and levels of the weighted blocks."""
        level = (self.log[:, None] == np.arange(self.log[-1] + 1)).astype(np.float64)
        whole = np.column_stack([self.design, level]) * self.root[:, None]
        u, singular, _ = np.linalg.svd(whole / np.linalg.norm(whole, axis=0), full_matrices=False)
        return np.asarray(u[:, singular > least_squares.RANK_TOLERANCE * singular[0]])


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
    blocks: Blocks, effect: Effect, combinations: Array, *, names: Sequence[str] = ()
) -> LevelFit:
    """Fit logs with a level of each, `effect`, and degrees of freedom of combinations [m, p].

    Raises
    ------
    FitError
        As `components.fit`; the levels, whose size is not known, coincide with the coefficients.

    """
    basis, count = blocks.basis(), blocks.design.shape[1]
    if basis.shape[1] == count and effect.known is None:
        raise coincidence(effect, count, names)
    mixed = components.fit(
        blocks.design, blocks.indication, [effect], weights=blocks.root**2, names=names
    )
    (component,) = mixed.components
    onto = _combine_rows(blocks, mixed.residual_rms**2, component.value**2)
    target = blocks.root * blocks.indication
    own = hac.covariance(
        lambda part: basis[part],
        target - basis @ (basis.T @ target),
        combinations=combinations @ onto @ basis,
    )
    # a level moves the coefficients by `moved`; the derivative of their covariance by its variance
    moved = onto @ (blocks.root[:, None] * (blocks.log[:, None] == np.arange(blocks.log[-1] + 1)))
    by_noise, by_level = gum.propagate(onto @ basis, own.covariance), moved @ moved.T
    of_noise, of_level = (gum.variance_along(combinations, part) for part in (by_noise, by_level))
    variance = of_noise + component.value**2 * of_level
    spread = (_spread_of_square(component) * of_level) ** 2 / 2.0 + of_noise**2 / own.effective_dof
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = np.where(spread > 0.0, variance**2 / spread, mixed.dof)
    return LevelFit(
        mixed.coefficients,
        by_noise + component.value**2 * by_level,
        np.maximum(dof, 1.0),
        component,
        mixed.predicted[0][:, 0],
    )


def _spread_of_square(component: Component) -> float:
    """Standard uncertainty of the square of a component, of which that of the root was made."""
    value, u = component.value, component.standard_uncertainty
    return 2.0 * value * u if value > 2.0 * u else u**2


def coincidence(effect: Effect, count: int, names: Sequence[str]) -> FitError:
    """Refusal of levels that the coefficients, `count` of them, hold already."""
    return FitError(
        f"the {effect.effect} of each {effect.group} cannot be told from {', '.join(names)}:"
        f" {int(effect.labels.max()) + 1} of them, each at one value of the abscissa, expected more"
        f" than {count}, or changes of the abscissa within each",
        hint="measure more of them, lower the order, or state how much the"
        f" {effect.effect} differs in [[errors.component]]",
    )


def _combine_rows(blocks: Blocks, noise: float, theta: float) -> Array:
    """Matrix [p, k] by which generalised least squares makes the coefficients of the weighted
    blocks.
    """
    weighted = blocks.design * blocks.root[:, None]
    left = weighted.copy()
    for log in range(int(blocks.log[-1]) + 1):
        own = blocks.log == log
        root = blocks.root[own]
        share = theta / (noise + float(root @ root) * theta) if theta > 0.0 else 0.0
        left[own] -= np.outer(root, share * (root @ weighted[own]))
    size = np.sqrt(np.abs(np.einsum("kp,kp->p", weighted, left)))
    inner = (weighted / size).T @ (left / size)
    return np.asarray(np.linalg.solve(inner, (left / size).T) / size[:, None], dtype=np.float64)

"""Which attitudes or stations tell most: optimal design of experiments by coordinate exchange
(Fedorov 1972; Meyer & Nachtsheim 1995).

    y = J p + Z b + e,   b ~ N(0, size²),   e ~ N(0, σ²)        one row of J and Z an observation
    M = Rᵀ R + diag(0, I),   R = [J, Z size] / σ                 information of p and of b/size

A design takes candidates, each of which adds its own information to M: shared errors are parameters
with priors, so that the inverse of M holds the covariance of generalised least squares. Every entry
of the design is exchanged for the candidate that lowers the criterion most, until no exchange
lowers it, from several starts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.fit.shared import Shared
from calibkit.numeric.arrays import Array, Integers

GAIN = 1e-9
"""Relative decrease of a criterion that is no rounding."""


@dataclass(frozen=True, slots=True)
class Pool:
    """Candidates of which a design takes some."""

    base: Array
    """Information [q, q] that every design has: priors, and what is measured already."""
    parts: Array
    """Information [c, q, q] that each candidate adds."""
    target: Array
    """[q, q]: the criterion is tr(M⁻¹ target), the mean variance of what is wanted (I-optimal)."""
    most_uses: int = 1
    """How often a candidate may be taken."""

    def criterion(self, entries: Sequence[int] | Integers) -> float:
        """Criterion of a design; infinite where it does not determine what is wanted."""
        return self._variance(self.base + self.parts[np.asarray(entries)].sum(axis=0))

    def _variance(self, M: Array) -> float:
        """Criterion of the information of a design."""
        if not (np.diag(M) > 0.0).all():
            return np.inf
        try:
            variance = float(np.sum(invert(M) * self.target))
        except np.linalg.LinAlgError:
            return np.inf
        return variance if variance > 0.0 else np.inf

    def exchange(self, entries: Sequence[int]) -> tuple[list[int], float]:
        """Design after exchanges, and its criterion."""
        design, best = list(entries), self.criterion(entries)
        # Information, relative to that of a candidate, that lets a start be worse than determined;
        # 1e-300: a parameter of which no candidate tells anything leaves a matrix with an inverse.
        ridge = np.diag(1e-9 * self.parts.mean(axis=0).diagonal() + 1e-300)
        for _ in range(20):
            before = best
            for place in range(len(design)):
                remaining = [*design[:place], *design[place + 1 :]]
                M = self.base + self.parts[remaining].sum(axis=0)
                # The three best are tried: to first order a candidate lowers the criterion by
                # tr(part · M⁻¹ target M⁻¹).
                inverse = invert(M + ridge)
                lowers = np.einsum("cij,ij->c", self.parts, inverse @ self.target @ inverse)
                free = np.bincount(remaining, minlength=len(self.parts)) < self.most_uses
                ranked = np.argsort(np.where(free, -lowers, np.inf), kind="stable")
                for candidate in ranked[: min(3, int(free.sum()))].tolist():
                    criterion = self._variance(M + self.parts[candidate])
                    if criterion < best * (1.0 - GAIN):
                        design[place], best = candidate, criterion
            if not best < before * (1.0 - GAIN):
                break
        return design, best

    def search(
        self, count: int, rng: np.random.Generator, restarts: int = 3
    ) -> tuple[list[int], float]:
        """Best design of a number of candidates from several random starts, and its criterion. More
        starts of a small one, where few entries can be exchanged, end away from the best.
        """
        available = np.tile(np.arange(len(self.parts)), self.most_uses)
        starts = [
            rng.choice(available, count, replace=False).tolist()
            for _ in range(restarts * max(30 // count, 1))
        ]
        design, best = min(map(self.exchange, starts), key=lambda exchanged: exchanged[1])
        return sorted(design), best


def pool(
    jacobian: Array,
    shared: Sequence[Shared],
    single: Sequence[Shared],
    noise: Array,
    candidate: Integers,
    slopes: Array,
) -> Pool:
    """Candidates, each of the same number of rows; the search makes the mean variance of m
    combinations of the parameters small (I-optimality).

    Parameters
    ----------
    jacobian : [n, p].
    shared, single : errors that candidates share, and that each has of its own, with their sizes.
    noise : [n].
    candidate : [n], number of the candidate of each row.
    slopes : [m, p].

    """
    p, all_rows = jacobian.shape[1], np.arange(len(noise))
    common = [error.design(all_rows) * (error.size or 0.0) for error in shared]
    of_one = [error.loading * (error.size or 0.0) for error in single]
    R = np.hstack([jacobian, *common, *of_one]) / noise[:, None]
    parts = R[np.argsort(candidate, kind="stable")].reshape(
        int(candidate.max()) + 1, -1, R.shape[1]
    )
    moments = np.einsum("cri,crj->cij", parts, parts)
    # what a candidate has of its own is eliminated: A - Bᵀ (C + I)⁻¹ B
    q = R.shape[1] - sum(error.width for error in single)
    A, B, C = moments[:, :q, :q], moments[:, q:, :q], moments[:, q:, q:]
    information = A - np.swapaxes(B, 1, 2) @ np.linalg.solve(C + np.eye(C.shape[1]), B)
    start = np.diag(np.arange(q) >= p).astype(np.float64)
    target = np.zeros_like(start)
    target[:p, :p] = slopes.T @ slopes / len(slopes)
    return Pool(start, information, target)


def spread_apart(directions: Array, occupied: Sequence[int], count: int) -> list[int]:
    """Directions [count] of unit vectors [c, 3] that lie farthest from those that are taken."""
    selection, largest_cosine = [], (directions @ directions[list(occupied)].T).max(axis=1)
    for _ in range(min(count, len(directions) - len(occupied))):
        # rounded, so that of equal angles the first is taken on every machine
        selection.append(int(np.argmin(np.round(largest_cosine, 9))))
        largest_cosine = np.maximum(largest_cosine, directions @ directions[selection[-1]])
    return selection


def invert(M: Array) -> Array:
    """Inverse [..., q, q] of information matrices whose columns differ in size."""
    size = np.sqrt(np.diagonal(M, axis1=-2, axis2=-1))
    outer = size[..., :, None] * size[..., None, :]
    return np.asarray(np.linalg.inv(M / outer) / outer, dtype=np.float64)

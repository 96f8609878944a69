"""Search for the designs that tell most: coordinate exchange (Fedorov 1972; Meyer & Nachtsheim
1995).

A design takes candidates, each of which adds its own information. Every entry of the design is
exchanged for the candidate that lowers the criterion most, until no exchange lowers it, from
several starts. Candidates are ranked by the derivative of the criterion, the best are tried.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers

TRIED = 3
"""Best candidates of an entry, by the derivative of the criterion, that are tried."""
GAIN = 1e-9
"""Relative decrease of a criterion that is no rounding."""
SMALL = 30
"""Entries of as many starts of a small design as count for one: where few entries can be exchanged,
more starts end away from the best.
"""
PASSES = 20
RESTARTS = 3
"""Starts of a search."""
RIDGE = 1e-9
"""Information, relative to that of a candidate, that lets a start be worse than determined."""


@dataclass(frozen=True, slots=True)
class Pool:
    """Candidates of which a design takes some."""

    base: Array
    """Information [q, q] that every design has: priors, and what is measured already."""
    parts: Array
    """Information [c, q, q] that each candidate adds."""
    target: Array | None = None
    """[q, q]: the criterion is tr(M⁻¹ target), the mean variance of what is wanted (I-optimal);
    None: det(M)^(−1/q) (D-optimal).
    """
    most: int = 1
    """How often a candidate may be taken."""

    def criterion(self, chosen: Sequence[int] | Integers) -> float:
        """Criterion of a design; infinite where it does not determine what is wanted."""
        return self._value(self.base + self.parts[np.asarray(chosen)].sum(axis=0))

    def _value(self, matrix: Array) -> float:
        size = np.diag(matrix)
        if not (size > 0.0).all():
            return np.inf
        if self.target is None:
            sign, logarithm = np.linalg.slogdet(matrix)
            return float(np.exp(-logarithm / len(matrix))) if sign > 0 else np.inf
        try:
            value = float(np.sum(invert(matrix) * self.target))
        except np.linalg.LinAlgError:
            return np.inf
        return value if value > 0.0 else np.inf

    def _gains(self, matrix: Array) -> Array:
        """Decrease [c] of the criterion per candidate that is added, to first order."""
        softened = matrix + np.diag(RIDGE * self.parts.mean(axis=0).diagonal() + 1e-300)
        inverse = invert(softened)
        pull = inverse if self.target is None else inverse @ self.target @ inverse
        return np.asarray(np.einsum("cij,ij->c", self.parts, pull), dtype=np.float64)

    def start(self, count: int, rng: np.random.Generator) -> list[int]:
        """Random design of a number of candidates."""
        every = np.tile(np.arange(len(self.parts)), self.most)
        return [int(one) for one in rng.choice(every, count, replace=False)]

    def exchange(self, chosen: Sequence[int]) -> tuple[list[int], float]:
        """Design after exchanges, and its criterion."""
        found = list(chosen)
        best = self.criterion(found)
        for _ in range(PASSES):
            before = best
            for place in range(len(found)):
                others = [*found[:place], *found[place + 1 :]]
                matrix = self.base + self.parts[others].sum(axis=0)
                free = np.bincount(others, minlength=len(self.parts)) < self.most
                gains = np.where(free, self._gains(matrix), -np.inf)
                ranked = [one for one in np.argsort(-gains, kind="stable").tolist() if free[one]]
                for one in ranked[:TRIED]:
                    value = self._value(matrix + self.parts[one])
                    if value < best * (1.0 - GAIN) or (np.isinf(best) and np.isfinite(value)):
                        found[place], best = one, value
            if not best < before * (1.0 - GAIN):
                break
        return found, best

    def search(
        self, count: int, rng: np.random.Generator, restarts: int = RESTARTS
    ) -> tuple[list[int], float]:
        """Best design of a number of candidates from several starts, more of a small one, and its
        criterion.
        """
        starts = restarts * max(SMALL // count, 1)
        tried = [self.exchange(self.start(count, rng)) for _ in range(starts)]
        found, value = min(tried, key=lambda one: one[1])
        return sorted(found), value


def invert(matrix: Array) -> Array:
    """Inverse [..., q, q] of information matrices whose columns differ in size."""
    size = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    outer = size[..., :, None] * size[..., None, :]
    return np.asarray(np.linalg.inv(matrix / outer) / outer, dtype=np.float64)

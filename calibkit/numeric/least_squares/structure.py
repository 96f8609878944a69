"""Rows that stand apart together because they have something in common: an effect, not outliers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers, Mask

TOGETHER = 0.4
"""Share of the rows of a level, two at least, that stand apart together: an effect."""


@dataclass(frozen=True, slots=True)
class Structure:
    """Rows of one level of a group that stand apart together."""

    group: int
    """Index of the group among those that were stated."""
    level: int
    rows: Integers
    """Indices of its rows."""


def find(
    residuals: Array, suspect: Mask, groups: Sequence[Integers]
) -> dict[tuple[int, int], Integers]:
    """Rows of each (group, level) of which a good share is suspect [n]; of that group alone within
    whose levels the residuals [n] of the suspects differ least, because what attitudes share shows
    at every temperature, too.

    Groups are labels [n], −1 for rows without one.
    """
    best: dict[tuple[int, int], Integers] = {}
    least = np.inf
    for number, labels in enumerate(groups):
        rows, suspects = np.bincount(labels + 1), np.bincount(labels + 1, weights=suspect)
        apart = np.flatnonzero(suspects[1:] >= np.maximum(2.0, TOGETHER * rows[1:])).tolist()
        found = {(number, level): np.flatnonzero(labels == level) for level in apart}
        within = [
            np.abs(residuals[own] - np.median(residuals[own]))[suspect[own]]
            for own in found.values()
        ]
        if found and float(np.median(np.concatenate(within))) < least:
            best, least = found, float(np.median(np.concatenate(within)))
    return best

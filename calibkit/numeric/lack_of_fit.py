"""Lack of fit: residuals that differ from group to group by more than their noise.

    F = [Σ n_g (r̄_g - r̄)²/(G - 1)] / [Σ (r - r̄_g)²/(n - G)]      one-way analysis of variance

A grouping has G groups of n_g residuals each, n in all; of several groupings Holm's correction
limits the chance of any false alarm.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers

CHANCE = 0.001
"""Probability with which any grouping of faultless residuals is called a lack of fit."""


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """A grouping whose means differ by more than noise."""

    group: str
    level: int
    """Group with the largest mean."""
    size: float
    """That mean [unit of the residuals]."""


def find(residuals: Array, groupings: Mapping[str, Integers]) -> tuple[LackOfFit, ...]:
    """Groupings of residuals [n] whose means differ, by an F test against the scatter within groups
    with Holm's correction for several tests (1979), the most significant first.

    `groupings` are labels [n] by name, −1 for a row that belongs to no group. Residuals of a fit
    differ less than errors do, so that the test is on the safe side.
    """
    from scipy.special import fdtrc

    tested = []
    for name, labels in groupings.items():
        rows = labels >= 0
        _, level, count = np.unique(labels[rows], return_inverse=True, return_counts=True)
        spare = int(rows.sum()) - count.size
        if count.size < 2 or spare < 1:
            continue
        values = residuals[rows]
        mean = np.bincount(level, values) / count
        variance_within = float(np.sum((values - mean[level]) ** 2)) / spare
        variance_between = float(np.sum(count * (mean - values.mean()) ** 2)) / (count.size - 1)
        # the group of the largest mean beyond what its noise explains
        worst = int(np.argmax(np.abs(mean) * np.sqrt(count)))
        lack = LackOfFit(name, int(labels[rows][level == worst][0]), float(mean[worst]))
        if variance_within > 0.0:
            chance = float(fdtrc(count.size - 1, spare, variance_between / variance_within))
        else:
            chance = 1.0 if variance_between == 0.0 else 0.0
        tested.append((chance, lack))
    tested.sort(key=lambda chance_and_lack: chance_and_lack[0])
    significant = []
    for number, (chance, lack) in enumerate(tested):
        if chance * (len(tested) - number) > CHANCE:
            break
        significant.append(lack)
    return tuple(significant)

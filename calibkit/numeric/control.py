"""Control charts of individuals: outliers among many values of one quantity."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.dispersion import mad_sigma

FEWEST = 10
"""Values from which outliers are named: the MAD of fewer is too uncertain."""
LIMITS = (
    (10, 7.0),
    (15, 5.97),
    (21, 5.27),
    (25, 5.03),
    (40, 4.60),
    (70, 4.38),
    (100, 4.31),
    (200, 4.29),
    (500, 4.39),
    (1000, 4.47),
    (5000, 4.75),
)
"""Values, and the robust z that the largest of so many normal ones exceeds in 1 of 100 samples, by
simulation.
"""
ROUNDING = 1e-12
"""Spread, relative to the largest value, below which values differ by rounding alone."""


@dataclass(frozen=True, slots=True)
class Control:
    """A control chart's lines, and the distance of each value from its centre."""

    centre: float
    """Median."""
    sigma: float
    """Standard deviation that the median absolute deviation stands for; 0 where most values are
    equal.
    """
    limit: float
    """Robust z beyond which a value is named; infinite where none can be."""
    z: Array
    """[n], (value − centre) / sigma; zeros where sigma is 0."""

    @property
    def outliers(self) -> tuple[int, ...]:
        """Values, by index, beyond the limit, the furthest first."""
        order = np.argsort(-np.abs(self.z), kind="stable")
        return tuple(int(k) for k in order if abs(self.z[k]) > self.limit)

    @classmethod
    def chart(cls, values: Array) -> Self:
        """Centre line, limits and robust z of values [n] ≥ 1 of one quantity; outliers up to half
        of them move neither.
        """
        centre = float(np.median(values))
        sigma = mad_sigma(values - centre)
        if sigma <= ROUNDING * float(np.max(np.abs(values))):
            return cls(centre, 0.0, math.inf, np.zeros(len(values)))
        return cls(centre, sigma, _limit(len(values)), (values - centre) / sigma)


def _limit(count: int) -> float:
    """Robust z that no one of `count` normal values exceeds in 99 samples of 100; infinite for
    fewer than 10.

    Hampel's identifier with a limit that grows with the sample (Davies & Gather 1993).
    """
    if count < FEWEST:
        return math.inf
    counts, limits = zip(*LIMITS, strict=True)
    return float(np.interp(math.log(count), np.log(counts), limits))

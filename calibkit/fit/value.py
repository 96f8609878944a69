"""A result with its uncertainty."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array

COVERAGE = 0.97725
"""Probability below the upper end of an interval of 95.45 %, that of two standard deviations of a
normal distribution.
"""


@dataclass(frozen=True, slots=True)
class Value:
    """Values [...] with standard uncertainty and effective degrees of freedom [...]."""

    value: Array
    u: Array
    dof: Array
    lack_of_fit: Array | float = 0.0
    """Size of what the form of the model leaves, in U twice beside t u."""
    half_width: Array | float = 0.0
    """Distance of two readings of the data between which no test decides; added to U."""

    @property
    def expanded(self) -> Array:
        """U for 95.45 %: half-width + √((t u)² + (2 l)²)."""
        from scipy.special import stdtrit

        t = stdtrit(self.dof, COVERAGE)
        spread = np.hypot(t * self.u, 2.0 * np.asarray(self.lack_of_fit))
        return np.asarray(self.half_width + spread, dtype=np.float64)

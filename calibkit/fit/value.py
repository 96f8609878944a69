"""A result with its uncertainty."""

from dataclasses import dataclass

import numpy as np

from calibkit.numeric.arrays import Array

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

    @property
    def expanded(self) -> Array:
        """U for 95.45 %: t u, t Student's quantile."""
        from scipy.special import stdtrit

        return np.asarray(stdtrit(self.dof, COVERAGE) * self.u, dtype=np.float64)

"""How far values scatter: root mean square, and the standard deviation that the median absolute
deviation stands for.
"""

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array

MAD_TO_SIGMA = 1.4826022185056018
"""Standard deviation of a normal distribution over its median absolute deviation, 1/Φ⁻¹(3/4)."""
MAD_OF_UNIT_NORMAL = 0.6745
"""Median absolute deviation of a normal distribution of unit variance, to the digits that wavelet
thresholds are published with (Donoho & Johnstone 1994).
"""


def mad_sigma(deviations: Array) -> float:
    """Standard deviation of normal noise from the median magnitude of deviations [n] from its
    centre: outliers, up to half of the values, hardly move it.
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(deviations)))


def rms(values: ArrayLike) -> float:
    """Root mean square of values [n]; NaN for no values."""
    square = np.asarray(values, dtype=np.float64) ** 2
    return float(np.sqrt(np.mean(square))) if square.size else float("nan")

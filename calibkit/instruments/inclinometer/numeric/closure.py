"""Noise of a reading estimated from the closures of stations, and detection of stations with an
outlier.
"""

import numpy as np

from calibkit.arrays import Array, Integers, Mask

FEWEST = 8
"""Fewest stations for outlier detection: the median of fewer is too uncertain."""
IMPROBABLE = 1e-20
"""Probability of a closure by noise below which it is an outlier: 9.3 standard deviations with one
degree of freedom.

With eight stations of one degree of freedom 0.08 % of campaigns have such a closure by chance,
with twelve 0.02 %, because the median of a few stations is uncertain itself.
"""


def usual_square(squares: Array, dof: Integers) -> float:
    """Variance of one reading from the median of sums of squares [n] with degrees of freedom [n];
    robust against one outlier.

    The median is divided by that of χ²/ν at the median degrees of freedom, which is not 1; NaN
    where no station has any.
    """
    known = dof > 0
    if not known.any():
        return float("nan")
    from scipy.special import gammaincinv

    median_dof = float(np.median(dof[known]))
    median = 2.0 * float(gammaincinv(median_dof / 2.0, 0.5)) / median_dof
    return float(np.median(squares[known] / dof[known])) / median


def find_outliers(squares: Array, dof: Integers, least: float) -> Mask:
    """Mask [n] of stations with an outlier: their sums of squares are far above those of the usual
    variance, or of `least` if that is larger.
    """
    found = np.zeros(squares.size, dtype=np.bool_)
    known = dof > 0
    if int(known.sum()) < FEWEST:
        return found
    from scipy.special import chdtri

    variance = max(usual_square(squares, dof), least)
    found[known] = squares[known] > variance * chdtri(dof[known], IMPROBABLE)
    return found


def estimate_noise(squares: Array, dof: Integers) -> float:
    """Standard deviation of one reading from sums of squares [n] with degrees of freedom [n]; 0
    where there are none.
    """
    total = int(dof.sum())
    return float(np.sqrt(squares.sum() / total)) if total else 0.0

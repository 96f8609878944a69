"""Noise of a reading from how stations close, and the stations that hold an outlier."""

import numpy as np

from calibkit.arrays import Array, Integers, Mask

FEWEST = 8
"""Stations below which their median is too uncertain to find outliers."""
IMPROBABLE = 1e-20
"""Probability of a closure from which it is no noise: 9.3 standard deviations with one degree of
freedom.

With eight stations of one degree of freedom 0.08 % of campaigns have such a one by chance, with
twelve 0.02 %: the median of few is uncertain itself.
"""


def usual_square(squares: Array, dof: Integers) -> float:
    """Variance of one reading from sums of squares [n] with degrees of freedom [n], by their
    median: one outlier does not move it.

    The median of χ²/ν is not 1: it is divided by that of the median degrees of freedom. NaN where
    no station has any.
    """
    known = dof > 0
    if not known.any():
        return float("nan")
    from scipy.special import gammaincinv

    median_dof = float(np.median(dof[known]))
    median = 2.0 * float(gammaincinv(median_dof / 2.0, 0.5)) / median_dof
    return float(np.median(squares[known] / dof[known])) / median


def find_outliers(squares: Array, dof: Integers, least: float) -> Mask:
    """Which stations [n] hold an outlier: their squares are far above the usual variance, or above
    the `least` that it can be.
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

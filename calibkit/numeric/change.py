"""How a number that was determined year after year has changed, and when it reaches a limit.

y = a + b (t - t̄),  w_i = 1/u_i²,  u_b² = max(1, R_B²)/Σ w (t - t̄)²,  R_B the Birge ratio
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibkit.numeric import gum
from calibkit.numeric.arrays import Array

EXTRAPOLATED = 2.0
"""Largest extrapolation of a line, in spans of the years that were measured."""
STEPS = 1000


@dataclass(frozen=True, slots=True)
class Trend:
    """Straight line through determinations over years: value at the middle, slope a year with its
    uncertainty, scatter in u, number of determinations.
    """

    middle_year: float
    intercept: float
    slope: float
    standard_uncertainty: float
    birge_ratio: float
    u_intercept: float
    count: int

    @property
    def coverage_factor(self) -> float:
        """2 where the values scatter as their uncertainties state, else Student's factor for the
        scatter of that many.
        """
        # a scatter that was taken from the values themselves has two degrees of freedom less than
        # there are values
        return gum.coverage_factor(self.count - 2 if self.birge_ratio > 1.0 else math.inf)

    def expand(self, year: ArrayLike) -> tuple[Array, Array]:
        """Value at years and its expanded uncertainty."""
        ahead = np.asarray(year) - self.middle_year
        # about the weighted middle, level and slope are uncorrelated
        u = np.hypot(self.u_intercept, self.standard_uncertainty * ahead)
        return self.intercept + self.slope * ahead, self.coverage_factor * u


@dataclass(frozen=True, slots=True)
class Reach:
    """Years in which a line reaches a limit: with the widest slope, by itself, with the narrowest;
    None where it does not within `until`, up to which it is extrapolated.
    """

    earliest: float | None
    expected: float | None
    latest: float | None
    until: float


def reach(line: Trend, last: float, span: float, low: float, high: float) -> Reach:
    """When a line leaves the range from low to high after the last of its determinations,
    extrapolated over no more than EXTRAPOLATED times the span [years] that was measured.
    """
    until = last + EXTRAPOLATED * span
    years = np.linspace(last, until, STEPS)
    value, U = line.expand(years)
    # the line or its band leaves the range: first with U outwards, then itself, then with all U
    leaving = (
        (value - U < low) | (value + U > high),
        (value < low) | (value > high),
        (value + U < low) | (value - U > high),
    )
    earliest, expected, latest = (
        float(years[beyond][0]) if beyond.any() else None for beyond in leaving
    )
    return Reach(earliest, expected, latest, until)


def trend(years: Array, values: Array, standard_uncertainty: Array) -> Trend | None:
    """Weighted straight line through values [n] at years [n]; None for fewer than three dates or a
    zero uncertainty.

    The slope's uncertainty is multiplied by the Birge ratio where the values scatter more about the
    line than their uncertainties state (Birge 1932); it is never made smaller.
    """
    # a line through two dates has no scatter to be tested by
    if np.unique(years).size < 3 or not (standard_uncertainty > 0.0).all():
        return None
    middle = float(np.average(years, weights=standard_uncertainty**-2.0))
    line, covariance = np.polyfit(
        years - middle, values, 1, w=1.0 / standard_uncertainty, cov="unscaled"
    )
    left = (values - np.polyval(line, years - middle)) / standard_uncertainty
    # scatter about the line over what the uncertainties let expect
    birge = math.sqrt(float(left @ left) / (values.size - 2))
    u_slope, u_mean = max(birge, 1.0) * np.sqrt(np.diag(covariance))
    slope, mean = line.tolist()
    return Trend(middle, mean, slope, float(u_slope), birge, float(u_mean), values.size)

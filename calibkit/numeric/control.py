"""Control charts of individuals: outliers among many values of one quantity.

    z_i = (y_i - median)/σ, σ by the MAD      outlier beyond a limit that grows with the values

Values that state an uncertainty are divided by √(u_i² + s²), s² what they differ beyond it; skewed
ones are judged after a power transform (Box & Cox 1964).
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.numeric.arrays import Array
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
FEWEST_SKEWED = 50
"""Values from which the skewness of their distribution is known well enough to be allowed for."""
WIDER = 1.08
"""Factor of the limit where more is estimated than a median and a spread: the power that makes a
distribution symmetric, or a spread that a part of the values tells. By simulation.
"""
MOST_PRECISE = 0.9
"""Share of values of equal weight, below which a part of the values tells the spread."""
MANY_DOF = 1e4
"""Degrees of freedom from which on an uncertainty is taken as known."""
BISECTIONS = 40
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
    """[n], distance from the centre over the value's own standard deviation, as a normal deviate:
    (value − centre) / sigma where no uncertainty is stated; zeros where sigma is 0.
    """
    ends: tuple[float, float]
    """Values of the usual uncertainty whose z is the limit; infinite where none can be named."""

    @property
    def outliers(self) -> tuple[int, ...]:
        """Values, by index, beyond the limit, the furthest first."""
        order = np.argsort(-np.abs(self.z), kind="stable")
        return tuple(int(k) for k in order if abs(self.z[k]) > self.limit)

    @classmethod
    def chart(
        cls, values: Array, uncertainties: Array | None = None, dof: Array | None = None
    ) -> Self:
        """Centre line, limits and robust z of values [n] ≥ 1 of one quantity; outliers up to half
        of them move neither.

        A value that states an uncertainty [n], with degrees of freedom [n], is judged by it and by
        what the values differ beyond their uncertainties. Positive values without any, which are
        skewed by nature (a residual, a nonlinearity), are judged on the scale of a power of them.
        """
        centre = float(np.median(values))
        sigma = mad_sigma(values - centre)
        if sigma <= ROUNDING * float(np.max(np.abs(values))):
            return cls(centre, 0.0, math.inf, np.zeros(len(values)), (-math.inf, math.inf))
        limit = _limit(len(values))
        if uncertainties is not None and np.any(uncertainties > 0.0):
            degrees = np.full(len(values), np.inf) if dof is None else dof
            middle, scatter_between, z = _between(values, uncertainties, degrees, sigma)
            usual = math.hypot(float(np.median(uncertainties)), scatter_between)
            # the precise values alone tell how much the values differ
            precise = (
                1.0 / np.maximum(np.hypot(uncertainties, scatter_between), ROUNDING * sigma) ** 2
            )
            count = int(precise.sum() ** 2 / np.sum(precise**2))
            if count < MOST_PRECISE * len(values):
                limit = WIDER * max(limit, _limit(max(count, FEWEST)))
            return cls(centre, sigma, limit, z, (middle - limit * usual, middle + limit * usual))
        from scipy.special import boxcox, inv_boxcox  # slow to import

        # skewed values are judged as powers of them
        power = _power(values)
        straight: Array = values if power == 1.0 else np.asarray(boxcox(values, power))
        limit *= 1.0 if power == 1.0 else WIDER
        middle = float(np.median(straight))
        spread = mad_sigma(straight - middle)
        ends = middle + np.array([-limit, limit]) * spread
        if power != 1.0:
            # the values of which these are the powers; 0 where none is so small
            ends = np.nan_to_num(inv_boxcox(ends, power))
        return cls(centre, sigma, limit, (straight - middle) / spread, tuple(ends.tolist()))


def _between(
    values: Array, uncertainties: Array, dof: Array, largest: float
) -> tuple[float, float, Array]:
    """Centre of values [n], the standard deviation, up to `largest`, by which they differ beyond
    their uncertainties [n], and the normal deviates [n] of their distances: that standard deviation
    makes the usual deviate what it is of normal values.
    """
    from scipy.special import ndtri, stdtr  # slow to import

    low, high = 0.0, largest
    order, usual = np.argsort(values), float(np.median(uncertainties))
    for _ in range(BISECTIONS):
        scatter_between = (low + high) / 2.0
        own_sigma = np.maximum(np.hypot(uncertainties, scatter_between), ROUNDING * largest)
        weights = np.cumsum(1.0 / own_sigma[order])
        centre = float(values[order[np.searchsorted(weights, weights[-1] / 2.0)]])
        # of an uncertainty from few values, a small one is small by chance
        raised = np.maximum(
            own_sigma / np.maximum(uncertainties, max(usual, ROUNDING * largest)), 1.0
        )
        z, degrees = (values - centre) / own_sigma, dof * raised**4
        few = degrees < MANY_DOF
        if few.any():  # normal deviates as improbable as Student's ratios
            tail = np.maximum(stdtr(degrees[few], -np.abs(z[few])), np.finfo(float).tiny)
            z[few] = -np.sign(z[few]) * ndtri(tail)
        # the scatter at which the median deviate is that of normal values
        low, high = (scatter_between, high) if mad_sigma(z) > 1.0 else (low, scatter_between)
    return centre, scatter_between, z


def _power(values: Array) -> float:
    """Power, from 0 (the logarithm) to 1, that puts the deciles of positive values [n] at equal
    distances from their median (Box & Cox 1964); 1 for few values or where some are not positive.
    """
    if len(values) < FEWEST_SKEWED or not np.all(values > 0.0):
        return 1.0
    from scipy.special import boxcox  # slow to import

    low, high = 0.0, 1.0
    deciles = np.quantile(values, (0.1, 0.5, 0.9))
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        lower_step, upper_step = np.diff(boxcox(deciles, middle))
        low, high = (low, middle) if upper_step > lower_step else (middle, high)
    return (low + high) / 2.0


def _limit(count: int) -> float:
    """Robust z that no one of `count` normal values exceeds in 99 samples of 100; infinite for
    fewer than 10.

    Hampel's identifier with a limit that grows with the sample (Davies & Gather 1993).
    """
    if count < FEWEST:
        return math.inf
    counts, limits = zip(*LIMITS, strict=True)
    return float(np.interp(math.log(count), np.log(counts), limits))

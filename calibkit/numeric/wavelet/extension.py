"""Coefficients of a wavelet transform level by level, and how they go on beyond the ends of a
signal where a filter reaches over them.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.chunks import release
from calibkit.numeric.wavelet.shrinkage import estimate_noise

Extension = Literal["symmetric", "antisymmetric", "trend", "constant", "periodic"]
EXTENSIONS: tuple[Extension, ...] = get_args(Extension)
Span = tuple[int, int]
"""First index and one past the last; empty where its end is at or before its start."""

SIGNIFICANT = 6.0
"""Slope at an end, in standard errors by white noise, beyond which the signal moves there: flicker
noise makes some slope too.
"""
STRETCH = 16
"""Samples of the shortest section that a straight line is fitted to at an end."""
MOST_VALUES = 1 << 16
"""Values that a line is sought in at an end; of more samples, means of some are taken, so that
memory is bounded.
"""


@dataclass(frozen=True, slots=True)
class Coefficients:
    """Approximations or details [n] of a level, 0 the signal itself.

    Element 0 has the index `first`. Index i lies at sample 2^level i, but for the delay of the
    filters.
    """

    values: Array
    first: int
    level: int

    @property
    def span(self) -> Span:
        """Indices that are known."""
        return self.first, self.first + self.values.size

    def interpolate(self, position: Array) -> Array:
        """Values between indices, along straight lines; beyond those known, the last of them."""
        below = np.clip(np.floor(position).astype(np.int64) - self.first, 0, self.values.size - 1)
        above = np.minimum(below + 1, self.values.size - 1)
        share = np.clip(position - self.first - below, 0.0, 1.0)
        return self.values[below] + share * (self.values[above] - self.values[below])

    def part(self, span: Span) -> Array:
        """Those with given indices, which are known."""
        return self.values[max(span[0] - self.first, 0) : max(span[1] - self.first, 0)]


@dataclass(frozen=True, slots=True)
class Ends:
    """How a signal of some length goes on beyond its ends, and the approximations of each level.

    "symmetric" mirrors at the end samples, x(−k) = x(k); "antisymmetric" reflects in the end
    points, x(−k) = 2 x(0) − x(k), which keeps a linear trend but carries the noise of one sample
    outwards; "trend" mirrors about a straight line through the end, x(−k) = x(k) − 2 k slope, which
    keeps a linear trend with no more noise than a mirrored signal has; "constant" holds the end
    values; "periodic" joins the two ends.
    """

    extension: Extension
    length: int
    delay: float = 0.0
    """Sample about which the filter of approximation 0 of level 1 lies."""
    slopes: tuple[float, float] = (0.0, 0.0)
    """Of "trend" [unit of the signal per sample]; 0 for other extensions."""

    def extend(self, known: Coefficients, span: Span) -> Array:
        """Approximations of given indices, whether known or not."""
        low, high = known.span
        if low <= span[0] and span[1] <= high:
            return known.part(span)
        index = np.arange(*span, dtype=np.float64)
        extended = known.interpolate(index)
        apart = 2.0**known.level
        # a step of one index is `apart` samples, an approximation √apart times what it is of
        scale = apart * math.sqrt(apart)
        for sample, outside, slope, inwards in (
            (0, index < low, self.slopes[0], self.length),
            (self.length - 1, index >= high, self.slopes[1], -self.length),
        ):
            beyond = index[outside]
            end = (sample - self.delay * (apart - 1.0)) / apart
            mirrored = known.interpolate(2.0 * end - beyond)
            match self.extension:
                case "periodic":
                    extended[outside] = known.interpolate(beyond + inwards / apart)
                case "constant":
                    extended[outside] = known.interpolate(np.array([end]))
                case "antisymmetric":
                    extended[outside] = 2.0 * known.interpolate(np.array([end])) - mirrored
                case _:
                    extended[outside] = mirrored + 2.0 * (beyond - end) * slope * scale
        return extended


def fit_slopes(signal: Array, extension: Extension, longest: int) -> tuple[float, float]:
    """Slopes [unit of the signal per sample] at both ends of a signal [n] that "trend" extends it
    by, from lines through at most so many samples; 0 for other extensions.
    """
    if extension != "trend":
        return 0.0, 0.0
    slopes = _end_slope(signal, longest), -_end_slope(signal[::-1], longest)
    release(signal)
    return slopes


def _end_slope(end: Array, longest: int) -> float:
    """Slope at sample 0 of the straight line through the longest section from there that is still
    straight; 0 where it is not beyond its noise, as at an end at rest.

    Sections grow by halves for as long as the values at sample 0 of the
    lines fitted to all of them agree within two standard errors, each 2 σ/√m for m samples
    (intersection of confidence intervals, Goldenshluger & Nemirovski 1997), with σ estimated from
    the differences of neighbouring samples.
    """
    limit = min(longest, end.size)
    if limit < STRETCH:
        return 0.0
    apart = -(-limit // MOST_VALUES)
    means = end[: limit // apart * apart].reshape(-1, apart).mean(axis=1) - end[0]
    spread = estimate_noise(np.diff(means)) / math.sqrt(2.0)
    sizes = [STRETCH]
    while sizes[-1] < means.size:
        sizes.append(min(sizes[-1] + sizes[-1] // 2, means.size))
    starts, m = [0, *sizes[:-1]], np.array(sizes, dtype=np.float64)
    total = np.cumsum(np.add.reduceat(means, starts))
    moment = np.cumsum(np.add.reduceat(means * np.arange(means.size), starts))
    # squared distances of the places 0 … m − 1 from their middle, added up
    squares = m * (m**2 - 1.0) / 12.0
    slope = (moment - total * (m - 1.0) / 2.0) / squares
    value = total / m - slope * (m - 1.0) / 2.0
    margin = 4.0 * spread / np.sqrt(m)
    low, high = np.maximum.accumulate(value - margin), np.minimum.accumulate(value + margin)
    straight = np.count_nonzero(low <= high) - 1
    if straight < 0 or abs(slope[straight]) <= SIGNIFICANT * spread / math.sqrt(squares[straight]):
        return 0.0
    return float(slope[straight]) / apart

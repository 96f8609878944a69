"""Coefficients of a wavelet transform level by level, and how they go on beyond the ends of a
signal where a filter reaches over them.
"""

import math
from dataclasses import dataclass
from typing import Literal, Self, get_args

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
        """Those with given indices, as far as they are known."""
        return self.values[max(span[0] - self.first, 0) : max(span[1] - self.first, 0)]


@dataclass(frozen=True, slots=True)
class End:
    """Value of a signal at an end [unit of the signal], and whether it is reflected in that point
    rather than mirrored.
    """

    value: float
    reflected: bool


@dataclass(frozen=True, slots=True)
class Ends:
    """How a signal of some length goes on beyond its ends, and the approximations of each level.

    "symmetric" mirrors at the end samples, x(−k) = x(k); "antisymmetric" reflects in the end
    points, x(−k) = 2 x(0) − x(k), which keeps a linear trend but carries the noise of one sample
    into the whole extension; "trend" reflects in the value at the end of a straight line fitted to
    the last samples, which keeps a linear trend and averages the noise, or mirrors where that line
    has no slope beyond its noise, so that an end at rest has no error of its own; "constant" holds
    the end values; "periodic" joins the two ends.
    """

    extension: Extension
    length: int
    delay: float
    """Sample about which the filter of approximation 0 of level 1 lies."""
    left: End
    right: End

    @classmethod
    def fit(cls, signal: Array, extension: Extension, delay: float, window: int) -> Self:
        """Ends of a signal [n]; "trend" fits its lines to at most `window` samples."""
        left, right = (End(float(signal[k]), extension != "symmetric") for k in (0, -1))
        if extension == "trend":
            left, right = _fit_end(signal, window), _fit_end(signal[::-1], window)
            release(signal)
        return cls(extension, signal.size, delay, left, right)

    def extend(self, known: Coefficients, span: Span) -> Array:
        """Approximations of given indices, whether known or not."""
        low, high = known.span
        if low <= span[0] and span[1] <= high:
            return known.part(span)
        before = self._reflect(known, self.left, 0, (span[0], min(low, span[1])))
        behind = self._reflect(known, self.right, self.length - 1, (max(high, span[0]), span[1]))
        return np.concatenate((before, known.part(span), behind))

    def _reflect(self, known: Coefficients, end: End, sample: int, span: Span) -> Array:
        """Approximations of given indices beyond an end, which lies at a sample."""
        index, apart = np.arange(*span, dtype=np.float64), 2.0**known.level
        # an approximation is √apart times what it is of
        value = end.value * math.sqrt(apart)
        if self.extension == "constant":
            return np.full(index.size, value)
        if self.extension == "periodic":
            period = self.length / apart
            return known.interpolate(index + period if sample == 0 else index - period)
        place = (sample - self.delay * (apart - 1.0)) / apart
        mirrored = known.interpolate(2.0 * place - index)
        return 2.0 * value - mirrored if end.reflected else mirrored


def _fit_end(end: Array, window: int) -> End:
    """Value at sample 0 of the straight line through the longest section from there that is still
    straight; reflected if the line, if need be of twice the window, has a slope beyond its noise.

    Sections grow by halves up to the window for as long as the values at sample 0 of the lines
    fitted to all of them agree within two standard errors, each 2 σ/√m for m samples (intersection
    of confidence intervals, Goldenshluger & Nemirovski 1997), with σ estimated from the differences
    of neighbouring samples.
    """
    limit = min(2 * window, end.size)
    if limit < 3:
        return End(float(end[0]), reflected=True)
    apart = -(-limit // MOST_VALUES)
    means = end[: limit // apart * apart].reshape(-1, apart).mean(axis=1) - end[0]
    window = min(window // apart, means.size)
    sizes = [min(STRETCH, window)]
    for most in (window, means.size):
        while sizes[-1] < most:
            sizes.append(min(sizes[-1] + sizes[-1] // 2, most))
    spread = estimate_noise(np.diff(means[: max(window, STRETCH)])) / math.sqrt(2.0)
    starts, m = [0, *sizes[:-1]], np.array(sizes, dtype=np.float64)
    total = np.cumsum(np.add.reduceat(means, starts))
    moment = np.cumsum(np.add.reduceat(means * np.arange(means.size), starts))
    # squared distances of the places 0 … m − 1 from their middle, added up
    squares = m * (m**2 - 1.0) / 12.0
    slope = (moment - total * (m - 1.0) / 2.0) / squares
    # sample 0 lies half a mean before the middle of the first
    value = total / m - slope * ((m - 1.0) / 2.0 + (apart - 1.0) / (2.0 * apart))
    margin = 4.0 * spread / np.sqrt(m)
    low, high = np.maximum.accumulate(value - margin), np.minimum.accumulate(value + margin)
    straight = int(np.count_nonzero(low <= high)) - 1
    if straight < 0:
        return End(float(end[0]), reflected=True)
    moves = abs(slope[straight]) > SIGNIFICANT * spread / math.sqrt(squares[straight])
    within_window = min(straight, sizes.index(window))
    return End(float(end[0] + value[within_window]), bool(moves))

"""How a signal is extended beyond its ends where a filter reaches over them."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Self, get_args

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import chunks
from calibkit.numeric.wavelet.shrinkage import estimate_noises

Extension = Literal["symmetric", "antisymmetric", "trend", "constant", "periodic"]
EXTENSIONS: tuple[Extension, ...] = get_args(Extension)

SIGNIFICANT = 6.0
"""Slope at an end, in standard errors by white noise, beyond which the signal moves there: flicker
noise makes some slope too.
"""
LONGER = 2
"""Sections that show whether the signal moves at an end, in windows of the line that gives the
value there.
"""
STRETCH = 16
"""Samples of the shortest section that a straight line is fitted to at an end."""


@dataclass(frozen=True, slots=True)
class Continuation:
    """How a signal goes on beyond its ends, and the values that it is reflected in [signal's unit].

    "symmetric" mirrors at the end samples, x(−k) = x(k); "antisymmetric" reflects in the end
    points, x(−k) = 2 x(0) − x(k), which keeps a linear trend but carries the noise of one sample
    into the whole extension; "trend" reflects in the value at the end of a straight line fitted to
    the last samples, which keeps a linear trend and averages the noise, or mirrors where that line
    has no slope beyond its noise, so that an end at rest has no error of its own; "constant" holds
    the end values; "periodic" joins the two ends.
    """

    extension: Extension
    left: float
    right: float
    turned: tuple[bool, bool] = (True, True)
    """Whether the signal is reflected in the value at each end, not mirrored."""

    @classmethod
    def fit(cls, signal: Array, extension: Extension, window: int) -> Self:
        """Continuation of a signal [n]; "trend" fits its lines to at most `window` samples."""
        if extension == "trend":
            (left, moves), (right, goes) = (_fit_end(x, window) for x in (signal, signal[::-1]))
            return cls(extension, left, right, (moves, goes))
        reflected = extension != "symmetric"
        return cls(extension, float(signal[0]), float(signal[-1]), (reflected, reflected))


def continue_signal(signal: Array, start: int, stop: int, beyond: Continuation) -> Array:
    """Samples start … stop − 1 of a signal [n] that goes on beyond its ends."""
    n = signal.size
    if start >= 0 and stop <= n:
        return signal[start:stop]
    if beyond.extension in {"periodic", "constant"} or n < 3:
        return _folded(signal, np.arange(start, stop), beyond)
    # reflected once by slices, farther out sample by sample: what a sample is does not depend on
    # what is asked for with it
    low, high = (min(max(bound, 2 - n), 2 * n - 2) for bound in (start, stop))
    before = signal[max(1, 1 - high) : max(1 - low, 1)][::-1]
    behind = signal[max(2 * n - 1 - high, 0) : min(n - 1, 2 * n - 1 - low)][::-1]
    before = 2.0 * beyond.left - before if beyond.turned[0] else before
    behind = 2.0 * beyond.right - behind if beyond.turned[1] else behind
    once = (before, signal[max(low, 0) : max(high, 0)], behind)
    if low == start and high == stop:
        return np.concatenate(once)
    left = _folded(signal, np.arange(start, min(stop, 2 - n)), beyond)
    right = _folded(signal, np.arange(max(start, 2 * n - 2), stop), beyond)
    return np.concatenate((left, *once, right))


def _folded(signal: Array, at: Integers, beyond: Continuation) -> Array:
    """Samples at any indices, however often the signal's length lies between them and the
    signal.
    """
    n = signal.size
    if beyond.extension == "periodic":
        return signal[at % n]
    if beyond.extension == "constant":
        return signal[np.clip(at, 0, n - 1)]
    last, ends = max(n - 1, 1), np.array([2.0 * beyond.left, 2.0 * beyond.right])
    at, sign, added = at.copy(), np.ones(at.size), np.full(at.size, -0.0)  # keeps signs of zeros
    while True:
        sides = (np.flatnonzero(at < 0), np.flatnonzero(at > last))
        if not sides[0].size and not sides[1].size:
            return np.asarray(added + sign * signal[np.minimum(at, n - 1)], dtype=np.float64)
        for side, rows in enumerate(sides):
            at[rows] = 2 * last * side - at[rows]
            if beyond.turned[side]:
                added[rows] += sign[rows] * ends[side]
                sign[rows] = -sign[rows]


def window_of(levels: int) -> int:
    """Samples that the lines at the ends are fitted to before a transform over so many levels."""
    return 3 << (levels - 1)


def lengths_at_end(size: int, window: int) -> tuple[int, int, int]:
    """Numbers of samples that show the noise at an end, that show whether the signal moves there,
    and of the window, on a signal of a size.
    """
    window = min(max(window, 2), size)
    return min(max(window, STRETCH), size), min(LONGER * window, size), window


@lru_cache(maxsize=64)
def sections(window: int, limit: int) -> tuple[Array, Array]:
    """Sizes of the sections at an end, which grow by halves to the window and on to a limit, and
    the sum of the squared distances of their samples from their middle.
    """
    sizes = [min(STRETCH, window)]
    for most in (window, limit):
        while sizes[-1] < most:
            sizes.append(min(sizes[-1] + sizes[-1] // 2, most))
    m = np.array(sizes, dtype=np.float64)
    return m, m * (m**2 - 1.0) / 12.0


def _sums(end: Array, sizes: Array) -> Array:
    """Sums [k, 2] above sample 0 of the samples that each section of given sizes [k] adds to the
    one before, by themselves and times their place; one section is in memory at a time.
    """
    found, first = np.empty((sizes.size, 2)), 0
    for k, stop in enumerate(sizes.astype(np.int64).tolist()):
        above = np.empty(stop - first)
        for a, b in chunks.ranges(above.size):
            np.subtract(end[first + a : first + b], end[0], out=above[a:b])
            chunks.release(end)
        # in the order of the compiled sums
        found[k, 0] = np.add.reduceat(above, [0])[0]
        for a, b in chunks.ranges(above.size):
            above[a:b] *= np.arange(first + a, first + b)
        found[k, 1] = np.add.reduceat(above, [0])[0]
        first = stop
    return found


def _fit_end(end: Array, window: int) -> tuple[float, bool]:
    """Value at sample 0 of the straight line through the longest section from there that is still
    straight, and whether the line, if need be of twice the window, has a slope beyond its noise.

    Sections grow by halves up to the window for as long as the values fitted to all of them agree
    within two standard errors, each 2 σ/√size (intersection of confidence intervals, Goldenshluger
    & Nemirovski 1997), with σ estimated from the differences of neighbouring samples.
    """
    known, limit, window = lengths_at_end(end.size, window)
    if window < 3:
        return float(end[0]), True
    steps = np.empty(known - 1)
    for a, b in chunks.ranges(steps.size):
        np.subtract(end[a + 1 : b + 1], end[a:b], out=steps[a:b])
        chunks.release(end)
    spread = estimate_noises([steps])[0] / math.sqrt(2.0)
    del steps
    sizes, squares = sections(window, limit)
    totals, moments = np.cumsum(_sums(end, sizes), axis=0).T
    slopes = (moments - totals * (sizes - 1.0) / 2.0) / squares
    fitted = totals / sizes - slopes * (sizes - 1.0) / 2.0
    margins = 4.0 * spread / np.sqrt(sizes)
    lows = np.maximum.accumulate(fitted - margins)
    apart = lows > np.minimum.accumulate(fitted + margins)
    straight = int(np.argmax(apart)) - 1 if apart.any() else sizes.size - 1
    if straight < 0:
        return float(end[0]), True
    moves = abs(slopes[straight]) > SIGNIFICANT * spread / math.sqrt(squares[straight])
    taken = min(straight, int(np.searchsorted(sizes, window)))
    return float(end[0] + fitted[taken]), bool(moves)

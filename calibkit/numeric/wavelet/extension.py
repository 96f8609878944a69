"""How a signal goes on beyond its ends, where the filters of a wavelet transform reach over them.

"symmetric" mirrors at the end samples, x(−k) = x(k); "antisymmetric" reflects in the end points,
x(−k) = 2 x(0) − x(k), which keeps a linear trend but carries the noise of one sample into the whole
extension; "trend" reflects in the value at the end of a straight line fitted to the last samples,
which keeps a linear trend and averages the noise, or mirrors where that line has no slope beyond
its noise, so that an end at rest has no error of its own.
"""

import math
from typing import Literal, NamedTuple, get_args

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.wavelet.shrinkage import estimate_noise

Extension = Literal["symmetric", "antisymmetric", "trend"]
EXTENSIONS: tuple[Extension, ...] = get_args(Extension)

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


class End(NamedTuple):
    """Value of a signal at an end [unit of the signal], and whether it is reflected in that point
    rather than mirrored.
    """

    value: float
    reflected: bool


def find_end(signal: Array, extension: Extension, window: int) -> End:
    """End of a signal [n] at its first sample; "trend" fits its line to at most `window` samples,
    or twice as many.
    """
    if extension == "trend":
        return _fit_end(signal, window)
    return End(float(signal[0]), reflected=extension == "antisymmetric")


def beyond(signal: Array, end: End, count: int) -> Array:
    """The `count` samples before the first one of a signal [n]; of a signal that is shorter, the
    reflection is repeated.
    """
    kind: Literal["odd", "even"] = "odd" if end.reflected else "even"
    padded = np.pad(signal[: count + 1], (count, 0), "reflect", reflect_type=kind)
    # NumPy reflects in the first sample itself
    shift = 2.0 * (end.value - float(signal[0])) if end.reflected else 0.0
    return np.asarray(padded[:count] + shift)


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
    per_mean = -(-limit // MOST_VALUES)
    means = end[: limit // per_mean * per_mean].reshape(-1, per_mean).mean(axis=1) - end[0]
    window = min(window // per_mean, means.size)
    sizes = [min(STRETCH, window)]
    for longest in (window, means.size):
        while sizes[-1] < longest:
            sizes.append(min(sizes[-1] + sizes[-1] // 2, longest))
    spread = estimate_noise(np.diff(means[: max(window, STRETCH)])) / math.sqrt(2.0)
    starts, m = [0, *sizes[:-1]], np.array(sizes, dtype=np.float64)
    total = np.cumsum(np.add.reduceat(means, starts))
    moment = np.cumsum(np.add.reduceat(means * np.arange(means.size), starts))
    # squared distances of the places 0 … m − 1 from their middle, added up
    squares = m * (m**2 - 1.0) / 12.0
    slope = (moment - total * (m - 1.0) / 2.0) / squares
    # sample 0 lies half a mean before the middle of the first
    value = total / m - slope * ((m - 1.0) / 2.0 + (per_mean - 1.0) / (2.0 * per_mean))
    margin = 4.0 * spread / np.sqrt(m)
    low, high = np.maximum.accumulate(value - margin), np.minimum.accumulate(value + margin)
    straight = int(np.count_nonzero(low <= high)) - 1
    if straight < 0:
        return End(float(end[0]), reflected=True)
    moves = abs(slope[straight]) > SIGNIFICANT * spread / math.sqrt(squares[straight])
    within_window = min(straight, sizes.index(window))
    return End(float(end[0] + value[within_window]), bool(moves))

"""How a signal is extended beyond its ends where a filter reaches over them."""

import math
from dataclasses import dataclass
from typing import Literal, Self, get_args

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric.wavelet.shrinkage import estimate_noise

Extension = Literal["symmetric", "antisymmetric", "trend", "constant", "periodic"]
EXTENSIONS: tuple[Extension, ...] = get_args(Extension)

STRETCH = 16
"""Samples of the shortest section that a straight line is fitted to at an end."""


@dataclass(frozen=True, slots=True)
class Continuation:
    """How a signal goes on beyond its ends, and the values that it is reflected in [signal's unit].

    "symmetric" mirrors at the end samples, x(−k) = x(k); "antisymmetric" reflects in the end
    points, x(−k) = 2 x(0) − x(k), which keeps a linear trend but carries the noise of one sample
    into the whole extension; "trend" reflects in the value at the end of a straight line fitted to
    the last samples, which keeps a linear trend and averages the noise; "constant" holds the end
    values; "periodic" joins the two ends.
    """

    extension: Extension
    left: float
    right: float

    @classmethod
    def fit(cls, signal: Array, extension: Extension, window: int) -> Self:
        """Continuation of a signal [n]; "trend" fits its lines to at most `window` samples."""
        if extension == "trend":
            ends = _end_value(signal, window), _end_value(signal[::-1], window)
        else:
            ends = float(signal[0]), float(signal[-1])
        return cls(extension, *ends)


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
    if beyond.extension != "symmetric":
        before, behind = 2.0 * beyond.left - before, 2.0 * beyond.right - behind
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
    turns, phase = np.divmod(at, 2 * max(n - 1, 1))
    ahead = phase < n
    samples = signal[np.where(ahead, phase, np.minimum(2 * (n - 1) - phase, n - 1))]
    if beyond.extension == "symmetric":
        return samples
    left, right = beyond.left, beyond.right
    return np.asarray(
        np.where(ahead, samples, 2.0 * right - samples) + 2.0 * turns * (right - left)
    )


def _end_value(end: Array, window: int) -> float:
    """Value at sample 0 of the straight line through the longest section from there that is still
    straight.

    Sections grow by halves up to the window for as long as the values fitted to all of them agree
    within two standard errors, each 2 σ/√size (intersection of confidence intervals, Goldenshluger
    & Nemirovski 1997), with σ estimated from the differences of neighbouring samples.
    """
    limit = min(max(window, 2), end.size)
    if limit < 3:
        return float(end[0])
    spread = estimate_noise(np.diff(end[: max(limit, STRETCH)])) / math.sqrt(2.0)
    low, high, value, size = -math.inf, math.inf, float(end[0]), STRETCH
    while True:
        size = min(size, limit)
        offset = np.arange(size) - (size - 1) / 2.0
        fitted = (
            float(np.mean(end[:size]))
            - float(offset @ end[:size]) / float(offset @ offset) * (size - 1) / 2.0
        )
        margin = 4.0 * spread / math.sqrt(size)
        low, high = max(low, fitted - margin), min(high, fitted + margin)
        if low > high:
            return value
        value = fitted
        if size == limit:
            return value
        size += size // 2

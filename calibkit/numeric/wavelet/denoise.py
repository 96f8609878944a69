"""Wavelet denoising of one segment of a signal."""

import difflib
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError
from calibkit.numeric.chunks import all_finite, release
from calibkit.numeric.wavelet import reach
from calibkit.numeric.wavelet.extension import Extension
from calibkit.numeric.wavelet.factor import Scheme
from calibkit.numeric.wavelet.lifting import (
    Allocate,
    find_scheme,
    forward,
    inverse,
    shared_length,
)
from calibkit.numeric.wavelet.reach import untouched
from calibkit.numeric.wavelet.shrinkage import (
    RULES,
    THRESHOLDS,
    Rule,
    Shrinkage,
    Threshold,
    estimate_noises,
    noise_gains,
)

OWN_NOISE_FROM = 16
"""Details that a level must have on the signal to have its noise estimated from them (29 % standard
error of the MAD).
"""


@dataclass(frozen=True, slots=True)
class Denoised:
    """A denoised signal [n], in its own unit, with what was taken for noise.

    noise and thresholds [levels] are of the details, finest level first, in the unit of the signal;
    the extension does not touch samples inner[0] … inner[1] − 1.
    """

    signal: Array
    noise: Array
    thresholds: Array
    inner: tuple[int, int]
    levels: int

    @property
    def edge(self) -> Mask:
        """Samples [n] that the extension touches."""
        at = np.arange(self.signal.size)
        return (at < self.inner[0]) | (at >= self.inner[1])


def denoise(
    signal: ArrayLike,
    *,
    wavelet: str = "cdf97",
    levels: int | None = None,
    threshold: Threshold = "universal",
    rule: Rule = "firm",
    extension: Extension = "trend",
    allocate: Allocate = np.empty,
) -> Denoised:
    """Remove from a segment [n] of equidistant samples what its wavelet details hold of noise.

    Parameters
    ----------
    signal : [n], any unit.
    wavelet : a name that `lifting.find_scheme` knows.
    levels : depth; that of `_deepest` when absent, 6 for 600 samples, 9 for 6000.
    threshold, rule : names in `shrinkage.THRESHOLDS` and `shrinkage.RULES`.
    extension : how the signal goes on beyond its ends (see `extension.Continuation`).
    allocate : makes the arrays of details and of the result; memory beyond them is that of a chunk,
        unless the threshold is "sure".

    Raises
    ------
    FitError : a signal shorter than the filter (found, needed), a sample that is not finite, an
        unknown name.

    Notes
    -----
    Noise is estimated level by level from the details that lie wholly on the signal, so that
    neither it nor the thresholds depend on the extension; a level with fewer than 16 of them takes
    the noise of the level above times the ratio of their noise gains (white noise) and,
    where the threshold looks at details, the universal threshold.
    """
    samples, scheme, depth = prepare(signal, wavelet, levels, threshold, rule)
    out, allocate_details = _allocate_shared(scheme, samples.size, allocate)
    parts = forward(samples, scheme, depth, extension=extension, allocate=allocate_details)
    own = [detail[part] for detail, part in zip(parts.details, parts.interior, strict=True)]
    noise, thresholds = find_thresholds(own, scheme, threshold, samples.size)
    _, inner = untouched(scheme, samples.size, depth)
    shrunk = inverse(parts, Shrinkage(rule, thresholds), allocate=allocate, into=out)
    return Denoised(shrunk, noise, thresholds, inner, depth)


def prepare(
    signal: ArrayLike, wavelet: str, levels: int | None, threshold: str, rule: str
) -> tuple[Array, Scheme, int]:
    """Samples, scheme and depth of what is asked for; FitError as `denoise` says."""
    samples = _checked(signal)
    scheme = find_scheme(wavelet)
    depth = _deepest(wavelet, samples.size) if levels is None else levels
    if not _fits(wavelet, samples.size, depth):
        raise FitError(
            f"{samples.size} samples are shorter than the filter: {wavelet} over {depth} levels"
            f" needs {_shortest(wavelet, depth)}",
            hint="use fewer levels, a shorter wavelet or a longer segment",
        )
    _require_known(threshold, rule)
    return samples, scheme, depth


def find_thresholds(
    own: Sequence[Array], scheme: Scheme, threshold: Threshold, length: int
) -> tuple[Array, Array]:
    """Noise and thresholds [levels] of a signal of a length, from the details of each level that
    lie wholly on it.
    """
    gains, depth = noise_gains(scheme, len(own)), len(own)
    known = [part.size >= OWN_NOISE_FROM for part in own]
    estimated = iter(
        estimate_noises([part for part, enough in zip(own, known, strict=True) if enough])
    )
    noise, thresholds = np.zeros(depth), np.zeros(depth)
    for j, (part, enough) in enumerate(zip(own, known, strict=True)):
        noise[j] = next(estimated) if enough else noise[j - 1] * gains[j] / gains[j - 1]
        estimate = THRESHOLDS[threshold if enough else "universal"]
        thresholds[j] = estimate(part, float(noise[j]), length)
        release(part)
    return noise, thresholds


@lru_cache(maxsize=64)
def _fits(wavelet: str, length: int, levels: int) -> bool:
    """Whether the filters of all levels fit on so many samples and level 1 shows its noise. Raises
    FitError for an unknown wavelet, or no levels.
    """
    if levels < 1:
        raise FitError(f"{levels} levels of a wavelet transform", hint="use one level or more")
    clean, _ = untouched(find_scheme(wavelet), length, levels)
    return clean[-1][1] > clean[-1][0] and clean[1][1] - clean[1][0] >= OWN_NOISE_FROM


def _shortest(wavelet: str, levels: int) -> int:
    """Smallest number of samples that fits: by bisection, because a longer signal never has fewer
    details that the extension leaves alone.
    """
    lengths = range(1 << (levels + 10))
    return bisect_left(lengths, x=True, key=lambda length: _fits(wavelet, length, levels))


@lru_cache(maxsize=64)
def _deepest(wavelet: str, length: int) -> int:
    """Depth for a segment of `length` samples: 2^levels at most an eighth of it, and every filter
    fits; at least 1.

    On simulated ramps of 600 to 6000 s the details of longer scales are trend rather than noise.
    """
    levels = 1
    while 16 << levels <= length and _fits(wavelet, length, levels + 1):
        levels += 1
    return levels


def _checked(signal: ArrayLike) -> Array:
    """The signal as an array of finite numbers."""
    samples = np.ascontiguousarray(signal, dtype=np.float64)
    if not all_finite(samples):
        known = np.isfinite(samples)
        raise FitError(
            f"{samples.size - np.count_nonzero(known)} of {samples.size} samples are not finite,"
            f" the first is sample {int(np.argmin(known))}",
            hint=(
                "exclude or split the segment there: a wavelet spreads one bad sample over its"
                " whole filter"
            ),
        )
    return samples


def _require_known(threshold: str, rule: str) -> None:
    """Refuse the name of a threshold or of a rule that does not exist."""
    if threshold in THRESHOLDS and rule in RULES:
        return
    for name, known, kind in (
        (threshold, list(THRESHOLDS), "threshold"),
        (rule, list(RULES), "shrinkage rule"),
    ):
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            raise FitError(
                f"unknown {kind} {name!r}",
                hint=f"did you mean {near[0]}?" if near else f"use one of {', '.join(known)}",
            )


def _allocate_shared(scheme: Scheme, length: int, allocate: Allocate) -> tuple[Array, Allocate]:
    """Array [length] for the signal that `inverse` makes, and what allocates the details: the
    finest in its second half.

    They lie so far after the signal that each of them is read before the signal is written over
    it.
    """
    _, (low, high) = reach.coefficients_of(scheme, (0, length), 1)
    whole = allocate(max(shared_length(scheme, length), length, high - low))
    free = [whole[whole.size - (high - low) :]]
    return whole[:length], lambda size: free.pop() if free else allocate(size)

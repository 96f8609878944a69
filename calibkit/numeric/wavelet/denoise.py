"""Wavelet denoising of a signal in one piece.

    s_0 = the signal, extended beyond its ends                            `extension.beyond`
    s_j, d_j from s_(j−1), j = 1 … L                                      `Lifting.analyse`
    σ_j = median |d_j| / Φ⁻¹(3/4), threshold t_j from σ_j and the details   `shrinkage.THRESHOLDS`
    s_(j−1) from s_j and the details shrunk by t_j, j = L … 1             `Lifting.synthesise`

The coarsest levels are averaged over all shifts (`_average_over_shifts`). A level is taken in
blocks that overlap by what the filters reach: they stay in a processor's cache, and no coefficient
depends on them.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np
import pywt
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError, did_you_mean
from calibkit.numeric.chunks import ranges
from calibkit.numeric.wavelet.extension import EXTENSIONS, Extension, beyond, find_end
from calibkit.numeric.wavelet.lifting import Wavelet, clean_spans, find_wavelet
from calibkit.numeric.wavelet.shrinkage import (
    RULES,
    THRESHOLDS,
    Rule,
    Threshold,
    estimate_noise,
    noise_gains,
)

BLOCK = 1 << 15
"""Coefficients that go through all steps of a level at a time: they stay in a processor's
second-level cache.
"""
OWN_NOISE_FROM = 16
"""Details that a level must have on the signal to have its noise estimated from them (29 % standard
error of the MAD).
"""
SHIFTED = 3
"""Coarsest levels that are averaged over all shifts. A decimated transform treats a step
differently by where it falls between its samples (Coifman & Donoho 1995, Translation-invariant
de-noising); at the finer levels hardly a detail is kept, so that their shifts change little.
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
        sample_number = np.arange(self.signal.size)
        return (sample_number < self.inner[0]) | (sample_number >= self.inner[1])


def denoise(
    signal: ArrayLike,
    *,
    wavelet: str = "cdf97",
    levels: int | None = None,
    threshold: Threshold = "universal",
    rule: Rule = "firm",
    extension: Extension = "trend",
    shifted: int = SHIFTED,
) -> Denoised:
    """Remove from a segment [n] of equidistant samples what its wavelet details hold of noise.

    Parameters
    ----------
    signal : [n], any unit.
    wavelet : "haar", "cdf53", "cdf97", "db2", or any discrete one of PyWavelets.
    levels : depth; that of `_deepest` when absent, 6 for 600 samples, 9 for 6000.
    threshold, rule : names in `shrinkage.THRESHOLDS` and `shrinkage.RULES`.
    extension : how the signal goes on beyond its ends (see `extension`).
    shifted : number of coarsest levels that are averaged over all shifts; 0 for the published
        scheme, which is decimated.

    Raises
    ------
    FitError : a signal shorter than the filter (found, needed), a sample that is not finite, an
        unknown name.

    Notes
    -----
    Noise is estimated level by level from the decimated details that lie wholly on the signal, so
    that neither it nor the thresholds depend on the extension; a level with fewer than 16 of them
    takes the noise of the level above times the ratio of their noise gains (white noise) and,
    where the threshold looks at details, the universal threshold.
    """
    samples = np.ascontiguousarray(signal, dtype=np.float64)
    bank = find_wavelet(wavelet)
    _require_usable(samples, threshold, rule, extension)
    size = samples.size
    depth = _deepest(wavelet, size) if levels is None else levels
    if not _fits(wavelet, size, depth):
        raise FitError(
            f"{size} samples are shorter than the filter: {wavelet} over {depth} levels"
            f" needs {_shortest(wavelet, depth)}",
            hint="use fewer levels, a shorter wavelet or a longer segment",
        )
    shifted = min(shifted, depth)
    fine, period = depth - shifted, 1 << depth
    # how far the filters of all levels reach from a sample, there and back
    reach = (bank.length - 1) * (period - 1)
    # of what lies beyond three quarters of the filters' length no more than 1e-9 comes back
    margin = -(-3 * bank.length // 4) * period
    extended = _extend(samples, extension, margin, period)
    approximations, unshifted = extended, extended
    details: list[Array] = []
    for level in range(depth):
        if level == fine:
            unshifted = approximations
        approximations, detail = _analyse(approximations, bank)
        details.append(detail)
    noise, thresholds = _find_thresholds(details, bank, threshold, size, margin)

    def shrink(level: int, part: Array) -> Array:
        return RULES[rule](part, float(thresholds[level]))

    if shifted:
        approximations = _average_over_shifts(unshifted, bank.bank, fine, depth, shrink)
    for level in range(fine - 1, -1, -1):
        approximations = _synthesise(
            approximations, details.pop(level), bank, partial(shrink, level)
        )
    inner = min(reach, size), max(size - reach, min(reach, size))
    return Denoised(approximations[margin : margin + size], noise, thresholds, inner, depth)


def _extend(samples: Array, extension: Extension, margin: int, period: int) -> Array:
    """Signal with a margin before its first sample and one or more behind its last, so many values
    that the coarsest period divides them.
    """
    size = samples.size
    extended = np.empty(-(-(size + 2 * margin) // period) * period)
    extended[margin : margin + size] = samples
    # the lines at the ends are as long as one and a half times the coarsest details are apart
    window, reversed_samples = 3 * period // 2, samples[::-1]
    extended[:margin] = beyond(samples, find_end(samples, extension, window), margin)
    reversed_margin = beyond(
        reversed_samples,
        find_end(reversed_samples, extension, window),
        extended.size - margin - size,
    )
    extended[margin + size :] = reversed_margin[::-1]
    return extended


def _blocks(size: int, margin: int, multiple: int = 1) -> Iterator[tuple[int, int, int, int]]:
    """First index and one past the last of each block, and of what it takes with the margin around
    it; all are multiples of a number.
    """
    for start, stop in ranges(size, -(-BLOCK // multiple) * multiple):
        yield start, stop, max(start - margin, 0), min(stop + margin, size)


def _analyse(values: Array, bank: Wavelet) -> tuple[Array, Array]:
    """Approximations and details [n/2] of values [n]."""
    approximations, details = np.empty(values.size // 2), np.empty(values.size // 2)
    for start, stop, first, last in _blocks(details.size, bank.length):
        inside = slice(start - first, stop - first)
        coefficients = bank.analyse(values[2 * first : 2 * last])
        approximations[start:stop], details[start:stop] = (
            coefficients[0][inside],
            coefficients[1][inside],
        )
    return approximations, details


def _synthesise(
    approximations: Array,
    details: Array,
    bank: Wavelet,
    shrink: Callable[[Array], Array],
) -> Array:
    """Values [2 n] of approximations [n] and of what `shrink` makes of details [n]."""
    values = np.empty(2 * details.size)
    for start, stop, first, last in _blocks(details.size, bank.length):
        rebuilt = bank.synthesise(approximations[first:last], shrink(details[first:last]))
        values[2 * start : 2 * stop] = rebuilt[2 * (start - first) : 2 * (stop - first)]
    return values


def _average_over_shifts(
    unshifted: Array,
    bank: str,
    fine: int,
    depth: int,
    shrink: Callable[[int, Array], Array],
) -> Array:
    """Approximations of level `fine` with the details of further levels shrunk, averaged over all
    shifts (stationary transform, cycle spinning).
    """
    values, period = np.empty(unshifted.size), 1 << (depth - fine)
    margin = pywt.Wavelet(bank).dec_len * period
    for start, stop, first, last in _blocks(unshifted.size, margin, period):
        coefficients = pywt.swt(unshifted[first:last], bank, level=depth - fine, trim_approx=True)
        for k in range(1, len(coefficients)):  # the coarsest details come first
            coefficients[k] = shrink(depth - k, coefficients[k])
        values[start:stop] = pywt.iswt(coefficients, bank)[start - first : stop - first]
    return values


def _find_thresholds(
    details: Sequence[Array], wavelet: Wavelet, threshold: Threshold, length: int, margin: int
) -> tuple[Array, Array]:
    """Noise and thresholds [levels] of a signal of a length, from those details of each level that
    lie wholly on it; those of sample 0 have the index margin / 2^level.
    """
    levels = len(details)
    gains, noise, thresholds = noise_gains(wavelet.bank, levels), np.zeros(levels), np.zeros(levels)
    for j, (low, high) in enumerate(clean_spans(wavelet, length, levels)[1:]):
        first = margin >> (j + 1)
        on_signal = details[j][first + low : first + high]
        has_own_noise = on_signal.size >= OWN_NOISE_FROM
        noise[j] = (
            estimate_noise(on_signal) if has_own_noise else noise[j - 1] * gains[j] / gains[j - 1]
        )
        estimate = THRESHOLDS[threshold if has_own_noise else "universal"]
        thresholds[j] = estimate(on_signal, float(noise[j]), length)
    return noise, thresholds


@lru_cache(maxsize=64)
def _fits(wavelet: str, length: int, levels: int) -> bool:
    """Whether the filters of all levels fit on so many samples and level 1 shows its noise. Raises
    FitError for an unknown wavelet, or no levels.
    """
    if levels < 1:
        raise FitError(f"{levels} levels of a wavelet transform", hint="use one level or more")
    clean = clean_spans(find_wavelet(wavelet), length, levels)
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


def _require_usable(samples: Array, threshold: str, rule: str, extension: str) -> None:
    """Refuse samples that are not finite, and the name of a threshold, a rule or an extension that
    does not exist.
    """
    finite = np.isfinite(samples)
    if not finite.all():
        raise FitError(
            f"{samples.size - np.count_nonzero(finite)} of {samples.size} samples are not finite,"
            f" the first is sample {int(np.argmin(finite))}",
            hint=(
                "exclude or split the segment there: a wavelet spreads one bad sample over its"
                " whole filter"
            ),
        )
    for name, names, kind in (
        (threshold, THRESHOLDS, "threshold"),
        (rule, RULES, "shrinkage rule"),
        (extension, EXTENSIONS, "extension"),
    ):
        if name not in names:
            raise FitError(
                f"unknown {kind} {name!r}",
                hint=did_you_mean(name, names, f"use one of {', '.join(names)}"),
            )

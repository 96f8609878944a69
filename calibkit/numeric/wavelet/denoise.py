"""Wavelet denoising of a signal in one piece.

    s_0 = the signal;  s_j, d_j from s_(j−1) by lifting, j = 1 … L        `lifting.analyse`
    σ_j = median |d_j| / Φ⁻¹(3/4), threshold t_j from σ_j and the details   `shrinkage.THRESHOLDS`
    s_(j−1) from s_j and the details shrunk by t_j, j = L … 1             `lifting.synthesise`

The coarsest levels are averaged over all shifts (`lifting.average_over_shifts`).
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError, did_you_mean
from calibkit.numeric.chunks import all_finite, release
from calibkit.numeric.wavelet.extension import (
    EXTENSIONS,
    Coefficients,
    Ends,
    Extension,
    Span,
)
from calibkit.numeric.wavelet.lifting import (
    Allocate,
    Wavelet,
    analyse,
    average_over_shifts,
    clean_spans,
    find_wavelet,
    synthesise,
)
from calibkit.numeric.wavelet.shrinkage import (
    RULES,
    THRESHOLDS,
    Rule,
    Threshold,
    estimate_noise,
    noise_gains,
)

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
    shifted: int = SHIFTED,
    allocate: Allocate = np.empty,
) -> Denoised:
    """Remove from a segment [n] of equidistant samples what its wavelet details hold of noise.

    Parameters
    ----------
    signal : [n], any unit.
    wavelet : "haar", "cdf53", "cdf97", "db2", or any discrete one of PyWavelets.
    levels : depth; that of `_deepest` when absent, 6 for 600 samples, 9 for 6000.
    threshold, rule : names in `shrinkage.THRESHOLDS` and `shrinkage.RULES`.
    extension : how the signal goes on beyond its ends (see `extension.Ends`).
    shifted : number of coarsest levels that are averaged over all shifts; 0 for the published
        scheme, which is decimated.
    allocate : makes the arrays of coefficients and of the result; memory beyond them is that of a
        block, unless the threshold is "sure".

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
    depth = _deepest(wavelet, samples.size) if levels is None else levels
    if not _fits(wavelet, samples.size, depth):
        raise FitError(
            f"{samples.size} samples are shorter than the filter: {wavelet} over {depth} levels"
            f" needs {_shortest(wavelet, depth)}",
            hint="use fewer levels, a shorter wavelet or a longer segment",
        )
    # the lines at the ends are as long as one and a half times the coarsest details are apart
    ends = Ends.fit(samples, extension, bank.delay, 3 << (depth - 1))
    fine = max(depth - shifted, 0)
    approximations = unshifted = Coefficients(samples, 0, 0)
    details: list[Coefficients] = []
    spans: list[Span] = []
    for level in range(depth):
        if level == fine:
            unshifted = approximations
        spans.append(approximations.span)
        approximations, detail = analyse(approximations, bank, ends, allocate)
        details.append(detail)
    clean = clean_spans(bank, samples.size, depth)
    noise, thresholds = _find_thresholds(details, clean[1:], bank, threshold, samples.size)

    def shrink(level: int, part: Array) -> Array:
        return RULES[rule](part, float(thresholds[level]))

    margin = 0
    if fine < depth:
        approximations = average_over_shifts(unshifted, depth - fine, bank, ends, shrink, allocate)
        margin = 2 << depth  # a shift moves what the extension touches by less
    del unshifted, detail, details[fine:], spans[fine:]
    while details:
        span = spans.pop()
        approximations = synthesise(approximations, details.pop(), span, bank, shrink, allocate)
    # samples that are rebuilt from coefficients alone that no extension touches
    low, high = clean[-1]
    for above in reversed(clean[:-1]):
        low = max(2 * (low - bank.needs[0]), above[0])
        high = min(2 * (high - bank.needs[1]), above[1])
    inner = low + margin, max(high - margin, low + margin)
    return Denoised(approximations.values, noise, thresholds, inner, depth)


def _find_thresholds(
    details: Sequence[Coefficients],
    clean: Sequence[Span],
    wavelet: Wavelet,
    threshold: Threshold,
    length: int,
) -> tuple[Array, Array]:
    """Noise and thresholds [levels] of a signal of a length, from those details of each level that
    lie wholly on it.
    """
    levels = len(details)
    gains, noise, thresholds = noise_gains(wavelet.bank, levels), np.zeros(levels), np.zeros(levels)
    for j in range(levels):
        on_signal = details[j].part(clean[j])
        enough = on_signal.size >= OWN_NOISE_FROM
        noise[j] = estimate_noise(on_signal) if enough else noise[j - 1] * gains[j] / gains[j - 1]
        estimate = THRESHOLDS[threshold if enough else "universal"]
        thresholds[j] = estimate(on_signal, float(noise[j]), length)
        release(on_signal)
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

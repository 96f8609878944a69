"""Wavelet denoising of a signal in one piece.

    s_0 = the signal, extended beyond its ends                                      `beyond`
    s_j, d_j from s_(j−1), j = 1 … L                                      `Wavelet.analyse`
    σ_j = median |d_j| / Φ⁻¹(3/4), threshold t_j from σ_j and the details   `shrinkage.THRESHOLDS`
    s_(j−1) from s_j and the details shrunk by t_j, j = L … 1             `Wavelet.synthesise`

The coarsest levels are averaged over all shifts (`_average_over_shifts`).

Beyond its ends a signal goes on in one of three ways: "symmetric" mirrors at the end samples,
x(−k) = x(k); "antisymmetric" reflects in the end points, x(−k) = 2 x(0) − x(k), which keeps a
linear trend but carries the noise of one sample into the whole extension; "trend" reflects in the
value at the end of a straight line fitted to the last samples, which keeps a linear trend and
averages the noise, or mirrors where that line has no slope beyond its noise, so that an end at rest
has no error of its own.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import pywt
from numpy.typing import ArrayLike

from calibkit.errors import FitError, did_you_mean
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.chunks import ranges
from calibkit.numeric.wavelet.lifting import CACHED, clean_spans, find_wavelet
from calibkit.numeric.wavelet.shrinkage import (
    RULES,
    THRESHOLDS,
    Rule,
    Threshold,
    estimate_noise,
    noise_gains,
)

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


def beyond(signal: Array, extension: Extension, count: int, window: int) -> Array:
    """The `count` samples before the first one of a signal [n]; of a signal that is shorter, the
    reflection is repeated. "trend" fits its line to at most `window` samples, or twice as many.
    """
    value, is_reflected = float(signal[0]), extension == "antisymmetric"
    if extension == "trend":
        value, is_reflected = fit_end(signal, window)
    kind: Literal["odd", "even"] = "odd" if is_reflected else "even"
    padded = np.pad(signal[: count + 1], (count, 0), "reflect", reflect_type=kind)
    # NumPy reflects in the first sample itself
    shift = 2.0 * (value - float(signal[0])) if is_reflected else 0.0
    return np.asarray(padded[:count] + shift)


def fit_end(end: Array, window: int) -> tuple[float, bool]:
    """Value at sample 0 of the straight line through the longest section from there that is still
    straight, and whether a signal is reflected in it: if the line, if need be of twice the window,
    has a slope beyond its noise.

    Sections grow by halves up to the window for as long as the values at sample 0 of the lines
    fitted to all of them agree within two standard errors, each 2 σ/√m for m samples (intersection
    of confidence intervals, Goldenshluger & Nemirovski 1997), with σ estimated from the differences
    of neighbouring samples.
    """
    limit = min(2 * window, end.size)
    if limit < 3:
        return float(end[0]), True
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
        return float(end[0]), True
    moves = abs(slope[straight]) > SIGNIFICANT * spread / math.sqrt(squares[straight])
    within_window = min(straight, sizes.index(window))
    return float(end[0] + value[within_window]), bool(moves)


OWN_NOISE_FROM = 16
"""Details that a level must have on the signal to have its noise estimated from them (29 % standard
error of the MAD).
"""
DEEP = 10
"""Levels below which a transform is extended once."""
SHIFTED = 3
"""Coarsest levels that are averaged over all shifts. A decimated transform treats a step
differently by where it falls between its samples (Coifman & Donoho 1995, Translation-invariant
de-noising); at the finer levels hardly a detail is kept, so that their shifts change little.
"""


@dataclass(frozen=True, slots=True)
class Denoised:
    """A denoised signal [n], in its own unit, with what was taken for noise.

    noise and thresholds [levels] are of the details, finest level first, in the unit of the signal.
    """

    signal: Array
    noise: Array
    thresholds: Array
    edge: Mask
    """Samples [n] that the extension touches."""

    @property
    def levels(self) -> int:
        """Levels of the transform."""
        return len(self.noise)


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
    extension : how the signal goes on beyond its ends.
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
    bank, size = find_wavelet(wavelet), samples.size
    finite = np.isfinite(samples)
    if not finite.all():
        raise FitError(
            f"{size - np.count_nonzero(finite)} of {size} samples are not finite,"
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
    depth = _deepest(wavelet, size) if levels is None else levels
    shortest = _shortest(wavelet, depth)
    if size < shortest:
        raise FitError(
            f"{size} samples are shorter than the filter: {wavelet} over {depth} levels"
            f" needs {shortest}",
            hint="use fewer levels, a shorter wavelet or a longer segment",
        )
    # of what lies beyond three quarters of the filters' length no more than 1e-9 comes back. A deep
    # transform is extended twice, its samples and its coarser approximations: the margin of one
    # extension would be as long as the signal.
    filters, split = -(-3 * bank.length // 4), max(depth - max(DEEP, shifted), 0)
    stages = [(0, split), (split, depth)] if split else [(0, depth)]
    values, margins, unshifted = samples, list[int](), np.zeros(0)
    details, origins, fine = list[Array](), list[int](), max(depth - shifted, 0)
    for start, stop in stages:
        period = 1 << (stop - start)
        margins.append(filters * period)
        # the lines at the ends are as long as one and a half times the coarsest details are apart
        window = 3 * (1 << (depth - start)) // 2
        approximations = extend(values, extension, margins[-1], period, window)
        for level in range(start, stop):
            if level == fine:
                unshifted = approximations
            approximations, detail = bank.analyse(approximations)
            details.append(detail)
            origins.append(margins[-1] >> (level + 1 - start))
        values = approximations[filters : filters - (-values.size // period)]

    # noise and thresholds from those details of each level that lie wholly on the signal, that of
    # sample 0 at the origin
    gains, noise, thresholds = noise_gains(bank.bank, depth), np.zeros(depth), np.zeros(depth)
    for j, (low, high) in enumerate(clean_spans(bank, size, depth)[1:]):
        on_signal = details[j][origins[j] + low : origins[j] + high]
        has_own_noise = on_signal.size >= OWN_NOISE_FROM
        noise[j] = (
            estimate_noise(on_signal) if has_own_noise else noise[j - 1] * gains[j] / gains[j - 1]
        )
        estimate = THRESHOLDS[threshold if has_own_noise else "universal"]
        thresholds[j] = estimate(on_signal, float(noise[j]), size)

    if shifted:
        approximations = _average_over_shifts(unshifted, bank.bank, thresholds[fine:], rule)
    for level in range(fine - 1, -1, -1):
        detail = details.pop(level)
        for begin, end in ranges(detail.size, CACHED):
            detail[begin:end] = RULES[rule](detail[begin:end], float(thresholds[level]))
        if level == split - 1:  # what the first extension has of the second one
            begin = margins[1] - filters
            approximations = approximations[begin : begin + detail.size]
        approximations = bank.synthesise(approximations, detail)
    # how far the filters of all levels reach from a sample, there and back
    reach, edge = (bank.length - 1) * (period - 1), np.ones(size, dtype=np.bool_)
    edge[reach : max(size - reach, 0)] = False
    # a copy, as a view would keep the margins
    on_signal = approximations[margins[0] : margins[0] + size]
    return Denoised(on_signal.copy(), noise, thresholds, edge)


def extend(samples: Array, extension: Extension, margin: int, period: int, window: int) -> Array:
    """Signal with a margin before its first sample and one or more behind its last, so many values
    that the coarsest period divides them; `window` as of `beyond`.
    """
    behind = margin - (samples.size + 2 * margin) % -period
    after = beyond(samples[::-1], extension, behind, window)[::-1]
    return np.concatenate([beyond(samples, extension, margin, window), samples, after])


def _average_over_shifts(unshifted: Array, bank: str, thresholds: Array, rule: Rule) -> Array:
    """Approximations [n] with the details of further levels shrunk by thresholds [levels], averaged
    over all shifts (stationary transform, cycle spinning), in blocks that overlap by what the
    filters reach.
    """
    values, levels = np.empty(unshifted.size), len(thresholds)
    period = 1 << levels
    margin = pywt.Wavelet(bank).dec_len * period
    for start, stop in ranges(unshifted.size, -(-CACHED // period) * period):
        first, last = max(start - margin, 0), min(stop + margin, unshifted.size)
        coefficients = pywt.swt(unshifted[first:last], bank, level=levels, trim_approx=True)
        for k in range(1, levels + 1):  # the coarsest details come first
            coefficients[k] = RULES[rule](coefficients[k], float(thresholds[-k]))
        values[start:stop] = pywt.iswt(coefficients, bank)[start - first : stop - first]
    return values


def _shortest(wavelet: str, levels: int) -> int:
    """Fewest samples on which the filters of all levels fit and level 1 shows its noise. Raises
    FitError for an unknown wavelet, or no levels.
    """
    if levels < 1:
        raise FitError(f"{levels} levels of a wavelet transform", hint="use one level or more")
    bank, period = find_wavelet(wavelet), 1 << levels
    clean = clean_spans(bank, 0, levels)
    # the last sample that the first clean detail is made of, and the 16th one of level 1
    deepest = period * clean[-1][0] + (period - 1) * bank.reads[1]
    finest = 2 * (clean[1][0] + OWN_NOISE_FROM - 1) + bank.reads[1]
    return max(deepest, finest) + 1


def _deepest(wavelet: str, length: int) -> int:
    """Depth for a segment of `length` samples: 2^levels at most an eighth of it, and every filter
    fits; at least 1.

    On simulated ramps of 600 to 6000 s the details of longer scales are trend rather than noise.
    """
    levels = 1
    while 16 << levels <= length and _shortest(wavelet, levels + 1) <= length:
        levels += 1
    return levels

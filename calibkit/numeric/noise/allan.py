"""Allan and wavelet deviation with gaps and confidence limits, and the bias stability of GJB 2426A.

    σ²(mτ₀) = ½ ⟨(ȳ_{k+m} − ȳ_k)²⟩ over all k, ȳ_k the mean of m samples from k on  (IEEE Std 952)
    σ²(2^(j−1) τ₀) = 2 ⟨d_j²⟩, d_j the details of level j of an orthogonal wavelet, undecimated
    B_s² = Σ (ω̄_i − ω̄)²/(n − 1), ω̄_i the means of n consecutive blocks            (GJB 2426A)

A rate here is the indication of any sensor at rest, and results are in its unit. Windows that hold
a missing sample are left out; which do, the count of those missing before each place tells.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.noise.confidence import (
    Noise,
    chi_square_limits,
    equivalent_dof,
    identify_noise,
    wavelet_correlation,
)

Spacing = Literal["octave", "decade"]

RIGHT_LENGTH = 0.01
"""Relative deviation of a block from the length that a standard names, above which the figure is
refused.
"""
BLOCK = 1 << 13
"""Samples worked on at once: they stay in a core's cache, and a dot product of them is not shared
out to threads.
"""


@dataclass(frozen=True, slots=True)
class DeviationCurve:
    """A deviation over averaging time in the unit of the rate: one entry [m] a cluster time,
    ascending, with chi-square confidence limits.
    """

    estimator: str
    interval_s: float
    samples: int
    factor: Integers
    tau_s: Array
    deviation: Array
    pairs: Integers
    noise: tuple[Noise, ...]
    """Type at each averaging time; empty for wavelets, whose degrees of freedom assume none."""
    dof: Array
    lower: Array
    upper: Array
    probability: float

    @classmethod
    def of_variance(
        cls,
        estimator: str,
        interval_s: float,
        samples: int,
        factors: Integers,
        variance: Array,
        pairs: Array | Integers,
        kinds: tuple[Noise, ...],
        dof: Array,
        probability: float,
    ) -> Self:
        """Curve of variances [m] with its limits."""
        deviation = np.sqrt(variance)
        lower, upper = chi_square_limits(deviation, dof, probability)
        tau_s = np.asarray(factors * interval_s, dtype=np.float64)
        return cls(
            estimator,
            interval_s,
            samples,
            factors,
            tau_s,
            deviation,
            pairs.astype(np.int64),
            kinds,
            dof,
            lower,
            upper,
            probability,
        )


@dataclass(frozen=True, slots=True)
class BiasStability:
    """Standard deviation of block means in the unit of the rate, the GJB figure: not an Allan
    deviation, and drift is in it.
    """

    block_s: float
    value: float
    blocks: int

    @property
    def standard_uncertainty(self) -> float:
        """That of a standard deviation of n independent normal values, σ/√(2(n − 1))."""
        return float(self.value / np.sqrt(2.0 * (self.blocks - 1)))


def overlapping(
    rate: ArrayLike,
    interval_s: float,
    *,
    tau_s: ArrayLike | None = None,
    spacing: Spacing = "octave",
    points: int = 1,
    probability: float = 0.95,
) -> DeviationCurve:
    """Overlapping Allan deviation of a rate signal.

    Parameters
    ----------
    rate : [n], evenly sampled; NaN marks a gap, and only pairs of neighbouring averages that are
        whole are used.
    interval_s : sampling interval [s].
    tau_s : averaging times [s], each rounded to whole samples (the curve carries the rounded ones);
        without them `points` an octave or a decade, from one sample to a third of the record.
    probability : of the two-sided limits, which are chi-square's.

    Raises
    ------
    FitError : fewer than three samples, an infinite one, an averaging time that the record has no
        whole pair for.

    Notes
    -----
    IEEE Std 952 annex C, overlapped as in NIST SP 1065 eq. 11: σ²(mτ₀) is the mean of (ȳ_{k+m} −
    ȳ_k)²/2 over all k. The record's mean is taken out first, so that the running sum loses no
    digits to it. Degrees of freedom are those of the noise type that Riley's lag-1 test identifies
    at each averaging time.
    """
    rate = require_record(rate, interval_s)
    missing, between_gaps = count_missing(rate), chunks.find_runs(~np.isnan(rate))
    runs = between_gaps[:, 1] - between_gaps[:, 0]
    if tau_s is None:
        factors_asked = averaging_factors(rate.size, spacing=spacing, points=points)
        factors = factors_asked[2 * factors_asked <= runs.max()]
    else:
        asked_tau_s, longest = np.sort(np.asarray(tau_s, dtype=np.float64), axis=None), runs.max()
        factors = np.unique(np.round(asked_tau_s / interval_s).astype(np.int64))
        if factors.size == 0 or factors[0] < 1 or 2 * factors[-1] > longest:
            raise FitError(
                f"averaging times {asked_tau_s.tolist()} s, possible are {interval_s:g} s to"
                f" {longest // 2 * interval_s:g} s",
                hint="two whole averages must fit between gaps",
            )
    if factors.size == 0:
        raise FitError(
            "every other sample is a gap: no two whole neighbours",
            hint="look at how the log marks gaps",
        )
    # the running sum Y of the rate less its mean
    # without the mean: a rate of 15 °/h over 10⁷ samples would cost the sum seven digits
    total = np.zeros(rate.size + 1)
    np.cumsum(centred(rate), out=total[1:])
    # ȳ_{k+m} - ȳ_k = (Y_{k+2m} - 2 Y_{k+m} + Y_k)/m
    sums = [
        square_beside_gaps(filtered(total, (1.0, -2.0, 1.0), m), missing, 2 * m)
        for m in factors.tolist()
    ]
    square, pairs = np.array(sums).T
    # σ² = ⟨(Y_{k+2m} - 2 Y_{k+m} + Y_k)²⟩/(2 m²), SP 1065 eq. 11 in samples
    variance = square / (2.0 * factors**2 * pairs)
    kinds = identify_noise(total, missing, factors)
    dof = np.array(
        [equivalent_dof(int(m), runs, kind) for m, kind in zip(factors, kinds, strict=True)]
    )
    return DeviationCurve.of_variance(
        "overlapping Allan",
        interval_s,
        rate.size,
        factors,
        variance,
        pairs,
        kinds,
        dof,
        probability,
    )


def wavelet_deviation(
    rate: Array,
    interval_s: float,
    *,
    wavelet: str = "db2",
    probability: float = 0.95,
) -> DeviationCurve:
    """Wavelet deviation of a rate signal, on the Allan deviation's scale but blind to drift.

    Parameters
    ----------
    rate : [n], evenly sampled; a coefficient that touches a gap (NaN) or an end of the record is
        left out.
    wavelet : an orthogonal PyWavelets name with p vanishing moments, blind to drift of degree p −
        1: "haar" (p = 1) is the Allan deviation itself, "db2" ignores a linear drift, "db3" a
        quadratic one.

    Raises
    ------
    FitError : a record too short for the first level.

    Notes
    -----
    Each level takes the place of the one before it, in one array of the record's length. Percival
    & Guttorp 1994: √2 times the unbiased wavelet deviation at scale τ = 2^(j−1) τ₀. Equal to the
    Allan deviation for angle random walk with every wavelet, for other noise a little below it.
    Degrees of freedom: the number of coefficients over the sum of their squared correlations
    (Percival 1995, η₁), for the noise type that has the fewest, and at least 1.
    """
    import pywt

    require_record(rate, interval_s)
    bank = pywt.Wavelet(wavelet)
    # the filters of level j span (2^j - 1)(taps - 1) + 1 samples, which must lie in the record
    levels = int(np.log2(1.0 + (rate.size - 1) / (bank.dec_len - 1)))
    if levels < 1:
        raise FitError(
            f"{rate.size} samples are too few for wavelet {wavelet}",
            hint="use haar or a longer record",
        )
    low, high = np.array(bank.dec_lo), np.array(bank.dec_hi)
    missing, smooth = count_missing(rate), centred(rate)
    factors, squares, counts = [], [], []
    for factor in (1 << level for level in range(levels)):
        details = _next_level(smooth, low[::-1] / np.sqrt(2.0), high[::-1] / np.sqrt(2.0), factor)
        smooth = smooth[: smooth.size - (low.size - 1) * factor]
        square, count = square_beside_gaps(details, missing, rate.size - smooth.size + 1)
        if count:
            factors.append(factor)
            squares.append(square)
            counts.append(count)
    if not factors:
        raise FitError(
            "no stretch without a gap is long enough for the wavelet",
            hint="use haar or a longer record",
        )
    # on the Allan variance's scale
    pairs, variance = np.array(counts), 2.0 * np.array(squares) / np.array(counts)
    correlation = np.array([wavelet_correlation(low, high, m) for m in factors])
    dof = np.maximum(pairs / correlation, 1.0)
    return DeviationCurve.of_variance(
        f"wavelet {wavelet}",
        interval_s,
        rate.size,
        np.array(factors),
        variance,
        pairs,
        (),
        dof,
        probability,
    )


def _next_level(smooth: Array, low: Array, high: Array, factor: int) -> Iterator[tuple[int, Array]]:
    """First place and details of consecutive blocks of a level; its smooth coefficients take the
    place of those of the level before, which later blocks do not need.
    """
    levels = filtered(smooth, low.tolist(), factor), filtered(smooth, high.tolist(), factor)
    for (start, smoothed), (_, detail) in zip(*levels, strict=True):
        smooth[start : start + smoothed.size] = smoothed
        yield start, detail


def averaging_factors(samples: int, *, spacing: Spacing = "octave", points: int = 1) -> Integers:
    """Whole averaging factors [m] from 1 to a third of the samples, evenly spaced in logarithm, no
    two equal.
    """
    base = 2.0 if spacing == "octave" else 10.0
    # beyond a third of the record an average has too few neighbours to tell noise
    largest = max(samples // 3, 1)
    exponents = (
        np.arange(int(np.floor(np.log(largest) / np.log(base) * points + 1e-9)) + 1) / points
    )
    return np.unique(np.round(base**exponents).astype(np.int64))


def centred(rate: Array) -> Array:
    """A rate [n] less its mean without gaps; 0 in gaps."""
    values = rate - np.nanmean(rate)
    values[np.isnan(values)] = 0.0
    return values


def count_missing(rate: Array) -> Integers | None:
    """Missing samples before each place [n + 1] of a rate [n], in which NaN is missing; None where
    none is.
    """
    missing = np.isnan(rate)
    return np.append(0, np.cumsum(missing, dtype=np.int32)) if missing.any() else None


def filtered(values: Array, taps: Sequence[float], tap_spacing: int) -> Iterator[tuple[int, Array]]:
    """First place i and Σ_k taps_k values[i + k · tap_spacing] of consecutive blocks of places."""
    for a, b in chunks.ranges(values.size - (len(taps) - 1) * tap_spacing, BLOCK):
        total: Array = taps[0] * values[a:b]
        for k, tap in enumerate(taps[1:], start=1):
            total += tap * values[a + k * tap_spacing : b + k * tap_spacing]
        yield a, total


def square_beside_gaps(
    blocks: Iterable[tuple[int, Array]], missing: Integers | None, length: int
) -> tuple[float, int]:
    """Sum of squares and number of the values of blocks, each with its first place, whose windows
    of `length` samples from their place on hold none that is missing (`count_missing`).
    """
    square, count = 0.0, 0
    for start, block in blocks:
        whole = block
        if missing is not None:
            places = slice(start, start + block.size)
            whole = block[missing[start + length :][: block.size] == missing[places]]
        square += float(whole @ whole)
        count += whole.size
    return square, count


def bias_stability(rate: Array, interval_s: float, *, block_s: float = 10.0) -> BiasStability:
    """Bias stability after GJB 2426A: the standard deviation of the means of consecutive blocks of
    10 s or 100 s.

    Parameters
    ----------
    rate : [n], evenly sampled; a block with a gap (NaN) is left out.
    block_s : length of a block [s].

    Raises
    ------
    FitError : the block is not a whole number of samples within 1 %, or fewer than two blocks are
        whole.

    Notes
    -----
    B_s = √(Σ (ω̄_i − ω̄)²/(n − 1)). Everything slower than a block is in it, drift and turn-on
    included, so it is no substitute for the Allan deviation at the same time, nor the other way
    about.
    """
    require_record(rate, interval_s)
    length = round(block_s / interval_s)
    if length < 1 or abs(length * interval_s - block_s) > RIGHT_LENGTH * block_s:
        raise FitError(
            f"a block of {block_s:g} s is not a whole number of samples of {interval_s:g} s",
            hint="resample the log to an interval that divides it",
        )
    means = chunks.block_means(rate, length)
    means = means[~np.isnan(means)]
    if means.size < 2:
        raise FitError(
            f"{means.size} whole blocks of {block_s:g} s in {rate.size * interval_s:g} s of record,"
            " at least 2 needed",
            hint="record for longer",
        )
    return BiasStability(length * interval_s, float(np.std(means, ddof=1)), int(means.size))


def require_record(record: ArrayLike, interval_s: float) -> Array:
    """Rate [n] of a record; FitError for what has no deviation: too few samples, infinite ones, no
    interval.
    """
    rate = np.asarray(record, dtype=np.float64)
    if rate.ndim != 1 or np.count_nonzero(~np.isnan(rate)) < 3:
        raise FitError(
            f"a record of shape {rate.shape} holds fewer than three rates", hint="record for longer"
        )
    if np.isinf(rate).any():
        raise FitError(
            "an infinite rate in the record", hint="mark unusable samples as missing (NaN)"
        )
    if not (np.isfinite(interval_s) and interval_s > 0.0):
        raise FitError(f"the sampling interval is {interval_s!r} s, expected a positive number")
    return rate

"""Allan deviation with gaps and confidence limits, wavelet deviation, and the bias stability of GJB
2426A. A rate here is the indication of any sensor at rest, and results are in its unit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.noise.confidence import (
    TYPES,
    Noise,
    chi_square_limits,
    equivalent_dof,
    identify_noise,
    wavelet_correlation,
)

Spacing = Literal["octave", "decade"]

BLOCK = 1 << 13
"""Samples worked on at once: they stay in a core's cache, and a dot product of them is not shared
out to threads.
"""
RIGHT_LENGTH = 0.01
"""Relative deviation of a block from the length that a standard names, above which the figure is
refused.
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

    @property
    def deviation_dph(self) -> Array:
        """Deviation of a gyro [deg/h]."""
        return self.deviation

    @property
    def lower_dph(self) -> Array:
        """Lower limit of a gyro's deviation [deg/h]."""
        return self.lower

    @property
    def upper_dph(self) -> Array:
        """Upper limit of a gyro's deviation [deg/h]."""
        return self.upper


@dataclass(frozen=True, slots=True)
class BiasStability:
    """Standard deviation of block means in the unit of the rate, the GJB figure: not an Allan
    deviation, and drift is in it.
    """

    block_s: float
    value: float
    blocks: int


def overlapping(
    rate: Array,
    interval_s: float,
    *,
    tau_s: Sequence[float] | None = None,
    spacing: Spacing = "octave",
    points: int = 1,
    noise: Noise | Literal["identify"] = "identify",
    probability: float = 0.95,
) -> DeviationCurve:
    """Overlapping Allan deviation of a rate signal.

    Parameters
    ----------
    rate : [n], evenly sampled; NaN marks a gap, and only pairs of neighbouring averages that are
        whole are used.
    interval_s : sampling interval [s].
    tau_s : averaging times [s], each rounded to whole samples (the curve carries the rounded ones);
        without them
        `points` an octave or a decade, from one sample to a third of the record.
    noise : the type that the degrees of freedom assume, or "identify" for Riley's lag-1 test at
        each averaging time.
    probability : of the two-sided limits, which are chi-square's.

    Raises
    ------
    FitError : fewer than three samples, an infinite one, an averaging time that the record has no
        whole pair for, a noise type that is none.

    Notes
    -----
    IEEE Std 952 annex C, overlapped as in NIST SP 1065 eq. 11: σ²(mτ₀) is the mean of (ȳ_{k+m} −
    ȳ_k)²/2 over all k. The record's mean is taken out first, so that the running sum loses no
    digits to it.
    """
    _require_record(rate, interval_s)
    if noise not in ("identify", *TYPES):
        raise FitError(f"noise type '{noise}'", hint=f"expected identify or {', '.join(TYPES)}")
    runs = _whole_runs(rate)
    if tau_s is None:
        wanted = averaging_factors(rate.size, spacing=spacing, points=points)
        factors = wanted[2 * wanted <= runs.max()]
    else:
        factors = _factors_of(tau_s, interval_s, int(runs.max()))
    if factors.size == 0:
        raise FitError(
            "every other sample is a gap: no two whole neighbours",
            hint="look at how the log marks gaps",
        )
    total = _running_sum(rate)
    missing = None if chunks.all_finite(rate) else np.cumsum(np.concatenate(([0], np.isnan(rate))))
    variance, pairs = np.array([_pair_variance(total, missing, int(m)) for m in factors]).T
    kinds = (
        identify_noise(total, missing, factors)
        if noise == "identify"
        else (noise,) * int(factors.size)
    )
    dof = np.array(
        [equivalent_dof(int(m), runs, kind) for m, kind in zip(factors, kinds, strict=True)]
    )
    return _curve(
        "overlapping Allan", rate, interval_s, factors, variance, pairs, kinds, dof, probability
    )


def averaging_factors(samples: int, *, spacing: Spacing = "octave", points: int = 1) -> Integers:
    """Whole averaging factors [m] from 1 to a third of the samples, evenly spaced in logarithm, no
    two equal.
    """
    base = 2.0 if spacing == "octave" else 10.0
    largest = max(samples // 3, 1)
    exponents = (
        np.arange(int(np.floor(np.log(largest) / np.log(base) * points + 1e-9)) + 1) / points
    )
    return np.unique(np.round(base**exponents).astype(np.int64))


def _whole_runs(rate: Array) -> Integers:
    """Lengths [g] of the runs of rate [n] that hold no gap; a single 0 when there is none."""
    runs = chunks.find_runs(rate.size, lambda a, b: ~np.isnan(rate[a:b]))
    return np.array([stop - start for start, stop in runs] or [0], dtype=np.int64)


def _running_sum(rate: Array) -> Array:
    """Running sum [n + 1] of rate [n] less its mean, gaps as zero; carried over blocks in extended
    precision.
    """
    mean, gapless = _finite_mean(rate), chunks.all_finite(rate)
    total = np.empty(rate.size + 1)
    total[0] = 0.0
    carry = np.longdouble(0.0)
    for start in range(0, rate.size, BLOCK):
        block = rate[start : start + BLOCK] - mean
        if not gapless:
            block[np.isnan(block)] = 0.0
        part = total[start + 1 : start + 1 + block.size]
        np.cumsum(block, out=part)
        step = np.longdouble(part[-1])
        part += float(carry)
        carry += step
    return total


def _finite_mean(rate: Array) -> float:
    """Mean of the samples that are not NaN."""
    return float(np.mean(rate) if chunks.all_finite(rate) else np.nanmean(rate))


def _pair_variance(total: Array, missing: Integers | None, factor: int) -> tuple[float, int]:
    """Allan variance and number of whole pairs at one averaging factor, in blocks along the running
    sum.
    """
    last = total.size - 2 * factor
    square, pairs = 0.0, 0
    buffer = np.empty(min(BLOCK, last))
    for start in range(0, last, BLOCK):
        stop = min(start + BLOCK, last)
        middle = total[start + factor : stop + factor]
        step = np.subtract(
            total[start + 2 * factor : stop + 2 * factor], middle, out=buffer[: stop - start]
        )
        step -= middle
        step += total[start:stop]
        if missing is not None:
            step = step[missing[start + 2 * factor : stop + 2 * factor] == missing[start:stop]]
        square += float(step @ step)
        pairs += step.size
    return square / (2.0 * factor**2 * pairs), pairs


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
    _require_record(rate, interval_s)
    length = round(block_s / interval_s)
    if length < 1 or abs(length * interval_s - block_s) > RIGHT_LENGTH * block_s:
        raise FitError(
            f"a block of {block_s:g} s is not a whole number of samples of {interval_s:g} s",
            hint="resample the log to an interval that divides it",
        )
    means = rate[: rate.size // length * length].reshape(-1, length).mean(axis=1)
    means = means[~np.isnan(means)]
    if means.size < 2:
        raise FitError(
            f"{means.size} whole blocks of {block_s:g} s in {rate.size * interval_s:g} s of record,"
            " at least 2 needed",
            hint="record for longer",
        )
    return BiasStability(length * interval_s, float(np.std(means, ddof=1)), int(means.size))


def wavelet_deviation(
    rate: Array, interval_s: float, *, wavelet: str = "db2", probability: float = 0.95
) -> DeviationCurve:
    """Wavelet deviation of a rate signal, on the Allan deviation's scale but blind to drift.

    Parameters
    ----------
    rate : [n], evenly sampled; a coefficient that touches a gap (NaN) or an end of the
        record is left out.
    wavelet : an orthogonal PyWavelets name with p vanishing moments, blind to drift of degree p −
        1: "haar" (p = 1) is
        the Allan deviation itself, "db2" ignores a linear drift, "db3" a quadratic one.

    Raises
    ------
    FitError : an unknown or non-orthogonal wavelet, or a record too short for the first level.

    Notes
    -----
    Percival & Guttorp 1994: √2 times the unbiased wavelet deviation at scale τ = 2^(j−1) τ₀. Equal
    to the Allan deviation for angle random walk with every wavelet, for other noise a little below
    it. Degrees of freedom: the number of coefficients over the sum of their squared correlations
    (Percival 1995, η₁), for the noise type that has the fewest, and at least 1.
    """
    import pywt

    _require_record(rate, interval_s)
    if wavelet not in pywt.wavelist(kind="discrete") or not pywt.Wavelet(wavelet).orthogonal:
        raise FitError(
            f"'{wavelet}' is not an orthogonal wavelet", hint="use haar, db2, db3, sym4 ..."
        )
    bank = pywt.Wavelet(wavelet)
    levels = int(np.log2(1.0 + (rate.size - 1) / (bank.dec_len - 1)))
    if levels < 1:
        raise FitError(
            f"{rate.size} samples are too few for wavelet {wavelet}",
            hint="use haar or a longer record",
        )
    low, high = np.array(bank.dec_lo), np.array(bank.dec_hi)
    found = list(_wavelet_variances(rate, low, high, levels))
    if not found:
        raise FitError(
            "no stretch without a gap is long enough for the wavelet",
            hint="use haar or a longer record",
        )
    variance, factors, pairs = np.array(found).T
    factors = factors.astype(np.int64)
    correlation = np.array([wavelet_correlation(low, high, m) for m in factors.tolist()])
    dof = np.maximum(pairs / correlation, 1.0)
    return _curve(
        f"wavelet {wavelet}", rate, interval_s, factors, variance, pairs, (), dof, probability
    )


def _wavelet_variances(
    rate: Array, low: Array, high: Array, levels: int
) -> Iterator[tuple[float, int, int]]:
    """Wavelet variance of a rate [n] on the Allan variance's scale, averaging factor and number of
    coefficients of each level that has one beside gaps and ends; `low` and `high` are the filters.

    A level takes the place of the one before it, block by block: a coefficient is made of samples
    from its own place on.
    """
    smooth = rate - _finite_mean(rate)
    gaps = np.flatnonzero(np.isnan(smooth))
    smooth[gaps] = 0.0
    filters = [half[::-1] / np.sqrt(2.0) for half in (low, high)]
    for level in range(levels):
        factor, reach = 2**level, (low.size - 1) * (2 ** (level + 1) - 1)
        size, square, count = rate.size - reach, 0.0, 0
        for start in range(0, size, BLOCK):
            stop = min(start + BLOCK, size)
            kept, detail = (_filter_block(smooth, taps, factor, start, stop) for taps in filters)
            if gaps.size:
                first = np.arange(start, stop)
                passed = np.searchsorted(gaps, first + reach + 1) > np.searchsorted(gaps, first)
                detail = detail[~passed]
            smooth[start:stop] = kept
            square += float(detail @ detail)
            count += detail.size
        if count:
            yield 2.0 * square / count, factor, count


def _filter_block(values: Array, taps: Array, apart: int, start: int, stop: int) -> Array:
    """Sums [stop − start] of values [n] from each place on, `apart` from each other, by taps."""
    total: Array = values[start:stop] * taps[0]
    for k in range(1, taps.size):
        total += values[start + k * apart : stop + k * apart] * taps[k]
    return total


def _curve(
    estimator: str,
    rate: Array,
    interval_s: float,
    factors: Integers,
    variance: Array,
    pairs: Array | Integers,
    kinds: tuple[Noise, ...],
    dof: Array,
    probability: float,
) -> DeviationCurve:
    """Assemble a curve with its limits."""
    deviation = np.sqrt(variance)
    lower, upper = chi_square_limits(deviation, dof, probability)
    return DeviationCurve(
        estimator=estimator,
        interval_s=interval_s,
        samples=int(rate.size),
        factor=factors,
        tau_s=np.asarray(factors * interval_s, dtype=np.float64),
        deviation=deviation,
        pairs=pairs.astype(np.int64),
        noise=kinds,
        dof=dof,
        lower=lower,
        upper=upper,
        probability=probability,
    )


def _require_record(rate: Array, interval_s: float) -> None:
    """Refuse what has no deviation: too few samples, infinite ones, no interval."""
    if (
        rate.ndim != 1
        or rate.size < 3
        or (not chunks.all_finite(rate) and int(np.sum(~np.isnan(rate))) < 3)
    ):
        raise FitError(
            f"a record of shape {rate.shape} holds fewer than three rates", hint="record for longer"
        )
    if not chunks.all_finite(rate) and np.isinf(rate).any():
        raise FitError(
            "an infinite rate in the record", hint="mark unusable samples as missing (NaN)"
        )
    if not (np.isfinite(interval_s) and interval_s > 0.0):
        raise FitError(f"the sampling interval is {interval_s!r} s, expected a positive number")


def _factors_of(tau_s: Sequence[float], interval_s: float, longest: int) -> Integers:
    """Averaging factors [m] of the averaging times asked for, ascending, or a refusal."""
    wanted = np.sort(np.asarray(tau_s, dtype=np.float64))
    factors = np.round(wanted / interval_s).astype(np.int64)
    if factors.size == 0 or factors[0] < 1 or 2 * factors[-1] > longest:
        raise FitError(
            f"averaging times {wanted.tolist()} s, possible are {interval_s:g} s to"
            f" {longest // 2 * interval_s:g} s",
            hint="two whole averages must fit between gaps",
        )
    return np.unique(factors)

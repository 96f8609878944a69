"""Allan deviation with gaps and confidence limits, wavelet deviation, and the bias stability of GJB
2426A.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric import chunks

Noise = Literal["quantization", "angle_random_walk", "bias_instability", "rate_random_walk"]
Spacing = Literal["octave", "decade"]

BLOCK = 1 << 13
"""Samples worked on at once: they stay in a core's cache, and a dot product of them is not shared
out to threads.
"""
LAGS = 200
"""Lags at which the correlation of overlapping pairs is summed; more windows than this are sampled
evenly.
"""
ENOUGH_MEANS = 30
"""Block means below which their lag-1 autocorrelation no longer tells noise types apart (Riley &
Greenhall 2004).
"""
MOST_MEANS = 1 << 16
"""Block means, from the middle of the record, that the noise type is read from."""
RIGHT_LENGTH = 0.01
"""Relative deviation of a block from the length that a standard names, above which the figure is
refused.
"""


@dataclass(frozen=True, slots=True)
class DeviationCurve:
    """A deviation over averaging time: one entry [m] a cluster time, ascending, with chi-square
    confidence limits.
    """

    estimator: str
    interval_s: float
    samples: int
    factor: Integers
    tau_s: Array
    deviation_dph: Array
    pairs: Integers
    noise: tuple[str, ...]
    dof: Array
    lower_dph: Array
    upper_dph: Array
    probability: float


@dataclass(frozen=True, slots=True)
class BiasStability:
    """Standard deviation of block means [deg/h], the GJB figure: not an Allan deviation, and drift
    is in it.
    """

    block_s: float
    value_dph: float
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
    rate : [n], deg/h, evenly sampled; NaN marks a gap, and only pairs of neighbouring averages that
        are whole are used.
    interval_s : sampling interval [s].
    tau_s : averaging times [s], each rounded to whole samples (the curve carries the rounded ones);
        without them
        `points` an octave or a decade, from one sample to a third of the record.
    noise : the type that the degrees of freedom assume, or "identify" for Riley's lag-1 test at
    each averaging time. probability : of the two-sided limits, which are chi-square's.

    Raises
    ------
    FitError : fewer than three samples, an infinite one, an averaging time that the record has no
        whole pair for.

    Notes
    -----
    IEEE Std 952 annex C, overlapped as in NIST SP 1065 eq. 11: σ²(mτ₀) is the mean of (ȳ_{k+m} −
    ȳ_k)²/2 over all k. The record's mean is taken out first, so that the running sum loses no
    digits to it.
    """
    _require_record(rate, interval_s)
    runs = _whole_runs(rate)
    if tau_s is None:
        wanted = _averaging_factors(rate.size, spacing=spacing, points=points)
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
        _identified_noise(total, missing, factors)
        if noise == "identify"
        else (noise,) * factors.size
    )
    dof = np.array(
        [_equivalent_dof(int(m), runs, kind) for m, kind in zip(factors, kinds, strict=True)]
    )
    return _curve(
        "overlapping Allan", rate, interval_s, factors, variance, pairs, kinds, dof, probability
    )


def _averaging_factors(samples: int, *, spacing: Spacing = "octave", points: int = 1) -> Integers:
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
    """Lengths [g] of the stretches of rate [n] that hold no gap; a single zero when there is
    none.
    """
    if chunks.all_finite(rate):
        return np.array([rate.size], dtype=np.int64)
    edges = np.flatnonzero(
        np.diff(np.concatenate(([True], np.isnan(rate), [True])).astype(np.int8))
    )
    lengths = np.asarray(edges[1::2] - edges[::2], dtype=np.int64)
    return lengths if lengths.size else np.zeros(1, dtype=np.int64)


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


def _identified_noise(total: Array, missing: Integers | None, factors: Integers) -> tuple[str, ...]:
    """Noise type at each averaging factor from the lag-1 autocorrelation of block means (after
    Riley & Greenhall 2004).

    A factor that leaves fewer than 30 block means takes the type of the one before it; with none
    before it, rate random walk, which has the fewest degrees of freedom.
    """
    kinds: list[str] = []
    for factor in factors:
        blocks = (total.size - 1) // int(factor)
        first = max(blocks - MOST_MEANS, 0) // 2 * int(factor)
        part = slice(first, first + min(blocks, MOST_MEANS) * int(factor) + 1, int(factor))
        means = np.diff(total[part]) / factor
        if missing is not None:
            means[np.diff(missing[part]) > 0] = np.nan
        if int(np.sum(~np.isnan(means))) >= ENOUGH_MEANS:
            kinds.append(_lag_one_type(means))
        else:
            kinds.append(kinds[-1] if kinds else "rate_random_walk")
    return tuple(kinds)


def _lag_one_type(means: Array) -> str:
    """Noise type of block means [k], NaN where not whole, a straight line taken out.

    Expected are −1/2 for quantization and 0 for angle random walk; differences of what is above 1/3
    have −0.217 for bias instability and 1/4 for rate random walk (`_pair_covariance` at one
    averaging time). Limits lie halfway, but nearer to quantization, whose many degrees of freedom
    must not be claimed by chance.
    """
    present = ~np.isnan(means)
    place = np.arange(means.size, dtype=np.float64)
    level = means - np.polyval(np.polyfit(place[present], means[present], 1), place)
    correlation = _lag_one(level)
    if correlation < 1.0 / 3.0:
        return "quantization" if correlation < -0.4 else "angle_random_walk"
    return "bias_instability" if _lag_one(np.diff(level)) < 0.017 else "rate_random_walk"


def _lag_one(series: Array) -> float:
    """Autocorrelation at lag 1 of a series [k] of mean zero, NaN left out; 1 where nothing is left
    or nothing varies.
    """
    product, square = series[1:] * series[:-1], series**2
    count, power = int(np.sum(~np.isnan(product))), float(np.nansum(square))
    if count == 0 or power == 0.0:
        return 1.0
    return float(np.nansum(product)) / count / (power / int(np.sum(~np.isnan(square))))


def _equivalent_dof(factor: int, runs: Integers, noise: str) -> float:
    """Equivalent degrees of freedom of the overlapping Allan variance at one averaging factor.

    Parameters
    ----------
    factor : samples in an average.
    runs : [g], lengths of the stretches without a gap; pairs of different stretches count as
        independent.
    noise : which of the types of `Noise` the record has at this averaging time.

    Notes
    -----
    Greenhall & Riley 2003, "Uncertainty of stability variances based on finite differences", eq.
    10: 1/dof is the sum of the squared correlations of all pairs over the squared number of pairs.
    Correlations from the generalised autocovariance of the integrated rate, −|t|, t² log|t| and
    |t|³ (their eq. 7 without a bandwidth filter: a gyro's samples are integrals of the rate
    already); quantization from the two lags at which it correlates at all.
    """
    lengths, many = np.unique(
        (runs - 2 * factor + 1)[runs >= 2 * factor].astype(np.float64), return_counts=True
    )
    pairs = float(lengths @ many)
    if noise == "quantization":
        lags = factor * np.arange(3.0)
        weight = np.array([1.0, 2.0, 2.0]) * np.array([1.0, -4.0 / 6.0, 1.0 / 6.0]) ** 2
        return float(pairs**2 / (weight @ np.maximum(lengths - lags[:, None], 0.0) @ many))
    reach = min(int(lengths[-1]), 3 * factor)
    lags = np.unique(np.round(np.linspace(0.0, reach, min(reach, LAGS) + 1)))
    shared = np.maximum(lengths - lags[:, None], 0.0) @ many
    correlation = _pair_covariance(lags / factor, noise) / _pair_covariance(np.zeros(1), noise)
    return float(pairs**2 / (2.0 * np.trapezoid(shared * correlation**2, lags)))


def _pair_covariance(shift: Array, noise: str) -> Array:
    """Covariance, up to a factor, of two pairs `shift` [k] averaging times apart (Greenhall & Riley
    2003 eq. 9).
    """
    arms = np.abs(shift[:, None] + np.array([-2.0, -1.0, 0.0, 1.0, 2.0]))
    if noise == "angle_random_walk":
        generalised = -arms
    elif noise == "bias_instability":
        generalised = arms**2 * np.log(np.where(arms > 0.0, arms, 1.0))
    else:
        generalised = arms**3
    return np.asarray(generalised @ np.array([1.0, -4.0, 6.0, -4.0, 1.0]), dtype=np.float64)


def bias_stability(rate: Array, interval_s: float, *, block_s: float = 10.0) -> BiasStability:
    """Bias stability after GJB 2426A: the standard deviation of the means of consecutive blocks of
    10 s or 100 s.

    Parameters
    ----------
    rate : [n], deg/h, evenly sampled; a block with a gap (NaN) is left out.
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
    rate : [n], deg/h, evenly sampled; a coefficient that touches a gap (NaN) or an end of the
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
    it. Degrees of freedom max(M/2^j, 1), M the number of coefficients (Percival 1995, η₃).
    """
    import pywt

    _require_record(rate, interval_s)
    if wavelet not in pywt.wavelist(kind="discrete") or not pywt.Wavelet(wavelet).orthogonal:
        raise FitError(
            f"'{wavelet}' is not an orthogonal wavelet", hint="use haar, db2, db3, sym4 ..."
        )
    half = pywt.Wavelet(wavelet).dec_len // 2
    levels = int(np.log2(1.0 + (rate.size - 1) / (2 * half - 1)))
    if levels < 1:
        raise FitError(
            f"{rate.size} samples are too few for wavelet {wavelet}",
            hint="use haar or a longer record",
        )
    padded = np.full(-(-rate.size // 2**levels) * 2**levels, np.nan)
    padded[: rate.size] = rate - _finite_mean(rate)
    missing = np.cumsum(np.concatenate(([0], np.isnan(padded))))
    smooth = np.nan_to_num(padded, nan=0.0)
    found: list[tuple[int, float, int]] = []
    for level in range(1, levels + 1):
        # one level on every 2^(level − 1)th sample: PyWavelets' own start_level pads its filters
        # with as many zeros
        ((low, high),) = pywt.swt(
            smooth.reshape(-1, 2 ** (level - 1)), wavelet, level=1, axis=0, norm=True
        )
        smooth, detail = low.ravel(), high.ravel()
        # a coefficient at k sees the samples from k − back to k + ahead, and only such as see the
        # record itself count
        back, ahead = (2**level - 1) * (half - 1), (2**level - 1) * half
        whole = missing[back + ahead + 1 :] == missing[: missing.size - back - ahead - 1]
        inside = detail[back : back + whole.size][whole]
        if inside.size:
            found.append((2 ** (level - 1), 2.0 * float(np.mean(inside**2)), inside.size))
    if not found:
        raise FitError(
            "no stretch without a gap is long enough for the wavelet",
            hint="use haar or a longer record",
        )
    factors, pairs = (np.array([row[k] for row in found], dtype=np.int64) for k in (0, 2))
    variance = np.array([row[1] for row in found])
    dof = np.maximum(pairs / (2.0 * factors), 1.0)
    kinds = ("any",) * factors.size
    return _curve(
        f"wavelet {wavelet}", rate, interval_s, factors, variance, pairs, kinds, dof, probability
    )


def _curve(
    estimator: str,
    rate: Array,
    interval_s: float,
    factors: Integers,
    variance: Array,
    pairs: Array | Integers,
    kinds: tuple[str, ...],
    dof: Array,
    probability: float,
) -> DeviationCurve:
    """Assemble a curve with its limits σ √(dof/χ²) (NIST SP 1065 section 5.3)."""
    from scipy.stats import chi2

    deviation = np.sqrt(variance)
    tail = (1.0 - probability) / 2.0
    return DeviationCurve(
        estimator=estimator,
        interval_s=interval_s,
        samples=int(rate.size),
        factor=factors,
        tau_s=np.asarray(factors * interval_s, dtype=np.float64),
        deviation_dph=deviation,
        pairs=pairs.astype(np.int64),
        noise=kinds,
        dof=dof,
        lower_dph=deviation * np.sqrt(dof / chi2.ppf(1.0 - tail, dof)),
        upper_dph=deviation * np.sqrt(dof / chi2.ppf(tail, dof)),
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

"""Noise type of an Allan variance and its equivalent degrees of freedom.

    r = δ/(1 − δ), α = −2 δ      lag-1 autocorrelation r of means of noise f^α (Riley & Greenhall)
    1/ν = Σ ρ_ij²/n²             ρ the correlations of all n pairs (Greenhall & Riley 2003)
    σ √(ν/χ²_{ν, p})             limits of a deviation (NIST SP 1065)

Degrees of freedom are those of the noise type that the block means of each averaging time show.
"""

from typing import Literal, get_args

import numpy as np

from calibkit.numeric.arrays import Array, Integers

Noise = Literal[
    "quantization",
    "flicker_phase_noise",
    "angle_random_walk",
    "bias_instability",
    "rate_random_walk",
]
"""Noise types by falling exponent α of the rate's spectrum f^α, from 2 to −2."""

TYPES: tuple[Noise, ...] = get_args(Noise)
LAGS = 200
"""Lags at which the correlation of overlapping pairs is summed; more windows than this are sampled
evenly.
"""
ENOUGH_MEANS = 30
"""Block means below which their lag-1 autocorrelation no longer separates noise types (Riley &
Greenhall 2004).
"""
FEWEST_MEANS = 6
"""Block means below which their variance shows no noise type either."""
FREQUENCIES = 2000
"""Points of the logarithmic frequency grid that correlations of wavelet details are found on."""
MOST_MEANS = 1 << 16
"""Block means, from the middle of the record, that the noise type is read from."""


def identify_noise(total: Array, missing: Integers | None, factors: Integers) -> tuple[Noise, ...]:
    """Noise type at each averaging factor from the lag-1 autocorrelation of block means (Riley &
    Greenhall 2004), which a record's running sum [n + 1] gives; `missing` as of
    `allan.count_missing`.

    Fewer than 30 block means name no type. The type assumed there is the one with the fewest
    degrees of freedom of three: that at the factor before, angle random walk, and the one that the
    ratio of the means' variance to their Allan variance shows. With no factor before it is rate
    random walk.
    """
    kinds: list[Noise] = []
    for factor in factors:
        blocks = (total.size - 1) // int(factor)
        # the middle of a long record: more means would not change a rounded exponent
        first = max(blocks - MOST_MEANS, 0) // 2 * int(factor)
        part = slice(first, first + min(blocks, MOST_MEANS) * int(factor) + 1, int(factor))
        means = np.diff(total[part]) / factor
        if missing is not None:
            means[np.diff(missing[part]) > 0] = np.nan
        if int(np.sum(~np.isnan(means))) >= ENOUGH_MEANS:
            kinds.append(_lag_one_type(means))
        else:
            before = kinds[-1] if kinds else TYPES[-1]
            kinds.append(max(before, _ratio_type(means), key=TYPES.index))
    return tuple(kinds)


def _lag_one_type(means: Array) -> Noise:
    """Noise type of block means [k], NaN where not whole, a straight line taken out.

    A series of spectrum f^α is one of fractional order δ = −α/2 with the lag-1 autocorrelation
    r = δ/(1 − δ); one of δ above 1/4 is differenced once, which adds 2 to −α. The exponent is
    rounded, as Stable32 rounds it. Means of flicker, −0.217 after differencing, lie near the limit
    of −0.2 to a random walk.
    """
    present = ~np.isnan(means)
    # a drift of the rate would look like a random walk
    place = np.arange(means.size) - (means.size - 1) / 2.0
    level = means - np.polyval(np.polyfit(place[present], means[present], 1), place)
    order, differenced = _fraction(level), 0
    if order >= 0.25:
        order, differenced = _fraction(np.diff(level)), 1
    exponent = -round(2.0 * order) - 2 * differenced
    return TYPES[2 - min(max(exponent, -2), 2)]


def _fraction(series: Array) -> float:
    """Fractional order δ = r/(1 + r) of a series [k] of mean zero, NaN left out, from its lag-1
    autocorrelation r; 1/2 where nothing is left or nothing varies.
    """
    product, square = series[1:] * series[:-1], series**2
    if np.isnan(product).all() or not np.nansum(square) > 0.0:
        return 0.5
    # r is the sum of n - 1 products over that of n squares, as Stable32 has it
    share = product.size / series.size
    correlation = share * float(np.nanmean(product) / np.nanmean(square))
    return correlation / (1.0 + correlation)


def _ratio_type(means: Array) -> Noise:
    """Noise type that few block means [k], NaN where not whole, show in B₁, the ratio of their
    variance to their Allan variance (Barnes 1969); no phase noise.

    Expected are 1 of angle random walk, k log k/(2 (k − 1) log 2) of flicker and k/2 of a random
    walk. It is flicker from its expectation on, so that angle random walk rarely passes for it.
    """
    count = float(np.sum(~np.isnan(means)))
    steps = np.diff(means)
    if count < FEWEST_MEANS or np.isnan(steps).all() or not np.nansum(steps**2) > 0.0:
        return "angle_random_walk"
    ratio = float(np.nanvar(means, ddof=1) / (0.5 * np.nanmean(steps**2)))
    flicker = count * np.log(count) / (2.0 * (count - 1.0) * np.log(2.0))
    if ratio**2 > flicker * count / 2.0:
        return "rate_random_walk"
    return "bias_instability" if ratio > flicker else "angle_random_walk"


def equivalent_dof(factor: int, runs: Integers, noise: Noise) -> float:
    """Equivalent degrees of freedom of the overlapping Allan variance at one averaging factor.

    Parameters
    ----------
    factor : samples in an average.
    runs : [g], lengths of the runs without a gap; pairs of different runs count as
        independent.
    noise : which of the types of `Noise` the record has at this averaging time.

    Notes
    -----
    Greenhall & Riley 2003, "Uncertainty of stability variances based on finite differences", eq.
    10: 1/dof is the sum of the squared correlations of all pairs over the squared number of pairs.
    Correlations from the generalised autocovariance of the integrated rate, −|t|, t² log|t| and
    |t|³ (their eq. 7 without a bandwidth filter: a gyro's samples are integrals of the rate
    already). Phase noise from the two lags at which quantization correlates at all, but never more
    than angle random walk has: overlapping gives phase noise new information at every sample, which
    no few blocks can vouch for.
    """
    # numbers of whole pairs of averages in the runs that have any, and how often each occurs
    whole_pairs = (runs - 2 * factor + 1)[runs >= 2 * factor]
    lengths, runs_of_length = np.unique(whole_pairs.astype(np.float64), return_counts=True)
    if noise in ("quantization", "flicker_phase_noise"):
        # phase noise of second differences of the angle is correlated with that one and two
        # averages on: 1, -4/6, 1/6
        lags = factor * np.arange(3.0)
        weight = np.array([1.0, 2.0, 2.0]) * np.array([1.0, -4.0 / 6.0, 1.0 / 6.0]) ** 2
        shared = weight @ np.maximum(lengths - lags[:, None], 0.0) @ runs_of_length
        of_phase_noise = float((lengths @ runs_of_length) ** 2 / shared)
        return min(of_phase_noise, equivalent_dof(factor, runs, "angle_random_walk"))
    pairs = float(lengths @ runs_of_length)
    reach = min(int(lengths[-1]), 3 * factor)
    # beyond three averaging times pairs are as good as independent
    lags = np.unique(np.round(np.linspace(0.0, reach, min(reach, LAGS) + 1)))
    shared = np.maximum(lengths - lags[:, None], 0.0) @ runs_of_length
    # covariance, up to a factor, of two pairs so many averaging times apart (eq. 9)
    arms = np.abs(lags[:, None] / factor + np.array([-2.0, -1.0, 0.0, 1.0, 2.0]))
    if noise == "angle_random_walk":
        generalised = -arms
    elif noise == "bias_instability":
        generalised = arms**2 * np.log(np.where(arms > 0.0, arms, 1.0))
    else:
        generalised = arms**3
    # fourth difference of the generalised autocovariance (eq. 9)
    covariance = generalised @ np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    correlation = covariance / covariance[0]
    return float(pairs**2 / (2.0 * np.trapezoid(shared * correlation**2, lags)))


def wavelet_correlation(low: Array, high: Array, factor: int) -> float:
    """Sum over all lags of the squared correlations of wavelet details, by which their number is
    divided to give degrees of freedom: the largest that a noise type of `TYPES` has.

    Parameters
    ----------
    low, high : [k] taps of the wavelet's decomposition filters.
    factor : averaging factor 2^(j − 1) of level j.

    Notes
    -----
    ∫S² dν / (∫S dν)² by Parseval, S the spectrum of the noise behind the filters of the level.
    """
    nu, step = logarithmic_grid(1e-3 / factor, FREQUENCIES)
    gain = _response(high, factor * nu)
    for level in range(factor.bit_length() - 1):
        gain *= _response(low, 2**level * nu)
    spectra = gain * np.sin(np.pi * nu) ** np.arange(2.0, -3.0, -1.0)[:, None]
    return float(np.max(spectra**2 @ step / (2.0 * (spectra @ step) ** 2)))


def logarithmic_grid(lowest: float, points: int) -> tuple[Array, Array]:
    """Frequencies [f, cycles per sample] from the lowest to a half, evenly spaced in logarithm, and
    the weights [f] of an integral over them.
    """
    nu = np.geomspace(lowest, 0.5, points)
    step = nu * np.log(nu[1] / nu[0])
    # trapezoidal rule in ln ν
    step[[0, -1]] /= 2.0
    return nu, step


def _response(taps: Array, nu: Array) -> Array:
    """Squared magnitude [f] of a filter's frequency response, taps [k], cycles per sample [f]."""
    return np.asarray(np.abs(taps @ np.exp(-2j * np.pi * np.outer(np.arange(taps.size), nu))) ** 2)


def chi_square_limits(deviation: Array, dof: Array, probability: float) -> tuple[Array, Array]:
    """Two-sided limits σ √(dof/χ²) [m each] of deviations [m] with degrees of freedom [m] (NIST SP
    1065 section 5.3).
    """
    from scipy.special import chdtri

    tail = (1.0 - probability) / 2.0
    return (
        deviation * np.sqrt(dof / chdtri(dof, tail)),
        deviation * np.sqrt(dof / chdtri(dof, 1.0 - tail)),
    )

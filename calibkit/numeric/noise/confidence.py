"""Noise type of an Allan variance and its equivalent degrees of freedom (Riley & Greenhall)."""

from typing import Literal

import numpy as np

from calibkit.arrays import Array, Integers

Noise = Literal["quantization", "angle_random_walk", "bias_instability", "rate_random_walk"]

LAGS = 200
"""Lags at which the correlation of overlapping pairs is summed; more windows than this are sampled
evenly.
"""
ENOUGH_MEANS = 30
"""Block means below which their lag-1 autocorrelation no longer separates noise types (Riley &
Greenhall 2004).
"""
MOST_MEANS = 1 << 16
"""Block means, from the middle of the record, that the noise type is read from."""


def identify_noise(total: Array, missing: Integers | None, factors: Integers) -> tuple[str, ...]:
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


def equivalent_dof(factor: int, runs: Integers, noise: str) -> float:
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

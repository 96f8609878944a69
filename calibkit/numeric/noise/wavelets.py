"""Wavelet deviation of a rate at rest: the Allan deviation's companion that drift does not enter.

All levels are filtered in one pass along the record, in one array of its length.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.noise.allan import BLOCK, DeviationCurve, finite_mean, require_record
from calibkit.numeric.noise.confidence import wavelet_correlation
from calibkit.numeric.noise.gaps import Gaps, open_places


@dataclass(slots=True)
class _Level:
    """One level of a record while it is filtered: how far apart its taps are, its coefficients,
    those that are done, their sum of squares and their number beside gaps.
    """

    apart: int
    size: int
    closed: Integers
    done: int = 0
    square: float = 0.0
    count: int = 0


def wavelet_deviation(
    rate: Array,
    interval_s: float,
    *,
    wavelet: str = "db2",
    probability: float = 0.95,
    allocate: Callable[[int], Array] = np.empty,
) -> DeviationCurve:
    """Wavelet deviation of a rate signal, on the Allan deviation's scale but blind to drift.

    Parameters
    ----------
    rate : [n], evenly sampled; a coefficient that touches a gap (NaN) or an end of the
        record is left out.
    wavelet : an orthogonal PyWavelets name with p vanishing moments, blind to drift of degree p −
        1: "haar" (p = 1) is
        the Allan deviation itself, "db2" ignores a linear drift, "db3" a quadratic one.
    allocate : makes the array [n] that is filtered, in memory or on disk.

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

    require_record(rate, interval_s)
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
    gaps = Gaps.find(rate)
    found = _filter_levels(_centred(rate, gaps, allocate), gaps, low, high, levels)
    if not found:
        raise FitError(
            "no stretch without a gap is long enough for the wavelet",
            hint="use haar or a longer record",
        )
    factors = np.array([level.apart for level in found])
    pairs = np.array([level.count for level in found])
    # on the Allan variance's scale
    variance = np.array([2.0 * level.square / level.count for level in found])
    correlation = np.array([wavelet_correlation(low, high, m) for m in factors.tolist()])
    dof = np.maximum(pairs / correlation, 1.0)
    return DeviationCurve.of_variance(
        *(f"wavelet {wavelet}", interval_s, rate.size, factors, variance, pairs, (), dof),
        probability,
    )


def _centred(rate: Array, gaps: Gaps, allocate: Callable[[int], Array]) -> Array:
    """Rate [n] less its mean, gaps as zero."""
    mean, made = finite_mean(rate, gaps), allocate(rate.size)
    for a, b in chunks.ranges_along(rate, made):
        np.subtract(rate[a:b], mean, out=made[a:b])
        if gaps.runs.size:
            made[a:b][np.isnan(rate[a:b])] = 0.0
    return made


def _filter_levels(smooth: Array, gaps: Gaps, low: Array, high: Array, levels: int) -> list[_Level]:
    """Those levels that have a coefficient beside gaps and ends; `low` and `high` are the filters.

    A level takes the place of the one before it in `smooth` [n], block by block: a coefficient is
    made of samples from its own place on. It follows the level before it as closely as its taps
    allow, so that a record on disk is read and written once.
    """
    found, size = [], smooth.size
    for apart in (1 << level for level in range(levels)):
        size -= (low.size - 1) * apart
        found.append(_Level(apart, size, gaps.closed_to(smooth.size - size + 1)))
    filters = low[::-1] / np.sqrt(2.0), high[::-1] / np.sqrt(2.0)
    for _, known in chunks.ranges(smooth.size):
        ready = known
        for level in found:
            for start, stop in _blocks(level, ready - (low.size - 1) * level.apart):
                _filter_block(smooth, filters, level, start, stop)
            ready = level.done
        chunks.release(smooth)
    return [level for level in found if level.count]


def _blocks(level: _Level, ready: int) -> Iterator[tuple[int, int]]:
    """Blocks of a level from its first coefficient that is not done to `ready`; only the last of a
    level is shorter.
    """
    while level.done < level.size and ready >= min(level.done + BLOCK, level.size):
        stop = min(level.done + BLOCK, level.size)
        yield level.done, stop
        level.done = stop


def _filter_block(
    smooth: Array, filters: tuple[Array, Array], level: _Level, start: int, stop: int
) -> None:
    """Filter the coefficients start … stop − 1 of a level: the smooth ones take the place of those
    of the level before, the details are summed up.
    """
    kept, detail = (_filtered(smooth, taps, level.apart, start, stop) for taps in filters)
    smooth[start:stop] = kept
    beside = open_places(level.closed, start, stop)
    detail = detail if beside is None else detail[beside]
    level.square += float(detail @ detail)
    level.count += detail.size


def _filtered(values: Array, taps: Array, apart: int, start: int, stop: int) -> Array:
    """Sums [stop − start] of values [n] from each place on, `apart` from each other, by taps."""
    total: Array = values[start:stop] * taps[0]
    for k in range(1, taps.size):
        total += values[start + k * apart : stop + k * apart] * taps[k]
    return total

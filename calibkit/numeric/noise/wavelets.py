"""Wavelet deviation of a rate at rest: the Allan deviation's companion that drift does not enter.

    σ²(2^(j−1) τ₀) = 2 ⟨d_j²⟩, d_j the details of level j of an orthogonal wavelet, undecimated

Each level takes the place of the one before it, in one array of the record's length.
"""

from collections.abc import Callable, Iterator

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric.noise.allan import DeviationCurve, centred, require_record
from calibkit.numeric.noise.confidence import wavelet_correlation
from calibkit.numeric.noise.gaps import Gaps, filtered, square_beside_gaps


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
    rate : [n], evenly sampled; a coefficient that touches a gap (NaN) or an end of the record is
        left out.
    wavelet : an orthogonal PyWavelets name with p vanishing moments, blind to drift of degree p −
        1: "haar" (p = 1) is the Allan deviation itself, "db2" ignores a linear drift, "db3" a
        quadratic one.
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
    gaps, smooth = Gaps.find(rate), allocate(rate.size)
    for start, stop, block in centred(rate, gaps, smooth):
        smooth[start:stop] = block
    factors, squares, counts = [], [], []
    for factor in (1 << level for level in range(levels)):
        details = _next_level(smooth, low[::-1] / np.sqrt(2.0), high[::-1] / np.sqrt(2.0), factor)
        smooth = smooth[: smooth.size - (low.size - 1) * factor]
        closed = gaps.closed_to(rate.size - smooth.size + 1)
        square, count = square_beside_gaps(details, closed)
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
        *(f"wavelet {wavelet}", interval_s, rate.size, np.array(factors), variance, pairs, (), dof),
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

"""The median of many magnitudes, exactly, without sorting or copying them all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MANY = 1 << 16
"""Values from which a sample of them is worth its while."""
SAMPLE = 1 << 14
"""Values, evenly spread, that tell where the median must be."""
MARGIN = 4.0
"""Standard deviations of the sample's median by which it may be off: once in 15,000 it is, and all values are partitioned."""
BLOCK = 1 << 15
"""Values worked on at once: they stay in the cache."""


def magnitude(values: Array, about: float = 0.0) -> float:
    """Median of |values − about| of values [n], exactly that of a full sort; the mean of the middle two where n is even.

    Parameters
    ----------
    values
        [n], any unit; read-only arrays serve, nothing is written into them.
    about
        What the magnitudes are taken from: 0, or the median for the median absolute deviation.

    Raises
    ------
    FitError
        No value, or one that is not finite.

    Notes
    -----
    A sample brackets the median (Floyd & Rivest 1975); one pass counts the magnitudes below the bracket and collects those
    inside, and only these are partitioned. Where the sample has misled, all are.
    """
    n = values.size
    if n == 0:
        raise FitError("no values have a median")
    ranks = ((n - 1) // 2, n // 2)
    if n >= MANY:
        low, high = _bracket(values, about)
        below, inside = _inside(values, about, low, high)
        if below <= ranks[0] and ranks[1] < below + inside.size:
            return _middle(inside, ranks[0] - below, ranks[1] - below)
    whole = np.abs(values if about == 0.0 else values - about)
    _require_finite(float(whole.max()))
    return _middle(whole, *ranks)


def _bracket(values: Array, about: float) -> tuple[float, float]:
    """Magnitudes between which the median lies, by an evenly spread sample."""
    step = values.size // SAMPLE
    # no common divisor with what logs repeat by: every 200th value may be of another kind
    while math.gcd(step, 210) > 1:
        step += 1
    sample = np.sort(np.abs(values[::step] - about))
    off = round(MARGIN * math.sqrt(sample.size) / 2.0)
    middle = sample.size // 2
    return float(sample[max(middle - off, 0)]), float(sample[min(middle + off, sample.size - 1)])


def _inside(values: Array, about: float, low: float, high: float) -> tuple[int, Array]:
    """Number of magnitudes below a bracket, and those inside it."""
    room = np.empty(min(BLOCK, values.size))
    below, largest = 0, 0.0
    parts = []
    for start in range(0, values.size, BLOCK):
        block = values[start : start + BLOCK]
        here = np.abs(block if about == 0.0 else block - about, out=room[: block.size])
        # a NaN is neither below nor above anything, but it is the largest
        largest = np.maximum(largest, here.max())
        under, up_to = here < low, here <= high
        below += int(np.count_nonzero(under))
        parts.append(here[under ^ up_to])
    _require_finite(float(largest))
    return below, np.concatenate(parts)


def _middle(values: Array, low: int, high: int) -> float:
    """Mean of the values of two ranks, equal or neighbours; the values [n] are reordered."""
    values.partition(high)
    upper = float(values[high])
    return upper if low == high else (upper + float(values[:high].max())) / 2.0


def _require_finite(largest: float) -> None:
    """Refuse magnitudes whose largest is not finite."""
    if not math.isfinite(largest):
        raise FitError("a value that is not finite has no place in a median", hint="exclude it")

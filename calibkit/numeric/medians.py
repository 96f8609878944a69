"""The median of many magnitudes, exactly, without sorting or copying them all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import spans

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MANY = 1 << 16
"""Values from which a sample of them is worth its while."""
SAMPLE = 1 << 14
"""Values, evenly spread, that tell where the median must be."""
MARGIN = 4.0
"""Standard deviations of the sample's median by which it may be off: once in 15,000 it is, and the bracket is made anew."""
BLOCK = 1 << 15
"""Values worked on at once: they stay in the cache."""


def magnitude(values: Array, about: float = 0.0) -> float:
    """Median of |values − about| of values [n], exactly that of a full sort; the mean of the middle two where n is even.

    Parameters
    ----------
    values
        [n], any unit; read-only arrays and mapped files serve, nothing is written into them. Memory is that of some blocks.
    about
        What the magnitudes are taken from: 0, or the median for the median absolute deviation.

    Raises
    ------
    FitError
        No value, or one that is not finite.

    Notes
    -----
    A sample brackets the median (Floyd & Rivest 1975); one pass counts the magnitudes below the bracket and collects those
    inside, and only these are partitioned. Where the sample has misled, `spans.middle` looks for another bracket.
    """
    n = values.size
    if n == 0:
        raise FitError("no values have a median")

    def magnitudes() -> Iterator[Array]:
        for start, stop in spans.along(values, rows=BLOCK):
            block = values[start:stop]
            here = np.abs(block if about == 0.0 else block - about)
            # a NaN lies on no side of anything, but it is the largest
            if not math.isfinite(float(here.max())):
                raise FitError("a value that is not finite has no place in a median", hint="exclude it")
            yield here

    return spans.middle(magnitudes, n, _bracket(values, about) if n >= MANY else None)


def _bracket(values: Array, about: float) -> tuple[float, float]:
    """Magnitudes between which the median lies, by an evenly spread sample."""
    step = values.size // SAMPLE
    # no common divisor with what logs repeat by: every 200th value may be of another kind
    while math.gcd(step, 210) > 1:
        step += 1
    sample = np.sort(np.abs(spans.taken(values, slice(0, values.size, step)) - about))
    off = round(MARGIN * math.sqrt(sample.size) / 2.0)
    middle = sample.size // 2
    return float(sample[max(middle - off, 0)]), float(sample[min(middle + off, sample.size - 1)])

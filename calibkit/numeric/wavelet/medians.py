"""The median of many magnitudes, exactly, without sorting or copying them all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import spans
from calibkit.numeric.compiled import kernels_for

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibkit.arrays import Array


MANY = 1 << 16
"""Values from which a sample of them is worth its while."""
SAMPLE = 1 << 14
"""Values, evenly spread, that tell where the median must be."""
MARGIN = 4.0
"""Standard deviations of the sample's median by which it may be off: once in 15,000 it is, and the
bracket is made anew.
"""
UNUSABLE = "a value that is not finite has no place in a median"
NOT_FINITE = -1
"""What the compiled pass says where it meets one."""
BLOCK = 1 << 15
"""Values worked on at once: they stay in the cache."""


def magnitude(values: Array, about: float = 0.0) -> float:
    """Median of |values − about| of values [n], exactly that of a full sort; the mean of the middle
    two where n is even.

    Parameters
    ----------
    values
        [n], any unit; read-only arrays and mapped files serve, nothing is written into them. Memory
        is that of some blocks.
    about
        What the magnitudes are taken from: 0, or the median for the median absolute deviation.

    Raises
    ------
    FitError
        No value, or one that is not finite.

    Notes
    -----
    A sample brackets the median (Floyd & Rivest 1975); one pass counts the magnitudes below the
    bracket and collects those inside, and only these are partitioned. Where the sample has misled,
    `spans.middle` looks for another bracket.
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
                raise FitError(UNUSABLE, hint="exclude it")
            yield here

    if n < MANY:
        return spans.middle(magnitudes, n)
    bracket = _bracket(values, about)
    found = _compiled(values, about, bracket)
    return spans.middle(magnitudes, n, bracket) if found is None else found


def _compiled(values: Array, about: float, bracket: tuple[float, float]) -> float | None:
    """The median in one compiled pass; None where nothing is compiled, or where it is not between
    those two magnitudes.
    """
    library = kernels_for(values)
    if library is None:
        return None
    room, above = np.empty(spans.KEPT), np.zeros(1, dtype=np.int64)
    held, up_to = 0, values.size
    for start, stop in spans.along(values):
        part, free = values[start:stop], room[held:]
        given = (part.ctypes.data, part.size, about, *bracket, free.ctypes.data, free.size)
        found = library.calibkit_bracketed(*given, above.ctypes.data)
        if found == NOT_FINITE:
            raise FitError(UNUSABLE, hint="exclude it")
        if found < 0:
            return None
        held, up_to = held + found, up_to - int(above[0])
    first, last = (values.size - 1) // 2 - up_to, values.size // 2 - up_to
    if first < 0 or last >= held:
        return None
    kept = room[:held]
    kept.partition(last)
    return float((kept[last] if first == last else kept[:last].max()) + kept[last]) / 2.0


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

"""Medians and quantiles of columns of any length, in bounded memory, equal to those of numpy.

The bits of doubles are in the order of the numbers, those of negative ones in the reverse order
(IEEE 754). Each pass counts by the next 16 bits the values that agree with the order statistic in
the bits before, until they are few enough to be held and sorted.
"""

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric import chunks

COLLECTED = 1 << 19
"""Largest number of values that a search holds in memory."""
DIGIT = 16
"""Bits that a pass counts by."""


def median(values: Array) -> float:
    """Median of values [n] in bounded memory, equal to `np.median`."""
    return median_of_chunks(
        lambda: (values[a:b] for a, b in chunks.ranges_along(values)), values.size
    )


def run_medians(values: Array, first: Integers) -> Array:
    """Medians [m] of the runs of finite values [n] that begin at rows `first` [m], equal to those
    of `np.median`; every run has a value. Runs of equal size are partitioned together.
    """
    count = np.diff(np.append(first, values.size))
    medians = np.empty(first.size)
    for size in np.unique(count).tolist():
        of_size = np.flatnonzero(count == size)
        for begin, stop in chunks.ranges(of_size.size, max(1, chunks.ROWS // size)):
            runs = of_size[begin:stop]
            part = values[first[runs, None] + np.arange(size)]
            part.partition(size // 2, axis=1)
            medians[runs] = _median_of_parted(part, size)
    return medians + 0.0  # a zero is positive


def median_of_chunks(parts: Callable[[], Iterable[Array]], count: int) -> float:
    """Median of `count` finite values in chunks, equal to that of the whole array; `parts` yields
    the chunks anew at each call. NaN for no value.
    """
    if count == 0:
        return float("nan")
    if count <= COLLECTED:
        values = np.concatenate(list(parts()))
        values.partition(count // 2)  # puts NaN last
        return (
            float(_median_of_parted(values, count))
            if not np.isnan(values[count // 2 :].max())
            else float("nan")
        )
    low, high = _values_at_ranks(parts, (count - 1) // 2, count // 2, count)
    return (low + high) / 2.0


def median_magnitude(values: Array, centre: float = 0.0) -> float:
    """Median of |values − centre| of values [n], equal to that of a full sort; the mean of the two
    middle ones for even n.

    Parameters
    ----------
    values
        [n], any unit; read-only arrays and mapped files serve, nothing is written into them. Memory
        is that of some chunks.
    centre
        What the magnitudes are taken from: 0, or the median for the median absolute deviation.

    Raises
    ------
    FitError
        No value, or one that is not finite.
    """
    if not values.size:
        raise FitError("no values have a median")
    if not chunks.all_finite(values):
        raise FitError("a value that is not finite has no place in a median", hint="exclude it")
    return median_of_chunks(
        lambda: (
            np.abs(values[a:b] - centre)
            for a, b in chunks.ranges_along(values, rows=chunks.CACHED_ROWS)
        ),
        values.size,
    )


def quantile_of_chunks(parts: Callable[[], Iterable[Array]], count: int, share: float) -> float:
    """Quantile of `count` finite values in chunks, equal to `np.quantile`; `parts` yields the
    chunks anew at each call.
    """
    if count <= COLLECTED:
        return float(np.quantile(np.concatenate(list(parts())), share))
    position = share * (count - 1)
    low, high = _values_at_ranks(parts, int(position), min(int(position) + 1, count - 1), count)
    # from the nearer value, as numpy does
    part, step = position - int(position), high - low
    return low + step * part if part < 0.5 else high - step * (1.0 - part)


def smallest_step(values: Array, *, fine_step: float = 0.0, decimals: int | None = None) -> float:
    """Smallest difference between two distinct values of a column [n], rounded if `decimals` is
    given; 0 if all are equal.

    The search ends at the first difference of at most `fine_step`, so that distinct values of noise
    are not all collected.
    """
    levels, step = np.zeros(0), 0.0
    for start, stop in chunks.ranges_along(values):
        part = values[start:stop]
        new = np.unique(part if decimals is None else np.round(part, decimals))
        if levels.size and np.isin(new, levels, assume_unique=True).all():
            continue
        levels = np.union1d(levels, new)
        step = float(np.min(np.diff(levels))) if levels.size > 1 else 0.0
        if 0.0 < step <= fine_step:
            break
    return step


def _median_of_parted(parted: Array, size: int) -> Array:
    """Median along the last axis of values partitioned at index size // 2.

    For even sizes the lower middle value is the maximum of those below: numpy's selection of one
    element is vectorised, that of two is not and takes five times as long.
    """
    upper = parted[..., size // 2]
    return upper if size % 2 else np.asarray((parted[..., : size // 2].max(axis=-1) + upper) / 2.0)


def _values_at_ranks(
    parts: Callable[[], Iterable[Array]], low: int, high: int, count: int
) -> tuple[float, float]:
    """Values at two ranks (from 0; equal or consecutive) among all `count`."""
    leading, shift, before, inside = 0, 64, 0, count
    while inside > COLLECTED and shift:
        shift -= DIGIT
        numbers = np.zeros(1 << DIGIT, dtype=np.int64)
        for bits in _agreeing(parts, leading, shift + DIGIT):
            digits = bits >> np.uint64(shift) & np.uint64(numbers.size - 1)
            numbers += np.bincount(digits.view(np.int64), minlength=numbers.size)
        # the first bit stands for the sign; of negative values the largest bits are the least
        positive, negative = np.split(np.arange(numbers.size), 2)
        ascending = np.concatenate([negative[::-1], positive])
        if shift + DIGIT < 64:
            is_negative = leading >> 63 - shift - DIGIT
            ascending = np.arange(numbers.size)[:: -1 if is_negative else 1]
        up_to = before + np.cumsum(numbers[ascending])
        place = int(np.searchsorted(up_to, low, side="right"))
        inside = int(numbers[ascending[place]])
        before = int(up_to[place]) - inside
        leading = (leading << DIGIT) + int(ascending[place])
    if shift:
        agreeing = np.concatenate(list(_agreeing(parts, leading, shift))).view(np.float64)
        agreeing.sort()
    else:  # values that agree in all bits
        agreeing = np.broadcast_to(np.uint64(leading).view(np.float64), inside)
    lower = float(agreeing[low - before])
    if high - before < inside:
        return lower, float(agreeing[high - before])
    # the higher one has other leading bits
    return lower, _values_at_ranks(parts, high, high, count)[1]


def _agreeing(
    parts: Callable[[], Iterable[Array]], leading: int, shift: int
) -> Iterator[np.ndarray[tuple[int], np.dtype[np.uint64]]]:
    """Bits of those values in chunks whose bits above `shift` are `leading`."""
    for part in parts():
        bits = part.view(np.uint64)
        yield bits if shift == 64 else bits[bits >> np.uint64(shift) == leading]

"""Medians and quantiles of columns of any length, in bounded memory, equal to those of numpy.

A sample gives a bracket around the order statistic. One pass counts the values below the bracket
and collects those inside, and only these are partitioned (Floyd & Rivest 1975). If the statistic
lies outside the bracket, the search is repeated in the part that holds it.
"""

import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric import chunks

COLLECTED = 1 << 19
"""Largest number of values that a search holds in memory."""
SAMPLE = 1 << 13
"""Size of the sample from which the bracket is taken."""
MARGIN = 4.0
"""Half width of the bracket in standard deviations of the sample's quantile; 1 of 15,000 brackets
misses and is replaced.
"""


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
        same = np.flatnonzero(count == size)
        begin, step = int(first[same[0]]), max(1, chunks.ROWS // size)
        if int(first[same[-1]]) == begin + (same.size - 1) * size:
            together = values[begin : begin + same.size * size].reshape(same.size, size)
        else:
            together = values[first[same, None] + np.arange(size)]
        for k in range(0, same.size, step):
            part = np.partition(together[k : k + step], size // 2, axis=1)
            medians[same[k : k + step]] = _median_of_parted(part, size)
    return medians + 0.0  # a zero is positive


def median_of_chunks(
    parts: Callable[[], Iterable[Array]], count: int, bracket: tuple[float, float] | None = None
) -> float:
    """Median of `count` finite values in chunks, equal to that of the whole array; `parts` yields
    the chunks anew at each call.

    `bracket` are two values between which the median probably lies; without them one more pass is
    made. NaN for no value.
    """
    if count == 0:
        return float("nan")
    if count <= COLLECTED and bracket is None:
        whole = np.concatenate(list(parts()))
        whole.partition(count // 2)  # puts NaN last
        return (
            float(_median_of_parted(whole, count))
            if not np.isnan(whole[count // 2 :].max())
            else float("nan")
        )
    low, high = _values_at_ranks(parts, ((count - 1) // 2, count // 2), count, bracket)
    return (low + high) / 2.0


def median_magnitude(values: Array, about: float = 0.0) -> float:
    """Median of |values − about| of values [n], equal to that of a full sort; the mean of the two
    middle ones for even n.

    Parameters
    ----------
    values
        [n], any unit; read-only arrays and mapped files serve, nothing is written into them. Memory
        is that of some chunks.
    about
        What the magnitudes are taken from: 0, or the median for the median absolute deviation.

    Raises
    ------
    FitError
        No value, or one that is not finite.
    """
    n = values.size
    if n == 0:
        raise FitError("no values have a median")

    def magnitudes() -> Iterator[Array]:
        for start, stop in chunks.ranges_along(values, rows=chunks.CACHED_ROWS):
            block = values[start:stop]
            here = np.abs(block if about == 0.0 else block - about)
            # NaN compares false with both bounds, but propagates to the maximum
            if not math.isfinite(float(here.max())):
                raise FitError(
                    "a value that is not finite has no place in a median", hint="exclude it"
                )
            yield here

    return median_of_chunks(magnitudes, n)


def quantile_of_chunks(parts: Callable[[], Iterable[Array]], count: int, share: float) -> float:
    """Quantile of `count` finite values in chunks, equal to `np.quantile`; `parts` yields the
    chunks anew at each call.
    """
    if count <= COLLECTED:
        return float(np.quantile(np.concatenate(list(parts())), share))
    at = share * (count - 1)
    low, high = _values_at_ranks(parts, (int(at), min(int(at) + 1, count - 1)), count)
    # from the nearer value, as numpy does
    part, step = at - int(at), high - low
    return low + step * part if part < 0.5 else high - step * (1.0 - part)


def quantile_bracket(sample: Array, share: float = 0.5) -> tuple[float, float]:
    """Bracket of a quantile (by default the median) of a population: two values of a sample [n]
    between which it probably lies.
    """
    ordered = np.sort(sample)
    reach = MARGIN * np.sqrt(share * (1.0 - share) / ordered.size) + 2.0 / ordered.size
    at = np.clip(
        [(share - reach) * ordered.size, (share + reach) * ordered.size], 0, ordered.size - 1
    ).astype(np.int64)
    return float(ordered[at[0]]), float(ordered[at[1]])


def smallest_step(values: Array, *, enough: float = 0.0, decimals: int | None = None) -> float:
    """Smallest difference between two distinct values of a column [n], rounded if `decimals` is
    given; 0 if all are equal.

    The search ends at the first difference of at most `enough`, so that distinct values of noise
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
        if 0.0 < step <= enough:
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
    parts: Callable[[], Iterable[Array]],
    ranks: tuple[int, int],
    count: int,
    bracket: tuple[float, float] | None = None,
) -> tuple[float, float]:
    """Values at two ranks (from 0; equal or consecutive) among all, by a bracket that is narrowed
    until they are found.
    """
    low, high, below, inside = -np.inf, np.inf, 0, count
    while True:
        first, last = bracket or _next_bracket(
            parts, (low, high), (sum(ranks) / 2.0 - below) / inside, inside
        )
        bracket = None
        counts, kept = _count_and_collect(parts, first, last)
        cell = np.searchsorted(counts, ranks, side="right")
        if cell[0] != cell[1]:  # the ranks lie on both sides of a bound
            return (
                _values_at_ranks(parts, (ranks[0],) * 2, count)[0],
                _values_at_ranks(parts, (ranks[1],) * 2, count)[0],
            )
        if cell[0] in {1, 3}:
            return (first,) * 2 if cell[0] == 1 else (last,) * 2
        if cell[0] == 2 and kept is not None:
            upper = ranks[1] - counts[1]
            kept.partition(upper)
            pair = kept[: upper + 1]
            return float(pair[:-1].max() if ranks[0] != ranks[1] else pair[-1]), float(pair[-1])
        edges = (below, *counts, below + inside)
        low, high = {0: (low, first), 2: (first, last), 4: (last, high)}[int(cell[0])]
        below, inside = edges[cell[0]], edges[cell[0] + 1] - edges[cell[0]]


def _next_bracket(
    parts: Callable[[], Iterable[Array]], bounds: tuple[float, float], share: float, inside: int
) -> tuple[float, float]:
    """Bracket of the quantile `share` of those `inside` values that lie strictly between two
    bounds, from a sample of them.
    """
    sampled: list[Array] = []
    every = max(1, inside // SAMPLE)
    for part in parts():
        among = part[(part > bounds[0]) & (part < bounds[1])] if np.isfinite(bounds).any() else part
        # a copy: a slice would keep the whole chunk
        sampled.append(
            (among[among.size % every // 2 :: every] if among.size > every else among[:1]).copy()
        )
    return quantile_bracket(np.concatenate(sampled), share)


def _count_and_collect(
    parts: Callable[[], Iterable[Array]], first: float, last: float
) -> tuple[tuple[int, int, int, int], Array | None]:
    """Numbers of values < first, ≤ first, < last and ≤ last, and the values between both unless
    they are too many to hold.
    """
    counts = np.zeros(4, dtype=np.int64)
    kept: list[Array] = []
    held = 0
    for part in parts():
        above, under = part > first, part < last
        between = part[above & under]
        up_to, less = part.size - np.count_nonzero(above), np.count_nonzero(under)
        counts += (
            np.count_nonzero(part < first),
            up_to,
            max(less, up_to),
            np.count_nonzero(part <= last),
        )
        held += between.size
        if held <= COLLECTED:
            kept.append(between)
    a, b, c, d = counts.tolist()
    return (a, b, c, d), np.concatenate(kept) if held <= COLLECTED else None

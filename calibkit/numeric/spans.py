"""Long columns, a span of rows at a time: in a processor's cache, and in bounded memory where a
column lies on disk.

What is computed along a column is computed over the same spans wherever the column lies, so that
the numbers are the same.
"""

from __future__ import annotations

import math
import mmap
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from numpy.typing import NDArray

    from calibkit.arrays import Array, Integers, Mask


ROWS = 1 << 17
"""Rows of a span: a few columns of them stay in a cache."""
KEPT = 1 << 19
"""Values that a search for order statistics holds at once."""
CACHED = 1 << 15
"""Values that are gone over several times while they stay in a processor's nearest cache."""
SAMPLE = 1 << 13
"""Values from which such a search guesses where to look."""


def over(size: int, rows: int = 0) -> Iterator[tuple[int, int]]:
    """First row and row after the last of consecutive spans of so many rows."""
    step = rows or ROWS
    for start in range(0, size, step):
        yield start, min(start + step, size)


def along(*columns: NDArray[np.generic], rows: int = 0) -> Iterator[tuple[int, int]]:
    """First row and row after the last of consecutive spans of columns [n]; pages of a span are let
    go behind it.
    """
    for start, stop in over(columns[0].shape[0], rows):
        yield start, stop
        release(*columns)


def series(values: Array) -> Callable[[int, int], Array]:
    """Rows first … stop − 1 of values [n, ...] when they are asked for; pages of those before are
    let go.
    """

    def between(first: int, stop: int) -> Array:
        release(values)
        return values[first:stop]

    return between


def taken(column: Array, part: slice) -> Array:
    """Values of a column [n] in a slice of its rows; where it skips some, of a file no more than a
    span is in memory.
    """
    if part.step in {None, 1}:
        return column[part]
    whole = column[part.start : part.stop]
    # copies: views would keep what they are views of
    return np.concatenate(
        [whole[a + -a % part.step : b : part.step].copy() for a, b in along(whole)]
    )


def release(*columns: NDArray[np.generic]) -> None:
    """Let go of the pages that memory-mapped columns hold in memory; nothing for columns that are
    in memory.
    """
    for column in columns:
        mapped = _mapping(column)
        if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
            mapped.madvise(mmap.MADV_DONTNEED)


def _mapping(column: NDArray[np.generic]) -> mmap.mmap | None:
    """The mapped file that a column lies in; none for one in memory."""
    base: object = column
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    return base if isinstance(base, mmap.mmap) else None


def at(values: Array, rows: Integers) -> Array:
    """Values [...] of a column [n] at rows [...] that ascend but for neighbours: of a file, those
    of a span at a time.

    A page that is looked at brings up to a megabyte of others with it.
    """
    if _mapping(values) is None:
        return values[rows]
    found, flat = np.empty(rows.size), rows.ravel()
    for part in np.split(np.arange(flat.size), np.flatnonzero(np.diff(flat // ROWS)) + 1):
        found[part] = values[flat[part]]
        release(values)
    return found.reshape(rows.shape)


def finite(values: Array) -> bool:
    """Whether all values [n] are finite: a sum is finite only where every term is, and costs a
    tenth of looking at each.
    """
    with np.errstate(all="ignore"):
        total = sum(float(np.sum(values[a:b])) for a, b in along(values))
    # the sum of large values may overflow by itself
    return math.isfinite(total) or all(np.isfinite(values[a:b]).all() for a, b in along(values))


def changes(values: NDArray[np.generic], before: float) -> Integers:
    """Rows at which values [n] differ from the one before them, which for the first is `before`."""
    changed = np.empty(values.size, dtype=np.bool_)
    changed[:1] = values[:1] != before
    np.not_equal(values[1:], values[:-1], out=changed[1:])
    return np.flatnonzero(changed)


def extremes(values: Array) -> tuple[float, float]:
    """Smallest and largest of values [n], both not a number where one of them is not; not a number
    where there is none.
    """
    if not values.size:
        return float("nan"), float("nan")
    ends = [(np.min(values[a:b]), np.max(values[a:b])) for a, b in along(values, rows=CACHED)]
    low, high = np.array(ends).T
    return float(np.min(low)), float(np.max(high))


def medians(rows: Array) -> Array:
    """Median of each row [m] of values [m, n]: that of `np.median`. The values must be finite."""
    count, size = rows.shape
    step = max(1, ROWS // size)
    parts = (np.partition(rows[k : k + step], size // 2, axis=1) for k in range(0, count, step))
    return np.concatenate([_halfway(part, size) for part in parts])


def _halfway(parted: Array, size: int) -> Array:
    """Median along the last axis of values that are parted at half their number.

    One element is put in its place and the other of the middle two looked for below it: numpy's
    selection of a single element is vectorised, that of two is not and takes five times as long.
    """
    upper = parted[..., size // 2]
    return upper if size % 2 else np.asarray((parted[..., : size // 2].max(axis=-1) + upper) / 2.0)


def total(values: Array) -> float:
    """Sum of values [n]."""
    return sum(float(np.sum(values[a:b])) for a, b in along(values))


def mean(values: Array) -> float:
    """Mean of values [n]."""
    return total(values) / values.size


def deviation(values: Array) -> float:
    """Standard deviation of values [n] about their mean, of the values themselves (divided by
    n).
    """
    middle = mean(values)
    return float(
        np.sqrt(
            sum(float(np.sum((values[a:b] - middle) ** 2)) for a, b in along(values)) / values.size
        )
    )


def correlation(one: Array, other: Array) -> float:
    """Correlation coefficient of two series [n], neither of them constant."""
    middle = mean(one), mean(other)
    sums = np.zeros((2, 2))
    for a, b in along(one, other):
        part = np.stack((one[a:b] - middle[0], other[a:b] - middle[1]))
        sums += part @ part.T
    return float(sums[0, 1] / np.sqrt(sums[0, 0] * sums[1, 1]))


def count(values: Array, chosen: Callable[[Array], Mask]) -> int:
    """How many values of a column [n] are chosen."""
    return sum(int(np.count_nonzero(chosen(values[a:b]))) for a, b in along(values))


def where(values: Array, chosen: Callable[[Array], Mask], *, step: bool = False) -> Integers:
    """Rows [m] of a column [n] whose value is chosen; with `step`, those whose step to the next row
    is.
    """
    found = []
    for start, stop in along(values):
        part = np.diff(values[start : stop + 1]) if step else values[start:stop]
        found.append(np.flatnonzero(chosen(part)) + start)
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)


def quantile(values: Array, share: float) -> float:
    """Quantile of values [n] by linear interpolation: that of `np.quantile`, by one element put in
    its place, as `medians`.
    """
    at = (values.size - 1) * share
    before, behind = int(at), min(int(at) + 1, values.size - 1)
    parted = np.partition(values, behind)
    if np.isnan(parted[behind:].max()):
        return float("nan")
    low, high = float(parted[: before + 1].max()), float(parted[behind])
    beyond = at - before
    return low + (high - low) * beyond if beyond < 0.5 else high - (high - low) * (1.0 - beyond)


def median(values: Array) -> float:
    """Median of values [n] in any order: that of `np.median`, in bounded memory."""
    return middle(lambda: (values[a:b] for a, b in along(values)), values.size)


def likely(sample: Array, share: float = 0.5) -> tuple[float, float]:
    """Two values of a sample [n] that the given share of what it was drawn from, the half for a
    median, is likely between.
    """
    ordered = np.sort(sample)
    reach = 4.0 * np.sqrt(share * (1.0 - share) / ordered.size) + 2.0 / ordered.size
    at = np.clip(
        [(share - reach) * ordered.size, (share + reach) * ordered.size], 0, ordered.size - 1
    ).astype(np.int64)
    return float(ordered[at[0]]), float(ordered[at[1]])


def middle(
    parts: Callable[[], Iterable[Array]], count: int, bracket: tuple[float, float] | None = None
) -> float:
    """Median of `count` values that come in parts, as often as they are asked for; the same number
    as from all of them at once.

    `bracket` are two values that it is likely between; without one the parts are asked for once
    more. NaN where there is no value. The values must be finite.
    """
    if count == 0:
        return float("nan")
    if count <= KEPT and bracket is None:
        whole = np.concatenate(list(parts()))
        whole.partition(count // 2)  # puts what is not a number behind all else
        return (
            float(_halfway(whole, count))
            if not np.isnan(whole[count // 2 :].max())
            else float("nan")
        )
    low, high = _ranked(parts, ((count - 1) // 2, count // 2), count, bracket)
    return (low + high) / 2.0


def quantile_of(parts: Callable[[], Iterable[Array]], count: int, share: float) -> float:
    """Quantile of `count` finite values that come in parts, as often as they are asked for: that of
    `np.quantile`.
    """
    if count <= KEPT:
        return quantile(np.concatenate(list(parts())), share)
    at = share * (count - 1)
    low, high = _ranked(parts, (int(at), min(int(at) + 1, count - 1)), count)
    t = at - int(at)
    # from the nearer end, as numpy does
    return high - (high - low) * (1.0 - t) if t >= 0.5 else low + (high - low) * t


def runs(size: int, chosen: Callable[[int, int], Mask]) -> list[tuple[int, int]]:
    """First and one past the last of each run of rows that are chosen among so many; asked for a
    span after the other.
    """
    found: list[tuple[int, int]] = []
    for start, stop in over(size):
        edges = (
            np.flatnonzero(np.diff(np.concatenate(([0], chosen(start, stop).astype(np.int8), [0]))))
            + start
        )
        for first, end in edges.reshape(-1, 2).tolist():
            goes_on = bool(found) and found[-1][1] == first
            found[-1 if goes_on else len(found) :] = [(found[-1][0] if goes_on else first, end)]
    return found


def _ranked(
    parts: Callable[[], Iterable[Array]],
    ranks: tuple[int, int],
    count: int,
    bracket: tuple[float, float] | None = None,
) -> tuple[float, float]:
    """The values of two ranks (from 0, neighbours or one) among all: a bracket about them is
    guessed, counted, narrowed.
    """
    low, high, below, inside = -np.inf, np.inf, 0, count
    while True:
        first, last = bracket or _guess(
            parts, (low, high), (sum(ranks) / 2.0 - below) / inside, inside
        )
        bracket = None
        counts, kept = _counted(parts, first, last)
        cell = np.searchsorted(counts, ranks, side="right")
        if cell[0] != cell[1]:  # two neighbours on both sides of a bound
            return (
                _ranked(parts, (ranks[0],) * 2, count)[0],
                _ranked(parts, (ranks[1],) * 2, count)[0],
            )
        if cell[0] in {1, 3}:
            return (first,) * 2 if cell[0] == 1 else (last,) * 2
        if cell[0] == 2 and kept is not None:
            first_at, last_at = (rank - counts[1] for rank in ranks)
            kept.partition(last_at)
            upper = float(kept[last_at])
            return (upper if first_at == last_at else float(kept[:last_at].max())), upper
        edges = (below, *counts, below + inside)
        low, high = {0: (low, first), 2: (first, last), 4: (last, high)}[int(cell[0])]
        below, inside = edges[cell[0]], edges[cell[0] + 1] - edges[cell[0]]


def _guess(
    parts: Callable[[], Iterable[Array]], bounds: tuple[float, float], share: float, inside: int
) -> tuple[float, float]:
    """Two values strictly between bounds, that the given share of what lies between them is likely
    between too.
    """
    seen: list[Array] = []
    every = max(1, inside // SAMPLE)
    for part in parts():
        among = part[(part > bounds[0]) & (part < bounds[1])] if np.isfinite(bounds).any() else part
        # a copy: a slice would keep the whole part
        seen.append(
            (among[among.size % every // 2 :: every] if among.size > every else among[:1]).copy()
        )
    return likely(np.concatenate(seen), share)


def _counted(
    parts: Callable[[], Iterable[Array]], first: float, last: float
) -> tuple[tuple[int, int, int, int], Array | None]:
    """How many values are below and up to each of two, and those between them where they are not
    too many to hold.
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
        if held <= KEPT:
            kept.append(between)
    a, b, c, d = counts.tolist()
    return (a, b, c, d), np.concatenate(kept) if held <= KEPT else None

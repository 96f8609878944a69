"""Processing of long columns in chunks of rows that fit in a processor's cache, and in bounded
memory for columns on disk.

A column in memory and one on disk are processed in the same chunks, so that results are identical.
"""

import math
import mmap
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from calibkit.arrays import Array, Integers, Mask

ROWS = 1 << 17
"""Rows of a chunk: a few columns of this length fit in a cache."""
CACHED_ROWS = 1 << 15
"""Rows of a chunk that is read several times: it fits in a processor's nearest cache."""


def ranges(size: int, rows: int = 0) -> Iterator[tuple[int, int]]:
    """First row and row after the last of consecutive chunks of `rows` rows, ROWS by default."""
    step = rows or ROWS
    for start in range(0, size, step):
        yield start, min(start + step, size)


def ranges_along(*columns: NDArray[np.generic], rows: int = 0) -> Iterator[tuple[int, int]]:
    """First row and row after the last of consecutive chunks of columns [n]; the memory pages of
    each chunk are released after it.
    """
    for start, stop in ranges(columns[0].shape[0], rows):
        yield start, stop
        release(*columns)


def row_reader(values: Array) -> Callable[[int, int], Array]:
    """Function that reads rows first … stop − 1 of values [n, ...] and first releases the pages of
    earlier rows.
    """

    def read(first: int, stop: int) -> Array:
        release(values)
        return values[first:stop]

    return read


def take_slice(column: Array, part: slice) -> Array:
    """Values of a column [n] in a slice of its rows; a slice with a step holds at most one chunk of
    a file in memory.
    """
    if part.step in {None, 1}:
        return column[part]
    rows_of_slice = column[part.start : part.stop]
    # copies, as views would keep the whole column in memory
    return np.concatenate(
        [
            rows_of_slice[a + -a % part.step : b : part.step].copy()
            for a, b in ranges_along(rows_of_slice)
        ]
    )


def take_rows(values: Array, rows: Integers) -> Array:
    """Values [...] of a column [n] at rows [...] in approximately ascending order; a file is read
    chunk by chunk.

    Reading one page of a file loads up to a megabyte of pages around it.
    """
    if _mapped_file(values) is None:
        return values[rows]
    rows_taken, flat = np.empty(rows.size), rows.ravel()
    for part in np.split(np.arange(flat.size), np.flatnonzero(np.diff(flat // ROWS)) + 1):
        rows_taken[part] = values[flat[part]]
        release(values)
    return rows_taken.reshape(rows.shape)


def release(*columns: NDArray[np.generic]) -> None:
    """Release the memory pages of memory-mapped columns; columns in memory are left as they are."""
    for column in columns:
        mapped = _mapped_file(column)
        if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
            mapped.madvise(mmap.MADV_DONTNEED)


def _mapped_file(column: NDArray[np.generic]) -> mmap.mmap | None:
    """The mapped file that a column lies in; None for one in memory."""
    base: object = column
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    return base if isinstance(base, mmap.mmap) else None


def all_finite(values: Array) -> bool:
    """Whether all values [n] are finite, tested by their sum, which takes a tenth of the time of
    testing each.
    """
    with np.errstate(all="ignore"):
        total = sum(float(np.sum(values[a:b])) for a, b in ranges_along(values))
    # the sum of large values may overflow by itself
    return math.isfinite(total) or all(
        np.isfinite(values[a:b]).all() for a, b in ranges_along(values)
    )


def extremes(values: Array) -> tuple[float, float]:
    """Smallest and largest of values [n]; NaN if a value is NaN or if there is no value."""
    if not values.size:
        return float("nan"), float("nan")
    ends = [
        (np.min(values[a:b]), np.max(values[a:b]))
        for a, b in ranges_along(values, rows=CACHED_ROWS)
    ]
    low, high = np.array(ends).T
    return float(np.min(low)), float(np.max(high))


def extremes_of_present(values: Array) -> tuple[float, float]:
    """Smallest and largest of those values [n] that are not NaN; NaN if there is none."""
    ends = [
        (np.fmin.reduce(values[a:b]), np.fmax.reduce(values[a:b])) for a, b in ranges_along(values)
    ]
    low = np.fmin.reduce([low for low, _ in ends], initial=np.nan)
    high = np.fmax.reduce([high for _, high in ends], initial=np.nan)
    return float(low), float(high)


def mean(values: Array) -> float:
    """Mean of values [n]."""
    return sum(float(np.sum(values[a:b])) for a, b in ranges_along(values)) / values.size


def block_means(values: Array, rows: int) -> Array:
    """Means [n // rows] of consecutive blocks of so many rows of values [n]; NaN where a block has
    one.
    """
    rows_per_chunk = max(ROWS // rows, 1) * rows
    complete_blocks = values[: values.size // rows * rows]
    means = [
        complete_blocks[a:b].reshape(-1, rows).mean(axis=1)
        for a, b in ranges_along(complete_blocks, rows=rows_per_chunk)
    ]
    return np.concatenate(means) if means else np.zeros(0)


def count(values: Array, condition: Callable[[Array], Mask]) -> int:
    """Number of values of a column [n] for which the condition holds."""
    return sum(int(np.count_nonzero(condition(values[a:b]))) for a, b in ranges_along(values))


def rows_where(
    values: Array, condition: Callable[[Array], Mask], *, step: bool = False
) -> Integers:
    """Rows [m] of a column [n] for whose values the condition holds; with `step`, for whose steps
    to the next row it does.
    """
    rows = []
    for start, stop in ranges_along(values):
        part = np.diff(values[start : stop + 1]) if step else values[start:stop]
        rows.append(np.flatnonzero(condition(part)) + start)
    return np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)


def changed_rows(values: NDArray[np.generic], before: float) -> Integers:
    """Rows at which values [n] differ from the value before; `before` precedes the first one."""
    changed = np.empty(values.size, dtype=np.bool_)
    changed[:1] = values[:1] != before
    np.not_equal(values[1:], values[:-1], out=changed[1:])
    return np.flatnonzero(changed)


def find_runs(size: int, condition: Callable[[int, int], Mask]) -> Integers:
    """First row and row after the last [m, 2] of each run of rows that meet a condition, among
    `size`; `condition` returns the mask of the rows first … stop − 1.
    """
    edges, inside = [np.zeros(0, dtype=np.int64)], False
    for start, stop in ranges(size):
        mask = condition(start, stop)
        edges.append(changed_rows(mask, inside) + start)
        inside = bool(mask[-1])
    last = [np.array([size])] if inside else []
    return np.concatenate([*edges, *last]).reshape(-1, 2)

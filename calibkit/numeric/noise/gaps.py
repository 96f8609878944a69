"""Gaps of a record, and filters along it whose windows touch none."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import chunks

BLOCK = 1 << 13
"""Samples worked on at once: they stay in a core's cache, and a dot product of them is not shared
out to threads.
"""


@dataclass(frozen=True, slots=True)
class Gaps:
    """Gaps of a record of `samples` values: first sample and sample after the last [g, 2] of
    each.
    """

    samples: int
    runs: Integers

    @classmethod
    def find(cls, rate: Array) -> Self:
        """Gaps of a rate [n], in which NaN is missing."""
        return cls(rate.size, chunks.find_runs(np.isnan(rate)))

    @property
    def missing(self) -> int:
        """Number of samples that are missing."""
        return int(np.sum(self.runs[:, 1] - self.runs[:, 0]))

    def lengths_between(self) -> Integers:
        """Lengths [k] of the runs that hold no gap; a single 0 when there is none."""
        lengths = np.diff(self.runs.ravel(), prepend=0, append=self.samples)[::2]
        return lengths[lengths > 0] if lengths.any() else np.zeros(1, dtype=np.int64)

    def closed_to(self, length: int) -> Integers:
        """First place and place after the last [h, 2] of the windows of so many samples that touch
        a gap, by the window's first sample.
        """
        first, stop = self.runs[:, 0] - length + 1, self.runs[:, 1]
        begins_range = np.ones(len(self.runs) + 1, dtype=np.bool_)
        begins_range[1:-1] = first[1:] > stop[:-1]
        return np.column_stack([first[begins_range[:-1]], stop[begins_range[1:]]])


def filtered(values: Array, taps: Sequence[float], tap_spacing: int) -> Iterator[tuple[int, Array]]:
    """First place i and Σ_k taps_k values[i + k · tap_spacing] of consecutive blocks of places."""
    for a, b in chunks.ranges(values.size - (len(taps) - 1) * tap_spacing, BLOCK):
        total: Array = taps[0] * values[a:b]
        for k, tap in enumerate(taps[1:], start=1):
            total += tap * values[a + k * tap_spacing : b + k * tap_spacing]
        yield a, total


def square_beside_gaps(blocks: Iterable[tuple[int, Array]], closed: Integers) -> tuple[float, int]:
    """Sum of squares and number of the values of blocks, each with its first place, whose places
    are in none of the ranges [h, 2].
    """
    square, count = 0.0, 0
    for start, block in blocks:
        closed_ranges = closed[
            np.searchsorted(closed[:, 1], start, side="right") : np.searchsorted(
                closed[:, 0], start + block.size
            )
        ]
        open_values = block
        if len(closed_ranges):
            steps = np.zeros(block.size + 1, dtype=np.int8)
            ends = np.clip(closed_ranges - start, 0, block.size)
            steps[ends[:, 0]] += 1
            steps[ends[:, 1]] -= 1
            open_values = block[np.cumsum(steps[:-1], dtype=np.int8) == 0]
        square += float(open_values @ open_values)
        count += open_values.size
    return square, count

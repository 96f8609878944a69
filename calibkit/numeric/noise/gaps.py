"""Gaps of a record, and the windows along it that touch one."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.numeric import chunks


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

        def missing(first: int, stop: int) -> Mask:
            found = np.isnan(rate[first:stop])
            chunks.release(rate)
            return found

        return cls(rate.size, chunks.find_runs(rate.size, missing))

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
        alone = np.ones(len(self.runs) + 1, dtype=np.bool_)
        alone[1:-1] = first[1:] > stop[:-1]
        return np.column_stack([first[alone[:-1]], stop[alone[1:]]])


def open_places(closed: Integers, start: int, stop: int) -> Mask | None:
    """Which of the places start … stop − 1 are in none of the ranges [h, 2]; None where all are
    open.
    """
    near = closed[
        np.searchsorted(closed[:, 1], start, side="right") : np.searchsorted(closed[:, 0], stop)
    ]
    if not len(near):
        return None
    steps = np.zeros(stop - start + 1, dtype=np.int8)
    ends = np.clip(near, start, stop) - start
    steps[ends[:, 0]] += 1
    steps[ends[:, 1]] -= 1
    return np.asarray(np.cumsum(steps[:-1], dtype=np.int8) == 0, dtype=np.bool_)

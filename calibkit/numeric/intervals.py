"""Model intervals of a log: which rows fall into which, and means over them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.errors import FitError
from calibkit.numeric import chunks, order_statistics


@dataclass(frozen=True, slots=True)
class Intervals:
    """Those intervals of a log of `rows` samples that hold one: their numbers [m], first samples
    [m] and counts [m].

    The log begins at `begin` [s]; `length_s` is what an interval lasts [s], `step_s` the usual
    sampling interval [s].
    """

    number: Integers
    first: Integers
    count: Integers
    rows: int
    begin: float
    length_s: float
    step_s: float

    @property
    def well_filled(self) -> Mask:
        """Those intervals [m] that hold at least half of the usual number of samples."""
        return np.asarray(self.count >= 0.5 * np.median(self.count))

    @property
    def is_complete(self) -> bool:
        """Whether no interval is empty or cut short."""
        return bool(self.well_filled.all()) and self.number.size == self.number[-1] + 1

    def groups(self) -> Iterator[tuple[slice, slice]]:
        """Consecutive intervals whose rows make up a chunk, and these rows."""
        cuts = np.unique(
            np.searchsorted(self.first, [*range(0, self.rows, chunks.ROWS), self.rows])
        )
        rows = np.append(self.first, self.rows)[cuts].tolist()
        for a, b, start, stop in zip(
            cuts[:-1].tolist(), cuts[1:].tolist(), rows[:-1], rows[1:], strict=True
        ):
            yield slice(a, b), slice(start, stop)

    def means(self, values: Array, *, origin: float = 0.0) -> Array:
        """Mean [m] of values [rows] over each interval, above an origin."""
        sums = np.empty(self.first.size)
        for intervals, rows in self.groups():
            part = values[rows] - origin if origin else values[rows]
            sums[intervals] = np.add.reduceat(part, self.first[intervals] - rows.start)
            chunks.release(values)
        return sums / self.count

    def last(self, values: Array) -> Array:
        """Last of the values [rows] of each interval: [m]."""
        ends = np.empty(self.first.size)
        for group_slice, _ in self.groups():
            ends[group_slice] = values[self.first[group_slice] + self.count[group_slice] - 1]
            chunks.release(values)
        return ends

    def filled(self, means: Array) -> Array:
        """Values of all intervals from those [m] of the ones that hold samples: straight lines
        across the empty and cut short.
        """
        if self.is_complete:
            return means
        return np.interp(
            np.arange(self.number[-1] + 1), self.number[self.well_filled], means[self.well_filled]
        )

    def centres(self, means: Array) -> Array:
        """Centres [s] of all intervals from the mean times [m, s]; that of an interval that is cut
        short is still its centre.
        """
        if self.is_complete:
            return means
        return np.asarray(
            self.begin + (np.arange(self.number[-1] + 1) + 0.5) * self.length_s - 0.5 * self.step_s
        )

    def of_row(self, row: int) -> int:
        """Number of the interval that a row falls in."""
        return int(self.number[np.searchsorted(self.first, row, side="right") - 1])

    @classmethod
    def find(cls, time: Array, length_s: float, step_s: float | None = None) -> Self:
        """Intervals of a log from its time [n, s]; half a sample of jitter moves nothing.

        `step_s` is the log's sampling interval, where it is known already. Raises FitError when the
        log is sampled more slowly than the interval, because coefficients are per interval.
        """
        step = Steps.find(time).usual if step_s is None else step_s
        if step > length_s * 1.01:
            raise FitError(
                f"sampled every {step:g} s, the model interval is {length_s:g} s",
                hint=(
                    "the coefficients are per interval: use a log that is sampled at least that"
                    " fast, or fit with that interval"
                ),
            )
        first: list[Integers] = []
        number: list[Integers] = []
        last = -1.0
        for start, stop in chunks.ranges_along(time):
            interval_of_row = time[start:stop] - float(time[0])
            interval_of_row /= length_s
            interval_of_row += 0.5 * min(step / length_s, 1.0)
            np.floor(interval_of_row, out=interval_of_row)
            new = chunks.changed_rows(interval_of_row, last)
            first.append(new + start)
            number.append(interval_of_row[new].astype(np.int64))
            last = float(interval_of_row[-1])
        begins = np.concatenate(first)
        count = np.diff(np.append(begins, time.size))
        return cls(np.concatenate(number), begins, count, time.size, float(time[0]), length_s, step)


@dataclass(frozen=True, slots=True)
class Steps:
    """Shortest, longest and median step [s] of a log's time; not a number where it has less than
    two rows.
    """

    shortest: float
    longest: float
    usual: float

    @classmethod
    def find(cls, time: Array) -> Self:
        """Steps of a log's time [n, s], which must be finite."""
        ends = [(step.min(), step.max()) for step in _steps(time) if step.size]
        if not ends:
            return cls(*(float("nan"),) * 3)
        low, high = np.array(ends).T
        usual = order_statistics.median_of_chunks(lambda: _steps(time), time.size - 1)
        return cls(float(low.min()), float(high.max()), usual)


def _steps(time: Array) -> Iterator[Array]:
    """Steps of a time [n], one chunk of rows after the other."""
    return (np.diff(time[max(a - 1, 0) : b]) for a, b in chunks.ranges_along(time))

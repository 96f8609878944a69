"""Model intervals of a log: which rows fall into which, and means over them."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array, Integers, Mask


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

    def means(self, values: Array, *, origin: float = 0.0) -> Array:
        """Mean [m] of values [rows] over each interval, above an origin."""
        above = values - origin if origin else values
        return np.asarray(np.add.reduceat(above, self.first) / self.count)

    def last(self, values: Array) -> Array:
        """Last of the values [rows] of each interval: [m]."""
        return np.asarray(values[self.first + self.count - 1])

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
        # each begins half a sample before its first one is due
        ahead, begin = 0.5 * min(step / length_s, 1.0), float(time[0])
        number = np.arange(int((float(time[-1]) - begin) / length_s + ahead) + 1)
        first = np.searchsorted(time, begin + (number - ahead) * length_s)
        count = np.diff(np.append(first, time.size))
        held = count > 0
        return cls(number[held], first[held], count[held], time.size, begin, length_s, step)


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
        # sorted: where most are equal, a search for the median takes longer
        steps = np.sort(np.diff(time))
        if not steps.size:
            return cls(*(float("nan"),) * 3)
        middle = (steps[(steps.size - 1) // 2] + steps[steps.size // 2]) / 2.0
        return cls(float(steps[0]), float(steps[-1]), float(middle))

"""Temperatures of campaigns, and their order."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.least_squares import polynomial

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from calibkit.arrays import Array

LEVELS = 25
"""Temperatures of use at which an uncertainty is predicted."""
USUAL_LEVELS = 9
"""Temperatures of a usual campaign."""
MOST_ADDED = 3
"""Temperatures that are added to what is measured, of which every choice is tried."""
ONE_LEVEL_DEGC = 5.0
"""Temperatures nearer than this are one of a campaign."""

Tour = tuple[int, ...]
"""Temperatures [°C] in the order in which they are gone to."""


def list_tours(
    order: int,
    more: int,
    range_degc: tuple[float, float],
    tours_of: Callable[[list[int]], Iterable[Tour]],
) -> dict[str, list[Tour]]:
    """Number of temperatures in words → tours of so many that no smaller number has, from one more
    temperature than an order needs to `more` beyond it; `tours_of` are those of the temperatures,
    lowest first, at which a polynomial is determined best.
    """
    low, high = np.ceil(range_degc[0]), np.floor(range_degc[1])
    tours: dict[str, list[Tour]] = {}
    seen: set[Tour] = set()
    for size in range(order + 2, order + 2 + more + 1):
        listed = dict.fromkeys(tours_of(polynomial.space_levels(low, high, size)))
        tours[f"{size} temperatures"] = [tour for tour in listed if tour not in seen]
        seen |= listed.keys()
    return tours


def list_usual_levels(range_degc: tuple[float, float]) -> Tour:
    """Temperatures of a usual campaign, from low to high."""
    return tuple(np.rint(np.linspace(*range_degc, USUAL_LEVELS)).astype(int).tolist())


def choose_some(levels: Sequence[int]) -> Iterator[Tour]:
    """Every choice of temperatures that may be added to what is measured."""
    for number in range(1, min(len(levels), MOST_ADDED) + 1):
        yield from combinations(levels, number)


def order_there_and_back(levels: Sequence[int]) -> Tour:
    """Temperatures, lowest first, in the order of a campaign: every second one on the way back to
    the first, so that drift is separated from temperature on a way that is no longer.
    """
    return (*levels[::2], *levels[1::2][::-1], levels[0])


def cover_range(
    temperatures: Iterable[float], fewest: int, range_degc: tuple[float, float]
) -> bool:
    """Whether temperatures [°C] reach both ends of a range of use, and at least so many differ."""
    found = np.sort(np.fromiter(temperatures, dtype=np.float64))
    ends = np.array(range_degc) + np.array([1.0, -1.0]) * ONE_LEVEL_DEGC
    reached = found.size and found[0] <= ends[0] and found[-1] >= ends[1]
    return bool(reached and 1 + np.sum(np.diff(found) > ONE_LEVEL_DEGC) >= fewest)


def raw_uncertainties(covariance: Array, range_degc: tuple[float, float]) -> list[float]:
    """Standard uncertainties of the coefficients of a polynomial in powers of °C, from their
    covariance for the temperature mapped from a range to [-1, 1].
    """
    zeros = np.zeros(len(covariance))
    middle_half = polynomial.middle_and_half(np.array(range_degc))
    to_raw = polynomial.to_raw_powers(*middle_half, len(zeros) - 1)
    raw = polynomial.in_raw_powers(zeros, covariance, to_raw)[1]
    return [float(u) for u in np.sqrt(np.diag(raw))]

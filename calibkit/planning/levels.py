"""Temperatures of campaigns, and their order.

A polynomial of order n in temperature is determined best at the extremes of the Chebyshev
polynomial T_m, m > n: x_k = cos(π k/m), mapped to the range (`polynomial.space_levels`).
"""

from collections.abc import Iterable
from itertools import combinations

import numpy as np

from calibkit.numeric.least_squares import polynomial

LEVELS = 25
"""Temperatures of use at which an uncertainty is predicted."""
MORE_LEVELS = 4
"""Temperatures of a campaign at most beyond one more than the order needs."""
MOST_ADDED = 3
"""Temperatures that are added to what is measured, of which every choice is tried."""
ONE_LEVEL_DEGC = 5.0
"""Temperatures nearer than this are one of a campaign."""

Tour = tuple[int, ...]
"""Temperatures [°C] in the order in which they are gone to."""


def list_tours(
    order: int, range_degc: tuple[float, float], *, subsets: bool, reference: float | None = None
) -> list[Tour]:
    """Tours of the temperatures at which a polynomial is determined best, the extremes of Chebyshev
    polynomials: of one more temperature than an order needs first, then of more; with `subsets`
    also every choice of those of the first tour, for what is measured already may have the others.

    A reference temperature takes the place of the nearest one between the ends of the range. Where
    both ends are one temperature, that is the campaign.
    """
    if range_degc[0] == range_degc[1]:
        return [(round(range_degc[0]),)]
    low, high = np.ceil(range_degc[0]), np.floor(range_degc[1])
    tours: list[Tour] = []
    for size in range(order + 2, order + 3 + MORE_LEVELS):
        levels = polynomial.space_levels(low, high, size)
        if reference is not None and low < round(reference) < high:
            inner = range(1, size - 1)
            nearest = min(inner, key=lambda k: abs(levels[k] - round(reference)))
            levels[nearest] = round(reference)
        # every second one on the way back: as long as straight there and back, and drift is
        # separated from temperature
        tours.append((*levels[::2], *levels[1::2][::-1], levels[0]))
    if subsets:
        first = tours[0][:-1]
        for number in range(1, min(len(first), MOST_ADDED) + 1):
            tours += combinations(first, number)
    return tours


def cover_range(
    temperatures: Iterable[float], fewest: int, range_degc: tuple[float, float]
) -> bool:
    """Whether temperatures [°C] reach both ends of a range of use, and at least so many differ, of
    a campaign at one temperature one.
    """
    if range_degc[1] - range_degc[0] <= ONE_LEVEL_DEGC:
        fewest = 1
    degc = np.sort(np.fromiter(temperatures, dtype=np.float64))
    ends = np.array(range_degc) + np.array([1.0, -1.0]) * ONE_LEVEL_DEGC
    reached = degc.size and degc[0] <= ends[0] and degc[-1] >= ends[1]
    return bool(reached and 1 + np.sum(np.diff(degc) > ONE_LEVEL_DEGC) >= fewest)

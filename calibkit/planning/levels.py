"""Temperatures of campaigns, and their order."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.least_squares import polynomial

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibkit.arrays import Array
    from calibkit.planning.proposal import Task

LEVELS = 25
"""Temperatures of use at which an uncertainty is predicted."""
USUAL_LEVELS = 9
"""Temperatures of a usual campaign."""
MOST_ADDED = 3
"""Temperatures that are added to what is measured, of which every choice is tried."""


def list_levels(
    task: Task, order: int, more: int, range_degc: tuple[float, float]
) -> Iterator[list[int]]:
    """Temperatures of campaigns of all sizes, lowest first: from one more than an order needs, with
    progress.
    """
    low, high = np.ceil(range_degc[0]), np.floor(range_degc[1])
    sizes = range(order + 2, order + 2 + more + 1)
    labels = [f"{size} temperatures" for size in sizes]
    for size, _ in zip(sizes, task.progress(labels, "searching"), strict=True):
        yield polynomial.space_levels(low, high, size)


def list_usual_levels(range_degc: tuple[float, float]) -> tuple[int, ...]:
    """Temperatures of a usual campaign, from low to high."""
    return tuple(np.rint(np.linspace(*range_degc, USUAL_LEVELS)).astype(int).tolist())


def choose_some(levels: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Every choice of temperatures that may be added to what is measured."""
    for number in range(1, min(len(levels), MOST_ADDED) + 1):
        yield from combinations(levels, number)


def order_there_and_back(levels: Sequence[int]) -> tuple[int, ...]:
    """Temperatures, lowest first, in the order of a campaign: every second one on the way back to
    the first, so that drift is separated from temperature on a way that is no longer.
    """
    return (*levels[::2], *levels[1::2][::-1], levels[0])


def raw_uncertainties(covariance: Array, range_degc: tuple[float, float]) -> list[float]:
    """Standard uncertainties of the coefficients of a polynomial in powers of °C, from their
    covariance for the temperature mapped from a range to [-1, 1].
    """
    zeros = np.zeros(len(covariance))
    middle_half = polynomial.middle_and_half(np.array(range_degc))
    to_raw = polynomial.to_raw_powers(*middle_half, len(zeros) - 1)
    raw = polynomial.in_raw_powers(zeros, covariance, to_raw)[1]
    return [float(u) for u in np.sqrt(np.diag(raw))]

"""Polynomials by least squares: powers of an abscissa mapped to [−1, 1], reported in raw powers
too, and the order by the errors at left-out values.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from calibkit.errors import FitError
from calibkit.numeric import chunks, gum
from calibkit.numeric.arrays import Array

HIGHEST_ORDER = 3
"""Of the polynomials over temperature that are compared."""
ONE_LEVEL_DEGC = 5.0
"""Temperatures that differ by no more count as one: they do not determine a power of their own."""


def powers(abscissa: Array, order: int, *, middle: float = 0.0, half: float = 1.0) -> Array:
    """Powers 0 … order of (x − middle)/half of an abscissa [n] as columns [n, order + 1], each
    contiguous.
    """
    return np.asfortranarray(np.vander((abscissa - middle) / half, order + 1, increasing=True))


def mapped_powers(
    abscissa: Array, order: int, span: tuple[float, float] | None = None
) -> tuple[Callable[[slice], Array], NDArray[np.longdouble]]:
    """Columns [m, order + 1] of a slice of an abscissa [n] mapped to [−1, 1], and the way back as
    `to_raw_powers`. It is mapped from its own span, or from a wider one.

    Raises
    ------
    FitError : the abscissa is constant, as that of a static record.
    """
    low, high = span or chunks.extremes(abscissa)
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    if half == 0.0 and order > 0:
        raise FitError(
            f"the abscissa is constant at {middle:g}", hint="a polynomial needs it to vary"
        )
    half = half or 1.0

    def columns(part: slice) -> Array:
        return powers(abscissa[part], order, middle=middle, half=half)

    return columns, to_raw_powers(middle, half, order)


def in_raw_powers(
    coefficients: Array, covariance: Array, to_raw: NDArray[np.longdouble]
) -> tuple[Array, Array]:
    """Coefficients [p] and covariance [p, p] of mapped powers put into raw powers, the former in
    extended precision.
    """
    # powers of raw °C cancel by digits: 60³ against a mapped 1
    raw = np.asarray(to_raw @ coefficients.astype(np.longdouble), dtype=np.float64)
    return raw, gum.propagate(np.asarray(to_raw, dtype=np.float64), covariance)


def middle_and_half(abscissa: Array) -> tuple[float, float]:
    """Middle and half-width of an abscissa [n], which map it to u = (x − middle)/half in [−1,
    1].
    """
    low, high = chunks.extremes(abscissa)
    return (low + high) / 2.0, (high - low) / 2.0


def to_raw_powers(middle: float, half: float, order: int) -> NDArray[np.longdouble]:
    """Matrix [order + 1, order + 1] from coefficients of u = (x − middle)/half to coefficients of
    x, ascending powers.
    """
    # u = (x - middle)/half as a polynomial of x; its powers by convolution
    step = np.array([-middle / np.longdouble(half), 1.0 / np.longdouble(half)], dtype=np.longdouble)
    matrix = np.zeros((order + 1, order + 1), dtype=np.longdouble)
    power = np.ones(1, dtype=np.longdouble)
    for k in range(order + 1):
        matrix[: k + 1, k] = power
        power = np.convolve(power, step)
    return matrix


def count_levels(temp_degc: Array) -> int:
    """Number of temperatures [°C] among n, each more than `ONE_LEVEL_DEGC` above the one before:
    a polynomial has at most one power fewer.
    """
    levels: list[float] = []
    for degc in np.sort(temp_degc).tolist():
        if not levels or degc - levels[-1] > ONE_LEVEL_DEGC:
            levels.append(degc)
    return len(levels)


def space_levels(low: float, high: float, count: int) -> list[int]:
    """Whole temperatures [°C] where polynomials are best determined: Chebyshev extremes."""
    # near the D-optimal points of a polynomial of order count - 1
    turn = np.cos(np.pi * np.arange(count) / (count - 1)) if count > 1 else np.zeros(1)
    levels = np.rint((low + high) / 2.0 - (high - low) / 2.0 * turn).astype(int).tolist()
    return list(levels)

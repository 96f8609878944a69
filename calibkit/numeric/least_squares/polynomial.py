"""Polynomials by least squares: powers of an abscissa mapped to [−1, 1], reported in raw powers
too, and the order by the errors at left-out values.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric import chunks, gum
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import fit as least_squares, leave_out

HIGHEST_ORDER = 3
"""Of the polynomials over temperature that are compared."""


@dataclass(frozen=True, slots=True)
class TemperaturePolynomial:
    """p0 + p1 T + …, T in °C."""

    coefficients: Array
    """p0 … pn in raw powers of °C."""
    covariance: Array
    """[n + 1, n + 1], type A."""
    dof: int
    residual_rms: float
    valid_degc: tuple[float, float]

    def at(self, temp_degc: ArrayLike) -> tuple[Array, Array]:
        """Value and type A standard uncertainty at temperatures [n] [°C], which are clamped to the
        fitted range.
        """
        temperature = np.atleast_1d(np.asarray(temp_degc, dtype=np.float64))
        columns = powers(np.clip(temperature, *self.valid_degc), self.coefficients.size - 1)
        return columns @ self.coefficients, gum.uncertainty_along(columns, self.covariance)


def powers(abscissa: Array, order: int, *, middle: float = 0.0, half: float = 1.0) -> Array:
    """Powers 0 … order of (x − middle)/half of an abscissa [n] as columns [n, order + 1], each
    contiguous.
    """
    rows = np.empty((order + 1, abscissa.size))
    rows[0] = 1.0
    if order > 0:
        np.subtract(abscissa, middle, out=rows[1])
        if half != 1.0:
            rows[1] /= half
    for k in range(2, order + 1):
        np.multiply(rows[k - 1], rows[1], out=rows[k])
    return rows.T


def fit_polynomial(
    abscissa: Array, indication: Array, order: int, *, weights: Array | None = None
) -> tuple[least_squares.LinearFit, Array, Array]:
    """Fit a polynomial of the given order on the abscissa mapped to [−1, 1] and report it in raw
    powers too.

    Returns
    -------
    The fit in mapped powers, the raw coefficients [order + 1] (ascending powers of the abscissa in
    its own unit) and their covariance [order + 1, order + 1].
    """
    design, to_raw = mapped_powers(abscissa, order)
    names = [f"p{k}" for k in range(order + 1)]
    fit = least_squares.fit_tall(design, indication, weights) or least_squares.linear(
        design(slice(None)), indication, weights=weights, names=names
    )
    return (fit, *in_raw_powers(fit.coefficients, fit.covariance, to_raw))


def mapped_powers(
    abscissa: Array, order: int
) -> tuple[Callable[[slice], Array], NDArray[np.longdouble]]:
    """Columns [m, order + 1] of a slice of an abscissa [n] mapped to [−1, 1], and the way back as
    `to_raw_powers`.

    Raises
    ------
    FitError : the abscissa is constant, as that of a static record.
    """
    middle, half = middle_and_half(abscissa)
    if half == 0.0 and order > 0:
        raise FitError(
            f"the abscissa is constant at {middle:g}", hint="a polynomial needs it to vary"
        )
    half = half or 1.0

    def columns(part: slice) -> Array:
        mapped = powers(chunks.take_slice(abscissa, part), order, middle=middle, half=half)
        chunks.release(abscissa)
        return mapped

    return columns, to_raw_powers(middle, half, order)


def in_raw_powers(
    coefficients: Array, covariance: Array, to_raw: NDArray[np.longdouble]
) -> tuple[Array, Array]:
    """Coefficients [p] and covariance [p, p] of mapped powers put into raw powers, the former in
    extended precision.
    """
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
    step = np.array([-middle / np.longdouble(half), 1.0 / np.longdouble(half)], dtype=np.longdouble)
    matrix = np.zeros((order + 1, order + 1), dtype=np.longdouble)
    power = np.ones(1, dtype=np.longdouble)
    for k in range(order + 1):
        matrix[: k + 1, k] = power
        power = np.convolve(power, step)
    return matrix


@dataclass(frozen=True, slots=True)
class OrderChoice:
    """The chosen order of a polynomial, and the standard deviation that the choice adds to its
    values: the rms by which the other orders differ from it at the abscissae, each order by the
    weight that its errors at left-out values give it, (least error/its error)^n of n groups
    (pseudo-Bayesian model averaging, Yao and others 2018, Bayesian Analysis 13:917).
    """

    order: int
    spread: float


def choose_order(
    abscissa: Array,
    indication: Array,
    highest: int,
    *,
    margin: float = leave_out.MARGIN,
    weights: Array | None = None,
    groups: Array | None = None,
    count_dof: bool = False,
) -> OrderChoice:
    """Order from 0 to `highest` of the polynomial whose errors at left-out values have the least
    weighted rms; a higher order must lower it below `margin` times that of the best lower one.

    Parameters
    ----------
    abscissa, indication
        [n].
    weights
        [n], proportional to 1/variance of each value; equal when absent.
    groups
        [n], label of the group that each value is left out with; each by itself when absent.
    count_dof
        Whether errors count times Student's t of the values that an order leaves over.
    """
    middle, half = middle_and_half(abscissa)
    errors, values, count = [], [], abscissa.size if groups is None else np.unique(groups).size
    for order in range(highest + 1):
        design = powers(abscissa, order, middle=middle, half=half or 1.0)
        residuals = least_squares.linear(design, indication, weights=weights).residuals
        left = leave_out.left_out_errors(design, residuals, weights=weights, groups=groups)
        values.append(indication - residuals)
        few = gum.widening(max(count - order - 1, 1)) if count_dof else 1.0
        errors.append(few * rms(left if weights is None else left * np.sqrt(weights)))
    chosen = leave_out.choose_simplest(errors, margin)
    if not np.isfinite(least := min(errors, default=np.inf)):
        return OrderChoice(chosen, 0.0)
    shares = np.array([1.0 if one == least else (least / one) ** count for one in errors])
    apart = [float(np.mean((other - values[chosen]) ** 2)) for other in values]
    return OrderChoice(chosen, float(np.sqrt(shares @ apart / shares.sum())))


def space_levels(low: float, high: float, count: int) -> list[int]:
    """Whole temperatures [°C] where polynomials are best determined: Chebyshev extremes."""
    turn = np.cos(np.pi * np.arange(count) / (count - 1)) if count > 1 else np.zeros(1)
    found = np.rint((low + high) / 2.0 - (high - low) / 2.0 * turn).astype(int).tolist()
    return list(found)

"""Response of a gyro beyond the straight line: odd polynomials, and the sine of an open-loop
fibre-optic gyro.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import CoefficientError, FitError
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import leave_out
from calibkit.numeric.least_squares.fit import linear

Form = Literal["odd-polynomial", "sine"]
ORDERS = (1, 3, 5, 7)
"""Highest powers of the odd polynomials that are compared."""
LARGEST_PHASE = np.pi / 2.0
"""Largest phase Ω/Ω_s: at π/2 the sine has its maximum, and an open-loop gyro is used below it."""
GRID = 24
"""Number of rate scales of the sine that are tried before refinement."""
INVERSE_GRID = 20001
"""Number of rates at which a response is tabulated for inversion, before one Newton step."""


@dataclass(frozen=True, slots=True)
class Response:
    """A fitted response.

    odd-polynomial: F = F0 + K1 Ω + K3 Ω³ + …; sine: F = F0 + K Ω_s sin(Ω/Ω_s), K the slope at zero
    rate.
    """

    form: Form
    order: int
    """Highest power of the odd polynomial; 1 for the sine."""
    names: tuple[str, ...]
    coefficients: Array
    covariance: Array
    dof: int
    residuals: Array
    left_out_rms: float
    """Root mean square of the leave-one-out errors of the plateaus, in the unit of the indication.
    """

    def at(self, rate_dps: Array) -> Array:
        """Indication at rates [n] [°/s]."""
        return evaluate(self.coefficients, rate_dps, is_sine=self.form == "sine")


def _odd_powers(count: int) -> list[int]:
    """Powers of the coefficients of an odd polynomial: 0, 1, 3, 5, …."""
    return [0, *range(1, 2 * count - 2, 2)]


def evaluate(coefficients: Array, rate_dps: Array, *, is_sine: bool) -> Array:
    """Indication [n] of a response at rates [n] [°/s]."""
    if is_sine:
        zero, slope, scale = coefficients
        return np.asarray(zero + slope * scale * np.sin(rate_dps / scale), dtype=np.float64)
    return np.asarray(
        sum(
            c * rate_dps**k
            for c, k in zip(coefficients, _odd_powers(coefficients.size), strict=True)
        )
    )


def gradient(coefficients: Array, rate_dps: Array, *, is_sine: bool) -> Array:
    """Derivatives [n, p] of the indication by the coefficients, at rates [n] [°/s]."""
    if not is_sine:
        return np.asarray(rate_dps[:, None] ** _odd_powers(coefficients.size), dtype=np.float64)
    _, slope, scale = coefficients
    phase = rate_dps / scale
    bend = slope * (np.sin(phase) - phase * np.cos(phase))
    return np.column_stack((np.ones_like(phase), scale * np.sin(phase), bend))


def invert(curve: Callable[[Array], Array], limits: tuple[float, float], indicated: Array) -> Array:
    """Rates [n] at which a response gives indicated rates [n] [°/s]; outside the fitted rates the
    correction at the nearer limit is kept.

    Raises CoefficientError for a response that is not monotonic.
    """
    grid = np.linspace(*limits, INVERSE_GRID)
    bent = curve(grid)
    if not (np.diff(bent) > 0.0).all():
        raise CoefficientError(
            "the response is not monotonic over its rates", hint="fit with response = 'line'"
        )
    rate = np.interp(indicated, bent, grid)
    step = 1e-4 * (limits[1] - limits[0])
    slope = (curve(rate + step) - curve(rate - step)) / (2.0 * step)
    inside = rate - (curve(rate) - indicated) / slope
    outside = rate + (indicated - np.clip(indicated, bent[0], bent[-1]))
    return np.where((indicated >= bent[0]) & (indicated <= bent[-1]), inside, outside)


def _odd_polynomial(rate_dps: Array, indication: Array, order: int) -> Response:
    """Fit F = F0 + K1 Ω + K3 Ω³ + … to plateau means [p] over rates [p] [°/s], up to an odd order.

    Raises FitError for an even order, or rates too few or too alike for it.
    """
    if order % 2 == 0:
        raise FitError(f"an odd polynomial of order {order}", hint="give an odd order")
    powers = np.array(_odd_powers((order + 3) // 2))
    unit = float(np.max(np.abs(rate_dps)))
    names = ("F0", *(f"K{k}" for k in powers[1:]))
    design = (rate_dps[:, None] / unit) ** powers
    fit = linear(design, indication, names=names)
    to_raw = 1.0 / unit**powers
    return Response(
        form="odd-polynomial",
        order=order,
        names=names,
        coefficients=fit.coefficients * to_raw,
        covariance=fit.covariance * np.outer(to_raw, to_raw),
        dof=fit.dof,
        residuals=fit.residuals,
        left_out_rms=rms(leave_out.left_out_errors(design, fit.residuals)),
    )


def _sine(rate_dps: Array, indication: Array) -> Response:
    """Fit F = F0 + K Ω_s sin(Ω/Ω_s), the response of an open-loop gyro (Lefèvre, The Fiber-Optic
    Gyroscope, chapter 2).

    rate_dps, indication : [p]. Raises FitError for fewer than four rates or rates within a straight
    line of it.
    """
    if rate_dps.size < 4:
        raise FitError(
            f"{rate_dps.size} plateaus for the three coefficients of a sine", hint="add rates"
        )
    scale = _best_scale(rate_dps, indication)
    zero, slope = _sine_factors(rate_dps, indication, scale)
    coefficients = np.array([zero, slope, scale])
    jacobian = gradient(coefficients, rate_dps, is_sine=True)
    residuals = indication - evaluate(coefficients, rate_dps, is_sine=True)
    # the linear fit of the residuals on the Jacobian carries the covariance of the last
    # Gauss-Newton step
    step = linear(jacobian, residuals, names=("F0", "K", "rate_scale"))
    return Response(
        form="sine",
        order=1,
        names=("F0", "K", "rate_scale_dps"),
        coefficients=coefficients,
        covariance=step.covariance,
        dof=rate_dps.size - 3,
        residuals=residuals,
        left_out_rms=rms(_left_out_sine(rate_dps, indication)),
    )


def _sine_factors(rate_dps: Array, indication: Array, scale: float) -> tuple[float, float]:
    """F0 and K of the sine of a given rate scale [°/s]: a straight line over Ω_s sin(Ω/Ω_s)."""
    bent = scale * np.sin(rate_dps / scale)
    middle = float(bent.mean())
    departure = bent - middle
    slope = float(np.sum(departure * indication) / np.sum(departure**2))
    return float(indication.mean()) - slope * middle, slope


def _best_scale(rate_dps: Array, indication: Array) -> float:
    """Rate scale [°/s] by least squares with the linear coefficients eliminated (variable
    projection, Golub & Pereyra 1973).
    """
    from scipy.optimize import minimize_scalar

    largest = float(np.max(np.abs(rate_dps)))

    def square(bend: float) -> float:
        scale = largest / bend
        zero, slope = _sine_factors(rate_dps, indication, scale)
        return float(np.sum((indication - zero - slope * scale * np.sin(rate_dps / scale)) ** 2))

    bends = np.linspace(0.01, LARGEST_PHASE, GRID)
    best = int(np.argmin([square(float(bend)) for bend in bends]))
    bounds = (
        float(bends[max(best - 1, 0)]) * (0.01 if best == 0 else 1.0),
        float(bends[min(best + 1, GRID - 1)]),
    )
    found = minimize_scalar(square, bounds=bounds, method="bounded", options={"xatol": 1e-10})
    return largest / float(found.x)


def _left_out_sine(rate_dps: Array, indication: Array) -> Array:
    """Leave-one-out error [p] of the sine at each plateau."""
    errors = np.empty_like(indication)
    for row in range(rate_dps.size):
        others = np.arange(rate_dps.size) != row
        scale = _best_scale(rate_dps[others], indication[others])
        zero, slope = _sine_factors(rate_dps[others], indication[others], scale)
        errors[row] = indication[row] - zero - slope * scale * np.sin(rate_dps[row] / scale)
    return errors


def choose(
    rate_dps: Array, indication: Array, *, orders: Sequence[int] = ORDERS, with_sine: bool = True
) -> tuple[Response, tuple[Response, ...]]:
    """Choose the response by leave-one-plateau-out error: the simplest one not clearly worse than
    the best.

    Parameters
    ----------
    rate_dps, indication : [p].
    orders : odd orders to compare.
    with_sine : whether the sine is compared too.

    Returns
    -------
    The chosen response and all that were compared. A response with more coefficients must lower the
    rms error by more than a tenth: by chance alone a superfluous term often wins by a few per cent.

    Raises
    ------
    FitError
        No response can be fitted to so few rates.

    """
    distinct = np.unique(np.round(rate_dps, 9)).size
    fitted = [
        _odd_polynomial(rate_dps, indication, order)
        for order in orders
        if (order + 1) // 2 + 2 <= distinct
    ]
    if with_sine and distinct >= 5:
        fitted.append(_sine(rate_dps, indication))
    if not fitted:
        raise FitError(f"{distinct} rates cannot show the shape of a response", hint="add rates")
    simplest_first = sorted(fitted, key=lambda response: response.coefficients.size)
    return simplest_first[
        leave_out.choose_simplest([response.left_out_rms for response in simplest_first])
    ], tuple(fitted)

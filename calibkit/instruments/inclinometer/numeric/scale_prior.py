"""Prior of s at a station: from the history of the stations before it, or from s(T) over a
calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.numeric.published import Components
from calibkit.instruments.inclinometer.numeric.root_choice import (
    DEFAULT_LIMITS,
    Estimates,
    Limits,
    Prior,
    Solution,
    estimate_roots,
    solve,
)
from calibkit.numeric import gum
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.fit import linear
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

GAIN = 4.0
"""Least reduction of the sum of squares by a higher order, in mean squares: the added coefficient
is then two standard uncertainties.
"""


@dataclass(frozen=True, slots=True)
class History:
    """Initial state and process noise of s along the stations, per unit of the abscissa: hours, or
    stations.
    """

    s: float = 1.0
    standard_uncertainty: float = 0.01
    rate: float = 0.0
    """Change of s per unit."""
    rate_uncertainty: float = 1e-3
    rate_walk: float = 1e-3
    """Random walk of the rate, per unit and square root of unit."""


DEFAULT_HISTORY = History()


@dataclass(frozen=True, slots=True)
class _ScaleOverTemperature(TemperaturePolynomial):
    """s(T) = s0 + s1 T + …, T in °C; its residual rms is weighted and dimensionless."""

    scatter: float
    """Standard deviation of s about the polynomial in excess of the stations' own noise; added to
    every prior.
    """
    used: Mask
    """Mask [n] of the stations used in the fit."""
    left_out: Prior
    """s(T) at each station [n] fitted to all the others: a prior independent of the station's own
    reading.
    """


def predict_scale(
    coefficients: Array,
    covariance: Array,
    scatter: float,
    valid_degc: tuple[float, float],
    temp_degc: ArrayLike,
) -> Prior:
    """Prior [n] of s at temperatures [n] [°C] from the s(T) of a coefficient file.

    Temperatures are clamped to the fitted range; the uncertainty then grows by what the slope at
    its end would add.
    """
    degc = np.atleast_1d(np.asarray(temp_degc, dtype=np.float64))
    clamped = np.clip(degc, *valid_degc)
    powers = polynomial.powers(clamped, coefficients.size - 1)
    variance = gum.variance_along(powers, covariance)
    slope = powers[:, :-1] @ (coefficients[1:] * np.arange(1, coefficients.size))
    beyond = slope * (degc - clamped)
    return Prior(powers @ coefficients, np.sqrt(np.maximum(variance, 0.0) + scatter**2 + beyond**2))


def history_prior(
    found: Estimates,
    elapsed: Array,
    *,
    start: History = DEFAULT_HISTORY,
    heading_deg: Array | None = None,
) -> Prior:
    """Prior of s at each station from the stations before it: value and rate of change (step D), by
    a Kalman filter.

    Parameters
    ----------
    found : both roots at n stations in their order.
    elapsed : [n], not decreasing: hours, or the number of the station.
    start : before the first station.
    heading_deg : [n], outside headings that choose the root; NaN where there is none.

    Notes
    -----
    State (s, ds/dt), its rate a random walk; a root that is not usable, or is as likely as the
    other, does not change the state.

    """
    if (
        elapsed.size != len(found.status)
        or not np.isfinite(elapsed).all()
        or (np.diff(elapsed) < 0.0).any()
    ):
        raise FitError(
            "the stations' times decrease or are not finite", hint="sort the stations by time"
        )
    forced = found.choose_by_heading(heading_deg)
    state = np.array([start.s, start.rate])
    covariance = np.diag([start.standard_uncertainty**2, start.rate_uncertainty**2])
    value, spread = np.empty_like(elapsed), np.empty_like(elapsed)
    for k in range(elapsed.size):
        state, covariance = _predict_state(
            state, covariance, float(elapsed[k] - elapsed[max(k - 1, 0)]), start.rate_walk
        )
        # the filter's prediction may be zero or negative; the prior must be a positive scale factor
        value[k], spread[k] = max(float(state[0]), 1e-3), float(np.sqrt(covariance[0, 0]))
        here = slice(k, k + 1)
        columns, ambiguous = found.choose_root(Prior(value[here], spread[here]), forced[here], here)
        root = k, int(columns[0])
        if not found.status[k] and found.usable[root] and not ambiguous[0]:
            state, covariance = _update_state(
                state, covariance, float(found.s[root]), float(found.uncertainty[root])
            )
    return Prior(value, spread)


def _predict_state(
    state: Array, covariance: Array, step: float, walk: float
) -> tuple[Array, Array]:
    """State and covariance predicted one step ahead."""
    move = np.array([[1.0, step], [0.0, 1.0]])
    added = walk**2 * np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])
    return move @ state, gum.propagate(move, covariance) + added


def _update_state(
    state: Array, covariance: Array, s: float, uncertainty: float
) -> tuple[Array, Array]:
    """State and covariance updated by a root of s."""
    gain = (
        covariance[:, 0] / (covariance[0, 0] + uncertainty**2)
        if covariance[0, 0] > 0.0
        else np.zeros(2)
    )
    return state + gain * (s - state[0]), covariance - np.outer(gain, covariance[0])


def predict_in_sequence(
    parts: Components,
    latitude_deg: ArrayLike,
    elapsed: Array,
    *,
    start: History = DEFAULT_HISTORY,
    heading_deg: Array | None = None,
    latitude_uncertainty_deg: float = 0.0,
    refused: Sequence[str] = (),
    limits: Limits = DEFAULT_LIMITS,
) -> Solution:
    """Solve n stations in order; s of each from its own root and the history of the stations
    before; see `solve`.
    """
    found = estimate_roots(parts, latitude_deg, refused=refused, limits=limits)
    prior = history_prior(found, elapsed, start=start, heading_deg=heading_deg)
    return solve(
        parts,
        latitude_deg,
        prior,
        heading_deg=heading_deg,
        latitude_uncertainty_deg=latitude_uncertainty_deg,
        refused=refused,
        limits=limits,
    )


def fit_over_temperature(
    solution: Solution, temp_degc: Array, *, order: int | None = None
) -> _ScaleOverTemperature:
    """Fit the chosen roots of n stations as s(T), weighted by their uncertainty and their common
    scatter.

    Parameters
    ----------
    solution : of one sensor pair; stations whose root was not used do not enter.
    temp_degc : [n] [°C].
    order : of the polynomial; by default the one of least leave-one-out error, at most cubic.

    Returns
    -------
    ScaleOverTemperature. The scatter is the standard deviation that makes the weighted residuals
    agree with their degrees of freedom (Mandel & Paule 1970, Analytical Chemistry 42:1194); zero
    where noise explains all.

    Raises
    ------
    FitError
        Fewer usable stations than coefficients, or temperatures that do not vary for an order above
        zero.

    """
    used = solution.root_used & np.isfinite(temp_degc)
    if used.sum() < 2:
        raise FitError(
            f"{int(used.sum())} usable roots of s for s(T)", hint="add stations away from C = 0"
        )
    s, u, temperature = solution.s_root[used], solution.s_root_uncertainty[used], temp_degc[used]
    u = np.maximum(u, 1e-3 * float(np.median(u)) if np.median(u) > 0.0 else 1.0)
    chosen = _choose_order(s, u, temperature) if order is None else order
    middle, half = polynomial.middle_and_half(temperature)
    if chosen > 0 and half == 0.0:
        raise FitError(
            f"one temperature, {middle:g} °C, for s(T) of order {chosen}",
            hint="add other temperatures",
        )
    limits = (float(temperature.min()), float(temperature.max()))
    half = half or 1.0
    every = polynomial.powers(np.clip(temp_degc, *limits), chosen, middle=middle, half=half)
    design = every[used]
    scatter = _excess_scatter(s, u, design)
    variance = np.asarray(u**2 + scatter**2, dtype=np.float64)
    fit = linear(design, s, weights=1.0 / variance, names=[f"s{k}" for k in range(chosen + 1)])
    inverse = np.asarray(np.linalg.inv((design / variance[:, None]).T @ design), dtype=np.float64)
    to_raw = np.asarray(polynomial.to_raw_powers(middle, half, chosen), dtype=np.float64)
    own = np.zeros(used.size)
    own[used] = 1.0 / variance
    roots = np.where(used, solution.s_root, 0.0)
    return _ScaleOverTemperature(
        coefficients=to_raw @ fit.coefficients,
        covariance=gum.propagate(to_raw, inverse),
        scatter=scatter,
        dof=fit.dof,
        residual_rms=fit.residual_rms,
        valid_degc=limits,
        used=used,
        left_out=_predict_left_out(every, fit.coefficients, inverse, own, roots, scatter),
    )


def _predict_left_out(
    design: Array, factors: Array, inverse: Array, own_weight: Array, s: Array, scatter: float
) -> Prior:
    """s(T) at each station without its own root: ŷ_(i) = (ŷ − h y)/(1 − h), its variance x P x/(1 −
    h).
    """
    power = gum.variance_along(design, inverse)
    leverage = np.minimum(power * own_weight, 1.0 - 1e-6)
    value = (design @ factors - leverage * s) / (1.0 - leverage)
    return Prior(value, np.sqrt(power / (1.0 - leverage) + scatter**2))


def _excess_scatter(s: Array, u: Array, design: Array) -> float:
    """Standard deviation in excess of noise with which the weighted sum of squared residuals equals
    its degrees of freedom.
    """
    from scipy.optimize import brentq

    dof = s.size - int(design.shape[1])
    if dof < 1:
        return 0.0

    def excess(scatter: float) -> float:
        variance = u**2 + scatter**2
        residuals = linear(design, s, weights=1.0 / variance).residuals
        return float(np.sum(residuals**2 / variance)) - dof

    if excess(0.0) <= 0.0:
        return 0.0
    upper = float(np.std(s)) + float(np.max(u))
    while excess(upper) > 0.0:
        upper *= 2.0
    return float(brentq(excess, 0.0, upper, xtol=1e-12))


def _choose_order(s: Array, u: Array, temperature: Array) -> int:
    """Order with the least weighted leave-one-out error among those that the temperatures
    determine; a higher order must improve it significantly (GAIN).
    """
    return polynomial.choose_order(
        temperature,
        s,
        min(polynomial.HIGHEST_ORDER, np.unique(np.round(temperature)).size - 1, s.size - 2),
        margin=float(np.sqrt(max(1.0 - GAIN / s.size, 0.0))),
        weights=1.0 / (u**2 + _excess_scatter(s, u, np.ones((s.size, 1))) ** 2),
    )

"""s(T) from the roots of s of many stations: polynomial, scatter from station to station and log to
log, and the turn of a gyro against its accelerometer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.numeric.root_choice import Prior, Solution
from calibkit.numeric import gum
from calibkit.numeric.least_squares import components as shared, levels, polynomial
from calibkit.numeric.least_squares.components import Effect
from calibkit.numeric.least_squares.fit import RANK_TOLERANCE, linear
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

GAIN = 4.0
"""Least reduction of the sum of squares by a higher order, in mean squares: the added coefficient
is then two standard uncertainties.
"""
SPARE = 3
"""Fewest degrees of freedom with which the turn of a gyro is measured."""
BY_CHANCE = 0.05
"""Probability of a turn by noise alone, below which it is taken as measured."""
LEAST_DEG = 1e-4
"""Turn [°] below which no tool is aligned."""


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
    turn_deg: tuple[float, float]
    """Turn of the gyro against its accelerometer and its standard uncertainty [°]; zeros where the
    roots do not show one.
    """
    components: tuple[shared.Component, ...]
    """Scatter of s from log to log and from station to station."""
    effective_dof: Array | None
    """Of the coefficients, where s scatters from log to log."""
    choice: float
    """Standard deviation that the choice of the order adds."""


def fit_over_temperature(
    solution: Solution,
    temp_degc: Array,
    *,
    order: int | None = None,
    turn: Array | None = None,
    log: Effect | None = None,
) -> _ScaleOverTemperature:
    """Fit the chosen roots of n stations as s(T), weighted by their uncertainty and their common
    scatter.

    Parameters
    ----------
    solution : of one sensor pair; stations whose root was not used do not enter.
    temp_degc : [n] [°C].
    order : of the polynomial; by default the one of least leave-one-out error, at most cubic.
    turn : [n], derivative of the roots by a turn of the gyro [1/°], which is tried.
    log : the part of s that the stations of a log share.

    Returns
    -------
    ScaleOverTemperature. The scatter is the standard deviation that makes the weighted residuals
    agree with their degrees of freedom (Mandel & Paule 1970, Analytical Chemistry 42:1194); zero
    where noise explains all.

    Raises
    ------
    FitError
        Fewer usable stations than coefficients, or temperatures that do not vary for an order above
        zero; logs that coincide with temperature.

    """
    used, s, u = _used_roots(solution, temp_degc)
    effects = [] if log is None else [log.of_rows(used)]
    found = polynomial.OrderChoice(order or 0, 0.0)
    if order is None:
        found = _choose_order(s, u, temp_degc[used], effects)
    chosen = found.order
    every, to_raw, limits = _powers(temp_degc, used, chosen)
    rows, angle = every, (0.0, 0.0)
    if turn is not None:
        wide = np.column_stack([every, np.where(used, turn, 0.0)])
        angle, asked = _measure_turn(s, u, wide[used], effects)
        rows = wide if asked else every
    fit = _fit_roots(s, u, rows[used], effects)
    size = chosen + 1
    own = np.zeros(used.size)
    own[used] = 1.0 / fit.variance
    roots = np.where(used, solution.s_root, 0.0)
    return _ScaleOverTemperature(
        coefficients=to_raw @ fit.coefficients[:size],
        covariance=gum.propagate(to_raw, fit.covariance[:size, :size]),
        scatter=fit.scatter,
        dof=fit.dof,
        residual_rms=fit.residual_rms,
        valid_degc=limits,
        used=used,
        left_out=_predict_left_out(every, rows, fit, own, roots, log),
        turn_deg=angle,
        components=fit.components,
        effective_dof=fit.effective_dof(to_raw) if effects else None,
        choice=found.spread,
    )


def _used_roots(solution: Solution, temp_degc: Array) -> tuple[Mask, Array, Array]:
    """Mask [n] of the stations of a fit, their roots and standard uncertainties [m]."""
    used = solution.root_used & np.isfinite(temp_degc)
    if used.sum() < 2:
        raise FitError(
            f"{int(used.sum())} usable roots of s for s(T)", hint="add stations away from C = 0"
        )
    s, u = solution.s_root[used], solution.s_root_uncertainty[used]
    return used, s, np.maximum(u, 1e-3 * float(np.median(u)) if np.median(u) > 0.0 else 1.0)


def _powers(temp_degc: Array, used: Mask, order: int) -> tuple[Array, Array, tuple[float, float]]:
    """Mapped powers [n, order + 1] of temperatures [n] [°C], clamped to those that are used, the
    matrix into raw powers, and the range.
    """
    middle, half = polynomial.middle_and_half(temp_degc[used])
    if order > 0 and half == 0.0:
        raise FitError(
            f"one temperature, {middle:g} °C, for s(T) of order {order}",
            hint="add other temperatures",
        )
    limits = (float(temp_degc[used].min()), float(temp_degc[used].max()))
    half = half or 1.0
    every = polynomial.powers(np.clip(temp_degc, *limits), order, middle=middle, half=half)
    return every, np.asarray(polynomial.to_raw_powers(middle, half, order), np.float64), limits


@dataclass(frozen=True, slots=True)
class _Roots:
    """Roots fitted as a linear model with scatter from station to station and log to log."""

    coefficients: Array
    covariance: Array
    variance: Array
    """Of each root about the model, without what a log shares."""
    scatter: float
    """Of a station of another log."""
    dof: int
    residual_rms: float
    components: tuple[shared.Component, ...]
    mixed: shared.MixedFit | None

    def effective_dof(self, to_raw: Array) -> Array:
        """Degrees of freedom of the coefficients in raw powers."""
        if self.mixed is None:
            return np.full(len(to_raw), float(self.dof))
        combined = np.zeros((len(to_raw), len(self.coefficients)))
        combined[:, : len(to_raw)] = to_raw
        return self.mixed.effective_dof_of(combined)


def _fit_roots(s: Array, u: Array, design: Array, effects: Sequence[Effect]) -> _Roots:
    """Fit roots s of standard uncertainty u [m] as design [m, p]."""
    names = [f"s{k}" for k in range(design.shape[1])]
    whole = _with_levels(design, effects)
    scatter = _excess_scatter(s, u, whole)
    variance = np.asarray(u**2 + scatter**2, dtype=np.float64)
    spare = s.size - whole.shape[1]
    of_station = shared.Component(
        *("station", "scale", scatter, _uncertainty_of(scatter, u, spare), s.size, spare, False)
    )
    found = linear(design, s, weights=1.0 / variance, names=names)
    inverse = np.asarray(np.linalg.inv((design / variance[:, None]).T @ design), dtype=np.float64)
    if not effects or not found.dof:
        return _Roots(
            *(found.coefficients, inverse, variance, scatter, found.dof, found.residual_rms),
            (of_station,),
            None,
        )
    if whole.shape[1] == design.shape[1] and effects[0].known is None:
        raise levels.coincidence(effects[0], design.shape[1], names)
    mixed = shared.fit(design, s, effects, weights=1.0 / variance, names=names)
    (of_log,) = mixed.components
    return _Roots(
        mixed.coefficients,
        mixed.covariance,
        variance,
        float(np.hypot(scatter, of_log.value)),
        mixed.dof,
        mixed.residual_rms,
        (of_log, of_station),
        mixed,
    )


def _with_levels(design: Array, effects: Sequence[Effect]) -> Array:
    """Columns [m, r] that span a design and the levels of effects."""
    if not effects:
        return design
    labels = effects[0].labels
    level = (labels[:, None] == np.unique(labels)).astype(np.float64)
    left, singular, _ = np.linalg.svd(np.column_stack([design, level]), full_matrices=False)
    return np.asarray(left[:, singular > RANK_TOLERANCE * singular[0]], dtype=np.float64)


def _uncertainty_of(scatter: float, u: Array, dof: int) -> float:
    """Standard uncertainty of a scatter beyond noise of standard uncertainties u [m]."""
    if dof < 1:
        return 0.0
    spread = float(np.mean(u**2) + scatter**2) * np.sqrt(2.0 / dof)
    return float(spread / (2.0 * scatter) if scatter**2 > spread else np.sqrt(spread))


def _measure_turn(
    s: Array, u: Array, design: Array, effects: Sequence[Effect]
) -> tuple[tuple[float, float], bool]:
    """Turn of the gyro [°], the last coefficient of a design, and its standard uncertainty, zeros
    where the roots cannot tell it; whether it is more than noise explains. A turn that noise may
    explain stays in the azimuth's uncertainty with its own size.
    """
    spare = s.size - design.shape[1]
    if spare < SPARE or np.linalg.matrix_rank(_with_levels(design, effects)) < design.shape[1]:
        return (0.0, 0.0), False
    fit = _fit_roots(s, u, design, effects)
    angle = float(fit.coefficients[-1])
    spread = float(np.sqrt(fit.covariance[-1, -1]))
    from scipy.special import stdtr

    asked = 2.0 * stdtr(spare, -abs(angle) / spread) <= BY_CHANCE
    if abs(angle) < LEAST_DEG:
        return (0.0, 0.0), False
    return (angle, spread if asked else 0.0), bool(asked)


def _predict_left_out(
    wanted: Array, design: Array, fit: _Roots, own_weight: Array, s: Array, log: Effect | None
) -> Prior:
    """s(T) at each station without its own root: z β_(i), β_(i) = β − P x w e/(1 − h), with its
    variance z P z + w (z P x)²/(1 − h), of rows x of the design and z [n, q] of what is
    wanted. What a log shares is part of x, with its size as known.
    """
    count, covariance, left = wanted.shape[1], fit.covariance, s - design @ fit.coefficients
    if fit.mixed is not None and log is not None and fit.components[0].value > 0.0:
        left = left - fit.mixed.shared([log])
        level = log.labels[:, None] == np.unique(log.labels)
        known = np.zeros(design.shape[1] + level.shape[1])
        known[design.shape[1] :] = fit.components[0].value ** -2.0
        design = np.column_stack([design, level])
        information = (design * own_weight[:, None]).T @ design + np.diag(known)
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    power = gum.variance_along(design, covariance)
    across = np.einsum("ni,ij,nj->n", wanted, covariance[:count], design)
    spare = 1.0 - np.minimum(power * own_weight, 1.0 - 1e-6)
    value = wanted @ fit.coefficients[:count] - across * own_weight * left / spare
    variance = gum.variance_along(wanted, covariance[:count, :count])
    variance += own_weight * across**2 / spare
    return Prior(value, np.sqrt(variance + fit.scatter**2))


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


def _choose_order(
    s: Array, u: Array, temperature: Array, effects: Sequence[Effect]
) -> polynomial.OrderChoice:
    """Order with the least weighted leave-one-out error among those that the temperatures
    determine; a higher order must improve it significantly (GAIN).
    """
    return polynomial.choose_order(
        temperature,
        s,
        min(polynomial.HIGHEST_ORDER, np.unique(np.round(temperature)).size - 1, s.size - 2),
        margin=float(np.sqrt(max(1.0 - GAIN / s.size, 0.0))),
        weights=1.0 / (u**2 + _excess_scatter(s, u, np.ones((s.size, 1))) ** 2),
        groups=effects[0].labels.astype(np.float64) if effects else None,
    )

"""In-situ scale factor of a gyro over temperature, from the roots of s of many stations.

    s_i = s0 + s1 x_i + … + sn x_iⁿ + δ d_i + b_log + b_station + e_i,   e_i ~ N(0, u_i²)     (1)

x is the temperature mapped to [-1, 1], δ the turn of the gyro against its accelerometer and d_i
the derivative of the root by it, b_log and b_station scatter from log to log and from station to
station, u_i the standard uncertainty of a root by the noise of its readings. Orders n are averaged
(`calibkit.fit.orders`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.coefficients import Component, Model, Parameter
from calibkit.errors import FitError
from calibkit.fit import likelihood
from calibkit.fit.complex_step import Numbers
from calibkit.fit.orders import average, orders
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit, sensitivities, solve
from calibkit.instruments.inclinometer.forms import SCALE, TEMPERATURE, ScaleModel
from calibkit.instruments.inclinometer.root_choice import ScalePrior, Solution
from calibkit.numeric import gum
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER

SPARE = 3
"""Fewest degrees of freedom with which the turn of a gyro is measured."""
SEPARABLE = 0.1
"""Share of the derivatives by a turn that a polynomial must leave. In one fixed fixture 0.001 is
left, noise alone, in which a turn of any size is seen; free stations leave 0.99, ± 5° 0.16.
"""
BY_CHANCE = 0.05
"""Probability of a turn by noise alone, below which it is taken as measured."""
LEAST_DEG = 1e-4
"""Turn [°] below which no tool is aligned."""
LEAST_SPARE = 1e-6
"""Least share of a root that the others leave open; with less it alone determines a coefficient."""


@dataclass(frozen=True, slots=True)
class StationRoots:
    """Roots of s at n stations."""

    s: Array
    u: Array
    """Standard uncertainty by the noise of the readings."""
    x: Array
    """Temperature mapped to [-1, 1], at the ends of the range beyond it."""
    turn: Array
    """Derivative of the root by a turn of the gyro [1/°]."""
    log: Integers


@dataclass(frozen=True, slots=True)
class ScaleOverTemperature:
    """s(T) = s0 + s1 T + …, T in °C, fitted to the roots of n stations."""

    fit: Fit
    """Of s0 … sn in powers of x and of the turn [°]."""
    roots: StationRoots
    """That were fitted."""
    to_raw: Array
    """[n + 1, n + 1], matrix from powers of x to powers of °C."""
    valid_degc: tuple[float, float]
    used: Mask
    """Mask [n] of the stations used in the fit."""
    left_out: ScalePrior
    """s(T) at each station [n] fitted to all the others: a prior independent of the station's own
    reading.
    """
    separable: bool | None
    """Whether the stations tell a turn of the gyro from the polynomial; None where they are too few
    to measure it.
    """

    @property
    def coefficients(self) -> Array:
        """s0 … sn in powers of °C."""
        return self.to_raw @ self.fit.parameters[:-1]

    @property
    def covariance(self) -> Array:
        """[n + 1, n + 1], type A."""
        return self.fit.restated(lambda p: self.to_raw @ p[:-1]).total_covariance

    @property
    def effective_dof(self) -> Array:
        """Of the coefficients [n + 1]. That of s0 is the least within the range of
        temperatures, because every s(T) is made with it; alone it is the polynomial at 0 °C.
        """
        dof = self.fit.of(lambda p: self.to_raw @ p[:-1]).dof
        dof[0] = min(dof[0], self.fit.of(lambda p: scale(p, np.linspace(-1.0, 1.0, 21))).dof.min())
        return dof

    @property
    def scatter(self) -> float:
        """Standard deviation of s at a station of another log about s(T), beyond the noise of its
        readings.
        """
        return float(np.linalg.norm([size.value for size in self.fit.shared]))

    @property
    def residual_rms(self) -> float:
        """Standard deviation of the roots about s(T), each weighted by the inverse square of its
        noise.
        """
        weight = self.fit.noise**-2.0
        square = float(weight @ self.fit.noise_residual**2 / np.mean(weight))
        return float(np.sqrt(square / self.fit.dof))

    @property
    def turn_deg(self) -> tuple[float, float]:
        """Turn of the gyro against its accelerometer and its standard uncertainty [°]. That of a
        turn which noise may explain is 0: it stays in the azimuth's uncertainty with its own size.
        """
        from scipy.special import stdtr

        turn = self.fit.of(lambda p: p[-1:])
        angle, u = float(turn.value[0]), float(turn.u[0])
        if not self.separable or abs(angle) < LEAST_DEG:
            return 0.0, 0.0
        by_chance = 2.0 * float(stdtr(turn.dof[0], -abs(angle) / u))
        return angle, u if by_chance <= BY_CHANCE else 0.0

    def further_error(self, by_error: Array, spare: int) -> tuple[float, float]:
        """An error that all stations share by derivatives of the root [n], instead of a turn, and
        its standard uncertainty; 0 where fewer than `spare` stations are left over, or they do not
        separate it from s(T).
        """
        roots = replace(self.roots, turn=by_error[self.used])
        order = len(self.to_raw) - 1
        if len(roots.s) < order + 1 + spare or not _separates_turn(roots, order):
            return 0.0, 0.0
        shared = [size.error for size in self.fit.shared]
        (fit,) = _fit_orders(roots, [order], shared, with_turn=True)
        error = fit.of(lambda p: p[-1])
        return float(error.value), float(error.u)

    def shifted(self, s: Array, turn: Array, temp_degc: Array) -> Array:
        """Change of the coefficients [n + 1] where roots, derivatives by a turn and temperatures of
        all stations are others, the weights held.
        """
        low, high = self.valid_degc
        x = (2.0 * temp_degc - low - high) / (high - low or 2.0)
        shifted_roots = replace(self.roots, s=s[self.used], turn=turn[self.used], x=x[self.used])
        of_fit, other = partial(residual, roots=self.roots), partial(residual, roots=shifted_roots)
        (change,) = sensitivities(of_fit, [other], self.fit)
        return np.asarray(self.to_raw @ change[:-1])


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """s(T) of one gyro, as files hold it, and how it was found."""

    model: ScaleModel
    used: Mask
    """Mask [n] of the stations used in the fit."""
    left_out: ScalePrior
    """As that of `over`."""
    over: ScaleOverTemperature | None = None
    """None of a single root."""
    components: tuple[Component, ...] = ()
    flags: tuple[str, ...] = ()

    @property
    def dof(self) -> int:
        """Roots less coefficients."""
        return 0 if self.over is None else self.over.fit.dof

    def write(self, axis: str) -> Model:
        """Model of the gyro on an axis; its parameters are the scatter of s and the noise of the
        readings.
        """
        model, over = self.model, self.over
        return SCALE.write(
            axis,
            [
                (f"s{k}", value, "1" if k == 0 else f"1/degC{k if k > 1 else ''}")
                for k, value in enumerate(model.coefficients.tolist())
            ],
            model.covariance,
            dof=self.dof,
            effective_dof=None if over is None else over.effective_dof,
            components=self.components,
            residual_rms=0.0 if over is None else over.residual_rms,
            residual_unit="1",
            valid={} if model.valid is None else {TEMPERATURE: model.valid},
            parameters=(
                Parameter("scatter", model.scatter, "1"),
                Parameter("gyro_noise", model.noise.gyro_dph, "deg/h"),
                Parameter("accel_noise", model.noise.accel_g, "g"),
                Parameter("noise_dof", float(model.noise.dof), "1"),
            ),
        )


def scale(p: Numbers, x: Array) -> Numbers:
    """s(T) [n] of parameters s0 … sn, δ at mapped temperatures [n]."""
    return np.asarray(np.vander(x, len(p) - 1, increasing=True) @ p[:-1])


def residual(p: Numbers, roots: StationRoots) -> Numbers:
    """What (1) leaves of the roots [n], of parameters s0 … sn, δ [°]."""
    return np.asarray(scale(p, roots.x) + p[-1] * roots.turn - roots.s)


def shared_errors(roots: StationRoots, log: Shared | None) -> list[Shared]:
    """Scatter of s from log to log, and from station to station within a log."""
    count = len(roots.s)
    station = Shared(
        group="station",
        effect="scale",
        level=np.arange(count),
        loading=np.ones((count, 1)),
        unit="1",
    )
    if log is None or not roots.log.any():
        return [station]
    of_log = replace(log, level=roots.log, loading=station.loading)
    # logs of one station each: their scatter is that of the stations
    return [of_log] if of_log.is_noise else [of_log, station]


def scale_of_logs(log: Integers) -> Shared:
    """Part of s that the stations of a log share, from the number [n] of the log of each."""
    return Shared(group="log", effect="scale", level=log, loading=np.ones((log.size, 1)), unit="1")


def fit_over_temperature(
    solution: Solution,
    temp_degc: Array,
    *,
    order: int | None = None,
    turn: Array | None = None,
    log: Shared | None = None,
) -> ScaleOverTemperature:
    """Fit the chosen roots of n stations as s(T).

    Parameters
    ----------
    solution : of one sensor pair; stations whose root was not used do not enter.
    temp_degc : [n] [°C].
    order : of the polynomial; by default the average of all that the stations carry, at most
        cubic.
    turn : [n], derivative of the roots by a turn of the gyro [1/°], which is measured where the
        stations separate it from s(T).
    log : [n], the part of s that the stations of a log share.

    Raises
    ------
    FitError
        Fewer usable stations than coefficients, or temperatures that do not vary for an order above
        zero; logs that coincide with temperature.

    """
    used = solution.root_used & np.isfinite(temp_degc)
    if used.sum() < 2:
        raise FitError(
            f"{int(used.sum())} usable roots of s for s(T)", hint="add stations away from C = 0"
        )
    degc = temp_degc[used]
    middle, half = polynomial.middle_and_half(degc)
    if order and half == 0.0:
        raise FitError(
            f"one temperature, {middle:g} °C, for s(T) of order {order}",
            hint="add other temperatures",
        )
    limits = (float(degc.min()), float(degc.max()))
    half = half or 1.0
    all_roots = StationRoots(
        s=np.where(used, solution.s_root, 0.0),
        u=np.where(used, solution.s_root_uncertainty, np.inf),
        x=(np.clip(temp_degc, *limits) - middle) / half,
        turn=np.zeros(used.size) if turn is None else np.where(used, turn, 0.0),
        log=np.zeros(used.size, dtype=np.int64) if log is None else log.level,
    )
    levels = np.unique(np.round(degc)).size
    tried_orders = orders(degc.size, levels, HIGHEST_ORDER) if order is None else [order]
    highest = tried_orders[-1]
    # one that states no uncertainty would be the only one that counts
    typical = float(np.median(all_roots.u[used]))
    least_u = 1e-3 * typical if typical > 0.0 else 1.0
    roots = StationRoots(
        s=all_roots.s[used],
        u=np.maximum(all_roots.u[used], least_u),
        x=all_roots.x[used],
        turn=all_roots.turn[used],
        log=np.unique(all_roots.log[used], return_inverse=True)[1],
    )
    separable = None
    if turn is not None and degc.size - highest - 2 >= SPARE:
        separable = _separates_turn(roots, highest)
    fits = _fit_orders(roots, tried_orders, shared_errors(roots, log), with_turn=separable is True)
    fit = average(fits)
    to_raw = np.asarray(polynomial.to_raw_powers(middle, half, highest), dtype=np.float64)
    left_out = _leave_out(fit, all_roots, roots, used)
    return ScaleOverTemperature(fit, roots, to_raw, limits, used, left_out, separable)


def _separates_turn(roots: StationRoots, order: int) -> bool:
    """Whether derivatives by a turn are other than a polynomial of the temperature."""
    powers = np.vander(roots.x, order + 1, increasing=True) / roots.u[:, None]
    turn = roots.turn / roots.u
    left = turn - powers @ np.linalg.lstsq(powers, turn, rcond=None)[0]
    return bool(np.linalg.norm(left) >= SEPARABLE * np.linalg.norm(turn) > 0.0)


def _fit_orders(
    roots: StationRoots, tried_orders: Sequence[int], shared: Sequence[Shared], *, with_turn: bool
) -> list[Fit]:
    """Fits of those orders that leave more levels (logs, or stations) than the polynomial has
    coefficients: with fewer it runs through each, and their scatter is unknown.
    """
    highest = tried_orders[-1]
    fits: list[Fit] = []
    for order in tried_orders:
        free = np.append(np.arange(highest + 1) <= order, with_turn)
        names = [*(f"s{k}" for k in range(highest + 1)), "turn"]
        fit = solve(
            partial(residual, roots=roots),
            np.zeros(highest + 2),
            shared,
            noise=roots.u,
            estimate_noise=False,
            free=free,
            names=names,
        )
        log, rows = shared[0], fit.solution.rows
        levels_apart = likelihood.degrees(rows.J, rows.Z[:, rows.group == 0])
        if not log.is_noise and log.size is None and not levels_apart:
            if fits:
                break
            raise FitError(
                f"the scale of each log cannot be separated from {', '.join(names[: order + 1])}:"
                f" {log.levels} of them, each at one temperature, expected more than {order + 1},"
                " or changes of the temperature within each",
                hint="measure more of them, lower the order, or state how much the scale differs in"
                " [[errors.component]]",
            )
        fits.append(fit)
    return fits


def _leave_out(fit: Fit, all_roots: StationRoots, roots: StationRoots, used: Mask) -> ScalePrior:
    """s(T) [n] at each station without its own root, and its standard uncertainty with the scatter.

    Without row i the parameters change by G_i (P r)_i / P_ii, and their covariance grows by
    G_i G_iᵀ / P_ii; G is the gain, r the residual, P = V⁻¹ (I - J G) (Cook 1977).
    """
    order = len(fit.parameters) - 2
    design = np.column_stack(
        [np.vander(all_roots.x, order + 1, increasing=True), np.zeros(used.size)]
    )
    J = np.column_stack([np.vander(roots.x, order + 1, increasing=True), roots.turn])
    values, variances = [], []
    for member in fit.members:
        P = np.diag(member.precision(np.eye(len(J)) - J @ member.gain))
        P = np.maximum(P, LEAST_SPARE / member.noise**2)
        by_root = np.einsum("np,pn->n", design[used], member.gain)
        value, variance = design @ member.parameters, gum.variance_along(design, member.covariance)
        value[used] += by_root * member.precision(member.residual[:, None])[:, 0] / P
        variance[used] += by_root**2 / P
        values.append(value)
        variances.append(variance)
    mean = fit.weights @ values
    spread = fit.weights @ (np.array(variances) + (np.array(values) - mean) ** 2)
    scatter = sum(size.value**2 for size in fit.shared)
    return ScalePrior(mean, np.sqrt(spread + scatter))

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

from calibkit.errors import FitError
from calibkit.fit import likelihood
from calibkit.fit.complex_step import Numbers
from calibkit.fit.orders import average, orders
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit, solve
from calibkit.instruments.inclinometer.forms import MOUNTING, SCALE, TEMPERATURE, ScaleModel
from calibkit.instruments.inclinometer.published import NO_NOISE, Noise
from calibkit.instruments.inclinometer.recipe import HistorySpec
from calibkit.instruments.inclinometer.root_choice import DEFAULT_HISTORY, ScalePrior, Solution
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.recipe.shared_errors import warn_of_few_levels
from calibkit.records.coefficients import Component, Model, Parameter
from calibkit.records.forms import components_of
from calibkit.records.frame import Remark
from calibkit.records.sensitivities import InputError

SPARE = 3
"""Fewest degrees of freedom with which the turn of a gyro is measured."""
SEPARABLE = 0.1
"""Share of the derivatives by a turn that a polynomial must leave. In one fixed fixture 0.001 is
left, noise alone, in which a turn of any size is seen; free stations leave 0.99, ± 5° 0.16.
"""
BY_CHANCE = 0.05
"""Probability of a turn by noise alone, below which it is taken as measured."""
SHOWN = 3.0
"""Standard uncertainties above which a turn is flagged; it is in the azimuth's from 2 on."""
ONE_ATTITUDE = "one attitude: a turn of the gyro is not separable, in U of the azimuth as stated"
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
class ScaleFit:
    """s(T) of one gyro, as files hold it, and its fit to the roots of n stations."""

    model: ScaleModel
    used: Mask
    """Mask [n] of the stations used in the fit."""
    left_out: ScalePrior
    """s(T) at each station [n] fitted to all the others: a prior independent of the station's own
    reading.
    """
    roots: StationRoots
    """That were fitted."""
    by_latitude: Array
    """Their derivatives by the latitude [1/°]."""
    to_raw: Array
    """[n + 1, n + 1], matrix from powers of x to powers of °C."""
    fit: Fit | None = None
    """Of s0 … sn in powers of x and of the turn [°]; None of a single root."""
    turn_deg: tuple[float, float] = (0.0, 0.0)
    """Turn of the gyro against its accelerometer and its standard uncertainty [°]. That of a turn
    which noise may explain is 0: it stays in the azimuth's uncertainty with its own size.
    """
    components: tuple[Component, ...] = ()
    flags: tuple[str, ...] = ()

    @property
    def dof(self) -> int:
        """Roots less coefficients."""
        return 0 if self.fit is None else self.fit.dof

    @property
    def effective_dof(self) -> Array | None:
        """Of the coefficients [n + 1]. That of s0 is the least within the range of
        temperatures, because every s(T) is made with it; alone it is the polynomial at 0 °C.
        """
        if self.fit is None:
            return None
        dof = self.fit.of(lambda p: self.to_raw @ p[:-1]).dof
        # s0 is in every s(T), but is itself s at 0 °C, mostly far outside the logs
        dof[0] = min(dof[0], self.fit.of(lambda p: scale(p, np.linspace(-1.0, 1.0, 21))).dof.min())
        return dof

    def latitude_error(self, spare: int) -> tuple[float, float]:
        """Error of the latitude that all stations share [°], instead of a turn, and its standard
        uncertainty; 0 where fewer than `spare` stations are left over, or they do not separate it
        from s(T). The root at the latitude that was taken is s(T) + ds/dα × error.
        """
        roots, order = replace(self.roots, turn=self.by_latitude), len(self.to_raw) - 1
        enough = self.fit is not None and len(roots.s) >= order + 1 + spare
        if self.fit is None or not (enough and _separates_turn(roots, order)):
            return 0.0, 0.0
        shared = [size.error for size in self.fit.shared]
        (fit,) = _fit_orders(roots, [order], shared, with_turn=True)
        error = fit.of(lambda p: p[-1])
        return float(error.value), float(error.u)

    def moved_by(self, error: InputError) -> Array:
        """Derivatives [n + 1] of the coefficients by an error of an input, weights held: of the
        latitude, of the gyro's scale, which divides every root, or of the thermometer.
        """
        s = self.model.coefficients
        if error.input == TEMPERATURE:
            # a thermometer that reads T + offset + growth T makes s(T) - (offset + growth T) s'(T)
            # a shift is linear in the reading: two points of it give offset and growth
            offset, at_one = error.shift(np.array([0.0, 1.0])) - np.array([0.0, 1.0])
            slope = np.append(s[1:] * np.arange(1, s.size), 0.0)
            change = offset * slope + (at_one - offset) * np.append(0.0, slope[:-1])
            return np.asarray(-change / error.step)
        if error.kind == "scale":
            # every root is divided by the gyro's scale, and so is s(T)
            return -s
        if self.fit is None:
            return self.by_latitude
        return np.asarray(self.to_raw @ (self.fit.gain @ self.by_latitude)[:-1])

    def write(self, axis: str) -> Model:
        """Model of the gyro on an axis; its parameters are the scatter of s and the noise of the
        readings.
        """
        model, residual_rms = self.model, 0.0
        if self.fit is not None:  # about s(T), each root weighted by the inverse square of its u
            weight = self.fit.noise**-2.0
            square = float(weight @ self.fit.noise_residual**2 / np.mean(weight))
            residual_rms = float(np.sqrt(square / self.fit.dof))
        return SCALE.write(
            axis,
            [
                (f"s{k}", value, "1" if k == 0 else f"1/degC{k if k > 1 else ''}")
                for k, value in enumerate(model.coefficients.tolist())
            ],
            model.covariance,
            dof=self.dof,
            effective_dof=self.effective_dof,
            components=self.components,
            residual_rms=residual_rms,
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
    turn: Shared | None = None,
    log: Shared | None = None,
    noise: Noise = NO_NOISE,
    history: HistorySpec = DEFAULT_HISTORY,
) -> ScaleFit:
    """Fit the chosen roots of n stations as s(T).

    Parameters
    ----------
    solution : of one sensor pair; stations whose root was not used do not enter.
    temp_degc : [n] [°C]; s0 alone where none is known.
    order : of the polynomial; by default the average of all that the stations carry, at most
        cubic.
    turn : turn of the gyro, with the derivatives of the roots by it [1/°], which is measured where
        the stations separate it from s(T); with its size where that is stated.
    log : the part of s that the stations of a log share.
    noise : of a reading, which goes with s(T) into the file.
    history : prior of s. A single root is s0 and does not determine the scatter, which is then
        that of the prior.

    Raises
    ------
    FitError
        Fewer usable stations than coefficients, or temperatures that do not vary for an order above
        zero; logs that coincide with temperature.

    """
    # 1. The roots, over the temperature mapped to [-1, 1].
    with_degc = bool(np.isfinite(temp_degc).any())
    if not with_degc:
        temp_degc, order = np.zeros(temp_degc.size), 0
    used = (solution.weight > 0.0) & np.isfinite(temp_degc)
    if not used.any():
        raise FitError("no usable root of s has a temperature", hint="add temp_case_degc")
    degc = temp_degc[used]
    middle, half = polynomial.middle_and_half(degc)
    if order and degc.size == 1:
        raise FitError(f"1 usable root of s for s(T) of order {order}", hint="add stations")
    if order and half == 0.0:
        raise FitError(
            f"one temperature, {middle:g} °C, for s(T) of order {order}",
            hint="add other temperatures",
        )
    limits = (float(degc.min()), float(degc.max()))
    half, valid = half or 1.0, limits if with_degc else None
    # a root that states no uncertainty would be the only one that counts
    u = solution.s_root_uncertainty[used]
    typical = float(np.median(u))
    levels = None if log is None else np.unique(log.level[used], return_inverse=True)[1]
    roots = StationRoots(
        s=solution.s_root[used],
        u=np.maximum(u, 1e-3 * typical if typical > 0.0 else 1.0),
        x=(degc - middle) / half,
        turn=np.zeros(degc.size) if turn is None else turn.loading[used, 0],
        log=np.zeros(degc.size, dtype=np.int64) if levels is None else levels,
    )
    by_latitude = np.radians(solution.root_slopes[used, 4])
    if degc.size == 1:
        scatter = history.standard_uncertainty
        model = ScaleModel(roots.s, u[:, None] ** 2, scatter, valid, noise)
        prior = ScalePrior(np.full(used.size, history.s), np.full(used.size, scatter))
        return ScaleFit(model, used, prior, roots, by_latitude, np.eye(1))

    # 2. Orders averaged, each with the turn and the scatter of logs and stations.
    tried_orders: Sequence[int] = [order or 0]
    if order is None:
        tried_orders = orders(degc.size, polynomial.count_levels(degc), HIGHEST_ORDER)
    highest = tried_orders[-1]
    measurable = turn is not None and degc.size - highest - 2 >= SPARE
    separable = measurable and _separates_turn(roots, highest)
    fit = average(_fit_orders(roots, tried_orders, shared_errors(roots, log), with_turn=separable))
    to_raw = np.asarray(polynomial.to_raw_powers(middle, half, highest), dtype=np.float64)

    # 3. The turn of the gyro [°]; one that noise may explain has no uncertainty of its own.
    # Azimuths are corrected without it: they are as uncertain as the turn which the roots show,
    # with its standard uncertainty, and at least by the stated one.
    angle = u_angle = 0.0
    flags = [*warn_of_few_levels([size for size in fit.shared if size.error.group == "log"])]
    if separable:
        from scipy.special import stdtr

        estimate = fit.of(lambda p: p[-1:])
        angle, u_angle = float(estimate.value[0]), float(estimate.u[0])
        if abs(angle) < LEAST_DEG:
            angle = u_angle = 0.0
        elif 2.0 * float(stdtr(estimate.dof[0], -abs(angle) / u_angle)) > BY_CHANCE:
            u_angle = 0.0
    elif measurable:
        flags.append(Remark(ONE_ATTITUDE))
    if abs(angle) > SHOWN * u_angle > 0.0:
        flags.append(
            f"the roots of s show a gyro that is turned by {angle:.3f}° ± {u_angle:.2g}° against"
            " the accelerometers about the tool axis, expected 0°: it is in the uncertainty of the"
            " azimuth; align the sensors and measure again"
        )
    stated_deg = 0.0 if turn is None else turn.size or 0.0
    turn_deg = max(stated_deg, float(np.hypot(angle, u_angle)))
    components = components_of(fit.shared)
    if turn_deg:
        of_turn = Component(MOUNTING, "gyro turn", turn_deg, "deg", u_angle or turn_deg, 1)
        components = (*components, of_turn)
    model = ScaleModel(
        to_raw @ fit.parameters[:-1],
        fit.restated(lambda p: to_raw @ p[:-1]).total_covariance,
        float(np.linalg.norm([size.value for size in fit.shared])),
        valid,
        noise,
        turn_deg,
    )
    x = (np.clip(temp_degc, *limits) - middle) / half
    left_out = _leave_out(fit, x, roots, used)
    return ScaleFit(
        *(model, used, left_out, roots, by_latitude, to_raw),
        *(fit, (angle, u_angle), components, tuple(flags)),
    )


def _separates_turn(roots: StationRoots, order: int) -> bool:
    """Whether derivatives by a turn are other than a polynomial of the temperature."""
    powers = np.vander(roots.x, order + 1, increasing=True) / roots.u[:, None]
    turn = roots.turn / roots.u
    # in one fixed fixture the derivative is a polynomial of T but for noise: any turn would fit it
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


def _leave_out(fit: Fit, x: Array, roots: StationRoots, used: Mask) -> ScalePrior:
    """s(T) [n] at each station, at mapped temperatures [n], without its own root, and its standard
    uncertainty with the scatter.

    Without row i the parameters change by G_i (P r)_i / P_ii, and their covariance grows by
    G_i G_iᵀ / P_ii; G is the gain, r the residual, P = V⁻¹ (I - J G) (Cook 1977).
    """
    design = np.column_stack([np.vander(x, len(fit.parameters) - 1, increasing=True), 0.0 * x])
    values, variances = [], []
    for member in fit.members:
        P = np.diag(member.precision(np.eye(len(roots.s)) - member.jacobian @ member.gain))
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

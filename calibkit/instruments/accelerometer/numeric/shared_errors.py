"""Errors that dwells of a triad share, as effects of a least-squares fit.

A soak shares a zero, an attitude the error of the table's index: these are always estimated. A
scale factor of each soak, the tilt of the table's base, the eccentricity of its encoders and
second-order errors of the sensors that the model lacks are kept where the likelihood asks for them.
A zero that drifts with time is estimated wherever the log tells the time. Residuals are components
along three axes, or lengths along gravity: each has a dwell and a direction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.numeric import lack_of_fit
from calibkit.numeric.least_squares import components, shared_fit
from calibkit.numeric.least_squares.components import Effect, Known
from calibkit.numeric.least_squares.shared_fit import SharedFit

State = Callable[[Sequence[Effect], Sequence[Effect]], tuple[Sequence[Effect], Sequence[Effect]]]
"""Effects and candidates → those of the groups that a recipe names, with what it states of them."""

SAME_SOAK_DEGC = 2.0
"""Change of temperature from a dwell to the next [°C] above which a new soak begins."""
SAME_ATTITUDE = 5e-3
"""Distance of reference vectors [g] below which attitudes are the same: 0.3°."""
MOST_DWELLS = 6_000
"""Dwells, evenly spread over more, from which shared errors are estimated."""
SEPARATE = 1e-6
"""Share of a drift's length that the coefficients must leave, so that the data separate the two."""
SECOND_ORDER = "sensor", "second order"
LACKING = "lacking terms", "scale"
"""What stands for errors of second order where the model has no coefficients for them."""
DRIFT = "session", "drift"
SET_UP = "fixture", "set-up"
WHOLE = Known(0.8, bound=True)
"""Standard deviation for an error of 1: U of 95 % holds it beside a noise whose U is as large."""
LARGEST_SECOND_ORDER = 1e-3
"""Error of second order [1/g] beyond that of any sensor that is worth a calibration."""
ANY_SIZE = Known(1e-3, bound=True)
"""Drift of the zero [g/h] beyond that of any sensor that is worth a calibration: U holds as much
of it as the data allow, however small it looks.
"""
LEAST_NOISE_G = 1e-15
"""Noise [g] of a residual that is rounding."""
STEPS = 2
"""Linearisations of a nonlinear fit that starts where ordinary least squares ended."""


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What n dwells have in common."""

    soak: Integers
    """[n], number of the soak."""
    hours: Array | None
    """[n], time since the first dwell [h]; None where the logs do not tell."""
    gravity: Array
    """Reference vectors [n, 3] [g], or corrected indications where attitudes are unknown."""
    inclination: Array | None = None
    """[n] [rad]; None where attitudes are unknown."""
    toolface: Array | None = None
    """[n] [rad]."""

    @property
    def attitude(self) -> Integers:
        """Number [n] of the attitude that a dwell repeats."""
        number = np.full(len(self.gravity), -1)
        while (rest := np.flatnonzero(number < 0)).size:
            apart = np.linalg.norm(self.gravity[rest] - self.gravity[rest[0]], axis=1)
            number[rest[apart < SAME_ATTITUDE]] = number.max() + 1
        return number

    def of_dwells(self, chosen: Integers) -> "Circumstances":
        """Circumstances of some of the dwells."""
        fields = (self.hours, self.gravity, self.inclination, self.toolface)
        return Circumstances(
            self.soak[chosen],
            *(None if field is None else field[chosen] for field in fields),  # type: ignore[arg-type]
        )


def number_soaks(temperature: Array, log: Integers) -> Integers:
    """Number [n] of the soak of each dwell, from temperatures [n] [°C] in the order of the logs and
    the number of the log [n].

    A soak ends where the temperature steps or the log does. Where that leaves hardly a dwell to a
    soak, the dwells are not in the order of the soaks: those of one level of temperature are one.
    """
    starts = np.diff(temperature, prepend=temperature[:1])
    new = (np.abs(starts) > SAME_SOAK_DEGC) | (np.diff(log, prepend=log[:1]) != 0)
    soak = np.cumsum(new)
    if 3 * (soak[-1] + 1) <= len(soak):
        return soak
    order = np.argsort(temperature, kind="stable")
    level = np.empty(len(order), dtype=np.int64)
    level[order] = np.cumsum(np.diff(temperature[order], prepend=-np.inf) > SAME_SOAK_DEGC)
    return np.asarray(np.unique(level, return_inverse=True)[1]).reshape(-1)


@dataclass(frozen=True, slots=True)
class Residuals:
    """Where the residuals [m] of a fit to dwells point."""

    dwell: Integers
    """[m], number of the dwell."""
    direction: Array
    """Unit vectors [m, 3]: a component, or along gravity for a length."""
    channel: Integers
    """[m], sensors with a noise of their own."""

    @classmethod
    def of_components(cls, dwells: int) -> "Residuals":
        """Residuals of three components, dwell by dwell."""
        axis = np.tile(np.arange(3), dwells)
        return cls(np.repeat(np.arange(dwells), 3), np.eye(3)[axis], axis)

    @classmethod
    def of_lengths(cls, corrected: Array) -> "Residuals":
        """Residuals of the lengths of corrected vectors [n, 3]."""
        count = len(corrected)
        unit = corrected / np.linalg.norm(corrected, axis=1)[:, None]
        return cls(np.arange(count), unit, np.zeros(count, dtype=np.int64))

    @property
    def per_dwell(self) -> int:
        """Residuals of one dwell."""
        return 3 if self.channel.any() else 1

    def along(self, slopes: Array) -> Array:
        """Derivatives [m, k] of the residuals from those [n, 3, k] of the reference vectors."""
        return np.asarray(np.einsum("mi,mik->mk", self.direction, slopes[self.dwell]))


def list_effects(where: Circumstances, at: Residuals) -> tuple[Effect, ...]:
    """Effects that the residuals can show: zeros of the soaks, and where attitudes are repeated
    their index errors, which are noise otherwise.
    """
    one = np.tile(np.eye(3), (len(where.soak), 1, 1))
    found = [Effect("soak", "zero", where.soak[at.dwell], at.along(one))]
    repeated = 2 * (where.attitude.max() + 1) <= len(where.soak)
    if where.inclination is not None and where.toolface is not None and repeated:
        up, across = angle_slopes(where.inclination, where.toolface)
        index = np.stack([up, across], axis=2)
        found.append(Effect("attitude", "index", where.attitude[at.dwell], at.along(index)))
    return tuple(found)


def list_candidates(where: Circumstances, at: Residuals) -> tuple[Effect, ...]:
    """Effects of the equipment and the sensors that are kept where the likelihood asks for them,
    and the set-up in the fixture, which it cannot tell from misaligned axes.
    """
    diagonal = np.eye(3) * where.gravity[:, None, :]
    tried = [("soak", "scale", where.soak, diagonal)]
    every = np.zeros(len(where.soak), dtype=np.int64)
    tried.append((*SECOND_ORDER, every, diagonal * where.gravity[:, None, :]))
    if where.hours is not None:
        hours = where.hours - where.hours.mean()
        tried.append((*DRIFT, every, np.eye(3) * hours[:, None, None]))
    if where.inclination is not None and where.toolface is not None:
        tilt, turn = where.inclination, where.toolface
        up, across = angle_slopes(tilt, turn)
        around = across * np.sin(tilt)[:, None]
        eccentric = [up * f(tilt)[:, None] for f in (np.sin, np.cos)]
        eccentric += [around * f(turn)[:, None] for f in (np.sin, np.cos)]
        turns = np.swapaxes(np.cross(np.eye(3), where.gravity[:, None, :]), 1, 2)
        tried += [
            (*SET_UP, every, turns),
            ("table", "tilt", every, np.stack([up, across], axis=2)),
            ("table", "eccentricity", every, np.stack(eccentric, axis=2)),
        ]
    return tuple(
        Effect(group, effect, labels[at.dwell], at.along(slopes))
        for group, effect, labels, slopes in tried
    )


def angle_slopes(inclination: Array, toolface: Array) -> tuple[Array, Array]:
    """Unit vectors [n, 3] in which gravity moves with inclination, and at right angles to it."""
    sine, cosine = np.sin(toolface), np.cos(toolface)
    up = [-np.cos(inclination) * cosine, np.cos(inclination) * sine, -np.sin(inclination)]
    return np.stack(up, axis=1), np.stack([sine, cosine, np.zeros(len(sine))], axis=1)


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Residuals that differ from group to group, beside all errors that dwells share."""

    what: str
    """Which residuals: "attitude 3, x"."""
    size_g: float
    expanded_g: float
    """U of a corrected component."""


@dataclass(frozen=True, slots=True)
class Refined:
    """Parameters of a fit with errors that dwells share."""

    parameters: Array
    """[p]."""
    shared: SharedFit
    """Its coefficients are the last step of the parameters."""
    used: Mask
    """[m], residuals that the fit used, of all dwells."""
    flags: tuple[str, ...]
    lack_of_fit: tuple[Unexplained, ...]


Refine = Callable[..., Refined]
"""`refine` for the circumstances of a set of dwells."""


def refine(
    linearised: Callable[[Array, Integers], tuple[Array, Array]],
    start: Array,
    *,
    where: Circumstances,
    at: Residuals,
    weights: Array,
    used: Mask,
    leave_out: bool,
    state: State,
    names: Sequence[str] = (),
    nuisance: Sequence[Effect] = (),
) -> Refined:
    """Fit again from the solution of ordinary least squares, now with errors that dwells share.

    Parameters
    ----------
    linearised : residuals [m] (corrected less reference) and derivatives [m, p] at parameters [p],
        of the chosen dwells.
    start : [p].
    weights : [m], 1/variance of the noise, or 1.
    used : [m], residuals that are no outliers so far.
    leave_out : whether residuals are judged.
    nuisance : further effects, of all residuals.
    """
    dwells = np.arange(0, len(where.soak), 1 + (len(where.soak) - 1) // MOST_DWELLS)
    rows = np.isin(at.dwell, dwells)
    some = Residuals(
        np.repeat(np.arange(len(dwells)), at.per_dwell), at.direction[rows], at.channel[rows]
    )
    near = where.of_dwells(dwells)
    effects, candidates = state(list_effects(near, some), list_candidates(near, some))
    tried = (*effects, *candidates)
    effects = (*effects, *(one.of_rows(rows) for one in nuisance))
    values, inside = start, used[rows]
    for step in range(STEPS):
        residual, slopes = linearised(values, dwells)
        found = shared_fit.fit(
            *(slopes, -residual, effects, candidates),
            weights=weights[rows],
            channel=some.channel,
            used=inside,
            leave_out=leave_out,
            names=names,
        )
        values = values + found.found.coefficients
        lacking = () if step else _list_lacking_terms(found, tried, slopes, near, some)
        effects, candidates, inside = (*found.effects, *lacking), (), found.used
    used = used.copy()
    used[rows] = inside
    found, flags = _with_any_drift(found, tried, (slopes, -residual, weights[rows]))
    return Refined(values, found, used, flags, _find_unexplained(near, some, found, slopes))


def _find_unexplained(
    where: Circumstances, at: Residuals, fitted: SharedFit, slopes: Array
) -> tuple[Unexplained, ...]:
    """Residuals that differ from group to group where shared errors are taken out."""
    from scipy.special import stdtrit

    left = fitted.residuals - fitted.found.shared(fitted.effects)
    quarter = np.minimum(4 * where.soak // (where.soak.max() + 1), 3)
    groups = {"soak": where.soak, "attitude": where.attitude, "quarter of the soaks": quarter}
    labels = {
        name: np.where(fitted.used, at.per_dwell * label[at.dwell] + at.channel, -1)
        for name, label in groups.items()
    }
    u = np.sqrt(np.einsum("mp,pq,mq->m", slopes, fitted.found.covariance, slopes))
    k = float(stdtrit(float(np.median(fitted.found.effective_dof)), 0.975))
    expanded = k * float(np.sqrt(np.mean(u**2)))
    axes = ("along x", "along y", "along z") if at.per_dwell == 3 else ("of the length",)
    return tuple(
        Unexplained(
            f"{one.group} {1 + one.level // at.per_dwell}, {axes[one.level % at.per_dwell]}",
            one.size,
            expanded,
        )
        for one in lack_of_fit.find(left, labels)
    )


def _list_lacking_terms(
    fitted: SharedFit, tried: Sequence[Effect], slopes: Array, where: Circumstances, at: Residuals
) -> tuple[Effect, ...]:
    """What stands for second-order errors of the sensors that the coefficients lack.

    A corrected component a has an error b a²: U of a scale factor of that size, b |a|, holds it in
    every direction. Of lengths, a bias takes most of an error that is too small for the likelihood
    to ask for: such may lie anywhere below that size.
    """
    own = [one for one in tried if (one.group, one.effect) == SECOND_ORDER]
    if not own:
        return ()
    # of a sensor that gravity never lies along nothing is left
    left = np.maximum(_beside(slopes, own[0].loading), SEPARATE)
    found, noise = fitted.found, max(fitted.found.residual_rms, LEAST_NOISE_G) / left
    effects = [(one.group, one.effect) for one in fitted.effects]
    if SECOND_ORDER in effects:
        spread = next(c.value for c in found.components if (c.group, c.effect) == SECOND_ORDER)
        unsure = spread * noise / np.hypot(spread, noise)
        size = np.hypot(found.predicted[effects.index(SECOND_ORDER)][0], unsure)
        along = at.along(np.eye(3) * size * where.gravity[:, None, :])
        return (Effect(*LACKING, np.zeros(len(along), dtype=np.int64), along, WHOLE),)
    if at.per_dwell > 1:
        return ()
    # anywhere below what would be asked for, of three sensors alike, as a rectangular distribution
    hidden = float(np.sqrt(shared_fit.ASKED_FOR / 3.0 / np.mean(noise**-2.0)))
    return (replace(own[0], known=Known(min(hidden, LARGEST_SECOND_ORDER), bound=True)),)


def _beside(slopes: Array, loading: Array) -> Array:
    """Lengths [k] of what coefficients with derivatives [m, p] leave of loadings [m, k]."""
    q, _ = np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0))
    return np.asarray(np.linalg.norm(loading - q @ (q.T @ loading), axis=0))


def _with_any_drift(
    fitted: SharedFit,
    tried: Sequence[Effect],
    problem: tuple[Array, Array, Array],
) -> tuple[SharedFit, tuple[str, ...]]:
    """Fit whose U holds any drift of the zero that the data allow, where one was `tried`;
    coefficients and components stay. `problem` holds slopes [m, p], target and weights [m].
    """
    drifts = [one for one in tried if (one.group, one.effect) == DRIFT and one.known is None]
    if not drifts:
        return fitted, ()
    slopes, target, weights = problem
    left = _beside(slopes, drifts[0].loading)
    if np.any(left <= SEPARATE * np.linalg.norm(drifts[0].loading, axis=0)):
        flag = (
            "a zero that drifts with time cannot be separated from its temperature coefficients,"
            " and the uncertainties leave it out: return to the first temperature at the end, or"
            " state the drift of the session in [[errors.component]]"
        )
        return fitted, (flag,)
    others = [one for one in fitted.effects if (one.group, one.effect) != DRIFT]
    part = [one.of_rows(fitted.used) for one in (*others, replace(drifts[0], known=ANY_SIZE))]
    used = fitted.used
    wide = components.fit(slopes[used], target[used], part, weights=weights[used])
    found = replace(
        wide,
        coefficients=fitted.found.coefficients,
        components=fitted.found.components,
        predicted=fitted.found.predicted,
    )
    return replace(fitted, found=found), ()

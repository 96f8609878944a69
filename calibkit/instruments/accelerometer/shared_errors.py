"""Errors that dwells of a triad share.

A soak shares a zero, an attitude the error of the table's index: these are always estimated. What
is optional is kept where the likelihood asks for it: a scale factor of each soak, a zero that
settles within the soaks, a memory of the attitude before, second-order errors of the sensors that
the model lacks, the tilt of the table's base, the eccentricity of its encoders, and a zero that
drifts with time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.fit.shared import Shared
from calibkit.fit.solve import ASKED_FOR, Fit
from calibkit.numeric import lack_of_fit

SAME_SOAK_DEGC = 2.0
"""Change of temperature from a dwell to the next [°C] above which a new soak begins."""
SAME_ATTITUDE = 5e-3
"""Distance of reference vectors [g] below which attitudes are the same: 0.3°."""
SETTLING_S = (400.0, 1200.0, 3600.0)
"""Time constants [s] whose sum follows a zero that settles in a soak: a single one that fits best
leaves the zero at the end of the soak off, at a small U.
"""
UNTIMED_DWELL_S = 60.0
"""Time from a dwell to the next [s] where none is logged."""
ZERO = "soak", "zero"
INDEX = "attitude", "index"
SECOND_ORDER = "sensor", "second order"
DRIFT = "session", "drift"
SET_UP = "fixture", "set-up"
UNITS = {
    ZERO: "g",
    INDEX: "rad",
    SET_UP: "rad",
    ("table", "tilt"): "rad",
    ("table", "eccentricity"): "rad",
    ("soak", "scale"): "1",
    ("soak", "settling"): "g",
    ("attitude", "memory"): "1",
    SECOND_ORDER: "1/g",
    DRIFT: "g/h",
}
"""Errors that dwells share and the units of their standard deviations."""
LARGEST = {"g": 0.05, "rad": 0.1, "1": 0.02, "1/g": 0.02, "g/h": 0.05}
"""Unit → size of a shared error beyond that of any table and of any sensor that is worth a
calibration.
"""
LACKING = "lacking terms", "scale"
"""What stands for errors of second order where the model has no coefficients for them."""
HALF_INTERVAL = 0.8
"""Standard deviation for an error of 1: U of 95 % holds it beside a noise whose U is as large."""
LARGEST_SECOND_ORDER = 1e-3
"""Error of second order [1/g] beyond that of any sensor that is worth a calibration."""
SEPARATE = 1e-6
"""Share of an error's length that the parameters must leave, so that the data separate the two."""


@dataclass(frozen=True, slots=True)
class Circumstances:
    """What n dwells have in common."""

    soak: Integers
    """[n], number of the soak."""
    hours: Array | None
    """[n], time since the first dwell [h]; None where the logs do not tell."""
    gravity: Array
    """Reference vectors [n, 3] [g], or corrected indications where attitudes are unknown."""
    log: Integers
    """[n], number of the log."""
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

    @property
    def seconds_in_soak(self) -> Array:
        """[n], time since the first dwell of the soak [s]; by their number where none is logged."""
        count = np.arange(len(self.soak), dtype=np.float64)
        time = UNTIMED_DWELL_S * count if self.hours is None else 3600.0 * self.hours
        begin = np.full(int(self.soak.max()) + 1, np.inf)
        np.minimum.at(begin, self.soak, time)
        return np.asarray(time - begin[self.soak], dtype=np.float64)

    @property
    def gravity_before(self) -> Array:
        """Gravity [n, 3] in the attitude before, 0 at the start of a log."""
        before = np.roll(self.gravity, 1, axis=0)
        before[np.diff(self.log, prepend=-1) != 0] = 0.0
        return before


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


def list_errors(where: Circumstances, along: Array) -> list[Shared]:
    """Errors that the residuals can show.

    `along` [n, m, 3] are the directions of the m residuals of each dwell: the three axes, or the
    one along gravity of a length.
    """
    dwells, per_dwell, _ = along.shape
    every = np.zeros(dwells, dtype=np.int64)

    def error(
        group_effect: tuple[str, str],
        level: Integers,
        slopes: Array,
        *,
        optional: bool = True,
    ) -> Shared:
        """An error with derivatives [n, 3, k] of the corrected vector."""
        loading = np.einsum("nmi,nik->nmk", along, slopes).reshape(dwells * per_dwell, -1)
        group, effect = group_effect
        return Shared(
            group=group,
            effect=effect,
            level=np.repeat(level, per_dwell),
            loading=loading,
            unit=UNITS[group_effect],
            largest=LARGEST[UNITS[group_effect]],
            optional=optional,
        )

    axes = np.broadcast_to(np.eye(3), (dwells, 3, 3))
    scale = axes * where.gravity[:, None, :]
    listed = [error(ZERO, where.soak, axes, optional=False)]
    listed += _of_the_table(where, error)
    settling = np.exp(-where.seconds_in_soak[:, None] / SETTLING_S)
    decays = np.einsum("nij,nk->nijk", axes, settling).reshape(dwells, 3, -1)
    before = axes * where.gravity_before[:, None, :]
    listed += [
        error(("soak", "scale"), where.soak, scale),
        error(("soak", "settling"), every, decays),
        error(("attitude", "memory"), every, before),
        error(SECOND_ORDER, every, scale * where.gravity[:, None, :]),
    ]
    if where.hours is not None:
        hours = where.hours - where.hours.mean()
        listed.append(error(DRIFT, every, axes * hours[:, None, None]))
    return listed


def _of_the_table(where: Circumstances, error: Callable[..., Shared]) -> list[Shared]:
    """Errors of the table and of the set-up on it."""
    tilt, turn = where.inclination, where.toolface
    if tilt is None or turn is None:
        return []
    every = np.zeros(len(tilt), dtype=np.int64)
    up, across = angle_slopes(tilt, turn)
    around = across * np.sin(tilt)[:, None]
    eccentric = [up * f(tilt)[:, None] for f in (np.sin, np.cos)]
    eccentric += [around * f(turn)[:, None] for f in (np.sin, np.cos)]
    turns = np.swapaxes(np.cross(np.eye(3), where.gravity[:, None, :]), 1, 2)
    both = np.stack([up, across], axis=2)
    attitude = where.attitude
    listed = [
        error(SET_UP, every, turns),
        error(("table", "tilt"), every, both),
        error(("table", "eccentricity"), every, np.stack(eccentric, axis=2)),
    ]
    if 2 * (attitude.max() + 1) <= len(where.soak):  # else it is noise
        listed.insert(0, error(INDEX, attitude, both, optional=False))
    return listed


def angle_slopes(inclination: Array, toolface: Array) -> tuple[Array, Array]:
    """Unit vectors [n, 3] in which gravity moves with inclination, and at right angles to it."""
    sine, cosine = np.sin(toolface), np.cos(toolface)
    up = [-np.cos(inclination) * cosine, np.cos(inclination) * sine, -np.sin(inclination)]
    return np.stack(up, axis=1), np.stack([sine, cosine, np.zeros(len(sine))], axis=1)


def lacking_terms(
    fit: Fit, listed: Sequence[Shared], jacobian: Array, scale: Array, per_dwell: int
) -> list[Shared]:
    """What stands for second-order errors of the sensors that the model lacks, in U alone.

    A corrected component a has an error b a²: U of a scale factor of that size, b |a|, holds it in
    every direction. Of lengths, a bias takes most of an error that is too small for the likelihood
    to ask for, h = √(6/3 / mean(left²/σ²)): such may lie anywhere below, of three sensors alike.

    `listed` are the errors offered to the fit, `jacobian` [n, p] is that of its residuals, `scale`
    [n, 3] their derivatives by a scale factor of each axis.
    """
    offered = [one for one in listed if (one.group, one.effect) == SECOND_ORDER]
    if not offered:
        return []
    left = beside(jacobian, offered[0].loading) / fit.noise[:, None]
    # of a sensor that gravity never lies along nothing is left
    information = np.maximum(np.sum(left**2, axis=0), 1e-30)
    kept = [size for size in fit.shared if (size.error.group, size.error.effect) == SECOND_ORDER]
    if kept:
        unsure = 1.0 / (information + max(kept[0].value, 1e-30) ** -2.0)
        size = np.sqrt(kept[0].errors[0] ** 2 + unsure)
        return [_bound(LACKING, scale * size, HALF_INTERVAL, "1")]
    if per_dwell > 1:
        return []
    hidden = float(np.sqrt(ASKED_FOR / 3.0 / np.mean(information)))
    largest = min(hidden, LARGEST_SECOND_ORDER)
    return [_bound(SECOND_ORDER, offered[0].loading, largest, "1/g")]


def possible_drift(
    fit: Fit, listed: Sequence[Shared], jacobian: Array
) -> tuple[list[Shared], tuple[str, ...]]:
    """Drift of the zero as large as the data allow, in U however small it looks, and a flag where
    it cannot be separated from the coefficients.
    """
    kept = [(size.error.group, size.error.effect) for size in fit.shared]
    drifts = [
        one
        for one in listed
        if (one.group, one.effect) == DRIFT and one.size is None and DRIFT not in kept
    ]
    if not drifts:
        return [], ()
    loading = drifts[0].loading
    length = np.linalg.norm(loading, axis=0)
    if np.any(np.linalg.norm(beside(jacobian, loading), axis=0) <= SEPARATE * length):
        flag = (
            "a zero that drifts with time cannot be separated from its temperature coefficients,"
            " and the uncertainties leave it out: return to the first temperature at the end, or"
            " state the drift of the session in [[errors.component]]"
        )
        return [], (flag,)
    drift, u = fit.further_error(jacobian, loading)
    return [_bound(DRIFT, loading * np.hypot(drift, u), 1.0, "g/h")], ()


def _bound(group_effect: tuple[str, str], loading: Array, size: float, unit: str) -> Shared:
    """An error below a size, of all residuals."""
    group, effect = group_effect
    level = np.zeros(len(loading), dtype=np.int64)
    return Shared(
        group=group,
        effect=effect,
        level=level,
        loading=loading,
        unit=unit,
        size=size,
        bound=True,
    )


def beside(jacobian: Array, loading: Array) -> Array:
    """What parameters with derivatives [n, p] leave of loadings [n, k], by least squares."""
    q, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    return np.asarray(loading - q @ (q.T @ loading), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Residuals that differ from group to group, beside all errors that dwells share."""

    what: str
    """Which residuals: "attitude 3, along x"."""
    size_g: float
    expanded_g: float
    """U of a corrected component."""


def find_unexplained(
    where: Circumstances, fit: Fit, jacobian: Array, per_dwell: int
) -> tuple[Unexplained, ...]:
    """Residuals that differ from group to group where shared errors are taken out."""
    from scipy.special import stdtrit

    quarter = np.minimum(4 * where.soak // (where.soak.max() + 1), 3)
    groups = {"soak": where.soak, "attitude": where.attitude, "quarter of the soaks": quarter}
    labels = {}
    for name, level in groups.items():
        each = per_dwell * level[:, None] + np.arange(per_dwell)
        labels[name] = np.where(fit.used, each.ravel(), -1)
    u = np.sqrt(np.einsum("np,pq,nq->n", jacobian, fit.covariance, jacobian))
    k = float(stdtrit(float(np.median(fit.of(lambda p: p).dof)), 0.975))
    expanded = k * float(np.sqrt(np.mean(u**2)))
    axes = ("along x", "along y", "along z") if per_dwell == 3 else ("of the length",)
    return tuple(
        Unexplained(
            f"{one.group} {1 + one.level // per_dwell}, {axes[one.level % per_dwell]}",
            one.size,
            expanded,
        )
        for one in lack_of_fit.find(-fit.noise_residual, labels)
    )

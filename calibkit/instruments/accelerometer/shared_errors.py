"""Errors that dwells of a triad share.

A soak shares a zero, an attitude the error of the table's index: these are always estimated. What
is optional is kept where the likelihood asks for it: a scale factor of each soak, a zero that
settles within the soaks, a memory of the attitude before, second-order errors of the sensors that
the model lacks, the tilt of the table's base, the eccentricity of its encoders, and a zero that
drifts with time.
"""

from collections.abc import Sequence

import numpy as np

from calibkit.fit.shared import Shared
from calibkit.fit.solve import ASKED_FOR, Fit
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.recipe.shared_errors import state_sizes

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
TILT = "table", "tilt"
ECCENTRICITY = "table", "eccentricity"
SETTLING = "soak", "settling"
UNITS = {
    ZERO: "g",
    INDEX: "rad",
    SET_UP: "rad",
    TILT: "rad",
    ECCENTRICITY: "rad",
    ("soak", "scale"): "1",
    SETTLING: "g",
    ("attitude", "memory"): "1",
    SECOND_ORDER: "1/g",
    DRIFT: "g/h",
}
"""Errors that dwells share and the units of their standard deviations."""
LARGEST = {"g": 0.05, "rad": 0.1, "1": 0.02, "1/g": 0.02, "g/h": 0.05}
"""Unit → size of a shared error beyond that of any table and of any sensor that is worth a
calibration.
"""
HALF_INTERVAL = 0.8
"""Standard deviation for an error of 1: U of 95 % holds it beside a noise whose U is as large."""
LARGEST_SECOND_ORDER = 1e-3
"""Error of second order [1/g] beyond that of any sensor that is worth a calibration."""
SEEN = 0.05
"""Share of an optional error, or of the product of two components of a direction that tells the
angle between their axes, that the parameters must leave. Of six faces that are set up within 2°
they leave 0.02 of the products, 0.04 of second-order errors and 0.007 of a zero that settles; of 26
attitudes 0.24, of these in seven soaks 0.64 and 0.13.
"""
SEPARATE = 1e-6
"""Share of an error's length that the parameters must leave, so that the data separate the two."""


def number_attitudes(gravity: Array) -> Integers:
    """Number [n] of the attitude that each dwell repeats, from gravity vectors [n, 3] [g]."""
    number = np.full(len(gravity), -1)
    while (unnumbered := np.flatnonzero(number < 0)).size:
        distance = np.linalg.norm(gravity[unnumbered] - gravity[unnumbered[0]], axis=1)
        number[unnumbered[distance < SAME_ATTITUDE]] = number.max() + 1
    return number


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


def state_errors(
    dwells: DwellSet, gravity: Array, directions: Array, spec: AccelerometerRecipe
) -> list[Shared]:
    """Errors that the residuals of n dwells can show, with the sizes that the recipe states,
    without what it makes a parameter; raises RecipeError for a stated error that there is not.

    `gravity` [n, 3] [g] are the reference vectors, or corrected indications where attitudes are
    unknown; `directions` [n, m, 3] those of the m residuals of each dwell: the three axes, or the
    one along gravity of a length.
    """
    count, per_dwell, _ = directions.shape
    soak, session = number_soaks(dwells.temperature, dwells.log), np.zeros(count, dtype=np.int64)
    lengths, one_soak = per_dwell == 1, soak.max() == 0
    attitude = session if lengths else number_attitudes(gravity)
    # several logs have no common start
    timed = dwells.log.max() == 0 and np.isfinite(dwells.time).all() and not one_soak

    # 1. Derivatives [n, 3, k] of the corrected vector by the k errors of a level.
    axes = np.broadcast_to(np.eye(3), (count, 3, 3))
    by_scale = axes * gravity[:, None, :]
    theta, phi = np.radians(dwells.inclination), np.radians(dwells.toolface)
    up, sideways = angle_slopes(theta, phi)
    by_angles, by_toolface = np.stack([up, sideways], axis=2), sideways * np.sin(theta)[:, None]
    by_set_up = np.swapaxes(np.cross(np.eye(3), gravity[:, None, :]), 1, 2)
    # an encoder that is off its axis reads wrong by a sine over the turn
    eccentric = [up * f(theta)[:, None] for f in (np.sin, np.cos)]
    eccentric += [by_toolface * f(phi)[:, None] for f in (np.sin, np.cos)]
    seconds = dwells.time if timed else UNTIMED_DWELL_S * np.arange(count)
    begin = np.full(int(soak.max()) + 1, np.inf)
    np.minimum.at(begin, soak, seconds)
    settling = np.exp(-(seconds - begin[soak])[:, None] / SETTLING_S)
    by_settling = np.einsum("nij,nk->nijk", axes, settling).reshape(count, 3, -1)
    gravity_before = np.roll(gravity, 1, axis=0)
    gravity_before[np.diff(dwells.log, prepend=-1) != 0] = 0.0  # at the start of a log
    hours = (seconds - seconds.mean()) / SECONDS_PER_HOUR

    # 2. Every error that dwells can share: what has a level of its own, and its derivatives.
    errors = {
        ZERO: (soak, axes),
        INDEX: (attitude, by_angles),
        SET_UP: (session, by_set_up),
        TILT: (session, by_angles),
        ECCENTRICITY: (session, np.stack(eccentric, axis=2)),
        ("soak", "scale"): (soak, by_scale),
        SETTLING: (session, by_settling),
        ("attitude", "memory"): (session, axes * gravity_before[:, None, :]),
        SECOND_ORDER: (session, by_scale * gravity[:, None, :]),
        DRIFT: (session, axes * hours[:, None, None]),
    }

    # 3. Without those that these dwells cannot show (of lengths attitudes are unknown, and the
    # index error of attitudes that hardly repeat is noise), and what the recipe makes a parameter.
    triad = spec.affine
    absent = {
        INDEX: lengths or 2 * (attitude.max() + 1) > count,
        SET_UP: lengths or (triad.enabled and triad.fixture),
        TILT: lengths or (triad.enabled and triad.tilt),
        ECCENTRICITY: lengths,
        SECOND_ORDER: triad.enabled and triad.second_order,
        DRIFT: not timed,
    }
    candidates = [
        Shared(
            group=name[0],
            effect=name[1],
            level=np.repeat(level, per_dwell),
            loading=np.einsum("nmi,nik->nmk", directions, slopes).reshape(count * per_dwell, -1),
            unit=UNITS[name],
            largest=LARGEST[UNITS[name]],
            optional=name not in (ZERO, INDEX),
        )
        for name, (level, slopes) in errors.items()
        if not absent.get(name)
    ]
    # no dwell tells a set-up from axes that are turned together; a few wrong dwells at the begin of
    # a single soak look as if its zero settled
    indistinct = {SET_UP, SETTLING} if one_soak else {SET_UP}
    return [
        error
        for error in state_sizes(spec.errors, candidates)
        if (error.group, error.effect) not in indistinct or error.size is not None
    ]


def angle_slopes(inclination: Array, toolface: Array) -> tuple[Array, Array]:
    """Unit vectors [n, 3] in which gravity moves with inclination, and at right angles to it."""
    sine, cosine = np.sin(toolface), np.cos(toolface)
    up = [-np.cos(inclination) * cosine, np.cos(inclination) * sine, -np.sin(inclination)]
    return np.stack(up, axis=1), np.stack([sine, cosine, np.zeros(len(sine))], axis=1)


def bounded_errors(
    fit: Fit, candidates: Sequence[Shared], by_scale: Array, per_dwell: int
) -> tuple[tuple[Shared, ...], tuple[str, ...]]:
    """Errors that are in U alone, as large as the data allow, and flags.

    `candidates` are the errors that the dwells can show, `by_scale` [n, 3] derivatives of the
    residuals by a scale factor of each axis.

    A zero that drifts is in U however small it looks. Sensors have errors of second order that the
    model lacks: a corrected component a has an error b a², and U of a scale factor of that size,
    b |a|, holds it in every direction. Of lengths, a bias takes most of an error that is too small
    for the likelihood to ask for, h = √(6/3 / mean(left²/σ²)): such may lie anywhere below, of
    three sensors alike.
    """
    fitted, jacobian = {(s.error.group, s.error.effect): s for s in fit.shared}, fit.jacobian
    by_name = {(error.group, error.effect): error for error in candidates}
    bounded, flags = [], list[str]()
    Q, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    drift, second = by_name.get(DRIFT), by_name.get(SECOND_ORDER)
    if drift is not None and drift.size is None and DRIFT not in fitted:
        length = np.linalg.norm(drift.loading, axis=0)
        left = drift.loading - Q @ (Q.T @ drift.loading)
        if np.all(np.linalg.norm(left, axis=0) > SEPARATE * length):
            error, u = fit.further_error(jacobian, drift.loading)
            bounded.append((DRIFT, drift.loading * np.hypot(error, u), 1.0))
        else:
            flags.append(
                "a zero that drifts with time cannot be separated from its temperature"
                " coefficients, and the uncertainties leave it out: return to the first temperature"
                " at the end, or state the drift of the session in [[errors.component]]"
            )
    if second is not None:
        left = (second.loading - Q @ (Q.T @ second.loading)) / fit.noise[:, None]
        # of a sensor that gravity never lies along nothing is left
        information = np.maximum(np.sum(left**2, axis=0), 1e-30)
        if SECOND_ORDER in fitted:
            size_shown = fitted[SECOND_ORDER]
            unsure = 1.0 / (information + max(size_shown.value, 1e-30) ** -2.0)
            size = np.sqrt(size_shown.errors[0] ** 2 + unsure)
            bounded.append((("lacking terms", "scale"), by_scale * size, HALF_INTERVAL))
        elif per_dwell == 1:
            hidden = float(np.sqrt(ASKED_FOR / 3.0 / np.mean(information)))
            bounded.append((SECOND_ORDER, second.loading, min(hidden, LARGEST_SECOND_ORDER)))
    return tuple(
        Shared(
            group=name[0],
            effect=name[1],
            level=np.zeros(len(loading), dtype=np.int64),
            loading=loading,
            unit=UNITS.get(name, "1"),
            size=size,
            bound=True,
        )
        for name, loading, size in bounded
    ), tuple(flags)

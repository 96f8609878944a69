"""Errors that dwells of a triad share.

A soak shares a zero, an attitude the error of the table's index: these are always estimated. What
is optional is kept where the likelihood asks for it: a scale factor of each soak, a zero that
settles within the soaks, a memory of the attitude before, second-order errors of the sensors that
the model lacks, the tilt of the table's base, the eccentricity of its encoders, and a zero that
drifts with time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.coefficients import Criterion, at_most
from calibkit.fit.shared import Shared
from calibkit.fit.solve import ASKED_FOR, Fit
from calibkit.frame import Remark
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import lack_of_fit
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


def number_attitudes(gravity: Array) -> Integers:
    """Number [n] of the attitude that each dwell repeats, from gravity vectors [n, 3] [g]."""
    number = np.full(len(gravity), -1)
    while (rest := np.flatnonzero(number < 0)).size:
        apart = np.linalg.norm(gravity[rest] - gravity[rest[0]], axis=1)
        number[rest[apart < SAME_ATTITUDE]] = number.max() + 1
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


def find_circumstances(
    dwells: DwellSet, gravity: Array, spec: AccelerometerRecipe
) -> Circumstances:
    """What the dwells of all logs have in common, at gravity vectors [n, 3] [g]."""
    known = spec.reference.kind == "attitude"
    soak = number_soaks(dwells.temperature, dwells.log)
    timed = _tells_time(dwells) and soak.max() > 0
    return Circumstances(
        soak,
        dwells.time / 3600.0 if timed else None,
        gravity,
        dwells.log,
        np.radians(dwells.inclination) if known else None,
        np.radians(dwells.toolface) if known else None,
    )


def list_errors(where: Circumstances, along: Array) -> list[Shared]:
    """Errors that the residuals can show.

    `along` [n, m, 3] are the directions of the m residuals of each dwell: the three axes, or the
    one along gravity of a length.
    """
    dwells, per_dwell, _ = along.shape
    all_dwells = np.zeros(dwells, dtype=np.int64)
    listed: list[Shared] = []

    def add(
        group_effect: tuple[str, str], level: Integers, slopes: Array, *, optional: bool = True
    ) -> None:
        """List an error with derivatives [n, 3, k] of the corrected vector."""
        group, effect = group_effect
        unit = UNITS[group_effect]
        loading = np.einsum("nmi,nik->nmk", along, slopes).reshape(dwells * per_dwell, -1)
        listed.append(
            Shared(
                group=group,
                effect=effect,
                level=np.repeat(level, per_dwell),
                loading=loading,
                unit=unit,
                largest=LARGEST[unit],
                optional=optional,
            )
        )

    axes = np.broadcast_to(np.eye(3), (dwells, 3, 3))
    scale = axes * where.gravity[:, None, :]
    add(ZERO, where.soak, axes, optional=False)
    tilt, turn = where.inclination, where.toolface
    if tilt is not None and turn is not None:
        (up, across), attitude = angle_slopes(tilt, turn), number_attitudes(where.gravity)
        both, around = np.stack([up, across], axis=2), across * np.sin(tilt)[:, None]
        if 2 * (attitude.max() + 1) <= dwells:  # else it is noise
            add(INDEX, attitude, both, optional=False)
        add(SET_UP, all_dwells, np.swapaxes(np.cross(np.eye(3), where.gravity[:, None, :]), 1, 2))
        add(("table", "tilt"), all_dwells, both)
        # an encoder that is off its axis reads wrong by a sine over the turn
        eccentric = [up * f(tilt)[:, None] for f in (np.sin, np.cos)]
        eccentric += [around * f(turn)[:, None] for f in (np.sin, np.cos)]
        add(("table", "eccentricity"), all_dwells, np.stack(eccentric, axis=2))
    add(("soak", "scale"), where.soak, scale)
    seconds = UNTIMED_DWELL_S * np.arange(dwells) if where.hours is None else 3600.0 * where.hours
    begin = np.full(int(where.soak.max()) + 1, np.inf)
    np.minimum.at(begin, where.soak, seconds)
    settling = np.exp(-(seconds - begin[where.soak])[:, None] / SETTLING_S)
    add(
        ("soak", "settling"),
        all_dwells,
        np.einsum("nij,nk->nijk", axes, settling).reshape(dwells, 3, -1),
    )
    gravity_before = np.roll(where.gravity, 1, axis=0)
    gravity_before[np.diff(where.log, prepend=-1) != 0] = 0.0  # at the start of a log
    add(("attitude", "memory"), all_dwells, axes * gravity_before[:, None, :])
    add(SECOND_ORDER, all_dwells, scale * where.gravity[:, None, :])
    if where.hours is not None:
        add(DRIFT, all_dwells, axes * (where.hours - where.hours.mean())[:, None, None])
    return listed


def state_errors(where: Circumstances, along: Array, spec: AccelerometerRecipe) -> list[Shared]:
    """Errors that the dwells share, with the sizes that the recipe states.

    `along` [n, m, 3] are the directions of the residuals.
    """
    listed = list_errors(where, along)
    # what the recipe makes a parameter is no error
    parameters = {
        "tilt": spec.affine.tilt,
        "second order": spec.affine.second_order,
        "set-up": spec.affine.fixture,
    }
    stated = state_sizes(
        spec.errors,
        [error for error in listed if not (spec.affine.enabled and parameters.get(error.effect))],
    )
    # no dwell tells a set-up from axes that are turned together; a few wrong dwells at the begin of
    # a single soak look as if its zero settled
    alike = {SET_UP}
    if where.soak.max() == 0:
        alike |= {("soak", "settling")}
    return [
        error
        for error in stated
        if (error.group, error.effect) not in alike or error.size is not None
    ]


def separable(listed: Sequence[Shared], jacobian: Array) -> list[Shared]:
    """Errors that a fit may take: of optional ones those of which parameters with derivatives
    [n, p] leave enough; else chance makes them large, and the parameters wrong by as much.
    """
    Q, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    offered = []
    for error in listed:
        if error.optional:
            # |Z - Q Qᵀ Z|² = |Z|² - |Qᵀ Z|², in which no matrix Z stands
            whole = np.sum(error.loading[error.level >= 0] ** 2)
            left = whole - np.sum(error.gathered(Q) ** 2)
            if left <= SEEN**2 * whole:
                continue
        offered.append(error)
    return offered


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
    offered = [error for error in listed if (error.group, error.effect) == SECOND_ORDER]
    if not offered:
        return []
    left = beside(jacobian, offered[0].loading) / fit.noise[:, None]
    # of a sensor that gravity never lies along nothing is left
    information = np.maximum(np.sum(left**2, axis=0), 1e-30)
    kept = [size for size in fit.shared if (size.error.group, size.error.effect) == SECOND_ORDER]
    if kept:
        unsure = 1.0 / (information + max(kept[0].value, 1e-30) ** -2.0)
        size = np.sqrt(kept[0].errors[0] ** 2 + unsure)
        return [_bound(("lacking terms", "scale"), scale * size, HALF_INTERVAL)]
    if per_dwell > 1:
        return []
    hidden = float(np.sqrt(ASKED_FOR / 3.0 / np.mean(information)))
    return [_bound(SECOND_ORDER, offered[0].loading, min(hidden, LARGEST_SECOND_ORDER))]


def possible_drift(
    fit: Fit, listed: Sequence[Shared], jacobian: Array
) -> tuple[list[Shared], tuple[str, ...]]:
    """Drift of the zero as large as the data allow, in U however small it looks, and a flag where
    it cannot be separated from the coefficients.
    """
    kept = [(size.error.group, size.error.effect) for size in fit.shared]
    drifts = [error for error in listed if (error.group, error.effect) == DRIFT]
    if not drifts or drifts[0].size is not None or DRIFT in kept:
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
    return [_bound(DRIFT, loading * np.hypot(drift, u), 1.0)], ()


def _bound(group_effect: tuple[str, str], loading: Array, size: float) -> Shared:
    """An error below a size, of all residuals."""
    group, effect = group_effect
    level, unit = np.zeros(len(loading), dtype=np.int64), UNITS.get(group_effect, "1")
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


def judge_unexplained(
    where: Circumstances, fit: Fit, jacobian: Array, per_dwell: int
) -> tuple[Criterion, ...]:
    """Failed criteria for residuals that differ from group to group by more than U of a corrected
    component, with shared errors taken out, whatever limits the recipe sets.
    """
    from scipy.special import stdtrit

    quarter = np.minimum(4 * where.soak // (where.soak.max() + 1), 3)
    groups = {
        "soak": where.soak,
        "attitude": number_attitudes(where.gravity),
        "quarter of the soaks": quarter,
    }
    labels = {}
    for name, level in groups.items():
        each = per_dwell * level[:, None] + np.arange(per_dwell)
        labels[name] = np.where(fit.used, each.ravel(), -1)
    u = np.sqrt(np.einsum("np,pq,nq->n", jacobian, fit.covariance, jacobian))
    k = float(stdtrit(float(np.median(fit.of(lambda p: p).dof)), 0.975))
    expanded = k * float(np.sqrt(np.mean(u**2)))
    axes = ("along x", "along y", "along z") if per_dwell == 3 else ("of the length",)
    failed = []
    for apart in lack_of_fit.find(-fit.noise_residual, labels):
        if abs(apart.size) > expanded:
            group, axis = divmod(apart.level, per_dwell)
            name = f"unexplained residual, {apart.group} {1 + group}, {axes[axis]}"
            failed.append(at_most(name, abs(apart.size), expanded, "g"))
    return tuple(failed)


def remark_on_set_up(spec: AccelerometerRecipe) -> tuple[str, ...]:
    """Remark on a set-up in the fixture of which nothing is known: no dwell tells it from axes that
    are turned together.
    """
    stated = [(one.group, one.effect) for one in spec.errors.component]
    angles = [one for one in spec.type_b if one.quantity in {"inclination_deg", "toolface_deg"}]
    known = spec.affine.fixture or angles or SET_UP in stated
    if known or spec.reference.kind != "attitude":
        return ()
    group, effect = SET_UP
    remark = Remark(
        "an error in setting up the triad in its fixture turns every corrected vector, and the"
        f' uncertainties leave it out: state its size in [[errors.component]] group = "{group}",'
        f' effect = "{effect}", or in [[type_b]] of inclination_deg and toolface_deg'
    )
    return (remark,)


def remark_on_order(dwells: DwellSet) -> tuple[str, ...]:
    """Remark on temperatures that only rise or only fall from soak to soak: a zero that drifts with
    time looks like one that follows temperature.
    """
    soak = number_soaks(dwells.temperature, dwells.log)
    level = np.bincount(soak, dwells.temperature) / np.bincount(soak)
    steps = np.sign(np.diff(level))
    if steps.size < 2 or abs(steps.sum()) < steps.size:
        return ()
    cure = "return to the first temperature at the end"
    if _tells_time(dwells):
        remark = Remark(
            "temperature follows time: U of what follows temperature holds any drift of the zero"
            f" that the dwells of a soak allow; {cure}, or state the drift of the session in"
            " [[errors.component]]"
        )
    else:
        remark = Remark(
            "temperature follows the order of the rows and no time_s is logged: a zero that drifts"
            f" would be taken for one that follows temperature; log time_s, and {cure}"
        )
    return (remark,)


def _tells_time(dwells: DwellSet) -> bool:
    """Whether the dwells have one clock; those of several logs have no common start."""
    return bool(dwells.log.max() == 0 and np.isfinite(dwells.time).all())

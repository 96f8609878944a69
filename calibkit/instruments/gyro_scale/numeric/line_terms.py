"""Terms of a run of the rate table beside its straight line, where the residuals ask for them: zero
that drifts with time, scale factor and zero that follow temperature, asymmetry of the two
directions.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.instruments.gyro_scale.numeric.plateau_means import Plateaus
from calibkit.numeric.dispersion import rms

ASYMMETRY = "asymmetry"
CURVATURE = "curvature"
CURVATURES = tuple(f"{CURVATURE} {power}" for power in (2, 3, 5, 7))
"""Powers of the rate that are tried; like asymmetry they belong to the response over the rate,
and are no part of what is taken out.
"""
ZERO_DRIFT, SCALE_DRIFT, TEMPERATURE = "zero drift", "scale drift", "temperature"
DRIFTS = {ZERO_DRIFT: "h", SCALE_DRIFT: "h", TEMPERATURE: "°C"}
"""Terms that change during a run, and what each is counted per."""
ASKED = 0.01
"""Probability of so large an F by chance, below which a term is included."""
LEAST_DOF = 3
"""Fewest degrees of freedom that a term must leave."""
ROUNDING = 1e-10
"""Residuals, relative to the largest indication, that are rounding: they ask for nothing."""
STOPPED = 1e-6
"""Largest rate of a table at rest, relative to the largest rate of the run."""
BOTH_WAYS = 2.0
"""Range of the signs of rates of both directions."""
FEW = 100
"""Rates of a run up to which what they alone determine is found once for all its gyros."""
ALIKE = 0.02
"""Share of a term that the other terms must leave over, for the data to tell it."""


@dataclass(frozen=True, slots=True)
class Solved:
    """Least-squares solution of a run's line with terms beside it."""

    design: Array
    """[p, k]: Ω, 1, then the columns of the terms."""
    solver: Array
    """[k, p], from indications to the coefficients of `design`."""
    taken_out: Array
    """[p, p], from indications to what time and temperature added to them."""

    results: Array
    """[4, p], from indications to K and F0 of the best straight line of what is left, to the
    indication at rest of the model, and to that of the held zero rates (the former again where
    none is held).
    """


def _solve(rate_dps: Array, terms: Mapping[str, Array]) -> Solved:
    """Solution for terms by name, with columns [p, k]."""
    design = np.column_stack((rate_dps, np.ones_like(rate_dps), *terms.values()))
    drifts = [name in DRIFTS for name, columns in terms.items() for _ in columns.T]
    if len(design) > FEW:
        return _solve_design(design, drifts)
    return _solve_few(design.tobytes(), design.shape[1], tuple(drifts))


@functools.lru_cache(1024)
def _solve_few(design: bytes, columns: int, drifts: tuple[bool, ...]) -> Solved:
    """The same of the bytes of a design."""
    return _solve_design(np.frombuffer(design).reshape(-1, columns), drifts)


def _solve_design(design: Array, drifts: Sequence[bool]) -> Solved:
    """Solution of a design of Ω, 1 and columns, of which some are drifts."""
    solver: Array = np.asarray(np.linalg.pinv(design))
    own = np.array([False, False, *drifts])
    taken_out = design[:, own] @ solver[own]
    line, rate = design[:, :2], design[:, 0]
    left = np.eye(rate.size) - taken_out
    straight = np.linalg.pinv(line) @ left
    held = at_rest(rate)
    mean = held / max(int(held.sum()), 1)
    stopped = mean @ left - (mean @ rate) * straight[0] if held.any() else solver[1]
    return Solved(design, solver, taken_out, np.vstack((straight, solver[1], stopped)))


@dataclass(frozen=True, slots=True)
class Chosen:
    """Terms that the residuals of a run ask for, and what the others would change."""

    solved: Solved
    terms: Mapping[str, tuple[float, ...]]
    """Name of each included term → its coefficients."""
    left_out: tuple[Solved, ...]
    """Solution with each one of the terms that were tried and not included."""


def courses(plateaus: Plateaus) -> dict[str, Array]:
    """Candidate terms of a run from the times and temperatures of its plateaus: name → columns
    [p, k].

    Each is centred, so that K and F0 hold at the middle of the run and at its mean temperature.
    Where the temperature is not logged, the scale factor may drift with time.
    """
    rate, found = plateaus.rate_dps, {}
    if plateaus.time_s.size:
        hours = plateaus.hours
        found[ZERO_DRIFT] = hours[:, None]
        if np.isnan(plateaus.temp_degc).any():
            found[SCALE_DRIFT] = np.column_stack((rate * hours, hours))
    warmer = plateaus.temp_degc - plateaus.temp_degc.mean()
    if np.isfinite(warmer).all() and np.ptp(warmer) > 0.0:
        found[TEMPERATURE] = np.column_stack((rate * warmer, warmer))
    return found


def choose(rate_dps: Array, indication: Array, candidates: Mapping[str, Array]) -> Chosen:
    """Include terms one by one, each time the one whose F test asks for it most.

    Parameters
    ----------
    rate_dps, indication : [p].
    candidates : name → columns [p, k]; asymmetry and curvature are tried too.

    """
    line = np.column_stack((rate_dps, np.ones_like(rate_dps)))
    included, others = ask(line, indication, dict(candidates) | shapes(rate_dps))
    solved = _solve(rate_dps, included)
    found, terms = solved.solver @ indication, {}
    first = 2
    for name, columns in included.items():
        terms[name] = tuple(found[first : first + columns.shape[1]].tolist())
        first += columns.shape[1]
    return Chosen(
        solved,
        terms,
        tuple(_solve(rate_dps, included | {name: columns}) for name, columns in others.items()),
    )


def turns_both_ways(rate_dps: Array) -> bool:
    """Whether rates of both directions are among [n]."""
    return bool(np.ptp(np.sign(rate_dps)) == BOTH_WAYS)


def shapes(rate_dps: Array, fastest_dps: float | None = None) -> dict[str, Array]:
    """Candidate terms of the response over rates [n], name → [n, 1]; powers are of the rate over
    the fastest one, by default that of these rates.
    """
    if fastest_dps is None:
        fastest_dps = float(np.max(np.abs(rate_dps), initial=np.finfo(np.float64).tiny))
    names = (ASYMMETRY, *CURVATURES)
    return {name: shape(name, rate_dps, fastest_dps)[:, None] for name in names}


def shape(name: str, rate_dps: Array, fastest_dps: float) -> Array:
    """Term [n] of the response by its name; powers are of the rate over the fastest one."""
    if name == ASYMMETRY:
        return np.abs(rate_dps)
    return np.asarray((rate_dps / fastest_dps) ** int(name.removeprefix(CURVATURE)))


def ask(
    design: Array, indication: Array, candidates: Mapping[str, Array]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Candidates that the residuals of a design [n, p] ask for, included one by one, and those that
    the data determine but do not ask for; both name → columns [n, k].
    """
    left, included = dict(candidates), dict[str, Array]()
    floor = ROUNDING * float(np.max(np.abs(indication), initial=0.0))
    while True:
        q, _ = np.linalg.qr(design)
        rounding = rms(indication - q @ (q.T @ indication)) <= floor
        tests = {
            name: _test(design, columns, indication)
            for name, columns in ({} if rounding else left).items()
        }
        best = min(tests, key=lambda name: tests[name][1], default="")
        if not best or tests[best][1] >= ASKED:
            return included, {name: left[name] for name, (ratio, _) in tests.items() if ratio > 0.0}
        included[best] = left.pop(best)
        design = np.column_stack((design, included[best]))


def at_rest(rate_dps: Array) -> Mask:
    """Mask [p] of the plateaus at rest: below a millionth of the largest rate."""
    return np.asarray(
        np.abs(rate_dps) <= STOPPED * np.max(np.abs(rate_dps), initial=0.0), dtype=np.bool_
    )


def _test(design: Array, columns: Array, indication: Array) -> tuple[float, float]:
    """F of the columns [p, k] beside a design, and the probability of a larger one by chance; (0,
    1) where the data cannot tell them.
    """
    from scipy.special import fdtrc

    dof = indication.size - design.shape[1] - columns.shape[1]
    few = indication.size <= FEW
    shape = design.shape[1], columns.shape[1]
    q, basis = (
        _tell_few(design.tobytes(), columns.tobytes(), shape) if few else _tell(design, columns)
    )
    if dof < LEAST_DOF or basis is None:
        return 0.0, 1.0
    residual = indication - q @ (q.T @ indication)
    explained = float(np.sum((basis.T @ residual) ** 2))
    least = (np.finfo(np.float64).eps * float(np.max(np.abs(indication)))) ** 2
    rest = max(float(residual @ residual) - explained, least)
    ratio = explained / columns.shape[1] / (rest / dof)
    return ratio, float(fdtrc(columns.shape[1], dof, ratio))


@functools.lru_cache(1024)
def _tell_few(design: bytes, columns: bytes, shape: tuple[int, int]) -> tuple[Array, Array | None]:
    """What `_tell` finds, of the bytes of a design and of columns."""
    parts = (
        np.frombuffer(part).reshape(-1, k) for part, k in zip((design, columns), shape, strict=True)
    )
    return _tell(*parts)


def _tell(design: Array, columns: Array) -> tuple[Array, Array | None]:
    """Orthonormal directions of a design [p, m], and of columns [p, k] beside it; None where the
    data cannot tell these.
    """
    q, _ = np.linalg.qr(design)
    across = columns - q @ (q.T @ columns)
    length = np.linalg.norm(columns, axis=0)
    if not (np.linalg.norm(across, axis=0) > ALIKE * length).all():
        return q, None
    basis, spread, _ = np.linalg.svd(across / length, full_matrices=False)
    return q, np.asarray(basis) if spread[-1] > ALIKE * spread[0] else None

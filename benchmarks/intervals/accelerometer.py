"""Triads on a two-axis table in a chamber, and turned by hand: K, triad over temperature, Q,
magnitude only.

The sensors are physical: magnets lose flux by an exponential law, the bias saturates as a spring's
does. Errors act where they arise: on the sensor's zero, flux or second order, on the base, the
fixture and the encoders of the table. The truth of a coefficient is that of a fit to the same
dwells without any error; the truth of a corrected vector is gravity. It is judged at indications
free of errors but for the sensors' own second order: that is in every indication.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from intervals import exact
from intervals.physics.accelerometer import AXES, UP, fit_k, k_design
from intervals.physics.campaigns import Campaign, Truth, compare, fit
from intervals.physics.triad import ROOM_DEGC, SPOTS_DEG, Triad, draw, gravity
from intervals.rows import GROUPS, NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

NOISE_G = 20e-6
"""Standard deviation of the mean indication of a dwell [g]."""
LOW_DEGC, HIGH_DEGC = -40.0, 125.0
SOAK_H, DWELL_H = 1.5, 2.0 / 60.0
BETWEEN_DEGC = np.array([-30.0, 0.0, 40.0, 80.0, 115.0])
"""Temperatures at which corrected vectors are judged, in two opposite faces each."""
ZEROS, PARAMETERS, VECTOR, ANGLES = "K4–K7", "parameters", "corrected vector", "Q"
ZERO, SCALE, INDEX, TILT, ECCENTRIC, SECOND, DRIFT = (
    "zero of a soak",
    "scale factor of a soak",
    "index of an attitude",
    "tilt of the table",
    "eccentric encoders",
    "second order",
    "drift of the zero",
)
ERRORS = (ZERO, SCALE, INDEX, TILT, ECCENTRIC, SECOND, DRIFT)
OF_LENGTHS = (ZERO, SCALE, SECOND)
"""Errors that change the length of gravity, and do not need a clock."""
COMPONENT = {
    ZERO: ("soak", "zero", "g"),
    SCALE: ("soak", "scale", "1"),
    INDEX: ("attitude", "index", "rad"),
    TILT: ("table", "tilt", "rad"),
    ECCENTRIC: ("table", "eccentricity", "rad"),
    SECOND: ("sensor", "second order", "1/g"),
}
"""Group, effect and unit of errors that a recipe can state."""
K, AFFINE, LENGTH = "K", "affine", "magnitude"
ROBUST = ", robust"
CUBIC = 4
"""Coefficients that a cubic takes from the soaks of each axis."""
FEW = ("degrees of freedom, so intervals are wide", "so it is in no uncertainty")


def list_cases() -> list[Case]:
    """Every error at every size and number of soaks; robustly, and with the component given, at
    seven.
    """
    found = []
    for procedure in (K, AFFINE, LENGTH):
        errors = OF_LENGTHS if procedure == LENGTH else ERRORS
        for soaks in GROUPS:
            found.append(_case(procedure, NONE, 0.0, soaks))
            found += [_case(procedure, e, ratio, soaks) for e in errors for ratio in RATIOS]
        seven = GROUPS[1]
        found.append(_case(procedure + ROBUST, NONE, 0.0, seven))
        found += [_case(procedure + ROBUST, e, ratio, seven) for e in errors for ratio in RATIOS]
        found += [
            _case(procedure, e, ratio, seven, given=True)
            for e in errors
            if e in COMPONENT
            for ratio in (0.0, *RATIOS)
        ]
    return found


def _case(procedure: str, error: str, ratio: float, soaks: int, *, given: bool = False) -> Case:
    """Case with the degrees of freedom that its design leaves an axis between its soaks: their
    zeros are estimated in every case.
    """
    between = soaks - (1 if procedure.startswith(LENGTH) else CUBIC)
    return Case("accelerometer", procedure, error, ratio, soaks, given=given, between=between)


def _draw(rng: np.random.Generator, procedure: str) -> Triad:
    """A triad; that of K is well aligned, for K8 and K9 know no temperature."""
    off = 1e-4 if procedure.startswith(K) else 3e-3
    axes = np.eye(3) + rng.normal(0.0, off, (3, 3))
    if procedure.startswith(LENGTH):
        axes = np.eye(3) + np.tril(rng.normal(0.0, off, (3, 3)), -1)
    return draw(rng, axes)


@dataclass(frozen=True)
class _Plan:
    """Where n dwells stand."""

    soak: NDArray[np.int64]
    spot: NDArray[np.int64]
    degc: Array
    hours: Array

    @property
    def angle(self) -> Array:
        """Inclination and toolface [n, 2] [°]."""
        return np.asarray(SPOTS_DEG[self.spot])


def _plan(case: Case) -> _Plan:
    """Soaks one after the other; a magnitude campaign stays at room temperature, one that drifts
    returns to its first temperature.
    """
    soak, spot = (a.ravel() for a in np.indices((case.groups, len(SPOTS_DEG))))
    held = np.linspace(LOW_DEGC, HIGH_DEGC, case.groups)
    if case.error == DRIFT:
        held = np.append(np.linspace(LOW_DEGC, HIGH_DEGC, case.groups - 1), LOW_DEGC)
    if case.procedure.startswith(LENGTH):
        held[:] = ROOM_DEGC
    return _Plan(soak, spot, held[soak], SOAK_H * soak + DWELL_H * spot)


def _latent(case: Case) -> int:
    """How many independent shared errors a campaign has."""
    soaks = 3 * case.groups
    axes = dict.fromkeys((SECOND, DRIFT), 3) | {TILT: 2, ECCENTRIC: 4, NONE: 0}
    each = {ZERO: soaks, SCALE: soaks, INDEX: 3 * len(SPOTS_DEG)}
    return (axes | each)[case.error]


def _size(case: Case, plan: _Plan) -> float:
    """Standard deviation of the shared error in its own unit; a drift has it as its rms."""
    if case.error == DRIFT:
        return case.ratio * NOISE_G / float(np.std(plan.hours))
    return case.ratio * NOISE_G


def _indicated(case: Case, triad: Triad, plan: _Plan, errors: Array) -> Array:
    """Noise-free indications [n, 3] with shared errors [q] in their own units."""
    zero, flux, second = np.zeros((len(plan.soak), 3)), np.zeros((len(plan.soak), 3)), np.zeros(3)
    angle, base, turn = plan.angle, UP, np.zeros((len(plan.soak), 3))
    if case.error == ZERO:
        zero = errors.reshape(-1, 3)[plan.soak]
    elif case.error == SCALE:
        flux = errors.reshape(-1, 3)[plan.soak]
    elif case.error == DRIFT:
        zero = (plan.hours - plan.hours.mean())[:, None] * errors
    elif case.error == INDEX:
        turn = errors.reshape(-1, 3)[plan.spot]
    elif case.error == TILT:
        base = np.array([*errors, 1.0]) / np.sqrt(1.0 + errors @ errors)
    elif case.error == ECCENTRIC:
        sines, cosines = np.sin(np.radians(angle)), np.cos(np.radians(angle))
        angle = angle + np.degrees(sines * errors[:2] + cosines * errors[2:])
    elif case.error == SECOND:
        second = errors
    down = gravity(angle, base)
    down = down + np.cross(turn, down)
    return triad.indication(down, plan.degc, zero, flux, second)


def _recipe(case: Case, plan: _Plan) -> dict[str, object]:
    """Recipe of a case."""
    by_length = case.procedure.startswith(LENGTH)
    tables: dict[str, object] = {
        "procedure": "accelerometer",
        "logs": {"files": ["*.csv"]},
        "reference": {"kind": "magnitude" if by_length else "attitude", "convention": "gravity"},
        "loss": "robust" if case.procedure.endswith(ROBUST) else "least_squares",
        "reference_temp_degc": ROOM_DEGC,
    }
    if case.given:
        # what is estimated whatever its size is stated too
        sizes = {ZERO: 0.0, SECOND if by_length else INDEX: 0.0} | {case.error: _size(case, plan)}
        stated = [(*COMPONENT[error], size) for error, size in sizes.items()]
        keys = ("group", "effect", "unit", "value")
        components = [dict(zip(keys, part, strict=True)) | {"dof": 1000.0} for part in stated]
        tables["errors"] = {"component": components}
    if case.procedure.startswith(K):
        return tables | {"affine": {"enabled": False}, "compensation": "k"}
    if by_length:
        tables["affine"] = {"enabled": False}
    return tables | {"k": {"enabled": False}}


@dataclass(frozen=True)
class _Form:
    """Triad over temperature t [°C] with its parameters p, and its truth.

    a_i = G_i Σ k_in tⁿ − Σ z_in tⁿ
    g_i = a_i − Σ_j (c_ij + d_ij t) a_j
    """

    order: int
    pairs: tuple[tuple[int, int], ...]
    """Axes i, j of the cross-axis terms."""

    @classmethod
    def of(cls, procedure: str) -> _Form:
        """Cubics and six changing cross-axis terms; constants and three of them by length."""
        if procedure.startswith(LENGTH):
            return cls(0, ((1, 0), (2, 0), (2, 1)))
        return cls(3, tuple((i, j) for i in range(3) for j in range(3) if i != j))

    @property
    def names(self) -> list[str]:
        """Names [p] in coefficient files."""
        powers = range(self.order + 1)
        names = [f"{letter}_{axis}{n}" for letter in "kz" for axis in AXES for n in powers]
        for letter in "cd" if self.order else "c":
            names += [f"{letter}_{AXES[i]}{AXES[j]}" for i, j in self.pairs]
        return names

    @property
    def units(self) -> Array:
        """Sizes [p] that the parameters are solved in: temperature over 100 °C."""
        powers = 100.0 ** -np.arange(self.order + 1.0)
        cross = np.repeat((1.0, 0.01)[: 2 if self.order else 1], len(self.pairs))
        return np.concatenate((np.tile(powers, 6), cross))

    def _cross(self, p: Array, degc: Array) -> Array:
        """Cross-axis terms [n, 3, 3] at temperatures [n]."""
        terms = np.zeros((len(degc), 3, 3))
        values = p[6 * (self.order + 1) :].reshape(-1, len(self.pairs))
        for (i, j), column in zip(self.pairs, values.T, strict=True):
            terms[:, i, j] = np.polynomial.polynomial.polyval(degc, column)
        return terms

    def corrected(self, p: Array, indication: Array, degc: Array) -> Array:
        """Gravity [n, 3] that indications [n, 3] mean."""
        powers = np.vander(degc, self.order + 1, increasing=True)
        k, z = p[: 6 * (self.order + 1)].reshape(2, 3, -1)
        a = indication * (powers @ k.T) - powers @ z.T
        return np.asarray(a - np.einsum("nij,nj->ni", self._cross(p, degc), a))

    def angles(self, p: Array) -> Array:
        """Q1, Q2, Q3 [3] at room temperature: −z·e2, (y·e1)(z·e2) − z·e1, −y·e1."""
        axes = np.linalg.inv(np.eye(3) - self._cross(p, np.array([ROOM_DEGC]))[0])
        x, y, z = axes / np.linalg.norm(axes, axis=1)[:, None]
        e2 = (y - (y @ x) * x) / np.sqrt(1.0 - (y @ x) ** 2)
        return np.array([-z @ e2, (y @ x) * (z @ e2) - z @ x, -y @ x])

    def solve(self, residual: Callable[[Array], Array]) -> Array:
        """Parameters [p] with the least squares of a residual."""
        start = np.array([float(name in ("k_x0", "k_y0", "k_z0")) for name in self.names])
        tolerances = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-14)
        solved = least_squares(
            lambda q: residual(q * self.units), start, jac="3-point", method="lm", **tolerances
        )
        return np.asarray(solved.x * self.units)

    def slopes(self, function: Callable[[Array], Array], p: Array) -> Array:
        """Derivatives [m, p]; the form is linear but for products of two parameters."""
        steps = 1e-4 * self.units
        moved = [
            (function(p + step) - function(p - step)).ravel() / (2.0 * step.sum())
            for step in np.diag(steps)
        ]
        return np.array(moved).T


def _clean(triad: Triad, plan: _Plan) -> tuple[Array, Array]:
    """Gravity and indications [n, 3] without any error."""
    down, nothing = gravity(plan.angle, UP), np.zeros((len(plan.soak), 3))
    return down, triad.indication(down, plan.degc, nothing, nothing, np.zeros(3))


def _true_form(procedure: str, triad: Triad, plan: _Plan) -> Array:
    """Parameters [p] by the same dwells without any error."""
    form = _Form.of(procedure)
    down, clean = _clean(triad, plan)

    def residual(p: Array) -> Array:
        vector = form.corrected(p, clean, plan.degc)
        if procedure.startswith(LENGTH):
            return np.linalg.norm(vector, axis=1) - 1.0
        return (vector - down).ravel()

    return form.solve(residual)


def simulate(case: Case, number: int) -> Outcome:
    """Simulate and fit one campaign, and judge its results."""
    rng = np.random.default_rng([*case.seed, number])
    triad, plan = _draw(rng, case.procedure), _plan(case)
    if not case.procedure.startswith(LENGTH):
        plan = _Plan(
            plan.soak, plan.spot, plan.degc + rng.normal(0.0, 0.2, plan.degc.size), plan.hours
        )
    errors = _size(case, plan) * rng.normal(size=_latent(case))
    indicated = _indicated(case, triad, plan, errors)
    indicated = indicated + rng.normal(0.0, NOISE_G, indicated.shape)
    second = errors if case.error == SECOND else np.zeros(3)
    truth = [*_true_coefficients(case.procedure, triad, plan)]
    truth += _true_vectors(case.procedure, triad, second)
    fitted = fit(Campaign(_recipe(case, plan), _logs(case, plan, indicated), truth))
    return compare(fitted, _exact(case), FEW)


def _logs(case: Case, plan: _Plan, indicated: Array) -> dict[str, pd.DataFrame]:
    """Logs of a campaign; by magnitude each session is a log."""
    frame = pd.DataFrame(indicated, columns=[f"accel_{axis}_g" for axis in AXES])
    if case.procedure.startswith(LENGTH):
        return {f"{soak}.csv": part for soak, part in frame.groupby(plan.soak)}
    frame["temp_case_degc"] = plan.degc
    frame[["inclination_deg", "toolface_deg"]] = plan.angle
    if case.error == DRIFT:
        frame["time_s"] = 3600.0 * plan.hours
    return {"a.csv": frame}


def _true_coefficients(procedure: str, triad: Triad, plan: _Plan) -> list[Truth]:
    """Zero offsets K4 … K7; or parameters of the triad, and Q."""
    if procedure.startswith(K):
        down, clean = _clean(triad, plan)
        return [
            Truth(ZEROS, f"accel_{axis}.K{k}", float(row[k]))
            for axis, row in zip(AXES, fit_k(clean, plan.degc, down), strict=True)
            for k in range(4, 8)
        ]
    form, p = _Form.of(procedure), _true_form(procedure, triad, plan)
    truth = [
        Truth(PARAMETERS, f"triad.{name}", float(value))
        for name, value in zip(form.names, p, strict=True)
    ]
    angles = form.angles(p).tolist()
    return truth + [Truth(ANGLES, f"triad.Q{k}", value) for k, value in enumerate(angles, 1)]


def _faces(procedure: str) -> tuple[Array, Array]:
    """Gravity [m, 3] and temperatures [m] at which corrected vectors are judged."""
    degc = np.full(5, ROOM_DEGC) if procedure.startswith(LENGTH) else BETWEEN_DEGC
    faces = np.vstack([(np.eye(3)[k % 3], -np.eye(3)[k % 3]) for k in range(len(degc))])
    return faces, np.repeat(degc, 2)


def _at_faces(procedure: str, triad: Triad, second: Array) -> Array:
    """Indications [m, 3] at the faces of a sensor with an error of second order [3]."""
    vectors, degc = _faces(procedure)
    nothing = np.zeros(vectors.shape)
    return triad.indication(vectors, degc, nothing, nothing, second)


def _true_vectors(procedure: str, triad: Triad, second: Array) -> list[Truth]:
    """Components of gravity at the faces; by K axis after axis, as its models are."""
    faces, degc = _faces(procedure)
    indicated = _at_faces(procedure, triad, second)
    truth = []
    for face, shown, t in zip(faces.tolist(), indicated.tolist(), degc.tolist(), strict=True):
        at = {f"accel_{axis}_g": value for axis, value in zip(AXES, shown, strict=True)}
        for axis, component in zip(AXES, face, strict=True):
            by_k = procedure.startswith(K)
            key = f".accel_{axis}.component" if by_k else f".corrected_{axis}"
            truth.append(Truth(VECTOR, key, component, at | {"temp_case_degc": t}))
    return truth


@lru_cache(maxsize=8)
def _exact(case: Case) -> dict[str, Array]:
    """Exact half-widths of each quantity, for a triad like the others."""
    triad, plan = _draw(np.random.default_rng(1), case.procedure), _plan(case)
    count, size = _latent(case), _size(case, plan)
    clean = _indicated(case, triad, plan, np.zeros(count))
    step = max(size, NOISE_G)
    moved = [_indicated(case, triad, plan, step * row) - clean for row in np.eye(count)]
    shared = np.array(moved).reshape(count, clean.size).T * (size / step)
    second = size if case.error == SECOND else 0.0
    if case.procedure.startswith(K):
        return _exact_k(triad, plan, clean, shared, second)
    return _exact_form(case.procedure, triad, plan, clean, shared, second)


def _of_second(procedure: str, size: float, q: int) -> Array:
    """Derivatives [3 m, q] of the components at the faces by errors of second order; none where
    there are no such errors.
    """
    faces, _ = _faces(procedure)
    if size == 0.0:
        return np.zeros((faces.size, q))
    return np.asarray(size * np.eye(3) * faces[:, :, None] ** 2).reshape(faces.size, q)


def _exact_k(
    triad: Triad, plan: _Plan, clean: Array, shared: Array, second: float
) -> dict[str, Array]:
    """Of the three axes together; `second` is the size of second-order errors."""
    design = np.zeros((len(clean), 3, 30))
    faces, degc = _faces(K)
    indicated = _at_faces(K, triad, np.zeros(3))
    vectors = np.zeros((len(faces), 3, 30))
    for axis in range(3):
        block = slice(10 * axis, 10 * axis + 10)
        design[:, axis, block] = k_design(clean, plan.degc, axis)
        vectors[:, axis, block] = k_design(indicated, degc, axis)
    flat, zeros = design.reshape(-1, 30), np.eye(30).reshape(3, 10, 30)[:, 4:8].reshape(12, 30)
    errors = _of_second(K, second, shared.shape[1])
    return {
        ZEROS: exact.half_widths(flat, shared, NOISE_G, zeros),
        VECTOR: exact.half_widths(flat, shared, NOISE_G, vectors.reshape(-1, 30), errors),
    }


def _exact_form(
    procedure: str, triad: Triad, plan: _Plan, clean: Array, shared: Array, second: float
) -> dict[str, Array]:
    """Of the triad over temperature; `second` is the size of second-order errors."""
    form, p = _Form.of(procedure), _true_form(procedure, triad, plan)
    design = form.slopes(lambda q: form.corrected(q, clean, plan.degc), p)
    if procedure.startswith(LENGTH):
        # A change of the corrected vector moves its length along the unit vector of gravity.
        down = gravity(plan.angle, UP)
        design = np.einsum("ni,nip->np", down, design.reshape(len(down), 3, -1))
        shared = np.einsum("ni,niq->nq", down, shared.reshape(len(down), 3, -1))
    _, degc = _faces(procedure)
    indicated = _at_faces(procedure, triad, np.zeros(3))
    vectors = form.slopes(lambda q: form.corrected(q, indicated, degc), p)
    # Slopes to +1 g and to −1 g differ by two errors of second order, a scale factor is of one.
    scales = np.zeros((p.size, shared.shape[1]))
    if second:
        rows = [form.names.index(f"k_{axis}0") for axis in AXES]
        scales[rows, range(3)] = second
    errors = _of_second(procedure, second, shared.shape[1])
    return {
        PARAMETERS: exact.half_widths(design, shared, NOISE_G, np.eye(p.size), scales),
        VECTOR: exact.half_widths(design, shared, NOISE_G, vectors, errors),
        ANGLES: exact.half_widths(design, shared, NOISE_G, form.slopes(form.angles, p)),
    }

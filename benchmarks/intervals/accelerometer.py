"""Triads on a two-axis table in a chamber, and turned by hand: K, affine triad, Q, magnitude only.

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

from calibkit.errors import CalibkitError
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.errors import judge_lack_of_fit
from calibkit.instruments.accelerometer.fit import fit_triad
from calibkit.instruments.accelerometer.numeric import (
    affine,
    affine_model,
    k_factor,
    magnitude,
    q_factor,
)
from calibkit.instruments.accelerometer.numeric.norms import lower_matrix
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import gum
from intervals import exact
from intervals.physics.triad import ROOM_DEGC, SPOTS_DEG, Triad, draw, gravity
from intervals.rows import GROUPS, NONE, RATIOS, Case, Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from calibkit.coefficients import Model

    Array = NDArray[np.float64]

NOISE_G = 20e-6
"""Standard deviation of the mean indication of a dwell [g]."""
LOW_DEGC, HIGH_DEGC = -40.0, 125.0
SOAK_H, DWELL_H = 1.5, 2.0 / 60.0
BETWEEN_DEGC = np.array([-30.0, 0.0, 40.0, 80.0, 115.0])
"""Temperatures at which corrected vectors are judged, in two opposite faces each."""
AT_ROOM_DEGC = np.full(5, ROOM_DEGC)
"""Those of a triad that knows no temperature."""
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
        axes = q_factor.axes_from_angles(rng.normal(0.0, off, 3))
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
    angle, base, turn = plan.angle, np.array([0.0, 0.0, 1.0]), np.zeros((len(plan.soak), 3))
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


def _recipe(case: Case, plan: _Plan) -> AccelerometerRecipe:
    """Recipe of a case."""
    tables: dict[str, object] = {
        "procedure": "accelerometer",
        "title": "a triad",
        "logs": {"files": ["a.csv"]},
        "loss": "robust" if case.procedure.endswith(ROBUST) else "least_squares",
        "reference_temp_degc": ROOM_DEGC,
    }
    if case.given:
        # what is estimated whatever its size is stated too
        sizes = {ZERO: 0.0, INDEX: 0.0} | {case.error: _size(case, plan)}
        if case.procedure.startswith(LENGTH):
            del sizes[INDEX]
            sizes = {SECOND: 0.0} | sizes
        tables["errors"] = {
            "component": [
                {
                    "group": group,
                    "effect": effect,
                    "value": sizes[error],
                    "unit": unit,
                    "dof": 1000.0,
                }
                for error, (group, effect, unit) in COMPONENT.items()
                if error in sizes
            ]
        }
    if case.procedure.startswith(K):
        tables |= {"affine": {"enabled": False}, "compensation": "k"}
    elif case.procedure.startswith(LENGTH):
        tables |= {"reference": {"kind": "magnitude"}, "k": {"enabled": False}}
        tables["affine"] = {"enabled": False}
    else:
        tables["k"] = {"enabled": False}
    return AccelerometerRecipe.model_validate(tables, strict=False)


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
    try:
        fitted = fit_triad(_dwells(case, plan, indicated), _recipe(case, plan))
    except CalibkitError as error:
        return Outcome({}, {}, refused=str(error))
    wide = _exact(case)
    second = errors if case.error == SECOND else np.zeros(3)
    if case.procedure.startswith(K):
        inside, width = _judge_k(fitted.k, triad, plan, second, wide)
    elif case.procedure.startswith(AFFINE):
        assert fitted.affine is not None  # noqa: S101 (the recipe enables it)
        assert fitted.q is not None  # noqa: S101
        inside, width = _judge_affine(fitted.affine, fitted.q, triad, plan, second, wide)
    else:
        assert fitted.affine is not None  # noqa: S101
        assert fitted.q is not None  # noqa: S101
        inside, width = _judge_lengths(fitted.affine, fitted.q, triad, plan, second, wide)
    flags = (*fitted.k_flags, *fitted.affine_flags)
    warned = any(text in flag for flag in flags for text in FEW)
    rejected = bool(judge_lack_of_fit(fitted.lack_of_fit))
    return Outcome(inside, width, warned=warned, rejected=rejected)


def _dwells(case: Case, plan: _Plan, indicated: Array) -> DwellSet:
    """Dwells of a campaign; by magnitude each session is a log."""
    count = len(indicated)
    by_length = case.procedure.startswith(LENGTH)
    unknown = np.full(count, np.nan)
    inclination, toolface = (unknown, unknown) if by_length else plan.angle.T
    return DwellSet(
        indicated,
        plan.degc,
        inclination,
        toolface,
        np.full(indicated.shape, np.nan),
        3600.0 * plan.hours if case.error == DRIFT else unknown,
        plan.soak if by_length else np.zeros(count, dtype=np.int64),
        tuple(f"a.csv:{row}" for row in range(count)),
        (),
    )


Judged = tuple[dict[str, "Array"], dict[str, "Array"]]


def _compare(
    found: Sequence[tuple[str, Array, Array, Array, Array]], wide: dict[str, Array]
) -> Judged:
    """Whether truths are inside and how wide the intervals are, from (quantity, values, truths,
    standard uncertainties, degrees of freedom).
    """
    inside, width = {}, {}
    for name, values, truths, u, dof in found:
        factor = np.array([gum.coverage_factor(float(d), probability=0.95) for d in dof])
        inside[name] = (np.abs(values - truths) <= factor * u).astype(np.float64)
        width[name] = factor * u / wide[name]
    return inside, width


def _coefficients(model: Model) -> tuple[Array, Array, Array]:
    """Values, standard uncertainties and degrees of freedom [p] of a model."""
    listed = [(c.value, c.standard_uncertainty, model.dof_of(c)) for c in model.coefficients]
    values, u, dof = np.array(listed).T
    return values, u, dof


def _corrected(
    model: Model,
    triad: Triad,
    axes: Sequence[int],
    second: Array,
    held_degc: Array = BETWEEN_DEGC,
) -> tuple[Array, ...]:
    """Corrected components, their truth, standard uncertainties and degrees of freedom [m]."""
    vectors, degc = _faces(held_degc)
    at = forms.inputs(_at_faces(triad, second, held_degc), degc)
    form = forms.K if len(axes) == 1 else forms.AFFINE
    values = form.evaluate(model, at).reshape(len(degc), -1).ravel()
    slopes = form.gradient(model, at).reshape(values.size, -1)
    covariance, dof = np.array(model.covariance), _coefficients(model)[2]
    u = np.sqrt(np.einsum("mp,pq,mq->m", slopes, covariance, slopes))
    own = np.array([gum.degrees_of_freedom(row, covariance, dof) for row in slopes])
    return values, vectors[:, list(axes)].ravel(), u, own


def _at_faces(triad: Triad, second: Array, held_degc: Array = BETWEEN_DEGC) -> Array:
    """Indications [m, 3] at the faces of a sensor with an error of second order [3]."""
    vectors, degc = _faces(held_degc)
    nothing = np.zeros(vectors.shape)
    return triad.indication(vectors, degc, nothing, nothing, second)


def _faces(held_degc: Array = BETWEEN_DEGC) -> tuple[Array, Array]:
    """Gravity [m, 3] and temperatures [m] at which corrected vectors are judged."""
    faces = np.vstack([(np.eye(3)[k % 3], -np.eye(3)[k % 3]) for k in range(len(held_degc))])
    return faces, np.repeat(held_degc, 2)


def _true_k(triad: Triad, plan: _Plan) -> tuple[k_factor.KAxis, ...]:
    """K of the same dwells without errors."""
    down, nothing = gravity(plan.angle, np.array([0.0, 0.0, 1.0])), np.zeros((len(plan.soak), 3))
    clean = triad.indication(down, plan.degc, nothing, nothing, np.zeros(3))
    return k_factor.fit(clean, plan.degc, down)


def _judge_k(
    models: Sequence[Model], triad: Triad, plan: _Plan, second: Array, wide: dict[str, Array]
) -> Judged:
    """K4 … K7 and corrected components of three axes."""
    truth = _true_k(triad, plan)
    zeros, vectors = [], []
    for axis, model in enumerate(models):
        values, u, dof = _coefficients(model)
        zeros.append(np.array([values[4:8], truth[axis].coefficients[4:8], u[4:8], dof[4:8]]))
        vectors.append(np.array(_corrected(model, triad, [axis], second)))
    parts = {"K4–K7": np.hstack(zeros), "corrected vector": np.hstack(vectors)}
    return _compare([(name, *part) for name, part in parts.items()], wide)


def _affine_truth(triad: Triad, plan: _Plan) -> affine.AffineFit:
    """Affine triad of the same dwells without errors."""
    down, nothing = gravity(plan.angle, np.array([0.0, 0.0, 1.0])), np.zeros((len(plan.soak), 3))
    clean = triad.indication(down, plan.degc, nothing, nothing, np.zeros(3))
    return affine.fit(clean, plan.degc, down)


def _judge_affine(
    model: Model, q: Model, triad: Triad, plan: _Plan, second: Array, wide: dict[str, Array]
) -> Judged:
    """Affine parameters, corrected components, and Q at the reference temperature."""
    truth = _affine_truth(triad, plan)
    values, u, dof = _coefficients(model)
    angles, u_q, dof_q = _coefficients(q)
    return _compare(
        [
            ("affine parameters", values, truth.coefficients, u, dof),
            ("corrected vector", *_corrected(model, triad, [0, 1, 2], second)),
            ("Q", angles, truth.evaluate_q(ROOM_DEGC)[0], u_q, dof_q),
        ],
        wide,
    )


def _lengths(parameters: Array, indication: Array) -> Array:
    """Lengths [n] of corrected vectors by the nine parameters."""
    axes = q_factor.axes_from_angles(parameters[6:9])
    matrix = q_factor.exact_matrix(axes) / parameters[:3]
    return np.asarray(np.linalg.norm((indication - parameters[3:6]) @ matrix.T, axis=1))


def _judge_lengths(
    model: Model, q: Model, triad: Triad, plan: _Plan, second: Array, wide: dict[str, Array]
) -> Judged:
    """Constant matrix and bias, corrected components, and Q, from lengths alone."""
    truth = _true_lengths(triad, plan)
    values, u, dof = _coefficients(model)
    angles, u_q, dof_q = _coefficients(q)
    return _compare(
        [
            ("matrix and bias", values, truth.as_affine()[1], u, dof),
            ("corrected vector", *_corrected(model, triad, [0, 1, 2], second, AT_ROOM_DEGC)),
            ("Q", angles, truth.parameters[6:], u_q, dof_q),
        ],
        wide,
    )


def _true_lengths(triad: Triad, plan: _Plan) -> magnitude.MagnitudeFit:
    """Nine parameters of the same dwells without errors."""
    down, nothing = gravity(plan.angle, np.array([0.0, 0.0, 1.0])), np.zeros((len(plan.soak), 3))
    return magnitude.fit(triad.indication(down, plan.degc, nothing, nothing, np.zeros(3)))


@lru_cache(maxsize=8)
def _exact(case: Case) -> dict[str, Array]:
    """Exact half-widths of each quantity, for a triad like the others."""
    triad, plan = _draw(np.random.default_rng(1), case.procedure), _plan(case)
    count, size = _latent(case), _size(case, plan)
    clean = _indicated(case, triad, plan, np.zeros(count))
    step = max(size, NOISE_G)
    moved = [_indicated(case, triad, plan, step * row) - clean for row in np.eye(count)]
    shared = np.array(moved).reshape(count, clean.size).T * (size / step)
    if case.procedure.startswith(K):
        return _exact_k(triad, plan, clean, shared, size if case.error == SECOND else 0.0)
    if case.procedure.startswith(AFFINE):
        return _exact_affine(triad, plan, clean, shared, size if case.error == SECOND else 0.0)
    return _exact_lengths(triad, plan, clean, shared, size if case.error == SECOND else 0.0)


def _own_second(size: float, q: int) -> Array:
    """Derivatives [m, 3, q] of the components at the faces by errors of second order; none where
    there are no such errors.
    """
    faces, _ = _faces()
    if size == 0.0:
        return np.zeros((*faces.shape, q))
    return np.asarray(size * np.eye(3) * faces[:, :, None] ** 2)


def _scale_factors(names: Sequence[str], size: float, q: int) -> Array:
    """Derivatives [p, q] of what scale factors are by errors of second order: the slopes to +1 g
    and to −1 g differ by two such errors, and a scale factor is one or the other.
    """
    own = np.zeros((len(names), q))
    for axis, name in enumerate(("m_xx0", "m_yy0", "m_zz0")):
        if size:
            own[list(names).index(name), axis] = size
    return own


def _exact_k(
    triad: Triad, plan: _Plan, clean: Array, shared: Array, second: float
) -> dict[str, Array]:
    """Of the three axes together; `second` is the size of second-order errors."""
    mapped = [k_factor.columns(clean, plan.degc, axis) for axis in range(3)]
    design = np.zeros((len(clean), 3, 30))
    _, degc = _faces()
    shown = _at_faces(triad, np.zeros(3))
    zeros, vectors = [], []
    for axis in range(3):
        own = slice(10 * axis, 10 * axis + 10)
        design[:, axis, own] = mapped[axis]
        zeros.append(np.eye(30)[own][4:8])
        rows = np.zeros((len(degc), 30))
        rows[:, own] = k_factor.columns(shown, degc, axis)
        vectors.append(rows)
    flat = design.reshape(-1, 30)
    own_errors = np.concatenate(list(np.swapaxes(_own_second(second, shared.shape[1]), 0, 1)))
    return {
        "K4–K7": exact.half_widths(flat, shared, NOISE_G, np.vstack(zeros)),
        "corrected vector": exact.half_widths(
            flat, shared, NOISE_G, np.vstack(vectors), own_errors
        ),
    }


def _exact_affine(
    triad: Triad, plan: _Plan, clean: Array, shared: Array, second: float
) -> dict[str, Array]:
    """Of the affine triad; `second` is the size of second-order errors."""
    truth = _affine_truth(triad, plan)
    values, entries = truth.coefficients, truth.entries
    design = affine_model.evaluate(entries, values, clean, plan.degc)[1].reshape(clean.size, -1)
    faces, degc = _faces()
    shown = _at_faces(triad, np.zeros(3))
    vectors = affine_model.evaluate(entries, values, shown, degc)[1].reshape(faces.size, -1)

    def angles(at: Array) -> Array:
        matrix = affine_model.matrix_and_bias(entries, at, np.array([ROOM_DEGC]))[0][0]
        return q_factor.small_angles(q_factor.axes_from_sensitivity(np.linalg.inv(matrix))[0])

    slopes = q_factor.differentiate(angles, values, scale=np.maximum(np.abs(values), 1e-6))
    own = _own_second(second, shared.shape[1]).reshape(faces.size, -1)
    scales = _scale_factors(truth.names, second, shared.shape[1])
    return {
        "affine parameters": exact.half_widths(
            design, shared, NOISE_G, np.eye(values.size), scales
        ),
        "corrected vector": exact.half_widths(design, shared, NOISE_G, vectors, own),
        "Q": exact.half_widths(design, shared, NOISE_G, slopes),
    }


def _exact_lengths(
    triad: Triad, plan: _Plan, clean: Array, shared: Array, second: float
) -> dict[str, Array]:
    """Of the nine parameters from lengths; `second` is the size of second-order errors."""
    truth = _true_lengths(triad, plan)
    at, scale = truth.parameters, np.ones(9)
    design = q_factor.differentiate(lambda p: _lengths(p, clean), at, scale=scale)
    # a change of the indication moves the length along the unit vector of gravity
    down = gravity(plan.angle, np.array([0.0, 0.0, 1.0]))
    along = np.einsum("ni,niq->nq", down, shared.reshape(len(clean), 3, -1))
    to_affine = q_factor.differentiate(magnitude.to_triangle, at, scale=scale)
    names, entries, _ = truth.as_affine()
    faces, shown = _faces(AT_ROOM_DEGC)[0], _at_faces(triad, np.zeros(3), AT_ROOM_DEGC)

    def corrected(values: Array) -> Array:
        return ((shown - values[6:]) @ lower_matrix(values[:6]).T).ravel()

    vectors = q_factor.differentiate(corrected, entries, scale=scale) @ to_affine
    own = _own_second(second, shared.shape[-1]).reshape(faces.size, -1)
    named = {
        "matrix and bias": (to_affine, _scale_factors(names, second, shared.shape[-1])),
        "corrected vector": (vectors, own),
        "Q": (np.eye(9)[6:], 0.0),
    }
    return {
        name: exact.half_widths(design, along, NOISE_G, rows, part)
        for name, (rows, part) in named.items()
    }

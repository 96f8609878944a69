"""Solution of an affine fit in mapped temperature: ordinary or robust least squares, then with
errors that dwells share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibkit.arrays import Array, Integers, Mask
from calibkit.instruments.accelerometer.numeric import common_errors, q_factor
from calibkit.instruments.accelerometer.numeric.affine_model import (
    Entry,
    evaluate,
    matrix_and_bias,
)
from calibkit.instruments.accelerometer.numeric.dwell_fit import MappedFit
from calibkit.instruments.accelerometer.numeric.shared_errors import Refine, Residuals
from calibkit.numeric.least_squares import gauss_newton, polynomial, robust
from calibkit.numeric.least_squares.structure import Structure

WEAKEST = 1e-4
"""Smallest singular value of the scaled Jacobian, relative to the largest, with which all
parameters count as determined.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class AffineFit(MappedFit):
    """Result of an affine fit; residuals are corrected components (rotated by the fixture) minus
    reference [n, 3], or magnitudes minus gravity [n, 1].
    """

    entries: tuple[Entry, ...]
    """The parameters, in the order of the coefficients."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(entry.name for entry in self.entries)

    def evaluate_q(self, temperature: float) -> tuple[Array, Array]:
        """Q1, Q2, Q3 [3] [rad] of the fitted axes at one temperature [°C], and their covariance [3,
        3].
        """
        angles, slopes = self._angles(temperature)
        return angles, slopes @ self.mapped_covariance @ slopes.T

    def q_dof(self, temperature: float) -> Array | None:
        """Effective degrees of freedom [3] of Q1, Q2, Q3 at one temperature [°C]; None: `dof`."""
        if self.mixed is None:
            return None
        return self.mixed.effective_dof_of(self._angles(temperature)[1])

    def _angles(self, temperature: float) -> tuple[Array, Array]:
        """Q1, Q2, Q3 [3] [rad] and their derivatives [3, p] by the mapped coefficients."""
        mapped = (temperature - self.middle) / self.half
        values = self.mapped_coefficients
        matrix = matrix_and_bias(self.entries, values, np.array([mapped]))[0].ravel()

        def angles(matrix: Array) -> Array:
            sensitivity = np.asarray(np.linalg.inv(matrix.reshape(3, 3)), dtype=np.float64)
            return q_factor.small_angles(q_factor.axes_from_sensitivity(sensitivity)[0])

        by_values = np.zeros((9, values.size))
        for k, entry in enumerate(self.entries):
            if entry.kind == "m":
                by_values[3 * entry.row + entry.factors[0], k] = mapped**entry.power
        scale = np.full(9, np.max(np.abs(matrix)))
        return angles(matrix), q_factor.differentiate(angles, matrix, scale=scale) @ by_values


@dataclass(frozen=True, slots=True)
class Problem:
    """Residuals and derivatives of an affine fit in mapped temperature."""

    entries: tuple[Entry, ...]
    indication: Array
    temperature: Array
    middle: float
    half: float
    root: Array
    reference: Array | None = None
    tool_rotation: Array | None = None
    gravity: float = 1.0

    def __call__(self, parameters: Array, rows: slice | Integers) -> tuple[Array, Array]:
        """Weighted residuals [3 n] against reference vectors, or [n] against gravity's magnitude,
        and their derivatives by the parameters.
        """
        mapped = (self.temperature[rows] - self.middle) / self.half
        corrected, slopes = evaluate(self.entries, parameters, self.indication[rows], mapped)
        root = self.root[rows]
        if self.reference is None:
            length = np.linalg.norm(corrected, axis=1)
            along = np.einsum("ni,nip->np", corrected / length[:, None], slopes)
            return (length - self.gravity) * root[:, 0], along * root
        places = {
            kind: [c for c, e in enumerate(self.entries) if e.kind == kind]
            for kind in ("tilt", "fixture")
        }
        reference = self.reference[rows]
        if places["tilt"] and self.tool_rotation is not None:
            reference, tilted = _tilted_gravity(
                self.tool_rotation[rows], parameters[places["tilt"]]
            )
            slopes[:, :, places["tilt"]] = -tilted
        if places["fixture"]:
            angles = parameters[places["fixture"]]
            turn = _rotation(angles)
            turns = q_factor.differentiate(
                lambda a: _rotation(a).ravel(), angles, scale=np.ones(3)
            ).reshape(3, 3, 3)
            model = [
                c for c in range(len(self.entries)) if c not in places["tilt"] + places["fixture"]
            ]
            slopes[:, :, model] = turn @ slopes[:, :, model]
            slopes[:, :, places["fixture"]] = np.einsum("ijp,nj->nip", turns, corrected)
            corrected = corrected @ turn.T
        weighted = slopes * root[:, :, None]
        return ((corrected - reference) * root).ravel(), weighted.reshape(-1, len(self.entries))

    def unweighted(self, parameters: Array, dwells: Integers) -> tuple[Array, Array]:
        """Residuals [3 m] or [m] of some dwells and their derivatives."""
        weighted, slopes = self(parameters, dwells)
        root = self.root[dwells].ravel()
        return weighted / root, slopes / root[:, None]

    def directions(self, parameters: Array) -> Residuals:
        """Where the residuals point."""
        if self.reference is not None:
            return Residuals.of_components(len(self.indication))
        mapped = (self.temperature - self.middle) / self.half
        return Residuals.of_lengths(evaluate(self.entries, parameters, self.indication, mapped)[0])


def solve(
    problem: Problem,
    begin: Array,
    loss: Literal["least_squares", "robust"],
    refine: Refine | None,
) -> AffineFit:
    """Solve by Gauss-Newton in mapped temperature; for a robust loss, go on with robust fits of the
    linearised problem, then with errors that dwells share.
    """
    rows = len(problem.indication)
    names = [entry.name for entry in problem.entries]
    found = gauss_newton.fit(problem, begin, rows, names=names, weakest=WEAKEST)
    values, matrix, condition = found.parameters, found.covariance, found.condition
    used, structured = np.ones(problem.root.size, dtype=np.bool_), tuple[Structure, ...]()
    if loss == "robust":
        common = common_errors.label(problem.temperature, problem.reference, problem.root.shape[1])
        values, tough = robust.nonlinear(
            lambda at: problem(at, slice(0, rows)), values, names=names, groups=common
        )
        structured = tough.structured
        matrix, condition = tough.fit.covariance, tough.fit.condition
        used[list(tough.suspects)] = False
    if refine is None:
        return _finish(problem, values, matrix, used, condition, structured)
    refined = refine(
        problem.unweighted,
        values,
        at=problem.directions(values),
        weights=problem.root.ravel() ** 2,
        used=used,
        leave_out=loss == "robust",
        names=names,
    )
    mixed, values = refined.shared.found, refined.parameters
    to_raw = _to_raw_matrix(problem.entries, problem.middle, problem.half)
    return replace(
        _finish(problem, values, mixed.covariance, refined.used, mixed.condition, structured),
        effective_dof=mixed.effective_dof_of(np.asarray(to_raw, dtype=np.float64)),
        mixed=mixed,
        lack_of_fit=refined.lack_of_fit,
        flags=refined.flags,
    )


def _finish(
    problem: Problem,
    values: Array,
    matrix: Array,
    used: Mask,
    condition: float,
    structured: Sequence[Structure],
) -> AffineFit:
    """Fit from parameters in mapped temperature and their covariance; `used` tells which residuals
    are no outliers, `structured` which stand apart together.
    """
    entries, rows = problem.entries, len(problem.indication)
    residuals = problem(values, slice(0, rows))[0].reshape(rows, -1)
    kept = used.reshape(rows, -1)
    left_out = np.flatnonzero(~kept.all(axis=1))
    size = np.max(np.abs(residuals[left_out]), axis=1)
    worst_first = tuple(left_out[np.argsort(-size, kind="stable")].tolist())
    dof = int(used.sum()) - len(entries)
    to_raw = _to_raw_matrix(entries, problem.middle, problem.half)
    coefficients, covariance = polynomial.in_raw_powers(values, matrix, to_raw)
    mean_square = np.sum(residuals[kept] ** 2) / np.sum(problem.root[kept] ** 2)
    return AffineFit(
        entries=entries,
        coefficients=coefficients,
        covariance=covariance,
        mapped_coefficients=values,
        mapped_covariance=matrix,
        middle=problem.middle,
        half=problem.half,
        residuals=residuals / problem.root,
        common_errors=common_errors.read(structured, residuals / problem.root),
        suspects=worst_first,
        left_out=worst_first,
        dof=dof,
        residual_rms=float(np.sqrt(mean_square * used.sum() / max(dof, 1))),
        condition=condition,
    )


def _to_raw_matrix(
    entries: tuple[Entry, ...], middle: float, half: float
) -> NDArray[np.longdouble]:
    """Matrix [p, p] that converts parameters in mapped temperature to powers of °C."""
    matrix = np.eye(len(entries), dtype=np.longdouble)
    powers = polynomial.to_raw_powers(middle, half, max(entry.power for entry in entries))
    for row, this in enumerate(entries):
        for column, other in enumerate(entries):
            if this.symbol == other.symbol:
                matrix[row, column] = powers[this.power, other.power]
    return matrix


def _rotation(angles: Array) -> Array:
    """Rotation matrix [3, 3] of a rotation vector [3] [rad] (Rodrigues 1840)."""
    x, y, z = angles
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = float(np.linalg.norm(angles))
    # sin(a)/a and (1 − cos a)/a², exact at a = 0
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross, dtype=np.float64)


def _tilted_gravity(tool_rotation: Array, tilt: Array) -> tuple[Array, Array]:
    """Gravity vectors [n, 3] in the tool with the base tilted by two angles, and their derivatives
    [n, 3, 2] by these angles.
    """
    length = np.sqrt(1.0 + tilt @ tilt)
    down = np.array([tilt[0], tilt[1], 1.0]) / length
    slope = (np.eye(3)[:, :2] - np.outer(down, down[:2])) / length
    return tool_rotation @ down, tool_rotation @ slope

"""The affine triad over temperature, G' = M(t) (V − b(t)), of which K- and Q-factor are special
cases.

Every entry of M and b is a polynomial in temperature. Optional are the second- and third-order
terms and cross products of the IEEE 1293 model equation (K₂, K₃, K_ip, K_io, here on the
indications and constant in temperature), and nuisance parameters: the tilt of the table's base and
the angles of the fixture, which otherwise bias the cross-axis terms. M can represent the rotation
of a fixture too, so with fixture angles M is lower triangular: the frame of the triad is e1 = x.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import (
    common_errors,
    determination,
    magnitude,
    q_factor,
)
from calibkit.instruments.accelerometer.numeric.affine_model import (
    AXES,
    AffineTerms,
    Entry,
    evaluate,
    matrix_and_bias,
)
from calibkit.instruments.accelerometer.numeric.dwell_fit import MappedFit
from calibkit.numeric.least_squares import fit as least_squares, gauss_newton, polynomial, robust

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
        mapped = np.array([(temperature - self.middle) / self.half])

        def angles(values: Array) -> Array:
            matrix = matrix_and_bias(self.entries, values, mapped)[0][0]
            return q_factor.small_angles(q_factor.axes_from_sensitivity(np.linalg.inv(matrix))[0])

        values = self.mapped_coefficients
        largest = max(abs(v) for e, v in zip(self.entries, values, strict=True) if e.kind == "m")
        slope = q_factor.differentiate(angles, values, scale=np.full(values.size, float(largest)))
        return angles(values), slope @ self.mapped_covariance @ slope.T


def fit(
    indication: Array,
    temperature: Array,
    reference: Array,
    *,
    terms: AffineTerms = AffineTerms(),  # noqa: B008 frozen
    weights: Array | None = None,
    tool_rotation: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
) -> AffineFit:
    """Fit the affine triad to reference vectors.

    Parameters
    ----------
    indication
        [n, 3], dwell means; nominally scaled to g where higher orders are fitted.
    temperature
        [n] [°C].
    reference
        [n, 3] [g], from `attitude.gravity_vector`.
    terms
        Which parameters.
    weights
        [n] or [n, 3], 1/variance of the dwell means.
    tool_rotation
        [n, 3, 3], from `attitude.tool_rotation`; needed for the tilt.
    loss
        "robust" leaves outliers out and names them.

    Raises
    ------
    FitError
        When the conditions do not determine a parameter: names it, says why and which dwells to
        add.

    """
    entries = terms.list_entries(triangular=terms.fixture)
    _require_enough(len(indication), indication.size, len(entries))
    if terms.tilt and tool_rotation is None:
        raise FitError(
            "a tilt needs the table's rotations",
            hint="give inclination_deg and toolface_deg of the dwells",
        )
    _require_determined(entries, reference, temperature)
    root = (
        np.ones(indication.shape)
        if weights is None
        else np.sqrt(np.broadcast_to(weights.T, (3, len(weights))).T)
    )
    middle, half = polynomial.middle_and_half(temperature)
    problem = _Problem(
        entries, indication, temperature, middle, half or 1.0, root, reference, tool_rotation
    )
    return _solve(problem, _starting_parameters(entries, indication, reference), loss)


def fit_magnitude(
    indication: Array,
    temperature: Array,
    gravity: float = 1.0,
    *,
    terms: AffineTerms = AffineTerms(1, 0, 1),  # noqa: B008 frozen
    weights: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
) -> AffineFit:
    """Fit the affine triad to the magnitude of gravity alone, M lower triangular: attitudes
    unknown, temperatures known.

    Parameters
    ----------
    indication
        [n, 3], dwell means.
    temperature
        [n] [°C].
    gravity
        Local gravity in the unit that corrected components shall have.
    terms
        Which parameters; no nuisance angles, lengths do not see them.
    weights
        [n], 1/variance of the length.
    loss
        "robust" leaves outliers out and names them.

    Raises
    ------
    FitError
        When the dwells leave a parameter undetermined.

    """
    if terms.tilt or terms.fixture:
        raise FitError(
            "lengths see no tilt and no fixture", hint="leave them out, or give reference attitudes"
        )
    entries = terms.list_entries(triangular=True)
    _require_enough(len(indication), len(indication), len(entries))
    order = max(entry.power for entry in entries)
    levels, _ = determination.distinct_temperatures(temperature)
    if levels.size <= order:
        raise FitError(
            f"{levels.size} distinct temperatures do not determine order {order}",
            hint="lower the orders",
        )
    root = np.ones((len(indication), 1)) if weights is None else np.sqrt(weights)[:, None]
    sphere = magnitude.fit_sphere(indication, gravity)
    begin = _constant_parameters(entries, np.diag(1.0 / sphere[:3]), sphere[3:6])
    middle, half = polynomial.middle_and_half(temperature)
    problem = _Problem(entries, indication, temperature, middle, half or 1.0, root, gravity=gravity)
    return _solve(problem, begin, loss)


def _require_enough(dwells: int, residuals: int, parameters: int) -> None:
    """Raise FitError for fewer residuals than the parameters need."""
    if residuals <= parameters:
        raise FitError(
            f"{dwells} dwells for {parameters} parameters", hint="add dwells or lower the orders"
        )


@dataclass(frozen=True, slots=True)
class _Problem:
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

    def __call__(self, parameters: Array, rows: slice) -> tuple[Array, Array]:
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


def _starting_parameters(entries: tuple[Entry, ...], indication: Array, reference: Array) -> Array:
    """Starting parameters [p]: temperature-independent M and b, by a fit linear in M and M b."""
    design = np.column_stack([indication, np.ones(len(indication))])
    # noise makes the indications appear full rank: the rank of the reference attitudes decides
    if determination.affine_rank(reference) == 4 and least_squares.rank(design) == 4:
        solved = np.array(
            [least_squares.linear(design, reference[:, i]).coefficients for i in range(3)]
        )
    else:
        # too few attitudes for a full matrix: each axis on its own indication
        slope = np.sum(indication * reference, axis=0) / np.sum(indication**2, axis=0)
        solved = np.column_stack([np.diag(slope), np.zeros(3)])
    matrix, bias = solved[:, :3], -np.linalg.solve(solved[:, :3], solved[:, 3])
    angles = np.zeros(3)
    if any(entry.kind == "fixture" for entry in entries):
        from scipy.spatial.transform import Rotation

        axes, turned, scale = q_factor.axes_from_sensitivity(np.linalg.inv(matrix))
        matrix = q_factor.exact_matrix(axes) / scale
        angles = Rotation.from_matrix(turned.T).as_rotvec()
    return _constant_parameters(entries, matrix, bias, angles)


def _constant_parameters(
    entries: tuple[Entry, ...],
    matrix: Array,
    bias: Array,
    angles: Array = np.zeros(3),  # noqa: B008
) -> Array:
    """Parameters [p] of a constant matrix [3, 3], bias [3] and fixture angles [3]."""
    values = {
        "m": lambda e: matrix[e.row, e.factors[0]],
        "b": lambda e: bias[e.row],
        "fixture": lambda e: angles[e.row],
    }
    return np.array(
        [values[e.kind](e) if e.power == 0 and e.kind in values else 0.0 for e in entries]
    )


def _require_determined(entries: tuple[Entry, ...], reference: Array, temperature: Array) -> None:
    """Raise FitError where the conditions do not determine an entry of M or b or a higher-order
    term.
    """
    nominal = np.array(
        [float(e.kind == "m" and e.power == 0 and e.factors == (e.row,)) for e in entries]
    )
    parts = []
    for i in range(3):
        own = [c for c, e in enumerate(entries) if e.row == i and e.kind in ("m", "b", "n")]
        # low powers first, then the axis itself and its bias, then the other axes and the higher
        # orders
        own.sort(key=lambda c, i=i: (entries[c].power, entries[c].factors not in ((i,), ()), c))  # type: ignore[misc]

        def design(vectors: Array, mapped: Array, axis: int = i, used: list[int] = own) -> Array:
            return evaluate(entries, nominal, vectors, mapped)[1][:, axis, used]

        parts.append(
            determination.Part(f"accel_{AXES[i]}", tuple(entries[c].name for c in own), design)
        )
    determination.require_determined(
        parts,
        reference,
        temperature,
        order=max(entry.power for entry in entries),
        lower="lower scale_order, cross_order and bias_order, or leave out higher-order terms",
    )


def _solve(problem: _Problem, begin: Array, loss: Literal["least_squares", "robust"]) -> AffineFit:
    """Solve by Gauss-Newton in mapped temperature; for a robust loss, go on with robust fits of the
    linearised problem.
    """
    entries, rows = problem.entries, len(problem.indication)
    names = [entry.name for entry in entries]
    found = gauss_newton.fit(problem, begin, rows, names=names, weakest=WEAKEST)
    values, matrix, condition = found.parameters, found.covariance, found.condition
    tough: robust.RobustFit | None = None
    used = np.ones(problem.root.shape, dtype=np.bool_)
    if loss == "robust":
        common = common_errors.label(problem.temperature, problem.reference, problem.root.shape[1])
        values, tough = robust.nonlinear(
            lambda at: problem(at, slice(0, rows)), values, names=names, groups=common
        )
        matrix, condition = tough.fit.covariance, tough.fit.condition
        # of a suspect dwell the other components are fitted
        used = (tough.ratio <= robust.DOUBTFUL).reshape(used.shape)
    residuals = problem(values, slice(0, rows))[0].reshape(rows, -1)
    suspects, left_out = common_errors.find_suspects(tough, problem.root.shape[1])
    unweighted, dof = residuals / problem.root, int(used.sum()) - len(entries)
    variance = float(np.sum(residuals[used] ** 2)) / dof
    coefficients, covariance = polynomial.in_raw_powers(
        values, matrix, _to_raw_matrix(entries, problem.middle, problem.half)
    )
    return AffineFit(
        entries=entries,
        coefficients=coefficients,
        covariance=covariance,
        mapped_coefficients=values,
        mapped_covariance=matrix,
        middle=problem.middle,
        half=problem.half,
        residuals=unweighted,
        suspects=suspects,
        left_out=left_out,
        common_errors=common_errors.read(tough.structured if tough else (), unweighted),
        dof=dof,
        residual_rms=float(np.sqrt(variance * used.sum() / np.sum(problem.root[used] ** 2))),
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

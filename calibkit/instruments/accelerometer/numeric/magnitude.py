"""Scale factor, bias and non-orthogonality of a triad from the magnitude of gravity alone, when
attitudes are unknown.

Nine parameters: scale factors k, biases b, and Q1, Q2, Q3 (Zhou, Hu & Fu 2010, exact form). The
corrected vector is Q diag(1/k) (V − b) with Q the inverse of the unit axes, and |G'| is to be the
local gravity. Lengths do not depend on how the triad is mounted, so its orientation stays unknown.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import common_errors, profile, q_factor
from calibkit.instruments.accelerometer.numeric.dwell_fit import DwellFit
from calibkit.instruments.accelerometer.numeric.norms import (
    LOWER,
    length_residuals,
    lower_matrix,
    sum_squares,
)
from calibkit.numeric.least_squares import fit as least_squares, fold, gauss_newton, gram, robust

NAMES = ("k_x", "k_y", "k_z", "b_x", "b_y", "b_z", "Q1", "Q2", "Q3")
LARGEST_Q = 0.35
"""Bound of each Q [rad]: 20°, far above the non-orthogonality of any triad."""
POOR_Q, POOR_SHARE = np.radians(0.25), 5e-3
"""95 % half-widths that are flagged as too wide: of a Q [rad]; of a relative scale factor, or of a
bias relative to gravity.
"""
ILL_CONDITIONED = 20.0
"""Condition number above which the attitudes determine some combination of parameters poorly; the
six-position tumble has 1.7.
"""
ENOUGH_TO_START = 20_000
"""Rows, evenly spread over a larger set, from which the starting parameters are found."""
WEAKEST = 1e-4
"""Smallest singular value of the scaled Jacobian, relative to the largest, below which the fit is
refused.
"""
FEW_DOF = 5
"""Degrees of freedom below which the residuals are too few to judge the uncertainty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnitudeFit(DwellFit):
    """A finished magnitude-only fit: nine parameters in the order of NAMES.

    The covariance is by the residuals or by the stated noise, whichever is larger; the residuals
    [n] are |G'| − gravity [unit of gravity].
    """

    parameters: Array
    """k [indication per g unit], b [indication], Q [rad]: [9]."""
    leverage: Array
    """[n], leverage (diagonal of the hat matrix): near 1, no other dwell checks this one."""

    @property
    def half_width(self) -> Array:
        """Half-widths [9] of the 95 % intervals by Student's t."""
        return self.standard_uncertainty * _t95(self.dof)

    @property
    def matrix(self) -> Array:
        """Correction matrix [3, 3]: corrected = matrix · (indication − bias)."""
        return _correction_matrix(self.parameters)

    @property
    def bias(self) -> Array:
        """[3], unit of the indication."""
        return self.parameters[3:6]

    def as_affine(self) -> tuple[tuple[str, ...], Array, Array]:
        """Names, values [9] and covariance [9, 9] of the equivalent affine parameters."""
        parameters = self.parameters
        scale = np.maximum(np.abs(parameters), 1e-3)
        slopes = q_factor.differentiate(to_triangle, parameters, scale=scale)
        names = (*(f"m_{'xyz'[i]}{'xyz'[j]}0" for i, j in LOWER), "b_x0", "b_y0", "b_z0")
        return names, to_triangle(parameters), slopes @ self.covariance @ slopes.T


def _correction_matrix(parameters: Array) -> Array:
    """Lower triangular correction matrix [3, 3] of the nine parameters: exact Q · diag(1/k)."""
    return q_factor.exact_matrix(q_factor.axes_from_angles(parameters[6:9])) / parameters[None, 0:3]


def fit(
    indication: Array,
    gravity: float = 1.0,
    *,
    noise: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
) -> MagnitudeFit:
    """Fit the nine parameters by Gauss-Newton with step control, block by block: memory does not
    grow with the rows.

    Parameters
    ----------
    indication
        [n, 3], dwell means, in any unit.
    gravity
        Local gravity in the unit that corrected components shall have.
    noise
        [n], standard deviation of each |G'| [unit of gravity]: weights, and a floor under the
        uncertainty.
    loss
        "robust" leaves outliers out and names them.

    Raises
    ------
    FitError
        For fewer than nine dwells, dwells on one cone or plane, or no convergence.

    """
    _require_enough(indication)
    root = np.ones(len(indication)) if noise is None else 1.0 / noise

    def residuals(parameters: Array, rows: slice) -> tuple[Array, Array]:
        return length_residuals(parameters, indication[rows], gravity, root[rows])

    begin = to_triangle(fit_sphere(indication, gravity))
    near = gauss_newton.fit_some_rows(residuals, begin, len(indication), enough=ENOUGH_TO_START)
    found = gauss_newton.fit(
        residuals, near, len(indication), names=TRIANGLE_NAMES, weakest=WEAKEST
    )
    if loss == "robust":
        triangle, tough = robust.nonlinear(
            lambda at: length_residuals(at, indication, gravity, root),
            found.parameters,
            names=TRIANGLE_NAMES,
        )
        return complete_fit(
            *(triangle, tough.fit.covariance, indication, gravity, root),
            (tough.fit.condition, tough),
        )
    inverse = found.normal_inverse * _variance(found.square, found.dof, absolute=noise is not None)
    return complete_fit(
        *(found.parameters, inverse, indication, gravity, root),
        (found.condition, None),
        found.normal_inverse,
    )


def fit_bounded(
    indication: Array, gravity: float = 1.0, *, noise: Array | None = None
) -> tuple[MagnitudeFit, Mapping[str, tuple[float, float]]]:
    """Fit the same nine parameters by lmfit, named and bounded, and give their 95 % confidence
    intervals.

    The intervals are profile intervals: each parameter is stepped and the others refitted until the
    F-test rejects at 5 %. An end that is never rejected inside the bounds is infinite.

    Parameters
    ----------
    indication, gravity, noise
        As for `fit`.

    Returns
    -------
    The fit, in the same record as `fit`, and parameter name to (low, high).

    Raises
    ------
    FitError
        As `fit`.

    """
    _require_enough(indication)
    root = np.ones(len(indication)) if noise is None else 1.0 / noise
    begin = fit_sphere(indication, gravity)
    problem = _bounded(begin, indication, gravity, root)
    parameters, square = problem.minimize(begin)
    triangle = to_triangle(parameters)
    jacobian = length_residuals(triangle, indication, gravity, root)[1]
    inverse = np.linalg.inv(np.linalg.qr(jacobian, mode="r"))
    dof = len(indication) - len(NAMES)
    variance = _variance(square, dof, absolute=noise is not None)
    singular = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=0), compute_uv=False)
    solver = (float(singular[0] / singular[-1]), None)
    fitted = complete_fit(
        triangle, inverse @ inverse.T * variance, indication, gravity, root, solver
    )
    # the F-test uses the residuals alone: where the stated noise is larger, the intervals are
    # widened by the same factor as the standard uncertainties
    widening = float(np.sqrt(variance * dof / square)) if square > 0.0 and dof > 0 else 1.0
    centre, unit = fitted.parameters, fitted.standard_uncertainty
    wide = _bounded(centre, indication, gravity, root)
    ends = wide.profile_intervals(centre, unit)
    limits = (centre[:, None] + (unit * widening)[:, None] * ends).tolist()
    return fitted, {name: (low, high) for name, (low, high) in zip(NAMES, limits, strict=True)}


def _bounded(about: Array, indication: Array, gravity: float, root: Array) -> profile.Bounded:
    """Residuals of the nine parameters within bounds around starting values [9], wide enough for
    any working triad.
    """
    reach = float(np.max(np.ptp(indication, axis=0)))

    def residuals(values: Array) -> Array:
        return length_residuals(to_triangle(values), indication, gravity, root)[0]

    def slopes(values: Array, unit: Array) -> Array:
        steps = np.concatenate([values[:3], values[:3], np.ones(3)])
        inner = q_factor.differentiate(to_triangle, values, scale=steps) * unit
        return length_residuals(to_triangle(values), indication, gravity, root)[1] @ inner

    low = np.concatenate([about[:3] * 0.2, about[3:6] - reach, np.full(3, -LARGEST_Q)])
    high = np.concatenate([about[:3] * 5.0, about[3:6] + reach, np.full(3, LARGEST_Q)])
    return profile.Bounded(NAMES, low, high, residuals, slopes)


def fit_sphere(indication: Array, gravity: float) -> Array:
    """Nine starting parameters [9] from the sphere fitted to indications [n, 3], linear in centre
    and radius.
    """
    indication = indication[:: 1 + len(indication) // ENOUGH_TO_START]
    centre = indication.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((indication - centre) ** 2, axis=1)))) or 1.0
    moved = (indication - centre) / size
    design = np.column_stack([2.0 * moved, np.ones(len(moved))])
    sphere = least_squares.linear(
        design, np.sum(moved**2, axis=1), names=("b_x", "b_y", "b_z", "the scale factor")
    ).coefficients
    radius = np.sqrt(sphere[3] + sphere[:3] @ sphere[:3])
    return np.concatenate(
        [np.full(3, radius * size / gravity), centre + sphere[:3] * size, np.zeros(3)]
    )


TRIANGLE_NAMES = ("k_x", "Q3", "k_y", "Q2", "Q1", "k_z", "b_x", "b_y", "b_z")


def to_triangle(parameters: Array) -> Array:
    """Convert scale factors, bias and Q [9] to the six entries of the correction matrix and the
    bias [9].
    """
    return np.concatenate(
        [_correction_matrix(parameters)[tuple(np.transpose(LOWER))], parameters[3:6]]
    )


def _from_triangle(triangle: Array) -> Array:
    """Convert the six entries of the correction matrix and the bias [9] to scale factors, bias and
    Q [9].
    """
    sensitivity = np.linalg.inv(lower_matrix(triangle[:6]))
    scale = np.linalg.norm(sensitivity, axis=1)
    return np.concatenate(
        [scale, triangle[6:], q_factor.small_angles(sensitivity / scale[:, None])]
    )


def _require_enough(indication: Array) -> None:
    if len(indication) < len(NAMES):
        raise FitError(
            f"{len(indication)} dwells for {len(NAMES)} parameters ({', '.join(NAMES)})",
            hint="hold at least 12 different attitudes, better 18, spread over the whole sphere",
        )


def _variance(square: float, dof: int, *, absolute: bool) -> float:
    """Variance factor on the inverse normal matrix: residual variance, never below the stated noise
    (Birge 1932).
    """
    if dof <= 0 and not absolute:
        raise FitError(
            "nine dwells leave no residual to judge them by",
            hint="add attitudes, or state the dwell noise",
        )
    ratio = square / dof if dof > 0 else 0.0
    return max(1.0, ratio) if absolute else ratio


def complete_fit(
    triangle: Array,
    covariance: Array,
    indication: Array,
    gravity: float,
    root: Array,
    solver: tuple[float, robust.RobustFit | None],
    normal_inverse: Array | None = None,
    kept: Mask | None = None,
) -> MagnitudeFit:
    """MagnitudeFit from the triangle parameters and their covariance, the solver's condition number
    and robust fit, (JᵀJ)⁻¹ of all rows where it is known, and the rows [n] that were fitted.
    """
    condition, tough = solver
    suspects, left_out = common_errors.find_suspects(tough)
    slope = parameter_slopes(triangle, gravity)
    parameters = _from_triangle(triangle)
    residual, leverage = _residual_and_leverage(triangle, indication, gravity, root, normal_inverse)
    if kept is None:
        kept = tough.ratio <= robust.DOUBTFUL if tough else np.ones(len(root), dtype=np.bool_)
    used, weight = residual[kept], root[kept]
    dof = used.size - len(NAMES)
    square = float(np.sum(used**2) / np.sum(weight**2))
    mapped = slope @ covariance @ slope.T
    return MagnitudeFit(
        parameters=parameters,
        covariance=mapped,
        residuals=residual / root,
        leverage=leverage,
        suspects=suspects,
        left_out=left_out,
        dof=dof,
        residual_rms=float(np.sqrt(square * used.size / max(dof, 1))),
        condition=condition,
        flags=_flags(parameters, np.sqrt(np.diag(mapped)) * _t95(dof), leverage, condition, dof),
    )


def parameter_slopes(triangle: Array, gravity: float) -> Array:
    """Derivatives [9, 9] of scale factors, bias and Q by the triangle parameters [9]."""
    steps = np.concatenate(
        [np.full(6, float(np.max(np.abs(triangle[:6])))), gravity / np.abs(triangle[[0, 2, 5]])]
    )
    return q_factor.differentiate(_from_triangle, triangle, scale=steps)


def _residual_and_leverage(
    triangle: Array, indication: Array, gravity: float, root: Array, normal_inverse: Array | None
) -> tuple[Array, Array]:
    """Weighted residuals [n] and leverages [n], block by block."""

    def slopes(rows: slice) -> Array:
        return length_residuals(triangle, indication[rows], gravity, root[rows])[1]

    tall = len(root) >= gram.TALL
    if tall and normal_inverse is not None:
        inverse = np.linalg.cholesky(normal_inverse)
    else:
        r = (
            np.linalg.cholesky(gram.matrix(slopes, len(root))).T
            if tall
            else fold.triangle(slopes, len(root))
        )
        inverse = np.linalg.inv(r)
    residual, leverage = np.empty(len(root)), np.empty(len(root))
    for rows in gram.blocks(len(root), gram.block_rows(len(NAMES))):
        residual[rows], slope = length_residuals(triangle, indication[rows], gravity, root[rows])
        leverage[rows] = sum_squares(inverse.T @ slope.T)
    return residual, leverage


def _flags(
    parameters: Array, half_width: Array, leverage: Array, condition: float, dof: int
) -> tuple[str, ...]:
    """Flags for poorly determined parameters, poorly spread attitudes and unchecked dwells."""
    flags: list[str] = []
    if dof < FEW_DOF:
        flags.append(
            f"{len(leverage)} dwells for {len(NAMES)} parameters leave {dof} degrees of freedom: "
            "the residuals cannot vouch for these numbers"
        )
    if condition > ILL_CONDITIONED:
        flags.append(
            f"ill-conditioned: condition number {condition:.3g}, six faces have 1.7; add other"
            " attitudes"
        )
    flags += [
        f"{name} is known to ±{np.degrees(width):.2g}° only (95 %)"
        for name, width in zip(NAMES[6:], half_width[6:], strict=True)
        if width > POOR_Q
    ]
    relative = half_width[:6] / np.tile(parameters[:3], 2)
    flags += [
        f"{name} is known to ±{100.0 * share:.2g} % of {'itself' if name[0] == 'k' else 'gravity'}"
        " only (95 %)"
        for name, share in zip(NAMES[:6], relative, strict=True)
        if share > POOR_SHARE
    ]
    alone = np.flatnonzero(leverage > 0.99)
    if alone.size:
        flags.append(
            f"no other dwell checks dwell {', '.join(str(i) for i in alone)} (leverage above 0.99)"
        )
    return tuple(flags)


def _t95(dof: int) -> float:
    """Two-sided 95 % quantile of Student's t; zero degrees of freedom count as one."""
    from scipy.special import stdtrit

    return float(stdtrit(max(dof, 1), 0.975))

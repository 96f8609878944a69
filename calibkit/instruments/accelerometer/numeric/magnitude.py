"""Scale factor, bias and non-orthogonality of a triad from the magnitude of gravity alone, when
attitudes are unknown.

Nine parameters: scale factors k, biases b, and Q1, Q2, Q3 (Zhou, Hu & Fu 2010, exact form). The
corrected vector is Q diag(1/k) (V − b) with Q the inverse of the unit axes, and |G'| is to be the
local gravity. Lengths do not depend on how the triad is mounted, so its orientation stays unknown.
"""

from collections.abc import Mapping

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import profile, q_factor
from calibkit.instruments.accelerometer.numeric.norms import (
    LOWER,
    length_residuals,
)
from calibkit.numeric.least_squares import fit as least_squares

NAMES = ("k_x", "k_y", "k_z", "b_x", "b_y", "b_z", "Q1", "Q2", "Q3")
LARGEST_Q = 0.35
"""Bound of each Q [rad]: 20°, far above the non-orthogonality of any triad."""
ENOUGH_TO_START = 20_000
"""Rows, evenly spread over a larger set, from which the starting parameters are found."""


def _correction_matrix(parameters: Array) -> Array:
    """Lower triangular correction matrix [3, 3] of the nine parameters: exact Q · diag(1/k)."""
    return q_factor.exact_matrix(q_factor.axes_from_angles(parameters[6:9])) / parameters[None, 0:3]


def profile_intervals(
    indication: Array, gravity: float = 1.0, *, noise: Array | None = None
) -> Mapping[str, tuple[float, float]]:
    """Parameter → 95 % confidence interval of the nine parameters, named and bounded, by lmfit.

    The intervals are profile intervals: each parameter is stepped and the others refitted until the
    F-test rejects at 5 %. An end that is never rejected inside the bounds is infinite.

    Parameters
    ----------
    indication
        [n, 3], dwell means, in any unit.
    gravity
        Local gravity in the unit that corrected components shall have.
    noise
        [n], standard deviation of each length [unit of gravity]: weights, and a floor under the
        uncertainty.

    Raises
    ------
    FitError
        For fewer than nine dwells.

    """
    require_enough(indication)
    root = np.ones(len(indication)) if noise is None else 1.0 / noise
    begin = fit_sphere(indication, gravity)
    parameters, square = _bounded(begin, indication, gravity, root).minimize(begin)
    steps = np.concatenate([parameters[:3], parameters[:3], np.ones(3)])
    slopes = q_factor.differentiate(to_triangle, parameters, scale=steps)
    jacobian = length_residuals(to_triangle(parameters), indication, gravity, root)[1] @ slopes
    inverse = np.linalg.inv(np.linalg.qr(jacobian, mode="r"))
    dof = len(indication) - len(NAMES)
    variance = _variance(square, dof, absolute=noise is not None)
    unit = np.sqrt(np.sum(inverse**2, axis=1) * variance)
    # the F-test uses the residuals alone: where the stated noise is larger, the intervals are
    # widened by the same factor as the standard uncertainties
    widening = float(np.sqrt(variance * dof / square)) if square > 0.0 and dof > 0 else 1.0
    ends = _bounded(parameters, indication, gravity, root).profile_intervals(parameters, unit)
    limits = (parameters[:, None] + (unit * widening)[:, None] * ends).tolist()
    return {name: (low, high) for name, (low, high) in zip(NAMES, limits, strict=True)}


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


def to_triangle(parameters: Array) -> Array:
    """Convert scale factors, bias and Q [9] to the six entries of the correction matrix and the
    bias [9].
    """
    return np.concatenate(
        [_correction_matrix(parameters)[tuple(np.transpose(LOWER))], parameters[3:6]]
    )


def require_enough(indication: Array) -> None:
    """Raise FitError for fewer dwells than parameters."""
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

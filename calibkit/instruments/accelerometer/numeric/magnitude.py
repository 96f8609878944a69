"""Scale factor, bias and non-orthogonality of a triad from the magnitude of gravity alone, when
attitudes are unknown.

Nine parameters: scale factors k, biases b, and Q1, Q2, Q3 (Zhou, Hu & Fu 2010, exact form). The
length of the corrected vector is to be the local gravity. Lengths do not depend on how the triad is
mounted, so its orientation stays unknown.
"""

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, derivative, length
from calibkit.instruments.accelerometer.numeric import q_factor
from calibkit.numeric.least_squares import fit as least_squares

NAMES = ("k_x", "k_y", "k_z", "b_x", "b_y", "b_z", "Q1", "Q2", "Q3")
LARGEST_Q = 0.35
"""Bound of each Q [rad]: 20°, far above the non-orthogonality of any triad."""
ENOUGH_TO_START = 20_000
"""Rows, evenly spread over a larger set, from which the starting parameters are found."""
TOLERANCES = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 0.0, "max_nfev": 2000}
"""Options of lmfit's leastsq: convergence close to machine precision."""
ORIGIN = 10.0
"""Value of a parameter's scaled coordinate at the solution, in standard uncertainties."""


def corrected_length(p: Numbers, indication: Array) -> Numbers:
    """Length [n] of Q diag(1/k) (V − b) for indications V [n, 3] and nine parameters, Q the exact
    matrix of the small angles.
    """
    scale, bias = p[:3], p[3:6]
    orthogonal = q_factor.exact_matrix(q_factor.axes_from_angles(p[6:]))
    return length((indication - bias) / scale @ orthogonal.T)


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
        For fewer than nine dwells, and where lmfit finds no minimum.

    """
    import lmfit

    require_enough(indication)
    root = np.ones(len(indication)) if noise is None else 1.0 / noise
    begin = fit_sphere(indication, gravity)
    # wide enough for any working triad
    reach = np.full(3, np.max(np.ptp(indication, axis=0)))
    angles = np.full(3, LARGEST_Q)
    low = np.concatenate([begin[:3] * 0.2, begin[3:6] - reach, -angles])
    high = np.concatenate([begin[:3] * 5.0, begin[3:6] + reach, angles])

    def residual(p: Numbers) -> Numbers:
        return (corrected_length(p, indication) - gravity) * root

    def minimize(about: Array, unit: Array) -> tuple[Any, Any]:
        """Minimizer and result of lmfit, started at parameters [9] in whose units [9] it steps."""

        def parameters(named: Any) -> Array:  # noqa: ANN401 (lmfit has no types)
            scaled = np.array([named[name].value for name in NAMES])
            return np.asarray(about + unit * (scaled - ORIGIN), dtype=np.float64)

        def slopes(named: Any) -> Array:  # noqa: ANN401 (lmfit has no types)
            varying = [named[name].vary for name in NAMES]  # a profile holds one of them
            return (derivative(residual, parameters(named)) * unit)[:, varying]

        named = lmfit.Parameters()
        bounds = ORIGIN + (np.array([low, high]) - about) / unit
        for name, least, most in zip(NAMES, *bounds.tolist(), strict=True):
            named.add(name, value=ORIGIN, min=least, max=most)
        minimizer = lmfit.Minimizer(lambda scaled: residual(parameters(scaled)), named)
        result = minimizer.minimize(method="leastsq", Dfun=slopes, **TOLERANCES)
        result.solution = parameters(result.params)
        return minimizer, result

    _, found = minimize(begin, np.concatenate([begin[:3], begin[:3], np.ones(3)]))
    if not found.success or found.covar is None:
        raise FitError(
            f"lmfit found no minimum: {found.message}",
            hint="check units, or add different attitudes",
        )
    solution, square = found.solution, float(np.sum(found.residual**2))
    dof = len(indication) - len(NAMES)
    variance = _variance(square, dof, absolute=noise is not None)
    inverse = np.linalg.inv(np.linalg.qr(derivative(residual, solution), mode="r"))
    u = np.sqrt(np.sum(inverse**2, axis=1) * variance)
    # lmfit finds the ends to 5e-5 of a parameter's value, which for a scale factor near 1 with an
    # uncertainty of 1e-5 would be five uncertainties: parameters are scaled by theirs
    with warnings.catch_warnings():
        # lmfit warns where a bound is met before the F-test rejects; that end is infinite
        warnings.simplefilter("ignore")
        minimizer, result = minimize(solution, u)
        for name in NAMES:
            # 1 by construction; lmfit may report none where it starts at the solution
            result.params[name].stderr = result.params[name].stderr or 1.0
        table = lmfit.conf_interval(minimizer, result, sigmas=[0.95])
    # the F-test uses the residuals alone: where the stated noise is larger, the intervals are
    # widened by the same factor as the standard uncertainties
    widening = float(np.sqrt(variance * dof / square)) if square > 0.0 and dof > 0 else 1.0
    intervals = {}
    for name, value, size in zip(NAMES, solution.tolist(), (u * widening).tolist(), strict=True):
        ends = [table[name][side][1] - ORIGIN for side in (0, -1)]
        least, most = (
            value + size * end if np.isfinite(end) else never
            for end, never in zip(ends, (-np.inf, np.inf), strict=True)
        )
        intervals[name] = least, most
    return intervals


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

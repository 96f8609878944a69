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
from calibkit.fit.solve import solve
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
        For fewer than nine dwells, and where they leave no residual.

    """
    import lmfit

    require_enough(indication)
    size = np.ones(len(indication)) if noise is None else noise

    def residual(p: Numbers) -> Numbers:
        return (corrected_length(p, indication) - gravity) / size

    begin = fit_sphere(indication, gravity)
    fit = solve(
        residual, begin, noise=np.ones(len(size)), estimate_noise=noise is None, names=NAMES
    )
    solution, u = fit.parameters, np.sqrt(np.diag(fit.covariance))
    # lmfit finds the ends to 5e-5 of a parameter's value, which for a scale factor near 1 with an
    # uncertainty of 1e-5 would be five uncertainties: parameters are scaled by theirs
    lmfit_parameters = lmfit.Parameters()
    # wide enough for any working triad
    reach, angles = np.full(3, np.max(np.ptp(indication, axis=0))), np.full(3, LARGEST_Q)
    low = np.concatenate([begin[:3] * 0.2, begin[3:6] - reach, -angles])
    high = np.concatenate([begin[:3] * 5.0, begin[3:6] + reach, angles])
    bounds = ORIGIN + (np.array([low, high]) - solution) / u
    for name, lower, upper in zip(NAMES, *bounds.tolist(), strict=True):
        lmfit_parameters.add(name, value=ORIGIN, min=lower, max=upper)

    def parameters(trial: Any) -> Array:  # noqa: ANN401 (lmfit has no types)
        scaled = np.array([trial[name].value for name in NAMES])
        return np.asarray(solution + u * (scaled - ORIGIN), dtype=np.float64)

    def slopes(trial: Any) -> Array:  # noqa: ANN401 (lmfit has no types)
        varying = [trial[name].vary for name in NAMES]  # a profile holds one of them
        return (derivative(residual, parameters(trial)) * u)[:, varying]

    with warnings.catch_warnings():
        # lmfit warns where a bound is met before the F-test rejects; that end is infinite
        warnings.simplefilter("ignore")
        minimizer = lmfit.Minimizer(lambda scaled: residual(parameters(scaled)), lmfit_parameters)
        result = minimizer.minimize(method="leastsq", Dfun=slopes, **TOLERANCES)
        for name in NAMES:
            # 1 by construction; lmfit may report none where it starts at the solution
            result.params[name].stderr = result.params[name].stderr or 1.0
        table = lmfit.conf_interval(minimizer, result, sigmas=[0.95])
    # the F-test uses the residuals alone: where the stated noise is larger, the intervals are
    # widened by the same factor as the standard uncertainties (Birge 1932)
    square = float(np.sum(residual(solution) ** 2))
    stated_is_larger = noise is not None and 0.0 < square < fit.dof
    widening = float(np.sqrt(fit.dof / square)) if stated_is_larger else 1.0
    intervals = {}
    for name, value, step in zip(NAMES, solution.tolist(), (u * widening).tolist(), strict=True):
        ends = [table[name][side][1] - ORIGIN for side in (0, -1)]
        lower, upper = (
            value + step * end if np.isfinite(end) else infinite
            for end, infinite in zip(ends, (-np.inf, np.inf), strict=True)
        )
        intervals[name] = lower, upper
    return intervals


def fit_sphere(indication: Array, gravity: float) -> Array:
    """Nine starting parameters [9] from the sphere fitted to indications [n, 3], linear in centre
    and radius.
    """
    indication = indication[:: 1 + len(indication) // ENOUGH_TO_START]
    centre = indication.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((indication - centre) ** 2, axis=1)))) or 1.0
    scaled = (indication - centre) / size
    design = np.column_stack([2.0 * scaled, np.ones(len(scaled))])
    sphere = least_squares.linear(
        design, np.sum(scaled**2, axis=1), names=("b_x", "b_y", "b_z", "the scale factor")
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

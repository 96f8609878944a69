"""95 % profile intervals of a triad fitted to the length of gravity at one temperature, by lmfit.

    |Q diag(1/s) (V - b)| = 1                                                                (1)

V are the indications, s the scale factors, b the biases, Q the exact matrix of the small angles Q1,
Q2, Q3. Each of the nine parameters is stepped and the others are fitted again until the F-test
rejects at 5 %: such intervals need not be symmetric, as those of `Fit.of` are.
"""

import warnings
from typing import Any

import numpy as np

from calibkit.fit.complex_step import Numbers, derivative, length
from calibkit.fit.solve import solve
from calibkit.instruments.accelerometer import published
from calibkit.instruments.accelerometer.dwells import DwellSet
from calibkit.instruments.accelerometer.triad import Triad
from calibkit.numeric.arrays import Array
from calibkit.records.coefficients import Figure

NAMES = ("k_x", "k_y", "k_z", "b_x", "b_y", "b_z", *published.Q_NAMES)
UNITS = ("1",) * 3 + ("g",) * 3 + ("rad",) * 3
LARGEST_Q = 0.35
"""Bound of each Q [rad]: 20°, far above the non-orthogonality of any triad."""
TOLERANCES = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 0.0, "max_nfev": 2000}
"""Options of lmfit's leastsq: convergence close to machine precision."""
ORIGIN = 10.0
"""Value of a parameter's scaled coordinate at the solution, in standard uncertainties."""


def find_intervals(triad: Triad, dwells: DwellSet) -> tuple[tuple[Figure, ...], tuple[str, ...]]:
    """Ends of the interval of each parameter of NAMES as figures of accel_q.json, by plain least
    squares from what `triad` found at the mean temperature of the dwells, and flags; an end that is
    not rejected within the bounds is none.

    Standard errors of the dwells, where all have one, are weights and a floor under the scatter.
    Raises FitError for dwells that leave no residual.
    """
    import lmfit

    indication = dwells.indication
    stated, noise = bool(np.all(dwells.noise > 0.0)), dwells.relative_noise(lengths=True)

    def residual(p: Numbers) -> Numbers:
        Q = published.exact_matrix(p[6:])
        return (length((indication - p[3:6]) / p[:3] @ Q.T) - 1.0) / noise

    t = float(triad.mapped(dwells.temperature.mean()))
    k, z, Q = np.split(triad.terms.at_temperature(triad.fit.parameters, t), 3)
    begin = np.concatenate([1.0 / k, z / k, Q])
    fit = solve(residual, begin, noise=np.ones(len(noise)), estimate_noise=not stated, names=NAMES)
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
        profiles = lmfit.conf_interval(minimizer, result, sigmas=[0.95])
    # the F-test uses the residuals alone: where the stated noise is larger, the intervals are
    # widened by the same factor as the standard uncertainties (Birge 1932)
    square = float(np.sum(residual(solution) ** 2))
    widening = float(np.sqrt(fit.dof / square)) if stated and 0.0 < square < fit.dof else 1.0
    figures = []
    flags = ["magnitude: lmfit solves by plain least squares, outliers are not left out"]
    steps = (u * widening).tolist()
    for name, unit, value, step in zip(NAMES, UNITS, solution.tolist(), steps, strict=True):
        ends = [value + step * (profiles[name][side][1] - ORIGIN) for side in (0, -1)]
        for side, end in zip(("low", "high"), ends, strict=True):
            if np.isfinite(end):
                figures.append(Figure(f"{name}_{side}_95", end, unit, 0.0))
        if not np.isfinite(ends).all():
            flags.append(f"magnitude: the 95 % interval of {name} has no end within its bounds")
    return tuple(figures), tuple(flags)

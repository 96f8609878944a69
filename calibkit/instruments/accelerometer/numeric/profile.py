"""Least squares with named, bounded parameters by lmfit, and their profile intervals."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError

TOLERANCES = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 0.0, "max_nfev": 2000}
"""Options of lmfit's leastsq: convergence close to machine precision."""
ORIGIN = 10.0
"""Value of a parameter's scaled coordinate at the solution, in standard uncertainties."""


@dataclass(frozen=True, slots=True)
class Bounded:
    """Residual function of p named parameters with bounds."""

    names: tuple[str, ...]
    low: Array
    """[p], lower bounds."""
    high: Array
    """[p], upper bounds."""
    residuals: Callable[[Array], Array]
    """Weighted residuals [n] at parameters [p]."""
    slopes: Callable[[Array, Array], Array]
    """Derivatives [n, p] of the residuals at parameters [p], by parameters in units [p]."""

    def minimize(self, begin: Array) -> tuple[Array, float]:
        """Minimise from starting parameters [p]; returns parameters [p] and the sum of squares,
        raises FitError where there is no minimum.
        """
        plain = np.zeros(begin.size), np.ones(begin.size)
        result = self._minimize(begin, self.low, self.high, *plain)[1]
        if not result.success or result.covar is None:
            raise FitError(
                f"lmfit found no minimum: {result.message}",
                hint="check units, or add different attitudes",
            )
        values = np.array([result.params[name].value for name in self.names])
        return values, float(np.sum(result.residual**2))

    def profile_intervals(self, solution: Array, unit: Array) -> Array:
        """Ends [p, 2] of the 95 % profile intervals about a solution [p], as departures in standard
        uncertainties [p]; an end that the F-test never rejects is infinite.

        Each parameter is stepped and the others are refitted until the F-test rejects at 5 %.
        Parameters are scaled by their standard uncertainty, with the value ORIGIN at the solution:
        lmfit finds the ends to 5e-5 of the value, which for an unscaled scale factor near 1 with an
        uncertainty of 1e-5 would be five uncertainties.
        """
        import lmfit

        with warnings.catch_warnings():
            # lmfit warns where a bound is met before the F-test rejects; that end is infinite
            warnings.simplefilter("ignore")
            begin = np.full(solution.size, ORIGIN)
            low, high = (ORIGIN + (end - solution) / unit for end in (self.low, self.high))
            minimizer, result = self._minimize(begin, low, high, solution - ORIGIN * unit, unit)
            for name in self.names:
                # 1 by construction; lmfit may report none where it starts at the solution
                result.params[name].stderr = result.params[name].stderr or 1.0
            table = lmfit.conf_interval(minimizer, result, sigmas=[0.95])
        found = np.array([[table[name][0][1], table[name][-1][1]] for name in self.names]) - ORIGIN
        return np.where(np.isfinite(found), found, [-np.inf, np.inf])

    def _minimize(
        self, begin: Array, low: Array, high: Array, centre: Array, unit: Array
    ) -> tuple[Any, Any]:
        """Minimizer and result of lmfit, whose variables v mean parameters centre + unit · v."""
        import lmfit

        def values(named: Any) -> Array:  # noqa: ANN401 lmfit has no types
            found = np.array([named[name].value for name in self.names])
            return np.asarray(centre + unit * found, dtype=np.float64)

        def varying(named: Any) -> Array:  # noqa: ANN401 lmfit has no types
            # a profile fixes one of the parameters
            columns = [j for j, name in enumerate(self.names) if named[name].vary]
            return self.slopes(values(named), unit)[:, columns]

        named = lmfit.Parameters()
        for name, *numbers in zip(self.names, begin, low, high, strict=True):
            value, least, most = map(float, numbers)
            named.add(name, value=value, min=least, max=most)
        minimizer = lmfit.Minimizer(lambda at: self.residuals(values(at)), named)
        return minimizer, minimizer.minimize(method="leastsq", Dfun=varying, **TOLERANCES)

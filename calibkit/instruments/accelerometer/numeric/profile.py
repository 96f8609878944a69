"""Least squares with named, bounded parameters by lmfit, and their profile intervals."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError

TOLERANCES = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 0.0, "max_nfev": 2000}
"""Of lmfit's leastsq: to the last digits."""
ORIGIN = 10.0
"""Place of the solution on the scale of a profile, in standard uncertainties."""


@dataclass(frozen=True, slots=True)
class Bounded:
    """Residuals of p named parameters within bounds."""

    names: tuple[str, ...]
    low: Array
    """[p]."""
    high: Array
    """[p]."""
    residuals: Callable[[Array], Array]
    """Weighted residuals [n] at parameters [p]."""
    slopes: Callable[[Array, Array], Array]
    """Derivatives [n, p] of the residuals at parameters [p] by steps of units [p]."""

    def minimize(self, begin: Array) -> tuple[Array, float]:
        """Parameters [p] from a start [p] on, and the sum of squares; raises FitError where there
        is no minimum.
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
        """Ends [p, 2] of the 95 % profile intervals of a solution [p] with standard uncertainties
        [p], in these from the solution; an end that the data never reject is infinite.

        Each parameter is stepped and the others fitted again until the F-test rejects at 5 %. The
        profile is drawn in standard uncertainties, ten of them at the solution: lmfit steps by the
        uncertainty and places the ends to 5e-5 of the value, which for a scale factor near 1 would
        be five uncertainties of 1e-5.
        """
        import lmfit

        with warnings.catch_warnings():
            # lmfit warns where a bound is met before the F-test rejects; that end is infinite
            warnings.simplefilter("ignore")
            begin = np.full(solution.size, ORIGIN)
            low, high = (ORIGIN + (end - solution) / unit for end in (self.low, self.high))
            minimizer, result = self._minimize(begin, low, high, solution - ORIGIN * unit, unit)
            for name in self.names:
                # 1 by construction; lmfit may have none where it starts at the solution
                result.params[name].stderr = result.params[name].stderr or 1.0
            table = lmfit.conf_interval(minimizer, result, sigmas=[0.95])
        found = np.array([[table[name][0][1], table[name][-1][1]] for name in self.names]) - ORIGIN
        return np.where(np.isfinite(found), found, [-np.inf, np.inf])

    def _minimize(
        self, begin: Array, low: Array, high: Array, centre: Array, unit: Array
    ) -> tuple[Any, Any]:
        """Minimizer of lmfit and its result; the parameters are centre + unit · lmfit's."""
        import lmfit

        def values(named: Any) -> Array:  # noqa: ANN401 lmfit has no types
            found = np.array([named[name].value for name in self.names])
            return np.asarray(centre + unit * found, dtype=np.float64)

        def varying(named: Any) -> Array:  # noqa: ANN401 lmfit has no types
            # a profile holds one of the parameters still
            columns = [j for j, name in enumerate(self.names) if named[name].vary]
            return self.slopes(values(named), unit)[:, columns]

        named = lmfit.Parameters()
        for name, *numbers in zip(self.names, begin, low, high, strict=True):
            value, least, most = map(float, numbers)
            named.add(name, value=value, min=least, max=most)
        minimizer = lmfit.Minimizer(lambda at: self.residuals(values(at)), named)
        return minimizer, minimizer.minimize(method="leastsq", Dfun=varying, **TOLERANCES)

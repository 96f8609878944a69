"""Which fit of a triad is exported: the robust one, or plain least squares where that agrees better
with the dwells.
"""

from collections.abc import Callable

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.triad import Triad

WORSE = 1.1
"""Ratio of median absolute residuals above which one fit is worse than the other: on clean data the
two differ by chance.
"""
WORSE_THAN_NONE = 1.3
"""Ratio of the median absolute residual of least squares to that of no correction above which no
fit is exported: a triad that needs no correction differs by less, by chance.
"""
ROUNDING_G = 1e-9
"""Difference of median absolute residuals [g] that is rounding."""


def choose(
    fit_with: Callable[..., Triad], loss: str, uncorrected: Array
) -> tuple[Triad, tuple[str, ...]]:
    """Fit with the recipe's loss, and flags; `uncorrected` are the residuals [n] or [n, m, g] of
    the raw dwells.

    Plain least squares stands in where a robust fit does not converge, or leaves a median absolute
    residual that is 10 % larger than that of least squares or of no correction. Where the two fits
    differ by more than U, both values are flagged. Raises FitError where no fit is better than
    none.
    """
    plain = fit_with(loss="least_squares")
    other, raw = _median_length(plain.residuals), _median_length(uncorrected)
    flags = list[str]()
    if loss == "robust":
        try:
            tough = fit_with(loss="robust")
        except FitError as error:
            worse = error.message
        else:
            left = _median_length(tough.residuals)
            if left <= WORSE * min(other, raw) + ROUNDING_G:
                return tough, _flag_differences(tough, plain)
            # without suspects the two differ by chance
            worse = (
                f"the robust fit leaves a median residual of {left:.2e} g, least squares"
                f" {other:.2e} g, no correction {raw:.2e} g: look for an error that dwells share"
                if tough.suspects
                else ""
            )
        if worse:
            flags.append(f"triad: {worse}; plain least squares was used, outliers are not left out")
    if other > WORSE_THAN_NONE * raw + ROUNDING_G:
        raise FitError(
            f"triad: the median residual is {other:.2e} g after correction by least squares,"
            f" {raw:.2e} g before, expected a smaller one",
            hint="look for wrong rows or references: gross errors move such a fit",
        )
    return plain, tuple(flags)


def _median_length(residuals: Array) -> float:
    """Median absolute residual [g] of dwells, over their components together: alone, most may be
    zero at the attitudes that were held.
    """
    return float(np.median(np.linalg.norm(residuals.reshape(len(residuals), -1), axis=1)))


def _flag_differences(tough: Triad, plain: Triad) -> tuple[str, ...]:
    """Flag for robust and least-squares fits that differ by more than U, with both values of the
    coefficient that differs most.
    """
    to_raw = tough.to_degrees
    value = tough.fit.of(lambda p: to_raw @ p)
    beside, expanded = to_raw @ plain.fit.parameters, value.expanded
    share = np.abs(value.value - beside) / np.where(expanded > 0.0, expanded, np.inf)
    if np.max(share) <= 1.0 or np.max(np.abs(tough.residuals)) <= ROUNDING_G:
        return ()
    k, count = int(np.argmax(share)), int(np.sum(share > 1.0)) - 1
    others = f", and {count} more coefficients differ" if count else ""
    flag = (
        f"triad: the fits differ by more than U: {tough.terms.names[k]} is {value.value[k]:.7g} ±"
        f" {expanded[k]:.1e} by the robust fit, which is exported, {beside[k]:.7g} by least"
        f" squares{others}; look at the suspects before you rely on it"
    )
    return (flag,)

"""Which fit of a triad is exported: the robust one, or plain least squares where that agrees better
with the dwells.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import k_factor, magnitude
from calibkit.instruments.accelerometer.numeric.affine_solve import AffineFit
from calibkit.instruments.accelerometer.numeric.dwell_fit import DwellFit, MappedFit
from calibkit.instruments.accelerometer.numeric.magnitude import MagnitudeFit
from calibkit.numeric import gum

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
Found = TypeVar("Found", bound="DwellFit | Sequence[DwellFit]")


def choose(
    fit_with: Callable[..., Found], loss: str, names: Sequence[str], uncorrected: Array
) -> tuple[Found, tuple[str, ...]]:
    """Fit with the recipe's loss, and flags; `names` are those of the fit's models, `uncorrected`
    the residuals [n] or [n, m, g] of the raw dwells.

    Plain least squares stands in where a robust fit does not converge, or leaves a median absolute
    residual that is 10 % larger than that of least squares or of no correction. Where the two fits
    differ by more than U, both values are flagged. Raises FitError where no fit is better than
    none.
    """
    plain = fit_with(loss="least_squares")
    other, raw = _median_length(_residuals(plain)), _median_length(uncorrected)
    what, flags = ", ".join(names), list[str]()
    if loss == "robust":
        try:
            tough = fit_with(loss="robust")
        except FitError as error:
            worse = error.message
        else:
            one = _median_length(_residuals(tough))
            if one <= WORSE * min(other, raw) + ROUNDING_G:
                return tough, _flag_differences(names, tough, plain)
            # without suspects the two differ by chance
            worse = (
                f"the robust fit leaves a median residual of {one:.2e} g, least squares"
                f" {other:.2e} g, no correction {raw:.2e} g: look for an error that dwells share"
                if any(model.suspects for model in _models(tough))
                else ""
            )
        if worse:
            flags.append(
                f"{what}: {worse}; plain least squares was used, outliers are not left out"
            )
    if other > WORSE_THAN_NONE * raw + ROUNDING_G:
        raise FitError(
            f"{what}: the median residual is {other:.2e} g after correction by least squares,"
            f" {raw:.2e} g before, expected a smaller one",
            hint="look for wrong rows or references: gross errors move such a fit",
        )
    return plain, tuple(flags)


def _residuals(found: "DwellFit | Sequence[DwellFit]") -> Array:
    """Residuals [n] or [n, m, g] of a fit, m axes side by side."""
    residuals = [model.residuals for model in _models(found)]
    return residuals[0] if len(residuals) == 1 else np.column_stack(residuals)


def _median_length(residuals: Array) -> float:
    """Median absolute residual [g] of dwells, over their components together: alone, most may be
    zero at the attitudes that were held.
    """
    return float(np.median(np.linalg.norm(residuals.reshape(len(residuals), -1), axis=1)))


def _models(found: "DwellFit | Sequence[DwellFit]") -> "Sequence[DwellFit]":
    """Models of a fit."""
    return (found,) if isinstance(found, DwellFit) else found


def _flag_differences(
    names: Sequence[str],
    tough: "DwellFit | Sequence[DwellFit]",
    plain: "DwellFit | Sequence[DwellFit]",
) -> tuple[str, ...]:
    """Flag for each model whose robust and least-squares fits differ by more than U, with both
    values of the coefficient that differs most.
    """
    flags = []
    for name, one, other in zip(names, _models(tough), _models(plain), strict=True):
        (symbols, value), (_, beside) = _coefficients(one), _coefficients(other)
        expanded = gum.coverage_factor(max(one.dof, 1)) * one.standard_uncertainty
        share = np.abs(value - beside) / np.where(expanded > 0.0, expanded, np.inf)
        if np.max(share) > 1.0 and np.max(np.abs(one.residuals)) > ROUNDING_G:
            k, count = int(np.argmax(share)), int(np.sum(share > 1.0)) - 1
            others = f", and {count} more coefficients differ" if count else ""
            flags.append(
                f"{name}: the fits differ by more than U: {symbols[k]} is {value[k]:.7g} ±"
                f" {expanded[k]:.1e} by the robust fit, which is exported, {beside[k]:.7g} by least"
                f" squares{others}; look at the suspects before you rely on it"
            )
    return tuple(flags)


def _coefficients(found: DwellFit) -> tuple[Sequence[str], Array]:
    """Names and values [p] of the coefficients of a fit."""
    if isinstance(found, MagnitudeFit):
        return magnitude.NAMES, found.parameters
    if isinstance(found, AffineFit):
        return found.names, found.coefficients
    assert isinstance(found, MappedFit)  # noqa: S101 (K0 … K9 of an axis)
    return k_factor.NAMES, found.coefficients

"""Results of fits to dwells: covariance and residuals, and coefficients over temperature."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.accelerometer.numeric.common_errors import CommonError
from calibkit.instruments.accelerometer.numeric.shared_errors import Unexplained
from calibkit.numeric.least_squares.components import Component, MixedFit


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellFit:
    """Covariance of the p parameters of a fit to n dwells, and the quality of the fit."""

    covariance: Array
    """[p, p], type A."""
    residuals: Array
    """[n] or [n, m], residuals of the dwells [unit of the reference]."""
    suspects: tuple[int, ...]
    """Indices of outlying dwells, worst first; empty for a least-squares fit."""
    left_out: tuple[int, ...] = ()
    """Indices of dwells that the fit left out, in one component at least; they may be no suspects
    where the tail of all residuals is long.
    """
    common_errors: tuple[CommonError, ...] = ()
    """Dwells that stand apart together and were kept."""
    dof: int
    """Degrees of freedom of the uncertainty: residuals less parameters, or fewer where dwells share
    an error.
    """
    residual_rms: float
    """Root of the sum of squares over the degrees of freedom [unit of the reference]."""
    condition: float
    effective_dof: Array | None = None
    """[p], of the parameters; None: `dof`."""
    mixed: MixedFit | None = None
    """The last step with errors that dwells share, in the parameters of the solver."""
    lack_of_fit: tuple[Unexplained, ...] = ()
    """Residuals that differ from group to group."""
    flags: tuple[str, ...] = ()
    """Reasons to doubt the fit."""

    @property
    def components(self) -> tuple[Component, ...]:
        """Errors that dwells share."""
        return () if self.mixed is None else self.mixed.components

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [p] of the parameters, type A."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedFit(DwellFit):
    """Fit in mapped temperature u = (t − middle)/half, converted also to powers of t in °C."""

    coefficients: Array
    """[p], in powers of °C; `covariance` belongs to these."""
    mapped_coefficients: Array
    """[p], in powers of u: well conditioned, for prediction and single precision."""
    mapped_covariance: Array
    """[p, p], of `mapped_coefficients`."""
    middle: float
    """Middle of the temperature range [°C]."""
    half: float
    """Half-width of the temperature range [°C]; 1 when the temperature was constant."""

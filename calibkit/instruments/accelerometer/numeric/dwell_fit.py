"""What fits to dwells report: of any parameters, and of coefficients over temperature."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class DwellFit:
    """Covariance of the p parameters of a fit to n dwells, and how well it fits."""

    covariance: Array
    """[p, p], type A."""
    residuals: Array
    """[n] or [n, m], of the dwells [unit of the reference]."""
    suspects: tuple[int, ...]
    """Dwells that no noise explains, by index, worst first; empty for a plain fit."""
    dof: int
    """Of the uncertainty: residuals less parameters, or fewer where dwells share an error."""
    residual_rms: float
    """Over the degrees of freedom, so that it estimates the noise without bias [unit of the
    reference].
    """
    condition: float

    @property
    def standard_uncertainty(self) -> Array:
        """Of the parameters [p], type A."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedFit(DwellFit):
    """A fit in u = (t − middle)/half, reported for temperatures t in °C too."""

    coefficients: Array
    """[p], for temperatures in °C; the covariance is of these."""
    mapped_coefficients: Array
    """[p], for u: well conditioned, for prediction and for single precision."""
    mapped_covariance: Array
    """[p, p]."""
    middle: float
    """[°C]."""
    half: float
    """[°C]; 1 when the temperature was constant."""

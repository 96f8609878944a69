"""What every fit over temperature reports: coefficients for °C and for the mapped temperature."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class MappedFit:
    """A fit in u = (t − middle)/half, reported for temperatures t in °C too; p coefficients."""

    coefficients: Array
    """[p], for temperatures in °C."""
    covariance: Array
    """[p, p], type A."""
    mapped_coefficients: Array
    """[p], for u: well conditioned, for prediction and for single precision."""
    mapped_covariance: Array
    """[p, p]."""
    middle: float
    """[°C]."""
    half: float
    """[°C]; 1 when the temperature was constant."""
    residuals: Array
    """[n] or [n, m], of the dwells [unit of the reference]."""
    suspects: tuple[int, ...]
    """Dwells that no noise explains, by index, worst first; empty for a plain fit."""
    dof: int
    """Of the uncertainty: residuals less coefficients, or fewer where dwells share an error."""
    residual_rms: float
    """Over the degrees of freedom, so that it estimates the noise without bias [unit of the
    reference].
    """
    condition: float

    @property
    def standard_uncertainty(self) -> Array:
        """Of the coefficients [p], type A."""
        return np.sqrt(np.diag(self.covariance))

"""s(T) of one gyro as a file holds it, and as a fit found it."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.instruments.inclinometer.noise import Noise
from calibkit.instruments.inclinometer.numeric import scale_prior
from calibkit.instruments.inclinometer.numeric.root_choice import Prior


@dataclass(frozen=True, slots=True)
class ScaleModel:
    """s(T) of one gyro as it leaves a file: powers of °C, their covariance, scatter, range [°C]
    (None: no temperature).
    """

    coefficients: Array
    covariance: Array
    scatter: float
    valid: tuple[float, float] | None
    noise: Noise

    def prior(self, temperature: Array) -> Prior:
        """Prior at temperatures [n] [°C]; where one is not known, the whole range is possible."""
        if self.valid is None:
            known = scale_prior.predict_scale(
                self.coefficients, self.covariance, self.scatter, (0.0, 0.0), [0.0]
            )
            return Prior(
                *(
                    np.repeat(part, temperature.size)
                    for part in (known.s, known.standard_uncertainty)
                )
            )
        low, high = self.valid
        there = np.isfinite(temperature)
        at = scale_prior.predict_scale(
            self.coefficients,
            self.covariance,
            self.scatter,
            self.valid,
            np.where(there, temperature, low),
        )
        span = scale_prior.predict_scale(
            self.coefficients, self.covariance, self.scatter, self.valid, np.linspace(low, high, 41)
        )
        # an unknown temperature may be any of the range: a rectangular distribution
        spread = np.hypot(span.standard_uncertainty.max(), np.ptp(span.s) / np.sqrt(12.0))
        middle = (span.s.min() + span.s.max()) / 2.0
        return Prior(
            np.where(there, at.s, middle), np.where(there, at.standard_uncertainty, spread)
        )


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """s(T) of one gyro, how well it fits, and which stations [n] carried it."""

    model: ScaleModel
    dof: int
    residual_rms: float
    used: Mask
    left_out: Prior

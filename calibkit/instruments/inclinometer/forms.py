"""In-situ scale factor s(T) of one gyro: result of a fit, content of a coefficient file, and model
form of inclinometer_scale.json.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.instruments.inclinometer.published import Noise
from calibkit.instruments.inclinometer.root_choice import ScalePrior
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.records.coefficients import Model
from calibkit.records.forms import Form, Inputs

FILE = "inclinometer_scale.json"
TEMPERATURE = "temp_case_degc"
MOUNTING = "mounting"
"""Group of the errors of how gyros and accelerometers are mounted."""


@dataclass(frozen=True, slots=True)
class ScaleModel:
    """s(T) of one gyro from a coefficient file: coefficients of powers of °C, covariance, scatter,
    range [°C] (None where no temperature was logged).
    """

    coefficients: Array
    covariance: Array
    scatter: float
    valid: tuple[float, float] | None
    noise: Noise
    turn_deg: float = 0.0
    """Standard deviation of the turn of the gyro against its accelerometer [°]."""

    def prior(self, temperature: Array) -> ScalePrior:
        """Prior of s at temperatures [n] [°C].

        Beyond the range s is that of its end, less certain by what the slope there would add; an
        unknown temperature is distributed uniformly over the range (GUM 4.3.7).
        """
        low, high = self.valid or (0.0, 0.0)
        logged = np.isfinite(temperature)
        # at the stations, then over the range
        degc = np.append(np.where(logged, temperature, low), np.linspace(low, high, 41))
        clamped = np.clip(degc, low, high)
        powers = np.vander(clamped, self.coefficients.size, increasing=True)
        slope = powers[:, :-1] @ (self.coefficients[1:] * np.arange(1, self.coefficients.size))
        variance = np.maximum(gum.variance_along(powers, self.covariance), 0.0)
        s = powers @ self.coefficients
        u = np.sqrt(variance + self.scatter**2 + (slope * (degc - clamped)) ** 2)
        count = temperature.size
        of_range, middle = u[count:].max(), (s[count:].min() + s[count:].max()) / 2.0
        spread = np.hypot(of_range, np.ptp(s[count:]) / np.sqrt(12.0))
        return ScalePrior(np.where(logged, s[:count], middle), np.where(logged, u[:count], spread))

    @classmethod
    def read(cls, model: Model) -> Self:
        """s(T) of one gyro from its model; raises CoefficientError for another form."""
        return cls(
            SCALE.read(model),
            np.array(model.covariance),
            model.value("scatter"),
            model.valid.get(TEMPERATURE),
            Noise(
                *(model.value("accel_noise"), model.value("gyro_noise")),
                round(model.value("noise_dof")),
            ),
            next((part.value for part in model.components if part.group == MOUNTING), 0.0),
        )


def _powers(model: Model, inputs: Inputs) -> Array:
    """Powers [n, p] of the case temperature in ascending order; ones for a model without
    temperature.
    """
    abscissa = inputs[TEMPERATURE] if model.valid else np.zeros(len(next(iter(inputs.values()))))
    return np.vander(abscissa, len(model.coefficients), increasing=True)


SCALE = Form("inclinometer-scale/1", _powers)
"""s(T) = Σ s_k T^k [1], which multiplies the indicated rate; T in °C."""

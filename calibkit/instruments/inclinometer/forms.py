"""In-situ scale factor s(T) of one gyro: result of a fit, content of a coefficient file, and model
form of inclinometer_scale.json.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Component, Model, Parameter
from calibkit.forms import Form, Inputs
from calibkit.instruments.inclinometer.noise import Noise
from calibkit.instruments.inclinometer.root_choice import ScalePrior
from calibkit.instruments.inclinometer.scale_fit import ScaleOverTemperature
from calibkit.numeric import gum

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
            next((one.value for one in model.components if one.group == MOUNTING), 0.0),
        )


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """s(T) of one gyro, quality of the fit, and mask [n] of the stations used in it."""

    model: ScaleModel
    dof: int
    residual_rms: float
    used: Mask
    left_out: ScalePrior
    effective_dof: Array | None = None
    components: tuple[Component, ...] = ()
    flags: tuple[str, ...] = ()
    over: ScaleOverTemperature | None = None
    """None of a single root."""

    def write(self, axis: str) -> Model:
        """Model of the gyro on an axis; its parameters are the scatter of s and the noise of the
        readings.
        """
        model = self.model
        return SCALE.write(
            axis,
            [
                (f"s{k}", value, "1" if k == 0 else f"1/degC{k if k > 1 else ''}")
                for k, value in enumerate(model.coefficients.tolist())
            ],
            model.covariance,
            dof=self.dof,
            effective_dof=self.effective_dof,
            components=self.components,
            residual_rms=self.residual_rms,
            residual_unit="1",
            valid={} if model.valid is None else {TEMPERATURE: model.valid},
            parameters=(
                Parameter("scatter", model.scatter, "1"),
                Parameter("gyro_noise", model.noise.gyro_dph, "deg/h"),
                Parameter("accel_noise", model.noise.accel_g, "g"),
                Parameter("noise_dof", float(model.noise.dof), "1"),
            ),
        )


def _powers(model: Model, at: Inputs) -> Array:
    """Powers [n, p] of the case temperature in ascending order; ones for a model without
    temperature.
    """
    abscissa = at[TEMPERATURE] if model.valid else np.zeros(len(next(iter(at.values()))))
    return np.vander(abscissa, len(model.coefficients), increasing=True)


SCALE = Form("inclinometer-scale/1", _powers)
"""s(T) = Σ s_k T^k [1], which multiplies the indicated rate; T in °C."""

"""In-situ scale factor s(T) of one gyro: result of a fit, content of a coefficient file, and model
form of inclinometer_scale.json.
"""

from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Component, Model, Parameter
from calibkit.forms import Form, Inputs
from calibkit.instruments.inclinometer.noise import Noise
from calibkit.instruments.inclinometer.numeric import scale_prior
from calibkit.instruments.inclinometer.numeric.root_choice import Prior
from calibkit.instruments.inclinometer.numeric.scale_fit import ScaleOverTemperature

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

    def prior(self, temperature: Array) -> Prior:
        """Prior of s at temperatures [n] [°C]; for an unknown temperature its uncertainty covers
        the whole range.
        """
        low, high = valid = self.valid or (0.0, 0.0)
        predict = partial(
            scale_prior.predict_scale, self.coefficients, self.covariance, self.scatter, valid
        )
        there = np.isfinite(temperature)
        at, span = predict(np.where(there, temperature, low)), predict(np.linspace(low, high, 41))
        # an unknown temperature is distributed uniformly over the range (GUM 4.3.7)
        spread = np.hypot(span.standard_uncertainty.max(), np.ptp(span.s) / np.sqrt(12.0))
        middle = (span.s.min() + span.s.max()) / 2.0
        return Prior(
            np.where(there, at.s, middle), np.where(there, at.standard_uncertainty, spread)
        )

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


def read_choice(model: Model) -> float:
    """Standard deviation that the choice of the order adds to s(T) in files of calibkit 0.2; later
    ones average the orders.
    """
    return next((one.value for one in model.parameters if one.name == "order_choice"), 0.0)


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """s(T) of one gyro, quality of the fit, and mask [n] of the stations used in it."""

    model: ScaleModel
    dof: int
    residual_rms: float
    used: Mask
    left_out: Prior
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
            [(f"s{k}", value, _unit(k)) for k, value in enumerate(model.coefficients.tolist())],
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


def _unit(power: int) -> str:
    """Unit of s0, s1, …."""
    return "1" if power == 0 else "1/degC" + ("" if power == 1 else str(power))

"""In-situ scale factor s(T) of one gyro: as a fit found it, as a file holds it, and the model form
of inclinometer_scale.json.
"""

from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Model, Parameter
from calibkit.forms import Form, Inputs
from calibkit.instruments.inclinometer.noise import Noise
from calibkit.instruments.inclinometer.numeric import scale_prior
from calibkit.instruments.inclinometer.numeric.root_choice import Prior

FILE = "inclinometer_scale.json"
TEMPERATURE = "temp_case_degc"


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
        low, high = valid = self.valid or (0.0, 0.0)
        predict = partial(
            scale_prior.predict_scale, self.coefficients, self.covariance, self.scatter, valid
        )
        there = np.isfinite(temperature)
        at, span = predict(np.where(there, temperature, low)), predict(np.linspace(low, high, 41))
        # an unknown temperature may be any of the range: a rectangular distribution
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
        )


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """s(T) of one gyro, how well it fits, and which stations [n] carried it."""

    model: ScaleModel
    dof: int
    residual_rms: float
    used: Mask
    left_out: Prior

    def write(self, axis: str) -> Model:
        """Model of the gyro of an axis, with its scatter and the noise of its readings as
        parameters.
        """
        model = self.model
        return SCALE.write(
            axis,
            [(f"s{k}", value, _unit(k)) for k, value in enumerate(model.coefficients.tolist())],
            model.covariance,
            dof=self.dof,
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
    """Ascending powers [n, p] of the case temperature; of a model without temperature, ones."""
    abscissa = at[TEMPERATURE] if model.valid else np.zeros(len(next(iter(at.values()))))
    return np.vander(abscissa, len(model.coefficients), increasing=True)


SCALE = Form("inclinometer-scale/1", _powers)
"""s(T) = Σ s_k T^k [1], which multiplies the indicated rate; T in °C."""


def _unit(power: int) -> str:
    """Unit of s0, s1, …."""
    return "1" if power == 0 else "1/degC" + ("" if power == 1 else str(power))

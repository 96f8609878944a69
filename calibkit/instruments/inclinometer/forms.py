"""Model form of inclinometer_scale.json: the in-situ scale factor s(T) of one gyro."""

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model, Parameter
from calibkit.forms import Form, Inputs
from calibkit.instruments.inclinometer.noise import Noise
from calibkit.instruments.inclinometer.scale_model import ScaleFit, ScaleModel

TEMPERATURE = "temp_case_degc"


def _powers(model: Model, at: Inputs) -> Array:
    """Ascending powers [n, p] of the case temperature; of a model without temperature, ones."""
    abscissa = at[TEMPERATURE] if model.valid else np.zeros(len(next(iter(at.values()))))
    return np.vander(abscissa, len(model.coefficients), increasing=True)


SCALE = Form("inclinometer-scale/1", _powers)
"""s(T) = Σ s_k T^k [1], which multiplies the indicated rate; T in °C."""


def write_scale(axis: str, scale: ScaleFit) -> Model:
    """Model of one gyro, with its scatter and the noise of its readings as parameters."""
    model = scale.model
    return SCALE.write(
        axis,
        [(f"s{k}", value, _unit(k)) for k, value in enumerate(model.coefficients.tolist())],
        model.covariance,
        dof=scale.dof,
        residual_rms=scale.residual_rms,
        residual_unit="1",
        valid={} if model.valid is None else {TEMPERATURE: model.valid},
        parameters=(
            Parameter("scatter", model.scatter, "1"),
            Parameter("gyro_noise", model.noise.gyro_dph, "deg/h"),
            Parameter("accel_noise", model.noise.accel_g, "g"),
            Parameter("noise_dof", float(model.noise.dof), "1"),
        ),
    )


def read_scale(model: Model) -> ScaleModel:
    """s(T) of one gyro from its model; raises CoefficientError for another form."""
    return ScaleModel(
        SCALE.read(model),
        np.array(model.covariance),
        model.value("scatter"),
        model.valid.get(TEMPERATURE),
        Noise(
            model.value("accel_noise"), model.value("gyro_noise"), round(model.value("noise_dof"))
        ),
    )


def _unit(power: int) -> str:
    """Unit of s0, s1, …."""
    return "1" if power == 0 else "1/degC" + ("" if power == 1 else str(power))

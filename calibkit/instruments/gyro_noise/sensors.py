"""What noise is of a gyro and of an accelerometer: units, noise terms, limits of the recipe."""

from collections.abc import Mapping
from dataclasses import dataclass

from calibkit.numeric.noise.allan_fit import ACCELEROMETER_LAWS, LAWS, PowerLaw


@dataclass(frozen=True, slots=True)
class Sensor:
    """Kind of sensor: unit of its deviations, name of its mean, noise terms, and the recipe's key
    of the limit on each figure.
    """

    unit: str
    mean: str
    laws: tuple[PowerLaw, ...]
    limits: Mapping[str, str]


GYRO = Sensor(
    "deg/h",
    "mean_rate",
    LAWS,
    {
        "angle_random_walk": "max_angle_random_walk",
        "bias_instability": "max_bias_instability_dph",
        "rate_random_walk": "max_rate_random_walk",
        "bias_stability": "max_bias_stability_dph",
    },
)
ACCELEROMETER = Sensor(
    "mg",
    "mean_acceleration",
    ACCELEROMETER_LAWS,
    {
        "velocity_random_walk": "max_velocity_random_walk",
        "bias_instability": "max_bias_instability_mg",
        "acceleration_random_walk": "max_acceleration_random_walk",
        "bias_stability": "max_bias_stability_mg",
    },
)


def find_sensor(column: str) -> Sensor:
    """Kind of the sensor that a column is the indication of."""
    return ACCELEROMETER if column.startswith("accel") else GYRO

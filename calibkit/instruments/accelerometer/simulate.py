"""A triad of servo accelerometers on a two-axis table in a chamber: dwells at attitudes and
temperatures.

The sensors are physical, not the models that are fitted: magnets that lose flux by an exponential
law, springs whose bias saturates, axes that turn with temperature, second- and third-order errors,
cross products, a thermometer with an error of its own. Indications are
positive along gravity.
"""

from dataclasses import asdict, dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.accelerometer import simulate_magnitude
from calibkit.numeric import attitude
from calibkit.simulate.campaign import Campaign

TEMPERATURES_DEGC = (-20.0, -5.0, 10.0, 25.0, 45.0, 65.0, 85.0, 105.0, 125.0)
AXES = "xyz"
DECIMALS = {
    "time_s": 1,
    "temp_case_degc": 3,
    "inclination_deg": 4,
    "toolface_deg": 4,
    "accel_x_g": 8,
    "accel_y_g": 8,
    "accel_z_g": 8,
}


@dataclass(frozen=True, slots=True)
class _Sensor:
    """One servo accelerometer; temperatures relative to 25 °C."""

    scale_factor: float
    """Indication per g at 25 °C [1]."""
    flux_loss: float
    """Reversible loss of the magnet's flux, relative to the scale factor [1/°C]."""
    flux_curvature: float
    """Second-order coefficient of the flux loss [1/°C²]."""
    bias: float
    """Bias at 25 °C [g]."""
    bias_slope: float
    """Bias temperature coefficient [g/°C]."""
    bias_bend: float
    """Saturating part of the bias [g]."""
    bend_width: float
    """Temperature scale of the saturation [°C]."""
    second_order: float
    """K₂ [g/g²]."""
    third_order: float
    """K₃ [g/g³]."""
    cross_product: float
    """K_ip with the next axis [g/g²]."""
    axis: tuple[float, float, float]
    """Sensitive axis at 25 °C, unit vector in the tool."""
    axis_turn: tuple[float, float, float]
    """Rotation of the axis [rad/°C] about the tool's axes."""


@dataclass(frozen=True, slots=True)
class _Conditions:
    """Conditions of a simulated campaign."""

    noise_g: float = 2e-5
    """Standard deviation of a logged indication [g]."""
    table_noise_deg: float = 0.01
    """Standard deviation of inclination and toolface of the table about what is logged [°]."""
    thermometer_noise_degc: float = 0.02
    temperatures_degc: tuple[float, ...] = TEMPERATURES_DEGC
    inclinations_deg: tuple[float, ...] = (30.0, 60.0, 90.0, 120.0, 150.0)
    """Inclinations held beside the two vertical positions, which are always held."""
    toolfaces: int = 8
    """Number of toolfaces, evenly spaced over a turn."""
    wild: int = 0
    """Number of dwells spoilt by a bumped table or a wrong entry."""


def campaign(seed: int, conditions: _Conditions = _Conditions()) -> Campaign:
    """Log a triad at every attitude and temperature of the table, one row per dwell.

    Parameters
    ----------
    seed
        What triad, table and noise are drawn from.
    conditions
        How the campaign is run.

    Returns
    -------
    `positions.csv`, and the truth: sensors, conditions, the table's true angles and the numbers of
    the spoilt dwells.

    """
    rng = np.random.default_rng(seed)
    sensors = draw_triad(rng)
    rolls = np.arange(conditions.toolfaces) * 360.0 / conditions.toolfaces
    spots = [
        (0.0, 0.0),
        *((tilt, roll) for tilt in conditions.inclinations_deg for roll in rolls),
        (180.0, 0.0),
    ]
    angle = np.tile(np.array(spots), (len(conditions.temperatures_degc), 1))
    # the chamber settles a little off its set point, the sensors follow the case
    sensor_degc = np.repeat(np.array(conditions.temperatures_degc), len(spots)) + rng.normal(
        0.0, 0.2, len(angle)
    )
    true_angles = angle + rng.normal(0.0, conditions.table_noise_deg, angle.shape)
    vector = attitude.gravity_vector(true_angles[:, 0], true_angles[:, 1])
    indicated = indications(sensors, vector, sensor_degc) + rng.normal(
        0.0, conditions.noise_g, (len(angle), 3)
    )
    wild = np.sort(rng.choice(len(angle), conditions.wild, replace=False))
    indicated[wild] += rng.uniform(2e-3, 0.3, (wild.size, 3)) * rng.choice(
        [-1.0, 1.0], (wild.size, 3)
    )
    case = sensor_degc + rng.normal(0.0, conditions.thermometer_noise_degc, len(angle))
    columns = {
        "temp_case_degc": case,
        "inclination_deg": angle[:, 0],
        "toolface_deg": angle[:, 1],
        **{f"accel_{name}_g": indicated[:, i] for i, name in enumerate(AXES)},
    }
    truth = {
        "seed": seed,
        "conditions": asdict(conditions),
        "sensors": describe(sensors),
        "inclination_deg": attitude.inclination(vector).tolist(),
        "toolface_deg": attitude.toolface(vector).tolist(),
        "wild_dwells": wild.tolist(),
    }
    return Campaign({"positions.csv": columns}, DECIMALS, truth)


def indications(sensors: tuple[_Sensor, ...], gravity: Array, temperature: Array) -> Array:
    """Noise-free indications [n, 3] of three sensors in gravity [n, 3] [g] at sensor temperatures
    [n] [°C].
    """
    acting = np.column_stack(
        [np.sum(gravity * _sensitive_axis(s, temperature), axis=1) for s in sensors]
    )
    warm = temperature - 25.0
    columns = []
    for i, sensor in enumerate(sensors):
        own_axis, next_axis = acting[:, i], acting[:, (i + 1) % 3]
        scale = sensor.scale_factor * np.exp(
            -sensor.flux_loss * warm - sensor.flux_curvature * warm**2
        )
        bias = (
            sensor.bias
            + sensor.bias_slope * warm
            + sensor.bias_bend * np.tanh(warm / sensor.bend_width)
        )
        higher = (
            sensor.second_order * own_axis**2
            + sensor.third_order * own_axis**3
            + sensor.cross_product * own_axis * next_axis
        )
        columns.append(scale * (own_axis + higher + bias))
    return np.column_stack(columns)


def _sensitive_axis(sensor: _Sensor, temperature: Array) -> Array:
    """Unit vectors [n, 3] of the sensitive axis at temperatures [n] [°C]."""
    change = np.cross(
        np.array(sensor.axis_turn) * (temperature - 25.0)[:, None], np.array(sensor.axis)
    )
    vectors = np.array(sensor.axis) + change
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), dtype=np.float64)


def draw_triad(rng: np.random.Generator) -> tuple[_Sensor, ...]:
    """Draw three servo accelerometers, of x, y and z."""
    return tuple(_sensor(rng, i) for i in range(3))


def describe(sensors: tuple[_Sensor, ...]) -> dict[str, object]:
    """Truth of a triad."""
    return {f"accel_{a}": asdict(sensor) for a, sensor in zip(AXES, sensors, strict=True)}


def _sensor(rng: np.random.Generator, index: int) -> _Sensor:
    """Draw the constants of one servo accelerometer for downhole tools."""
    axis = np.eye(3)[index] + rng.normal(0.0, 3e-3, 3)
    first, second, third = (axis / np.linalg.norm(axis)).tolist()
    turn_x, turn_y, turn_z = rng.normal(0.0, 8e-7, 3).tolist()
    return _Sensor(
        scale_factor=1.0 + rng.normal(0.0, 3e-3),
        flux_loss=rng.normal(1.2e-4, 2e-5),
        flux_curvature=rng.normal(1e-7, 3e-8),
        bias=rng.normal(0.0, 3e-3),
        bias_slope=rng.normal(0.0, 3e-5),
        bias_bend=rng.normal(0.0, 5e-4),
        bend_width=rng.uniform(150.0, 250.0),
        second_order=rng.normal(0.0, 1e-5),
        third_order=rng.normal(0.0, 1e-5),
        cross_product=rng.normal(0.0, 1e-5),
        axis=(first, second, third),
        axis_turn=(turn_x, turn_y, turn_z),
    )


CAMPAIGNS = {"accelerometer": campaign, "accelerometer_magnitude": simulate_magnitude.campaign}

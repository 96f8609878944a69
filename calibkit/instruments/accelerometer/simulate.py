"""A triad of servo accelerometers on a two-axis table in a chamber: dwells at attitudes and
temperatures.

The sensors are physical, not the models that are fitted: magnets that lose flux by an exponential
law, springs whose bias saturates, axes that turn with temperature, second- and third-order errors,
cross products, a thermometer with an error of its own. Indications are
positive along gravity.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from calibkit.instruments.accelerometer import simulate_magnitude
from calibkit.numeric import attitude
from calibkit.numeric.arrays import Array
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


Sensor: TypeAlias = dict[str, Any]
"""Constants of one servo accelerometer, as `draw_triad` lists them."""


def campaign(
    seed: int,
    *,
    noise_g: float = 2e-5,
    table_noise_deg: float = 0.01,
    thermometer_noise_degc: float = 0.02,
    temperatures_degc: tuple[float, ...] = TEMPERATURES_DEGC,
    inclinations_deg: tuple[float, ...] = (30.0, 60.0, 90.0, 120.0, 150.0),
    toolfaces: int = 8,
    outliers: int = 0,
) -> Campaign:
    """Log a triad at every attitude and temperature of the table, one row per dwell.

    Parameters
    ----------
    seed : what triad, table and noise are drawn from.
    noise_g : standard deviation of a logged indication [g].
    table_noise_deg : that of inclination and toolface of the table about what is logged [°].
    thermometer_noise_degc : that of the thermometer [°C].
    temperatures_degc : of the soaks [°C].
    inclinations_deg : held beside the two vertical positions, which are always held [°].
    toolfaces : number of them, evenly spaced over a turn.
    outliers : number of dwells at which the table was bumped, or an entry is wrong.

    Returns
    -------
    `positions.csv`, and the truth: sensors, conditions, the table's true angles and the numbers of
    the outliers.

    """
    conditions = {
        "noise_g": noise_g,
        "table_noise_deg": table_noise_deg,
        "thermometer_noise_degc": thermometer_noise_degc,
        "temperatures_degc": temperatures_degc,
        "inclinations_deg": inclinations_deg,
        "toolfaces": toolfaces,
        "outliers": outliers,
    }
    rng = np.random.default_rng(seed)
    sensors = draw_triad(rng)
    rolls = np.arange(toolfaces) * 360.0 / toolfaces
    spots = [
        (0.0, 0.0),
        *((tilt, roll) for tilt in inclinations_deg for roll in rolls),
        (180.0, 0.0),
    ]
    angle = np.tile(np.array(spots), (len(temperatures_degc), 1))
    # the chamber settles a little off its set point, the sensors follow the case
    sensor_degc = np.repeat(np.array(temperatures_degc), len(spots)) + rng.normal(
        0.0, 0.2, len(angle)
    )
    true_angles = angle + rng.normal(0.0, table_noise_deg, angle.shape)
    vector = attitude.gravity_vector(true_angles[:, 0], true_angles[:, 1])
    indicated = indications(sensors, vector, sensor_degc) + rng.normal(
        0.0, noise_g, (len(angle), 3)
    )
    outlier_rows = np.sort(rng.choice(len(angle), outliers, replace=False))
    size_g = rng.uniform(2e-3, 0.3, (outliers, 3))
    indicated[outlier_rows] += size_g * rng.choice([-1.0, 1.0], (outliers, 3))
    case = sensor_degc + rng.normal(0.0, thermometer_noise_degc, len(angle))
    columns = {
        "temp_case_degc": case,
        "inclination_deg": angle[:, 0],
        "toolface_deg": angle[:, 1],
        **{f"accel_{name}_g": indicated[:, i] for i, name in enumerate(AXES)},
    }
    truth = {
        "seed": seed,
        "conditions": conditions,
        "sensors": describe(sensors),
        "inclination_deg": attitude.inclination(vector).tolist(),
        "toolface_deg": attitude.toolface(vector).tolist(),
        "outlier_dwells": outlier_rows.tolist(),
    }
    return Campaign({"positions.csv": columns}, DECIMALS, truth)


def indications(sensors: Sequence[Sensor], gravity: Array, temperature: Array) -> Array:
    """Noise-free indications [n, 3] of three sensors in gravity [n, 3] [g] at sensor temperatures
    [n] [°C].
    """
    warm, acting = temperature - 25.0, []
    for sensor in sensors:
        axis_turns = np.array(sensor["axis_turn"]) * warm[:, None]
        axis = np.array(sensor["axis"]) + np.cross(axis_turns, np.array(sensor["axis"]))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        acting.append(np.sum(gravity * axis, axis=1))
    columns = []
    for i, sensor in enumerate(sensors):
        own_axis, next_axis = acting[i], acting[(i + 1) % 3]
        flux = -sensor["flux_loss"] * warm - sensor["flux_curvature"] * warm**2
        bent = sensor["bias_bend"] * np.tanh(warm / sensor["bend_width"])
        bias = sensor["bias"] + sensor["bias_slope"] * warm + bent
        higher = (
            sensor["second_order"] * own_axis**2
            + sensor["third_order"] * own_axis**3
            + sensor["cross_product"] * own_axis * next_axis
        )
        columns.append(sensor["scale_factor"] * np.exp(flux) * (own_axis + higher + bias))
    return np.column_stack(columns)


def draw_triad(rng: np.random.Generator) -> tuple[Sensor, ...]:
    """Draw three servo accelerometers for downhole tools, of x, y and z; temperatures are relative
    to 25 °C.
    """
    sensors = []
    for direction in np.eye(3):
        axis = direction + rng.normal(0.0, 3e-3, 3)
        turn = rng.normal(0.0, 8e-7, 3)
        sensor = {
            # indication per g at 25 °C
            "scale_factor": 1.0 + rng.normal(0.0, 3e-3),
            # reversible loss of the magnet's flux, relative to the scale factor [1/°C], [1/°C²]
            "flux_loss": rng.normal(1.2e-4, 2e-5),
            "flux_curvature": rng.normal(1e-7, 3e-8),
            # at 25 °C [g], and over temperature [g/°C]
            "bias": rng.normal(0.0, 3e-3),
            "bias_slope": rng.normal(0.0, 3e-5),
            # saturating part of the bias [g], and its temperature scale [°C]
            "bias_bend": rng.normal(0.0, 5e-4),
            "bend_width": rng.uniform(150.0, 250.0),
            # K₂ [g/g²], K₃ [g/g³], K_ip with the next axis [g/g²]
            "second_order": rng.normal(0.0, 1e-5),
            "third_order": rng.normal(0.0, 1e-5),
            "cross_product": rng.normal(0.0, 1e-5),
            # unit vector in the tool at 25 °C, and its rotation about the tool's axes [rad/°C]
            "axis": (axis / np.linalg.norm(axis)).tolist(),
            "axis_turn": turn.tolist(),
        }
        sensors.append(sensor)
    return tuple(sensors)


def describe(sensors: Sequence[Sensor]) -> dict[str, object]:
    """Truth of a triad."""
    return {f"accel_{a}": dict(sensor) for a, sensor in zip(AXES, sensors, strict=True)}


CAMPAIGNS = {"accelerometer": campaign, "accelerometer_magnitude": simulate_magnitude.campaign}

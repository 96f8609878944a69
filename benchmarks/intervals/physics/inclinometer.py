"""Four-position inclinometers: faults of the stand, and of the stations that are chosen.

A gyro indicates the earth's rate along its axis divided by its in-situ scale factor s. The truth
is the tool's own s(T), and its azimuth.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from intervals.physics.campaigns import Applied, Campaign, Fault, Truth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

EARTH_DPH, LATITUDE_DEG, ROOM_DEGC = 15.041, 34.2, 25.0
POSITIONS_DEG = np.array([0.0, 90.0, 180.0, 270.0])
SENSORS_DEG = {"x": 0.0, "y": 90.0}
"""Direction of each pair of a gyro and an accelerometer about the tool, in position 0."""
GYRO_NOISE_DPH, ACCEL_NOISE_G, INDEX_DEG = 0.01, 2e-5, 0.01
SCALE, AZIMUTH = "s(T)", "azimuth"
AT_DEGC = (25.0, 70.0, 115.0)
ROOT_NOISE = 5e-4
"""Near the noise of the s of one station."""


@dataclass(frozen=True)
class Stations:
    """Attitude [°] and temperature [°C] of n stations."""

    inclination: Array
    toolface: Array
    azimuth: Array
    degc: Array


def draw(rng: np.random.Generator, count: int, *, fixed: bool = False) -> Stations:
    """Stations while the tool warms: each in an attitude of its own, or all in the first one."""
    inclination = rng.uniform(5.0, 50.0, count)
    toolface, azimuth = rng.uniform(-180.0, 180.0, count), rng.uniform(0.0, 360.0, count)
    if fixed:
        inclination, toolface, azimuth = (
            np.full(count, angle[0]) for angle in (inclination, toolface, azimuth)
        )
    degc = np.linspace(20.0, 120.0, count) + rng.normal(0.0, 1.0, count)
    return Stations(inclination, toolface, azimuth, degc)


def _along(vector_ned: Array, at: Stations, direction_deg: Array) -> Array:
    """Component [n, 4] of a vector [3] (north, east, down) along directions [n, 4] about the tool,
    whose attitude is azimuth about down, then inclination, then toolface.
    """
    theta, phi, psi = np.radians((at.inclination, at.toolface, at.azimuth))
    north, east, down = vector_ned
    high = (north * np.cos(psi) + east * np.sin(psi)) * np.cos(theta) - down * np.sin(theta)
    right = east * np.cos(psi) - north * np.sin(psi)
    angle = phi[:, None] + np.radians(direction_deg)
    return np.asarray(high[:, None] * np.cos(angle) + right[:, None] * np.sin(angle))


def log(
    rng: np.random.Generator, at: Stations, s: dict[str, Array], latitude_deg: float
) -> pd.DataFrame:
    """Log of stations of a tool with scale factors s [n] of each gyro."""
    latitude, count = np.radians(latitude_deg), at.degc.size
    earth = EARTH_DPH * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    turned = POSITIONS_DEG + INDEX_DEG * rng.normal(size=(count, 4))
    frame = {
        "station": np.repeat(np.arange(1, count + 1), 4),
        "position_deg": np.tile(POSITIONS_DEG, count),
        "temp_case_degc": np.repeat(at.degc, 4),
    }
    for sensor, nominal_deg in SENSORS_DEG.items():
        direction = turned + nominal_deg
        accel = _along(np.array([0.0, 0.0, 1.0]), at, direction) + rng.normal(0.0, 1e-3)
        gyro = _along(earth, at, direction) / s[sensor][:, None] + rng.normal(0.0, 0.3)
        noise = rng.normal(size=(2, count, 4))
        frame[f"accel_{sensor}_g"] = (accel + ACCEL_NOISE_G * noise[0]).ravel()
        frame[f"gyro_{sensor}_dph"] = (gyro + GYRO_NOISE_DPH * noise[1]).ravel()
    return pd.DataFrame(frame)


def _scale(rng: np.random.Generator, slope: float) -> dict[str, tuple[float, float]]:
    """Scale factor at 25 °C and its change per °C, of both gyros; it changes by `slope` over
    100 °C.
    """
    return {sensor: (1.0 + rng.normal(0.0, 3e-3), slope / 100.0) for sensor in SENSORS_DEG}


def _campaign(
    rng: np.random.Generator, at: Stations, slope: float, *, latitude_u_deg: float | None = None
) -> Campaign:
    """Stations whose s(T) is a straight line; where a standard uncertainty of the latitude of the
    place of use is given [°], twelve stations there too.
    """
    lines = _scale(rng, slope)

    def s(degc: Array) -> dict[str, Array]:
        return {name: base + per * (degc - ROOM_DEGC) for name, (base, per) in lines.items()}

    recipe = {
        "procedure": "inclinometer",
        "logs": {"files": ["stations.csv"]},
        "site": {"latitude_deg": LATITUDE_DEG},
        "reference": {"convention": "gravity"},
        "output": {"azimuth_uncertainty": True},
    }
    truth = [
        Truth(SCALE, f".{name}.s", float(values[k]), {"temp_case_degc": degc})
        for name, values in s(np.array(AT_DEGC)).items()
        for k, degc in enumerate(AT_DEGC)
    ]
    logs = {"stations.csv": log(rng, at, s(at.degc), LATITUDE_DEG)}
    if latitude_u_deg is None:
        return Campaign(recipe, logs, truth)
    place = draw(rng, 12)
    latitude_deg = LATITUDE_DEG + latitude_u_deg * rng.normal()
    applied = Applied(
        AZIMUTH,
        log(rng, place, s(place.degc), latitude_deg),
        "azimuth_deg",
        np.repeat(place.azimuth, 4),
        "azimuth_standard_uncertainty_deg",
        {"site__latitude_uncertainty_deg": latitude_u_deg},
    )
    return Campaign(recipe, logs, truth, applied)


def _fixture(rng: np.random.Generator, size: float) -> Campaign:
    """24 stations, with a size of 1 in one fixed fixture."""
    return _campaign(rng, draw(rng, 24, fixed=size > 0.0), 3e-3)


def _slope(rng: np.random.Generator, size: float) -> Campaign:
    """24 stations; s changes by `size` times the noise of one over the range."""
    return _campaign(rng, draw(rng, 24), size * ROOT_NOISE)


def _latitude(rng: np.random.Generator, size: float) -> Campaign:
    """The latitude of the place of use is known to a standard uncertainty of `size` °."""
    return _campaign(rng, draw(rng, 24), 3e-3, latitude_u_deg=size)


_row = partial(Fault, "inclinometer")
FAULTS = (
    _row("latitude of the place of use", 0.5, "°", _latitude, "latitude"),
    _row("stations in one fixed fixture", 1.0, "", _fixture, "one attitude|not separable"),
    _row("slope of s(T) over its noise", 1.5, "×", _slope, "order of"),
)

"""Stations of a north-seeking tool by matrices, for tests of what solves them."""

import numpy as np

from calibkit.instruments.inclinometer import published, stations as station_steps
from calibkit.numeric import earth

FOUR = (0.0, 90.0, 180.0, 270.0)
"""Positions of a station [°]."""


def wrapped(angle):
    """Angle in [−180, 180)."""
    return np.remainder(angle + 180.0, 360.0) - 180.0


def forward(inclination, toolface, azimuth, latitude, s=1.0, position=0.0):
    """Gravity [g] and gyro rates [°/h] that a tool reads, by matrices."""
    turn = passive("z", toolface + position) @ passive("y", inclination) @ passive("z", azimuth)
    return turn @ [0.0, 0.0, 1.0], turn @ earth.north_east_down(latitude) / s


def closed(readings):
    """Noise of a reading, from how the four positions [n, 4] close."""
    return float(np.sqrt(np.mean((readings @ [0.5, -0.5, 0.5, -0.5]) ** 2)))


def components_of(accel, gyro, sensor, *, accel_noise_g=0.0, gyro_noise_dph=0.0):
    """Components of stations with readings [n, 4] at 0°, 90°, 180°, 270°, of a stated noise."""
    station, position = np.repeat(np.arange(len(accel)), 4), np.tile(FOUR, len(accel))
    fits = station_steps.fit_stations(station, position, accel.ravel(), gyro.ravel(), sensor)
    return fits.components(published.Noise(accel_noise_g, gyro_noise_dph, 0))


def vector_components(station, sensor):
    """Components of a worked example."""
    accel, gyro = (
        np.array([[reading[f"{kind}_{sensor}_{unit}"] for reading in station["readings"]]])
        for kind, unit in (("accel", "g"), ("gyro", "dph"))
    )
    return components_of(accel, gyro, sensor)


def passive(axis, degrees):
    """Passive rotation matrix about one axis, written out."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    if axis == "z":
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])

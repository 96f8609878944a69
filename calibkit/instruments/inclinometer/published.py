"""Four-position north seeking as published (temperature compensation of a FOG inclinometer, Wuxi
Huilian 2015): steps C, D and F; A and B, from readings in positions to components, are
`stations.fit_stations`.

North-east-down axes; azimuth ψ about z, inclination θ about y, toolface φ about z, passive
rotations; indications positive along gravity; rates in °/h, accelerations in local g. A sensor pair
is one gyro and one accelerometer on one axis.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calibkit.fit.complex_step import Numbers, arctan2
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.constants import EARTH_RATE_DPH

Sensor = Literal["x", "y"]
"""Axis of a sensor pair: at 90° the x sensor lies where y was, the y sensor where −x was."""
SENSORS = (("accel", "g", "g"), ("gyro", "dph", "deg/h"))
"""Sensors of a pair: name, last word of their column, unit."""
POSITIONS_DEG = (0.0, 90.0, 180.0, 270.0)
POSITION_TOLERANCE_DEG = 0.1
"""Largest departure of a position from its nominal angle [°] with which the four differences are
used.
"""


@dataclass(frozen=True, slots=True)
class Components:
    """Gravity and earth rate across the tool at n stations, free of constant bias (step B), and
    their covariance.
    """

    accel_x: Array
    accel_y: Array
    gyro_x: Array
    gyro_y: Array
    covariance: Array
    """[n, 4, 4] of accel_x, accel_y [g], gyro_x, gyro_y [°/h]."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of one reading of a sensor pair, and the degrees of freedom of their
    estimate.
    """

    accel_g: float
    gyro_dph: float
    dof: int

    def widen(self, spec: InclinometerRecipe) -> "Noise":
        """Noise for propagation: a noise estimated from few degrees of freedom is raised by
        Student's t, so that k = 2 covers 95 %.
        """
        if not self.dof:
            return self
        factor = gum.widening(self.dof)
        accel = factor if spec.stations.accel_noise_g == "auto" else 1.0
        gyro = factor if spec.stations.gyro_noise_dph == "auto" else 1.0
        return Noise(accel * self.accel_g, gyro * self.gyro_dph, self.dof)


NO_NOISE = Noise(0.0, 0.0, 0)
"""Noise before any reading: zero, from no degrees of freedom."""


@dataclass(frozen=True, slots=True)
class Attitude:
    """Inclination and toolface of n stations (step C)."""

    inclination: Array
    """θ [rad]."""
    toolface: Array
    """φ [rad], in (−π, π]."""
    clamped: Mask
    """Whether √(g_x² + g_y²) exceeded g and was clamped to it."""


def nearest_position(position_deg: Array) -> Integers:
    """Index [r] of the nearest position (0°, 90°, 180°, 270°) to each rotation [r] [°]."""
    # quarters from 45° on, so that -0.1° and 359.9° are position 0
    from_edge = np.remainder(position_deg + 45.0, 360.0)
    return np.clip(np.floor(from_edge / 90.0), 0, 3).astype(np.int64)


def attitude(accel_x: Array, accel_y: Array) -> Attitude:
    """Inclination and toolface (step C): θ = arcsin √(g_x² + g_y²), φ = atan2(g_y, −g_x), of
    components [n] [g].
    """
    level = np.sqrt(accel_x**2 + accel_y**2)
    clamped = np.asarray(np.real(level) > 1.0, dtype=np.bool_)
    return Attitude(
        inclination=np.arcsin(np.where(clamped, 1.0, level)),
        toolface=_atan2(accel_y, -accel_x),
        clamped=clamped,
    )


def scale_roots(
    gyro_x: Array, gyro_y: Array, tilt: Attitude, latitude_deg: ArrayLike
) -> tuple[Array, Array, Mask]:
    """The + root and the − root of (s A − sin α sin θ)² + s² B² cos²θ = cos²α cos²θ (step D), NaN
    where no rate is seen, and whether a negative discriminant was clamped to zero.

    gyro_x, gyro_y : [n] [°/h]; latitude_deg : α [°], one or [n].
    """
    # rates in units of the earth's rate, rotated back by the toolface
    x, y = gyro_x / EARTH_RATE_DPH, gyro_y / EARTH_RATE_DPH
    A = x * np.cos(tilt.toolface) - y * np.sin(tilt.toolface)
    B = x * np.sin(tilt.toolface) + y * np.cos(tilt.toolface)
    latitude = np.asarray(latitude_deg) * np.pi / 180.0
    sine, cosine = np.sin(tilt.inclination), np.cos(tilt.inclination)
    # step D solved for s: cos²α (A² + B²) - B² sin²θ, below 0 by noise alone
    discriminant = (A**2 + B**2) * np.cos(latitude) ** 2 - (sine * B) ** 2
    # ω_x² + ω_y² - B² sin²θ = A² + B² cos²θ
    divisor = A**2 + (cosine * B) ** 2
    middle = A * np.sin(latitude) * sine
    clamped = np.asarray(np.real(discriminant) < 0.0, dtype=np.bool_)
    half = cosine * np.sqrt(np.where(clamped, 0.0, discriminant))
    rotates = np.real(divisor) > 0.0
    safe = np.where(rotates, divisor, np.nan)
    return (middle + half) / safe, (middle - half) / safe, clamped


def azimuth(
    accel_x: Array, accel_y: Array, gyro_x: Array, gyro_y: Array, latitude_deg: ArrayLike
) -> Array:
    """Azimuth ψ [n] [rad], in [0, 2π), from corrected rates s ω [n] [°/h] and components [n] [g]
    (step F).

    ψ = atan2(−(ω_x g_y − ω_y g_x) √(g² − g_x² − g_y²), −g (ω_x g_x + ω_y g_y) − ω_e sin α (g_x² +
    g_y²)).
    """
    x, y = gyro_x / EARTH_RATE_DPH, gyro_y / EARTH_RATE_DPH
    level = accel_x**2 + accel_y**2
    # g along the tool, which no sensor of the tool measures
    down = np.sqrt(np.where(np.real(level) > 1.0, 0.0, 1.0 - level))
    east = -(x * accel_y - y * accel_x) * down
    north = -(x * accel_x + y * accel_y) - np.sin(np.asarray(latitude_deg) * np.pi / 180.0) * level
    return full_circle(_atan2(east, north), 2.0 * np.pi)


def root_label(inclination: Array, psi: Array, latitude_deg: ArrayLike) -> Array:
    """C = cos α cos θ + sin α sin θ cos ψ [n]: positive for an azimuth of the + root; near zero, s
    is useless.

    A computed azimuth always agrees with the root it came from: C labels a solution and cannot
    choose it.
    """
    latitude = np.radians(latitude_deg)
    return np.asarray(
        np.cos(latitude) * np.cos(inclination)
        + np.sin(latitude) * np.sin(inclination) * np.cos(psi),
        dtype=np.float64,
    )


def toolface_plus_azimuth(gyro_x: Array, gyro_y: Array) -> Array:
    """φ + ψ [n] [rad], in [0, 2π), of a vertical tool, where neither alone is defined: atan2(−ω_y,
    ω_x).
    """
    return full_circle(_atan2(-gyro_y, gyro_x), 2.0 * np.pi)


def _atan2(y: Numbers, x: Numbers) -> Numbers:
    """Angle of a vector in (−π, π]; y = −0.0 counts as +0.0, which gives π instead of −π."""
    return arctan2(y + 0.0, x)


def full_circle(angle: Numbers, turn: float) -> Numbers:
    """Angle in [0, turn); a remainder that rounds up to `turn` becomes zero."""
    wrapped = angle - turn * np.floor(np.real(angle) / turn)
    return np.where(np.real(wrapped) >= turn, 0.0, wrapped)

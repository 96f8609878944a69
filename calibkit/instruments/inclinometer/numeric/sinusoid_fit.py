"""Least-squares fit of sinusoid, bias and bias ramp to stations with any number and sequence of
positions.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Integers
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.published import Components, Sensor
from calibkit.numeric.least_squares.fit import linear, undetermined

NAMES = ("x", "y", "bias", "ramp")


@dataclass(frozen=True, slots=True)
class _Fitted:
    """Components of n stations by least squares, with the biases of the sensors."""

    station: Array
    """Name of each station [n], in the order of first appearance."""
    components: Components
    gyro_bias_dph: Array
    gyro_ramp_dph_per_h: Array
    """[n] [°/h²]; 0 where it was not fitted."""
    accel_bias_g: Array
    status: tuple[str, ...]
    """[n]: empty, or why the station cannot be solved; its components are then NaN."""
    squares: Array
    """Sums of squared residuals [n, 2] of accelerometer and gyro; 0 for an unsolved station."""
    dofs: Integers
    """Degrees of freedom [n, 2] of `squares`."""


def fit_stations(
    station: ArrayLike,
    position_deg: Array,
    accel: Array,
    gyro: Array,
    sensor: Sensor,
    *,
    time_s: Array | None = None,
    gyro_ramp: bool = False,
    accel_noise_g: float = 1.0,
    gyro_noise_dph: float = 1.0,
) -> _Fitted:
    """Components of every station of one sensor pair from readings in any positions p: indication =
    x cos p + y sin p + bias + ramp (t − t̄), of the y sensor y cos p − x sin p + ….

    Parameters
    ----------
    station : [r], number of each row's station.
    position_deg : [r] rotations p about the tool axis [°], any, in any sequence.
    accel, gyro : [r] [g] and [°/h].
    sensor : which axis the pair is on.
    time_s : [r] [s], needed for the ramp.
    gyro_ramp : fit a ramp of the gyro's bias at each station.
    accel_noise_g, gyro_noise_dph : standard deviation of one reading, for the covariance.

    Returns
    -------
    Fitted; its components go where those of the four differences go. A station that cannot be
    fitted has its reason.

    Raises
    ------
    FitError
        No station can be fitted, or a ramp without times.

    """
    numbers = np.asarray(station, dtype=np.float64)
    unique, first = np.unique(numbers, return_index=True)
    order = unique[np.argsort(first, kind="stable")]
    sensors = (accel, False, accel_noise_g), (gyro, gyro_ramp, gyro_noise_dph)
    found, covariance = np.full((order.size, 2, 4), np.nan), np.full((order.size, 4, 4), np.nan)
    squares, dofs = np.zeros((order.size, 2)), np.zeros((order.size, 2), dtype=np.int64)
    status = []
    for k, name in enumerate(order):
        rows = numbers == name
        position, clock = position_deg[rows], None if time_s is None else time_s[rows]
        both = np.column_stack((accel[rows], gyro[rows]))
        status.append(_reason(position, both, sensor, clock, ramp=gyro_ramp))
        if status[k]:
            continue
        covariance[k] = 0.0
        for j, (indication, ramp, noise) in enumerate(sensors):
            design, names = _design(position, sensor, clock, ramp=ramp)
            own = slice(2 * j, 2 * j + 2)
            found[k, j], unit, squares[k, j], dofs[k, j] = _fit(design, indication[rows], names)
            covariance[k, own, own] = unit * noise**2
    if all(status):
        raise FitError(f"none of {order.size} stations can be fitted: {status[0]}")
    accel_x, accel_y, accel_bias, _, gyro_x, gyro_y, gyro_bias, gyro_ramps = (
        np.ascontiguousarray(column) for column in found.reshape(-1, 8).T
    )
    parts = Components(accel_x, accel_y, gyro_x, gyro_y, covariance)
    hourly = gyro_ramps * SECONDS_PER_HOUR
    return _Fitted(order, parts, gyro_bias, hourly, accel_bias, tuple(status), squares, dofs)


def _reason(
    position_deg: Array, indications: Array, sensor: Sensor, time_s: Array | None, *, ramp: bool
) -> str:
    """Reason why a station with indications [r, m] at positions [r] cannot be fitted, or an empty
    string.
    """
    if not (np.isfinite(indications).all() and np.isfinite(position_deg).all()):
        return "an indication or a position is not finite"
    if time_s is not None and not np.isfinite(time_s).all():
        return "a time is not finite"
    design, names = _design(position_deg, sensor, time_s, ramp=ramp)
    if position_deg.size < len(names):
        return f"{position_deg.size} readings for {len(names)} coefficients"
    unknown = undetermined(design, names)
    return f"the positions cannot determine {', '.join(unknown)}" if unknown else ""


def _design(
    position_deg: Array, sensor: Sensor, time_s: Array | None, *, ramp: bool
) -> tuple[Array, tuple[str, ...]]:
    """Design matrix [r, 3 or 4] of the components, the bias and the ramp, and the names of its
    columns.
    """
    angle = np.radians(position_deg)
    cosine, sine = np.cos(angle), np.sin(angle)
    columns = [cosine, sine] if sensor == "x" else [-sine, cosine]
    columns.append(np.ones_like(angle))
    if ramp:
        if time_s is None:
            raise FitError("a bias ramp without times", hint="log time_s, or fit the bias alone")
        columns.append(time_s - time_s.mean())
    return np.column_stack(columns), NAMES[: len(columns)]


def _fit(
    design: Array, indication: Array, names: tuple[str, ...]
) -> tuple[Array, Array, float, int]:
    """Coefficients [4] of one sensor at one station, 0 where not fitted; covariance [2, 2] of its
    components for readings of unit variance; sum of squared residuals and degrees of freedom.
    """
    fit = linear(design, indication, names=names)
    coefficients = np.zeros(len(NAMES))
    coefficients[: len(names)] = fit.coefficients
    size = np.linalg.norm(design, axis=0)
    inverse = np.linalg.inv(np.linalg.qr(design / size, mode="r")) / size[:, None]
    # without degrees of freedom the residuals are rounding errors
    square = float(np.sum(fit.residuals**2)) if fit.dof else 0.0
    return coefficients, (inverse @ inverse.T)[:2, :2], square, fit.dof

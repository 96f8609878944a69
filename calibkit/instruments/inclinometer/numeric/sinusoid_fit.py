"""Components of stations with any number and sequence of positions, by least squares.

    r_i = x cos p_i + y sin p_i + b + ḃ (t_i - t̄)      sensor on x                            (1)
    r_i = y cos p_i - x sin p_i + b + ḃ (t_i - t̄)      sensor on y

r reading in position p at time t; x, y the components of gravity or of the earth's rate, b bias of
the sensor, ḃ its ramp.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.fit.complex_step import Numbers, derivative
from calibkit.instruments.inclinometer.published import Components, Sensor
from calibkit.numeric.least_squares.fit import undetermined

NAMES = ("x", "y", "bias", "ramp")


@dataclass(frozen=True, slots=True)
class StationFits:
    """Components of n stations by least squares, with the biases of the sensors; stations in the
    order of first appearance.
    """

    coefficients: Array
    """[n, 2, 4], x, y, bias and ramp by the second of accelerometer [g] and gyro [°/h]; a ramp that
    is not fitted is 0.
    """
    covariance: Array
    """[n, 4, 4] of the components for readings of unit noise."""
    status: tuple[str, ...]
    """[n]: empty, or why the station cannot be solved; its components are then NaN."""
    squares: Array
    """Sums of squared residuals [n, 2] of accelerometer and gyro; 0 for an unsolved station."""
    dofs: Integers
    """Degrees of freedom [n, 2] of `squares`."""

    @property
    def components(self) -> Components:
        """Components of readings of unit noise."""
        accel_x, accel_y, gyro_x, gyro_y = self.coefficients[:, :, :2].reshape(-1, 4).T
        return Components(accel_x, accel_y, gyro_x, gyro_y, self.covariance)


def residual(
    p: Numbers, sensor: Sensor, position_deg: Array, elapsed_s: Array, reading: Array | float
) -> Numbers:
    """What (1) leaves of the readings [r] of a station, of x, y, b and ḃ."""
    x, y, bias, ramp = p
    angle = np.radians(position_deg)
    along, across = (x, y) if sensor == "x" else (y, -x)
    model = along * np.cos(angle) + across * np.sin(angle) + bias + ramp * elapsed_s
    return np.asarray(model - reading)


def fit_stations(
    station: ArrayLike,
    position_deg: Array,
    accel: Array,
    gyro: Array,
    sensor: Sensor,
    *,
    time_s: Array | None = None,
    gyro_ramp: bool = False,
) -> StationFits:
    """Components of every station of one sensor pair.

    Parameters
    ----------
    station : [r], number of each row's station.
    position_deg : [r] rotations p about the tool axis [°], any, in any sequence.
    accel, gyro : [r] [g] and [°/h].
    sensor : which axis the pair is on.
    time_s : [r] [s], needed for the ramp.
    gyro_ramp : fit a ramp of the gyro's bias at each station.

    Returns
    -------
    StationFits; its components go where those of the four differences go. A station that cannot be
    fitted has its reason.

    Raises
    ------
    FitError
        No station can be fitted, or a ramp without times.

    """
    if gyro_ramp and time_s is None:
        raise FitError("a bias ramp without times", hint="log time_s, or fit the bias alone")
    numbers = np.asarray(station, dtype=np.float64)
    unique, first = np.unique(numbers, return_index=True)
    order = unique[np.argsort(first, kind="stable")]
    readings = np.column_stack((accel, gyro))
    time = np.zeros(numbers.size) if time_s is None else time_s
    coefficients = np.full((order.size, 2, len(NAMES)), np.nan)
    covariance = np.full((order.size, 4, 4), np.nan)
    squares, dofs = np.zeros((order.size, 2)), np.zeros((order.size, 2), dtype=np.int64)
    status = []
    for k, name in enumerate(order):
        rows = numbers == name
        position, elapsed, reading = (
            position_deg[rows],
            time[rows] - time[rows].mean(),
            readings[rows],
        )
        design = derivative(
            partial(residual, sensor=sensor, position_deg=position, elapsed_s=elapsed, reading=0.0),
            np.zeros(len(NAMES)),
        )
        count = len(NAMES) if gyro_ramp else len(NAMES) - 1
        status.append(_reason(design[:, :count], elapsed, reading))
        if status[k]:
            continue
        coefficients[k], covariance[k] = 0.0, 0.0
        for j, width in enumerate((len(NAMES) - 1, count)):
            gain = np.linalg.pinv(design[:, :width])
            coefficients[k, j, :width] = gain @ reading[:, j]
            pair = slice(2 * j, 2 * j + 2)
            covariance[k, pair, pair] = (gain @ gain.T)[:2, :2]
            dofs[k, j] = len(reading) - width
            if dofs[k, j]:  # without any, residuals are rounding errors
                left = reading[:, j] - design @ coefficients[k, j]
                squares[k, j] = left @ left
    if all(status):
        raise FitError(f"none of {order.size} stations can be fitted: {status[0]}")
    return StationFits(coefficients, covariance, tuple(status), squares, dofs)


def _reason(design: Array, elapsed_s: Array, readings: Array) -> str:
    """Reason why a station with readings [r, m] cannot be fitted, or an empty string."""
    if not (np.isfinite(readings).all() and np.isfinite(design[:, :2]).all()):
        return "an indication or a position is not finite"
    if not np.isfinite(elapsed_s).all():
        return "a time is not finite"
    names = NAMES[: design.shape[1]]
    if len(design) < len(names):
        return f"{len(design)} readings for {len(names)} coefficients"
    unknown = undetermined(design, names)
    return f"the positions cannot determine {', '.join(unknown)}" if unknown else ""

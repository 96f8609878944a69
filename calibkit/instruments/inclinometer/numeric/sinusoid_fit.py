"""Stations of any number and sequence of positions: sinusoid, bias and bias ramp of each sensor by
least squares.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibkit.arrays import Array, Integers
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.errors import FitError
from calibkit.instruments.inclinometer.numeric.published import Components, Sensor
from calibkit.numeric.least_squares.fit import LinearFit, linear, undetermined

NAMES = ("x", "y", "bias", "ramp")


@dataclass(frozen=True, slots=True)
class _Harmonics:
    """One sensor at one station: what turns with the tool and what stays."""

    x: float
    y: float
    """Components in the start frame, in the unit of the indication."""
    bias: float
    """At the mean time of the readings."""
    ramp: float
    """Per second; 0 where it was not fitted."""
    unit_covariance: Array
    """[q, q] for readings of unit variance."""
    dof: int
    sum_of_squares: float


@dataclass(frozen=True, slots=True)
class Fitted:
    """Components of n stations by least squares, and what the sensors' biases did."""

    station: Array
    """Name of each station [n], in the order of first appearance."""
    components: Components
    gyro_bias_dph: Array
    gyro_ramp_dph_per_h: Array
    """[n] [°/h²]; 0 where it was not fitted."""
    accel_bias_g: Array
    gyro_noise_dph: float
    """Standard deviation of one reading, from the residuals or as given."""
    accel_noise_g: float
    dof: int
    """Of the residuals of all stations, each sensor."""
    status: tuple[str, ...]
    """[n]: empty, or why the station cannot be solved; its components are NaN."""
    squares: Array
    """Sums of squared residuals [n, 2] of accelerometer and gyro; 0 where a station is not solved.
    """
    dofs: Integers
    """Degrees of freedom of each of them [n, 2]."""


def _fit_harmonics(
    position_deg: Array,
    indication: Array,
    sensor: Sensor,
    *,
    time_s: Array | None = None,
    ramp: bool = False,
) -> _Harmonics:
    """Fit indication = x cos p + y sin p + bias + ramp (t − t̄); for the y sensor y cos p − x sin p
    + ….

    Parameters
    ----------
    position_deg : [r] rotations p about the tool axis [°], any, in any sequence.
    indication : [r].
    sensor : which axis the sensor is on.
    time_s : [r] [s], needed for the ramp.
    ramp : whether the bias may change linearly in time.

    Raises
    ------
    FitError
        Readings too few or positions too alike, or a ramp without times.

    """
    design, names = _design(position_deg, sensor, time_s, ramp=ramp)
    fit = linear(design, indication, names=names)
    q = fit.coefficients
    return _Harmonics(
        x=float(q[0]),
        y=float(q[1]),
        bias=float(q[2]),
        ramp=float(q[3]) if ramp else 0.0,
        unit_covariance=_unit_covariance(design),
        dof=fit.dof,
        sum_of_squares=_square(fit),
    )


def _design(
    position_deg: Array, sensor: Sensor, time_s: Array | None, *, ramp: bool
) -> tuple[Array, tuple[str, ...]]:
    """Columns [r, 3 or 4] and names of the components, the bias and the ramp."""
    angle = np.radians(position_deg)
    cosine, sine = np.cos(angle), np.sin(angle)
    columns = [cosine, sine] if sensor == "x" else [-sine, cosine]
    columns.append(np.ones_like(angle))
    if ramp:
        if time_s is None:
            raise FitError("a bias ramp without times", hint="log time_s, or fit the bias alone")
        columns.append(time_s - time_s.mean())
    return np.column_stack(columns), NAMES[: len(columns)]


def _unit_covariance(design: Array) -> Array:
    """Covariance [q, q] of linear coefficients for readings of unit variance, through scaled
    columns.
    """
    size = np.linalg.norm(design, axis=0)
    _, r = np.linalg.qr(design / size)
    inverse = np.linalg.inv(r) / size[:, None]
    return np.asarray(inverse @ inverse.T, dtype=np.float64)


def _square(fit: LinearFit) -> float:
    """Sum of squared residuals; exactly zero without degrees of freedom, where only rounding is
    left.
    """
    return float(np.sum(fit.residuals**2)) if fit.dof else 0.0


def fit_stations(
    station: ArrayLike,
    position_deg: Array,
    accel: Array,
    gyro: Array,
    sensor: Sensor,
    *,
    time_s: Array | None = None,
    gyro_ramp: bool = False,
    accel_noise_g: float | None = None,
    gyro_noise_dph: float | None = None,
) -> Fitted:
    """Components of every station of one sensor pair from readings in any positions.

    Parameters
    ----------
    station : [r], number of each row's station.
    position_deg : [r] [°].
    accel, gyro : [r] [g] and [°/h].
    sensor : which axis the pair is on.
    time_s : [r] [s], needed for the ramp.
    gyro_ramp : fit a ramp of the gyro's bias at each station.
    accel_noise_g, gyro_noise_dph : standard deviation of one reading; by default from the residuals
        of all stations.

    Returns
    -------
    Fitted; its components go where those of the four differences go. A station that cannot be
    fitted has its reason.

    Raises
    ------
    FitError
        No station can be fitted, or no noise is given and no station has more readings than
        coefficients.

    """
    names = np.asarray(station, dtype=np.float64)
    unique, first = np.unique(names, return_index=True)
    order = unique[np.argsort(first, kind="stable")]
    pairs: list[tuple[_Harmonics, _Harmonics] | None] = []
    status = []
    for name in order:
        rows = names == name
        clock = None if time_s is None else time_s[rows]
        both = np.column_stack((accel[rows], gyro[rows]))
        reason = _reason(position_deg[rows], both, sensor, clock, ramp=gyro_ramp)
        status.append(reason)
        if reason:
            pairs.append(None)
            continue
        of_gyro = _fit_harmonics(
            position_deg[rows], gyro[rows], sensor, time_s=clock, ramp=gyro_ramp
        )
        pairs.append((_fit_harmonics(position_deg[rows], accel[rows], sensor), of_gyro))
    fitted = [pair for pair in pairs if pair is not None]
    if not fitted:
        raise FitError(f"none of {len(order)} stations can be fitted: {status[0]}")
    accel_sd = _noise([pair[0] for pair in fitted], accel_noise_g, "accel_noise_g")
    gyro_sd = _noise([pair[1] for pair in fitted], gyro_noise_dph, "gyro_noise_dph")
    return _fitted(order, pairs, tuple(status), accel_sd, gyro_sd)


def _reason(
    position_deg: Array, indications: Array, sensor: Sensor, time_s: Array | None, *, ramp: bool
) -> str:
    """Why a station of readings at positions [r] with indications [r, m] cannot be fitted; empty
    where it can.
    """
    if not (np.isfinite(indications).all() and np.isfinite(position_deg).all()):
        return "an indication or a position is not finite"
    if time_s is not None and not np.isfinite(time_s).all():
        return "a time is not finite"
    design, names = _design(position_deg, sensor, time_s, ramp=ramp)
    if position_deg.size < len(names):
        return f"{position_deg.size} readings for {len(names)} coefficients"
    loose = undetermined(design, names)
    return f"the positions cannot determine {', '.join(loose)}" if loose else ""


def _noise(fits: list[_Harmonics], given: float | None, name: str) -> float:
    """Standard deviation of one reading: as given, or pooled from the residuals of all stations."""
    if given is not None:
        return given
    dof = sum(fit.dof for fit in fits)
    if dof == 0:
        raise FitError(
            "no station has more readings than coefficients: nothing tells the noise",
            hint=f"give {name}",
        )
    return float(np.sqrt(sum(fit.sum_of_squares for fit in fits) / dof))


def _fitted(
    order: Array,
    pairs: list[tuple[_Harmonics, _Harmonics] | None],
    status: tuple[str, ...],
    accel_sd: float,
    gyro_sd: float,
) -> Fitted:
    """Put the stations' fits side by side; NaN for a station without one."""
    values = np.full((order.size, 7), np.nan)
    covariance = np.full((order.size, 4, 4), np.nan)
    squares, dofs = np.zeros((order.size, 2)), np.zeros((order.size, 2), dtype=np.int64)
    for k, pair in enumerate(pairs):
        if pair is None:
            continue
        accel, gyro = pair
        squares[k], dofs[k] = (accel.sum_of_squares, gyro.sum_of_squares), (accel.dof, gyro.dof)
        values[k] = (
            accel.x,
            accel.y,
            gyro.x,
            gyro.y,
            gyro.bias,
            gyro.ramp * SECONDS_PER_HOUR,
            accel.bias,
        )
        covariance[k] = 0.0
        covariance[k, :2, :2] = accel.unit_covariance[:2, :2] * accel_sd**2
        covariance[k, 2:, 2:] = gyro.unit_covariance[:2, :2] * gyro_sd**2
    accel_x, accel_y, gyro_x, gyro_y, bias, ramp, accel_bias = (
        np.ascontiguousarray(column) for column in values.T
    )
    return Fitted(
        station=order,
        components=Components(accel_x, accel_y, gyro_x, gyro_y, covariance),
        gyro_bias_dph=bias,
        gyro_ramp_dph_per_h=ramp,
        accel_bias_g=accel_bias,
        gyro_noise_dph=gyro_sd,
        accel_noise_g=accel_sd,
        dof=int(dofs[:, 1].sum()),
        status=status,
        squares=squares,
        dofs=dofs,
    )

"""Logs of a four-position inclinometer → rows, numbered by station → stations: components across
the tool, their noise, and why a station is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np

from calibkit import check
from calibkit.errors import FitError
from calibkit.instruments.inclinometer import dwells as inclinometer_dwells, published
from calibkit.instruments.inclinometer.dwells import DwellLog
from calibkit.instruments.inclinometer.forms import TEMPERATURE
from calibkit.instruments.inclinometer.published import (
    NO_NOISE,
    SENSORS,
    Components,
    Noise,
    Sensor,
)
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.logs.column_values import unmap_values
from calibkit.numeric import attitude
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.attitude import gravity_positive
from calibkit.numeric.constants import SECONDS_PER_HOUR
from calibkit.numeric.least_squares.fit import undetermined
from calibkit.records.frame import Examined, Finding, Log, refuse, values

if TYPE_CHECKING:
    from pandas import DataFrame

PLAUSIBLE = {"accel": 1.5, "gyro": 1000.0}
"""Largest indication [g], [°/h] of a tool at rest, bias included; a larger one has a wrong unit."""
CONTRADICTED = 1e-6
"""Probability below which closures contradict a known noise; the noise is then estimated from the
readings alone.
"""
FEWEST_CLOSING = 8
"""Fewest stations for outlier detection: the median of fewer is too uncertain."""
IMPROBABLE = 1e-20
"""Probability of a closure by noise below which it is an outlier: 9.3 standard deviations with one
degree of freedom.

With eight stations of one degree of freedom 0.08 % of campaigns have such a closure by chance,
with twelve 0.02 %, because the median of a few stations is uncertain itself.
"""
COEFFICIENTS = ("x", "y", "bias", "ramp")
"""Of a sensor in a station that is fitted by least squares."""
REFERENCE = ("inclination_deg", "toolface_deg", "azimuth_deg")


@dataclass(frozen=True, slots=True)
class Stations:
    """n stations, of numbered logs: components and noise by axis, reasons for refusal (or empty),
    temperature, time and reference attitude.
    """

    names: tuple[str, ...]
    log: Integers
    row_station: Integers
    components: Mapping[Sensor, Components]
    noise: Mapping[Sensor, Noise]
    status: Mapping[Sensor, tuple[str, ...]]
    temperature: Array
    elapsed: Array
    """Hours [n] since the first station; the station's number where the logs have no times."""
    reference: Array
    """[n, 3] of inclination, toolface, azimuth [°]; NaN where there is none."""


def examine(spec: InclinometerRecipe, log: Log) -> Examined:
    """Findings of a log, and its stations: consecutive rows with the same station number, or
    dwells.
    """
    dwelt, findings = _examine_dwells(log, spec)
    return Examined(tuple(findings), () if dwelt is None else dwelt.held())


def admit_logs(logs: Sequence[Log], spec: InclinometerRecipe) -> tuple[list[Log], list[Finding]]:
    """Logs reduced to one row per position, and the findings of all logs; raises FrameError listing
    all refused findings.
    """
    examined = [_examine_dwells(log, spec) for log in logs]
    findings = [finding for _, findings in examined for finding in findings]
    refuse(findings)
    return [dwelt.log for dwelt, _ in examined if dwelt is not None], findings


def _examine_dwells(log: Log, spec: InclinometerRecipe) -> tuple[DwellLog | None, list[Finding]]:
    """Dwells of a log, None where the log is refused as a whole, and all findings on the log and
    its stations.
    """
    columns = [name for name in log.frame.columns if name not in REFERENCE]
    findings = [*check.find_too_few_rows(log, 3), *check.find_missing_values(log, columns)]
    if any(finding.refused for finding in findings):
        return None, findings
    findings += find_unusable(log, spec)
    if any(finding.refused for finding in findings):
        return None, findings
    dwelt = inclinometer_dwells.find_dwells(log, spec)
    findings += dwelt.findings
    if not dwelt.continuous:
        readings = [name for name in columns if name not in ("station", "time_s")]
        findings += check.find_copied_rows(log, readings)
    if spec.stations.method == "four_differences":
        station, position = (values(dwelt.log.frame, name) for name in ("station", "position_deg"))
        for name in dict.fromkeys(station.tolist()):
            rows = np.flatnonzero(station == name)
            fault = _position_fault(position[rows])
            if fault is not None:
                line = dwelt.log.line(int(rows[fault[0]]))
                # finding positions: a station lacks a position or has one twice
                findings.append(
                    Finding(
                        f"{log.file}:{line}: station {name:g}",
                        fault[1],
                        "one row at each of 0°, 90°, 180°, 270°",
                        "repair or remove the station, or set stations.method = 'least_squares'",
                        name="positions",
                        line=line,
                    )
                )
    if not any(finding.refused for finding in findings):
        gyros = [f"gyro_{axis}_dph" for axis in spec.axes]
        findings += [
            finding for gyro in gyros for finding in check.magnitude.check_gyro_unit(log, gyro)
        ]
        findings += check.magnitude.find_compensated_names(log, spec, gyros)
        if TEMPERATURE in log.frame.columns:
            findings += check.thermometers.check_stations(dwelt.log, "station", TEMPERATURE)
    return dwelt, findings


def find_unusable(log: Log, spec: InclinometerRecipe) -> list[Finding]:
    """Faults for which a log is refused as a whole."""
    timed = "time_s" in log.frame.columns
    findings = check.find_missing_values(
        log, [name for name in ("station", "time_s") if name in log.frame.columns]
    )
    if timed:
        findings += check.find_unordered_times(log)
    if TEMPERATURE in log.frame.columns:
        findings += check.find_implausible_temperatures(log, [TEMPERATURE])
    for axis in spec.axes:
        for kind, suffix, unit in SENSORS:
            limit = PLAUSIBLE[kind]
            expected = f"at most {limit:g} {unit} of a tool at rest"
            column = f"{kind}_{axis}_{suffix}"
            findings += check.find_out_of_range(log, column, -limit, limit, unit, expected)
    return findings


def _position_fault(position: Array) -> tuple[int, str] | None:
    """Row and description of the first fault that prevents the four differences at positions [r]
    [°] of one station; None without a fault.
    """
    if not np.isfinite(position).all():
        return int(np.flatnonzero(~np.isfinite(position))[0]), "a position is missing"
    quarter = published.nearest_position(position)
    off_deg = np.abs(attitude.wrapped(position - 90.0 * quarter))
    wrong = np.flatnonzero(off_deg > published.POSITION_TOLERANCE_DEG)
    if wrong.size:
        return int(wrong[0]), f"position {position[wrong[0]]:g}° is no multiple of 90°"
    for k, nominal in enumerate(published.POSITIONS_DEG):
        if (rows := np.flatnonzero(quarter == k)).size > 1:
            return int(rows[1]), f"position {nominal:g}° stands {rows.size} times"
    missing = [f"{p:g}°" for k, p in enumerate(published.POSITIONS_DEG) if k not in quarter]
    return (position.size - 1, f"no row at position {', '.join(missing)}") if missing else None


def gather_rows(logs: Sequence[Log], spec: InclinometerRecipe) -> "DataFrame":
    """Rows of all logs in canonical columns, NaN of one that a log lacks. `station` is the number
    of the station, from 0 in the order of first appearance, `name` what it is called, `log` the
    number of its log; `time_s` counts through all logs where all have it.
    """
    import pandas as pd

    frames, stations, start_s = [], 0, 0.0
    for number, log in enumerate(logs):
        places, station_numbers = pd.factorize(values(log.frame, "station"))
        prefix = f"{log.name}:" if len(logs) > 1 else ""
        names = np.array([f"{prefix}{name:g}" for name in station_numbers.tolist()])
        # each log starts one hour after the end of the one before
        time = np.full(len(log.frame), np.nan)
        if "time_s" in log.frame.columns:
            time = values(log.frame, "time_s") - log.frame["time_s"].iloc[0] + start_s
        start_s = float(time[-1]) + SECONDS_PER_HOUR
        of_rows = log.frame.assign(station=places + stations, time_s=time)
        frames.append(of_rows.assign(name=names[places], log=number))
        stations += station_numbers.size
    sensors = [f"{kind}_{axis}_{word}" for kind, word, _ in SENSORS for axis in spec.axes]
    columns = ["station", "name", "log", "time_s", "position_deg", *sensors]
    return pd.concat(frames, ignore_index=True).reindex(columns=[*columns, TEMPERATURE, *REFERENCE])


def solve_components(
    frame: "DataFrame",
    spec: InclinometerRecipe,
    calibrated_noise: Mapping[Sensor, Noise] | None = None,
) -> Stations:
    """Components of every station (step B) of rows that `gather_rows` gives, with the noise stated
    by the recipe or estimated from the readings.

    The noise of a calibration is pooled with the readings' own unless they
    contradict it. Raises FitError where the noise is unknown.
    """
    by_station = frame.groupby("station")
    mean, first = by_station.mean(numeric_only=True), by_station.first()
    count, station = len(mean), frame["station"].to_numpy()
    position, faults = values(frame, "position_deg"), [""] * count
    if spec.stations.method == "four_differences":
        # half differences of the four positions are their fit by least squares
        for k in range(count):
            fault = _position_fault(position[station == k])
            faults[k] = fault[1] if fault is not None else ""
        quarter = published.nearest_position(np.nan_to_num(position))
        position = np.array(published.POSITIONS_DEG)[quarter]
    components, noises, status = {}, {}, {}
    for axis in spec.axes:
        sensors = [f"{kind}_{axis}_{word}" for kind, word, _ in SENSORS]
        accel, gyro = (values(frame, name) for name in sensors)
        # a log of few digits repeats its readings: they would close better than they are known
        last_digits = [_resolution(values(frame, name), name, spec) for name in sensors]
        accel = gravity_positive(accel, spec.reference.convention)
        fits = fit_stations(
            *(station, position, accel, gyro, axis),
            ramp_time_s=values(frame, "time_s") if spec.stations.gyro_ramp else None,
            faults=faults,
        )
        before = NO_NOISE if calibrated_noise is None else calibrated_noise[axis]
        noises[axis], outliers = decide_noise(
            fits.squares, fits.dofs, before, last_digits, spec, axis
        )
        components[axis] = fits.components(noises[axis].widen(spec), outliers)
        status[axis] = tuple(
            text or reason for text, reason in zip(outliers, fits.status, strict=True)
        )
    # Means of the finite values of each station. Those of directions are about the first of them:
    # exactly it where all are equal.
    for name in ("toolface_deg", "azimuth_deg"):
        departure = attitude.wrapped(values(frame, name) - values(first, name)[station])
        mean[name] = first[name] + frame.assign(turn=departure).groupby("station")["turn"].mean()
    time = values(first, "time_s")
    return Stations(
        names=tuple(first["name"]),
        log=first["log"].to_numpy(),
        row_station=station,
        components=components,
        noise=noises,
        status=status,
        temperature=values(mean, TEMPERATURE),
        elapsed=(time - time[0]) / SECONDS_PER_HOUR
        if np.isfinite(time).all()
        else np.arange(float(count)),
        reference=mean[[*REFERENCE]].to_numpy(dtype=np.float64),
    )


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

    def components(self, noise: Noise, outliers: Sequence[str] = ()) -> Components:
        """Components of readings of a noise; NaN for stations [n] with an outlier."""
        u = np.array([noise.accel_g, noise.accel_g, noise.gyro_dph, noise.gyro_dph])
        values = self.coefficients[:, :, :2].reshape(-1, 4).copy()
        values[[k for k, text in enumerate(outliers) if text]] = np.nan
        accel_x, accel_y, gyro_x, gyro_y = values.T
        return Components(accel_x, accel_y, gyro_x, gyro_y, self.covariance * np.outer(u, u))


def fit_stations(
    station: Integers,
    position_deg: Array,
    accel: Array,
    gyro: Array,
    sensor: Sensor,
    *,
    ramp_time_s: Array | None = None,
    faults: Sequence[str] = (),
) -> StationFits:
    """Components of every station of one sensor pair, by least squares of x, y, b and ḃ.

        r_i = x cos p_i + y sin p_i + b + ḃ (t_i - t̄)      sensor on x
        r_i = y cos p_i - x sin p_i + b + ḃ (t_i - t̄)      sensor on y

    r reading in position p at time t; x, y the components of gravity or of the earth's rate, b
    bias of the sensor, ḃ its ramp.

    Parameters
    ----------
    station : [r], number of each row's station, from 0.
    position_deg : [r] rotations p about the tool axis [°], any, in any sequence.
    accel, gyro : [r] [g] and [°/h].
    sensor : which axis the pair is on.
    ramp_time_s : [r] [s], where a ramp of the gyro's bias is fitted at each station.
    faults : [n], why a station is not to be fitted, or empty.

    Returns
    -------
    StationFits; its components go where those of the four differences go. A station that cannot be
    fitted has its reason.

    Raises
    ------
    FitError
        No station can be fitted, though none is excluded by `faults`.

    """
    readings, elapsed = np.column_stack((accel, gyro)), np.zeros(station.size)
    if ramp_time_s is not None:
        elapsed = ramp_time_s - (np.bincount(station, ramp_time_s) / np.bincount(station))[station]
    sine, cosine = np.sin(np.radians(position_deg)), np.cos(np.radians(position_deg))
    # step A: at 90° the x sensor lies where y was, the y sensor where -x was
    of_x, of_y = (cosine, sine) if sensor == "x" else (-sine, cosine)
    all_columns = np.column_stack((of_x, of_y, np.ones(station.size), elapsed))
    count = len(COEFFICIENTS) - (ramp_time_s is None)
    stations = int(station.max()) + 1
    coefficients = np.full((stations, 2, len(COEFFICIENTS)), np.nan)
    covariance = np.full((stations, 4, 4), np.nan)
    squares, dofs = np.zeros((stations, 2)), np.zeros((stations, 2), dtype=np.int64)
    status = []
    for k in range(stations):
        rows = station == k
        design, reading = all_columns[rows], readings[rows]
        fault = faults[k] if faults else ""
        if not fault:
            unknown: Sequence[str] = ()
            if not np.isfinite(np.column_stack([reading, design[:, :2]])).all():
                fault = "an indication or a position is not finite"
            elif not np.isfinite(elapsed[rows]).all():
                fault = "a time is not finite"
            elif len(design) < count:
                fault = f"{len(design)} readings for {count} coefficients"
            else:
                unknown = undetermined(design[:, :count], COEFFICIENTS[:count])
            if unknown:
                fault = f"the positions cannot determine {', '.join(unknown)}"
        status.append(fault)
        if fault:
            continue
        coefficients[k], covariance[k] = 0.0, 0.0
        for j, width in enumerate((len(COEFFICIENTS) - 1, count)):  # the accelerometer has no ramp
            gain, pair = np.linalg.pinv(design[:, :width]), slice(2 * j, 2 * j + 2)
            coefficients[k, j, :width] = gain @ reading[:, j]
            covariance[k, pair, pair] = (gain @ gain.T)[:2, :2]
            dofs[k, j] = len(reading) - width
            if dofs[k, j]:  # without any, residuals are rounding errors
                left = reading[:, j] - design @ coefficients[k, j]
                squares[k, j] = left @ left
    if all(status) and not any(faults):
        raise FitError(f"none of {stations} stations can be fitted: {status[0]}")
    return StationFits(coefficients, covariance, tuple(status), squares, dofs)


def decide_noise(
    squares: Array,
    dofs: Integers,
    before: Noise,
    last_digit: Sequence[float],
    spec: InclinometerRecipe,
    axis: Sensor,
) -> tuple[Noise, tuple[str, ...]]:
    """Noise of one reading of accelerometer and gyro, and for each station [n] the reason why it is
    refused, or an empty string.

    `squares` and `dofs` [n, 2] are the sums of squares by which stations fail to close, of
    accelerometer and gyro, and their degrees of freedom. A station that fails by far more than the
    others holds an outlier, and its noise is not that of the others. The noise is that which the
    recipe states, otherwise the one of the stations that close, pooled with a calibration's
    `before`; never below the last digit's. Raises FitError where it is unknown.
    """
    stated_sizes = spec.stations.accel_noise_g, spec.stations.gyro_noise_dph
    calibrated = before.accel_g, before.gyro_dph
    # standard deviation of a rectangular distribution one digit wide
    of_digit = [digit / float(np.sqrt(12.0)) for digit in last_digit]
    reasons = [""] * len(squares)
    for k, (kind, _, unit_mark) in enumerate(SENSORS):
        square, dof, stated_size = squares[:, k], dofs[:, k], stated_sizes[k]
        least_size = max(of_digit[k], calibrated[k], 0.0 if stated_size == "auto" else stated_size)
        variance = max(usual_square(square, dof), least_size**2)
        for row in np.flatnonzero(find_outliers(square, dof, variance)).tolist():
            size = float(np.sqrt(square[row] / dof[row]))
            times = f"{size / np.sqrt(variance):.0f} times the noise of the others"
            outlier = f"an outlier: the {kind} does not close by {size:.2g} {unit_mark}, {times}"
            reasons[row] = reasons[row] or outlier
    closing = np.array([not reason for reason in reasons])
    # the gyro's for both: it has fewer, where its drift within a station is fitted
    shown_dof = int(dofs[closing, 1].sum())
    sizes = []
    for k, (kind, suffix, _) in enumerate(SENSORS):
        stated_size = stated_sizes[k]
        if stated_size != "auto":
            sizes.append(stated_size)
            continue
        if shown_dof + before.dof == 0:
            raise FitError(
                f"{kind}_{axis}_{suffix}: no station tells the noise of a reading",
                hint=f"give stations.{kind}_noise_{suffix} in the recipe, or stations with more"
                " positions",
            )
        # variances of a reading
        of_readings = float(squares[closing, k].sum() / max(dofs[closing, k].sum(), 1))
        of_calibration = calibrated[k] ** 2
        weighted = shown_dof * of_readings + before.dof * of_calibration
        pooled = weighted / (shown_dof + before.dof)
        if shown_dof and before.dof and of_calibration > 0.0:
            from scipy.special import fdtr, fdtrc

            ratio = of_readings / of_calibration
            # another noise than in the calibration, larger or smaller, is that of this log
            tails = fdtr(shown_dof, before.dof, ratio), fdtrc(shown_dof, before.dof, ratio)
            pooled = of_readings if min(tails) < CONTRADICTED else pooled
        sizes.append(max(float(np.sqrt(pooled)), of_digit[k]))
    return Noise(sizes[0], sizes[1], shown_dof + before.dof), tuple(reasons)


def usual_square(squares: Array, dof: Integers) -> float:
    """Variance of one reading from the median of sums of squares [n] with degrees of freedom [n];
    robust against one outlier.

    The median is divided by that of χ²/ν at the median degrees of freedom, which is not 1; NaN
    where no station has any.
    """
    redundant = dof > 0
    if not redundant.any():
        return float("nan")
    from scipy.special import gammaincinv

    median_dof = float(np.median(dof[redundant]))
    median = 2.0 * float(gammaincinv(median_dof / 2.0, 0.5)) / median_dof
    return float(np.median(squares[redundant] / dof[redundant])) / median


def find_outliers(squares: Array, dof: Integers, variance: float) -> Mask:
    """Mask [n] of stations with an outlier: their sums of squares are far above those of the
    variance of a reading.
    """
    redundant = dof > 0
    if int(redundant.sum()) < FEWEST_CLOSING:
        return np.zeros(squares.size, dtype=np.bool_)
    from scipy.special import chdtri

    # an outlier closes worse than noise does at any station of any log
    limit = variance * chdtri(np.maximum(dof, 1), IMPROBABLE)
    return np.asarray(redundant & (squares > limit), dtype=np.bool_)


def _resolution(data: Array, column: str, spec: InclinometerRecipe) -> float:
    """Size of the last digit [unit of the column] with which a log's values are written."""
    finite = data[np.isfinite(data)]
    step = 1.0
    if column in spec.columns:
        ends = unmap_values(np.array([0.0, 1.0]), spec.columns[column], column, spec)
        step, finite = (
            1.0 / abs(float(ends[1] - ends[0])),
            unmap_values(finite, spec.columns[column], column, spec),
        )
    last = [int(Decimal(f"{value:.12g}").as_tuple().exponent) for value in finite.tolist()]
    return step * 10.0 ** min(last, default=-12)

"""Logs of a four-position inclinometer → stations: components across the tool, their noise, and why
a station is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit import check
from calibkit.arrays import Array, Integers, Mask
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.frame import Examined, Finding, Log, refuse, values
from calibkit.instruments.inclinometer import (
    dwells as inclinometer_dwells,
    noise as inclinometer_noise,
    published,
)
from calibkit.instruments.inclinometer.dwells import DwellLog
from calibkit.instruments.inclinometer.forms import TEMPERATURE
from calibkit.instruments.inclinometer.noise import Noise
from calibkit.instruments.inclinometer.numeric import sinusoid_fit
from calibkit.instruments.inclinometer.published import Components, Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.instruments.inclinometer.rows import REFERENCE, SENSORS, Rows
from calibkit.numeric import attitude, chunks

PLAUSIBLE = {"accel": (1.5, "g"), "gyro": (1000.0, "deg/h")}
"""Largest indication of a tool at rest, bias included; a larger one shows a wrong unit."""


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


def needed_columns(spec: InclinometerRecipe) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Columns that the recipe needs, and optional columns that it uses where a log has them."""
    wanted = [
        "position_deg",
        *(f"accel_{axis}_g" for axis in spec.axes),
        *(f"gyro_{axis}_dph" for axis in spec.axes),
    ]
    if spec.stations.gyro_ramp:
        wanted.append("time_s")
    if spec.root.choice == "heading":
        wanted.append("azimuth_deg")
    return tuple(wanted), tuple(
        name for name in ("station", "time_s", TEMPERATURE, *REFERENCE) if name not in wanted
    )


def examine(spec: InclinometerRecipe, log: Log) -> Examined:
    """Findings of a log, and its stations: consecutive rows with the same station number, or
    dwells.
    """
    dwelt, found = _examine_dwells(log, spec)
    return Examined(tuple(found), () if dwelt is None else dwelt.held())


def admit_logs(logs: Sequence[Log], spec: InclinometerRecipe) -> tuple[list[Log], list[Finding]]:
    """Logs reduced to one row per position, and the findings of all logs; raises FrameError listing
    all refused findings.
    """
    looked = [_examine_dwells(log, spec) for log in logs]
    found = [finding for _, findings in looked for finding in findings]
    refuse(found)
    return [dwelt.log for dwelt, _ in looked if dwelt is not None], found


def _examine_dwells(log: Log, spec: InclinometerRecipe) -> tuple[DwellLog | None, list[Finding]]:
    """Dwells of a log, None where the log is refused as a whole, and all findings on the log and
    its stations.
    """
    columns = [name for name in log.frame.columns if name not in REFERENCE]
    found = [*check.find_too_few_rows(log, 3), *check.find_missing_values(log, columns)]
    if any(finding.refused for finding in found):
        return None, found
    found += find_unusable(log, spec)
    if any(finding.refused for finding in found):
        return None, found
    dwelt = inclinometer_dwells.find_dwells(log, spec)
    found += dwelt.findings
    if spec.stations.method == "four_differences":
        found += _find_position_faults(dwelt.log)
    if not any(finding.refused for finding in found):
        gyros = [f"gyro_{axis}_dph" for axis in spec.axes]
        found += [
            finding for gyro in gyros for finding in check.magnitude.check_gyro_unit(log, gyro)
        ]
        found += check.magnitude.find_compensated_names(log, spec, gyros)
        if TEMPERATURE in log.frame.columns:
            found += check.thermometers.check_stations(dwelt.log, "station", TEMPERATURE)
    return dwelt, found


def find_unusable(log: Log, spec: InclinometerRecipe) -> list[Finding]:
    """Faults for which a log is refused as a whole."""
    timed = "time_s" in log.frame.columns
    found = check.find_missing_values(
        log, [name for name in ("station", "time_s") if name in log.frame.columns]
    )
    if timed:
        found += check.find_unordered_times(log)
    if TEMPERATURE in log.frame.columns:
        found += check.find_implausible_temperatures(log, [TEMPERATURE])
    for axis in spec.axes:
        for kind, suffix in SENSORS:
            column, (limit, unit) = f"{kind}_{axis}_{suffix}", PLAUSIBLE[kind]
            data = values(log.frame, column)

            def beyond(part: Array, limit: float = limit) -> Mask:
                return np.asarray(np.abs(part) > limit, dtype=np.bool_)

            bad = chunks.rows_where(data, beyond)
            if bad.size:
                what = f"{data[bad[0]]:g} {unit} ({bad.size} such row{'s' if bad.size > 1 else ''})"
                expected = f"at most {limit:g} {unit} of a tool at rest"
                advice = f"state the log's unit in [columns.{column}]"
                row = int(bad[0])
                found.append(
                    check.finding_at_row(log, row, column, what, expected, advice, "range")
                )
    return found


def _find_position_faults(log: Log) -> list[Finding]:
    """Findings on stations with a repeated or missing position, or none of the nominal four."""
    station, position = values(log.frame, "station"), values(log.frame, "position_deg")
    names, first = np.unique(station, return_index=True)
    found = []
    for name in names[np.argsort(first)]:
        rows = np.flatnonzero(station == name)
        fault = _position_fault(position[rows])
        if fault is not None:
            at, what = fault
            line = log.line(int(rows[at]))
            found.append(
                Finding(
                    f"{log.file}:{line}: station {name:g}",
                    what,
                    "one row at each of 0°, 90°, 180°, 270°",
                    "repair or remove the station, or set stations.method = 'least_squares'",
                    name="positions",
                    line=line,
                )
            )
    return found


def _position_fault(position: Array) -> tuple[int, str] | None:
    """Row and description of the first fault that prevents the four differences at positions [r]
    [°] of one station; None without a fault.
    """
    if not np.isfinite(position).all():
        return int(np.flatnonzero(~np.isfinite(position))[0]), "a position is missing"
    quarter = published.nearest_position(position)
    apart = np.abs(attitude.wrapped(position - 90.0 * quarter))
    off = np.flatnonzero(apart > published.POSITION_TOLERANCE_DEG)
    if off.size:
        return int(off[0]), f"position {position[off[0]]:g}° is no multiple of 90°"
    for k, nominal in enumerate(published.POSITIONS_DEG):
        if (rows := np.flatnonzero(quarter == k)).size > 1:
            return int(rows[1]), f"position {nominal:g}° stands {rows.size} times"
    missing = [f"{p:g}°" for k, p in enumerate(published.POSITIONS_DEG) if k not in quarter]
    return (position.size - 1, f"no row at position {', '.join(missing)}") if missing else None


def solve_components(
    rows: Rows, spec: InclinometerRecipe, known: Mapping[Sensor, Noise] | None = None
) -> Stations:
    """Components of every station (step B), with the noise stated by the recipe or estimated from
    the readings.

    `known` is the noise of a calibration: it is pooled with the readings' own unless they
    contradict it. Raises FitError where the noise is unknown.
    """
    count = len(rows.names)
    components, noises, status = {}, {}, {}
    for axis in spec.axes:
        if spec.stations.method == "four_differences":
            parts, squares, dofs, own = _by_differences(rows, axis)
        else:
            fits = sinusoid_fit.fit_stations(
                rows.station,
                rows.position,
                rows.accel[axis],
                rows.gyro[axis],
                axis,
                time_s=rows.time if spec.stations.gyro_ramp else None,
                gyro_ramp=spec.stations.gyro_ramp,
            )
            parts, squares, dofs, own = fits.components, fits.squares, fits.dofs, fits.status
        before = inclinometer_noise.NO_NOISE if known is None else known[axis]
        last_digit = rows.resolution[axis]
        least = inclinometer_noise.least_noise(before, last_digit, spec)
        shown, outliers = inclinometer_noise.judge_closures(squares, dofs, least)
        noises[axis] = shown.decide(before, last_digit, spec, axis)
        components[axis] = _with_noise(parts, noises[axis].widen(spec), outliers)
        status[axis] = tuple(text or reason for text, reason in zip(outliers, own, strict=True))
    inclination, toolface, azimuth = rows.reference.T
    reference = (
        _mean_by_station(inclination, rows.station, count),
        _mean_direction_by_station(toolface, rows.station, count),
        _mean_direction_by_station(azimuth, rows.station, count),
    )
    time = rows.time[np.unique(rows.station, return_index=True)[1]]
    timed = bool(np.isfinite(time).all())
    return Stations(
        names=rows.names,
        log=rows.log,
        row_station=rows.station,
        components=components,
        noise=noises,
        status=status,
        temperature=_mean_by_station(rows.temperature, rows.station, count),
        elapsed=(time - time[0]) / SECONDS_PER_HOUR if timed else np.arange(float(count)),
        reference=np.column_stack(reference),
    )


def _by_differences(
    rows: Rows, axis: Sensor
) -> tuple[Components, Array, Integers, tuple[str, ...]]:
    """Components by the four differences for readings of unit noise; squares and degrees of freedom
    [n, 2] of the closures r₀ − r₉₀ + r₁₈₀ − r₂₇₀; and why each station is refused.
    """
    placed = np.where(np.isfinite(rows.position), rows.position, 0.0)
    readings = np.column_stack((rows.accel[axis], rows.gyro[axis]))
    _, four = published.arrange(rows.station, placed, readings)
    finite = [bool(np.isfinite(station).all()) for station in four]
    faults = [_position_fault(rows.position[rows.station == k]) for k in range(len(rows.names))]
    status = tuple(
        fault[1] if fault else "" if known else "an indication is not finite"
        for fault, known in zip(faults, finite, strict=True)
    )
    solved = np.array([not reason for reason in status])
    accel, gyro = np.moveaxis(np.where(solved[:, None, None], four, np.nan), -1, 0)
    parts = published.components(accel, gyro, axis, accel_noise_g=1.0, gyro_noise_dph=1.0)
    closures = np.column_stack([published.closures(accel), published.closures(gyro)])
    known = np.isfinite(closures)
    return parts, np.where(known, closures, 0.0) ** 2, known.astype(np.int64), status


def _with_noise(parts: Components, noise: Noise, outliers: Sequence[str]) -> Components:
    """Scale the covariance of components of unit noise to a noise; NaN for stations [n] with an
    outlier.
    """
    u = np.array([noise.accel_g, noise.accel_g, noise.gyro_dph, noise.gyro_dph])
    gone = np.array([bool(text) for text in outliers])
    accel_x, accel_y, gyro_x, gyro_y = (
        np.where(gone, np.nan, column)
        for column in (parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y)
    )
    return Components(accel_x, accel_y, gyro_x, gyro_y, parts.covariance * np.outer(u, u))


def _mean_by_station(column: Array, station: Integers, count: int) -> Array:
    """Mean [count] of the finite values of each station; NaN where there is none."""
    finite = np.isfinite(column)
    rows = np.bincount(station[finite], minlength=count)
    total = np.bincount(station[finite], column[finite], minlength=count)
    return np.where(rows > 0, total / np.maximum(rows, 1), np.nan)


def _mean_direction_by_station(column: Array, station: Integers, count: int) -> Array:
    """Circular mean direction [count] [°] of each station; a station with equal values keeps them
    exactly.
    """
    first = np.full(count, np.nan)
    finite = np.isfinite(column)
    first[station[finite][::-1]] = column[finite][::-1]
    # mean departure from the first value: exactly zero where all values are equal
    return first + _mean_by_station(attitude.wrapped(column - first[station]), station, count)

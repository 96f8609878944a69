"""Continuous logs of an inclinometer → one row per dwell: the mean of the readings while the tool
stood in a position.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from calibkit.errors import FrameError
from calibkit.instruments.inclinometer import published
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric import attitude
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.dwells import average_dwells
from calibkit.records.frame import Finding, Held, Log, require, values

FEWEST = 3
"""Fewest rows of a dwell: the standard error of its mean is estimated from them."""
DIRECTIONS = ("position_deg", "toolface_deg", "azimuth_deg")
"""Columns of angles that wrap at 360° and are averaged on the circle."""
CLOSURE = {"accel": 0.01, "gyro": 1.0}
"""Closure [g], [°/h] of the four positions of a station that a drifting bias and position errors of
a tool may cause.
"""
CERTAIN = 10.0
"""Closure, in standard errors, from which it is attributed to a moved tool and not to noise."""


@dataclass(frozen=True, slots=True)
class DwellLog:
    """A log with one row per position; row k stands for rows start[k] … stop[k] − 1 of the log as
    it was read.
    """

    log: Log
    start: Integers
    stop: Integers
    findings: tuple[Finding, ...] = ()
    continuous: bool = False

    def along(self, of_row: Array, log: Log, *, standing: bool = False) -> Array:
        """Expand a value of each dwell to the rows [n] of the log as it was read; a row between two
        dwells takes the value of the earlier one, or NaN with `standing`.
        """
        rows = np.arange(len(log.frame))
        dwell = np.searchsorted(self.start, rows, side="right") - 1
        of_log_rows = of_row[np.maximum(dwell, 0)]
        if standing:
            of_log_rows[(dwell < 0) | (rows >= self.stop[dwell])] = np.nan
        return of_log_rows

    def held(self) -> tuple[Held, ...]:
        """Row ranges, in the log as it was read, of the stations and, for a continuous log, of the
        dwells.
        """
        station = values(self.log.frame, "station")
        bounds = [0, *(np.flatnonzero(np.diff(station)) + 1).tolist(), station.size]
        conditions = [
            Held("station", int(self.start[a]), int(self.stop[b - 1]), float(b - a), "positions")
            for a, b in pairwise(bounds)
        ]
        if self.continuous:
            position = values(self.log.frame, "position_deg")
            rows = zip(self.start.tolist(), self.stop.tolist(), position.tolist(), strict=True)
            conditions += [Held("dwell", a, b, p, "deg") for a, b, p in rows]
        return tuple(conditions)


def find_dwells(log: Log, spec: InclinometerRecipe) -> DwellLog:
    """Reduce a log to one row per position: a log with several rows in a position is averaged over
    each dwell, any other log is returned unchanged.

    A dwell is a run of rows whose position_deg (and station, where there is one) stays the same to
    0.2°, of at least stations.dwell_s, less stations.settle_s at both ends. Without a column
    `station`, dwells that follow each other in four different positions are one. Raises FrameError
    where the stations follow neither from a column nor from the dwells.
    """
    import pandas as pd

    # Runs of rows with the same position and station: positions of one cell, twice the tolerance
    # wide, or none.
    frame, width = log.frame, 2.0 * published.POSITION_TOLERANCE_DEG
    position = values(frame, "position_deg")
    cell = np.remainder(np.round(np.remainder(position, 360.0) / width), 360.0 / width)
    changes = np.diff(np.nan_to_num(cell, nan=-1.0)) != 0.0
    if "station" in frame.columns:
        changes |= np.diff(values(frame, "station")) != 0.0
    bounds = np.concatenate([[0], np.flatnonzero(changes) + 1, [position.size]])
    start, stop = bounds[:-1], bounds[1:]
    standing = (stop - start)[stop - start >= FEWEST].sum()
    if "time_s" not in frame.columns or 2 * standing <= len(frame):
        require(log.file, frame.columns, ("station",))
        rows = np.arange(len(frame))
        return DwellLog(log, rows, rows + 1)
    if "station" not in frame.columns and spec.stations.method != "four_differences":
        # such a station may have any number of positions, so the start of the next one is unknown
        require(log.file, frame.columns, ("station",))

    # Runs in a position that last long enough, without the settling time at both ends.
    positioned = np.isfinite(position[start])
    start, stop = start[positioned], stop[positioned]
    time, settle_s, stands = values(frame, "time_s"), spec.stations.settle_s, []
    lasting = time[stop - 1] - time[start] >= spec.stations.dwell_s
    for a, b in zip(start[lasting].tolist(), stop[lasting].tolist(), strict=True):
        of_run = time[a:b]
        first_row = a + int(np.searchsorted(of_run, of_run[0] + settle_s, side="left"))
        last_row = a + int(np.searchsorted(of_run, of_run[-1] - settle_s, side="right"))
        if last_row - first_row >= FEWEST:
            stands.append((first_row, last_row))
    if not stands:
        raise FrameError(
            f"{log.file}: the tool stands in no position for {spec.stations.dwell_s:g} s",
            hint="state stations.dwell_s and stations.settle_s as the log was taken",
        )
    intervals = np.array(stands, dtype=np.int64)
    start, stop = intervals.T

    # The mean of every column over each dwell, and its standard error; of directions by departures
    # from the dwell's first row, wrapped: 359.98° and 0.01° are neighbours.
    names = [name for name in frame.columns if pd.api.types.is_numeric_dtype(frame[name])]
    columns = frame[names].to_numpy(dtype=np.float64)
    turning = [names.index(name) for name in DIRECTIONS if name in names]
    first = start[np.maximum(np.searchsorted(start, np.arange(len(frame)), side="right") - 1, 0)]
    turns = columns[np.ix_(first, turning)]
    columns[:, turning] = turns + attitude.wrapped(columns[:, turning] - turns)
    means, errors = average_dwells(columns, intervals)
    dwells = pd.DataFrame(means, columns=names, index=frame.index[start])
    if "station" in names:
        return DwellLog(replace(log, frame=dwells), start, stop, (), continuous=True)

    # Stations, from 1: a new one begins where a position repeats or after four positions.
    station, quarters = 1, set[int]()
    numbers = []
    for position_deg in values(dwells, "position_deg").tolist():
        quarter = round(position_deg / 90.0) % 4
        if quarter in quarters or len(quarters) == len(published.POSITIONS_DEG):
            station, quarters = station + 1, set()
        quarters.add(quarter)
        numbers.append(float(station))
    reduced = replace(log, frame=dwells.assign(station=numbers))
    open_stations = _find_open_stations(reduced, dict(zip(names, errors.T, strict=True)), spec)
    return DwellLog(reduced, start, stop, tuple(open_stations), continuous=True)


def _find_open_stations(
    log: Log, errors: Mapping[str, Array], spec: InclinometerRecipe
) -> list[Finding]:
    """Findings on stations, identified by their positions alone, whose four readings do not close:
    the tool was moved between them.

    r₀ − r₉₀ + r₁₈₀ − r₂₇₀ of one attitude holds neither signal nor bias; `errors` are the standard
    errors of the readings by column.
    """
    station, position = values(log.frame, "station"), values(log.frame, "position_deg")
    stations = station.astype(np.int64) - 1
    complete = np.bincount(stations) == len(published.POSITIONS_DEG)
    sign = 1.0 - 2.0 * (published.nearest_position(position) % 2)
    findings = []
    for axis, (kind, word, unit) in product(spec.axes, published.SENSORS):
        name = f"{kind}_{axis}_{word}"
        closure = np.bincount(stations, sign * values(log.frame, name))
        u = np.sqrt(np.bincount(stations, errors[name] ** 2))
        limit = np.maximum(CLOSURE[kind], CERTAIN * u)
        for number in np.flatnonzero(complete & (np.abs(closure) > limit)).tolist():
            rows = np.flatnonzero(stations == number)
            row = int(rows[0])
            # finding closure: the four readings of a station do not close: the tool was moved
            findings.append(
                Finding(
                    f"{log.place(row)}: station {number + 1}: {name}",
                    f"r₀ − r₉₀ + r₁₈₀ − r₂₇₀ = {closure[number]:.3g} {unit}",
                    f"at most {CLOSURE[kind]:g} {unit} of one attitude",
                    "the tool was moved between these dwells: give a column station, or leave"
                    f" these out: {log.advise_exclude(rows)}",
                    name="closure",
                    line=log.line(row),
                )
            )
    return findings

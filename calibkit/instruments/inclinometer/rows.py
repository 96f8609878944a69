"""Logs of one row per position → the rows of all logs, numbered by station."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import SECONDS_PER_HOUR
from calibkit.frame import Log, values
from calibkit.ingest.column_values import unmap_values
from calibkit.instruments.inclinometer.forms import TEMPERATURE
from calibkit.instruments.inclinometer.published import Sensor
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric.attitude import gravity_positive

REFERENCE = ("inclination_deg", "toolface_deg", "azimuth_deg")
SENSORS = (("accel", "g"), ("gyro", "dph"))
"""Sensors of a pair, and the last words of their columns."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of all logs: station index [r] of each row, counted from 0 over all logs, and its
    readings.

    `accel` [g, positive along gravity] and `gyro` [°/h] are by axis; `resolution` is the last digit
    of (accel, gyro).
    """

    station: Integers
    names: tuple[str, ...]
    log: Integers
    """[n], number of the log of each station."""
    position: Array
    accel: Mapping[Sensor, Array]
    gyro: Mapping[Sensor, Array]
    resolution: Mapping[Sensor, tuple[float, float]]
    time: Array
    temperature: Array
    reference: Array
    """[r, 3] of inclination, toolface, azimuth [°]; NaN where a log has none."""

    @classmethod
    def gather(cls, logs: Sequence[Log], spec: InclinometerRecipe) -> Self:
        """Rows of all logs, their stations counted from 0 in the order in which they appear."""
        import pandas as pd

        station: list[Integers] = []
        names: list[str] = []
        numbers: list[int] = []
        for number, log in enumerate(logs):
            places, own = pd.factorize(values(log.frame, "station"))
            station.append(places + len(names))
            numbers += [number] * own.size
            prefix = f"{log.name}:" if len(logs) > 1 else ""
            names += [f"{prefix}{name:g}" for name in own.tolist()]
        columns = [f"{kind}_{axis}_{unit}" for kind, unit in SENSORS for axis in spec.axes]
        columns += ["position_deg", TEMPERATURE, *REFERENCE]
        # NaN for the rows of a log without a column
        frame = pd.concat([log.frame for log in logs], ignore_index=True).reindex(columns=columns)
        accel = {axis: values(frame, f"accel_{axis}_g") for axis in spec.axes}
        gyro = {axis: values(frame, f"gyro_{axis}_dph") for axis in spec.axes}
        convention = spec.reference.convention
        return cls(
            station=np.concatenate(station),
            names=tuple(names),
            log=np.array(numbers),
            position=values(frame, "position_deg"),
            accel={axis: gravity_positive(column, convention) for axis, column in accel.items()},
            gyro=gyro,
            resolution={
                axis: (
                    _resolution(accel[axis], f"accel_{axis}_g", spec),
                    _resolution(gyro[axis], f"gyro_{axis}_dph", spec),
                )
                for axis in spec.axes
            },
            time=_join_times(logs),
            temperature=values(frame, TEMPERATURE),
            reference=frame[[*REFERENCE]].to_numpy(dtype=np.float64),
        )


def _join_times(logs: Sequence[Log]) -> Array:
    """Times [r] [s] of all logs, each log starting one hour after the end of the previous one; NaN
    where any log has no times.
    """
    parts, start = [], 0.0
    for log in logs:
        if "time_s" not in log.frame.columns:
            return np.full(sum(len(entry.frame) for entry in logs), np.nan)
        time = values(log.frame, "time_s")
        parts.append(time - time[0] + start)
        start = float(parts[-1][-1]) + SECONDS_PER_HOUR
    return np.concatenate(parts)


def _resolution(data: Array, column: str, spec: InclinometerRecipe) -> float:
    """Size of the last digit [unit of the column] with which a log's values are written."""
    known = data[np.isfinite(data)]
    step = 1.0
    if column in spec.columns:
        ends = unmap_values(np.array([0.0, 1.0]), spec.columns[column], column, spec)
        step, known = (
            1.0 / abs(float(ends[1] - ends[0])),
            unmap_values(known, spec.columns[column], column, spec),
        )
    last = [int(Decimal(f"{value:.12g}").as_tuple().exponent) for value in known.tolist()]
    return step * 10.0 ** min(last, default=-12)

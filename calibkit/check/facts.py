"""What a log holds, as numbers: rows, duration, sampling, span and resolution of every column,
temperature occupancy.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit import units
from calibkit.numeric import anomalies
from calibkit.numeric.arrays import Array
from calibkit.records.frame import GAP, Log, values

BIN_DEGC = 10.0
"""Width of a temperature bin of the occupancy."""


@dataclass(frozen=True, slots=True)
class _ColumnFacts:
    """One column: unit, smallest and largest value, resolution, standard deviation of its noise,
    missing values.
    """

    name: str
    unit: str
    low: float
    high: float
    resolution: float
    noise: float
    missing: int


@dataclass(frozen=True, slots=True)
class _Occupancy:
    """Share of a log's rows that lie in a bin of a temperature [°C], low ≤ T < high."""

    low: float
    high: float
    share: float


@dataclass(frozen=True, slots=True)
class Facts:
    """One log: rows, duration [s], rows a second, relative spread of the sampling interval, gaps,
    columns, occupancy.
    """

    rows: int
    duration_s: float
    rate_hz: float
    irregularity: float
    gaps: int
    columns: tuple[_ColumnFacts, ...]
    occupancy: tuple[_Occupancy, ...]

    @classmethod
    def describe(cls, log: Log) -> Self:
        """Facts of a log that was read."""
        frame = log.frame
        names = [name for name in frame.columns if name not in ("run", "time_s")]
        columns = tuple(_describe_column(name, values(frame, name)) for name in names)
        temperature = next((name for name in names if name.endswith("_degc")), "")
        occupancy = _count_occupancy(values(frame, temperature)) if temperature else ()
        if "time_s" not in frame.columns or len(frame) < 2:
            return cls(len(frame), 0.0, 0.0, 0.0, 0, columns, occupancy)
        time = values(frame, "time_s")
        step = np.diff(time)
        usual = float(np.median(step))
        ordinary = step[np.abs(step) < GAP * abs(usual)] if usual else step
        return cls(
            len(frame),
            duration_s=float(time[-1] - time[0]),
            rate_hz=1.0 / usual if usual > 0.0 else 0.0,
            irregularity=float(np.std(ordinary) / usual) if usual and ordinary.size else 0.0,
            gaps=int(np.sum(step > GAP * usual)) if usual > 0.0 else 0,
            columns=columns,
            occupancy=occupancy,
        )


def _describe_column(name: str, data: Array) -> _ColumnFacts:
    """Facts of a column."""
    finite = np.isfinite(data)
    good = data if finite.all() else data[finite]
    unit = units.column_unit(name)
    if not good.size:
        return _ColumnFacts(name, unit, 0.0, 0.0, 0.0, 0.0, data.size)
    return _ColumnFacts(
        name,
        unit,
        low=float(good.min()),
        high=float(good.max()),
        resolution=anomalies.resolution(good),
        noise=anomalies.scatter(good),
        missing=int(data.size - good.size),
    )


def _count_occupancy(temperature: Array) -> tuple[_Occupancy, ...]:
    """Occupancy of a temperature [n, °C] in bins of ten degrees, from the coldest to the
    hottest.
    """
    good = temperature[np.isfinite(temperature)]
    if not good.size:
        return ()
    first = int(np.floor(good.min() / BIN_DEGC))
    number = np.floor(good / BIN_DEGC).astype(np.int64) - first
    if number.max() > 1000:
        return ()
    share = np.bincount(number) / good.size
    return tuple(
        _Occupancy((first + k) * BIN_DEGC, (first + k + 1) * BIN_DEGC, float(part))
        for k, part in enumerate(share)
    )

"""Names for the columns of a log that has none, guessed from their numbers."""

from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array

_G_MPS2 = 9.80665
_COLDEST_DEGC, _HOTTEST_DEGC = -100.0, 200.0
_SMOOTH = 0.05
"""Largest median step of a temperature over its span."""
_ROOM_DEGC = (5.0, 60.0)
"""Temperatures at which a constant column is taken for one."""


def name_columns(columns: Sequence[Array | None]) -> list[str]:
    """Name of each column [n], None for one of texts: the time, a triad of accelerometers, then
    temperatures, then gyros; `column 3` of one that is like nothing known.
    """
    names = [f"column {k + 1}" for k in range(len(columns))]
    left = [k for k, column in enumerate(columns) if column is not None and column.size > 1]
    timed = next((k for k in left if _runs(columns[k])), None)
    if timed is not None:
        names[timed] = "time_s"
        left.remove(timed)
    for first in left:
        unit = _find_triad([columns[k] for k in range(first, min(first + 3, len(columns)))])
        if unit and {first, first + 1, first + 2} <= set(left):
            for k, axis in enumerate("xyz", start=first):
                names[k] = f"accel_{axis}_g" if unit == "g" else f"accel {axis} [{unit}]"
                left.remove(k)
            break
    warm = [k for k in left if _is_temperature(columns[k])]
    for k, name in zip(warm, ("temp_case_degc", "temp_env_degc"), strict=False):
        names[k] = name
    rates = [k for k in left if k not in warm and _varies(columns[k])]
    for number, k in enumerate(rates[:3]):
        names[k] = "gyro_dph" if len(rates) == 1 else f"gyro_{'xyz'[number]}_dph"
    return names


def _runs(column: Array | None) -> bool:
    """Whether a column rises in every row, nearly evenly."""
    if column is None or not np.all(np.isfinite(column)):
        return False
    step = np.diff(column)
    return bool(np.all(step > 0.0) and np.median(np.abs(step - np.median(step))) < np.median(step))


def _find_triad(axes: Sequence[Array | None]) -> str:
    """Unit of three columns whose length is that of gravity in most rows, or ""."""
    there = [axis for axis in axes if axis is not None]
    if len(there) < 3:
        return ""
    length = float(np.nanmedian(np.sqrt(np.sum(np.square(there), axis=0))))
    for unit, g in (("g", 1.0), ("m/s^2", _G_MPS2)):
        if 0.9 < length / g < 1.1:
            return unit
    return ""


def _varies(column: Array | None) -> bool:
    """Whether a column has more than two values."""
    return column is not None and np.unique(column[np.isfinite(column)]).size > 2


def _is_temperature(column: Array | None) -> bool:
    """Whether a column changes slowly within what a chamber reaches."""
    if column is None or not np.all(np.isfinite(column)):
        return False
    low, high = float(column.min()), float(column.max())
    if low < _COLDEST_DEGC or high > _HOTTEST_DEGC or high == low:
        return False
    slow = float(np.median(np.abs(np.diff(column)))) < _SMOOTH * (high - low)
    still = high - low < 2.0 and _ROOM_DEGC[0] < low < _ROOM_DEGC[1]
    return slow and (high - low > 5.0 or still)

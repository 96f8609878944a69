"""Names for the columns of a log that has none, guessed from their numbers."""

from collections.abc import Sequence

import numpy as np

from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import STANDARD_GRAVITY_MPS2

_COLDEST_DEGC, _HOTTEST_DEGC = -100.0, 200.0
_SMOOTH = 0.05
"""Largest median step of a temperature over its span."""
_LEAST_TURNED = 6
"""Fewest attitudes of a triad that was turned."""
_ROUND = 0.05
"""Largest usual departure of a triad's length from its median, relative."""
_LEAST_RATES, _MOST_RATES = 4, 500
_IN_PROPORTION = 0.99999
"""Least correlation of the rates of a table and what a gyro indicates."""
_ROOM_DEGC = (5.0, 60.0)
"""Temperatures at which a constant column is taken for one."""


def name_columns(columns: Sequence[Array | None], *, timed: bool = False) -> list[str]:
    """Name of each column [n], None for one of texts: the time, a triad of accelerometers, then
    temperatures, then gyros; `column 3` of one that is like nothing known. None is a time where
    the log is `timed` by stamps.
    """
    names = [f"column {k + 1}" for k in range(len(columns))]
    if (swept := _find_sweep(columns)) is not None:
        names[swept[0]], names[swept[1]] = "table_rate_dps", "gyro_x_lsb"
        return names
    unnamed = [k for k, column in enumerate(columns) if column is not None and column.size > 1]
    clock = None if timed else next((k for k in unnamed if _runs(columns[k])), None)
    if clock is not None:
        names[clock] = "time_s"
        unnamed.remove(clock)
    for first in unnamed:
        unit = _find_triad([columns[k] for k in range(first, min(first + 3, len(columns)))])
        if unit and {first, first + 1, first + 2} <= set(unnamed):
            for k, axis in enumerate("xyz", start=first):
                names[k] = f"accel_{axis}_g" if unit == "g" else f"accel {axis} [{unit}]"
                names[k] = f"accel_{axis}_lsb" if unit == "1" else names[k]
                unnamed.remove(k)
            break
    warm = [k for k in unnamed if _is_temperature(columns[k])][:2]
    for k, name in zip(warm, ("temp_case_degc", "temp_env_degc"), strict=False):
        names[k] = name
    rates = [k for k in unnamed if k not in warm and _varies(columns[k])]
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
    present = [axis for axis in axes if axis is not None]
    if len(present) < 3:
        return ""
    length = float(np.nanmedian(np.sqrt(np.sum(np.square(present), axis=0))))
    for unit, g in (("g", 1.0), ("m/s^2", STANDARD_GRAVITY_MPS2)):
        if 0.9 < length / g < 1.1:
            return unit
    return "1" if _on_sphere(np.column_stack(present)) else ""


def find_sphere(vectors: Array) -> Array:
    """Centre and radius, [4], of the sphere that vectors [n, 3] end on, by least squares."""
    finite = vectors[np.all(np.isfinite(vectors), axis=1)]
    design = np.column_stack([2.0 * finite, np.ones(len(finite))])
    solution = np.linalg.lstsq(design, np.sum(finite**2, axis=1), rcond=None)[0]
    radius = np.median(np.linalg.norm(finite - solution[:3], axis=1))
    return np.append(solution[:3], radius)


def _on_sphere(vectors: Array) -> bool:
    """Whether most vectors [n, 3] end on a sphere around any centre, and all around it, as the
    counts of a triad that was turned do.
    """
    finite = vectors[np.all(np.isfinite(vectors), axis=1)]
    if len(finite) < 2 * _LEAST_TURNED or min(np.ptp(finite, axis=0), default=0.0) == 0.0:
        return False
    *centre, radius = find_sphere(finite)
    distance = np.abs(np.linalg.norm(finite - centre, axis=1) - radius)
    return float(np.median(distance)) < _ROUND * radius and bool(
        np.all(np.ptp(finite, axis=0) > radius)
    )


def _find_sweep(columns: Sequence[Array | None]) -> tuple[int, int] | None:
    """Rates of a table and what a gyro indicated, by their numbers: two columns in proportion, of
    which the first is typed; None for other columns.
    """
    varying = [k for k, column in enumerate(columns) if _varies(column)]
    if len(varying) != 2 or len(columns) > 2:
        return None
    rates, indication = (np.asarray(columns[k], dtype=np.float64) for k in varying)
    if not (_LEAST_RATES <= rates.size <= _MOST_RATES and np.all(np.isfinite(rates + indication))):
        return None
    typed = np.array_equal(rates, np.round(rates, 3)) and not np.array_equal(
        indication, np.round(indication)
    )
    linear = abs(float(np.corrcoef(rates, indication)[0, 1])) > _IN_PROPORTION
    return (varying[0], varying[1]) if linear and typed else None


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
    steady_at_room = high - low < 2.0 and _ROOM_DEGC[0] < low < _ROOM_DEGC[1]
    return slow and (high - low > 5.0 or steady_at_room)

"""The field's units: one table, and the conversions between units of one dimension."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit.errors import RecipeError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

EARTH_RATE_DPH = 15.041067
"""Rotation of the earth against the stars [°/h]."""
STANDARD_GRAVITY_MPS2 = 9.80665
"""Standard gravity [m/s²], the unit that data sheets call g; local gravity is another number."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: base value = factor · value + offset, in the base unit of its dimension."""

    dimension: str
    factor: float = 1.0
    offset: float = 0.0


_RAD = 180.0 / math.pi

TABLE: dict[str, Unit] = {
    "s": Unit("time"),
    "ms": Unit("time", 1e-3),
    "us": Unit("time", 1e-6),
    "min": Unit("time", 60.0),
    "h": Unit("time", 3600.0),
    "degC": Unit("temperature"),
    "K": Unit("temperature", 1.0, -273.15),
    "degF": Unit("temperature", 5.0 / 9.0, -160.0 / 9.0),
    "deg/h": Unit("angular rate"),
    "deg/s": Unit("angular rate", 3600.0),
    "mdeg/s": Unit("angular rate", 3.6),
    "deg/min": Unit("angular rate", 60.0),
    "rad/s": Unit("angular rate", 3600.0 * _RAD),
    "rad/h": Unit("angular rate", _RAD),
    "arcsec/s": Unit("angular rate", 1.0),
    "rpm": Unit("angular rate", 6.0 * 3600.0),
    "deg": Unit("angle"),
    "rad": Unit("angle", _RAD),
    "mrad": Unit("angle", 1e-3 * _RAD),
    "arcmin": Unit("angle", 1.0 / 60.0),
    "arcsec": Unit("angle", 1.0 / 3600.0),
    "g": Unit("acceleration"),
    "mg": Unit("acceleration", 1e-3),
    "ug": Unit("acceleration", 1e-6),
    "m/s^2": Unit("acceleration in SI"),
    "1/s": Unit("count rate"),
    "1/ms": Unit("count rate", 1e3),
    "1/h": Unit("count rate", 1.0 / 3600.0),
    "1": Unit("count"),
}
"""Spelling → unit; the base units are s, °C, °/h, °, g (local), m/s², 1/s, 1."""

ALIASES: dict[str, str] = {
    "sec": "s",
    "µs": "us",
    "°C": "degC",
    "℃": "degC",
    "°F": "degF",
    "°/h": "deg/h",
    "deg/hr": "deg/h",
    "dph": "deg/h",
    "°/s": "deg/s",
    "dps": "deg/s",
    "°": "deg",
    "m/s²": "m/s^2",
    "m/s2": "m/s^2",
    "lsb": "1",
    "count": "1",
    "counts": "1",
    "lsb/s": "1/s",
    "counts/s": "1/s",
}

COLUMN_UNITS: dict[str, str] = {
    "s": "s",
    "degc": "degC",
    "dph": "deg/h",
    "dps": "deg/s",
    "deg": "deg",
    "g": "g",
    "lsb": "1",
}
"""Last word of a column name → unit that the column is in."""


def column_unit(column: str) -> str:
    """Unit that the last word of a column's name states; a gyro's `lsb` is counts per second."""
    unit = COLUMN_UNITS.get(column.rsplit("_", 1)[-1], "1")
    return "1/s" if column.startswith("gyro") and unit == "1" else unit


def known(spelling: str) -> str:
    """Return the table's spelling of a unit, or raise RecipeError with the closest known one."""
    unit = ALIASES.get(spelling, spelling)
    if unit in TABLE:
        return unit
    close = difflib.get_close_matches(spelling, [*TABLE, *ALIASES], n=1)
    guess = f"did you mean '{close[0]}'?" if close else f"known units: {', '.join(TABLE)}"
    raise RecipeError(f"unknown unit '{spelling}'", hint=guess)


def convert(
    values: NDArray[np.float64], source: str, target: str, *, gravity_mps2: float | None = None
) -> NDArray[np.float64]:
    """Convert values [any shape] from one unit to another of the same dimension.

    m/s² and local g convert into each other only when the local gravity [m/s²] is given: which g is meant is a fact of
    the site, never a constant. Raises RecipeError for units of different dimensions.
    """
    a, b = TABLE[known(source)], TABLE[known(target)]
    si = "acceleration in SI"
    if {a.dimension, b.dimension} == {"acceleration", si}:
        if gravity_mps2 is None:
            raise RecipeError(
                f"'{source}' to '{target}' needs the local gravity",
                hint="give [site] gravity_mps2, or latitude and height",
            )
        step = 1.0 / gravity_mps2 if a.dimension == si else gravity_mps2
        return (values * a.factor) * step / b.factor
    if a.dimension != b.dimension:
        raise RecipeError(f"'{source}' is a {a.dimension}, '{target}' a {b.dimension}", hint="state the log's own unit")
    if a == b:
        return values
    return (values * a.factor + (a.offset - b.offset)) / b.factor

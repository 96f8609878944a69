"""What is wrong with a log, found before anything is fitted to it."""

from calibkit.check import magnitude, series, thermometers
from calibkit.check.content import (
    at_row,
    bridged,
    finite,
    gaps,
    line,
    monotonic,
    plausible_rate,
    plausible_temperature,
    rows,
    varying,
)

__all__ = [
    "at_row",
    "bridged",
    "finite",
    "gaps",
    "line",
    "magnitude",
    "monotonic",
    "plausible_rate",
    "plausible_temperature",
    "rows",
    "series",
    "thermometers",
    "varying",
]

"""Logs of gyros alone → what only their names or their numbers say: table axes, and records at
rest.
"""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import CalibkitError
from calibkit.frame import values
from calibkit.ingest import logs
from calibkit.instruments.gyro_noise.deviations import STEADY_DEGC

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe

TABLE_AXIS = re.compile(r"(?:^|[^a-z]|axis|achse|about|um)([xyz])(?![a-z])", re.IGNORECASE)
"""Table axis in the name of a log: a letter by itself, or behind a word for an axis."""
TEMPERATURES = ("temp_case_degc", "temp_env_degc")
LONG_S = 600.0
"""Duration [s] from which a temperature that stands still says something: no chamber ramps so
slowly.
"""


def table_axes(files: Sequence[str]) -> dict[str, list[str]]:
    """Table axis → its logs where every log's name names one of x, y, z and each has a log; else
    nothing.
    """
    found: dict[str, list[str]] = {axis: [] for axis in "xyz"}
    for file in files:
        named = {str(axis).lower() for axis in TABLE_AXIS.findall(logs.log_name(file))}
        if len(named) != 1:
            return {}
        found[named.pop()].append(file)
    return found if all(found.values()) else {}


def alike(axes: Mapping[str, Sequence[str]], shipped: Mapping[str, Sequence[str]]) -> bool:
    """Whether patterns of a recipe give just these logs to each axis."""
    every = [file for files in axes.values() for file in files]
    return all(
        {file for file in every if any(fnmatchcase(file, pattern) for pattern in shipped[axis])}
        == set(files)
        for axis, files in axes.items()
    )


def at_rest(spec: GyroNoiseRecipe, folder: Path, files: Sequence[str]) -> bool:
    """Whether each log is long, and steady where it has a temperature; one that cannot be read is
    not.
    """
    try:
        return all(_steady(spec, folder, file) for file in files)
    except CalibkitError:
        return False


def _steady(spec: GyroNoiseRecipe, folder: Path, file: str) -> bool:
    """Whether one log has rows enough for noise and no temperature in it changes."""
    frame = logs.read_log(
        spec, folder / file, file, ("time_s", *spec.noise.columns), TEMPERATURES
    ).frame
    if len(frame) < spec.noise.min_rows:
        return False
    logged = [values(frame, name) for name in TEMPERATURES if name in frame.columns]
    long = float(np.ptp(values(frame, "time_s"))) >= LONG_S
    return not logged or (long and all(float(np.ptp(one)) <= STEADY_DEGC for one in logged))

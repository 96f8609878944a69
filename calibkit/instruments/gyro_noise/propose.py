"""Logs of gyros at rest → the recipe that fits them."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibkit.errors import CalibkitError
from calibkit.frame import values
from calibkit.ingest import logs
from calibkit.ingest.proposal import Choice, Evidence
from calibkit.instruments.gyro_noise.deviations import STEADY_DEGC
from calibkit.instruments.gyro_noise.recipe import GyroNoiseRecipe

TEMPERATURES = ("temp_case_degc", "temp_env_degc")
LONG_S = 600.0
"""Duration [s] from which a temperature that stands still says something: no chamber ramps so
slowly.
"""


def propose(evidence: Evidence) -> Choice | None:
    """Times and rates of gyros, no reference, and no temperature that changes."""
    rates = list(evidence.gyros("dph"))
    alone = evidence.second_logger and not evidence.columns.keys() & set(TEMPERATURES)
    if "time_s" not in evidence.columns or not rates or alone:
        return None
    keys = {} if rates == ["gyro_dph"] else {"columns": json.dumps(rates)}
    choice = evidence.choose("gyro_noise", ("time_s", *TEMPERATURES, *rates), keys=keys)
    spec = evidence.recipe(choice)
    if not isinstance(spec, GyroNoiseRecipe) or not _at_rest(
        spec, evidence.folder, evidence.group.files
    ):
        return None
    return replace(
        choice,
        remark=(
            "# Taken for gyros at rest, for want of anything that says they moved: a log cannot"
            " show it."
        ),
    )


def _at_rest(spec: GyroNoiseRecipe, folder: Path, files: Sequence[str]) -> bool:
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

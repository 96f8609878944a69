"""What a plan of ramps assumes from an earlier run, and the logs that are measured already."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import UsageError
from calibkit.frame import refuse
from calibkit.instruments.fog_thermal import forms, ramps
from calibkit.instruments.fog_thermal.numeric.planned import CaseLog
from calibkit.instruments.fog_thermal.uncertainty import TURN_ON
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.coefficients import Record, StageResult
    from calibkit.frame import Log
    from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe

BEFORE, NOISE = "drift_rms_before.", "noise_rms."
"""Figures of the drift rms of a log and of the noise in it begin with these."""


def read_run(
    records: Mapping[str, Record | StageResult], noise_s: float
) -> tuple[float, dict[tuple[str, str], ErrorComponent]]:
    """White noise [°/h] of the mean over a time [s], and sizes of drift, turn-on bias and flicker
    noise of a run; UsageError for one that does not state them.
    """
    levels = {form.name for form in forms.ON_LEVELS.values()}
    found = records.get(forms.FILE)
    model = next((one for one in found.models if one.form in levels), None) if found else None
    if found is None or model is None:
        raise UsageError(
            "that run has no level, lagged or bank model of a gyro's drift, which states noise and"
            " turn-on biases",
            hint="name another run, or state the sizes in [device] of the equipment file",
        )
    stated = {one.name: one.value for one in model.parameters}
    figures = {one.name: one.value for one in found.figures}
    names = [one.removeprefix(BEFORE) for one in figures if one.startswith(BEFORE)]
    squares = [figures[BEFORE + one] ** 2 - figures[NOISE + one] ** 2 for one in names]
    turn_on = [value for name, value in figures.items() if name.startswith(TURN_ON)]
    spread = float(np.std(turn_on, ddof=1)) if len(turn_on) > 1 else 0.0
    sizes = {
        ("coil", "drift"): max(float(np.mean(squares)), 0.0) ** 0.5 if squares else 0.0,
        ("log", "turn-on"): stated.get("turn_on", spread),
        ("log", "flicker"): stated["flicker"],
    }
    white = float(np.sqrt(stated["white_variance"] * stated["interval"] / noise_s))
    return white, {
        (group, effect): ErrorComponent(
            group=group,
            effect=effect,
            value=value,
            unit="deg/h",
            dof=float(max(len(names) - 1, 1)),
        )
        for (group, effect), value in sizes.items()
        # what was not seen is as the equipment file states it
        if value > 0.0
    }


def measure_logs(spec: FogThermalRecipe, logs: Sequence[Log]) -> tuple[CaseLog, ...]:
    """Rows of measured logs; FrameError for one that a fit refuses."""
    found = []
    for log in logs:
        refuse(ramps.find_faults(log, spec))
        blocks = ramps.block_means(log, spec, rated=False)[1]
        found.append(CaseLog.of_blocks(blocks.time, blocks.case))
    return tuple(found)

"""What a plan of ramps assumes from an earlier run, and the logs that are measured already."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import UsageError
from calibkit.frame import refuse
from calibkit.instruments.fog_thermal import forms, ramps
from calibkit.instruments.fog_thermal.numeric.planned import CaseLog
from calibkit.instruments.fog_thermal.uncertainty import TURN_ON
from calibkit.recipe.tables import ErrorComponent

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from calibkit.coefficients import Record, StageResult
    from calibkit.frame import Log
    from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe

DIFFERENT = 1.1
"""Ratio of two rates from which on they differ."""
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


@dataclass(frozen=True, slots=True)
class Measured:
    """Logs that are measured already."""

    logs: tuple[CaseLog, ...]
    rates: tuple[float, ...]
    """Signed rates [°C/min] of their ramps."""

    def rates_with(self, planned: Iterable[float]) -> tuple[int, int]:
        """Number of rates that differ, heating and cooling, of these and of planned ramps."""
        every = [*self.rates, *planned]
        return _count_rates(one for one in every if one > 0.0), _count_rates(
            -one for one in every if one < 0.0
        )


def _count_rates(rates: Iterable[float]) -> int:
    """Number of unsigned rates [°C/min] that differ."""
    ordered = sorted(rates)
    return sum(k == 0 or one > DIFFERENT * ordered[k - 1] for k, one in enumerate(ordered))


def measure_logs(spec: FogThermalRecipe, logs: Sequence[Log]) -> Measured:
    """Measured logs; FrameError for one that a fit refuses."""
    found, rates = [], list[float]()
    for log in logs:
        examined = ramps.examine(spec, log)
        refuse(examined.findings)
        rates += [one.level for one in examined.held if one.kind == "ramp"]
        blocks = ramps.block_means(log, spec, rated=False)[1]
        found.append(CaseLog.of_blocks(blocks.time, blocks.case))
    return Measured(tuple(found), tuple(rates))

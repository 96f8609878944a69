"""How the results of a rate table move with errors of the table's rate, the time base, the
thermometer and the latitude.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from calibkit.coefficients import StageResult
from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.recipe import AnyRecipe
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.sensitivities import InputError, Sensitivity, differentiate, of_thermometer

Runs = Mapping[str, tuple[TableRun, ...]]
Refit = Callable[[Any, Runs], Sequence[StageResult]]
MOVED = {
    forms.RATE: ("rate_dps", "angle_rate_dps"),
    "time_s": ("indication", "angle_rate_dps"),
    forms.TEMPERATURE: ("temp_degc",),
}
"""Input → means over held rates that it moves; of a clock counts and turns per second."""
SHARE, RATE_STEP_DPS, LATITUDE_STEP_DEG = 1e-5, 1e-6, 1e-3


def find(
    spec: AnyRecipe, runs: Runs, results: Sequence[StageResult], refit: Refit
) -> tuple[Sensitivity, ...]:
    """Sensitivities of the results that `refit` made of runs."""
    errors = [
        InputError(forms.RATE, "scale", SHARE),
        InputError(forms.RATE, "offset", RATE_STEP_DPS),
        InputError("time_s", "scale", SHARE),
    ]
    temperatures = [run.temp_degc for group in runs.values() for run in group]
    low, high = min(temperatures), max(temperatures)
    if low <= high:  # logged in every run
        errors += of_thermometer(forms.TEMPERATURE, low, high)
    if spec.site.latitude_deg is not None:
        errors.append(InputError("latitude_deg", "offset", LATITUDE_STEP_DEG))

    def shift(error: InputError) -> Sequence[StageResult]:
        if error.input == "latitude_deg":
            site = spec.site.model_copy(
                update={"latitude_deg": error.shift(spec.site.latitude_deg)}
            )
            return refit(spec.model_copy(update={"site": site}), runs)
        return refit(
            spec,
            {axis: tuple(_shift(run, error) for run in group) for axis, group in runs.items()},
        )

    return differentiate(errors, results, shift)


def _shift(run: TableRun, error: InputError) -> TableRun:
    """A run with an error of the table's rate, of the time base or of the thermometer."""
    held = run.plateaus
    moved = {name: error.shift(getattr(held, name)) for name in MOVED[error.input]}
    return replace(run, plateaus=replace(held, **moved))

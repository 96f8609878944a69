"""How the coefficients of an exported drift model move with errors of the case thermometer and
of the gyro's indication.
"""

from collections.abc import Mapping

import numpy as np

from calibkit.coefficients import Model, StageResult
from calibkit.instruments.fog_thermal import forms
from calibkit.instruments.fog_thermal.bias import RESULT
from calibkit.sensitivities import Sensitivity
from calibkit.thermal_forms import CASE, RATE, list_time_errors

POINTS = 41
"""Temperatures at rest over which shifted coefficients are found."""
AT_REST = ("mean_rate_at_reference", RESULT)
"""Figures that move with the level."""


def find(result: StageResult) -> tuple[Sensitivity, ...]:
    """Sensitivities of the level's coefficients of a model on levels; none of another model, whose
    coefficients are of differences.

    At rest the model is a polynomial of temperature: where every temperature is off, or off in
    proportion, it is one of the same order, found exactly by least squares.
    """
    found: list[Sensitivity] = []
    for model in result.models:
        if model.form in forms.ON_LEVELS:
            rest = {f.name: f.value for f in result.figures if f.name in AT_REST}
            found += _of_levels(result.stage, model, rest)
            found += list_time_errors(result.stage, model)
    return tuple(found)


def _of_levels(stage: str, model: Model, rest: Mapping[str, float]) -> list[Sensitivity]:
    """Sensitivities of one model on levels, and of the rates at `rest`."""
    low, high = model.valid[CASE]
    case = np.linspace(low, high, POINTS)
    at = {CASE: case, RATE: np.zeros(POINTS)}
    slope = forms.slope_over_case(model, at)
    along = (2.0 * case - high - low) / ((high - low) or 1.0)
    design = forms.ON_LEVELS[model.form].gradient(model, at)
    own = [
        k
        for k, c in enumerate(model.coefficients)
        if design[:, k].any() and (c.value or c.standard_uncertainty)
    ]
    solved = np.linalg.lstsq(
        design[:, own], np.column_stack([-slope, -slope * along, np.ones(POINTS)]), rcond=None
    )[0]
    names = [f"{stage}.{model.name}.{model.coefficients[k].name}" for k in own]
    offset, span, level = (dict(zip(names, column.tolist(), strict=True)) for column in solved.T)
    by_rate = {f"{stage}.{name}": 1.0 for name in rest}
    shares = {
        f"{stage}.{model.name}.{c.name}": c.value
        for c in model.coefficients
        if c.value and not c.unit.startswith("s")
    }
    return [
        Sensitivity(CASE, "offset", offset),
        Sensitivity(CASE, "span", span),
        Sensitivity("gyro_dph", "offset", level | by_rate),
        Sensitivity("gyro_dph", "scale", shares | {f"{stage}.{n}": v for n, v in rest.items()}),
    ]

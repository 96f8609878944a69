"""How the coefficients of a bias move with errors of the thermometer and of the channel: exact, as
a polynomial whose temperature is shifted or stretched is one of the same order, and lags do not
change.
"""

import numpy as np

from calibkit.coefficients import StageResult
from calibkit.numeric.thermal.terms import TERMS
from calibkit.sensitivities import Kind, Sensitivity
from calibkit.thermal_forms import CASE, list_time_errors


def find(result: StageResult) -> tuple[Sensitivity, ...]:
    """Sensitivities of every coefficient to an offset, a scale and a span of the thermometer, and
    to an offset and a scale of the channel's own indication.
    """
    found = []
    for model in result.models:
        value = {name: model.value(name) for name in TERMS}
        powers = np.array([value[f"b{k}"] for k in range(4)])
        shifted = dict.fromkeys(TERMS, 0.0) | {
            f"b{k}": float(-(k + 1) * powers[k + 1]) for k in range(3)
        }
        shifted["s_rate"] = -value["s_temp_rate"]
        degrees = {"b0": 0, "b1": 1, "b2": 2, "b3": 3, "s_grad2": 2, "s_temp_rate": 2}
        stretched = {name: -degrees.get(name, 1) * value[name] for name in TERMS}
        low, high = model.valid[CASE]
        middle, half = (high + low) / 2.0, (high - low) / 2.0 or 1.0
        span = {name: (stretched[name] - middle * shifted[name]) / half for name in TERMS}
        errors: tuple[tuple[str, Kind, dict[str, float]], ...] = (
            (CASE, "offset", shifted),
            (CASE, "scale", stretched),
            (CASE, "span", span),
            (model.name, "offset", {"b0": 1.0}),
            (model.name, "scale", value),
        )
        for column, kind, derivatives in errors:
            named = {
                f"{result.stage}.{model.name}.{name}": one
                for name, one in derivatives.items()
                if one
            }
            found.append(Sensitivity(column, kind, named))
        found += list_time_errors(result.stage, model)
    return tuple(found)

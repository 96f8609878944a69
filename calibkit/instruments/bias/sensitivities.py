"""How coefficients of a bias move with errors of its abscissa and of the indication: exactly, as a
sum of powers of T + δ or (1 + ε) T is one of powers of T of the same order, and lags do not change.

    c_k T^k → c_k (T − δ)^k:   ∂c_{k−1}/∂δ = −k c_k        T → T/(1 + ε):   ∂c_k/∂ε = −k c_k
"""

from calibkit.coefficients import StageResult
from calibkit.numeric.thermal.terms import LAGS
from calibkit.sensitivities import Kind, Sensitivity
from calibkit.thermal_forms import list_time_errors

DEGREE = {"s_grad2": 2, "s_temp_rate": 2}
"""Degree in temperatures of the terms that are neither powers p_k, b_k nor linear."""


def find(result: StageResult) -> tuple[Sensitivity, ...]:
    """Sensitivities of every coefficient to an offset, a scale and a span of the abscissa, and to
    an offset and a scale of the channel's own indication.
    """
    sensitivities = []
    for model in result.models:
        abscissa, (low, high) = next(iter(model.valid.items()))
        middle, half = (high + low) / 2.0, (high - low) / 2.0 or 1.0
        value = {c.name: c.value for c in model.coefficients if c.name not in LAGS}
        offset, scale = dict.fromkeys(value, 0.0), {}
        for name, c in value.items():
            power = int(name[1:]) if name[1:].isdigit() else DEGREE.get(name, 1)
            scale[name] = -power * c
            if name == "s_temp_rate":
                offset["s_rate"] = -c
            elif name[1:].isdigit() and power:
                offset[f"{name[0]}{power - 1}"] = -power * c
        span = {name: (scale[name] - middle * offset[name]) / half for name in value}
        constant = next(iter(value))
        errors: tuple[tuple[str, Kind, dict[str, float]], ...] = (
            (abscissa, "offset", offset),
            (abscissa, "scale", scale),
            (abscissa, "span", span),
            (model.name, "offset", {constant: 1.0}),
            (model.name, "scale", value),
        )
        for column, kind, derivatives in errors:
            by_coefficient = {
                f"{result.stage}.{model.name}.{n}": d for n, d in derivatives.items() if d
            }
            sensitivities.append(Sensitivity(column, kind, by_coefficient))
        sensitivities += list_time_errors(result.stage, model)
    return tuple(sensitivities)

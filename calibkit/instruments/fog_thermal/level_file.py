"""Prepared logs → thermal models on levels, tested on ramps they have not seen, and their place in
drift_rate.json.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Figure, Model, Parameter
from calibkit.instruments.fog_thermal.numeric import choice as thermal_choice
from calibkit.instruments.fog_thermal.numeric.noise import Noise
from calibkit.instruments.fog_thermal.numeric.terms import TERMS, UNITS, ThermalModel, Valid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.instruments.fog_thermal.numeric.choice import ThermalChoice
    from calibkit.instruments.fog_thermal.ramps import PreparedLog
    from calibkit.instruments.fog_thermal.recipe import Drift

FORMS = {"level": "fog-drift-level/1", "lagged": "fog-drift-lagged/1"}
LAGS = ("tau_outer", "tau_inner")
UNKNOWN_DOF = (
    "degrees of freedom of the model error: not in the file, taken as infinite; fit again to have"
    " them"
)
RANGES = ("temp_case_degc", "temp_rate_degc_min", "gradient_degc", "gradient_rate_degc_min")
"""Names under which a model's fitted ranges stand in its file; of a lagged model they are those of
its coil.
"""


def choose(logs: Sequence[PreparedLog], spec: Drift) -> ThermalChoice | None:
    """Test the models on levels by leaving out each ramp; none where the recipe asks for the
    published scheme alone.
    """
    if spec.model == "gradient_rate" or (spec.model == "auto" and spec.order != "auto"):
        return None
    candidates = [c for c in thermal_choice.CANDIDATES if spec.model in ("auto", c.form)]
    return thermal_choice.choose(
        [log.thermal for log in logs],
        candidates,
        figure_blocks=max(1, round(100.0 / spec.interval_s)),
    )


def file_model(model: ThermalModel, interval_s: float) -> Model:
    """fog-drift-level/1 or fog-drift-lagged/1 model; terms that were not fitted are 0."""
    names = (*TERMS, *LAGS[: len(model.lags)])
    values = [*model.coefficients.tolist(), *model.lags]
    units = (*UNITS, *("s" for _ in model.lags))
    spans = (
        model.valid.temperature,
        model.valid.rate,
        model.valid.gradient,
        model.valid.gradient_rate,
    )
    parameters = [
        Parameter("interval", interval_s, "s"),
        Parameter("white_variance", model.noise.white_variance, "(deg/h)^2"),
        Parameter("flicker", model.noise.flicker, "deg/h"),
        Parameter("model_error", model.model_error, "deg/h"),
        Parameter("model_error_dof", model.model_error_dof, "1"),
    ]
    if model.form == "level":
        parameters.append(Parameter("window", model.window_s, "s"))
    return Model(
        name="drift",
        form=FORMS[model.form],
        coefficients=tuple(
            Coefficient(name, float(value), unit, float(u))
            for name, value, unit, u in zip(
                names, values, units, model.standard_uncertainty, strict=True
            )
        ),
        covariance=tuple(map(tuple, model.covariance.tolist())),
        dof=model.dof,
        residual_rms=model.residual_rms,
        residual_unit="deg/h",
        valid=dict(zip(RANGES, spans, strict=True)),
        parameters=tuple(parameters),
    )


def thermal_model(model: Model) -> ThermalModel:
    """Thermal model of its file: the inverse of file_model, but for the turn-on biases of the
    fitted logs.

    Files of before the degrees of freedom of the model error were stated are taken as they were
    then: infinite, and flagged.
    """
    form = next(name for name, written in FORMS.items() if written == model.form)
    named = {c.name: c for c in model.coefficients}
    stated = any(parameter.name == "model_error_dof" for parameter in model.parameters)
    return ThermalModel(
        form="lagged" if form == "lagged" else "level",
        terms=tuple(
            name
            for name in TERMS
            if named[name].standard_uncertainty > 0.0 or named[name].value != 0.0
        ),
        coefficients=np.array([named[name].value for name in TERMS]),
        lags=tuple(named[name].value for name in LAGS if name in named),
        covariance=np.array(model.covariance),
        window_s=model.value("window") if form == "level" else 0.0,
        valid=Valid(*(model.valid[name] for name in RANGES)),
        turn_on=np.zeros(0),
        dof=model.dof,
        residual_rms=model.residual_rms,
        noise=Noise(model.value("white_variance"), model.value("flicker")),
        model_error=model.value("model_error"),
        model_error_dof=model.value("model_error_dof") if stated else math.inf,
        entangled=(),
        flags=() if stated else (UNKNOWN_DOF,),
    )


def figures(choice: ThermalChoice) -> tuple[Figure, ...]:
    """Left-out figures of every candidate, raw beside them."""
    found = [
        Figure(f"leave_one_ramp_out_rms.{t.candidate.name}", t.pooled, "deg/h", 0.0)
        for t in choice.tested
    ]
    if choice.tested:
        found.insert(0, Figure("raw_drift_rms.ramps", choice.tested[0].pooled_raw, "deg/h", 0.0))
    return tuple(found)

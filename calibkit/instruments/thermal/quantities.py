"""Results of a run: the bias of each channel over temperature and its rate, and its drift against
rest at the reference, which `apply` takes off.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibkit import thermal_forms
from calibkit.certificate.quantities import At, Point, Quantity, against_rest, ranged
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.thermal import forms
from calibkit.instruments.thermal.recipe import ThermalRecipe
from calibkit.thermal_forms import CASE, RATE

MODEL_ERROR = Words("model error on stretches left out", "留出时段的模型误差")


def bias(stage: str, model: Model) -> Quantity:
    """Bias of one channel, its turn-on bias included, on a ramp after the lags have settled."""

    def point(at: At) -> Point:
        columns = {column: np.array([value]) for column, value in at.items()}
        form = forms.FORMS[model.form]
        slope = float(thermal_forms.slope_over_case(model, columns)[0])
        return Point(
            float(form.evaluate(model, columns)[0]),
            ((model, form.gradient(model, columns)[0]),),
            {CASE: (at[CASE], slope)},
            ((MODEL_ERROR, *thermal_forms.model_error(model)),),
        )

    inputs = (ranged(model, CASE), ranged(model, RATE, 0.0))
    words, unit = Words("bias at rest", "稳态零偏"), model.residual_unit
    return Quantity(
        "bias", stage, model.name, words, unit, inputs, point, symbol="y", principal=True
    )


def _drift(level: Quantity, reference_degc: float) -> Quantity:
    """Drift of one channel, zero at rest at the reference."""
    case = level.inputs[0]
    reference = min(max(reference_degc, case.low), case.high)
    words = Words(f"drift against rest at {reference:g} °C", f"相对 {reference:g} °C 稳态的漂移")
    point = against_rest(level.point, {CASE: reference})
    return replace(level, name="drift", words=words, point=point, compared=(({},),))


def results(records: Mapping[str, Record], spec: ThermalRecipe) -> tuple[Quantity, ...]:
    """Bias and drift of each channel."""
    record = records[forms.FILE]
    quantities = []
    for model in record.models:
        level = bias(record.stage, model)
        quantities += [level, _drift(level, spec.reference_temp_degc)]
    return tuple(quantities)

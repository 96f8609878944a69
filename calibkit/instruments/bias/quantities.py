"""Results of a run: the bias y of each channel, and its drift y − y(reference, at rest), which
`apply` takes off.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibkit import thermal_forms, units
from calibkit.certificate.quantities import (
    At,
    Point,
    Quantity,
    against_rest,
    numbered,
    of_form,
    polynomial,
    ranged,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.bias import forms
from calibkit.recipe import Recipe
from calibkit.thermal_forms import CASE, RATE

MODEL_ERROR = Words("model error on stretches left out", "留出时段的模型误差")


def reference_of(model: Model, reference_degc: float) -> float:
    """Abscissa at which the drift of a channel is zero: the reference temperature clamped to the
    fitted range, of an abscissa in another unit the middle of the range.
    """
    column, (low, high) = next(iter(model.valid.items()))
    reference = reference_degc if column.endswith("_degc") else (low + high) / 2.0
    return float(np.clip(reference, low, high))


def bias(stage: str, model: Model) -> Quantity:
    """Bias of one channel, its turn-on bias included; of a model over temperature on a ramp after
    the lags have settled.
    """
    if model.form == POLYNOMIAL.name:
        (column,) = model.valid
        return Quantity(
            "bias",
            stage,
            model.name,
            Words("bias", "零偏"),
            units.column_unit(model.name),
            (ranged(model, column),),
            polynomial(model, numbered("p", model), column),
            principal=True,
        )

    inputs = ranged(model, CASE), ranged(model, RATE, 0.0)
    fitted = of_form(forms.FORMS[model.form], model, inputs[:1])

    def point(operating_point: At) -> Point:
        model_error = (MODEL_ERROR, *thermal_forms.model_error(model))
        return replace(fitted(operating_point), more=(model_error,))

    return Quantity(
        "bias",
        stage,
        model.name,
        Words("bias at rest", "稳态零偏"),
        model.residual_unit,
        inputs,
        point,
        symbol="y",
        principal=True,
    )


def results(records: Mapping[str, Record], spec: Recipe) -> tuple[Quantity, ...]:
    """Bias and drift of each channel."""
    quantities = []
    for record in records.values():
        for model in record.models:
            level = bias(record.stage, model)
            reference = reference_of(model, spec.reference_temp_degc)
            words = Words(f"drift against {reference:g}", f"相对 {reference:g} 的漂移")
            if model.form != POLYNOMIAL.name:
                words = Words(
                    f"drift against rest at {reference:g} °C", f"相对 {reference:g} °C 稳态的漂移"
                )
            point = against_rest(level.point, {level.inputs[0].column: reference})
            drift = replace(level, name="drift", words=words, point=point, compared=(({},),))
            quantities += [level, drift]
    return tuple(quantities)

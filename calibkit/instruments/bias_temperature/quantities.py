"""Results of a run: the bias of each channel over its abscissa, and its drift against the
reference, which `apply` takes off.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibkit import units
from calibkit.certificate.quantities import (
    Quantity,
    against_rest,
    numbered,
    polynomial,
    ranged,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.bias_temperature.recipe import BiasTemperatureRecipe


def reference_of(model: Model, reference_degc: float) -> float:
    """Abscissa at which the drift of a channel is zero: the reference temperature clamped to the
    fitted range, of an abscissa in another unit the middle of the range.
    """
    ((column, (low, high)),) = model.valid.items()
    wanted = reference_degc if column.endswith("_degc") else (low + high) / 2.0
    return float(np.clip(wanted, low, high))


def bias(stage: str, model: Model) -> Quantity:
    """Bias of one channel, its turn-on bias included."""
    (column,) = model.valid
    point = polynomial(model, numbered("p", model), column)
    unit, inputs = units.column_unit(model.name), (ranged(model, column),)
    return Quantity(
        "bias", stage, model.name, Words("bias", "零偏"), unit, inputs, point, principal=True
    )


def _drift(level: Quantity, reference: float) -> Quantity:
    """Drift of one channel, zero at the reference."""
    words = Words(f"drift against {reference:g}", f"相对 {reference:g} 的漂移")
    point = against_rest(level.point, {level.inputs[0].column: reference})
    return replace(level, name="drift", words=words, point=point, compared=(({},),))


def results(records: Mapping[str, Record], spec: BiasTemperatureRecipe) -> tuple[Quantity, ...]:
    """Bias and drift of each channel."""
    record = records["bias.json"]
    quantities = []
    for model in record.models:
        level = bias(record.stage, model)
        quantities += [level, _drift(level, reference_of(model, spec.reference_temp_degc))]
    return tuple(quantities)

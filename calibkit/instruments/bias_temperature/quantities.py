"""Results of a run: the bias of each channel over its abscissa, and its drift against the
reference, which `apply` takes off.
"""

from collections.abc import Mapping

import numpy as np

from calibkit import units
from calibkit.certificate.quantities import At, Point, Quantity, ranged, weigh
from calibkit.certificate.stated import powers
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.forms import POLYNOMIAL
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

    def point(at: At) -> Point:
        weights, slope = powers("p", model, at[column])
        return weigh(model, weights, slope=slope, of=(column, at[column]))

    unit, inputs = units.column_unit(model.name), (ranged(model, column),)
    return Quantity("bias", stage, model.name, Words("bias", "零偏"), unit, inputs, point)


def _drift(stage: str, model: Model, reference: float) -> Quantity:
    """Drift of one channel, zero at the reference."""
    (column,) = model.valid
    level = POLYNOMIAL.gradient(model, {column: np.array([reference])})[0]

    def point(at: At) -> Point:
        weights, slope = powers("p", model, at[column])
        names = [c.name for c in model.coefficients]
        against = {name: weights[name] - one for name, one in zip(names, level, strict=True)}
        return weigh(model, against, slope=slope, of=(column, at[column]))

    words = Words(f"drift against {reference:g}", f"相对 {reference:g} 的漂移")
    unit, inputs = units.column_unit(model.name), (ranged(model, column),)
    return Quantity("drift", stage, model.name, words, unit, inputs, point, compared=(({},),))


def results(records: Mapping[str, Record], spec: BiasTemperatureRecipe) -> tuple[Quantity, ...]:
    """Bias and drift of each channel."""
    record = records["bias.json"]
    return tuple(
        one
        for model in record.models
        for one in (
            bias(record.stage, model),
            _drift(record.stage, model, reference_of(model, spec.reference_temp_degc)),
        )
    )

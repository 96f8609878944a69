"""Results of a run as functions of their inputs: the bias y of each channel and its drift D, which
`apply` takes off; increments Δ of the published scheme.

    D = y(T, Ṫ, G, …) − y(T_ref, at rest)       Δ = a0(r) + a1(r) G + a2(r) G²

Lags have settled: y is that on a steady ramp (`forms`).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibkit.certificate.quantities import (
    At,
    Point,
    Quantity,
    QuantityInput,
    ResultLimit,
    against_rest,
    numbered,
    of_form,
    outside_ranges,
    polynomial,
    ranged,
)
from calibkit.certificate.words import Words
from calibkit.instruments.bias import forms
from calibkit.instruments.bias.recipe import BiasRecipe, FogThermalRecipe
from calibkit.numeric.thermal.terms import CASE, DRIVERS, GRADIENT, RATE
from calibkit.records.coefficients import Model, Record
from calibkit.records.forms import POLYNOMIAL

RATES = (10.0, 5.0, 2.0, 1.0, 0.5)
"""Rates [°C/min]; drift on ramps is stated at the fastest that was fitted."""
MODEL_ERROR = Words("model error on stretches left out")
GYRO_MODEL_ERROR = Words("model error on ramps left out")
HYSTERESIS = Words("hysteresis: which way the gyro came")
COIL_FORMS = (forms.LAGGED.name, forms.BANK.name)
"""Forms whose ranges are those of the coil, which lags behind the case."""


@dataclass(frozen=True, slots=True)
class FittedBias:
    """Bias of one channel, its turn-on bias included, by a model of any form, and the temperature
    at which its drift is zero.
    """

    model: Model
    reference_degc: float

    @property
    def reference(self) -> float:
        """Abscissa at which the drift is zero: the reference temperature clamped to the fitted
        range, of an abscissa in another unit the middle of the range.
        """
        column, (low, high) = next(iter(self.model.valid.items()))
        reference = self.reference_degc if column.endswith("_degc") else (low + high) / 2.0
        return float(np.clip(reference, low, high))

    @property
    def inputs(self) -> tuple[QuantityInput, ...]:
        """Abscissa, or case temperature, rate and gradients to the air, which are 0 where they are
        not given, as at rest.
        """
        if self.model.form == POLYNOMIAL.name:
            return tuple(ranged(self.model, column) for column in self.model.valid)
        drivers = DRIVERS[1:] if self.model.form == forms.LEVEL.name else (RATE,)
        return ranged(self.model, CASE), *(ranged(self.model, name, 0.0) for name in drivers)

    def bias(self, operating_point: At) -> Point:
        """Bias, on a ramp with lags settled; a hysteresis is in its uncertainty at rest."""
        model = self.model
        if model.form == POLYNOMIAL.name:
            return polynomial(model, numbered("p", model), self.inputs[0].column)(operating_point)
        of_gyro = model.form in forms.ON_LEVELS
        # on a ramp the way that the gyro came is known
        spread = 0.0 if operating_point.get(RATE, 0.0) else forms.hysteresis(model)
        further = (
            (GYRO_MODEL_ERROR if of_gyro else MODEL_ERROR, *forms.model_error(model)),
            # a rectangular distribution of that half width (JCGM 100, 4.3.7)
            (HYSTERESIS, spread / math.sqrt(3.0), math.inf),
        )
        point = of_form(forms.FORMS[model.form], model, self.inputs[:1])(operating_point)
        return replace(point, more=tuple(part for part in further if part[1] > 0.0))

    def beyond(self, operating_point: At) -> str:
        """Why the model does not hold at a point: of one with the lags of a coil where the coil, or
        the rate, is outside the fitted range.
        """
        if self.model.form not in COIL_FORMS:
            return outside_ranges(self.inputs, operating_point)
        columns = {column: np.array([value]) for column, value in operating_point.items()}
        coil = float(forms.coil_temperature(self.model, columns)[0])
        low, high = self.model.valid[CASE]
        coil_outside = f"the coil is then at {coil:.4g} °C, outside {low:.4g} … {high:.4g} °C"
        reasons = (
            "" if low <= coil <= high else coil_outside,
            outside_ranges(self.inputs[1:], operating_point),
        )
        return "; ".join(filter(None, reasons))

    def quantities(self, stage: str) -> tuple[Quantity, Quantity]:
        """The bias itself, and its drift."""
        reference, of_gyro = f"{self.reference:g}", self.model.form in forms.ON_LEVELS
        words = Words("bias at rest")
        symbol: str | None = "y"
        drift_words = Words("drift against rest at {reference} °C", reference=reference)
        if of_gyro:
            words, symbol = Words("bias, the earth's rate included"), "B"
            drift_words = Words(
                "drift against rest at {reference} °C|of a gyro", reference=reference
            )
        elif self.model.form == POLYNOMIAL.name:
            words, symbol = Words("bias"), None
            drift_words = Words("drift against {reference}", reference=reference)
        bias = Quantity(
            "bias",
            stage,
            self.model.name,
            words,
            self.model.residual_unit,
            self.inputs,
            self.bias,
            beyond=self.beyond,
            symbol=symbol,
            principal=True,
        )
        # rest, and of a gyro the fastest ramp in each direction
        up, down = (tuple({RATE: way * rate} for rate in RATES) for way in (1.0, -1.0))
        drift = replace(
            bias,
            name="drift",
            words=drift_words,
            point=against_rest(self.bias, {self.inputs[0].column: self.reference}),
            compared=(({},), up, down) if of_gyro else (({},),),
            symbol="D" if of_gyro else bias.symbol,
            principal=not of_gyro,
        )
        return bias, drift


def results(records: Mapping[str, Record], spec: BiasRecipe) -> tuple[Quantity, ...]:
    """Bias and drift of each channel, or increments of the published scheme; those of each ramp
    last.
    """
    quantities: list[Quantity] = []
    for record in sorted(records.values(), key=lambda record: record.stage == "drift"):
        for model in record.models:
            if model.form not in forms.FORMS:
                # drift increment per interval, of one side or of one ramp
                form = forms.PER_RAMP if model.form == forms.PER_RAMP.name else forms.OVER_RATES
                columns = (GRADIENT,) if form is forms.PER_RAMP else (RATE, GRADIENT)
                inputs = tuple(ranged(model, column) for column in columns)
                low, high = model.valid[GRADIENT]
                groups = tuple(({GRADIENT: x},) for x in (low, (low + high) / 2.0, high))
                quantities.append(
                    Quantity(
                        "increment",
                        record.stage,
                        model.name,
                        Words(
                            "drift increment per {interval:g} s", interval=model.value("interval")
                        ),
                        "deg/h",
                        inputs,
                        of_form(form, model, inputs),
                        compared=() if form.per_log else groups,
                    )
                )
                continue
            fitted = FittedBias(model, spec.reference_temp_degc)
            bias, drift = fitted.quantities(record.stage)
            if isinstance(spec, FogThermalRecipe):
                largest = spec.acceptance.max_drift_rms_dph
                if largest is not None:
                    limit = ResultLimit("acceptance.max_drift_rms_dph", largest)
                    drift = replace(drift, limit=limit)
                quantities += [drift, bias]
            else:
                quantities += [bias, drift]
    return tuple(quantities)

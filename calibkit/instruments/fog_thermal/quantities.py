"""Results of a run: indicated rate and drift of a model on levels, increments of the published
scheme.

    drift D = ω(T, Ṫ, G, …) − ω(T_ref, at rest)       increment Δ = a0(r) + a1(r) G + a2(r) G²

Lags have settled: ω is that on a steady ramp (`forms`).
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
    of_form,
    outside_ranges,
    ranged,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.fog_thermal import forms
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.thermal_forms import CASE, DRIVERS, GRADIENT, RATE, model_error

RATES = (10.0, 5.0, 2.0, 1.0, 0.5)
"""Rates [°C/min]; drift on ramps is stated at the fastest that was fitted."""
MODEL_ERROR = Words("model error on ramps left out", "留出温变的模型误差")
HYSTERESIS = Words("hysteresis: which way the gyro came", "滞回：温度到达方向")
LAGS = (forms.LAGGED.name, forms.BANK.name)
"""Forms whose ranges are those of the coil, which lags behind the case."""


@dataclass(frozen=True, slots=True)
class OnLevels:
    """A level or lagged model, or a bank, and the temperature at which its drift is zero."""

    model: Model
    reference_degc: float

    @property
    def reference(self) -> float:
        """Reference temperature [°C], clamped to the fitted range."""
        low, high = self.model.valid[CASE]
        return min(max(self.reference_degc, low), high)

    @property
    def inputs(self) -> tuple[QuantityInput, ...]:
        """Case temperature, rate and gradients; those that are not given are 0, as at rest."""
        further_columns = DRIVERS[1:2] if self.model.form in LAGS else DRIVERS[1:]
        rests = (ranged(self.model, column, 0.0) for column in further_columns)
        return (ranged(self.model, CASE), *rests)

    def rate(self, operating_point: At) -> Point:
        """Indicated rate [°/h], on a ramp after the lags have settled; a hysteresis is in its
        uncertainty at rest.
        """
        point = of_form(forms.ON_LEVELS[self.model.form], self.model, self.inputs[:1])
        spread = 0.0 if operating_point.get(RATE, 0.0) else forms.hysteresis(self.model)
        further = (
            (MODEL_ERROR, *model_error(self.model)),
            (HYSTERESIS, spread / math.sqrt(3.0), math.inf),
        )
        return replace(
            point(operating_point), more=tuple(part for part in further if part[1] > 0.0)
        )

    def drift(self, operating_point: At) -> Point:
        """Indicated rate less that at rest at the reference."""
        return against_rest(self.rate, {CASE: self.reference})(operating_point)

    def beyond(self, operating_point: At) -> str:
        """Why the model does not hold at a point: of one with lags where the coil, or the rate, is
        outside the fitted range.
        """
        if self.model.form not in LAGS:
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


def on_levels(stage: str, levels: OnLevels) -> tuple[Quantity, Quantity]:
    """Drift, and the indicated rate itself, which holds turn-on bias and earth's rate."""
    # rest, and the fastest ramp in each direction
    up, down = (tuple({RATE: way * rate} for rate in RATES) for way in (1.0, -1.0))
    drift = Quantity(
        "drift",
        stage,
        levels.model.name,
        Words(f"drift against rest at {levels.reference:g} °C", "热致漂移"),
        "deg/h",
        levels.inputs,
        levels.drift,
        compared=(({},), up, down),
        beyond=levels.beyond,
        symbol="D",
    )
    words = Words("bias, the earth's rate included", "零偏（含地球自转分量）")
    rate = replace(drift, name="bias", words=words, point=levels.rate, compared=(), symbol="B")
    return drift, replace(rate, principal=True)


def _increments(record: Record, model: Model) -> Quantity:
    """Drift increment per interval, of one side or of one ramp."""
    form = forms.PER_RAMP if model.form == forms.PER_RAMP.name else forms.OVER_RATES
    columns = (GRADIENT,) if form is forms.PER_RAMP else (RATE, GRADIENT)
    inputs = tuple(ranged(model, column) for column in columns)
    low, high = model.valid[GRADIENT]
    groups = tuple(({GRADIENT: x},) for x in (low, (low + high) / 2.0, high))
    return Quantity(
        "increment",
        record.stage,
        model.name,
        Words(f"drift increment per {model.value('interval'):g} s", "漂移增量"),
        "deg/h",
        inputs,
        of_form(form, model, inputs),
        compared=() if form.per_log else groups,
    )


def results(records: Mapping[str, Record], spec: FogThermalRecipe) -> tuple[Quantity, ...]:
    """Results of the exported model, then the increments of each ramp."""
    largest = spec.acceptance.max_drift_rms_dph
    limit = None if largest is None else ResultLimit("acceptance.max_drift_rms_dph", largest)
    quantities: list[Quantity] = []
    for name in (forms.FILE, "drift.json"):
        for model in records[name].models if name in records else ():
            if model.form in forms.ON_LEVELS:
                levels = OnLevels(model, spec.reference_temp_degc)
                drift, rate = on_levels(records[name].stage, levels)
                quantities += [replace(drift, limit=limit), rate]
            else:
                quantities.append(_increments(records[name], model))
    return tuple(quantities)

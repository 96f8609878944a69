"""Results of a run: corrected components by the compensation of the recipe, and of each model by
itself; scale factors, zero offsets and matrix entries over temperature.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

from calibkit.certificate.quantities import (
    At,
    Input,
    Limit,
    Point,
    Quantity,
    of_form,
    polynomial,
    ranged,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.forms import Form
from calibkit.instruments.accelerometer import coefficient_files, forms
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe

POSITIONS = tuple(
    {name: sign * float(name == own) for name in forms.COMPONENTS}
    for own in forms.COMPONENTS
    for sign in (1.0, -1.0)
)
"""Indications [g] of the six positions with one axis along gravity."""


KINDS = {
    "k": Words("Scale factor ", "标度因数 "),
    "z": Words("Zero offset ", "零位 "),
    "c": Words("Cross term ", "交叉耦合项 "),
    "m": Words("Matrix entry ", "矩阵元 "),
    "b": Words("Bias ", "零偏 "),
}
"""First letter of a polynomial's symbol → what it is."""


def is_cross(symbol: str) -> bool:
    """Whether a polynomial is that of a cross-axis term: c_xy, m_xy."""
    _, axes = symbol.split("_")
    return len(axes) == 2 and axes[0] != axes[1]


def over_temperature(stage: str, model: Model) -> list[Quantity]:
    """Scale factor and zero offset of a K model, or every polynomial Σ c_k T^k of a triad."""
    if model.form == forms.K.name:
        axis = AXES[forms.K_MODELS.index(model.name)]
        listed = [
            ("scale", axis, KINDS["k"] + Words(axis), [*forms.SCALE_FACTOR], "1"),
            ("zero", axis, KINDS["z"] + Words(axis), [*forms.ZERO_OFFSET], "g"),
        ]
    else:
        listed = []
        over = model.form != forms.Q.name and forms.TEMPERATURE in model.valid
        for name, terms, unit in forms.list_polynomials(model) if over else ():
            symbol = name.replace("m_", "M_")
            listed.append((name, symbol, KINDS[name[0]] + Words(symbol), terms, unit))
    return [
        Quantity(
            *(name, stage, model.name, words, unit, (ranged(model, forms.TEMPERATURE),)),
            polynomial(model, terms, forms.TEMPERATURE),
            symbol=symbol,
            principal=name in ("scale", "zero") or not is_cross(name),
        )
        for name, symbol, words, terms, unit in listed
    ]


def _inputs(model: Model) -> tuple[Input, ...]:
    """Temperature and indications, each of which may reach twice gravity."""
    temperature = (ranged(model, forms.TEMPERATURE),) if forms.TEMPERATURE in model.valid else ()
    return (*temperature, *(Input(name, -2.0, 2.0) for name in forms.COMPONENTS))


def _lack_of_fit(model: Model) -> tuple[tuple[Words, float, float], ...]:
    """What K0 … K9 correct otherwise than the triad, as a further uncertainty [g]."""
    words = Words("lack of fit of the K-factor", "K 系数的失拟")
    return tuple(
        (words, parameter.value, float("inf"))
        for parameter in model.parameters
        if parameter.name == "lack_of_fit" and parameter.value > 0.0
    )


def _component(form: Form, model: Model, axis: int | None) -> Callable[[At], Point]:
    """Component [g] that a model corrects, of one axis by itself or of a triad, as a function of
    its inputs.
    """
    point = of_form(form, model, _inputs(model), axis)
    return lambda at: replace(point(at), more=_lack_of_fit(model))


def _by_compensation(
    records: Mapping[str, Record], spec: AccelerometerRecipe
) -> tuple[Quantity, ...]:
    """Corrected components [g] as `apply` gives them; compared at the six positions."""
    correction = coefficient_files.find_correction(spec.compensation, records.values())
    largest = spec.acceptance.max_residual_rms_g
    of_axes = len(correction.models) == len(AXES)
    models = correction.models if of_axes else correction.models * len(AXES)
    rows = [None] * len(AXES) if of_axes else [*range(len(AXES))]
    return tuple(
        Quantity(
            f"corrected_{letter}",
            coefficient_files.COMPENSATIONS[spec.compensation],
            "",
            Words(f"corrected {letter}", f"修正后 {letter}"),
            "g",
            _inputs(model),
            _component(correction.form, model, row),
            compared=tuple((position,) for position in POSITIONS),
            limit=None if largest is None else Limit("acceptance.max_residual_rms_g", largest),
        )
        for letter, model, row in zip(AXES, models, rows, strict=True)
    )


def _components(stage: str, model: Model) -> list[Quantity]:
    """Corrected components that a model gives by itself."""
    inputs = _inputs(model)
    if model.form == forms.K.name:
        words = Words("corrected component", "修正分量")
        return [
            Quantity(
                "component", stage, model.name, words, "g", inputs, _component(forms.K, model, None)
            )
        ]
    form = {form.name: form for form in forms.FORMS}[model.form]
    return [
        Quantity(
            *(f"component_{letter}", stage, model.name),
            *(Words(f"corrected {letter}", f"修正 {letter}"), "g", inputs),
            of_form(form, model, inputs, axis),
        )
        for axis, letter in enumerate(AXES)
    ]


def results(records: Mapping[str, Record], spec: AccelerometerRecipe) -> tuple[Quantity, ...]:
    """Corrected components by the compensation of the recipe, then the results of each model."""
    quantities = [*_by_compensation(records, spec)]
    for record in records.values():
        corrects = coefficient_files.COMPENSATIONS[spec.compensation] == record.stage
        for model in record.models:
            quantities += over_temperature(record.stage, model)
            if model.form == forms.K.name or not corrects:
                quantities += _components(record.stage, model)
    return tuple(quantities)

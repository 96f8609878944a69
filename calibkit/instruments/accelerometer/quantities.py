"""Results of a run: corrected components by the compensation of the recipe, and of each model by
itself; scale factors, zero offsets and matrix entries over temperature.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from calibkit.certificate.quantities import (
    At,
    Input,
    Limit,
    Point,
    Quantity,
    of_form,
    ranged,
    slope_by,
    weigh,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.accelerometer import coefficient_files, forms
from calibkit.instruments.accelerometer.coefficient_files import Correction
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe

POSITIONS = tuple(
    {name: sign * float(name == own) for name in forms.COMPONENTS}
    for own in forms.COMPONENTS
    for sign in (1.0, -1.0)
)
"""Indications [g] of the six positions with one axis along gravity."""


def over_temperature(
    stage: str,
    model: Model,
    name: str,
    words: Words,
    terms: Sequence[str],
    unit: str,
) -> Quantity:
    """Σ c_k t^k of the coefficients that `terms` names."""

    def point(at: At) -> Point:
        t = at[forms.TEMPERATURE]
        weights = {term: t**k for k, term in enumerate(terms)}
        slope = {term: k * t ** (k - 1) for k, term in enumerate(terms) if k}
        of = (forms.TEMPERATURE, t)
        return weigh(model, weights, slope=slope, of=of)

    inputs = (ranged(model, forms.TEMPERATURE),)
    return Quantity(name, stage, model.name, words, unit, inputs, point)


def _inputs(model: Model) -> tuple[Input, ...]:
    """Temperature and indications, each of which may reach twice gravity."""
    temperature = (ranged(model, forms.TEMPERATURE),) if forms.TEMPERATURE in model.valid else ()
    return (*temperature, *(Input(name, -2.0, 2.0) for name in forms.COMPONENTS))


def _corrected(correction: Correction, axis: int, inputs: Sequence[Input], at: At) -> Point:
    """Corrected component [g] of an axis by all stages, and its derivatives by the coefficients of
    each.
    """

    def through(at: At) -> list[np.ndarray]:
        """Indication [1, 3] before each stage, and behind the last."""
        vectors = [np.array([[at[name] for name in forms.COMPONENTS]])]
        for form, models in correction.stages:
            columns = forms.inputs(vectors[-1], np.array([at[forms.TEMPERATURE]]))
            vectors.append(np.column_stack([form.evaluate(one, columns) for one in models]))
        return vectors

    vectors, parts, along = through(at), [], np.eye(3)[axis]
    for (form, models), before in zip(correction.stages[::-1], vectors[-2::-1], strict=True):
        temperature = at[forms.TEMPERATURE]
        columns = forms.inputs(before, np.array([temperature]))
        for row, model in enumerate(models):
            gradient = form.gradient(model, columns)[0]
            parts.append((model, along @ gradient if gradient.ndim == 2 else along[row] * gradient))
        if len(models) == 1:  # linear in the indications
            own = forms.inputs(np.eye(3), np.full(3, temperature))
            along = form.evaluate(models[0], own) @ along
    slopes = {
        one.column: (
            at[one.column],
            slope_by(lambda moved: float(through(moved)[-1][0, axis]), one, at),
        )
        for one in inputs
    }
    used = tuple((model, weights) for model, weights in parts if np.any(weights))
    more = tuple(one for model, _ in used for one in _lack_of_fit(model))
    return Point(float(vectors[-1][0, axis]), used, slopes, more)


def _lack_of_fit(model: Model) -> tuple[tuple[Words, float, float], ...]:
    """What K0 … K9 correct otherwise than the triad, as a further uncertainty [g]."""
    words = Words("lack of fit of the K-factor", "K 系数的失拟")
    return tuple(
        (words, parameter.value, float("inf"))
        for parameter in model.parameters
        if parameter.name == "lack_of_fit" and parameter.value > 0.0
    )


def _component(model: Model, inputs: Sequence[Input]) -> Callable[[At], Point]:
    """Component [g] that the K model of an axis corrects, as a function of its inputs."""
    point = of_form(forms.K, model, inputs)
    return lambda at: replace(point(at), more=_lack_of_fit(model))


def _by_compensation(
    records: Mapping[str, Record], spec: AccelerometerRecipe
) -> tuple[Quantity, ...]:
    """Corrected components [g] as `apply` gives them; compared at the six positions."""
    correction = coefficient_files.find_correction(spec.compensation, records.values())
    largest = spec.acceptance.max_residual_rms_g
    inputs = _inputs(correction.stages[0][1][0])
    return tuple(
        Quantity(
            f"corrected_{letter}",
            coefficient_files.COMPENSATIONS[spec.compensation][-1],
            "",
            Words(f"corrected {letter}", f"修正后 {letter}"),
            "g",
            inputs,
            partial(_corrected, correction, axis, inputs),
            compared=tuple((position,) for position in POSITIONS),
            limit=None if largest is None else Limit("acceptance.max_residual_rms_g", largest),
        )
        for axis, letter in enumerate(AXES)
    )


def _of_models(record: Record, *, components: bool) -> list[Quantity]:
    """Results of each model by itself; `components` of a triad where nothing else gives them."""
    make: Callable[..., Quantity] = partial(over_temperature, record.stage)
    found = []
    for model in record.models:
        inputs = _inputs(model)
        if model.form == forms.K.name:
            words, form = Words("corrected component", "修正分量"), _component(model, inputs)
            found += [
                make(model, "scale", Words("scale factor"), forms.SCALE_FACTOR, "1"),
                make(model, "zero", Words("zero offset"), forms.ZERO_OFFSET, "g"),
                Quantity("component", record.stage, model.name, words, "g", inputs, form),
            ]
            continue
        form_of = {form.name: form for form in forms.FORMS}[model.form]
        for axis, letter in enumerate(AXES if components else ""):
            name, words = f"component_{letter}", Words(f"corrected {letter}", f"修正 {letter}")
            point = of_form(form_of, model, inputs, axis)
            found.append(Quantity(name, record.stage, model.name, words, "g", inputs, point))
        if form_of is not forms.Q and forms.TEMPERATURE in model.valid:
            for symbol, terms, unit in forms.list_polynomials(model):
                words = Words(symbol.replace("m_", "M_"))
                found.append(make(model, symbol, words, terms, unit))
    return found


def results(records: Mapping[str, Record], spec: AccelerometerRecipe) -> tuple[Quantity, ...]:
    """Corrected components by the compensation of the recipe, then the results of each model."""
    used = coefficient_files.COMPENSATIONS[spec.compensation]
    return (
        *_by_compensation(records, spec),
        *(
            one
            for record in records.values()
            for one in _of_models(record, components=used != (record.stage,))
        ),
    )

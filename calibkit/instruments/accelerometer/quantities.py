"""Results of a run: corrected components by the compensation of the recipe, and of each model by
itself; scale factors, zero offsets and matrix entries over temperature.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import chain

from calibkit.certificate.quantities import (
    At,
    Point,
    Quantity,
    QuantityInput,
    ResultLimit,
    of_form,
    polynomial,
    ranged,
)
from calibkit.certificate.words import Words
from calibkit.instruments.accelerometer import corrections, forms
from calibkit.instruments.accelerometer.equation import AXES, read_terms
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.records.coefficients import Model, Record

POSITIONS = tuple(
    {name: sign * float(name == vertical) for name in forms.COMPONENTS}
    for vertical in forms.COMPONENTS
    for sign in (1.0, -1.0)
)
"""Indications [g] of the six positions with one axis along gravity."""


KINDS = {
    "k": Words("Scale factor "),
    "z": Words("Zero offset "),
    "c": Words("Cross term "),
    "m": Words("Matrix entry "),
    "b": Words("Bias "),
}
"""First letter of a polynomial's symbol → what it is."""


def over_temperature(stage: str, model: Model) -> dict[tuple[str, bool], list[Quantity]]:
    """Key of `KINDS`, and whether it is of a cross-axis term → scale factor or zero offset of a K
    model, polynomials Σ c_k T^k of a triad.
    """
    # name, symbol, key → names of the coefficients
    polynomials: dict[tuple[str, str, tuple[str, bool]], list[str]] = {}
    if model.form == forms.K.name:
        axis = AXES[forms.K_MODELS.index(model.name)]
        # K8 and K9 have no temperature: they are stated as coefficients alone
        polynomials["scale", axis, ("k", False)] = [*forms.SCALE_FACTOR]
        polynomials["zero", axis, ("z", False)] = [*forms.ZERO_OFFSET]
    elif model.form != forms.Q.name and forms.TEMPERATURE in model.valid:
        terms = read_terms(tuple(c.name for c in model.coefficients))
        for name, symbol in zip(terms.names, terms.symbol.tolist(), strict=True):
            kind, axes = symbol[0], symbol[2:]
            if kind in KINDS:
                key = kind, len(set(axes)) > 1
                polynomials.setdefault((symbol, symbol.replace("m_", "M_"), key), []).append(name)
    units = {c.name: c.unit for c in model.coefficients}
    quantities: dict[tuple[str, bool], list[Quantity]] = {}
    for (name, symbol, key), powers in polynomials.items():
        # the published form and the triad have scale factors of their own
        which = f"{symbol} ({powers[0]} … {powers[-1]})" if model.form == forms.K.name else symbol
        quantity = Quantity(
            *(name, stage, model.name, KINDS[key[0]] + Words.literal(which), units[powers[0]]),
            (ranged(model, forms.TEMPERATURE),),
            polynomial(model, powers, forms.TEMPERATURE),
            symbol=symbol,
            principal=not key[1],
        )
        quantities.setdefault(key, []).append(quantity)
    return quantities


def _inputs(model: Model) -> tuple[QuantityInput, ...]:
    """Temperature and indications, each of which may reach twice gravity."""
    temperature = (ranged(model, forms.TEMPERATURE),) if forms.TEMPERATURE in model.valid else ()
    return (*temperature, *(QuantityInput(name, -2.0, 2.0) for name in forms.COMPONENTS))


def _component(model: Model, axis: int) -> Callable[[At], Point]:
    """Component [g] that a model corrects, its only one or that along an axis, as a function of its
    inputs; what K0 … K9 correct otherwise than the triad is a further uncertainty.
    """
    form = forms.BY_NAME[model.form]
    point = of_form(form, model, _inputs(model), None if form is forms.K else axis)
    words = Words("lack of fit of the K-factor")
    sizes = [p.value for p in model.parameters if p.name == "lack_of_fit" and p.value > 0.0]
    further = tuple((words, size, float("inf")) for size in sizes)
    return lambda inputs: replace(point(inputs), more=further)


def results(records: Mapping[str, Record], spec: AccelerometerRecipe) -> tuple[Quantity, ...]:
    """Corrected components [g] by the compensation of the recipe, as `apply` gives them, compared
    at the six positions; then the results of each model, and the components that it gives by
    itself.
    """
    models = corrections.find_correction(spec.compensation, records.values()).models
    stage, largest = (
        corrections.COMPENSATIONS[spec.compensation],
        spec.acceptance.max_residual_rms_g,
    )
    limit = None
    if largest is not None:
        limit = ResultLimit("acceptance.max_residual_rms_g", largest)
    quantities = []
    for axis, letter in enumerate(AXES):
        # K has a model for each axis, a triad one for all
        model = models[axis % len(models)]
        quantity = Quantity(
            f"corrected_{letter}",
            stage,
            "",
            Words("corrected {letter}", letter=letter),
            "g",
            _inputs(model),
            _component(model, axis),
            compared=tuple((position,) for position in POSITIONS),
            limit=limit,
        )
        quantities.append(quantity)
    for record in records.values():
        for model in record.models:
            quantities += chain.from_iterable(over_temperature(record.stage, model).values())
            if model.form == forms.K.name:
                named = [("component", Words("corrected component"))]
            elif record.stage != stage:
                named = [(f"component_{x}", Words("corrected {x}", x=x)) for x in AXES]
            else:
                continue
            quantities += [
                Quantity(
                    name,
                    record.stage,
                    model.name,
                    words,
                    "g",
                    _inputs(model),
                    _component(model, axis),
                )
                for axis, (name, words) in enumerate(named)
            ]
    return tuple(quantities)

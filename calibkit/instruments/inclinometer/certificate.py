"""Inclinometer results: the in-situ scale factor s of each gyro over temperature, as functions of
their inputs and on a certificate.
"""

from collections.abc import Mapping
from dataclasses import replace

from calibkit.certificate.blocks import lay_out_models
from calibkit.certificate.quantities import (
    At,
    Point,
    Quantity,
    numbered,
    of_figure,
    polynomial,
    ranged,
)
from calibkit.certificate.results import Block, Equation
from calibkit.certificate.stated import Stated
from calibkit.certificate.words import Words
from calibkit.instruments.inclinometer.forms import FILE, SCALE as SCALE_FORM, TEMPERATURE
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.records.coefficients import Model, Record

SCALE = Equation(
    SCALE_FORM.name,
    r"\omega' = s(T)\,\omega, \quad s(T) = \sum_k s_k T^k",
    Words("ω indicated rate, ω' corrected rate, T case temperature [°C]."),
)
FIGURES = {
    "stations_used": Words("stations used"),
    "stations_refused": Words("stations refused"),
}


CHOICE = Words("choice of the order, by left-out stations")


def scale(record: Record, model: Model) -> Quantity:
    """Scale factor of one gyro; constant where temperature was not logged."""
    value = polynomial(model, numbered("s", model), TEMPERATURE)
    over_temperature = TEMPERATURE in model.valid
    # files of calibkit 0.2 state what the choice of the order adds; later ones average the orders
    u_choice = next((p.value for p in model.parameters if p.name == "order_choice"), 0.0)
    further_terms = ((CHOICE, u_choice, float(max(model.dof, 1))),) if u_choice else ()

    def point(at: At) -> Point:
        if over_temperature:
            return replace(value(at), more=further_terms)
        return replace(value({TEMPERATURE: 0.0}), influences={}, more=further_terms)

    return Quantity(
        "s",
        record.stage,
        model.name,
        Words("s of gyro {name}", name=model.name),
        "1",
        (ranged(model, TEMPERATURE),) if over_temperature else (),
        point,
        compared=(({},),),
        relative=True,
        principal=True,
    )


def results(records: Mapping[str, Record], spec: InclinometerRecipe) -> tuple[Quantity, ...]:
    """Scale factor of each gyro; the recipe sets no limit on it."""
    del spec
    record = records[FILE]
    return tuple(scale(record, model) for model in record.models)


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Block of inclinometer_scale.json."""
    record = basis.records.get(FILE)
    if record is None:
        return ()
    values = [scale(record, model) for model in record.models]
    values += [
        of_figure(record, figure, FIGURES[figure.name])
        for figure in record.figures
        if figure.name in FIGURES
    ]
    title = Words("In-situ scale factor of the north-seeking gyros")
    return (lay_out_models(basis, record, title, (SCALE,), values),)

"""Results of a run: the in-situ scale factor s of each gyro over temperature."""

from collections.abc import Mapping
from dataclasses import replace

from calibkit.certificate.quantities import At, Point, Quantity, ranged, weigh
from calibkit.certificate.stated import powers
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.inclinometer.forms import FILE, TEMPERATURE, read_choice
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe


def choice_of_order(model: Model) -> tuple[tuple[Words, float, float], ...]:
    """What the choice of the order adds to the uncertainty of s(T)."""
    u = read_choice(model)
    words = Words("choice of the order, by left-out stations", "阶数选择（留一法）")
    return ((words, u, float(max(model.dof, 1))),) if u else ()


def scale(record: Record, model: Model) -> Quantity:
    """Scale factor of one gyro; constant where temperature was not logged."""
    over = TEMPERATURE in model.valid

    def point(at: At) -> Point:
        t = at.get(TEMPERATURE, 0.0)
        weights, slope = powers("s", model, t)
        found = weigh(model, weights, slope=slope if over else None, of=(TEMPERATURE, t))
        return replace(found, more=choice_of_order(model))

    return Quantity(
        "s",
        record.stage,
        model.name,
        Words(f"s of gyro {model.name}", f"{model.name} 陀螺 s"),
        "1",
        (ranged(model, TEMPERATURE),) if over else (),
        point,
        compared=(({},),),
        relative=True,
    )


def results(records: Mapping[str, Record], spec: InclinometerRecipe) -> tuple[Quantity, ...]:
    """Scale factor of each gyro; the recipe sets no limit on it."""
    del spec
    record = records[FILE]
    return tuple(scale(record, model) for model in record.models)

"""Results of a run: the in-situ scale factor s of each gyro over temperature."""

import math
from collections.abc import Mapping

from calibkit.certificate.quantities import At, Point, Quantity, ranged, weigh
from calibkit.certificate.stated import powers
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.inclinometer.forms import FILE, TEMPERATURE
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe


def by_latitude(record: Record, value: float) -> dict[str, tuple[float, float]]:
    """Sensitivity of s, and of quantities proportional to s, to the latitude α: −s tan α, exact for
    a vertical tool.
    """
    found = next((c for c in record.conditions if c.name == "latitude"), None)
    if found is None:
        return {}
    alpha = math.radians(found.value)
    return {"latitude_deg": (found.value, -value * math.tan(alpha) * math.pi / 180.0)}


def scale(record: Record, model: Model) -> Quantity:
    """Scale factor of one gyro; constant where temperature was not logged."""
    over = TEMPERATURE in model.valid

    def point(at: At) -> Point:
        t = at.get(TEMPERATURE, 0.0)
        weights, slope = powers("s", model, t)
        value = weigh(model, weights).value
        known = by_latitude(record, value)
        return weigh(
            model, weights, slope=slope if over else None, of=(TEMPERATURE, t), influences=known
        )

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


def list_quantities(
    records: Mapping[str, Record], spec: InclinometerRecipe
) -> tuple[Quantity, ...]:
    """Scale factor of each gyro; the recipe sets no limit on it."""
    del spec
    record = records[FILE]
    return tuple(scale(record, model) for model in record.models)

"""inclinometer_scale.json → chain without memory: s(T) of each gyro."""

from collections.abc import Mapping

from calibkit.firmware import exact
from calibkit.firmware.chain import Chain
from calibkit.firmware.draft import Draft, powers
from calibkit.firmware.sources import required_record
from calibkit.instruments.inclinometer.forms import FILE, TEMPERATURE
from calibkit.instruments.inclinometer.recipe import InclinometerRecipe
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.records.coefficients import Record


def files(_: InclinometerRecipe) -> tuple[str, ...]:
    """Coefficient file that the chain takes its numbers from."""
    return (FILE,)


def chain(spec: InclinometerRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain that evaluates s(T) of each gyro and multiplies its indication by it; the s of single
    stations is not exported.
    """
    record = required_record(records, FILE, spec)
    draft = Draft(padded=spec.export.layout == "padded")
    for model in record.models:
        raw, name = powers(model, "s"), f"s_{model.name}"
        valid, input_name = model.valid.get(TEMPERATURE), ""
        if valid is not None:
            input_name = "u"
            if not draft.inputs:
                draft.temperature(valid)
            raw = exact.mapped(raw, *exact.span(*valid))
        source = draft.sum(
            name, draft.polynomial(f"{name}_of_t", raw, input_name, order=HIGHEST_ORDER)
        )
        meaning = f"scale factor of the {model.name} gyro, to be multiplied with its indication"
        draft.output(
            f"scale_{model.name}",
            "1",
            source,
            meaning,
            corrects=f"gyro_{model.name}_dph",
            product=True,
        )
    return draft.chain(
        [model.form for model in record.models], "corrected = scale * indication, for each gyro"
    )

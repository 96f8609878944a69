"""bias.json → chain without memory, one correction per channel."""

import re
from collections.abc import Mapping
from fractions import Fraction

from calibkit import units
from calibkit.coefficients import Record
from calibkit.errors import OutputError
from calibkit.firmware import exact
from calibkit.firmware.chain import Chain
from calibkit.firmware.draft import BEYOND, Draft, powers
from calibkit.firmware.sources import required_record
from calibkit.instruments.bias_temperature.recipe import BiasTemperatureRecipe
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER

FILE = "bias.json"


def files(_: BiasTemperatureRecipe) -> tuple[str, ...]:
    """Coefficient file that the chain takes its numbers from."""
    return (FILE,)


def chain(spec: BiasTemperatureRecipe, records: Mapping[str, Record]) -> Chain:
    """Bias of each channel, zero at the reference temperature; of an abscissa that is no
    temperature at the middle of its range.
    """
    record = required_record(records, FILE, spec)
    draft = Draft(padded=spec.export.layout == "padded")
    for number, model in enumerate(record.models):
        (column, valid), name = next(iter(model.valid.items())), model.name
        for text in (column, name):
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text):
                raise OutputError(
                    f"column '{text}' cannot be a name in C",
                    hint="rename it in the recipe's [columns]",
                )
        unit = units.column_unit(column)
        middle, half = exact.span(*valid)
        reach = (middle - BEYOND * half, middle + BEYOND * half)
        draft.input(column, unit, "abscissa of the bias", reach)
        if number == 0:
            draft.ranges.append(f"{column} {exact.limits_text(*valid, 6)} {unit}")
            draft.map("u", column, valid, flag="TEMP_CLAMPED")
        low, high = (Fraction(limit) for limit in valid)
        reference = (
            Fraction(spec.reference_temp_degc) if column.endswith("_degc") else (low + high) / 2
        )
        found = exact.mapped(powers(model, "p"), middle, half)
        at_rest = exact.value(found, (min(max(reference, low), high) - middle) / half)
        bias = exact.add(found, (-at_rest,))
        if not exact.trimmed(bias):
            raise OutputError(
                f"{name}: the bias does not vary", hint="there is nothing to correct: leave it out"
            )
        terms = draft.polynomial(f"p_{name}", bias, "u", order=HIGHEST_ORDER)
        source = draft.sum(f"bias_{name}", terms)
        meaning = f"bias of {name}, to be subtracted from it"
        draft.output(f"bias_{name}", units.column_unit(name), source, meaning, corrects=name)
    return draft.chain(
        [model.form for model in record.models],
        f"corrected = indication - bias, each channel in its unit; {_zero(spec)}",
    )


def _zero(spec: BiasTemperatureRecipe) -> str:
    """Where the bias of every channel is 0, in words."""
    column = spec.polynomials.abscissa
    if not column.endswith("_degc"):
        return f"the bias is 0 in the middle of the fitted range of {column}"
    return (
        f"the bias is 0 at {spec.reference_temp_degc:g} degC, or at the end of the fitted range"
        " nearest to it"
    )

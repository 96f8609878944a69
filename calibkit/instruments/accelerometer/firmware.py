"""accel_k.json or accel_affine.json → chain that corrects a triad."""

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING

from calibkit.firmware import exact
from calibkit.firmware.chain import Chain
from calibkit.firmware.draft import Draft, factor, numbers
from calibkit.firmware.sources import required_record
from calibkit.instruments.accelerometer import corrections, forms
from calibkit.instruments.accelerometer.equation import AXES, read_terms
from calibkit.instruments.accelerometer.published import CROSS
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.records.coefficients import Model, Record

if TYPE_CHECKING:
    from calibkit.firmware.steps import ChainTerm

FITTED_G = Fraction(5, 4)
"""Largest indication [g] of a triad that is calibrated at 1 g, its bias included."""
SENSE = {
    "gravity": "positive along gravity",
    "specific_force": "specific force, positive against gravity",
}


def chain(spec: AccelerometerRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain of the correction that the recipe names; inputs and outputs follow the recipe's sign
    convention.
    """
    convention = spec.reference.convention
    (file,) = files(spec)
    record = required_record(records, file, spec)
    draft = Draft(padded=spec.export.layout == "padded")
    # coefficients are of indications along gravity: with both sides turned, terms of even order
    # change sign
    sign = -1 if convention == "specific_force" else 1
    valid = record.models[0].valid[forms.TEMPERATURE]
    middle, half = (
        # a calibration at one temperature has no map, and its polynomials are constants
        draft.temperature(valid) if valid[1] > valid[0] else (Fraction(valid[0]), Fraction(0))
    )
    full = Fraction(spec.full_scale("accel_g"))
    for axis in AXES:
        meaning = f"indication of the {axis} accelerometer, {SENSE[convention]}"
        draft.indication(f"accel_{axis}_g", "g", meaning, FITTED_G, full, "ACCEL_BEYOND")
    form = record.models[0].form
    if form == forms.K.name:
        # S(u) V − Z(u) − K8 V′ − K9 V″, V′ and V″ the other axes; the largest term is added last
        for row, axis in enumerate(AXES):
            model = record.model(forms.K_MODELS[row])
            scale, zero = (
                exact.mapped(numbers(model, *names), middle, half)
                for names in (forms.SCALE_FACTOR, forms.ZERO_OFFSET)
            )
            cross = zip(forms.CROSS, CROSS[row], strict=True)
            draft.sum(
                f"k_{axis}",
                *(
                    draft.polynomial(
                        f"{name.lower()}_{axis}",
                        numbers(model, name),
                        "",
                        forms.COMPONENTS[other],
                        sign=-1,
                    )
                    for name, other in cross
                ),
                draft.polynomial(f"zero_{axis}", exact.scale(zero, Fraction(sign)), "u", sign=-1),
                draft.polynomial(f"scale_{axis}", scale, "u", forms.COMPONENTS[row]),
            )
    else:
        _triad(draft, record.models[0], (middle, half), sign)
    for axis in AXES:
        meaning = f"corrected component along {axis}, {SENSE[convention]}"
        draft.output(f"accel_{axis}_g", "g", f"k_{axis}", meaning)
    formula = {
        forms.K.name: "corrected = S(T) indication - Z(T) - cross-axis terms (K-factor)",
        forms.TRIAD.name: "a = S(T) indication - Z(T), corrected = a - C(T) a",
        forms.AFFINE.name: "corrected = M(T) (indication - b(T))",
    }[form]
    if any(name.startswith("n_") for name in draft.tables):
        formula += " + second- and third-order terms"
    return draft.chain([form], f"{formula}, in local g")


def files(spec: AccelerometerRecipe) -> tuple[str, ...]:
    """Coefficient files that the chain takes its coefficients from."""
    return (f"{corrections.find_stage(spec.compensation)}.json",)


def _triad(draft: Draft, model: Model, mapping: tuple[Fraction, Fraction], sign: int) -> None:
    """Add a = S(u) V - Z(u), then a - C(u) a with its products, to the draft; of accel-affine/1
    V - b(u), then the product with M(u). For specific force, Z, b and the second-order terms change
    sign.
    """
    terms = read_terms(tuple(c.name for c in model.coefficients))
    powers: dict[str, list[Fraction]] = {}
    for symbol, c in zip(terms.symbol.tolist(), model.coefficients, strict=True):
        powers.setdefault(symbol, []).append(Fraction(c.value))

    def polynomial(symbol: str, signed: int = 1) -> tuple[Fraction, ...]:
        return exact.scale(exact.mapped(powers[symbol], *mapping), Fraction(signed))

    by_matrix = model.form == forms.AFFINE.name
    for axis, component in zip(AXES, forms.COMPONENTS, strict=True):
        if by_matrix:
            bias = polynomial(f"b_{axis}", sign)
            minus_bias = draft.polynomial(f"b_{axis}", bias, "u", sign=-1, order=HIGHEST_ORDER)
            draft.sum(axis, minus_bias, factor(component))
            continue
        zero, scale = polynomial(f"z_{axis}", sign), polynomial(f"k_{axis}")
        minus_zero = draft.polynomial(f"zero_{axis}", zero, "u", sign=-1)
        draft.sum(f"a_{axis}", minus_zero, draft.polynomial(f"scale_{axis}", scale, "u", component))
    for axis in AXES:
        added: list[list[ChainTerm]] = []
        of_axis = [symbol for symbol in powers if symbol[0] in "cmn" and symbol[2] == axis]
        # the largest terms last
        for symbol in sorted(of_axis, key=lambda name: (-len(name), name == f"m_{axis}{axis}")):
            kind, axes = symbol[0], symbol[3:].removeprefix("_")
            factors = [f"accel_{a}_g" if by_matrix else f"a_{a}" for a in axes]
            if kind == "m":
                table = polynomial(symbol)
                added.append(draft.polynomial(symbol, table, "u", *axes, order=HIGHEST_ORDER))
            elif kind == "c":
                added.append(draft.polynomial(symbol, polynomial(symbol), "u", *factors, sign=-1))
            else:
                signed = powers[symbol][0] * (sign if len(axes) == 2 else 1)
                added.append(draft.polynomial(symbol, (signed,), "", *factors))
        last = [] if by_matrix else [factor(f"a_{axis}")]
        draft.sum(f"k_{axis}", *added, *last)


def conventions(spec: AccelerometerRecipe) -> tuple[str, ...]:
    """Sense of the accelerometers."""
    return (f"accelerometers in and out: {SENSE[spec.reference.convention]}",)

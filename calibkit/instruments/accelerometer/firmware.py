"""accel_k.json, accel_q.json, accel_affine.json → chain that corrects a triad: K-factor, K- and
Q-factor, or affine.
"""

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model, Record
from calibkit.firmware import as_firmware, exact
from calibkit.firmware.chain import Chain, Term
from calibkit.firmware.draft import Draft, factor, numbers
from calibkit.firmware.program import Program
from calibkit.firmware.sources import required_record
from calibkit.ingest.write_back import Applied
from calibkit.instruments.accelerometer import coefficient_files, forms
from calibkit.instruments.accelerometer.equation import Terms
from calibkit.instruments.accelerometer.numeric.affine_model import AXES, Entry, find_entry
from calibkit.instruments.accelerometer.numeric.k_factor import CROSS
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER

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
    compensation, convention = spec.compensation, spec.reference.convention
    (file,) = files(spec)
    record = required_record(records, file, spec)
    draft = Draft(padded=spec.export.layout == "padded")
    sign = -1 if convention == "specific_force" else 1
    valid = record.models[0].valid[forms.TEMPERATURE]
    middle, half = (
        draft.temperature(valid) if valid[1] > valid[0] else (Fraction(valid[0]), Fraction(0))
    )
    full = Fraction(spec.full_scale("accel_g"))
    for axis in AXES:
        meaning = f"indication of the {axis} accelerometer, {SENSE[convention]}"
        draft.indication(f"accel_{axis}_g", "g", meaning, FITTED_G, full, "ACCEL_BEYOND")
    entries: list[Entry] = []
    triad = record.models[0].form == forms.TRIAD.name
    if compensation == "affine" and triad:
        _triad(draft, record.models[0], (middle, half), sign)
    elif compensation == "affine":
        entries = _affine(draft, record.models[0], (middle, half), sign)
    else:
        _k(draft, record, (middle, half), sign)
    for axis in AXES:
        meaning = f"corrected component along {axis}, {SENSE[convention]}"
        draft.output(f"accel_{axis}_g", "g", f"k_{axis}", meaning)
    higher = any(entry.kind == "n" and entry.name in draft.tables for entry in entries)
    by_form = (
        "a = S(T) indication - Z(T), corrected = a - C(T) a"
        if triad
        else "corrected = M(T) (indication - b(T))"
    )
    formula = {
        "affine": by_form
        + (" + second- and third-order terms" if higher or _has_products(draft) else "")
        + ", in local g",
        "k": "corrected = S(T) indication - Z(T) - cross-axis terms (K-factor), in local g",
    }[compensation]
    return draft.chain([record.models[0].form], formula)


def files(spec: AccelerometerRecipe) -> tuple[str, ...]:
    """Coefficient files that the chain takes its coefficients from."""
    return (f"{coefficient_files.find_stage(spec.compensation)}.json",)


def _affine(
    draft: Draft, model: Model, mapping: tuple[Fraction, Fraction], sign: int
) -> list[Entry]:
    """Add M(u) (V − b(u)) and the higher orders to the draft and return the parameters; for
    specific force, b and the second-order terms change sign.
    """
    entries = [find_entry(c.name) for c in model.coefficients]
    powers: dict[str, list[Fraction]] = {entry.symbol: [] for entry in entries}
    for entry, c in zip(entries, model.coefficients, strict=True):
        powers[entry.symbol].append(Fraction(c.value))
    for entry in entries:
        if entry.kind == "b" and entry.power == 0:
            axis = AXES[entry.row]
            bias = exact.scale(exact.mapped(powers[entry.symbol], *mapping), Fraction(sign))
            draft.sum(
                axis,
                draft.polynomial(entry.symbol, bias, "u", sign=-1, order=HIGHEST_ORDER),
                factor(forms.COMPONENTS[entry.row]),
            )
    for row, axis in enumerate(AXES):
        higher = [e for e in entries if e.kind == "n" and e.row == row]
        linear = [e for e in entries if e.kind == "m" and e.row == row and e.power == 0]
        terms: list[list[Term]] = []
        # the largest terms last
        for entry in sorted(higher, key=lambda e: len(e.factors), reverse=True):
            turned = powers[entry.symbol][0] * (sign if len(entry.factors) == 2 else 1)
            factors = (forms.COMPONENTS[i] for i in entry.factors)
            terms.append(draft.polynomial(entry.symbol, (turned,), "", *factors))
        for entry in sorted(linear, key=lambda e: e.factors == (row,)):
            polynomial = exact.mapped(powers[entry.symbol], *mapping)
            own = AXES[entry.factors[0]]
            terms.append(draft.polynomial(entry.symbol, polynomial, "u", own, order=HIGHEST_ORDER))
        draft.sum(f"k_{axis}", *terms)
    return entries


def _triad(draft: Draft, model: Model, mapping: tuple[Fraction, Fraction], sign: int) -> None:
    """Add a = S(u) V - Z(u), then a - C(u) a and the higher orders, to the draft; for specific
    force, Z and the second-order terms change sign.
    """
    terms = Terms.named([c.name for c in model.coefficients])
    powers: dict[str, list[Fraction]] = {}
    for term, c in zip(terms.listed, model.coefficients, strict=True):
        powers.setdefault(term.symbol, []).append(Fraction(c.value))
    first = [term for term in terms.listed if term.power == 0]

    def polynomial(symbol: str, turned: int = 1) -> tuple[Fraction, ...]:
        return exact.scale(exact.mapped(powers[symbol], *mapping), Fraction(turned))

    for row, axis in enumerate(AXES):
        zero, scale = f"z_{axis}", f"k_{axis}"
        draft.sum(
            f"a_{axis}",
            draft.polynomial(f"zero_{axis}", polynomial(zero, sign), "u", sign=-1),
            draft.polynomial(f"scale_{axis}", polynomial(scale), "u", forms.COMPONENTS[row]),
        )
    for row, axis in enumerate(AXES):
        added: list[list[Term]] = []
        # the largest terms last
        for term in sorted(first, key=lambda t: len(t.factors), reverse=True):
            if term.axis != row or term.kind not in ("c", "n"):
                continue
            factors = [f"a_{AXES[k]}" for k in term.factors]
            if term.kind == "c":
                cross = polynomial(term.symbol)
                added.append(draft.polynomial(term.symbol, cross, "u", *factors, sign=-1))
            else:
                turned = powers[term.symbol][0] * (sign if len(factors) == 2 else 1)
                added.append(draft.polynomial(term.symbol, (turned,), "", *factors))
        draft.sum(f"k_{axis}", *added, factor(f"a_{axis}"))


def _has_products(draft: Draft) -> bool:
    """Whether the chain has second- or third-order terms."""
    return any(name.startswith("n_") for name in draft.tables)


def _k(draft: Draft, record: Record, mapping: tuple[Fraction, Fraction], sign: int) -> None:
    """Add S(u) V − Z(u) − K8 V′ − K9 V″ of each axis to the draft, V′ and V″ the other axes; the
    largest term is added last.
    """
    for own, axis in enumerate(AXES):
        model = record.model(forms.K_MODELS[own])
        scale = exact.mapped(numbers(model, *forms.SCALE_FACTOR), *mapping)
        zero = exact.scale(
            exact.mapped(numbers(model, *forms.ZERO_OFFSET), *mapping), Fraction(sign)
        )
        cross = zip(forms.CROSS, CROSS[own], strict=True)
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
            draft.polynomial(f"zero_{axis}", zero, "u", sign=-1),
            draft.polynomial(f"scale_{axis}", scale, "u", forms.COMPONENTS[own]),
        )


def correct_as_firmware(
    spec: AccelerometerRecipe, chain: Chain, quantised: Program, data: Path
) -> Applied:
    """Correct every row of a log as the exported firmware would, and add inclination and
    toolface.
    """

    def angles(found: Mapping[str, Array]) -> Mapping[str, Array]:
        vector = np.column_stack([found[f"accel_{axis}_g"] for axis in AXES])
        vector = attitude.gravity_positive(vector, spec.reference.convention)
        return {
            "inclination_deg": attitude.inclination(vector),
            "toolface_deg": attitude.toolface(vector),
        }

    return as_firmware.apply(spec, chain, quantised, data, angles)


def conventions(spec: AccelerometerRecipe) -> tuple[str, ...]:
    """Sense of the accelerometers."""
    return (f"accelerometers in and out: {SENSE[spec.reference.convention]}",)

"""accel_k.json, accel_q.json, accel_affine.json → chain that corrects a triad: K-factor, K- and
Q-factor, or affine.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from calibkit.firmware import as_firmware, exact
from calibkit.firmware.draft import Draft, factor, numbers
from calibkit.firmware.sources import required_record
from calibkit.instruments import Firmware
from calibkit.numeric import attitude

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from calibkit.arrays import Array
    from calibkit.coefficients import Model, Record
    from calibkit.firmware.chain import Chain, Term
    from calibkit.firmware.program import Program
    from calibkit.ingest.write_back import Applied
    from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe

AXES = "xyz"
FILES = {
    "affine": ("accel_affine.json",),
    "k": ("accel_k.json",),
    "kq": ("accel_k.json", "accel_q.json"),
}
"""Compensation → coefficient files that its chain takes its numbers from."""
LARGEST_G = Fraction(2)
"""Indication [g] beyond which it is clamped: a triad is calibrated in the field of the earth."""
CROSS = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}
"""Axes that K8 and K9 multiply."""
SENSE = {
    "gravity": "positive along gravity",
    "specific_force": "specific force, positive against gravity",
}


def chain(spec: AccelerometerRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain of the correction that the recipe names; indications and results have the recipe's sign
    convention.
    """
    compensation, convention = spec.compensation, spec.reference.convention
    record = required_record(records, FILES[compensation][0], spec)
    draft, sign = Draft(), -1 if convention == "specific_force" else 1
    valid = record.models[0].valid["temp_case_degc"]
    middle, half = (
        draft.temperature(valid) if valid[1] > valid[0] else (Fraction(valid[0]), Fraction(0))
    )
    for axis in AXES:
        meaning = f"indication of the {axis} accelerometer, {SENSE[convention]}"
        draft.input(f"accel_{axis}_g", "g", meaning, (-LARGEST_G, LARGEST_G), "ACCEL_CLAMPED")
    if compensation == "affine":
        forms = [_affine(draft, record.models[0], (middle, half), sign)]
    else:
        forms = [_k(draft, record, (middle, half), sign)]
    if compensation == "kq":
        forms.append(_q(draft, records["accel_q.json"].model("triad")))
    last = "q" if compensation == "kq" else "k"
    for axis in AXES:
        meaning = f"corrected component along {axis}, {SENSE[convention]}"
        draft.output(f"accel_{axis}_g", "g", f"{last}_{axis}", meaning)
    formula = {
        "affine": f"corrected = M(T) (indication - b(T)){_higher(draft)}, in local g",
        "k": "corrected = S(T) indication - Z(T) - cross-axis terms (K-factor), in local g",
        "kq": "corrected = Q (S(T) indication - Z(T)) (K-factor, then Q-factor), in local g",
    }[compensation]
    return draft.chain(forms, formula)


def _higher(draft: Draft) -> str:
    """What stands behind M and b where the model has it."""
    return (
        " + second- and third-order terms of the indication"
        if any(t.startswith("n_") for t in draft.tables)
        else ""
    )


def _affine(draft: Draft, model: Model, mapping: tuple[Fraction, Fraction], sign: int) -> str:
    """M(u) (V − b(u)) and the higher orders; specific force turns the sign of b and of the second
    order.
    """
    entries = {c.name: Fraction(c.value) for c in model.coefficients}

    def polynomial(stem: str) -> exact.Poly:
        raw = [entries[f"{stem}{k}"] for k in range(10) if f"{stem}{k}" in entries]
        return exact.mapped(raw, *mapping) if raw else ()

    for axis in AXES:
        bias = exact.scale(polynomial(f"b_{axis}"), Fraction(sign))
        draft.sum(
            axis, draft.polynomial(f"b_{axis}", bias, "u", sign=-1), factor(f"accel_{axis}_g")
        )
    for axis in AXES:
        terms: list[list[Term]] = []
        for name in sorted(
            (n for n in entries if n.startswith(f"n_{axis}_")), key=len, reverse=True
        ):
            factors = tuple(f"accel_{letter}_g" for letter in name.removeprefix(f"n_{axis}_"))
            turned = entries[name] * (sign if len(factors) == 2 else 1)
            terms.append(draft.polynomial(name, (turned,), "", *factors))
        others = [other for other in AXES if other != axis]
        terms += [
            draft.polynomial(f"m_{axis}{j}", polynomial(f"m_{axis}{j}"), "u", j)
            for j in (*others, axis)
        ]
        draft.sum(f"k_{axis}", *terms)
    return model.form


def _k(draft: Draft, record: Record, mapping: tuple[Fraction, Fraction], sign: int) -> str:
    """S(u) V − Z(u) − K8 V − K9 V of each axis, the largest term last."""
    for axis in AXES:
        model = record.model(f"accel_{axis}")
        scale = exact.mapped(numbers(model, "K0", "K1", "K2", "K3"), *mapping)
        zero = exact.scale(
            exact.mapped(numbers(model, "K4", "K5", "K6", "K7"), *mapping), Fraction(sign)
        )
        draft.sum(
            f"k_{axis}",
            *(
                draft.polynomial(
                    f"{name.lower()}_{axis}", numbers(model, name), "", f"accel_{other}_g", sign=-1
                )
                for name, other in zip(("K8", "K9"), CROSS[axis], strict=True)
            ),
            draft.polynomial(f"zero_{axis}", zero, "u", sign=-1),
            draft.polynomial(f"scale_{axis}", scale, "u", f"accel_{axis}_g"),
        )
    return record.models[0].form


def _q(draft: Draft, model: Model) -> str:
    """Exact form of the Q-factor: lower triangular, from Q1, Q2, Q3 by the unit axes that have
    them.
    """
    q1, q2, q3 = numbers(model, "Q1", "Q2", "Q3")
    ye1, ze2, ze1 = -q3, -q1, q3 * q1 - q2
    ye2, ze3 = exact.sqrt(1 - ye1**2), exact.sqrt(1 - ze1**2 - ze2**2)
    rows = {
        "x": (Fraction(1), Fraction(0), Fraction(0)),
        "y": (-ye1 / ye2, 1 / ye2, Fraction(0)),
        "z": ((ze2 * ye1 / ye2 - ze1) / ze3, -ze2 / (ye2 * ze3), 1 / ze3),
    }
    for axis, row in rows.items():
        entries = zip(AXES, row, strict=True)
        draft.sum(
            f"q_{axis}", *(draft.polynomial(f"q_{axis}{j}", (c,), "", f"k_{j}") for j, c in entries)
        )
    return model.form


def apply(spec: AccelerometerRecipe, chain: Chain, quantised: Program, data: Path) -> Applied:
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


FIRMWARE = Firmware(
    files=lambda spec: FILES[spec.compensation],
    chain=chain,
    apply=apply,
    conventions=lambda spec: (f"accelerometers in and out: {SENSE[spec.reference.convention]}",),
)

"""bias.json, gyro_scale.json, inclinometer_scale.json → chains without memory."""

from __future__ import annotations

import re
from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING

from calibkit import units
from calibkit.errors import OutputError
from calibkit.firmware import exact
from calibkit.firmware.chain import Output, Quotient
from calibkit.firmware.draft import BEYOND, Draft, factor, numbers, powers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.coefficients import Model, Record
    from calibkit.firmware.chain import Chain

TEMPERATURE = "temp_case_degc"
RATE = "table_rate_dps"
MARGIN = Fraction(21, 20)
"""Rates beyond the fitted ones by this factor are still counts that a gyro may give."""


def bias(record: Record, reference_degc: float) -> Chain:
    """Bias of each channel, zero at the reference temperature (the middle of an abscissa that is
    none).
    """
    draft = Draft()
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
            draft.ranges.append(f"{column} {valid[0]:.6g} to {valid[1]:.6g} {unit}")
            draft.map("u", column, valid, flag="TEMP_CLAMPED")
        low, high = (Fraction(limit) for limit in valid)
        reference = Fraction(reference_degc) if column.endswith("_degc") else (low + high) / 2
        found = exact.mapped(powers(model, "p"), middle, half)
        at_rest = exact.value(found, (min(max(reference, low), high) - middle) / half)
        terms = draft.polynomial(f"p_{name}", exact.add(found, (-at_rest,)), "u")
        if not terms:
            raise OutputError(
                f"{name}: the bias does not vary", hint="there is nothing to correct: leave it out"
            )
        source = draft.sum(f"bias_{name}", terms)
        meaning = f"bias of {name}, to be subtracted from it"
        draft.outputs.append(Output(f"bias_{name}", units.column_unit(name), source, meaning))
    return draft.chain(
        [model.form for model in record.models],
        "corrected = indication - bias, each channel in its unit",
    )


def inclinometer(record: Record) -> Chain:
    """s(T) of each gyro, which multiplies its indication; a station's own s is the matter of its
    solution.
    """
    draft = Draft()
    for model in record.models:
        raw, name = powers(model, "s"), f"s_{model.name}"
        valid, over = model.valid.get(TEMPERATURE), ""
        if valid is not None:
            over = "u"
            if not draft.inputs:
                draft.temperature(valid)
            raw = exact.mapped(raw, *exact.span(*valid))
        source = draft.sum(name, draft.polynomial(f"{name}_of_t", raw, over))
        meaning = f"scale factor of the {model.name} gyro, to be multiplied with its indication"
        draft.outputs.append(Output(f"scale_{model.name}", "1", source, meaning))
    return draft.chain(
        [model.form for model in record.models], "corrected = scale * indication, for each gyro"
    )


def gyro(
    scale: Record, orthogonality: Record | None, gyros: Sequence[tuple[str, str]], added_dps: float
) -> Chain:
    """Rates of gyros, (F − F0(T))/K(T); of a pair also the rate across the first gyro's axis in
    their plane.

    `gyros` are names of columns and models; added_dps [°/s] is the earth's rate where the recipe
    leaves it in.
    """
    draft, models = Draft(), {model.name: model for model in scale.models}
    forms = []
    for column, name in gyros:
        line = scale.model(name)
        forms.append(line.form)
        if f"{name}.response" in models:
            raise OutputError(
                f"{name}: a response that is not a straight line has no firmware form",
                hint="fit with response = 'line'",
            )
        K, F0, over = _line(draft, line, models, column)
        _rate(draft, line, (K, F0), over, column, added_dps)
    if orthogonality is not None:
        forms.append(_across(draft, orthogonality.model("pair"), [column for column, _ in gyros]))
    end = ", the earth's rate left in" if added_dps else ", zero at rest on the laboratory's table"
    return draft.chain(forms, f"rate = (indication - F0(T)) / K(T), in deg/s{end}")


def _line(
    draft: Draft, line: Model, models: dict[str, Model], column: str
) -> tuple[exact.Poly, exact.Poly, str]:
    """K and F0 as polynomials of u (or plain numbers), and the name of u."""
    curves = [models.get(f"{line.name}.{letter}_over_temperature") for letter in ("K", "F0")]
    found = [model for model in curves if model is not None]
    if len(found) < 2:
        return numbers(line, "K"), numbers(line, "F0"), ""
    over = f"u_{column}"
    middle, half = draft.temperature(found[0].valid[TEMPERATURE], over)
    K, F0 = (exact.mapped(powers(model, "p"), middle, half) for model in found)
    return K, F0, over


def _rate(
    draft: Draft,
    line: Model,
    curves: tuple[exact.Poly, exact.Poly],
    over: str,
    column: str,
    added_dps: float,
) -> None:
    """Rate of one gyro."""
    (K, F0), fastest = curves, max(abs(Fraction(limit)) for limit in line.valid[RATE])
    largest = Fraction(ceil(MARGIN * fastest * sum(map(abs, K)) + sum(map(abs, F0))))
    name = f"gyro_{column}_lsb"
    draft.input(
        name,
        "1/s",
        f"indication of gyro {column}, counts per second",
        (-largest, largest),
        "RATE_CLAMPED",
    )
    low, high = line.valid[RATE]
    draft.ranges.append(f"rate of gyro {column} {low:.4g} to {high:.4g} deg/s")
    draft.sum(
        f"above_{column}", draft.polynomial(f"zero_{column}", F0, over, sign=-1), factor(name)
    )
    draft.sum(f"scale_{column}", draft.polynomial(f"scale_factor_{column}", K, over))
    source = f"rate_{column}"
    draft.steps.append(Quotient(source, f"above_{column}", f"scale_{column}"))
    if added_dps:
        earth = draft.polynomial("earth_rate", (Fraction(added_dps),), "")
        source = draft.sum(f"inertial_{column}", earth, factor(source))
    draft.outputs.append(
        Output(f"gyro_{column}_dps", "deg/s", source, f"rate about the axis of gyro {column}")
    )


def _across(draft: Draft, pair: Model, columns: Sequence[str]) -> str:
    """Misalignment: from the rates about both axes that about the axis at right angles to the first
    in their plane.
    """
    (gamma,) = numbers(pair, "gamma")
    if abs(gamma) < 1:
        first, second = (output.source for output in draft.outputs)
        sine = exact.sqrt(1 - gamma**2)
        source = draft.sum(
            "across",
            draft.polynomial("misalignment_first", (-gamma / sine,), "", first),
            draft.polynomial("misalignment_second", (1 / sine,), "", second),
        )
        meaning = f"rate about the axis at right angles to gyro {columns[0]} in the plane of both"
        draft.outputs.append(Output(f"gyro_{columns[1]}_orthogonal_dps", "deg/s", source, meaning))
    return pair.form

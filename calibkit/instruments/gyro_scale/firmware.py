"""gyro_scale.json and gyro_orthogonality.json → chains without memory: rates about the gyros' own
axes.
"""

from __future__ import annotations

from fractions import Fraction
from math import ceil
from typing import TYPE_CHECKING

from calibkit.errors import OutputError
from calibkit.firmware import as_firmware, exact
from calibkit.firmware.chain import Quotient
from calibkit.firmware.draft import Draft, factor, numbers, powers
from calibkit.firmware.sources import required_record
from calibkit.instruments import Firmware

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.coefficients import Model, Record
    from calibkit.firmware.chain import Chain
    from calibkit.instruments.gyro_scale.recipe import (
        GyroPairRecipe,
        OwnAxisRecipe,
        RateTableRecipe,
    )

FILES = ("gyro_scale.json", "gyro_orthogonality.json")
TEMPERATURE = "temp_case_degc"
RATE = "table_rate_dps"
MARGIN = Fraction(21, 20)
"""Rates beyond the fitted ones by this factor are still counts that a gyro may give."""


def pair_chain(spec: GyroPairRecipe, records: Mapping[str, Record]) -> Chain:
    """Rates of both gyros about their own axes, and the rate across the first in their plane."""
    scale, angles = (required_record(records, name, spec) for name in FILES)
    models = (("a", "a_about_a"), ("b", "b_about_b"))
    return _chain(scale, angles, models, _earth_rate(scale, spec))


def rate_table_chain(spec: RateTableRecipe, records: Mapping[str, Record]) -> Chain:
    """Rates of gyros about their own axes."""
    scale = required_record(records, FILES[0], spec)
    models = [(gyro, f"gyro_{gyro}") for gyro in spec.gyros]
    return _chain(scale, None, models, _earth_rate(scale, spec))


def _earth_rate(record: Record, spec: OwnAxisRecipe) -> float:
    """Earth's rate about the laboratory's table axis [°/s], where the recipe leaves it in the
    result.
    """
    if spec.compensation == "laboratory":
        return 0.0
    for condition in record.conditions:
        if condition.name == "earth_rate_about_table_axis":
            return condition.value
    raise OutputError(
        "the run does not know the earth's rate about its table axis",
        hint="fit with [site] latitude_deg",
    )


def _chain(
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
    draft.output(f"gyro_{column}_dps", "deg/s", source, f"rate about the axis of gyro {column}")


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
        draft.output(f"gyro_{columns[1]}_orthogonal_dps", "deg/s", source, meaning)
    return pair.form


PAIR = Firmware(files=lambda _: FILES, chain=pair_chain, apply=as_firmware.apply)
RATE_TABLE = Firmware(files=lambda _: FILES[:1], chain=rate_table_chain, apply=as_firmware.apply)

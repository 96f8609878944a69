"""gyro_orthogonality.json and gyro_scale.json of three gyros over three axes → chain to rates about
the axes of their base.
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
from calibkit.instruments.gyro_scale.firmware import FILES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.coefficients import Model, Record
    from calibkit.firmware.chain import Chain
    from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe

AXES = "xyz"
TEMPERATURE, RATE = "temp_case_degc", "table_rate_dps"
MARGIN = Fraction(21, 20)
"""Rates beyond the fitted ones by this factor are still counts that a gyro may give."""
Matrix = list[list[exact.Poly]]


def chain(spec: GyroTriadRecipe, records: Mapping[str, Record]) -> Chain:
    """Rates S(T)⁻¹ (F − B(T)): the inverse by cofactors, each an exact polynomial of u, over the
    determinant.

    Raises OutputError for another number of gyros than three, unknown biases, or gyros that do not
    sense three axes.
    """
    scale, angles = (required_record(records, name, spec) for name in FILES)
    triad, gyros = angles.model("triad"), spec.gyros
    if len(gyros) != len(AXES):
        raise OutputError(
            f"{len(gyros)} gyros over three axes", hint="the firmware form is for three gyros"
        )
    if f"B_{gyros[0]}" not in [c.name for c in triad.coefficients]:
        raise OutputError(
            "the run does not know the biases of its gyros: they are mixed with the earth's rate",
            hint="fit with [site] latitude_deg",
        )
    draft = Draft()
    S, B = _curves(draft, scale, triad, gyros)
    _indications(draft, triad, gyros, S, B)
    _inverse(draft, S, gyros)
    for axis in AXES:
        draft.output(
            f"rate_{axis}_dps", "deg/s", f"rate_{axis}", f"rate about axis {axis} of the base"
        )
    return draft.chain(
        [triad.form], "rate = S(T)^-1 (indication - B(T)), in deg/s about the axes of the base"
    )


def _curves(
    draft: Draft, scale: Record, triad: Model, gyros: Sequence[str]
) -> tuple[Matrix, list[exact.Poly]]:
    """Sensitivities [gyro][axis] and biases [gyro] as polynomials of u, or plain numbers."""
    models = {model.name: model for model in scale.models}
    curves = [[models.get(f"{g}_about_{axis}.K_over_temperature") for axis in AXES] for g in gyros]
    biases = [models.get(f"{g}.bias_over_temperature") for g in gyros]
    known = [model for model in (*curves[0], *curves[1], *curves[2], *biases) if model is not None]
    if len(known) < len(AXES) * len(gyros) + len(gyros):
        S = [[numbers(triad, f"S_{g}{axis}") for axis in AXES] for g in gyros]
        return S, [numbers(triad, f"B_{g}") for g in gyros]
    middle, half = draft.temperature(known[0].valid[TEMPERATURE])
    mapped = [exact.mapped(powers(model, "p"), middle, half) for model in known]
    return [mapped[3 * g : 3 * g + 3] for g in range(3)], mapped[9:]


def _indications(
    draft: Draft, triad: Model, gyros: Sequence[str], S: Matrix, B: Sequence[exact.Poly]
) -> None:
    """Indications above their biases."""
    low, high = triad.valid[RATE]
    draft.ranges.append(f"rate about each axis {low:.4g} to {high:.4g} deg/s")
    fastest = MARGIN * max(abs(Fraction(low)), abs(Fraction(high)))
    for gyro, row, bias in zip(gyros, S, B, strict=True):
        steepest = max(sum(map(abs, entry), Fraction(0)) for entry in row)
        largest = Fraction(ceil(fastest * steepest + sum(map(abs, bias), Fraction(0))))
        name = f"gyro_{gyro}_lsb"
        draft.input(
            name,
            "1/s",
            f"indication of gyro {gyro}, counts per second",
            (-largest, largest),
            "RATE_CLAMPED",
        )
        draft.sum(
            f"above_{gyro}", draft.polynomial(f"bias_{gyro}", bias, "u", sign=-1), factor(name)
        )


def _inverse(draft: Draft, S: Matrix, gyros: Sequence[str]) -> None:
    """Cofactors and determinant, divided by the determinant in the middle of the range, and the
    rates.
    """
    cofactors = [[_cofactor(S, g, a) for a in range(3)] for g in range(3)]
    determinant = exact.add(*(exact.product(S[0][a], cofactors[0][a]) for a in range(3)))
    middle = determinant[0]
    if middle == 0:
        raise OutputError(
            "the gyros do not sense three axes", hint="log a gyro of the missing direction too"
        )
    varies = len(exact.trimmed(determinant)) > 1
    if varies:
        draft.sum(
            "determinant",
            draft.polynomial("determinant_of_s", exact.scale(determinant, 1 / middle), "u"),
        )
    for a, axis in enumerate(AXES):
        terms = [
            draft.polynomial(
                f"inverse_{axis}{gyro}",
                exact.scale(cofactors[g][a], 1 / middle),
                "u",
                f"above_{gyro}",
            )
            for g, gyro in enumerate(gyros)
        ]
        terms.sort(
            key=lambda term: (
                abs(draft.tables[term[0].table][0]) if term and term[0].table else Fraction(0)
            )
        )
        name = draft.sum(f"numerator_{axis}" if varies else f"rate_{axis}", *terms)
        if varies:
            draft.steps.append(Quotient(f"rate_{axis}", name, "determinant"))


def _cofactor(S: Matrix, row: int, column: int) -> exact.Poly:
    """Signed minor of a matrix of polynomials."""
    (i, j), (k, m) = ([n for n in range(3) if n != skipped] for skipped in (row, column))
    minor = exact.add(
        exact.product(S[i][k], S[j][m]), exact.scale(exact.product(S[i][m], S[j][k]), Fraction(-1))
    )
    return exact.scale(minor, Fraction((-1) ** (row + column)))


FIRMWARE = Firmware(files=lambda _: FILES, chain=chain, apply=as_firmware.apply)

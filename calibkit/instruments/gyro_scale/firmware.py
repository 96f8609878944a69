"""gyro_scale.json and gyro_orthogonality.json → chains without memory, in exact arithmetic.

    ω = (F − F0(T))/K(T)                       a gyro about its own axis
    ω_⊥ = (ω_b − γ ω_a)/√(1 − γ²)              a pair, at right angles to a in the plane of both
    Ω = S(T)⁻¹ (F − B(T)) = adj S (F − B)/det S    three gyros about the axes of their base

F indication, γ = cos α of the angle between the axes of a pair.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import ceil

from calibkit.errors import OutputError
from calibkit.firmware import exact
from calibkit.firmware.chain import Chain
from calibkit.firmware.draft import Draft, factor, numbers, powers
from calibkit.firmware.sources import required_record
from calibkit.firmware.steps import Quotient
from calibkit.instruments.gyro_scale.forms import (
    AXES,
    ORTHOGONALITY_FILE,
    RATE,
    SCALE_FILE,
    TEMPERATURE,
    GyroMatrix,
    gyro_column,
    read_earth_rate,
    read_matrices,
)
from calibkit.instruments.gyro_scale.recipe import (
    AnyRecipe,
    GyroPairRecipe,
    GyroTriadRecipe,
    RateTableRecipe,
)
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.records.coefficients import Record

MARGIN = Fraction(21, 20)
"""Factor by which an indication may exceed that of the fastest fitted rate before its status says
so.
"""
Polynomials = list[list[exact.Poly]]


def files(spec: AnyRecipe) -> tuple[str, ...]:
    """Coefficient files that the chain takes its coefficients from."""
    return (SCALE_FILE,) if isinstance(spec, RateTableRecipe) else (SCALE_FILE, ORTHOGONALITY_FILE)


def chain(spec: AnyRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain of the rates S(T)⁻¹ (F − B(T)) about the axes of a base, or (F − F0(T))/K(T) of gyros;
    for a pair also the rate perpendicular to the first gyro's axis, in the plane of both axes.

    Raises OutputError where the models have no firmware form.
    """
    for name in files(spec):
        required_record(records, name, spec)
    matrices = read_matrices(spec, records)
    if isinstance(spec, GyroTriadRecipe):
        return _chain_about_base(spec, matrices[0])
    earth_dps = read_earth_rate(spec, records, OutputError)
    draft = Draft(padded=spec.export.layout == "padded")
    full_scale_dps = Fraction(spec.full_scale("rate_dps"))
    for matrix in matrices:
        if matrix.response is not None:
            raise OutputError(
                f"{matrix.model.name}: a response that is not a straight line has no firmware form",
                hint="fit with response = 'line'",
            )
        (gyro,) = matrix.gyros
        abscissa = f"u_{gyro}" if matrix.curves else ""
        ((K,),), (F0,) = _polynomials(draft, matrix, abscissa)
        _add_indication(draft, matrix, gyro, ([K], F0), full_scale_dps)
        low, high = matrix.model.valid[RATE]
        draft.ranges.append(f"rate of gyro {gyro} {exact.limits_text(low, high)} deg/s")
        terms = draft.polynomial(f"zero_{gyro}", F0, abscissa, sign=-1)
        draft.sum(f"above_{gyro}", terms, factor(gyro_column(gyro)))
        draft.sum(f"scale_{gyro}", draft.polynomial(f"scale_factor_{gyro}", K, abscissa))
        source = f"rate_{gyro}"
        draft.steps.append(Quotient(source, f"above_{gyro}", f"scale_{gyro}"))
        if earth_dps:
            source = draft.sum(
                f"inertial_{gyro}",
                draft.polynomial("earth_rate", (Fraction(earth_dps),), ""),
                factor(source),
            )
        draft.output(matrix.outputs[0], "deg/s", source, f"rate about the axis of gyro {gyro}")
    forms = [matrix.model.form for matrix in matrices]
    if isinstance(spec, GyroPairRecipe):
        pair = records[ORTHOGONALITY_FILE].model("pair")
        forms.append(pair.form)
        (gamma,) = numbers(pair, "gamma")
        if abs(gamma) < 1:
            # ω_⊥, from the rates about both axes and γ
            first, second = (output.source for output in draft.outputs)
            sine, gyros = exact.sqrt(1 - gamma**2), spec.gyros
            source = draft.sum(
                "across",
                draft.polynomial("misalignment_first", (-gamma / sine,), "", first),
                draft.polynomial("misalignment_second", (1 / sine,), "", second),
            )
            meaning = f"rate about the axis at right angles to gyro {gyros[0]} in the plane of both"
            draft.output(f"gyro_{gyros[1]}_orthogonal_dps", "deg/s", source, meaning)
    end = ", the earth's rate left in" if earth_dps else ", zero at rest on the laboratory's table"
    return draft.chain(forms, f"rate = (indication - F0(T)) / K(T), in deg/s{end}")


def _chain_about_base(spec: GyroTriadRecipe, matrix: GyroMatrix) -> Chain:
    """Chain of the rates about the axes of the base: S inverted by cofactors, each an exact
    polynomial of u, over the determinant.
    """
    if len(matrix.gyros) != len(AXES):
        raise OutputError(
            f"{len(matrix.gyros)} gyros over three axes",
            hint="the firmware form is for three gyros",
        )
    matrix.require_biases(OutputError)
    draft = Draft(padded=spec.export.layout == "padded")
    full_scale_dps = Fraction(spec.full_scale("rate_dps"))
    S, B = _polynomials(draft, matrix, "u")
    low, high = matrix.model.valid[RATE]
    draft.ranges.append(f"rate about each axis {exact.limits_text(low, high)} deg/s")
    for gyro, row, bias in zip(matrix.gyros, S, B, strict=True):
        _add_indication(draft, matrix, gyro, (row, bias), full_scale_dps)
        terms = draft.polynomial(f"bias_{gyro}", bias, "u", sign=-1)
        draft.sum(f"above_{gyro}", terms, factor(gyro_column(gyro)))
    # cofactors and determinant, both divided by the determinant at mid-range
    cofactors = [[_cofactor(S, g, a) for a in range(3)] for g in range(3)]
    determinant = exact.add(*(exact.product(S[0][a], cofactors[0][a]) for a in range(3)))
    middle = determinant[0]
    if middle == 0:
        raise OutputError(
            "the gyros do not sense three axes", hint="log a gyro of the missing direction too"
        )
    varies = len(determinant if draft.padded else exact.trimmed(determinant)) > 1
    if varies:
        draft.sum(
            "determinant",
            draft.polynomial("determinant_of_s", exact.scale(determinant, 1 / middle), "u"),
        )
    for a, axis in enumerate(AXES):
        others_first = sorted(range(len(matrix.gyros)), key=lambda g: g == a)
        products = [
            draft.polynomial(
                f"inverse_{axis}{matrix.gyros[g]}",
                exact.scale(cofactors[g][a], 1 / middle),
                "u",
                f"above_{matrix.gyros[g]}",
            )
            for g in others_first
        ]
        name = draft.sum(f"numerator_{axis}" if varies else f"rate_{axis}", *products)
        if varies:
            draft.steps.append(Quotient(f"rate_{axis}", name, "determinant"))
    for axis, output in zip(AXES, matrix.outputs, strict=True):
        draft.output(output, "deg/s", f"rate_{axis}", f"rate about axis {axis} of the base")
    return draft.chain(
        [matrix.model.form],
        "rate = S(T)^-1 (indication - B(T)), in deg/s about the axes of the base",
    )


def _polynomials(
    draft: Draft, matrix: GyroMatrix, abscissa: str
) -> tuple[Polynomials, list[exact.Poly]]:
    """Sensitivities [gyro][axis] and biases [gyro] as polynomials of u, or as constants."""
    if matrix.curves:
        middle, half = draft.temperature(matrix.curves[0].valid[TEMPERATURE], abscissa)
        order = HIGHEST_ORDER if draft.padded else 0
        constants = [
            exact.padded(exact.mapped(powers(model, "p"), middle, half), order)
            for model in matrix.curves
        ]
    else:
        constants = [numbers(matrix.model, name) for name in matrix.names]
    axes, gyros = len(matrix.outputs), len(matrix.gyros)
    rows = [constants[axes * g : axes * (g + 1)] for g in range(gyros)]
    return rows, constants[axes * gyros :]


def _add_indication(
    draft: Draft,
    matrix: GyroMatrix,
    gyro: str,
    sensed: tuple[Sequence[exact.Poly], exact.Poly],
    full_scale_dps: Fraction,
) -> None:
    """Add the indication of a gyro to the draft, with the ranges that the fastest fitted rate and
    the full scale about any axis give.
    """
    row, bias = sensed
    fastest = MARGIN * max(abs(Fraction(limit)) for limit in matrix.model.valid[RATE])
    steepest = max(sum(map(abs, entry), Fraction(0)) for entry in row)
    bias_reach = sum(map(abs, bias), Fraction(0))
    fitted, full = (
        Fraction(ceil(rate * steepest + bias_reach)) for rate in (fastest, full_scale_dps)
    )
    meaning = f"indication of gyro {gyro}, counts per second"
    draft.indication(gyro_column(gyro), "1/s", meaning, fitted, full, "RATE_BEYOND")


def _cofactor(S: Polynomials, row: int, column: int) -> exact.Poly:
    """Signed minor of a matrix of polynomials."""
    (i, j), (k, m) = ([n for n in range(3) if n != skipped] for skipped in (row, column))
    minor = exact.add(
        exact.product(S[i][k], S[j][m]), exact.scale(exact.product(S[i][m], S[j][k]), Fraction(-1))
    )
    return exact.scale(minor, Fraction((-1) ** (row + column)))

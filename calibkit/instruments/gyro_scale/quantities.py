"""Results of a run as quantities, which certificates state and comparisons compare:
K(T) and F0(T) over temperature, F = K Ω + F0 over rate, F = S Ω + B of a triad (`forms`), and
N, ε, γ and α of a pair (`published`, (2)).

    dγ/dα = −sin α, dε/dα = −N sin α        how type B terms on α enter γ and ε
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from calibkit.certificate.quantities import (
    Quantity,
    QuantityInput,
    ResultLimit,
    coefficient,
    numbered,
    of_figure,
    of_form,
    polynomial,
    ranged,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.compensate import TEMPERATURE_SLACK
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroTriadRecipe

PPM = 1e-6
OF_THESE_RUNS = Words(
    "U leaves out how the scale factor repeats from run to run", "U 未包含各测次间标度因数的重复性"
)


PAIR_WORDS = {
    "N": ("N", Words("ratio of the scale factors", "标度因数比")),
    "epsilon": ("ε", Words("projection ratio", "投影比")),
    "gamma": ("γ", Words("orthogonality coefficient", "正交系数")),
    "alpha_deg": ("α", Words("angle between the axes", "两轴夹角")),
}
"""Coefficient of a pair → its symbol and its name."""


def is_cross(name: str) -> bool:
    """Whether a line, or the curve of a line, is of a gyro about another gyro's axis."""
    gyro, separator, axis = name.partition(".")[0].partition("_about_")
    return bool(separator) and gyro != axis


def over_temperature(record: Record, model: Model, letter: str) -> Quantity:
    """K or F0 of a line, or a bias, over temperature."""
    point = polynomial(model, numbered("p", model), forms.TEMPERATURE)
    inputs, unit = (ranged(model, forms.TEMPERATURE),), model.coefficients[0].unit
    return Quantity(
        *("value", record.stage, model.name, Words(letter), unit, inputs, point),
        symbol=letter,
        principal=not is_cross(model.name),
    )


def temperature_of_line(line: Model) -> float:
    """Mean case temperature [°C] of the runs of a line."""
    values = {parameter.name: parameter.value for parameter in line.parameters}
    return values.get("temp_case", sum(line.valid[forms.TEMPERATURE]) / 2.0)


def of_line(record: Record, line: Model, letter: str, words: Words) -> Quantity:
    """K or F0 of a line at the mean temperature of its runs: an error of the thermometer moves it
    by the slope of its curve, where one was fitted. Principal is the mean over the runs of a gyro
    about its own axis.
    """
    quantity, gyro = coefficient(record, line, letter, words), line.name.partition(".")[0]
    for model in record.models:
        if model.name == forms.curve_name(gyro, letter) and forms.TEMPERATURE in line.valid:
            degc = temperature_of_line(line)
            curve = np.polynomial.Polynomial([c.value for c in model.coefficients])
            slopes = {forms.TEMPERATURE: (degc, -float(curve.deriv()(degc)))}
            quantity = coefficient(record, line, letter, words, slopes)
    if letter == "F0" or is_cross(line.name):
        return quantity
    return replace(quantity, undecided=undecided_scale(record), principal="." not in line.name)


def list_pair(record: Record, model: Model) -> list[Quantity]:
    """N, ε, γ and α of a pair; errors of table rate and time base cancel in these ratios, an error
    of α enters ε and γ.
    """
    quantities = []
    for c in model.coefficients:
        symbol, words = PAIR_WORDS[c.name]
        ratio = coefficient(record, model, c.name, words, by_angle(model, c.name))
        undecided = undecided_scale(record) if c.name in {"N", "epsilon"} else None
        quantities.append(replace(ratio, symbol=symbol, principal=True, undecided=undecided))
    return quantities


def hold_within_runs(records: Iterable[Record]) -> bool:
    """Whether scale factors hold within their runs: nothing tells how they repeat, which files of
    gyros about several axes state.
    """
    return any(figure.name == forms.WITHIN_RUNS for record in records for figure in record.figures)


def undecided_scale(record: Record) -> Words | None:
    """Why no limit on a scale factor, or on the ratio of two, is decided; None where one is."""
    return OF_THESE_RUNS if hold_within_runs([record]) else None


def sensitivity_name(gyro: str, axis: str) -> str:
    """Name of the scale factor of a gyro about an axis of the base, or about its own."""
    return "K_" + "_about_".join(filter(None, (gyro, axis)))


def by_angle(model: Model, name: str) -> dict[str, tuple[float, float]]:
    """Value of α, and derivative of γ = cos α, ε = N γ or 90° − α by it, through which type B terms
    on alpha_deg enter them.
    """
    alpha = model.value("alpha_deg")
    slope = -math.sin(math.radians(alpha)) * math.pi / 180.0
    slopes = {
        "gamma": slope,
        "epsilon": model.value("N") * slope,
        "orthogonality_error_deg": -1.0,
    }
    return {"alpha_deg": (alpha, slopes[name])} if name in slopes else {}


def list_sensitivities(records: Mapping[str, Record], spec: AnyRecipe) -> Iterator[Quantity]:
    """Scale factor of each gyro about its own axis, for a triad about all three axes: over
    temperature where that was fitted, else near the temperature of the runs. They are compared,
    under names that runs with and without temperature share.
    """
    record = records[forms.SCALE_FILE]
    triad = isinstance(spec, GyroTriadRecipe)
    for matrix in forms.read_matrices(spec, records):
        reference = matrix.reference[0]
        file = records[forms.ORTHOGONALITY_FILE] if triad else record
        for k, name in enumerate(matrix.names[: reference.size]):
            g, a = divmod(k, len(matrix.outputs))
            gyro, axis = matrix.gyros[g], forms.AXES[a] if triad else ""
            if matrix.curves:
                K = over_temperature(record, matrix.curves[k], "K")
            else:
                temperature_input = ranged(matrix.model, forms.TEMPERATURE)
                low = temperature_input.low - TEMPERATURE_SLACK
                high = temperature_input.high + TEMPERATURE_SLACK
                temperature_logged = forms.TEMPERATURE in matrix.model.valid
                K = replace(
                    coefficient(file, matrix.model, name, Words(name)),
                    inputs=(QuantityInput(temperature_input.column, low, high),)
                    * temperature_logged,
                )
            if axis in ("", gyro):
                K = replace(K, undecided=undecided_scale(record))
            key = "max_scale_factor_error_ppm"
            if triad:
                key = "max_rate_error_ppm" if gyro == axis else "max_cross_axis_ppm"
            ppm, limit = getattr(spec.acceptance, key, None), None
            if ppm is not None:
                # the largest change, of the own scale factor
                limit = ResultLimit(f"acceptance.{key}", ppm * PPM * float(abs(reference[g]).max()))
            yield replace(
                K,
                name=sensitivity_name(gyro, axis),
                model="",
                words=Words(f"scale factor of gyro {gyro}{axis and f' about {axis}'}"),
                compared=(({},),),
                limit=limit,
                relative=not triad or gyro == axis,
                called=(
                    K.key,
                    f"{K.model}.{K.name}",
                    K.name,
                ),
            )


def _of_scales(record: Record) -> Iterator[Quantity]:
    """Each line over rate (of a gyro over several runs, their mean), each zero-rate indication over
    temperature, each response.
    """
    over_rate = {form.name: form for form in (forms.LINE, forms.RESPONSE, forms.RESPONSE_1)}
    for model in record.models:
        if model.form == POLYNOMIAL.name and ".K_" not in model.name:
            yield over_temperature(record, model, "F0")
        of_run = model.form == forms.LINE.name and "." in model.name
        if model.form not in over_rate or of_run:
            continue
        columns = (forms.RATE,) if model.form == forms.LINE.name else tuple(model.valid)
        inputs = tuple(ranged(model, column) for column in columns)
        point = of_form(over_rate[model.form], model, inputs)
        words = Words("indication", "示值")
        quantity = Quantity("F", record.stage, model.name, words, "1/s", inputs, point)
        if model.form == forms.RESPONSE_1.name:
            words = Words("indicated rate", "示值角速率")
            quantity = replace(quantity, name="rate", words=words, unit="deg/s", compared=(({},),))
        yield quantity


def _of_angles(record: Record, spec: AnyRecipe) -> Iterator[Quantity]:
    """N, ε, γ, α of a pair; indications of a triad over the rates, and the angles between axes."""
    largest = getattr(spec.acceptance, "max_orthogonality_error_deg", None)
    limit = (
        None
        if largest is None
        else ResultLimit(
            "acceptance.max_orthogonality_error_deg", None, 90.0 - largest, 90.0 + largest
        )
    )
    for model in record.models:
        if model.form == forms.PAIR.name:
            *ratios, angle = list_pair(record, model)
            yield from ratios
            yield replace(angle, compared=(({},),), limit=limit)
        elif model.name == "triad":
            rate = ranged(model, forms.RATE)
            inputs = tuple(replace(rate, column=f"rate_{axis}_dps") for axis in forms.AXES)
            about_x = [c.name for c in model.coefficients if c.name.endswith(forms.AXES[0])]
            gyros = [name[2:-1] for name in about_x if name.startswith("S_")]
            for row, gyro in enumerate(gyros):
                point, words = of_form(forms.TRIAD, model, inputs, row), Words(f"indication {gyro}")
                yield Quantity(f"F_{gyro}", record.stage, model.name, words, "1/s", inputs, point)
    dof = min((float(model.dof) for model in record.models), default=1.0)
    for figure in record.figures:
        kind, _, pair = figure.name.partition(".")
        if kind == "angle_deg" and "." not in pair:
            words = Words(f"angle between the axes of gyros {pair.replace('_', ' and ')}")
            angle = of_figure(record, figure, words, dof=dof)
            yield replace(angle, compared=(({},),), limit=limit)


def results(records: Mapping[str, Record], spec: AnyRecipe) -> tuple[Quantity, ...]:
    """Sensitivities, then what each model gives by itself."""
    angles = records.get(forms.ORTHOGONALITY_FILE)
    return (
        *list_sensitivities(records, spec),
        *_of_scales(records[forms.SCALE_FILE]),
        *(_of_angles(angles, spec) if angles is not None else ()),
    )

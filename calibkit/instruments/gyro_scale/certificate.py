"""Results of a run of gyros on a rate table as quantities of `published`, (2), `equation`, (1), and
`forms`, which comparisons and `evaluate` read; and the blocks that a certificate states them in.

    F = K(T) Ω + … + F0(T)            scale factors and figures of each gyro, over temperature
    N, ε, γ = cos α                   of a pair;  dγ/dα = −sin α, dε/dα = −N sin α
    F = S Ω + B                       of a triad, unit vectors and the angles between them

The derivatives by α are how type B terms on α enter γ and ε. Each block prints its equation.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from calibkit.certificate.blocks import (
    COEFFICIENT_NOTE,
    column_results,
    list_coefficients,
    make_block,
    plot,
    tabulate,
)
from calibkit.certificate.names import name_model, name_subject, show_symbol
from calibkit.certificate.quantities import (
    At,
    Point,
    Quantity,
    QuantityInput,
    ResultLimit,
    coefficient,
    numbered,
    of_figure,
    of_form,
    polynomial,
    ranged,
    state,
)
from calibkit.certificate.results import (
    Block,
    CertificateFigure,
    Equation,
    GridTable,
    ListTable,
    Result,
)
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words
from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.published import PPM, FigureName
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroTriadRecipe
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.numeric.noise.confidence import chi_square_limits
from calibkit.records.coefficients import Figure, Model, Record
from calibkit.records.forms import POLYNOMIAL
from calibkit.units import unit_mark

EQUATIONS = (
    Equation(
        forms.LINE.name,
        r"F = K\,\Omega + F_0",
        Words(
            "F indication [1/s], Ω table rate [°/s], K scale factor [1/°]; "
            "F₀ holds the bias and the earth's rate about the table axis."
        ),
    ),
    Equation(
        POLYNOMIAL.name,
        r"p(T) = \sum_k p_k T^k",
        Words("T case temperature [°C]."),
    ),
    Equation(
        forms.RESPONSE.name,
        r"F = K(T)\,\Omega + \sum_k (c_k + d_k x + e_k x^2) (\Omega/\Omega_{\max})^k + F_0(T)",
        Words("x case temperature mapped to −1 … 1, Ω_max largest rate that was fitted."),
    ),
    Equation(
        forms.PAIR.name,
        r"N = \frac{K_B}{K_A}, \quad \varepsilon = \frac{K_{Ba}}{K_A}, \quad \gamma ="
        r" \frac{\varepsilon}{N} = \cos\alpha",
        Words(
            "K_A, K_B scale factors about the gyros' own axes, K_Ba that of B about A's axis, α the"
            " angle between the two axes."
        ),
    ),
    Equation(
        forms.TRIAD.name,
        r"\mathbf{F} = \mathbf{S}\,\boldsymbol{\Omega} + \mathbf{F}_0, \quad \mathbf{u}_g ="
        r" \mathbf{s}_g / |\mathbf{s}_g|, "
        r"\quad \cos\alpha_{gh} = \mathbf{u}_g \cdot \mathbf{u}_h",
        Words(
            "F indications [1/s], Ω rate about the axes of the base [°/s]; the rows of S are the"
            " sensitivities of the gyros."
        ),
    ),
)
"""What a block prints of the model forms that it states."""
NAMES = {
    "scale_factor": Words("scale factor"),
    "nonlinearity_full_scale": Words("nonlinearity, of full scale"),
    "nonlinearity_per_point": Words("nonlinearity, per point"),
    "linearity_error_rms": Words("linearity error, rms"),
    "asymmetry": Words("asymmetry"),
    "threshold": Words("threshold, at most: smallest rate driven"),
    "dead_zone": Words("dead zone"),
    "resolution": Words("resolution, at most: smallest step driven"),
    "repeatability": Words("repeatability"),
    "temperature_sensitivity": Words("temperature sensitivity"),
    "bias": Words("bias"),
}
"""Figure → its term in the standards."""
LETTERS = {"K": NAMES["scale_factor"], "F0": Words("zero-rate indication")}
"""Coefficient of a line → its term."""
COEFFICIENT_OF = {"scale_factor": "K", "bias": "F0"}
"""Figure → coefficient of a line that it restates."""
ANGLE = "angle_deg"
"""Figures of angles between input axes, and name of type B terms on the angles between the axes of
the table.
"""
MAGNITUDES = {
    "nonlinearity_full_scale",
    "nonlinearity_per_point",
    "linearity_error_rms",
    "asymmetry",
    "repeatability",
}
"""Figures that are magnitudes and cannot be negative."""
PAIR_WORDS = {
    "N": ("N", Words("ratio of the scale factors")),
    "epsilon": ("ε", Words("projection ratio")),
    "gamma": ("γ", Words("orthogonality coefficient")),
    "alpha_deg": ("α", Words("angle between the axes")),
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
        *("value", record.stage, model.name, Words.literal(letter), unit, inputs, point),
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
    curve_name = forms.curve_name(line.name.partition(".")[0], letter)
    slopes = {}
    for model in record.models:
        if model.name == curve_name and forms.TEMPERATURE in line.valid:
            degc = temperature_of_line(line)
            curve = np.polynomial.Polynomial([c.value for c in model.coefficients])
            # a thermometer that reads too high assigns the value to too high a temperature
            slopes = {forms.TEMPERATURE: (degc, -float(curve.deriv()(degc)))}
    quantity = coefficient(record, line, letter, words, slopes)
    if letter == "F0" or is_cross(line.name):
        return quantity
    return replace(quantity, undecided=undecided_scale(record), principal="." not in line.name)


def undecided_scale(record: Record) -> Words | None:
    """Why no limit on a scale factor, or on the ratio of two, is decided: scale factors hold within
    their runs, where nothing tells how they repeat; None where one is.
    """
    if not any(figure.name == forms.WITHIN_RUNS for figure in record.figures):
        return None
    return Words("U leaves out how the scale factor repeats from run to run")


def across(record: Record, quantity: Quantity, slope: float) -> Quantity:
    """A result across an axis of the table, or between two: an error of the angle between table
    axes moves it by its derivative [unit/°], and no limit on it is decided while neither a
    component of the files nor a type B term states how a mounting repeats.
    """

    def point(input_values: At) -> Point:
        without = quantity.point(input_values)
        # axes of a table are meant to be square
        return replace(without, influences={**without.influences, ANGLE: (90.0, slope)})

    undecided: Words | None = None
    components = [part for model in record.models for part in model.components]
    if not any(part.group == "mounting" for part in components):
        undecided = Words("U leaves out how a mounting on the table repeats")
    return replace(quantity, point=point, undecided=undecided, completed_by=(ANGLE, quantity.name))


def about_axis(record: Record, quantity: Quantity, s: Array, axis: int) -> Quantity:
    """Scale factor of a gyro about one of the axes that it was turned about, s [axes] those about
    all: dK/dα = |s⊥| about an axis across its own, s⊥ what is not about this one.
    """
    if axis == int(np.argmax(np.abs(s))):
        return replace(quantity, undecided=undecided_scale(record))
    return across(record, quantity, math.radians(np.linalg.norm(np.delete(s, axis))))


def sensitivity_name(gyro: str, axis: str) -> str:
    """Name of the scale factor of a gyro about an axis of the base, or about its own."""
    return "K_" + "_about_".join(filter(None, (gyro, axis)))


def by_angle(model: Model, name: str) -> dict[str, tuple[float, float]]:
    """Value of α, and derivative of γ = cos α, ε = N γ or 90° − α by it, through which type B terms
    on alpha_deg enter them.
    """
    alpha = model.value("alpha_deg")
    # dγ/dα, per degree
    slope = -math.sin(math.radians(alpha)) * math.pi / 180.0
    slopes = {
        "gamma": slope,
        "epsilon": model.value("N") * slope,
        "orthogonality_error_deg": -1.0,
    }
    return {"alpha_deg": (alpha, slopes[name])} if name in slopes else {}


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


def of_direction(record: Record, figure: Figure, words: Words, dof: float) -> Quantity:
    """Angle between the input axes of two gyros, or a component u of the unit vector of one, which
    an error of the angle between table axes turns as much: du/dα = √(1 − u²).
    """
    slope = 1.0
    if not figure.name.startswith(ANGLE):
        # a component that rounding took beyond 1 turns by nothing
        slope = math.radians(math.sqrt(max(1.0 - figure.value**2, 0.0)))
    return across(record, of_figure(record, figure, words, dof=dof), slope)


def list_sensitivities(records: Mapping[str, Record], spec: AnyRecipe) -> Iterator[Quantity]:
    """Scale factor of each gyro about its own axis, for a triad about all three axes: over
    temperature where that was fitted, else near the temperature of the runs. They are compared,
    under names that runs with and without temperature share.
    """
    triad = isinstance(spec, GyroTriadRecipe)
    scales = records[forms.SCALE_FILE]
    record = records[forms.ORTHOGONALITY_FILE] if triad else scales
    for matrix in forms.read_matrices(spec, records):
        S, _ = matrix.reference
        near: tuple[QuantityInput, ...] = ()
        if forms.TEMPERATURE in matrix.model.valid:
            low, high = matrix.model.valid[forms.TEMPERATURE]
            # without a curve over temperature K holds near its runs
            slack = forms.TEMPERATURE_SLACK
            near = (QuantityInput(forms.TEMPERATURE, low - slack, high + slack),)
        for k, name in enumerate(matrix.names[: S.size]):
            g, a = divmod(k, len(matrix.outputs))
            gyro, axis = matrix.gyros[g], forms.AXES[a] if triad else ""
            if matrix.curves:
                K = over_temperature(scales, matrix.curves[k], "K")
            else:
                K = replace(coefficient(record, matrix.model, name), inputs=near)
            K = about_axis(record, K, S[g], a)
            own_K = float(np.abs(S[g]).max())
            is_own_axis = a == int(np.argmax(np.abs(S[g])))
            key = "max_scale_factor_error_ppm"
            if triad:
                key = "max_rate_error_ppm" if is_own_axis else "max_cross_axis_ppm"
            ppm = getattr(spec.acceptance, key, None)
            yield replace(
                K,
                name=sensitivity_name(gyro, axis),
                model="",
                words=Words.literal(f"scale factor of gyro {gyro}{axis and f' about {axis}'}"),
                compared=(({},),),
                # errors across the axes are relative to the own scale factor, as rates are
                limit=None if ppm is None else ResultLimit(f"acceptance.{key}", ppm / PPM * own_K),
                relative=is_own_axis,
                called=(K.key, f"{K.model}.{K.name}", K.name),
            )


def results(records: Mapping[str, Record], spec: AnyRecipe) -> tuple[Quantity, ...]:
    """Sensitivities, then what each model gives by itself: indication over rate of each line (of a
    gyro in several runs, of their mean), response and triad, zero-rate indication over temperature,
    N, ε, γ and α of a pair, and angles between the axes of a triad.
    """
    quantities = [*list_sensitivities(records, spec)]
    scales = records[forms.SCALE_FILE]
    over_rate = {form.name: form for form in (forms.LINE, forms.RESPONSE, forms.RESPONSE_1)}
    for model in scales.models:
        if model.form == POLYNOMIAL.name and ".K_" not in model.name:
            quantities.append(over_temperature(scales, model, "F0"))
        is_line = model.form == forms.LINE.name
        if model.form not in over_rate or (is_line and "." in model.name):
            continue
        columns = (forms.RATE,) if is_line else tuple(model.valid)
        inputs = tuple(ranged(model, column) for column in columns)
        point = of_form(over_rate[model.form], model, inputs)
        words = Words("indication")
        quantity = Quantity("F", scales.stage, model.name, words, "1/s", inputs, point)
        if model.form == forms.RESPONSE_1.name:
            words = Words("indicated rate")
            quantity = replace(quantity, name="rate", words=words, unit="deg/s", compared=(({},),))
        quantities.append(quantity)
    if forms.ORTHOGONALITY_FILE not in records:
        return tuple(quantities)
    angles = records[forms.ORTHOGONALITY_FILE]
    key, limit = "max_orthogonality_error_deg", None
    largest = getattr(spec.acceptance, key, None)
    if largest is not None:
        limit = ResultLimit(f"acceptance.{key}", None, 90.0 - largest, 90.0 + largest)
    for model in angles.models:
        if model.form == forms.PAIR.name:
            *ratios, angle = list_pair(angles, model)
            quantities += [*ratios, replace(angle, compared=(({},),), limit=limit)]
        elif model.name == "triad":
            rate = ranged(model, forms.RATE)
            inputs = tuple(replace(rate, column=f"rate_{axis}_dps") for axis in forms.AXES)
            for row, gyro in enumerate(forms.list_gyros(model)):
                point, words = (
                    of_form(forms.TRIAD, model, inputs, row),
                    Words.literal(f"indication {gyro}"),
                )
                indication = (f"F_{gyro}", angles.stage, model.name, words, "1/s", inputs, point)
                quantities.append(Quantity(*indication))
    dof = min((float(model.dof) for model in angles.models), default=1.0)
    for figure in angles.figures:
        kind, _, pair = figure.name.partition(".")
        if kind == ANGLE and "." not in pair:
            words = Words.literal(f"angle between the axes of gyros {pair.replace('_', ' and ')}")
            angle = of_direction(angles, figure, words, dof)
            quantities.append(replace(angle, compared=(({},),), limit=limit))
    return tuple(quantities)


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Blocks of scale factors and, for several gyros, of angles and misalignment."""
    laid_out = []
    if forms.SCALE_FILE in basis.records:
        laid_out.append(_state_scale(basis, basis.records[forms.SCALE_FILE]))
    if forms.ORTHOGONALITY_FILE in basis.records:
        angles = basis.records[forms.ORTHOGONALITY_FILE]
        pair = any(model.form == forms.PAIR.name for model in angles.models)
        laid_out.append((_state_pair if pair else _state_triad)(basis, angles))
    return tuple(laid_out)


def _block(
    record: Record,
    title: Words,
    tables: Sequence[ListTable | GridTable],
    notes: Sequence[Words],
    figures: Sequence[CertificateFigure] = (),
) -> Block:
    """Block of a file with the equations of its models."""
    of_record = {model.form for model in record.models}
    equations = [equation for equation in EQUATIONS if equation.form in of_record]
    return make_block(record, title, equations, tables, figures, dict.fromkeys(notes))


def _state_pair(basis: Stated, record: Record) -> Block:
    """Block of N, ε, γ, α and 90° − α."""
    pair, figures = record.model("pair"), {figure.name: figure for figure in record.figures}
    *ratios, alpha = (state(basis, quantity, {}) for quantity in list_pair(record, pair))
    if alpha.uncertainty is not None:
        U = alpha.uncertainty.expanded_uncertainty
        # no angle between two axes lies outside 0° … 180°
        if not (alpha.value - U > 0.0 and alpha.value + U < 180.0):
            # first-order u(α) diverges at 0° and 180°; the ends of γ know of no type B terms
            low, high = (figures[f"alpha_{end}_95_deg"].value for end in ("low", "high"))
            low, high = min(low, max(alpha.value - U, 0.0)), max(high, min(alpha.value + U, 180.0))
            alpha = replace(alpha, interval=(low, high))
    error = figures["orthogonality_error_deg"]
    words, slopes = (
        Words("orthogonality error 90° − α"),
        by_angle(pair, error.name),
    )
    orthogonality_error = of_figure(record, error, words, dof=pair.dof, slopes=slopes)
    stated = (*ratios, alpha, state(basis, orthogonality_error, {}))
    side = Words("Gyro B lies on the same side as gyro A.")
    if figures["side"].value < 0.0:
        side = Words("Gyro B lies on the side opposite to gyro A (α > 90°).")
    notes = [side, range_words(pair)]
    if figures["clamped"].value:
        notes.append(Words("|γ| was beyond 1 by noise and is clamped."))
    title = Words("Orthogonality of the gyro pair")
    return _block(record, title, (ListTable(Words("Orthogonality"), stated),), notes)


def _state_scale(basis: Stated, record: Record) -> Block:
    """Block of lines, curves over temperature and figures."""
    lines = [model for model in record.models if model.form == forms.LINE.name]
    labels, cells = _label_lines(lines), []
    for line in lines:
        of_K_and_F0 = [
            state(basis, of_line(record, line, letter, words), {})
            for letter, words in LETTERS.items()
        ]
        if forms.TEMPERATURE in line.valid:
            at = ((forms.TEMPERATURE, temperature_of_line(line), "degC"),)
            of_K_and_F0 = [replace(result, at=at) for result in of_K_and_F0]
        cells.append(tuple(of_K_and_F0))
    tables: list[ListTable | GridTable] = [
        GridTable(
            Words("Scale factor and zero-rate indication"),
            Words("gyro, run"),
            (Words.literal("K"), Words.literal("F₀")),
            ("1/deg", "1/s"),
            tuple(labels.values()),
            tuple(cells),
        )
    ]
    figures: list[CertificateFigure] = []
    notes = [residual_words(line) for line in lines]
    if len(lines) > 8:  # one note for all
        rms, dof = sorted(line.residual_rms for line in lines), min(line.dof for line in lines)
        span = f"{rms[0]:.2g} … {rms[-1]:.2g} {unit_mark(lines[0].residual_unit)}"
        notes = [
            Words(
                "Residual rms of the {count} fits {span}, at least {dof} degrees of freedom"
                " (descriptors, not uncertainties).",
                count=len(lines),
                span=span,
                dof=dof,
            )
        ]
    for model in record.models:
        if model.form == forms.LINE.name:
            continue
        values = [over_temperature(record, model, "p")] * (model.form == POLYNOMIAL.name)
        title = Words("{model}: coefficients", model=name_model(model.name))
        tables.append(list_coefficients(basis, record, model, title, values))
        notes += [range_words(model), *basis.left_out(model)]
    for letter in LETTERS:
        columns = [
            (name_subject(f".{model.name}"), over_temperature(record, model, letter))
            for model in record.models
            if model.form == POLYNOMIAL.name and f".{letter}_" in model.name
        ]
        symbol = show_symbol(letter)
        title = Words("{symbol} over temperature", symbol=symbol)
        table = tabulate(basis, title, columns) if columns else None
        if table is None:
            continue
        tables.append(table)
        if letter == "F0":
            figures.append(plot(table, Words.literal("F₀ [1/s]")))
            continue
        # K from the middle point of each column, in ppm of the largest K
        K = [[result.value for _, result in column_results(table, k)] for k in range(len(columns))]
        middles = [values[len(values) // 2] if values else 0.0 for values in K]
        largest = max((abs(value) for values in K for value in values), default=1.0)
        label = Words("change of K [ppm]")
        figures.append(plot(table, label, origins=middles, scale=PPM / largest))
    tables += _tabulate_figures(basis, record, labels)
    title = Words("Scale factors on the rate table")
    return _block(record, title, tables, notes, figures)


def _label_lines(lines: Sequence[Model]) -> dict[str, Words]:
    """Name of a line → gyro, log or all of them, and case temperature, or its range where that of
    the runs differs.
    """
    runs_of = Counter(line.name.partition(".")[0] for line in lines if "." in line.name)
    labels = {}
    for line in lines:
        label, log, runs = name_subject(f".{line.name}"), line.name.partition(".")[2], ""
        if log:
            label += Words(", {log}", log=log)
        elif runs_of[line.name] > 1:  # those at other temperatures by the curve through them
            runs = f"{runs_of[line.name]}"
            label += Words(", all {runs} runs, weighted", runs=runs)
        if forms.TEMPERATURE in line.valid:
            low, high = line.valid[forms.TEMPERATURE]
            degc = (
                f"{low:.1f} … {high:.1f}"
                if high - low > 1.0
                else f"{temperature_of_line(line):.1f}"
            )
            label += Words.literal(f" ({degc} °C)".replace("(-", "(−").replace("… -", "… −"))
        labels[line.name] = label
    return labels


def _tabulate_figures(
    basis: Stated, record: Record, labels: Mapping[str, Words]
) -> Iterator[GridTable]:
    """Tables of figures in the standards' terms: rows are figures, columns are lines, by their
    labels; lines with the same figures stand side by side.
    """
    results_of: dict[str, dict[tuple[str, str, str], Result]] = {}
    for figure in record.figures:
        kind, standard, line_name = FigureName.of(figure.name)
        if line_name not in labels:
            continue
        line = record.model(line_name)
        dof = float(line.dof)
        if kind in COEFFICIENT_OF:  # the figure is the coefficient of the line, with its U
            dof = next(line.dof_of(c) for c in line.coefficients if c.name == COEFFICIENT_OF[kind])
        if kind == "repeatability":
            runs = {p.name: p.value for p in line.parameters}.get("runs", 2.0)
            dof = max(runs - 1.0, 1.0)
        quantity = of_figure(record, figure, NAMES[kind], dof=dof)
        quantity = replace(quantity, standard=standard, magnitude=kind in MAGNITUDES)
        row, result = (kind, standard, figure.unit), state(basis, quantity, {})
        if kind == "repeatability":  # a standard deviation over runs
            low, high = chi_square_limits(np.array(figure.value), np.array(dof), gum.TWO_SIGMA)
            result = replace(result, interval=(float(low), float(high)))
        results_of.setdefault(line_name, {})[row] = result
    alike: dict[tuple[tuple[str, str, str], ...], list[str]] = {}
    for name in labels:
        if name in results_of:
            alike.setdefault(tuple(results_of[name]), []).append(name)
    for rows, names in alike.items():
        yield GridTable(
            Words("Figures of the scale factor"),
            Words(""),
            tuple(labels[name] for name in names),
            tuple(unit for _, _, unit in rows),
            tuple(
                NAMES[kind] + Words.literal(f" {standard}".rstrip()) for kind, standard, _ in rows
            ),
            tuple(tuple(results_of[name][row] for name in names) for row in rows),
            by_row=True,
        )


def _state_triad(basis: Stated, record: Record) -> Block:
    """Block of runs about three axes: the rows of S, the unit vectors and the angles, a row of each
    for each gyro and temperature.
    """
    figures = {figure.name: figure for figure in record.figures}
    about = tuple(Words("about {axis}", axis=axis) for axis in forms.AXES)
    gyros = forms.list_gyros(record.model("triad"))
    pairs = [f"{g}_{h}" for g, h in combinations(gyros, 2)]
    between = tuple(Words.literal(pair.replace("_", " – ")) for pair in pairs)
    words_of = {
        "S": Words("Sensitivities about the axes of the base"),
        "misalignment": Words("Unit vectors of the input axes"),
        ANGLE: Words("Angles between the input axes"),
    }
    direction_words = {
        "misalignment": Words("unit vectors of the input axes"),
        ANGLE: Words("angles between the input axes"),
    }
    heads = {"S": about, "misalignment": tuple(map(Words, forms.AXES)), ANGLE: between}
    units = {"S": "1/deg", "misalignment": "1", ANGLE: "deg"}
    rows: dict[str, dict[str, list[Result]]] = {kind: {} for kind in words_of}
    notes: list[Words] = []
    for triad in [model for model in record.models if model.form == forms.TRIAD.name]:
        suffix, place = triad.name.removeprefix("triad"), triad.name
        if forms.TEMPERATURE in triad.valid:
            place = f"{sum(triad.valid[forms.TEMPERATURE]) / 2.0:.1f} °C".replace("-", "−")
        components = [(gyro, f"{gyro}{axis}") for gyro in gyros for axis in forms.AXES]
        directions = [("misalignment", f"{gyro} ({place})", name) for gyro, name in components]
        directions += [(ANGLE, f"({place})", pair) for pair in pairs]
        for kind, row, name in directions:
            figure = figures[f"{kind}.{name}{suffix}"]
            direction = of_direction(record, figure, direction_words[kind], triad.dof)
            result = state(basis, direction, {}, principal=kind == ANGLE and not suffix)
            rows[kind].setdefault(row, []).append(result)
        for gyro in gyros:
            names = [f"S_{gyro}{axis}" for axis in forms.AXES]
            s = np.array([triad.value(name) for name in names])
            for a, name in enumerate(names):
                K = coefficient(record, triad, name, Words("sensitivity"))
                principal = not suffix and a == int(np.argmax(np.abs(s)))
                result = state(basis, about_axis(record, K, s, a), {}, principal=principal)
                rows["S"].setdefault(f"{gyro} ({place})", []).append(result)
        notes += [residual_words(triad), range_words(triad)]
    tables = [
        GridTable(
            words_of[kind],
            Words("gyro"),
            heads[kind],
            (units[kind],) * len(heads[kind]),
            tuple(of_kind),
            tuple(map(tuple, of_kind.values())),
            COEFFICIENT_NOTE if kind == "S" else None,
        )
        for kind, of_kind in rows.items()
    ]
    title = Words("Sensitivities and angles of the gyros")
    return _block(record, title, tables, notes)

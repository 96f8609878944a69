"""Rate-table results: scale factors and figures of each gyro, K and F0 over temperature; N, ε, γ
and α of a pair; sensitivities, unit vectors of the input axes and the angles between them for three
axes.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

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
from calibkit.certificate.quantities import NO_SLOPES, coefficient, of_figure, state
from calibkit.certificate.results import (
    Block,
    CertificateFigure,
    Equation,
    GridTable,
    ListTable,
    Result,
)
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words, unit_mark
from calibkit.coefficients import Figure as StatedFigure, Model, Record
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale import forms, quantities
from calibkit.instruments.gyro_scale.published import PPM, FigureName

MOST_NOTES = 8
"""Largest number of models with a note for each; more share one note."""

LINE_EQUATION = Equation(
    forms.LINE.name,
    r"F = K\,\Omega + F_0",
    Words(
        "F indication [1/s], Ω table rate [°/s], K scale factor [1/°]; "
        "F₀ holds the bias and the earth's rate about the table axis.",
        "F 为示值 [1/s]，Ω 为转台角速率 [°/s]，K 为标度因数 [1/°]；"
        "F₀ 含零偏与地球自转在转台轴上的分量。",
    ),
)
PAIR_EQUATION = Equation(
    forms.PAIR.name,
    r"N = \frac{K_B}{K_A}, \quad \varepsilon = \frac{K_{Ba}}{K_A}, \quad \gamma ="
    r" \frac{\varepsilon}{N} = \cos\alpha",
    Words(
        "K_A, K_B scale factors about the gyros' own axes, K_Ba that of B about A's axis, α the"
        " angle between the two axes.",
        "K_A、K_B 为各陀螺绕自身轴的标度因数，K_Ba 为 B 绕 A 轴的标度因数，α 为两轴夹角。",
    ),
)
TRIAD_EQUATION = Equation(
    forms.TRIAD.name,
    r"\mathbf{F} = \mathbf{S}\,\boldsymbol{\Omega} + \mathbf{F}_0, \quad \mathbf{u}_g ="
    r" \mathbf{s}_g / |\mathbf{s}_g|, "
    r"\quad \cos\alpha_{gh} = \mathbf{u}_g \cdot \mathbf{u}_h",
    Words(
        "F indications [1/s], Ω rate about the axes of the base [°/s]; the rows of S are the"
        " sensitivities of the gyros.",
        "F 为示值 [1/s]，Ω 为绕基准轴的角速率 [°/s]，S 的各行为各陀螺的灵敏度。",
    ),
)
CURVE_EQUATION = Equation(
    POLYNOMIAL.name,
    r"p(T) = \sum_k p_k T^k",
    Words("T case temperature [°C].", "T 为壳温 [°C]。"),
)
NAMES = {
    "scale_factor": Words("scale factor", "标度因数"),
    "nonlinearity_full_scale": Words("nonlinearity, of full scale", "非线性度（满量程）"),
    "nonlinearity_per_point": Words("nonlinearity, per point", "非线性度（逐点）"),
    "linearity_error_rms": Words("linearity error, rms", "线性误差均方根"),
    "asymmetry": Words("asymmetry", "不对称度"),
    "threshold": Words(
        "threshold, at most: smallest rate driven", "阈值（不大于：最小试验角速率）"
    ),
    "dead_zone": Words("dead zone", "死区"),
    "resolution": Words(
        "resolution, at most: smallest step driven",
        "分辨率（不大于：最小角速率增量）",
    ),
    "repeatability": Words("repeatability", "重复性"),
    "temperature_sensitivity": Words("temperature sensitivity", "温度灵敏度"),
    "bias": Words("bias", "零偏"),
}
"""Figure → its term in the standards."""
F0_LABEL = Words("F₀ [1/s]")
GYRO = Words("gyro", "陀螺")
ANGLE = "angle_deg"
"""Figures of angles between input axes, and quantity of type B terms on the angles between the axes
of the table.
"""
MAGNITUDES = {
    "nonlinearity_full_scale",
    "nonlinearity_per_point",
    "linearity_error_rms",
    "asymmetry",
    "repeatability",
}
"""Figures that are magnitudes and cannot be negative."""
ONE_TEMPERATURE_DEGC = 1.0
"""Span of the runs' case temperatures [°C] above which both ends are printed instead of the mean.
"""


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Blocks of scale factors and, for several gyros, of angles and misalignment."""
    found = (
        (forms.SCALE_FILE, _state_scale),
        (forms.ORTHOGONALITY_FILE, _state_angles),
    )
    return tuple(
        state(stated, stated.records[name]) for name, state in found if name in stated.records
    )


def _state_scale(stated: Stated, record: Record) -> Block:
    """Block of lines, curves over temperature and figures."""
    lines = [model for model in record.models if model.form == forms.LINE.name]
    others = [model for model in record.models if model.form != forms.LINE.name]
    curves = [model for model in others if model.form == POLYNOMIAL.name]
    letters = {"K": NAMES["scale_factor"], "F0": Words("zero-rate indication", "零速率示值")}
    labels = _label_lines(lines)
    of_lines = GridTable(
        Words("Scale factor and zero-rate indication", "标度因数与零速率示值"),
        Words("gyro, run", "陀螺、测次"),
        (Words("K"), Words("F₀")),
        ("1/deg", "1/s"),
        tuple(labels.values()),
        tuple(
            tuple(_state_of_line(stated, record, model, *entry) for entry in letters.items())
            for model in lines
        ),
    )
    tables: list[ListTable | GridTable] = [of_lines]
    figures: list[CertificateFigure] = []
    notes: list[Words] = []
    for model in others:
        title = name_model(model.name) + Words(": coefficients", "：系数")
        values = []
        if model.form == POLYNOMIAL.name:
            values.append(quantities.over_temperature(record, model, "p"))
        tables.append(list_coefficients(stated, record, model, title, values))
        notes += [range_words(model), *stated.left_out(model)]
    for letter in ("K", "F0"):
        columns = [
            (name_subject(f".{model.name}"), quantities.over_temperature(record, model, letter))
            for model in curves
            if f".{letter}_" in model.name
        ]
        title = Words(f"{show_symbol(letter)} over temperature", f"{show_symbol(letter)} 随温度")
        table = tabulate(stated, title, columns) if columns else None
        if table is not None:
            tables.append(table)
            figures.append(_plot_change(table) if letter == "K" else plot(table, F0_LABEL))
    tables += _tabulate_figures(stated, record, labels)
    return make_block(
        record,
        Words("Scale factors on the rate table", "转台标度因数"),
        (LINE_EQUATION, CURVE_EQUATION) if curves else (LINE_EQUATION,),
        tables,
        figures,
        (*_many_residuals(lines), *dict.fromkeys(notes)),
    )


def _state_of_line(
    stated: Stated, record: Record, line: Model, letter: str, words: Words
) -> Result:
    """K or F0 of a line at the mean temperature of its runs: an error of the thermometer moves it
    by the slope of its curve, where one was fitted. Principal is the mean over the runs of a gyro
    about its own axis.
    """
    slopes, at = NO_SLOPES, _find_temperature(line)
    name = f"{line.name.partition('.')[0]}.{letter}_over_temperature"
    curve = next((model for model in record.models if model.name == name), None)
    if curve is not None and at is not None:
        slope = np.polynomial.Polynomial([c.value for c in curve.coefficients]).deriv()(at[0][1])
        slopes = {forms.TEMPERATURE: (at[0][1], -float(slope))}
    principal = letter == "K" and "." not in line.name and not quantities.is_cross(line.name)
    quantity = coefficient(record, line, letter, words, slopes)
    if letter == "K" and not quantities.is_cross(line.name):
        quantity = replace(quantity, undecided=quantities.undecided_scale(record))
    result = state(stated, quantity, {}, principal=principal)
    return result if at is None else replace(result, at=at)


def _find_temperature(model: Model) -> tuple[tuple[str, float, str], ...] | None:
    """Mean case temperature of a line's runs as a condition of the result; None where it was not
    logged.
    """
    if forms.TEMPERATURE not in model.valid:
        return None
    known = {parameter.name: parameter.value for parameter in model.parameters}
    return (
        (
            forms.TEMPERATURE,
            known.get("temp_case", sum(model.valid[forms.TEMPERATURE]) / 2.0),
            "degC",
        ),
    )


def _label_lines(models: Sequence[Model]) -> dict[str, Words]:
    """Labels of lines by their names: gyro and case temperature, or the range where its runs
    differ; where these are alike also the log, or that it is fitted to all runs.
    """
    found = {}
    runs = Counter(model.name.partition(".")[0] for model in models if "." in model.name)
    for model in models:
        subject, at = name_subject(f".{model.name}"), _find_temperature(model)
        own = Words("")
        if at is not None:
            low, high = model.valid[forms.TEMPERATURE]
            span = f"{low:.1f} … {high:.1f}"
            text = span if high - low > ONE_TEMPERATURE_DEGC else f"{at[0][1]:.1f}"
            own = Words(f" ({text} °C)".replace("(-", "(−").replace("… -", "… −"))
        log, count = model.name.partition(".")[2], runs[model.name]
        from_log = Words("")
        if log:
            from_log = Words(f", {log}", f"，{log}")
        elif count > 1:  # those at other temperatures by the curve through them
            from_log = Words(f", all {count} runs, weighted", f"，全部 {count} 次加权")
        found[model.name] = subject, from_log, own
    plain = [subject + at for subject, _, at in found.values()]
    return {
        name: subject + at if plain.count(subject + at) == 1 else subject + log + at
        for name, (subject, log, at) in found.items()
    }


def _plot_change(table: GridTable) -> CertificateFigure:
    """Departure of K over temperature from the middle point of each column, in ppm of the largest
    K.
    """
    columns = [
        [result.value for _, result in column_results(table, k)] for k in range(len(table.heads))
    ]
    largest = max((abs(K) for column in columns for K in column), default=1.0)
    middles = [column[len(column) // 2] if column else 0.0 for column in columns]
    label = Words("change of K [ppm]", "K 的变化 [ppm]")
    return plot(table, label, origins=middles, scale=PPM / largest)


def _tabulate_figures(
    stated: Stated, record: Record, names: Mapping[str, Words]
) -> list[ListTable | GridTable]:
    """Tables of figures in the standards' terms: rows are figures, columns are models, by their
    names.
    """
    kinds: dict[tuple[str, str, str], dict[str, Result]] = {}
    models = {model.name: model for model in record.models}
    for figure in record.figures:
        what, standard, model = FigureName.of(figure.name)
        words = NAMES.get(what, Words(what.replace("_", " ")))
        dof = float(models[model].dof) if model in models else math.inf
        if what == "repeatability" and model in models:
            # a standard deviation over runs
            runs = {p.name: p.value for p in models[model].parameters}.get("runs", 2.0)
            dof = max(runs - 1.0, 1.0)
        quantity = replace(
            of_figure(record, figure, words, dof=dof),
            standard=standard,
            magnitude=what in MAGNITUDES,
        )
        result = state(stated, quantity, {})
        kinds.setdefault((what, standard, figure.unit), {})[model] = result
    alike: dict[tuple[object, ...], list[str]] = {}
    for name in names:  # models with the same figures stand side by side
        alike.setdefault(tuple(kind for kind, row in kinds.items() if name in row), []).append(name)
    tables: list[ListTable | GridTable] = []
    for shown, group in alike.items():
        rows = [(kind, row) for kind, row in kinds.items() if kind in shown]
        table = GridTable(
            Words("Figures of the scale factor", "标度因数特征量"),
            Words(""),
            tuple(names[name] for name in group),
            tuple(unit for (_, _, unit), _ in rows),
            tuple(NAMES.get(w, Words(w)) + Words(f" {s}" if s else "") for (w, s, _), _ in rows),
            tuple(tuple(row.get(name) for name in group) for _, row in rows),
            by_row=True,
        )
        tables += [table] if shown else []
    return tables


def _many_residuals(models: Sequence[Model]) -> tuple[Words, ...]:
    """Notes on fit residuals: one per model, or a common one for more than MOST_NOTES models."""
    if len(models) <= MOST_NOTES:
        return tuple(map(residual_words, models))
    rms = sorted(model.residual_rms for model in models)
    unit, dof = unit_mark(models[0].residual_unit), min(model.dof for model in models)
    return (
        Words(
            f"Residual rms of the {len(models)} fits {rms[0]:.2g} … {rms[-1]:.2g} {unit}, "
            f"at least {dof} degrees of freedom (descriptors, not uncertainties).",
            f"{len(models)} 次拟合的残差均方根 {rms[0]:.2g} … {rms[-1]:.2g} {unit}，"
            f"自由度不少于 {dof}（仅为描述量，并非不确定度）。",
        ),
    )


def _state_angles(stated: Stated, record: Record) -> Block:
    """Block of gyro_orthogonality.json, for a pair or for runs about three axes."""
    if any(model.form == forms.PAIR.name for model in record.models):
        return _state_pair(stated, record)
    models = [model for model in record.models if model.form == forms.TRIAD.name]
    tables = (
        _tabulate_sensitivities(stated, record, models),
        *(
            _tabulate_sets(stated, record, models, what, title, unit)
            for what, title, unit in (
                ("misalignment", Words("Unit vectors of the input axes", "输入轴单位矢量"), "1"),
                (ANGLE, Words("Angles between the input axes", "输入轴夹角"), "deg"),
            )
        ),
    )
    notes = [words for model in models for words in (residual_words(model), range_words(model))]
    title = Words("Sensitivities and angles of the gyros", "陀螺灵敏度与夹角")
    return make_block(record, title, (TRIAD_EQUATION,), tables, notes=notes)


def _tabulate_sensitivities(stated: Stated, record: Record, models: list[Model]) -> GridTable:
    """Table of the rows of S, one for each gyro and temperature."""
    cells: dict[tuple[str, Words], Result] = {}
    for model in models:
        for c in model.coefficients:
            gyro, axis = c.name[2:-1], c.name[-1]
            if c.name.startswith("S_"):
                sensitivity = coefficient(record, model, c.name, Words("sensitivity", "灵敏度"))
                if gyro == axis:
                    undecided = quantities.undecided_scale(record)
                    sensitivity = replace(sensitivity, undecided=undecided)
                principal = model.name == "triad" and gyro == axis
                place = f"{gyro} ({_where(model)})", Words(f"about {axis}", f"绕 {axis} 轴")
                cells[place] = state(stated, sensitivity, {}, principal=principal)
    title = Words("Sensitivities about the axes of the base", "绕基准轴的灵敏度")
    return _arrange(title, cells, "1/deg", COEFFICIENT_NOTE)


def _tabulate_sets(
    stated: Stated, record: Record, models: list[Model], what: str, title: Words, unit: str
) -> GridTable:
    """Table of the figures named what.<pair>[.<temperature>]: a row for each set of runs and,
    unless they are angles, for each gyro.
    """
    cells: dict[tuple[str, Words], Result] = {}
    for model in models:
        suffix = model.name.removeprefix("triad").removeprefix(".")
        for figure in record.figures:
            kind, _, rest = figure.name.partition(".")
            key, _, where = rest.partition(".")
            if (kind, where) == (what, suffix):
                gyro, column = ("", key.replace("_", " – ")) if "_" in key else (key[:-1], key[-1])
                # an error of the angle between two table axes turns a unit vector by as much
                across = math.sqrt(max(1.0 - figure.value**2, 0.0))
                slope = 1.0 if what == ANGLE else math.radians(across)
                by_axes = {ANGLE: (90.0, slope)}
                words = Words(title.en.lower(), title.zh)
                direction = of_figure(record, figure, words, dof=model.dof, slopes=by_axes)
                principal = what == ANGLE and model.name == "triad"
                place = f"{gyro} ({_where(model)})".strip(), Words(column)
                cells[place] = state(stated, direction, {}, principal=principal)
    return _arrange(title, cells, unit)


def _arrange(
    title: Words, cells: Mapping[tuple[str, Words], Result], unit: str, note: Words | None = None
) -> GridTable:
    """Table of results by the labels of their rows and columns."""
    rows = tuple(dict.fromkeys(row for row, _ in cells))
    heads = tuple(dict.fromkeys(head for _, head in cells))
    table = tuple(tuple(cells.get((row, head)) for head in heads) for row in rows)
    return GridTable(title, GYRO, heads, (unit,) * len(heads), rows, table, note)


def _where(model: Model) -> str:
    """Mean temperature of a triad's runs; the model's name where it was not logged."""
    span = model.valid.get(forms.TEMPERATURE)
    return model.name if span is None else f"{sum(span) / 2.0:.1f} °C".replace("-", "−")


def _state_pair(stated: Stated, record: Record) -> Block:
    """Block of N, ε, γ, α; errors of table rate and time base cancel in these ratios."""
    model = record.model("pair")
    figures = {figure.name: figure for figure in record.figures}
    *ratios, alpha = (state(stated, one, {}) for one in quantities.list_pair(record, model))
    error = figures["orthogonality_error_deg"]
    words = Words("orthogonality error 90° − α", "正交误差 90° − α")
    slopes = quantities.by_angle(model, error.name)
    off = state(stated, of_figure(record, error, words, dof=model.dof, slopes=slopes), {})
    results = (*ratios, _bounded(alpha, figures), off)
    title = Words("Orthogonality of the gyro pair", "陀螺组合正交性")
    table = ListTable(Words("Orthogonality", "正交性"), results)
    notes = [
        Words("Gyro B lies on the side opposite to gyro A (α > 90°).", "两陀螺异侧（α > 90°）。")
        if figures["side"].value < 0.0
        else Words("Gyro B lies on the same side as gyro A.", "两陀螺同侧。"),
        range_words(model),
    ]
    if figures["clamped"].value:
        notes.append(
            Words("|γ| was beyond 1 by noise and is clamped.", "|γ| 因噪声超过 1，已限幅。")
        )
    return make_block(record, title, (PAIR_EQUATION,), (table,), notes=notes)


def _bounded(alpha: Result, figures: Mapping[str, StatedFigure]) -> Result:
    """α with the interval from the file where α ± U would exceed 0° to 180°: first-order u(α)
    diverges there.
    """
    if alpha.uncertainty is None:
        return alpha
    U = alpha.uncertainty.expanded_uncertainty
    if alpha.value - U > 0.0 and alpha.value + U < 180.0:
        return alpha
    low, high = (figures[f"alpha_{end}_95_deg"].value for end in ("low", "high"))
    return replace(alpha, interval=(low, high))

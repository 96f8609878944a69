"""Certificate blocks of gyros on a rate table: scale factors and figures of each gyro, K and F0
over temperature; N, ε, γ and α of a pair; sensitivities, unit vectors of the input axes and the
angles between them for three axes. Each block prints the equation that it is of, F = K Ω + F0 and
those of `published`, (2), and `forms.TRIAD`.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from calibkit.certificate.blocks import (
    COEFFICIENT_NOTE,
    column_results,
    list_coefficients,
    make_block,
    plot,
    tabulate,
)
from calibkit.certificate.names import name_model, name_subject, show_symbol
from calibkit.certificate.quantities import coefficient, of_figure, state
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
from calibkit.coefficients import Model, Record
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
RESPONSE_EQUATION = Equation(
    forms.RESPONSE.name,
    r"F = K(T)\,\Omega + \sum_k (c_k + d_k x + e_k x^2) (\Omega/\Omega_{\max})^k + F_0(T)",
    Words(
        "x case temperature mapped to −1 … 1, Ω_max largest rate that was fitted.",
        "x 为映射到 −1 … 1 的壳温，Ω_max 为拟合的最大角速率。",
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
LETTERS = {"K": NAMES["scale_factor"], "F0": Words("zero-rate indication", "零速率示值")}
"""Coefficient of a line → its term."""
GYRO = Words("gyro", "陀螺")
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
ONE_TEMPERATURE_DEGC = 1.0
"""Span of the runs' case temperatures [°C] above which both ends are printed instead of the mean.
"""


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Blocks of scale factors and, for several gyros, of angles and misalignment."""
    laid_out = []
    if forms.SCALE_FILE in basis.records:
        laid_out.append(_state_scale(basis, basis.records[forms.SCALE_FILE]))
    if forms.ORTHOGONALITY_FILE in basis.records:
        record = basis.records[forms.ORTHOGONALITY_FILE]
        pair = any(model.form == forms.PAIR.name for model in record.models)
        laid_out.append(_state_pair(basis, record) if pair else _state_triad(basis, record))
    return tuple(laid_out)


def _state_scale(basis: Stated, record: Record) -> Block:
    """Block of lines, curves over temperature and figures."""
    lines = [model for model in record.models if model.form == forms.LINE.name]
    labels = _label_lines(lines)
    cells = []
    for line in lines:
        results = []
        for letter, words in LETTERS.items():
            quantity = quantities.of_line(record, line, letter, words)
            result = state(basis, quantity, {})
            if forms.TEMPERATURE in line.valid:
                degc = quantities.temperature_of_line(line)
                result = replace(result, at=((forms.TEMPERATURE, degc, "degC"),))
            results.append(result)
        cells.append(tuple(results))
    tables: list[ListTable | GridTable] = [
        GridTable(
            Words("Scale factor and zero-rate indication", "标度因数与零速率示值"),
            Words("gyro, run", "陀螺、测次"),
            (Words("K"), Words("F₀")),
            ("1/deg", "1/s"),
            tuple(labels.values()),
            tuple(cells),
        )
    ]
    figures: list[CertificateFigure] = []
    # of many lines one note for all
    notes = [residual_words(line) for line in lines]
    if len(lines) > MOST_NOTES:
        rms, dof = sorted(line.residual_rms for line in lines), min(line.dof for line in lines)
        unit = unit_mark(lines[0].residual_unit)
        notes = [
            Words(
                f"Residual rms of the {len(lines)} fits {rms[0]:.2g} … {rms[-1]:.2g} {unit}, "
                f"at least {dof} degrees of freedom (descriptors, not uncertainties).",
                f"{len(lines)} 次拟合的残差均方根 {rms[0]:.2g} … {rms[-1]:.2g} {unit}，"
                f"自由度不少于 {dof}（仅为描述量，并非不确定度）。",
            )
        ]
    curves = []
    for model in record.models:
        if model.form == forms.LINE.name:
            continue
        values = []
        if model.form == POLYNOMIAL.name:
            curves.append(model)
            values.append(quantities.over_temperature(record, model, "p"))
        title = name_model(model.name) + Words(": coefficients", "：系数")
        tables.append(list_coefficients(basis, record, model, title, values))
        notes += [range_words(model), *basis.left_out(model)]
    for letter in LETTERS:
        columns = [
            (name_subject(f".{model.name}"), quantities.over_temperature(record, model, letter))
            for model in curves
            if f".{letter}_" in model.name
        ]
        symbol = show_symbol(letter)
        title = Words(f"{symbol} over temperature", f"{symbol} 随温度")
        table = tabulate(basis, title, columns) if columns else None
        if table is None:
            continue
        tables.append(table)
        figures.append(_plot_change(table) if letter == "K" else plot(table, Words("F₀ [1/s]")))
    tables += _tabulate_figures(basis, record, labels)
    model_forms = {model.form for model in record.models}
    equations = [
        equation
        for equation in (LINE_EQUATION, CURVE_EQUATION, RESPONSE_EQUATION)
        if equation.form in model_forms
    ]
    title = Words("Scale factors on the rate table", "转台标度因数")
    return make_block(record, title, equations, tables, figures, dict.fromkeys(notes))


def _plot_change(table: GridTable) -> CertificateFigure:
    """K over temperature from the middle point of each column, in ppm of the largest K."""
    columns = [
        [result.value for _, result in column_results(table, k)] for k in range(len(table.heads))
    ]
    largest = max((abs(K) for column in columns for K in column), default=1.0)
    middles = [column[len(column) // 2] if column else 0.0 for column in columns]
    label = Words("change of K [ppm]", "K 的变化 [ppm]")
    return plot(table, label, origins=middles, scale=PPM / largest)


def _label_lines(lines: Sequence[Model]) -> dict[str, Words]:
    """Labels of lines by their names: gyro and case temperature, or the range where its runs
    differ; where these are alike also the log, or that it is fitted to all runs.
    """
    runs_of = Counter(line.name.partition(".")[0] for line in lines if "." in line.name)
    short, long = {}, {}
    for line in lines:
        subject, temperature_label, source = name_subject(f".{line.name}"), Words(""), Words("")
        if forms.TEMPERATURE in line.valid:
            low, high = line.valid[forms.TEMPERATURE]
            text = f"{quantities.temperature_of_line(line):.1f}"
            if high - low > ONE_TEMPERATURE_DEGC:
                text = f"{low:.1f} … {high:.1f}"
            temperature_label = Words(f" ({text} °C)".replace("(-", "(−").replace("… -", "… −"))
        log, count = line.name.partition(".")[2], runs_of[line.name]
        if log:
            source = Words(f", {log}", f"，{log}")
        elif count > 1:  # those at other temperatures by the curve through them
            source = Words(f", all {count} runs, weighted", f"，全部 {count} 次加权")
        short[line.name], long[line.name] = (
            subject + temperature_label,
            subject + source + temperature_label,
        )
    labels = [*short.values()]
    return {
        name: label if labels.count(label) == 1 else long[name] for name, label in short.items()
    }


def _tabulate_figures(
    basis: Stated, record: Record, names: Mapping[str, Words]
) -> Iterator[GridTable]:
    """Tables of figures in the standards' terms: rows are figures, columns are models, by their
    names; models with the same figures stand side by side.
    """
    rows: dict[tuple[str, str, str], dict[str, Result]] = {}
    models = {model.name: model for model in record.models}
    for figure in record.figures:
        figure_kind, standard, of_model = FigureName.of(figure.name)
        model = models.get(of_model)
        dof = math.inf if model is None else float(model.dof)
        if figure_kind == "repeatability" and model is not None:
            # a standard deviation over runs
            runs = {p.name: p.value for p in model.parameters}.get("runs", 2.0)
            dof = max(runs - 1.0, 1.0)
        words = NAMES.get(figure_kind, Words(figure_kind.replace("_", " ")))
        quantity = of_figure(record, figure, words, dof=dof)
        quantity = replace(quantity, standard=standard, magnitude=figure_kind in MAGNITUDES)
        row = rows.setdefault((figure_kind, standard, figure.unit), {})
        row[of_model] = state(basis, quantity, {})
    columns: dict[tuple[tuple[str, str, str], ...], list[str]] = {}
    for name in names:
        kinds = tuple(kind for kind, row in rows.items() if name in row)
        columns.setdefault(kinds, []).append(name)
    columns.pop((), None)
    for kinds, of_models in columns.items():
        labels = [
            NAMES.get(figure_kind, Words(figure_kind)) + Words(f" {standard}" if standard else "")
            for figure_kind, standard, _ in kinds
        ]
        yield GridTable(
            Words("Figures of the scale factor", "标度因数特征量"),
            Words(""),
            tuple(names[name] for name in of_models),
            tuple(unit for _, _, unit in kinds),
            tuple(labels),
            tuple(tuple(rows[kind].get(name) for name in of_models) for kind in kinds),
            by_row=True,
        )


def _state_triad(basis: Stated, record: Record) -> Block:
    """Block of runs about three axes: the rows of S, the unit vectors and the angles, a row of each
    for each gyro and temperature.
    """
    triads = [model for model in record.models if model.form == forms.TRIAD.name]
    kinds = {
        "S": Words("Sensitivities about the axes of the base", "绕基准轴的灵敏度"),
        "misalignment": Words("Unit vectors of the input axes", "输入轴单位矢量"),
        ANGLE: Words("Angles between the input axes", "输入轴夹角"),
    }
    cells: dict[str, dict[tuple[str, Words], Result]] = {kind: {} for kind in kinds}
    notes: list[Words] = []
    for triad in triads:
        suffix, set_label = triad.name.removeprefix("triad").removeprefix("."), triad.name
        if forms.TEMPERATURE in triad.valid:
            middle = sum(triad.valid[forms.TEMPERATURE]) / 2.0
            set_label = f"{middle:.1f} °C".replace("-", "−")
        for c in triad.coefficients:
            gyro, axis = c.name[2:-1], c.name[-1]
            if not c.name.startswith("S_"):
                continue
            sensitivity = coefficient(record, triad, c.name, Words("sensitivity", "灵敏度"))
            if gyro == axis:
                undecided = quantities.undecided_scale(record)
                sensitivity = replace(sensitivity, undecided=undecided)
            principal = triad.name == "triad" and gyro == axis
            place = f"{gyro} ({set_label})", Words(f"about {axis}", f"绕 {axis} 轴")
            cells["S"][place] = state(basis, sensitivity, {}, principal=principal)
        for figure in record.figures:
            kind, _, name_and_suffix = figure.name.partition(".")
            name, _, of_suffix = name_and_suffix.partition(".")
            if kind not in kinds or of_suffix != suffix:
                continue
            # an error of the angle between two table axes turns a unit vector by as much
            angle = kind == ANGLE
            slope = 1.0 if angle else math.radians(math.sqrt(max(1.0 - figure.value**2, 0.0)))
            words = Words(kinds[kind].en.lower(), kinds[kind].zh)
            direction = of_figure(
                record, figure, words, dof=triad.dof, slopes={ANGLE: (90.0, slope)}
            )
            gyro, head = ("", name.replace("_", " – ")) if "_" in name else (name[:-1], name[-1])
            principal = angle and triad.name == "triad"
            place = f"{gyro} ({set_label})".strip(), Words(head)
            cells[kind][place] = state(basis, direction, {}, principal=principal)
        notes += [residual_words(triad), range_words(triad)]
    tables = []
    units = {"S": "1/deg", "misalignment": "1", ANGLE: "deg"}
    for kind, results in cells.items():
        rows = tuple(dict.fromkeys(row for row, _ in results))
        heads = tuple(dict.fromkeys(head for _, head in results))
        grid = tuple(tuple(results.get((row, head)) for head in heads) for row in rows)
        note = COEFFICIENT_NOTE if kind == "S" else None
        of_heads = (units[kind],) * len(heads)
        tables.append(GridTable(kinds[kind], GYRO, heads, of_heads, rows, grid, note))
    title = Words("Sensitivities and angles of the gyros", "陀螺灵敏度与夹角")
    return make_block(record, title, (TRIAD_EQUATION,), tables, notes=notes)


def _state_pair(basis: Stated, record: Record) -> Block:
    """Block of N, ε, γ, α; errors of table rate and time base cancel in these ratios."""
    pair = record.model("pair")
    figures = {figure.name: figure for figure in record.figures}
    *ratios, alpha = (state(basis, quantity, {}) for quantity in quantities.list_pair(record, pair))
    if alpha.uncertainty is not None:
        U = alpha.uncertainty.expanded_uncertainty
        if not (alpha.value - U > 0.0 and alpha.value + U < 180.0):
            # first-order u(α) diverges at 0° and 180°
            low, high = (figures[f"alpha_{end}_95_deg"].value for end in ("low", "high"))
            alpha = replace(alpha, interval=(low, high))
    error = figures["orthogonality_error_deg"]
    words = Words("orthogonality error 90° − α", "正交误差 90° − α")
    slopes = quantities.by_angle(pair, error.name)
    orthogonality_error = state(
        basis, of_figure(record, error, words, dof=pair.dof, slopes=slopes), {}
    )
    title = Words("Orthogonality of the gyro pair", "陀螺组合正交性")
    table = ListTable(Words("Orthogonality", "正交性"), (*ratios, alpha, orthogonality_error))
    notes = [
        Words("Gyro B lies on the side opposite to gyro A (α > 90°).", "两陀螺异侧（α > 90°）。")
        if figures["side"].value < 0.0
        else Words("Gyro B lies on the same side as gyro A.", "两陀螺同侧。"),
        range_words(pair),
    ]
    if figures["clamped"].value:
        notes.append(
            Words("|γ| was beyond 1 by noise and is clamped.", "|γ| 因噪声超过 1，已限幅。")
        )
    return make_block(record, title, (PAIR_EQUATION,), (table,), notes=notes)

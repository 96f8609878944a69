"""Rate-table results: scale factors and figures of each gyro, K and F0 over temperature; for
several gyros also the results between them.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibkit.certificate.blocks import (
    column_results,
    list_coefficients,
    make_block,
    plot,
    tabulate,
)
from calibkit.certificate.names import name_model, name_subject, show_symbol
from calibkit.certificate.quantities import NO_SLOPES, coefficient, of_figure, state
from calibkit.certificate.results import Block, Equation, Figure, GridTable, ListTable, Result
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words, unit_mark
from calibkit.coefficients import Model, Record
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale import certificate_angles, forms, quantities
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM

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
        (forms.ORTHOGONALITY_FILE, certificate_angles.state_angles),
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
    figures: list[Figure] = []
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


def _plot_change(table: GridTable) -> Figure:
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
    for figure in record.figures:
        what, standard, model = forms.read_figure_name(figure.name)
        words = NAMES.get(what, Words(what.replace("_", " ")))
        quantity = replace(
            of_figure(record, figure, words, dof=_find_dof(record, what, model)),
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


def _find_dof(record: Record, what: str, name: str) -> float:
    """Degrees of freedom of a figure: those of its model, or the number of runs less one for a
    standard deviation over runs.
    """
    model = next((m for m in record.models if m.name == name), None)
    if model is None:
        return math.inf
    if what == "repeatability":
        return max(next((p.value for p in model.parameters if p.name == "runs"), 2.0) - 1.0, 1.0)
    return float(model.dof)


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

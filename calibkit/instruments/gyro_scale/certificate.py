"""Rate-table results: scale factors and figures of each gyro, K over temperature, N, ε, γ and α of
a pair.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from calibkit.certificate.results import (
    Block,
    Equation,
    Figure,
    GridTable,
    ListTable,
    Result,
    Series,
)
from calibkit.certificate.stated import TEMPERATURE, many_residuals, powers, range_words
from calibkit.certificate.words import Words
from calibkit.instruments.gyro_scale import axes_certificate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Figure as Found, Model, Record

LINE = Equation(
    "gyro-scale/1",
    r"F = K\,\Omega + F_0",
    Words(
        "F indication [1/s], Ω table rate [°/s], K scale factor [1/°]; "
        "F₀ holds the bias and the earth's rate about the table axis.",
        "F 为示值 [1/s]，Ω 为转台角速率 [°/s]，K 为标度因数 [1/°]；"
        "F₀ 含零偏与地球自转在转台轴上的分量。",
    ),
)
CURVE = Equation(
    "polynomial/1",
    r"p(T) = \sum_k p_k T^k",
    Words("T case temperature [°C].", "T 为壳温 [°C]。"),
)
PAIR = Equation(
    "gyro-orthogonality/1",
    r"N = \frac{K_B}{K_A}, \quad \varepsilon = \frac{K_{Ba}}{K_A}, \quad \gamma ="
    r" \frac{\varepsilon}{N} = \cos\alpha",
    Words(
        "K_A, K_B scale factors about the gyros' own axes, K_Ba that of B about A's axis, α the"
        " angle between the two axes.",
        "K_A、K_B 为各陀螺绕自身轴的标度因数，K_Ba 为 B 绕 A 轴的标度因数，α 为两轴夹角。",
    ),
)
NAMES = {
    "scale_factor": Words("scale factor", "标度因数"),
    "nonlinearity_full_scale": Words("nonlinearity, of full scale", "非线性度（满量程）"),
    "nonlinearity_per_point": Words("nonlinearity, per point", "非线性度（逐点）"),
    "linearity_error_rms": Words("linearity error, rms", "线性误差均方根"),
    "asymmetry": Words("asymmetry", "不对称度"),
    "threshold": Words("threshold, at most", "阈值（不大于）"),
    "resolution": Words("resolution, at most", "分辨率（不大于）"),
    "repeatability": Words("repeatability", "重复性"),
    "temperature_sensitivity": Words("temperature sensitivity", "温度灵敏度"),
    "bias": Words("bias", "零偏"),
}
"""Figures in the standards' terms."""
MAGNITUDES = {
    "nonlinearity_full_scale",
    "nonlinearity_per_point",
    "linearity_error_rms",
    "asymmetry",
    "repeatability",
}
"""Figures that cannot be negative."""


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Scale factors, and of a pair what stands between the gyros."""
    made: list[Block] = []
    if "gyro_scale.json" in stated.records:
        made.append(_scale(stated, stated.records["gyro_scale.json"]))
    if "gyro_orthogonality.json" in stated.records:
        record = stated.records["gyro_orthogonality.json"]
        paired = any(model.form == "gyro-orthogonality/1" for model in record.models)
        made.append(
            _pair(stated, record) if paired else axes_certificate.block(stated, record, _rates)
        )
    return tuple(made)


def _scale(stated: Stated, record: Record) -> Block:
    """Lines, curves over temperature, figures."""
    lines = [model for model in record.models if model.form == "gyro-scale/1"]
    others = [model for model in record.models if model.form != "gyro-scale/1"]
    tables: list[ListTable | GridTable] = [_lines(stated, record, lines)]
    figures: list[Figure] = []
    notes: list[Words] = []
    for model in others:
        title = Words(f"{model.name}: coefficients", f"{model.name}：系数")
        tables.append(
            stated.coefficients(record, model, title, _rates if ".K_" in model.name else None)
        )
        notes += [range_words(model), *stated.left_out(model)]
    for letter in ("K", "F0"):
        curves = [m for m in others if m.form == "polynomial/1" and f".{letter}_" in m.name]
        if curves and (table := _curves(stated, record, curves, letter)) is not None:
            tables.append(table)
            figures.append(_plot(table, relative=letter == "K"))
    tables += _figures(stated, record, [model.name for model in lines])
    equations = (LINE, *([CURVE] if any(m.form == "polynomial/1" for m in others) else ()))
    notes = [*many_residuals(lines), *dict.fromkeys(notes)]
    title = Words("Scale factors on the rate table", "转台标度因数")
    return Block(
        record.stage,
        f"{record.stage}.json",
        title,
        equations,
        tuple(tables),
        tuple(figures),
        tuple(notes),
    )


ONE_TEMPERATURE_DEGC = 1.0
"""Span of the runs' case temperatures above which both ends are printed."""
FULL_SCALE = 100.0
"""Table rate [°/s] that shares of it are taken of where a model does not name its own."""


def _rates(value: float, largest: float = FULL_SCALE) -> dict[str, tuple[float, float]]:
    """Sensitivity of K, and of what is proportional to it, to the table rate at full scale and to
    the time base (of 1 s).
    """
    return {"table_rate_dps": (largest, -value / largest), "time_s": (1.0, value)}


def _full_scale(model: Model) -> float:
    """Largest table rate [°/s] of a line."""
    return max(map(abs, model.valid.get("table_rate_dps", ())), default=0.0) or FULL_SCALE


def _lines(stated: Stated, record: Record, models: Sequence[Model]) -> GridTable:
    """K and F0 of every line."""
    cells = []
    for model in models:
        K = stated.linear(
            record,
            model,
            "K",
            Words("scale factor", "标度因数"),
            {"K": 1.0},
            "1/deg",
            sensitivities=_rates(model.value("K"), _full_scale(model)),
            principal=model.name in _principal(models),
        )
        F0 = stated.linear(
            record, model, "F0", Words("zero-rate indication", "零速率示值"), {"F0": 1.0}, "1/s"
        )
        at = _temperature(model)
        cells.append((K, F0) if at is None else (replace(K, at=at), replace(F0, at=at)))
    return GridTable(
        Words("Scale factor and zero-rate indication", "标度因数与零速率示值"),
        Words("gyro, run", "陀螺、测次"),
        (Words("K"), Words("F₀")),
        ("1/deg", "1/s"),
        tuple(_label(model) for model in models),
        tuple(cells),
    )


def _temperature(model: Model) -> tuple[tuple[str, float, str], ...] | None:
    """Mean case temperature that a line was found at, as a condition, where it was logged."""
    if TEMPERATURE not in model.valid:
        return None
    known = {parameter.name: parameter.value for parameter in model.parameters}
    return ((TEMPERATURE, known.get("temp_case", sum(model.valid[TEMPERATURE]) / 2.0), "degC"),)


def _label(model: Model) -> str:
    """A line by its name and the case temperature that it holds at; both ends where its runs lie
    apart.
    """
    at = _temperature(model)
    if at is None:
        return model.name
    low, high = model.valid[TEMPERATURE]
    text = f"{low:.1f} … {high:.1f}" if high - low > ONE_TEMPERATURE_DEGC else f"{at[0][1]:.1f}"
    return f"{model.name} ({text} °C)".replace("(-", "(−").replace("… -", "… −")


def _principal(models: Sequence[Model]) -> list[str]:
    """Lines whose budget is printed in full: a gyro about its own axis, the mean of its runs."""
    return [m.name for m in models if "." not in m.name and not _is_cross(m.name)]


def _curves(
    stated: Stated, record: Record, models: Sequence[Model], letter: str
) -> GridTable | None:
    """Values of the polynomials of K or F0 over temperature, one column a gyro."""
    temperatures = stated.grid(models[0])
    if not temperatures:
        return None
    columns = [
        (
            Words(model.name.split(".")[0]),
            model.coefficients[0].unit,
            partial(_curve_value, stated, record, model, letter),
        )
        for model in models
    ]
    return stated.over(
        Words(f"{letter} over temperature", f"{letter} 随温度"), temperatures, columns
    )


def _curve_value(
    stated: Stated, record: Record, model: Model, letter: str, t: float
) -> Result | None:
    """Value of one polynomial at a temperature inside its range."""
    low, high = model.valid["temp_case_degc"]
    if not low <= t <= high:
        return None
    weights, slope = powers("p", model, t)
    value = sum(weights[c.name] * c.value for c in model.coefficients)
    return stated.linear(
        record,
        model,
        "value",
        Words(letter),
        weights,
        model.coefficients[0].unit,
        at=t,
        slope=slope,
        sensitivities=_rates(value) if letter == "K" else {},
        symbol=letter,
        principal=t == stated.reference_degc and not _is_cross(model.name),
    )


def _is_cross(name: str) -> bool:
    """Whether a model is of a gyro about another's axis."""
    gyro, about, axis = name.split(".", maxsplit=1)[0].partition("_about_")
    return bool(about) and gyro != axis


def _plot(table: GridTable, *, relative: bool) -> Figure:
    """Values over temperature with their expanded uncertainties, of K in ppm of the largest K from
    the middle.
    """
    columns = [
        [r for row in table.cells if (r := row[k]) is not None and r.uncertainty is not None]
        for k in range(len(table.heads))
    ]
    largest = max((abs(r.value) for points in columns for r in points), default=1.0)
    series = []
    for head, points in zip(table.heads, columns, strict=True):
        origin, scale = (
            (points[len(points) // 2].value, 1e6 / largest) if relative and points else (0.0, 1.0)
        )
        U = tuple(
            r.uncertainty.expanded_uncertainty * scale for r in points if r.uncertainty is not None
        )
        values = tuple((r.value - origin) * scale for r in points)
        series.append(Series(head, tuple(r.at[0][1] for r in points), values, U))
    label = Words("change of K [ppm]", "K 的变化 [ppm]") if relative else Words("F₀ [1/s]")
    return Figure(table.title, Words("case temperature [°C]", "壳温 [°C]"), label, tuple(series))


def _figures(stated: Stated, record: Record, names: Sequence[str]) -> list[ListTable | GridTable]:
    """Figures in the standards' terms: rows of figure and standard, models side by side."""
    kinds: dict[tuple[str, str, str], dict[str, Result]] = {}
    for figure in record.figures:
        what, standard, model = _parts(figure)
        words = NAMES.get(what, Words(what.replace("_", " ")))
        sign = (
            -1.0 if standard.startswith("IEEE") else 1.0
        )  # a rate per count is the reciprocal of a count per rate
        found = stated.figure(
            record,
            figure,
            words,
            _dof(record, what, model),
            standard=standard,
            magnitude=what in MAGNITUDES,
            sensitivities=_rates(sign * figure.value) if what == "scale_factor" else None,
        )
        kinds.setdefault((what, standard, figure.unit), {})[model] = found
    tables: list[ListTable | GridTable] = []
    columns = [name for name in names if any(name in row for row in kinds.values())]
    alike: dict[tuple[object, ...], list[str]] = {}
    for name in columns:  # models with the same figures stand side by side
        alike.setdefault(tuple(kind for kind, row in kinds.items() if name in row), []).append(name)
    for group in alike.values():
        rows = [(kind, row) for kind, row in kinds.items() if any(name in row for name in group)]
        labels = tuple(
            NAMES.get(w, Words(w)) + Words(f" {s}" if s else "") for (w, s, _), _ in rows
        )
        tables.append(
            GridTable(
                Words("Figures of the scale factor", "标度因数特征量"),
                Words(""),
                tuple(map(Words, group)),
                tuple(unit for (_, _, unit), _ in rows),
                labels,
                tuple(tuple(row.get(name) for name in group) for _, row in rows),
                by_row=True,
            )
        )
    return tables


def _parts(figure: Found) -> tuple[str, str, str]:
    """What, standard and model of a figure's name."""
    what, _, rest = figure.name.partition(".")
    for standard in ("GJB 2426A", "IEEE Std 952"):
        if rest.startswith(f"{standard}."):
            return what, standard, rest.removeprefix(f"{standard}.")
    return what, "", rest


def _dof(record: Record, what: str, name: str) -> float:
    """Degrees of freedom of a figure: those of its model; of a standard deviation over runs one
    less than the runs.
    """
    model = next((m for m in record.models if m.name == name), None)
    if model is None:
        return math.inf
    if what == "repeatability":
        return max(next((p.value for p in model.parameters if p.name == "runs"), 2.0) - 1.0, 1.0)
    return float(model.dof)


def _by_angle(model: Model, name: str) -> dict[str, tuple[float, float]]:
    """Sensitivity of γ = cos α and ε = N γ to the angle, which type B terms on alpha_deg reach them
    by.
    """
    alpha = model.value("alpha_deg")
    slope = -math.sin(math.radians(alpha)) * math.pi / 180.0
    derivatives = {
        "gamma": slope,
        "epsilon": model.value("N") * slope,
        "orthogonality_error_deg": -1.0,
    }
    return {"alpha_deg": (alpha, derivatives[name])} if name in derivatives else {}


def _pair(stated: Stated, record: Record) -> Block:
    """N, ε, γ, α; the table's rate and the time base cancel in them."""
    model = record.model("pair")
    figures = {figure.name: figure for figure in record.figures}
    words = {
        "N": (Words("N"), Words("ratio of the scale factors", "标度因数比")),
        "epsilon": (Words("ε"), Words("projection ratio", "投影比")),
        "gamma": (Words("γ"), Words("orthogonality coefficient", "正交系数")),
        "alpha_deg": (Words("α"), Words("angle between the axes", "两轴夹角")),
    }
    results = [
        stated.linear(
            record,
            model,
            name,
            word,
            {name: 1.0},
            model.coefficients[k].unit,
            symbol=symbol.en,
            sensitivities=_by_angle(model, name),
            principal=True,
        )
        for k, (name, (symbol, word)) in enumerate(words.items())
    ]
    results[3] = _bounded(
        results[3], figures["alpha_low_95_deg"].value, figures["alpha_high_95_deg"].value
    )
    error = figures["orthogonality_error_deg"]
    words_off = Words("orthogonality error 90° − α", "正交误差 90° − α")
    off = stated.figure(
        record, error, words_off, model.dof, sensitivities=_by_angle(model, error.name)
    )
    title = Words("Orthogonality of the gyro pair", "陀螺组合正交性")
    side = Words("Gyro B lies on the same side as gyro A.", "两陀螺同侧。")
    if figures["side"].value < 0.0:
        side = Words(
            "Gyro B lies on the side opposite to gyro A (α > 90°).", "两陀螺异侧（α > 90°）。"
        )
    notes = [side, range_words(model)]
    if figures["clamped"].value:
        notes.append(
            Words("|γ| was beyond 1 by noise and is clamped.", "|γ| 因噪声超过 1，已限幅。")
        )
    table = ListTable(Words("Orthogonality", "正交性"), (*results, off))
    return Block(record.stage, f"{record.stage}.json", title, (PAIR,), (table,), (), tuple(notes))


def _bounded(alpha: Result, low: float, high: float) -> Result:
    """α with the interval of the file where α ± U would leave 0° to 180°: there u(α) to first order
    diverges.
    """
    if alpha.uncertainty is None:
        return alpha
    U = alpha.uncertainty.expanded_uncertainty
    if alpha.value - U > 0.0 and alpha.value + U < 180.0:
        return alpha
    return replace(alpha, interval=(low, high))

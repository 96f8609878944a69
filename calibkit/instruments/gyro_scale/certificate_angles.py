"""Results between gyros: N, ε, γ and α of a pair; sensitivities, unit vectors of the input axes and
the angles between them for three axes.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

from calibkit.certificate.blocks import COEFFICIENT_NOTE, make_block
from calibkit.certificate.quantities import coefficient, of_figure, state
from calibkit.certificate.results import Block, Equation, GridTable, ListTable, Result
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words
from calibkit.coefficients import Figure, Model, Record
from calibkit.instruments.gyro_scale.forms import (
    AXES,
    PAIR,
    TEMPERATURE,
    TRIAD,
)
from calibkit.instruments.gyro_scale.quantities import by_angle, list_pair

PAIR_EQUATION = Equation(
    PAIR.name,
    r"N = \frac{K_B}{K_A}, \quad \varepsilon = \frac{K_{Ba}}{K_A}, \quad \gamma ="
    r" \frac{\varepsilon}{N} = \cos\alpha",
    Words(
        "K_A, K_B scale factors about the gyros' own axes, K_Ba that of B about A's axis, α the"
        " angle between the two axes.",
        "K_A、K_B 为各陀螺绕自身轴的标度因数，K_Ba 为 B 绕 A 轴的标度因数，α 为两轴夹角。",
    ),
)
TRIAD_EQUATION = Equation(
    TRIAD.name,
    r"\mathbf{F} = \mathbf{S}\,\boldsymbol{\Omega} + \mathbf{F}_0, \quad \mathbf{u}_g ="
    r" \mathbf{s}_g / |\mathbf{s}_g|, "
    r"\quad \cos\alpha_{gh} = \mathbf{u}_g \cdot \mathbf{u}_h",
    Words(
        "F indications [1/s], Ω rate about the axes of the base [°/s]; the rows of S are the"
        " sensitivities of the gyros.",
        "F 为示值 [1/s]，Ω 为绕基准轴的角速率 [°/s]，S 的各行为各陀螺的灵敏度。",
    ),
)
GYRO = Words("gyro", "陀螺")
ANGLE = "angle_deg"
"""Figures of angles between input axes, and quantity of type B terms on the angles between the axes
of the table.
"""


def state_angles(stated: Stated, record: Record) -> Block:
    """Block of gyro_orthogonality.json, for a pair or for runs about three axes."""
    if any(model.form == PAIR.name for model in record.models):
        return _state_pair(stated, record)
    models = [model for model in record.models if model.form == TRIAD.name]
    tables = (
        _tabulate_sensitivities(stated, record, models),
        *(
            _tabulate_figures(stated, record, models, what, title, unit)
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
    labels: list[str] = []
    cells: list[tuple[Result, ...]] = []
    for model in models:
        rows: dict[str, list[Result]] = {}
        for c in model.coefficients:
            gyro, axis = c.name[2:-1], c.name[-1]
            if c.name.startswith("S_"):
                sensitivity = coefficient(record, model, c.name, Words("sensitivity", "灵敏度"))
                principal = model.name == "triad" and gyro == axis
                result = state(stated, sensitivity, {}, principal=principal)
                rows.setdefault(gyro, []).append(result)
        labels += [f"{gyro} ({_where(model)})" for gyro in rows]
        cells += map(tuple, rows.values())
    return GridTable(
        Words("Sensitivities about the axes of the base", "绕基准轴的灵敏度"),
        GYRO,
        tuple(Words(f"about {axis}", f"绕 {axis} 轴") for axis in AXES),
        ("1/deg",) * len(AXES),
        tuple(labels),
        tuple(cells),
        COEFFICIENT_NOTE,
    )


def _where(model: Model) -> str:
    """Mean temperature of a triad's runs; the model's name where it was not logged."""
    span = model.valid.get(TEMPERATURE)
    return model.name if span is None else f"{sum(span) / 2.0:.1f} °C".replace("-", "−")


def _tabulate_figures(
    stated: Stated, record: Record, models: list[Model], what: str, title: Words, unit: str
) -> GridTable:
    """Table of the figures named what.<pair>[.<temperature>]: a row for each set of runs and,
    unless they are angles, for each gyro.
    """
    labels: list[str] = []
    cells: list[tuple[Result, ...]] = []
    columns: dict[str, None] = {}
    for model in models:
        suffix = model.name.removeprefix("triad").removeprefix(".")
        rows: dict[str, list[Result]] = {}
        for figure in record.figures:
            kind, _, rest = figure.name.partition(".")
            key, _, where = rest.partition(".")
            if (kind, where) == (what, suffix):
                gyro, column = ("", key.replace("_", " – ")) if "_" in key else (key[:-1], key[-1])
                columns[column] = None
                # an error of the angle between two table axes turns a unit vector by as much
                across = math.sqrt(max(1.0 - figure.value**2, 0.0))
                slope = 1.0 if what == ANGLE else math.radians(across)
                by_axes = {ANGLE: (90.0, slope)}
                words = Words(title.en.lower(), title.zh)
                direction = of_figure(record, figure, words, dof=model.dof, slopes=by_axes)
                principal = what == ANGLE and model.name == "triad"
                rows.setdefault(gyro, []).append(state(stated, direction, {}, principal=principal))
        labels += [f"{gyro} ({_where(model)})".strip() for gyro in rows]
        cells += map(tuple, rows.values())
    heads = tuple(map(Words, columns))
    return GridTable(title, GYRO, heads, (unit,) * len(heads), tuple(labels), tuple(cells))


def _state_pair(stated: Stated, record: Record) -> Block:
    """Block of N, ε, γ, α; errors of table rate and time base cancel in these ratios."""
    model = record.model("pair")
    figures = {figure.name: figure for figure in record.figures}
    *ratios, alpha = (state(stated, one, {}) for one in list_pair(record, model))
    error = figures["orthogonality_error_deg"]
    words = Words("orthogonality error 90° − α", "正交误差 90° − α")
    slopes = by_angle(model, error.name)
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


def _bounded(alpha: Result, figures: Mapping[str, Figure]) -> Result:
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

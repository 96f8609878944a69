"""Accelerometer results: K-factor, Q-factor and triad, coefficients and values over temperature."""

from calibkit.certificate.blocks import (
    COEFFICIENT_NOTE,
    COEFFICIENTS,
    Table,
    column_results,
    fitted_coefficients,
    list_coefficients,
    make_block,
    note_models,
    plot,
    tabulate,
)
from calibkit.certificate.quantities import Quantity, coefficient, state
from calibkit.certificate.results import Block, Equation, Figure, GridTable, ListTable
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words
from calibkit.coefficients import Record
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.quantities import is_cross, over_temperature

K_EQUATION = Equation(
    forms.K.name,
    r"G_x' = G_x (K_0 + K_1 t + K_2 t^2 + K_3 t^3) - (K_4 + K_5 t + K_6 t^2 + K_7 t^3) - K_8 G_y -"
    r" K_9 G_z",
    Words(
        "G indications [g], G' corrected [g], t case temperature [°C], g local gravity; K₈ and K₉"
        " are of y and z for x, of z and x for y, of x and y for z.",
        "G 为示值 [g]，G' 为修正值 [g]，t 为壳温 [°C]，g 为当地重力；K₈、K₉ 对 x 轴取 y、z，对 y"
        " 轴取 z、x，对 z 轴取 x、y。",
    ),
)
AFFINE_EQUATION = Equation(
    forms.AFFINE.name,
    r"\mathbf{G}' = \mathbf{M}(t) (\mathbf{G} - \mathbf{b}(t)), \quad "
    r"M_{ij}(t) = \sum_k m_{ijk} t^k, \quad b_i(t) = \sum_k b_{ik} t^k",
    Words(
        "G indications [g], G' corrected [g], t case temperature [°C], g local gravity; n multiply"
        " products of indications.",
        "G 为示值 [g]，G' 为修正值 [g]，t 为壳温 [°C]，g 为当地重力；n 与示值之积相乘。",
    ),
)
TRIAD_EQUATION = Equation(
    forms.TRIAD.name,
    r"a_i = G_i \sum_k k_{ik} t^k - \sum_k z_{ik} t^k, \quad "
    r"G_i' = a_i - \sum_{j \neq i} (c_{ij} + d_{ij} t) a_j",
    Words(
        "G indications [g], G' corrected [g], t case temperature [°C], g local gravity; n multiply"
        " products of a.",
        "G 为示值 [g]，G' 为修正值 [g]，t 为壳温 [°C]，g 为当地重力；n 与 a 之积相乘。",
    ),
)
Q_EQUATION = Equation(
    forms.Q.name,
    r"G_x' = G_x, \quad G_y' = Q_3 G_x + G_y, \quad G_z' = Q_2 G_x + Q_1 G_y + G_z",
    Words("G after scale factor and zero offset [g].", "G 为经标度因数与零位修正后的值 [g]。"),
)
OVER = Words(" over temperature", "随温度")
TRIADS = {
    forms.AFFINE.name: (
        Words("Affine triad: matrix and bias", "三轴仿射模型：矩阵与零偏"),
        AFFINE_EQUATION,
    ),
    forms.TRIAD.name: (
        Words(
            "Triad: scale factor, zero offset and cross terms",
            "三轴模型：标度因数、零位与交叉耦合项",
        ),
        TRIAD_EQUATION,
    ),
}
"""Form → title and equation of its block."""
GRIDS = (
    (Words("Diagonal of M", "M 对角元"), "m", False),
    (Words("Cross terms of M", "M 交叉元"), "m", True),
    (Words("Scale factor", "标度因数"), "k", False),
    (Words("Cross terms", "交叉耦合项"), "c", True),
    (Words("Zero offset", "零位"), "z", False),
    (Words("Bias", "零偏"), "b", False),
)
"""Tables over temperature: title, first letter of the symbols in it, and whether these are of
cross-axis terms.
"""


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Result blocks of the stages (K-factor, Q-factor, triad) that the run holds."""
    layouts = {"accel_k.json": _k, "accel_q.json": _q, "accel_affine.json": _triad}
    return tuple(
        layout(stated, stated.records[file])
        for file, layout in layouts.items()
        if file in stated.records and stated.records[file].models
    )


def _k(stated: Stated, record: Record) -> Block:
    """Block of the K-factor: coefficients of the three axes side by side, scale factor and zero
    offset against temperature.
    """
    models = record.models
    axes = tuple(Words(AXES[forms.K_MODELS.index(model.name)]) for model in models)
    curves = [over_temperature(record.stage, model) for model in models]
    columns = [
        {c.name: c for c in fitted_coefficients(record, model, of_model)}
        for model, of_model in zip(models, curves, strict=True)
    ]
    rows = {name: c.unit for column in columns for name, c in column.items()}
    coefficients = GridTable(
        COEFFICIENTS,
        Words(""),
        axes,
        tuple(rows.values()),
        tuple(rows),
        tuple(
            tuple(state(stated, column[name], {}) if name in column else None for column in columns)
            for name in rows
        ),
        COEFFICIENT_NOTE,
        by_row=True,
    )
    grids = [
        tabulate(stated, title + OVER, [*zip(axes, quantities, strict=True)])
        for title, quantities in zip(
            (Words("Scale factor", "标度因数"), Words("Zero offset", "零位")),
            zip(*curves, strict=True),
            strict=False,
        )
    ]
    title = Words(
        "K-factor: scale factor, zero offset and cross terms", "K 系数：标度因数、零位与交叉耦合项"
    )
    notes = (*map(residual_words, models), range_words(models[0]), *stated.left_out(models[0]))
    figures = [_plot_change(grid) for grid in grids if grid is not None]
    return make_block(record, title, (K_EQUATION,), (coefficients, *grids), figures, notes)


def _q(stated: Stated, record: Record) -> Block:
    """Block of the Q-factor at the temperature that it was found at."""
    model = record.models[0]
    name = Words("Non-orthogonality", "非正交角")
    results = tuple(
        state(stated, coefficient(record, model, c.name, name), {}, principal=True)
        for c in model.coefficients
    )
    at = model.value("temperature")
    notes = (
        Words(f"Q holds at {at:g} °C.", f"Q 系数对应温度 {at:g} °C。"),
        residual_words(model),
        range_words(model),
    )
    title = Words("Q-factor: non-orthogonality of the axes", "Q 系数：三轴非正交")
    table = ListTable(COEFFICIENTS, results)
    return make_block(record, title, (Q_EQUATION,), (table,), (), notes)


def _triad(stated: Stated, record: Record) -> Block:
    """Block of the triad: every coefficient, and its polynomials against temperature."""
    model = record.models[0]
    curves = over_temperature(record.stage, model)
    grids: list[GridTable] = []
    for title, letter, cross in GRIDS:
        columns: list[tuple[Words, Quantity]] = [
            (Words(curve.symbol or ""), curve)
            for curve in curves
            if curve.name[0] == letter and is_cross(curve.name) == cross
        ]
        grid = tabulate(stated, title + OVER, columns) if columns else None
        grids += [] if grid is None else [grid]
    figures = [_plot_change(grid) for grid in (*grids[:1], *grids[-1:])]
    title, equation = TRIADS[model.form]
    tables: tuple[Table, ...] = (list_coefficients(stated, record, model, values=curves), *grids)
    return make_block(record, title, (equation,), tables, figures, note_models(stated, [model]))


def _plot_change(table: GridTable) -> Figure:
    """Plot of the change of every column from its first row, with expanded uncertainties."""
    unit = "ppm" if table.units[0] == "1" else "µg"
    low = f"{table.points[0]:g}".replace("-", "−")
    origins = [column_results(table, k)[0][1].value for k in range(len(table.heads))]
    return plot(
        table,
        Words(f"change [{unit}]", f"变化 [{unit}]"),
        title=table.title + Words(f": change from {low} °C", f"：相对 {low} °C 的变化"),
        origins=origins,
        scale=1e6,
    )

"""Accelerometer results: K-factor, Q-factor and affine triad, coefficients and values over
temperature.
"""

from collections.abc import Callable, Mapping, Sequence

from calibkit.certificate.quantities import state
from calibkit.certificate.results import (
    Block,
    Equation,
    Figure,
    GridTable,
    ListTable,
    Result,
    Series,
)
from calibkit.certificate.stated import (
    COEFFICIENT_NOTE,
    COEFFICIENTS,
    Stated,
    range_words,
    residual_words,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Coefficient, Model, Record
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.quantities import over_temperature

Column = tuple[Words, str, "Callable[[float], Result | None]"]
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


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Result blocks of the stages (K-factor, Q-factor, affine) that the run holds."""
    layouts = {"accel_k.json": _k, "accel_q.json": _q, "accel_affine.json": _affine}
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
    same = [cs for cs in zip(*(m.coefficients for m in models), strict=True) if _any_value(cs)]
    cells = tuple(
        tuple(
            _coefficient(stated, record, model, c, Words(c.name))
            for model, c in zip(models, cs, strict=True)
        )
        for cs in same
    )
    table = GridTable(
        COEFFICIENTS,
        Words(""),
        tuple(Words(_axis(model)) for model in models),
        tuple(row[0].unit for row in cells),
        tuple(cs[0].name for cs in same),
        cells,
        COEFFICIENT_NOTE,
        by_row=True,
    )
    grids: list[GridTable] = []
    if temperatures := stated.grid(models[0]):
        for name, key, terms, unit in (
            (Words("Scale factor", "标度因数"), "scale", forms.SCALE_FACTOR, "1"),
            (Words("Zero offset", "零位"), "zero", forms.ZERO_OFFSET, "g"),
        ):
            columns = [
                _column(stated, record, m, _axis(m), key, name + Words(f" {_axis(m)}"), terms, unit)
                for m in models
            ]
            grids.append(stated.over(name + OVER, temperatures, columns))
    title = Words(
        "K-factor: scale factor, zero offset and cross terms", "K 系数：标度因数、零位与交叉耦合项"
    )
    notes = (*map(residual_words, models), range_words(models[0]), *stated.left_out(models[0]))
    figures = tuple(map(_plot_change, grids))
    tables = (table, *grids)
    return Block(record.stage, f"{record.stage}.json", title, (K_EQUATION,), tables, figures, notes)


def _q(stated: Stated, record: Record) -> Block:
    """Block of the Q-factor at the temperature that it was found at."""
    model = record.models[0]
    name = Words("Non-orthogonality", "非正交角")
    results = tuple(
        _coefficient(stated, record, model, c, name, principal=True) for c in model.coefficients
    )
    at = model.value("temperature")
    notes = (
        Words(f"Q holds at {at:g} °C.", f"Q 系数对应温度 {at:g} °C。"),
        residual_words(model),
        range_words(model),
    )
    title = Words("Q-factor: non-orthogonality of the axes", "Q 系数：三轴非正交")
    table = ListTable(COEFFICIENTS, results)
    return Block(record.stage, f"{record.stage}.json", title, (Q_EQUATION,), (table,), (), notes)


def _affine(stated: Stated, record: Record) -> Block:
    """Block of the triad: every coefficient, and its polynomials against temperature."""
    model = record.models[0]
    results = tuple(
        _coefficient(stated, record, model, c, Words(""))
        for c in model.coefficients
        if _any_value((c,))
    )
    grids: list[GridTable] = []
    for title, name, begin in TRIAD_GRIDS[model.form]:
        columns = []
        for symbol, terms, unit in forms.list_polynomials(model):
            if not begin(symbol):
                continue
            shown, cross = symbol.replace("m_", "M_"), _is_cross(symbol)
            what = shown, symbol, name + Words(shown), terms, unit
            columns.append(_column(stated, record, model, *what, cross=cross))
        if columns and (temperatures := stated.grid(model)):
            grids.append(stated.over(title + OVER, temperatures, columns))
    notes = (residual_words(model), range_words(model), *stated.left_out(model))
    tables: tuple[ListTable | GridTable, ...]
    tables = (ListTable(COEFFICIENTS, results, COEFFICIENT_NOTE), *grids)
    figures = tuple(_plot_change(grid) for grid in (*grids[:1], *grids[-1:]))
    title, equation = TRIAD_TITLES[model.form]
    return Block(record.stage, f"{record.stage}.json", title, (equation,), tables, figures, notes)


def _is_cross(symbol: str) -> bool:
    """Whether a polynomial is that of a cross-axis term: c_xy, m_xy."""
    _, axes = symbol.split("_")
    return len(axes) == 2 and axes[0] != axes[1]


MATRIX, BIAS, SCALE, ZERO, CROSS = (
    Words("Matrix entry ", "矩阵元 "),
    Words("Bias ", "零偏 "),
    Words("Scale factor ", "标度因数 "),
    Words("Zero offset ", "零位 "),
    Words("Cross term ", "交叉耦合项 "),
)
TRIAD_GRIDS: Mapping[str, Sequence[tuple[Words, Words, Callable[[str], bool]]]] = {
    forms.AFFINE.name: (
        (
            Words("Diagonal of M", "M 对角元"),
            MATRIX,
            lambda symbol: symbol[0] == "m" and not _is_cross(symbol),
        ),
        (
            Words("Cross terms of M", "M 交叉元"),
            MATRIX,
            lambda symbol: symbol[0] == "m" and _is_cross(symbol),
        ),
        (Words("Bias", "零偏"), BIAS, lambda symbol: symbol[0] == "b"),
    ),
    forms.TRIAD.name: (
        (Words("Scale factor", "标度因数"), SCALE, lambda symbol: symbol[0] == "k"),
        (Words("Cross terms", "交叉耦合项"), CROSS, lambda symbol: symbol[0] == "c"),
        (Words("Zero offset", "零位"), ZERO, lambda symbol: symbol[0] == "z"),
    ),
}
"""Form → tables over temperature: title, name of a result, and which polynomials stand in it."""
TRIAD_TITLES = {
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


def _axis(model: Model) -> str:
    """Letter of the axis of a K model."""
    return AXES[forms.K_MODELS.index(model.name)]


def _any_value(coefficients: Sequence[Coefficient]) -> bool:
    """Whether at least one of the coefficients was fitted."""
    return any(c.value or c.standard_uncertainty for c in coefficients)


def _coefficient(
    stated: Stated,
    record: Record,
    model: Model,
    coefficient: Coefficient,
    words: Words,
    *,
    principal: bool = False,
) -> Result:
    """Result of one coefficient; of power 0 it is the value at 0 °C."""
    value_at_zero = {"K0": "scale", "K4": "zero"}.get(coefficient.name)
    if model.form in TRIAD_TITLES:
        first = {terms[0]: symbol for symbol, terms, _ in forms.list_polynomials(model)}
        value_at_zero = first.get(coefficient.name)
    return stated.linear(
        record,
        model,
        coefficient.name,
        words,
        {coefficient.name: 1.0},
        coefficient.unit,
        principal=principal,
        also=() if value_at_zero is None else (value_at_zero,),
    )


def _column(
    stated: Stated,
    record: Record,
    model: Model,
    head: str,
    key: str,
    name: Words,
    terms: Sequence[str],
    unit: str,
    *,
    cross: bool = False,
) -> Column:
    """Column of a quantity Σ c_k t^k against temperature; `terms` names its coefficients c_k."""
    quantity = over_temperature(record.stage, model, key, name, terms, unit)

    def value(t: float) -> Result:
        at, principal = {forms.TEMPERATURE: t}, t == stated.reference_degc and not cross
        return state(stated, quantity, at, principal=principal, symbol=head)

    return Words(head), unit, value


def _plot_change(table: GridTable) -> Figure:
    """Plot of the change of every column from its first row, with expanded uncertainties."""
    series = []
    for k, head in enumerate(table.heads):
        found = [row[k] for row in table.cells]
        points = [r for r in found if r is not None and r.uncertainty is not None]
        origin = points[0].value if points else 0.0
        series.append(
            Series(
                head,
                tuple(r.at[0][1] for r in points),
                tuple(1e6 * (r.value - origin) for r in points),
                tuple(
                    1e6 * r.uncertainty.expanded_uncertainty
                    for r in points
                    if r.uncertainty is not None
                ),
            )
        )
    unit = "ppm" if table.units[0] == "1" else "µg"
    low = str(table.labels[0]).replace("-", "−") if table.labels else ""
    title = table.title + Words(f": change from {low} °C", f"：相对 {low} °C 的变化")
    return Figure(
        title,
        Words("case temperature [°C]", "壳温 [°C]"),
        Words(f"change [{unit}]", f"变化 [{unit}]"),
        tuple(series),
    )

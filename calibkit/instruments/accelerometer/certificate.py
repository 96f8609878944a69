"""Accelerometer results: K-factor, Q-factor and affine triad, coefficients and values over
temperature.
"""

from __future__ import annotations

import math
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
from calibkit.certificate.stated import (
    COEFFICIENT_NOTE,
    COEFFICIENTS,
    powers,
    range_words,
    residual_words,
)
from calibkit.certificate.words import Words

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Model, Record

AXES = "xyz"
PER_DEGREE = math.pi / 180.0
"""A reference attitude that is off by 1° turns the frame: cross terms change by as many radians,
scale and bias do not.
"""

K_EQUATION = Equation(
    "accel-k/1",
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
    "accel-affine/1",
    r"\mathbf{G}' = \mathbf{M}(t) (\mathbf{G} - \mathbf{b}(t)), \quad "
    r"M_{ij}(t) = \sum_k m_{ijk} t^k, \quad b_i(t) = \sum_k b_{ik} t^k",
    Words(
        "G indications [g], G' corrected [g], t case temperature [°C], g local gravity; n multiply"
        " products of indications.",
        "G 为示值 [g]，G' 为修正值 [g]，t 为壳温 [°C]，g 为当地重力；n 与示值之积相乘。",
    ),
)
Q_EQUATION = Equation(
    "accel-q/1",
    r"G_x' = G_x, \quad G_y' = Q_3 G_x + G_y, \quad G_z' = Q_2 G_x + Q_1 G_y + G_z",
    Words("G after scale factor and zero offset [g].", "G 为经标度因数与零位修正后的值 [g]。"),
)
SCALE = Words("Scale factor ", "标度因数 ")
ZERO = Words("Zero offset ", "零位 ")


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Blocks of the stages that the run holds."""
    made: list[Block] = []
    for file, layout in (
        ("accel_k.json", _k),
        ("accel_q.json", _q),
        ("accel_affine.json", _affine),
    ):
        if file in stated.records and stated.records[file].models:
            made.append(layout(stated, stated.records[file]))
    return tuple(made)


def _attitude(*, cross: bool) -> dict[str, tuple[float, float]]:
    """Sensitivity of a cross term to the reference attitude."""
    return (
        {"inclination_deg": (0.0, PER_DEGREE), "toolface_deg": (0.0, PER_DEGREE)} if cross else {}
    )


def _k(stated: Stated, record: Record) -> Block:
    """K-factor: coefficients of the three axes side by side, scale factor and zero offset at
    temperatures.
    """
    models = record.models
    names = [f"K{k}" for k in range(10) if any(m.value(f"K{k}") for m in models)]

    def coefficient(model: Model, name: str) -> Result:
        unit = next(c.unit for c in model.coefficients if c.name == name)
        cross = _attitude(cross=name in {"K8", "K9"})
        return stated.linear(
            record, model, name, Words(name), {name: 1.0}, unit, sensitivities=cross
        )

    cells = tuple(tuple(coefficient(model, name) for model in models) for name in names)
    units = tuple(row[0].unit for row in cells)
    axes = tuple(Words(model.name.removeprefix("accel_")) for model in models)
    table = GridTable(
        COEFFICIENTS, Words(""), axes, units, tuple(names), cells, COEFFICIENT_NOTE, by_row=True
    )
    tables = (
        table,
        *_over(stated, record, models, _k_scale),
        *_over(stated, record, models, _k_zero),
    )
    notes = (
        *(residual_words(m) for m in models),
        range_words(models[0]),
        *stated.left_out(models[0]),
    )
    figures = tuple(_curve(t) for t in tables[1:] if isinstance(t, GridTable))
    title = Words(
        "K-factor: scale factor, zero offset and cross terms", "K 系数：标度因数、零位与交叉耦合项"
    )
    return Block(record.stage, f"{record.stage}.json", title, (K_EQUATION,), tables, figures, notes)


Column = tuple[Words, str, "Callable[[float], Result | None]"]


def _over(
    stated: Stated, record: Record, models: tuple[Model, ...], column: Callable[..., Column]
) -> tuple[GridTable, ...]:
    """One quantity of every axis at temperatures."""
    temperatures = stated.grid(models[0])
    if not temperatures:
        return ()
    title = (
        Words("Scale factor over temperature", "标度因数随温度")
        if column is _k_scale
        else Words("Zero offset over temperature", "零位随温度")
    )
    return (stated.over(title, temperatures, [column(stated, record, model) for model in models]),)


def _k_scale(stated: Stated, record: Record, model: Model) -> Column:
    """K0 + K1 t + K2 t² + K3 t³ of one axis."""
    axis = model.name.removeprefix("accel_")

    def at(t: float) -> Result:
        weights = {f"K{k}": t**k for k in range(4)}
        slope = {f"K{k}": k * t ** (k - 1) for k in range(1, 4)}
        words = SCALE + Words(axis)
        main = t == stated.reference_degc
        return stated.linear(
            record, model, "scale", words, weights, "1", at=t, slope=slope, principal=main
        )

    return Words(axis), "1", at


def _k_zero(stated: Stated, record: Record, model: Model) -> Column:
    """K4 + K5 t + K6 t² + K7 t³ of one axis."""
    axis = model.name.removeprefix("accel_")

    def at(t: float) -> Result:
        weights = {f"K{k + 4}": t**k for k in range(4)}
        slope = {f"K{k + 4}": k * t ** (k - 1) for k in range(1, 4)}
        words = ZERO + Words(axis)
        main = t == stated.reference_degc
        return stated.linear(
            record, model, "zero", words, weights, "g", at=t, slope=slope, principal=main
        )

    return Words(axis), "g", at


def _q(stated: Stated, record: Record) -> Block:
    """Q-factor at its temperature."""
    model = record.models[0]
    results = tuple(
        stated.linear(
            record,
            model,
            c.name,
            Words("Non-orthogonality", "非正交角"),
            {c.name: 1.0},
            c.unit,
            sensitivities=_attitude(cross=True),
            principal=True,
        )
        for c in model.coefficients
    )
    at = next((p.value for p in model.parameters if p.name == "temperature"), None)
    notes: tuple[Words, ...] = (residual_words(model), range_words(model))
    if at is not None:
        notes = (Words(f"Q holds at {at:g} °C.", f"Q 系数对应温度 {at:g} °C。"), *notes)
    title = Words("Q-factor: non-orthogonality of the axes", "Q 系数：三轴非正交")
    table = ListTable(COEFFICIENTS, results)
    return Block(record.stage, f"{record.stage}.json", title, (Q_EQUATION,), (table,), (), notes)


def _affine(stated: Stated, record: Record) -> Block:
    """Affine triad: coefficients with the axes side by side, matrix and bias at temperatures."""
    model = record.models[0]
    tables: list[ListTable | GridTable] = [_affine_coefficients(stated, record, model)]
    temperatures = stated.grid(model)
    if temperatures:
        groups = (
            (
                Words("Diagonal of M over temperature", "M 对角元随温度"),
                [(f"m_{a}{a}", "1", False) for a in AXES],
            ),
            (
                Words("Cross terms of M over temperature", "M 交叉元随温度"),
                [(f"m_{a}{b}", "1", True) for a in AXES for b in AXES if a != b],
            ),
            (Words("Bias over temperature", "零偏随温度"), [(f"b_{a}", "g", False) for a in AXES]),
        )
        for title, entries in groups:
            columns = [
                _entry(stated, record, model, *e) for e in entries if powers(e[0], model, 0.0)[0]
            ]
            if columns:
                tables.append(stated.over(title, temperatures, columns))
    figures = tuple(
        _curve(t) for t in (tables[1], tables[-1]) if isinstance(t, GridTable) and len(tables) > 1
    )
    notes = (residual_words(model), range_words(model), *stated.left_out(model))
    title = Words("Affine triad: matrix and bias", "三轴仿射模型：矩阵与零偏")
    return Block(
        record.stage,
        f"{record.stage}.json",
        title,
        (AFFINE_EQUATION,),
        tuple(tables),
        figures,
        notes,
    )


def _affine_coefficients(stated: Stated, record: Record, model: Model) -> ListTable:
    """Every fitted coefficient of the triad."""
    results = tuple(
        stated.linear(
            record,
            model,
            c.name,
            Words(""),
            {c.name: 1.0},
            c.unit,
            sensitivities=_attitude(
                cross=c.name.startswith("m_") and c.name[2] != c.name[3] and c.name[4:] == "0"
            ),
        )
        for c in model.coefficients
        if c.value or c.standard_uncertainty
    )
    return ListTable(COEFFICIENTS, results, COEFFICIENT_NOTE)


def _entry(
    stated: Stated,
    record: Record,
    model: Model,
    prefix: str,
    unit: str,
    cross: bool,  # noqa: FBT001
) -> Column:
    """One entry of M or b as a function of temperature."""
    symbol = prefix.replace("m_", "M_")
    words = Words("Matrix entry ", "矩阵元 ") if prefix.startswith("m") else Words("Bias ", "零偏 ")

    def at(t: float) -> Result:
        weights, slope = powers(prefix, model, t)
        main = t == stated.reference_degc and not cross
        return stated.linear(
            record,
            model,
            prefix,
            words + Words(symbol),
            weights,
            unit,
            at=t,
            slope=slope,
            sensitivities=_attitude(cross=cross),
            principal=main,
        )

    return Words(symbol), unit, at


def _curve(table: GridTable) -> Figure:
    """Change of every column from its first row, with its expanded uncertainty."""
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

"""Bias results on a certificate: terms of each channel, and its bias at rest over temperature."""

from calibkit.certificate.names import name_model
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
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words, unit_mark
from calibkit.coefficients import Model, Record
from calibkit.instruments.thermal import forms, quantities
from calibkit.thermal_forms import CASE, RATE

LEVEL = Equation(
    forms.LEVEL.name,
    r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_{Tr} T \dot T",
    Words(
        "y indication at rest, T temperature [°C], Ṫ its rate [°C/min]. What is taken off is y less"
        " its value at rest at the reference temperature.",
        "y 为静态示值，T 为温度 [°C]，Ṫ 为其速率 [°C/min]。补偿量为 y 减去参考温度稳态时的值。",
    ),
)
LAGGED = Equation(
    forms.LAGGED.name,
    r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_G G + s_{Tr} T \dot T, "
    r"\quad \tau_o \dot T = T_s - T, \quad \tau_i \dot T_i = T - T_i, \quad G = T - T_i",
    Words(
        "y indication at rest, T a temperature that follows the thermometer T_s with the lag τₒ, G"
        " its excess over one that follows it with τᵢ. What is taken off is y less its value at"
        " rest at the reference temperature.",
        "y 为静态示值，T 以时间常数 τₒ 跟随温度计读数 T_s，G 为 T 与以 τᵢ 跟随其的温度之差。"
        "补偿量为 y 减去参考温度稳态时的值。",
    ),
)


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Block of thermal.json."""
    record = stated.records.get(forms.FILE)
    if record is None:
        return ()
    tables: list[ListTable | GridTable] = []
    figures: list[Figure] = []
    notes: list[Words] = []
    for model in record.models:
        title = name_model(model.name) + Words(": coefficients", "：系数")
        tables.append(stated.coefficients(record, model, title))
        table = _values(stated, record, model)
        if table is not None:
            tables.append(table)
            figures.append(_plot(model, table))
        notes += [residual_words(model), range_words(model), *stated.left_out(model)]
    used = {model.form for model in record.models}
    return (
        Block(
            record.stage,
            forms.FILE,
            Words("Bias over temperature", "零偏随温度"),
            tuple(equation for equation in (LEVEL, LAGGED) if equation.form in used),
            tuple(tables),
            tuple(figures),
            tuple(notes),
        ),
    )


def _values(stated: Stated, record: Record, model: Model) -> GridTable | None:
    """Bias of one channel at rest over temperature."""
    points = stated.grid(model)
    if not points:
        return None
    quantity = quantities.bias(record.stage, model)

    def at(t: float) -> Result:
        principal = t == stated.reference_degc
        return state(stated, quantity, {CASE: t, RATE: 0.0}, principal=principal, symbol="y")

    return stated.over(
        name_model(model.name) + Words(": bias at rest", "：稳态零偏"),
        points,
        [(quantity.words, quantity.unit, at)],
    )


def _plot(model: Model, table: GridTable) -> Figure:
    """Bias at rest over temperature with its expanded uncertainty."""
    points = [r for (r,) in table.cells if r is not None and r.uncertainty is not None]
    series = Series(
        Words("bias ± U", "零偏 ± U"),
        tuple(r.at[0][1] for r in points),
        tuple(r.value for r in points),
        tuple(r.uncertainty.expanded_uncertainty for r in points if r.uncertainty),
    )
    unit = unit_mark(model.residual_unit) or "1"
    axes = Words("temperature [°C]", "温度 [°C]"), Words(f"bias [{unit}]", f"零偏 [{unit}]")
    return Figure(table.title, *axes, (series,))

"""Results of a gyro's thermal drift: what each ramp gave, the exported drift model, drift at rest
and on ramps, hysteresis.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

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
    TEMPERATURE,
    powers,
    range_words,
    residual_words,
    weighted,
)
from calibkit.certificate.words import Words
from calibkit.numeric import earth, gum

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibkit.arrays import Array
    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Model, Record


GRADIENT = Equation(
    "fog-drift-gradient/1",
    r"\omega_k - \omega_{k-1} = a_0 + a_1 G_{k-1} + a_2 G_{k-1}^2",
    Words(
        "ω indicated rate [°/h] of the k-th interval, G case less chamber temperature [K].",
        "ω 为第 k 个区间的示值角速率 [°/h]，G 为壳温与箱温之差 [K]。",
    ),
)
RATE = Equation(
    "fog-drift-rate/1",
    r"a_j(r) = \sum_m c_{jm} r^m",
    Words("r temperature rate of the chamber air [°C/min].", "r 为箱内空气温变速率 [°C/min]。"),
)
LEVEL_WHERE = Words(
    "T case temperature [°C], Ṫ its rate [°C/min], G case less chamber temperature [K], Ġ its rate"
    " [K/min]. D, which is taken off, is ω less its value at rest at the reference temperature T₀:"
    " bias and earth's rate stay.",
    "T 为壳温 [°C]，Ṫ 为其速率 [°C/min]，G 为壳温与箱温之差 [K]，Ġ 为其速率 [K/min]。"
    "补偿量 D 为 ω 减去参考温度 T₀ 稳态时的值：零偏与地球自转分量保留在输出中。",
)
LAGGED_WHERE = Words(
    "T temperature of the coil's outside [°C], which follows the case with the lag τₒ; G its excess"
    " over the inside [K], which follows it with τᵢ. D, which is taken off, is ω less its value at"
    " rest at the reference temperature T₀: bias and earth's rate stay.",
    "T 为光纤环外层温度（以时间常数 τₒ 跟随壳温），G 为环内外层温差（内层以 τᵢ 跟随外层）。"
    "补偿量 D 为 ω 减去参考温度 T₀ 稳态时的值：零偏与地球自转分量保留在输出中。",
)
LATEX = (
    r"D = \omega - \omega(T_0), \quad \omega = b_0 + b_1 T + b_2 T^2 + b_3 T^3 "
    r"+ s_r \dot T + s_G G + s_{GG} G^2 + s_{Tr} T \dot T + s_{\dot G} \dot G"
)
EQUATIONS = {
    "fog-drift-rate/1": RATE,
    "fog-drift-level/1": Equation("fog-drift-level/1", LATEX, LEVEL_WHERE),
    "fog-drift-lagged/1": Equation(
        "fog-drift-lagged/1",
        rf"{LATEX}, \quad \tau_o \dot T_o = T_s - T_o, \quad \tau_i \dot T_i = T_o - T_i",
        LAGGED_WHERE,
    ),
}
RATES = (10.0, 5.0, 2.0, 1.0, 0.5)
"""Temperature rates [°C/min] of which the fastest that the model holds at is taken for the ramp
values.
"""
BIAS = "bias_at_reference"
AT_REST = Words("at rest", "稳态")


def blocks(stated: Stated) -> tuple[Block, ...]:
    """What was exported first, then what each ramp gave by itself, then the noise files."""
    made: list[Block] = []
    if "drift_rate.json" in stated.records:
        made.append(_exported(stated, stated.records["drift_rate.json"]))
    if "drift.json" in stated.records and stated.records["drift.json"].models:
        made.append(_ramps(stated, stated.records["drift.json"]))
    return tuple(made)


def _exported(stated: Stated, record: Record) -> Block:
    """The exported drift model, or the statement that none was."""
    tables: list[ListTable | GridTable] = []
    figures: list[Figure] = []
    notes: list[Words] = []
    for model in record.models:
        tables.append(
            stated.coefficients(
                record, model, Words(f"Coefficients of {model.name}", f"{model.name} 系数")
            )
        )
        if model.form in {"fog-drift-level/1", "fog-drift-lagged/1"}:
            more, drawn = _level_values(stated, record, model)
            tables += more
            figures += drawn
        elif model.form == "fog-drift-rate/1":
            tables.append(_rate_values(stated, record, model))
        notes += [residual_words(model), range_words(model), *stated.left_out(model)]
    if not record.models:
        notes.append(
            Words(
                "No drift term is exported: no model was better than the raw indication.",
                "未给出漂移项：无模型优于原始示值。",
            )
        )
    tables.append(_before_after(stated, record))
    equations = tuple(
        EQUATIONS[form]
        for form in dict.fromkeys(m.form for m in record.models)
        if form in EQUATIONS
    )
    title = Words("Thermal drift: the exported model", "热致漂移：输出模型")
    return Block(
        record.stage,
        f"{record.stage}.json",
        title,
        equations,
        tuple(tables),
        tuple(figures),
        tuple(notes),
    )


def _reference(stated: Stated, model: Model) -> float:
    """Reference temperature [°C], clamped to the fitted range."""
    low, high = model.valid[TEMPERATURE]
    return min(max(stated.reference_degc, low), high)


def _at_rest(stated: Stated, record: Record, model: Model) -> Callable[[float], Result]:
    """Drift at rest less that at the reference: b1 (T − T₀) + b2 (T² − T₀²) + …; the model error
    stands beside the fit.
    """
    reference = _reference(stated, model)

    def at(t: float) -> Result:
        weights, slope = powers("b", model, t)
        zero, _ = powers("b", model, reference)
        difference = {name: weights[name] - zero[name] for name in weights}
        found = stated.linear(
            record,
            model,
            "drift",
            Words("thermal drift at rest", "稳态热致漂移"),
            difference,
            "deg/h",
            at=t,
            slope=slope,
            symbol="D",
            principal=t == max(stated.grid(model)),
            more=_model_error(model),
        )
        return replace(found, uncertainty=None, by_definition=True) if t == reference else found

    return at


MODEL_ERROR = Words("model error on ramps left out", "留出温变的模型误差")


def _model_error(model: Model) -> tuple[tuple[Words, float, float], ...]:
    """What lasts on ramps that were left out of the fit, with its degrees of freedom."""
    chosen = {parameter.name: parameter.value for parameter in model.parameters}
    error, dof = chosen.get("model_error", 0.0), chosen.get("model_error_dof", math.inf)
    return ((MODEL_ERROR, error, dof),) if error > 0.0 else ()


def _level_values(
    stated: Stated, record: Record, model: Model
) -> tuple[list[ListTable | GridTable], list[Figure]]:
    """Bias at the reference; drift at rest over temperature, and of a lagged model on ramps."""
    reference = _reference(stated, model)
    found = (
        _with_earth(stated, record, model, reference),
        *_without_earth(stated, record, model, reference),
    )
    bias = ListTable(Words(f"Bias at {reference:g} °C", f"{reference:g} °C 零偏"), found)
    temperatures = stated.grid(model)
    if not temperatures:
        return [bias], []
    head = Words(
        f"Thermal drift against {reference:g} °C at rest", f"相对 {reference:g} °C 稳态的热致漂移"
    )
    note = Words(
        f"ref.: at rest at {reference:g} °C the drift is zero by definition.",
        f"ref.：按定义，{reference:g} °C 稳态漂移为零。",
    )
    columns = [
        (AT_REST, "deg/h", _at_rest(stated, record, model)),
        *_ramp_columns(stated, record, model),
    ]
    table = stated.over(
        head, temperatures, columns, note=note if reference in temperatures else None
    )
    return [bias, table], [_plot(table)]


def _ramp_columns(
    stated: Stated, record: Record, model: Model
) -> list[tuple[Words, str, Callable[[float], Result | None]]]:
    """Columns of drift on ramps both ways and their difference, of a lagged model."""
    rate = _rate(model)
    if rate is None:
        return []
    ways = (
        (Words(f"heating, {rate:g} °C/min", f"升温 {rate:g} °C/min"), rate, None),
        (Words(f"cooling, {rate:g} °C/min", f"降温 {rate:g} °C/min"), -rate, None),
        (Words("heating − cooling", "升温 − 降温"), rate, -rate),
    )
    return [
        (words, "deg/h", _on_ramp(stated, record, model, one, less)) for words, one, less in ways
    ]


def _with_earth(stated: Stated, record: Record, model: Model, reference: float) -> Result:
    """Bias at the reference, the earth's rate in it."""
    weights, slope = powers("b", model, reference)
    return stated.linear(
        record,
        model,
        "bias",
        Words("bias at rest, the earth's rate included", "稳态零偏（含地球自转分量）"),
        weights,
        "deg/h",
        at=reference,
        slope=slope,
        symbol="B",
        principal=True,
        more=_model_error(model),
    )


def _without_earth(
    stated: Stated, record: Record, model: Model, reference: float
) -> tuple[Result, ...]:
    """Bias at the reference without the earth's rate, where the run knew latitude and attitude of
    the input axis.
    """
    figures = {figure.name: figure for figure in record.figures}
    where = {condition.name: condition.value for condition in record.conditions}
    if BIAS not in figures or not {"latitude", "input_axis_elevation"} <= where.keys():
        return ()
    rate = figures["mean_rate_at_reference"].value
    axis = where["latitude"], where["input_axis_elevation"], where.get("input_axis_azimuth", 0.0)
    by_latitude = float(earth.along_axis_by_latitude(*axis))
    found = stated.result(
        f"{record.stage}.json",
        f"{record.stage}.{BIAS}",
        "B",
        Words("bias at rest without the earth's rate", "稳态零偏（不含地球自转分量）"),
        figures[BIAS].value,
        "deg/h",
        type_a=figures[BIAS].standard_uncertainty,
        dof=model.dof,
        called=(BIAS, f"{record.stage}.{model.name}.bias", "bias"),
        sensitivities={
            "latitude_deg": (where["latitude"], -by_latitude),
            "gyro_dph": (rate, 1.0),
            TEMPERATURE: (reference, weighted(model, powers("b", model, reference)[1])[0]),
        },
        at=((TEMPERATURE, reference, "degC"),),
        more=_model_error(model),
    )
    return (found,)


def _rate(model: Model) -> float | None:
    """Fastest round temperature rate [°C/min] that a lagged model holds at in both directions."""
    if model.form != "fog-drift-lagged/1":
        return None
    low, high = model.valid.get("temp_rate_degc_min", (0.0, 0.0))
    return next((rate for rate in RATES if rate <= min(-low, high)), None)


def _on_ramp(
    stated: Stated, record: Record, model: Model, rate: float, less: float | None
) -> Callable[[float], Result | None]:
    """Drift on a steady ramp against the reference at rest, or less that on another ramp, at a case
    temperature.

    On a steady ramp T_o = T_s − τ_o r and G = τ_i r. The derivatives by coefficients and lags come
    from central differences.
    """
    low, high = model.valid[TEMPERATURE]
    names = tuple(c.name for c in model.coefficients)
    best = np.array([c.value for c in model.coefficients])
    u = np.array([c.standard_uncertainty for c in model.coefficients])
    reference = _reference(stated, model)

    def drift(values: Array, t: float) -> float:
        c = dict(zip(names, values.tolist(), strict=True))
        return _steady(c, t, rate) - (
            _steady(c, reference, 0.0) if less is None else _steady(c, t, less)
        )

    def at(t: float) -> Result | None:
        lag = sum(model.value(name) for name in names if name == "tau_outer") / 60.0
        outer = [t - lag * r for r in (rate, *(() if less is None else (less,)))]
        if not all(low <= temperature <= high for temperature in outer):
            return None
        jacobian = gum.sensitivities(lambda values: np.array([drift(values, t)]), best, u)
        variance = float((jacobian @ np.array(model.covariance) @ jacobian.T)[0, 0])
        name = f"drift_{rate:+g}" if less is None else f"hysteresis_{rate:g}"
        slope = (drift(best, t + 0.5) - drift(best, t - 0.5)) / 1.0
        return stated.result(
            f"{record.stage}.json",
            f"{record.stage}.{model.name}.{name}",
            "D",
            (
                Words("thermal drift on a ramp", "温变热致漂移")
                if less is None
                else Words("hysteresis", "滞回")
            ),
            drift(best, t),
            "deg/h",
            type_a=math.sqrt(max(variance, 0.0)),
            dof=model.dof,
            called=(f"{record.stage}.{model.name}.{name}", name),
            sensitivities={TEMPERATURE: (t, slope)},
            at=((TEMPERATURE, t, "degC"), ("temp_rate", rate, "degC/min")),
            condition=f"{t:g}",
            more=_model_error(model),
        )

    return at


def _steady(c: dict[str, float], t: float, rate: float) -> float:
    """Drift [°/h] of a lagged model on a ramp [°C/min] that has lasted, at a case temperature
    [°C].
    """
    T = t - c.get("tau_outer", 0.0) * rate / 60.0
    G = c.get("tau_inner", 0.0) * rate / 60.0
    level = sum(c[f"b{k}"] * T**k for k in range(4))
    return (
        level
        + c["s_rate"] * rate
        + c["s_grad"] * G
        + c["s_grad2"] * G**2
        + c["s_temp_rate"] * T * rate
    )


def _plot(table: GridTable) -> Figure:
    """Drift over case temperature, at rest and on ramps."""
    series = []
    for k, head in enumerate(table.heads[:3]):
        points = [
            r
            for row in table.cells
            if (r := row[k]) is not None and (r.uncertainty or r.by_definition)
        ]
        U = tuple(r.uncertainty.expanded_uncertainty if r.uncertainty else 0.0 for r in points)
        series.append(
            Series(head, tuple(r.at[0][1] for r in points), tuple(r.value for r in points), U)
        )
    label = Words("drift [°/h]", "漂移 [°/h]")
    return Figure(table.title, Words("case temperature [°C]", "壳温 [°C]"), label, tuple(series))


def _rate_values(stated: Stated, record: Record, model: Model) -> GridTable:
    """a_j at rates inside the fitted range."""
    low, high = model.valid["temp_rate_degc_min"]
    rates = [
        r for r in (-10.0, -8.0, -5.0, -3.0, -1.0, 1.0, 3.0, 5.0, 8.0, 10.0) if low <= r <= high
    ] or [low, high]
    units = ("deg/h", "deg/h/K", "deg/h/K^2")

    def column(j: int) -> tuple[Words, str, Callable[[float], Result | None]]:
        def at(r: float) -> Result:
            weights, _ = powers(f"c{j}", model, r)
            return stated.linear(
                record,
                model,
                f"a{j}",
                Words(f"a{j}"),
                weights,
                units[j],
                at=r,
                condition=("temp_rate", "degC/min"),
            )

        return Words(f"a{j}"), units[j], at

    title = Words(
        f"Drift coefficients over temperature rate, {model.name}",
        f"漂移系数随温变速率（{model.name}）",
    )
    return stated.over(title, rates, [column(j) for j in range(3)], row_head=Words("r [°C/min]"))


def _before_after(stated: Stated, record: Record) -> GridTable:
    """Drift rms of the fitted logs before and after, with the rate gain: descriptors."""
    found = {figure.name: figure for figure in record.figures}
    logs = [name.partition(".")[2] for name in found if name.startswith("drift_rms_before.")]
    kinds = (
        ("drift_rms_before", Words("before", "补偿前"), "deg/h"),
        ("drift_rms_after", Words("after", "补偿后"), "deg/h"),
        ("rate_gain_recursive", Words("rate gain", "速率增益"), "1"),
    )
    cells = tuple(
        tuple(
            stated.figure(record, found[f"{kind}.{log}"], words, math.inf)
            for kind, words, _ in kinds
        )
        for log in logs
    )
    return GridTable(
        Words("Drift rms of the fitted logs, 100 s means", "拟合数据的漂移均方根（100 s 平均）"),
        Words("log", "数据"),
        tuple(words for _, words, _ in kinds),
        tuple(unit for _, _, unit in kinds),
        tuple(logs),
        cells,
        Words(
            "Descriptors of the fit, not of the gyro on other ramps; "
            "the rate gain is the share of a true constant rate that is left in the output.",
            "为拟合描述量，不代表其他温变条件；速率增益为真实恒定角速率在输出中的保留比例。",
        ),
    )


def _ramps(stated: Stated, record: Record) -> Block:
    """a0, a1, a2 of every ramp, per interval."""
    units = ("deg/h", "deg/h/K", "deg/h/K^2")
    cells = tuple(
        tuple(
            stated.linear(record, model, f"a{j}", Words(f"a{j}"), {f"a{j}": 1.0}, units[j])
            for j in range(3)
        )
        for model in record.models
    )
    labels = tuple(f"{m.name} ({m.value('rate'):+.2f} °C/min)" for m in record.models)
    heads = (Words("a₀"), Words("a₁"), Words("a₂"))
    title = Words("Drift coefficients of each ramp, per interval", "各温变的漂移系数（每区间）")
    table = GridTable(title, Words("ramp", "温变"), heads, units, labels, cells, COEFFICIENT_NOTE)
    interval = record.models[0].value("interval")
    note = Words(
        f"The coefficients are per interval of {interval:g} s.", f"系数对应区间 {interval:g} s。"
    )
    heading = Words("Thermal drift: each ramp by itself", "热致漂移：各次温变")
    return Block(record.stage, f"{record.stage}.json", heading, (GRADIENT,), (table,), (), (note,))

"""Biases over temperature on a certificate: coefficients of each model beside its equation, the
bias over its inputs; of a gyro the drift at rest and on ramps, and the coefficients of each ramp.
"""

from collections.abc import Sequence
from dataclasses import replace

from calibkit.certificate.blocks import (
    COEFFICIENT_NOTE,
    Table,
    lay_out_models,
    list_coefficients,
    make_block,
    note_models,
    plot,
    tabulate,
)
from calibkit.certificate.quantities import (
    Quantity,
    QuantityInput,
    coefficient,
    less,
    of_figure,
    polynomial,
    ranged,
    state,
)
from calibkit.certificate.results import Block, Equation, GridTable, ListTable, Result
from calibkit.certificate.stated import Stated
from calibkit.certificate.words import Words
from calibkit.instruments.bias import forms
from calibkit.instruments.bias.at_rest import RESULT as BIAS
from calibkit.instruments.bias.numeric.bank import ORIGIN_DEGC
from calibkit.instruments.bias.quantities import COIL_FORMS, RATES, FittedBias
from calibkit.numeric import earth
from calibkit.numeric.thermal.terms import CASE, RATE
from calibkit.records.coefficients import Record
from calibkit.records.forms import POLYNOMIAL

COEFFICIENT_RATES = (-10.0, -8.0, -5.0, -3.0, -1.0, 1.0, 3.0, 5.0, 8.0, 10.0)
"""Temperature rates [°C/min] that the coefficients of the published scheme are stated at."""
AT_REST = Words("at rest", "稳态")
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
BANK_WHERE = Words(
    "u case temperature, ρⱼ its rate behind the lag τⱼ [°C/min]; T follows u with the lags"
    " tau_fast and tau_static, z = (T − 25 °C)/50 °C; g a table over T, dₘ a play operator of"
    " T, t the time since switch-on, each where the model has it. D, which is taken off, is ω"
    " less its value at rest at the reference temperature T₀: bias and earth's rate stay.",
    "u 为壳温，ρⱼ 为经时间常数 τⱼ 滞后的温变速率 [°C/min]；T 以 tau_fast、tau_static 跟随 u，"
    "z = (T − 25 °C)/50 °C；g 为 T 的表，dₘ 为 T 的滞回算子，t 为通电后的时间（模型含有时）。"
    "补偿量 D 为 ω 减去参考温度 T₀ 稳态时的值：零偏与地球自转分量保留在输出中。",
)
LATEX = (
    r"D = \omega - \omega(T_0), \quad \omega = b_0 + b_1 T + b_2 T^2 + b_3 T^3 "
    r"+ s_r \dot T + s_G G + s_{GG} G^2 + s_{Tr} T \dot T + s_{\dot G} \dot G"
)
EQUATIONS = (
    Equation(
        POLYNOMIAL.name,
        r"p(T) = \sum_k p_k T^k",
        Words("T the abscissa named in the tables.", "T 为表中所示自变量。"),
    ),
    Equation(
        forms.BIAS_LEVEL.name,
        r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_{Tr} T \dot T",
        Words(
            "y indication at rest, T temperature [°C], Ṫ its rate [°C/min]. What is taken off is y"
            " less its value at rest at the reference temperature.",
            "y 为静态示值，T 为温度 [°C]，Ṫ 为其速率 [°C/min]。补偿量为 y 减去参考温度稳态时的值。",
        ),
    ),
    Equation(
        forms.BIAS_LAGGED.name,
        r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_G G + s_{Tr} T \dot T, "
        r"\quad \tau_o \dot T = T_s - T, \quad \tau_i \dot T_i = T - T_i, \quad G = T - T_i",
        Words(
            "y indication at rest, T a temperature that follows the thermometer T_s with the lag"
            " τₒ, G its excess over one that follows it with τᵢ. What is taken off is y less its"
            " value at rest at the reference temperature.",
            "y 为静态示值，T 以时间常数 τₒ 跟随温度计读数 T_s，G 为 T 与以 τᵢ 跟随其的温度之差。"
            "补偿量为 y 减去参考温度稳态时的值。",
        ),
    ),
    Equation(
        forms.PER_RAMP.name,
        r"\omega_k - \omega_{k-1} = a_0 + a_1 G_{k-1} + a_2 G_{k-1}^2",
        Words(
            "ω indicated rate [°/h] of the k-th interval, G case less chamber temperature [K].",
            "ω 为第 k 个区间的示值角速率 [°/h]，G 为壳温与箱温之差 [K]。",
        ),
    ),
    Equation(
        forms.OVER_RATES.name,
        r"a_j(r) = \sum_m c_{jm} r^m",
        Words("r temperature rate of the chamber air [°C/min].", "r 为箱内空气温变速率 [°C/min]。"),
    ),
    Equation(forms.LEVEL.name, LATEX, LEVEL_WHERE),
    Equation(
        forms.LAGGED.name,
        rf"{LATEX}, \quad \tau_o \dot T_o = T_s - T_o, \quad \tau_i \dot T_i = T_o - T_i",
        LAGGED_WHERE,
    ),
    Equation(
        forms.BANK.name,
        r"D = \omega - \omega(T_0), \quad \omega = b_0 + \sum_j (a_j + b_j z) \rho_j "
        r"+ \sum_k s_k z^k + g(T) + \sum_m h_m d_m + \sum_m w_m e^{-t/\theta_m}, "
        r"\quad \rho_j = (u - x_j)/\tau_j, \quad \tau_j \dot x_j = u - x_j",
        BANK_WHERE,
    ),
)


def blocks(basis: Stated) -> tuple[Block, ...]:
    """A block for each coefficient file with models; the exported drift term of a gyro first."""
    title, laid_out = Words("Bias over temperature", "零偏随温度"), []
    for record in sorted(basis.records.values(), key=lambda record: record.stage == "drift"):
        used = {model.form for model in record.models}
        equations = [equation for equation in EQUATIONS if equation.form in used]
        if record.stage == "drift_rate":
            laid_out.append(_exported(basis, record, equations))
        elif record.stage == "drift" and record.models:
            laid_out.append(_ramps(basis, record, equations))
        elif record.models:
            fitted = [FittedBias(model, basis.reference_degc) for model in record.models]
            biases = [bias.quantities(record.stage)[0] for bias in fitted]
            laid_out.append(lay_out_models(basis, record, title, equations, biases))
    return tuple(laid_out)


def _exported(basis: Stated, record: Record, equations: Sequence[Equation]) -> Block:
    """Block of the exported drift model, or of the statement that none was exported."""
    tables: list[Table | None] = []
    figures = []
    notes = note_models(basis, record.models)
    for model in record.models:
        title = Words(f"Coefficients of {model.name}", f"{model.name} 系数")
        if model.form in forms.ON_LEVELS:
            levels = FittedBias(model, basis.reference_degc)
            rate, _ = levels.quantities(record.stage)
            # b0 is the rate at rest at the model's origin, and as uncertain as one
            origin = {CASE: ORIGIN_DEGC if model.form == forms.BANK.name else 0.0}
            drift = _tabulate_drift(basis, record, levels)
            tables += [
                list_coefficients(basis, record, model, title, [rate], origin),
                _list_bias(basis, record, levels),
                drift,
            ]
            if drift is not None:
                label = Words("drift [°/h]", "漂移 [°/h]")
                figures.append(plot(drift, label, labels=drift.heads[:3]))
        else:
            # a_j at temperature rates within the fitted range
            rates, order = ranged(model, RATE), len(model.coefficients) // 3 - 1
            columns = []
            for j, unit in enumerate(forms.GRADIENT_UNITS):
                name, point = f"a{j}", polynomial(model, forms.rate_names(order)[j], RATE)
                a_j = Quantity(name, record.stage, model.name, Words(name), unit, (rates,), point)
                columns.append((a_j.words, a_j))
            heading = Words(
                f"Drift coefficients over temperature rate, {model.name}",
                f"漂移系数随温变速率（{model.name}）",
            )
            points = [rate for rate in COEFFICIENT_RATES if rates.low <= rate <= rates.high]
            points, head = points or [rates.low, rates.high], Words("r [°C/min]")
            tables += [
                list_coefficients(basis, record, model, title),
                tabulate(basis, heading, columns, points, row_head=head),
            ]
    if not record.models:
        notes.append(
            Words(
                "No drift term is exported: no model was better than the raw indication.",
                "未给出漂移项：无模型优于原始示值。",
            )
        )
    title = Words("Thermal drift: the exported model", "热致漂移：输出模型")
    tables.append(_before_after(basis, record))
    return make_block(record, title, equations, tables, figures, notes)


def _list_bias(basis: Stated, record: Record, levels: FittedBias) -> ListTable:
    """Bias at the reference including the earth's rate, and without it if latitude and attitude of
    the input axis are known.
    """
    rate, _ = levels.quantities(record.stage)
    reference_point = {CASE: levels.reference}
    words = Words("bias at rest, the earth's rate included", "稳态零偏（含地球自转分量）")
    bias = state(basis, replace(rate, words=words, inputs=rate.inputs[:1]), reference_point)
    results = [bias]
    figures = {figure.name: figure for figure in record.figures}
    condition_values = {condition.name: condition.value for condition in record.conditions}
    if BIAS in figures and {"latitude", "input_axis_elevation"} <= condition_values.keys():
        latitude, elevation = condition_values["latitude"], condition_values["input_axis_elevation"]
        azimuth = condition_values.get("input_axis_azimuth", 0.0)
        axis = latitude, elevation, azimuth
        by_latitude, by_elevation, by_azimuth = earth.along_axis_slopes(*axis).tolist()
        rate_at_rest = levels.bias(reference_point)
        bias_alone = Quantity(
            *(BIAS, record.stage, ""),
            Words("bias at rest without the earth's rate", "稳态零偏（不含地球自转分量）"),
            *("deg/h", ()),
            lambda _: replace(
                rate_at_rest,
                value=figures[BIAS].value,
                influences={
                    "latitude_deg": (latitude, -by_latitude),
                    "input_axis_elevation_deg": (elevation, -by_elevation),
                    "input_axis_azimuth_deg": (azimuth, -by_azimuth),
                },
            ),
            called=(bias.quantity, "bias"),
            symbol="B",
        )
        results.append(replace(state(basis, bias_alone, {}), at=bias.at))
    place = f"{levels.reference:g} °C"
    return ListTable(Words(f"Bias at {place}", f"{place} 零偏"), tuple(results))


def _tabulate_drift(basis: Stated, record: Record, levels: FittedBias) -> GridTable | None:
    """Drift over temperature: at rest, and of a model with lags on its fastest ramp in both
    directions, and between the two.
    """
    reference, case = f"{levels.reference:g} °C", levels.inputs[:1]
    temperatures = basis.grid(CASE, case[0].low, case[0].high)
    _, drift = levels.quantities(record.stage)
    drift_at_rest = replace(
        drift,
        words=Words("thermal drift at rest", "稳态热致漂移"),
        inputs=case,
        beyond=None,
        principal=True,
    )
    title = Words(f"Thermal drift against {reference} at rest", f"相对 {reference} 稳态的热致漂移")
    note = Words(
        f"ref.: at rest at {reference} the drift is zero by definition.",
        f"ref.：按定义，{reference} 稳态漂移为零。",
    )
    columns = [(AT_REST, drift_at_rest)]
    # a model with lags holds on a ramp where the coil is within its range
    low, high = levels.model.valid.get(RATE, (0.0, 0.0))
    rate = next((rate for rate in RATES if rate <= min(-low, high)), None)
    if levels.model.form in COIL_FORMS and rate is not None:

        def on_ramp(way: float) -> Quantity:
            return replace(
                drift_at_rest,
                name=f"drift_{way:+g}",
                words=Words("thermal drift on a ramp", "温变热致漂移"),
                inputs=(*drift_at_rest.inputs, QuantityInput(RATE, low, high, way)),
                beyond=levels.beyond,
                principal=False,
            )

        heating, cooling = on_ramp(rate), on_ramp(-rate)
        difference = replace(
            heating,
            name=f"hysteresis_{rate:g}",
            words=Words("hysteresis", "滞回"),
            point=lambda at: less(levels.bias(at), levels.bias({**at, RATE: -rate})),
            beyond=lambda at: levels.beyond(at) or levels.beyond({**at, RATE: -rate}),
        )
        columns += [
            (Words(f"heating, {rate:g} °C/min", f"升温 {rate:g} °C/min"), heating),
            (Words(f"cooling, {rate:g} °C/min", f"降温 {rate:g} °C/min"), cooling),
            (Words("heating − cooling", "升温 − 降温"), difference),
        ]
    return tabulate(
        basis,
        title,
        columns,
        temperatures,
        note=note if levels.reference in temperatures else None,
        principal_at=temperatures[-1] if temperatures else None,
    )


def _before_after(basis: Stated, record: Record) -> GridTable:
    """Table of the fitted logs' drift rms before and after compensation, with the rate gain."""
    figures = {figure.name: figure for figure in record.figures}
    logs = [name.partition(".")[2] for name in figures if name.startswith("drift_rms_before.")]
    figure_kinds = (
        ("drift_rms_before", Words("before", "补偿前"), "deg/h"),
        ("drift_rms_after", Words("after", "补偿后"), "deg/h"),
        ("noise_rms", Words("noise alone", "仅噪声"), "deg/h"),
        ("drift_left_rms", Words("drift left", "剩余漂移"), "deg/h"),
        ("rate_gain_recursive", Words("rate gain", "速率增益"), "1"),
    )
    # files of before do not state the noise
    kinds = [kind for kind in figure_kinds if all(f"{kind[0]}.{log}" in figures for log in logs)]

    def cell(kind: str, words: Words, log: str) -> Result:
        figure = of_figure(record, figures[f"{kind}.{log}"], words)
        return state(basis, replace(figure, magnitude=kind == "drift_left_rms"), {})

    cells = tuple(tuple(cell(kind, words, log) for kind, words, _ in kinds) for log in logs)
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


def _ramps(basis: Stated, record: Record, equations: Sequence[Equation]) -> Block:
    """Block of a0, a1, a2 of every ramp, per interval."""
    cells = tuple(
        tuple(
            state(basis, coefficient(record, model, c.name, Words(c.name)), {})
            for c in model.coefficients
        )
        for model in record.models
    )
    table = GridTable(
        Words("Drift coefficients of each ramp, per interval", "各温变的漂移系数（每区间）"),
        Words("ramp", "温变"),
        (Words("a₀"), Words("a₁"), Words("a₂")),
        forms.GRADIENT_UNITS,
        tuple(f"{m.name} ({m.value('rate'):+.2f} °C/min)" for m in record.models),
        cells,
        COEFFICIENT_NOTE,
    )
    interval = record.models[0].value("interval")
    note = Words(
        f"The coefficients are per interval of {interval:g} s.", f"系数对应区间 {interval:g} s。"
    )
    heading = Words("Thermal drift: each ramp by itself", "热致漂移：各次温变")
    return make_block(record, heading, equations, (table,), (), (note,))

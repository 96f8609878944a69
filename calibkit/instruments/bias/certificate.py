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
AT_REST = Words("at rest")
LEVEL_WHERE = Words(
    "T case temperature [°C], Ṫ its rate [°C/min], G case less chamber temperature [K], Ġ its rate"
    " [K/min]. D, which is taken off, is ω less its value at rest at the reference temperature T₀:"
    " bias and earth's rate stay."
)
LAGGED_WHERE = Words(
    "T temperature of the coil's outside [°C], which follows the case with the lag τₒ; G its excess"
    " over the inside [K], which follows it with τᵢ. D, which is taken off, is ω less its value at"
    " rest at the reference temperature T₀: bias and earth's rate stay."
)
BANK_WHERE = Words(
    "u case temperature, ρⱼ its rate behind the lag τⱼ [°C/min]; T follows u with the lags"
    " tau_fast and tau_static, z = (T − 25 °C)/50 °C; g a table over T, dₘ a play operator of"
    " T, t the time since switch-on, each where the model has it. D, which is taken off, is ω"
    " less its value at rest at the reference temperature T₀: bias and earth's rate stay."
)
LATEX = (
    r"D = \omega - \omega(T_0), \quad \omega = b_0 + b_1 T + b_2 T^2 + b_3 T^3 "
    r"+ s_r \dot T + s_G G + s_{GG} G^2 + s_{Tr} T \dot T + s_{\dot G} \dot G"
)
EQUATIONS = (
    Equation(
        POLYNOMIAL.name,
        r"p(T) = \sum_k p_k T^k",
        Words("T the abscissa named in the tables."),
    ),
    Equation(
        forms.BIAS_LEVEL.name,
        r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_{Tr} T \dot T",
        Words(
            "y indication at rest, T temperature [°C], Ṫ its rate [°C/min]. What is taken off is y"
            " less its value at rest at the reference temperature."
        ),
    ),
    Equation(
        forms.BIAS_LAGGED.name,
        r"y = b_0 + b_1 T + b_2 T^2 + b_3 T^3 + s_r \dot T + s_G G + s_{Tr} T \dot T, "
        r"\quad \tau_o \dot T = T_s - T, \quad \tau_i \dot T_i = T - T_i, \quad G = T - T_i",
        Words(
            "y indication at rest, T a temperature that follows the thermometer T_s with the lag"
            " τₒ, G its excess over one that follows it with τᵢ. What is taken off is y less its"
            " value at rest at the reference temperature."
        ),
    ),
    Equation(
        forms.PER_RAMP.name,
        r"\omega_k - \omega_{k-1} = a_0 + a_1 G_{k-1} + a_2 G_{k-1}^2",
        Words("ω indicated rate [°/h] of the k-th interval, G case less chamber temperature [K]."),
    ),
    Equation(
        forms.OVER_RATES.name,
        r"a_j(r) = \sum_m c_{jm} r^m",
        Words("r temperature rate of the chamber air [°C/min]."),
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
    title, laid_out = Words("Bias over temperature"), []
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
        title = Words("Coefficients of {name}", name=model.name)
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
                label = Words("drift [°/h]")
                figures.append(plot(drift, label, labels=drift.heads[:3]))
        else:
            # a_j at temperature rates within the fitted range
            rates, order = ranged(model, RATE), len(model.coefficients) // 3 - 1
            columns = []
            for j, unit in enumerate(forms.GRADIENT_UNITS):
                name, point = f"a{j}", polynomial(model, forms.rate_names(order)[j], RATE)
                a_j = Quantity(
                    name, record.stage, model.name, Words.literal(name), unit, (rates,), point
                )
                columns.append((a_j.words, a_j))
            heading = Words("Drift coefficients over temperature rate, {name}", name=model.name)
            points = [rate for rate in COEFFICIENT_RATES if rates.low <= rate <= rates.high]
            points, head = points or [rates.low, rates.high], Words.literal("r [°C/min]")
            tables += [
                list_coefficients(basis, record, model, title),
                tabulate(basis, heading, columns, points, row_head=head),
            ]
    if not record.models:
        notes.append(
            Words("No drift term is exported: no model was better than the raw indication.")
        )
    title = Words("Thermal drift: the exported model")
    tables.append(_before_after(basis, record))
    return make_block(record, title, equations, tables, figures, notes)


def _list_bias(basis: Stated, record: Record, levels: FittedBias) -> ListTable:
    """Bias at the reference including the earth's rate, and without it if latitude and attitude of
    the input axis are known.
    """
    rate, _ = levels.quantities(record.stage)
    reference_point = {CASE: levels.reference}
    words = Words("bias at rest, the earth's rate included")
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
            Words("bias at rest without the earth's rate"),
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
    return ListTable(Words("Bias at {place}", place=place), tuple(results))


def _tabulate_drift(basis: Stated, record: Record, levels: FittedBias) -> GridTable | None:
    """Drift over temperature: at rest, and of a model with lags on its fastest ramp in both
    directions, and between the two.
    """
    reference, case = f"{levels.reference:g} °C", levels.inputs[:1]
    temperatures = basis.grid(CASE, case[0].low, case[0].high)
    _, drift = levels.quantities(record.stage)
    drift_at_rest = replace(
        drift,
        words=Words("thermal drift at rest"),
        inputs=case,
        beyond=None,
        principal=True,
    )
    title = Words("Thermal drift against {reference} at rest", reference=reference)
    note = Words(
        "ref.: at rest at {reference} the drift is zero by definition.", reference=reference
    )
    columns = [(AT_REST, drift_at_rest)]
    # a model with lags holds on a ramp where the coil is within its range
    low, high = levels.model.valid.get(RATE, (0.0, 0.0))
    # fitted in both directions
    rate = next((rate for rate in RATES if rate <= min(-low, high)), None)
    if levels.model.form in COIL_FORMS and rate is not None:

        def on_ramp(way: float) -> Quantity:
            return replace(
                drift_at_rest,
                name=f"drift_{way:+g}",
                words=Words("thermal drift on a ramp"),
                inputs=(*drift_at_rest.inputs, QuantityInput(RATE, low, high, way)),
                beyond=levels.beyond,
                principal=False,
            )

        heating, cooling = on_ramp(rate), on_ramp(-rate)
        difference = replace(
            heating,
            name=f"hysteresis_{rate:g}",
            words=Words("hysteresis"),
            point=lambda at: less(levels.bias(at), levels.bias({**at, RATE: -rate})),
            beyond=lambda at: levels.beyond(at) or levels.beyond({**at, RATE: -rate}),
        )
        columns += [
            (Words("heating, {rate:g} °C/min", rate=rate), heating),
            (Words("cooling, {rate:g} °C/min", rate=rate), cooling),
            (Words("heating − cooling"), difference),
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
        ("drift_rms_before", Words("before"), "deg/h"),
        ("drift_rms_after", Words("after"), "deg/h"),
        ("noise_rms", Words("noise alone"), "deg/h"),
        ("drift_left_rms", Words("drift left"), "deg/h"),
        ("rate_gain_recursive", Words("rate gain"), "1"),
    )
    # files of before do not state the noise
    kinds = [kind for kind in figure_kinds if all(f"{kind[0]}.{log}" in figures for log in logs)]

    def cell(kind: str, words: Words, log: str) -> Result:
        # a magnitude has no sign, and its interval ends at zero
        figure = of_figure(record, figures[f"{kind}.{log}"], words)
        return state(basis, replace(figure, magnitude=kind == "drift_left_rms"), {})

    cells = tuple(tuple(cell(kind, words, log) for kind, words, _ in kinds) for log in logs)
    return GridTable(
        Words("Drift rms of the fitted logs, 100 s means"),
        Words("log"),
        tuple(words for _, words, _ in kinds),
        tuple(unit for _, _, unit in kinds),
        tuple(logs),
        cells,
        Words(
            "Descriptors of the fit, not of the gyro on other ramps; "
            "the rate gain is the share of a true constant rate that is left in the output."
        ),
    )


def _ramps(basis: Stated, record: Record, equations: Sequence[Equation]) -> Block:
    """Block of a0, a1, a2 of every ramp, per interval."""
    cells = tuple(
        tuple(
            state(basis, coefficient(record, model, c.name, Words.literal(c.name)), {})
            for c in model.coefficients
        )
        for model in record.models
    )
    table = GridTable(
        Words("Drift coefficients of each ramp, per interval"),
        Words("ramp"),
        (Words.literal("a₀"), Words.literal("a₁"), Words.literal("a₂")),
        forms.GRADIENT_UNITS,
        tuple(f"{m.name} ({m.value('rate'):+.2f} °C/min)" for m in record.models),
        cells,
        COEFFICIENT_NOTE,
    )
    interval = record.models[0].value("interval")
    note = Words("The coefficients are per interval of {interval:g} s.", interval=interval)
    heading = Words("Thermal drift: each ramp by itself")
    return make_block(record, heading, equations, (table,), (), (note,))

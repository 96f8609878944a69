"""Certificate of the thermal drift: exported model, drift at rest and on ramps, hysteresis."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calibkit.certificate.quantities import At, Point, Quantity, state
from calibkit.certificate.results import (
    Block,
    Figure,
    GridTable,
    ListTable,
    Result,
    Series,
)
from calibkit.certificate.stated import (
    COEFFICIENT_NOTE,
    Stated,
    range_words,
    residual_words,
)
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.fog_thermal import equations, forms
from calibkit.instruments.fog_thermal.bias import RESULT as BIAS
from calibkit.instruments.fog_thermal.numeric.bank import ORIGIN_DEGC
from calibkit.instruments.fog_thermal.quantities import (
    LAGS,
    RATES,
    OnLevels,
    difference as between,
)
from calibkit.numeric import earth
from calibkit.thermal_forms import CASE, GRADIENT, RATE

COEFFICIENT_RATES = (-10.0, -8.0, -5.0, -3.0, -1.0, 1.0, 3.0, 5.0, 8.0, 10.0)
"""Temperature rates [°C/min] that the coefficients of the published scheme are stated at."""
AT_REST = Words("at rest", "稳态")


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Blocks of the exported drift model and of the coefficients of each ramp."""
    made: list[Block] = []
    if forms.FILE in stated.records:
        made.append(_exported(stated, stated.records[forms.FILE]))
    if "drift.json" in stated.records and stated.records["drift.json"].models:
        made.append(_ramps(stated, stated.records["drift.json"]))
    return tuple(made)


def _exported(stated: Stated, record: Record) -> Block:
    """Block of the exported drift model, or of the statement that none was exported."""
    tables: list[ListTable | GridTable] = []
    notes: list[Words] = []
    for model in record.models:
        tables.append(_tabulate_coefficients(stated, record, model))
        if model.form in forms.ON_LEVELS:
            tables += _OnLevels(stated, record, model).tables()
        elif model.form == forms.OVER_RATES.name:
            tables.append(_rate_values(stated, record, model))
        notes += [residual_words(model), range_words(model), *stated.left_out(model)]
    on_levels = [model for model in record.models if model.form in forms.ON_LEVELS]
    drawn = [table for table in tables if isinstance(table, GridTable)] if on_levels else []
    if not record.models:
        notes.append(
            Words(
                "No drift term is exported: no model was better than the raw indication.",
                "未给出漂移项：无模型优于原始示值。",
            )
        )
    return Block(
        record.stage,
        f"{record.stage}.json",
        Words("Thermal drift: the exported model", "热致漂移：输出模型"),
        tuple(
            equation
            for equation in equations.EXPORTED
            if equation.form in {model.form for model in record.models}
        ),
        (*tables, _before_after(stated, record)),
        tuple(map(_plot, drawn)),
        tuple(notes),
    )


def _tabulate_coefficients(stated: Stated, record: Record, model: Model) -> ListTable:
    """Coefficients of a model; b0 of one on levels is the rate at rest at its origin, and as
    uncertain as one.
    """
    title = Words(f"Coefficients of {model.name}", f"{model.name} 系数")
    if model.form not in forms.ON_LEVELS:
        return stated.coefficients(record, model, title)
    origin = ORIGIN_DEGC if model.form == forms.BANK.name else 0.0
    levels = OnLevels(model, stated.reference_degc)
    also = {"b0": ("bias",)} if origin == levels.reference else {}
    return stated.coefficients(record, model, title, {"b0": levels.rate({CASE: origin}).more}, also)


@dataclass(frozen=True, slots=True)
class _OnLevels:
    """Results of a level or lagged model: bias at the reference, drift at rest and on ramps."""

    stated: Stated
    record: Record
    model: Model

    @property
    def levels(self) -> OnLevels:
        """The model as a function of its inputs."""
        return OnLevels(self.model, self.stated.reference_degc)

    @property
    def reference(self) -> float:
        """Reference temperature [°C], clamped to the fitted range."""
        return self.levels.reference

    def tables(self) -> list[ListTable | GridTable]:
        """Tables of the bias at the reference and of the drift over temperature."""
        at = f"{self.reference:g} °C"
        bias = ListTable(Words(f"Bias at {at}", f"{at} 零偏"), self._bias())
        temperatures = self.stated.grid(self.model)
        if not temperatures:
            return [bias]
        note = Words(
            f"ref.: at rest at {at} the drift is zero by definition.",
            f"ref.：按定义，{at} 稳态漂移为零。",
        )
        drift = self.stated.over(
            Words(f"Thermal drift against {at} at rest", f"相对 {at} 稳态的热致漂移"),
            temperatures,
            [
                (AT_REST, "deg/h", lambda t: self._at_rest(t, principal=t == temperatures[-1])),
                *self._on_ramps(),
            ],
            note=note if self.reference in temperatures else None,
        )
        return [bias, drift]

    def _result(
        self,
        name: str,
        words: Words,
        t: float,
        point: Callable[[At], Point],
        *,
        rate: float = 0.0,
        symbol: str = "D",
        principal: bool = False,
    ) -> Result:
        """Result at a case temperature [°C] and rate [°C/min], with uncertainty."""
        at = {CASE: t, RATE: rate}
        inputs = self.levels.inputs[:1]
        quantity = Quantity(
            name, self.record.stage, self.model.name, words, "deg/h", inputs, lambda _: point(at)
        )
        found = state(self.stated, quantity, at, principal=principal, symbol=symbol)
        ramp = (("temp_rate", rate, "degC/min"),) if rate else ()
        return replace(found, at=(*found.at, *ramp))

    def _bias(self) -> tuple[Result, ...]:
        """Bias at the reference including the earth's rate, and without it if latitude and attitude
        of the input axis are known.
        """
        levels = self.levels
        words = Words("bias at rest, the earth's rate included", "稳态零偏（含地球自转分量）")
        bias = self._result("bias", words, self.reference, levels.rate, symbol="B", principal=True)
        figures = {figure.name: figure for figure in self.record.figures}
        where = {condition.name: condition.value for condition in self.record.conditions}
        if BIAS not in figures or not {"latitude", "input_axis_elevation"} <= where.keys():
            return (bias,)
        rest = levels.rate({CASE: self.reference})
        latitude, azimuth = where["latitude"], where.get("input_axis_azimuth", 0.0)
        axis = latitude, where["input_axis_elevation"], azimuth
        by_elevation, by_azimuth = earth.along_axis_by_attitude(*axis)
        own = self.stated.result(
            f"{self.record.stage}.json",
            f"{self.record.stage}.{BIAS}",
            "B",
            Words("bias at rest without the earth's rate", "稳态零偏（不含地球自转分量）"),
            figures[BIAS].value,
            "deg/h",
            type_a=0.0,
            dof=math.inf,
            called=(BIAS, bias.quantity, "bias"),
            influences={
                **self.stated.of_models(rest.parts)[0],
                ("latitude_deg", "offset"): -float(earth.along_axis_by_latitude(*axis)),
                ("input_axis_elevation_deg", "offset"): -by_elevation,
                ("input_axis_azimuth_deg", "offset"): -by_azimuth,
            },
            at=bias.at,
            more=rest.type_a(),
        )
        return bias, own

    def _at_rest(self, t: float, *, principal: bool) -> Result:
        """Drift at rest at a case temperature [°C]."""
        words = Words("thermal drift at rest", "稳态热致漂移")
        found = self._result("drift", words, t, self.levels.drift, principal=principal)
        return (
            replace(found, uncertainty=None, by_definition=True) if t == self.reference else found
        )

    def _on_ramps(self) -> list[tuple[Words, str, Callable[[float], Result | None]]]:
        """Columns of a lagged model's drift on ramps; cells are empty where the coil is out of
        range.
        """
        if self.model.form not in LAGS:
            return []
        low, high = self.model.valid.get(RATE, (0.0, 0.0))
        rate = next((rate for rate in RATES if rate <= min(-low, high)), None)
        if rate is None:
            return []

        def drift(t: float, way: float) -> Result | None:
            if self.levels.beyond({CASE: t, RATE: way}):
                return None
            words = Words("thermal drift on a ramp", "温变热致漂移")
            return self._result(f"drift_{way:+g}", words, t, self.levels.drift, rate=way)

        def difference(t: float) -> Result | None:
            ways = [{CASE: t, RATE: way} for way in (rate, -rate)]
            if any(map(self.levels.beyond, ways)):
                return None
            apart = between(*map(self.levels.rate, ways))
            words = Words("hysteresis", "滞回")
            return self._result(f"hysteresis_{rate:g}", words, t, lambda _: apart, rate=rate)

        return [
            (
                Words(f"heating, {rate:g} °C/min", f"升温 {rate:g} °C/min"),
                "deg/h",
                lambda t: drift(t, rate),
            ),
            (
                Words(f"cooling, {rate:g} °C/min", f"降温 {rate:g} °C/min"),
                "deg/h",
                lambda t: drift(t, -rate),
            ),
            (Words("heating − cooling", "升温 − 降温"), "deg/h", difference),
        ]


def _plot(table: GridTable) -> Figure:
    """Figure of the drift over case temperature, at rest and on ramps."""
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
    return Figure(
        table.title,
        Words("case temperature [°C]", "壳温 [°C]"),
        Words("drift [°/h]", "漂移 [°/h]"),
        tuple(series),
    )


def _rate_values(stated: Stated, record: Record, model: Model) -> GridTable:
    """Table of a_j at temperature rates within the fitted range."""
    low, high = model.valid[RATE]
    rates = [rate for rate in COEFFICIENT_RATES if low <= rate <= high] or [low, high]
    order = len(model.coefficients) // 3 - 1

    def at(j: int, rate: float) -> Result:
        weights = forms.OVER_RATES.gradient(
            model, {GRADIENT: np.ones(1), RATE: np.array([rate])}
        ).reshape(3, -1)[j]
        return stated.linear(
            record,
            model,
            f"a{j}",
            Words(f"a{j}"),
            dict(zip(forms.rate_names(order)[j], weights.tolist(), strict=True)),
            forms.GRADIENT_UNITS[j],
            at=rate,
            condition=("temp_rate", "degC/min"),
        )

    title = Words(
        f"Drift coefficients over temperature rate, {model.name}",
        f"漂移系数随温变速率（{model.name}）",
    )
    columns = [
        (Words(f"a{j}"), unit, partial(at, j)) for j, unit in enumerate(forms.GRADIENT_UNITS)
    ]
    return stated.over(title, rates, columns, row_head=Words("r [°C/min]"))


def _before_after(stated: Stated, record: Record) -> GridTable:
    """Table of the fitted logs' drift rms before and after compensation, with the rate gain."""
    found = {figure.name: figure for figure in record.figures}
    logs = [name.partition(".")[2] for name in found if name.startswith("drift_rms_before.")]
    named = (
        ("drift_rms_before", Words("before", "补偿前"), "deg/h"),
        ("drift_rms_after", Words("after", "补偿后"), "deg/h"),
        ("noise_rms", Words("noise alone", "仅噪声"), "deg/h"),
        ("drift_left_rms", Words("drift left", "剩余漂移"), "deg/h"),
        ("rate_gain_recursive", Words("rate gain", "速率增益"), "1"),
    )
    # files of before do not state the noise
    kinds = [kind for kind in named if all(f"{kind[0]}.{log}" in found for log in logs)]
    cells = tuple(
        tuple(
            stated.figure(
                record, found[f"{kind}.{log}"], words, math.inf, magnitude=kind == "drift_left_rms"
            )
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
    """Block of a0, a1, a2 of every ramp, per interval."""
    units = forms.GRADIENT_UNITS
    cells = tuple(
        tuple(
            stated.linear(record, model, c.name, Words(c.name), {c.name: 1.0}, c.unit)
            for c in model.coefficients
        )
        for model in record.models
    )
    labels = tuple(f"{m.name} ({m.value('rate'):+.2f} °C/min)" for m in record.models)
    heads = (Words("a₀"), Words("a₁"), Words("a₂"))
    table = GridTable(
        Words("Drift coefficients of each ramp, per interval", "各温变的漂移系数（每区间）"),
        Words("ramp", "温变"),
        heads,
        units,
        labels,
        cells,
        COEFFICIENT_NOTE,
    )
    interval = record.models[0].value("interval")
    note = Words(
        f"The coefficients are per interval of {interval:g} s.", f"系数对应区间 {interval:g} s。"
    )
    heading = Words("Thermal drift: each ramp by itself", "热致漂移：各次温变")
    file, equation = f"{record.stage}.json", equations.PER_RAMP
    return Block(record.stage, file, heading, (equation,), (table,), (), (note,))

"""Thermal drift model and its logs → mean rate at the reference temperature, earth's rate along the
input axis, and bias.

Also the turn-on bias of each log, and the hysteresis of the residual drift (cooling less heating).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibkit.coefficients import Condition, Figure
from calibkit.errors import FitError
from calibkit.frame import Remark
from calibkit.instruments.fog_thermal import decision
from calibkit.instruments.fog_thermal.compensate import DriftModel
from calibkit.instruments.fog_thermal.numeric import evaluate, hysteresis
from calibkit.instruments.fog_thermal.numeric.bank import BankModel, OnLevels
from calibkit.instruments.fog_thermal.numeric.hysteresis import Hysteresis
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.instruments.fog_thermal.uncertainty import TURN_ON
from calibkit.numeric import earth, gum
from calibkit.recipe import type_b
from calibkit.report import budget
from calibkit.report.overview import KeyValue
from calibkit.report.summary import number
from calibkit.report.table import Table, number_or_none

RESULT = "bias_at_reference"
SLOPE_STEP_DEGC = 0.05
"""Change of case temperature for the numerical derivative of the rate at rest."""
LEAST_SOAK_S = 300.0
"""Shortest soak [s] that shows the drift at rest."""
SAME_SOAK_DEGC = 5.0
"""Distance [°C] of soaks that are at one temperature."""
DENSE_SOAKS_DEGC = 10.0
"""Distance of soaks [°C] up to which an anomaly as wide as those of coils shows at rest."""
NO_BIAS = (
    "no rate at rest and no bias are stated: this model follows changes of the drift only, so the"
    ' means of the logs still hold drift; for a bias, fit with [drift] model = "auto"'
)


@dataclass(frozen=True, slots=True)
class _StatedBias:
    """Bias at rest and hysteresis of a run: figures of drift_rate.json, flags, tables, combined
    uncertainties as JSON objects, and named hysteresis curves.
    """

    figures: tuple[Figure, ...]
    flags: tuple[str, ...]
    tables: tuple[Table, ...]
    uncertainty: tuple[dict[str, Any], ...]
    hysteresis: tuple[tuple[str, Hysteresis], ...]
    at_rest: KeyValue | None
    """Bias where the earth's rate is known, else the rate at rest that includes it."""


@dataclass(frozen=True, slots=True)
class _Rest:
    """Rate at rest at a temperature, what the logs leave unknown of it, and the earth's rate along
    the input axis, if known.
    """

    temp_degc: float
    rate_dph: float
    parts: tuple[gum.UncertaintyComponent, ...]
    """Of its uncertainty."""
    by_case: float
    """Derivative of the rate at rest by case temperature [°/h/°C]."""
    earth_dph: float | None
    by_latitude: float
    """Derivative of the earth's rate by latitude [°/h/°]."""
    turn_on: tuple[tuple[str, float], ...]
    """Names of the logs and their biases relative to the mean of all [°/h]."""

    @property
    def bias_dph(self) -> float | None:
        """Rate at rest less the earth's rate [°/h]; None if the latter is not known."""
        return None if self.earth_dph is None else self.rate_dph - self.earth_dph

    @property
    def uncertainty(self) -> tuple[float, float]:
        """Standard uncertainty [°/h] without type B terms, and its effective degrees of freedom."""
        combined = gum.combine(self.parts)
        return combined.standard_uncertainty, combined.effective_dof

    def key_value(self) -> KeyValue:
        """Bias, or the rate at rest that includes the earth's."""
        known, (u, _) = self.bias_dph is not None, self.uncertainty
        name = "bias" if known else "rate at rest, earth's rate in it,"
        value = self.rate_dph if self.bias_dph is None else self.bias_dph
        return KeyValue(f"{name} at {self.temp_degc:g} °C", value, "°/h", u)


@dataclass(frozen=True, slots=True)
class _BothWays:
    """Hysteresis (cooling less heating at equal case temperature) of the indication and of the
    residual drift of the model, if there is one.

    `constant` is the difference of the turn-on biases of cooling and heating logs and its standard
    uncertainty [°/h]: a constant part of the hysteresis, or chance.
    """

    before: Hysteresis
    after: Hysteresis | None
    constant: tuple[float, float] | None


def state_bias(
    model: DriftModel, logs: Sequence[PreparedLog], recipe: FogThermalRecipe
) -> _StatedBias:
    """Bias at rest at the reference temperature and hysteresis, if the logs determine them."""
    rest, ways = _at_rest(model, logs, recipe), _compare_ways(model, logs)
    figures: list[Figure] = []
    tables: list[Table] = []
    flags = [NO_BIAS]
    uncertainty: list[dict[str, Any]] = []
    if rest is not None:
        figures += _rest_figures(rest)
        tables.append(_rest_table(rest))
        flags = [*_flags(rest, recipe), *_flag_hysteresis(model), *_say_where_observed(logs)]
        uncertainty = _uncertainty(rest, recipe)
    sides: list[tuple[str, Hysteresis]] = []
    if ways is not None:
        figures += _hysteresis_figures(ways)
        tables.append(_hysteresis_table(ways))
        sides.append(("indication", ways.before))
        if ways.after is not None:
            sides.append(("left by the model", ways.after))
    return _StatedBias(
        tuple(figures),
        tuple(flags),
        tuple(tables),
        tuple(uncertainty),
        tuple(sides),
        None if rest is None else rest.key_value(),
    )


def _earth_rate(recipe: FogThermalRecipe) -> tuple[float | None, float]:
    """Earth's rate [°/h] along the input axis and its derivative by latitude [°/h/°]; (None, 0) if
    latitude or axis is not given.
    """
    axis, latitude = recipe.input_axis, recipe.site.latitude_deg
    if axis is None or latitude is None:
        return None, 0.0
    where = latitude, axis.elevation_deg, axis.azimuth_deg or 0.0
    return float(earth.along_axis(*where)), float(earth.along_axis_slopes(*where)[0])


def _at_rest(
    model: DriftModel, logs: Sequence[PreparedLog], recipe: FogThermalRecipe
) -> _Rest | None:
    """Rate at rest at the reference temperature; None without a level or lagged model, which
    separates rate and drift.
    """
    if model.thermal is None:
        return None
    thermal = model.thermal
    temperature = thermal.nearest_fitted(recipe.reference_temp_degc)
    rate, row = evaluate.at_rest(thermal, temperature)
    type_a = float(np.sqrt(row @ thermal.covariance @ row))
    half_width = _spread(thermal) / np.sqrt(3.0)
    parts = [
        gum.UncertaintyComponent("coefficients", rate, type_a, "A", dof=thermal.constant_dof),
        gum.UncertaintyComponent(
            "model error", rate, thermal.model_error, "A", dof=thermal.model_error_dof
        ),
    ]
    if half_width:
        parts.append(gum.UncertaintyComponent("hysteresis", rate, half_width, "B"))
    around = (temperature - SLOPE_STEP_DEGC, temperature + SLOPE_STEP_DEGC)
    low, high = (evaluate.at_rest(thermal, degc)[0] for degc in around)
    # at an end of the fitted range the rate is clamped beyond it
    inside = np.ptp([thermal.nearest_fitted(degc) for degc in around])
    return _Rest(
        temperature,
        rate,
        tuple(parts),
        (high - low) / inside if inside else 0.0,
        *_earth_rate(recipe),
        tuple(zip((log.name for log in logs), thermal.turn_on.tolist(), strict=True)),
    )


def _flags(rest: _Rest, recipe: FogThermalRecipe) -> list[str]:
    """Flag if the rate at rest is stated at another temperature than the recipe asks for."""
    if rest.temp_degc == recipe.reference_temp_degc:
        return []
    outside = f"reference_temp_degc = {recipe.reference_temp_degc:g} lies outside the fitted"
    return [f"{outside} temperatures: rate and bias are those at {rest.temp_degc:.1f} °C"]


def _spread(model: OnLevels) -> float:
    """Half the spread [°/h] of the rate at rest at one temperature by where the gyro came from."""
    return model.bank.hysteresis(model.coefficients) if isinstance(model, BankModel) else 0.0


def _flag_hysteresis(model: DriftModel) -> list[str]:
    """Flag that the rate at rest depends on which way the gyro came, by more than is known of it
    otherwise.
    """
    spread = 0.0 if model.thermal is None else _spread(model.thermal)
    if model.thermal is None or spread <= model.thermal.model_error:
        return []
    return [
        (
            f"hysteresis of ±{spread:.2g} deg/h: rates at rest are stated in its middle, and which"
            " way the gyro came is in their uncertainty, and in that of a log until the temperature"
            " has turned over the width of the hysteresis"
        )
    ]


def _say_where_observed(logs: Sequence[PreparedLog]) -> list[str]:
    """At which temperatures the drift at rest was observed, where soaks lie far apart: between
    them it follows from logs in motion, in which no local anomaly shows.
    """
    at_rest = []
    for log in logs:
        starts = [0, *(ramp.stop for ramp in log.ramps)]
        stops = [*(ramp.start for ramp in log.ramps), log.raw.case.size]
        at_rest += [
            float(log.raw.case[stop - 1])
            for start, stop in zip(starts, stops, strict=True)
            if stop > start and log.raw.time[stop - 1] - log.raw.time[start] >= LEAST_SOAK_S
        ]
    levels = np.sort(at_rest)
    groups = np.split(levels, np.flatnonzero(np.diff(levels) > SAME_SOAK_DEGC) + 1)
    observed = [float(group.mean()) for group in groups if group.size]
    widest = max(np.diff(observed), default=0.0)
    if widest <= DENSE_SOAKS_DEGC:
        return []
    listed = ", ".join(f"{degc:.0f}" for degc in observed)
    return [
        Remark(
            f"the drift at rest was observed at {listed} °C; between them it is inferred from logs"
            f" in motion, and an anomaly narrower than {widest:.0f} °C is not in its uncertainty:"
            f" where that matters, soak every {DENSE_SOAKS_DEGC:g} °C, up and down"
        )
    ]


def conditions(recipe: FogThermalRecipe) -> tuple[Condition, ...]:
    """Latitude [°], and elevation and azimuth of the input axis [°], if given."""
    found = []
    if recipe.site.latitude_deg is not None:
        found.append(Condition("latitude", recipe.site.latitude_deg, "deg"))
    if recipe.input_axis is not None:
        found.append(Condition("input_axis_elevation", recipe.input_axis.elevation_deg, "deg"))
        if recipe.input_axis.azimuth_deg is not None:
            found.append(Condition("input_axis_azimuth", recipe.input_axis.azimuth_deg, "deg"))
    return tuple(found)


def _rest_figures(rest: _Rest) -> list[Figure]:
    """Figures of the rates at rest with type A standard uncertainties."""
    u, dof = rest.uncertainty
    known = u, number_or_none(dof)
    found = [Figure("mean_rate_at_reference", rest.rate_dph, "deg/h", *known)]
    if rest.earth_dph is not None and rest.bias_dph is not None:
        found.append(Figure("earth_rate_along_input_axis", rest.earth_dph, "deg/h", 0.0))
        found.append(Figure(RESULT, rest.bias_dph, "deg/h", *known))
    turn_on = (Figure(f"{TURN_ON}{name}", value, "deg/h", 0.0) for name, value in rest.turn_on)
    return [*found, *turn_on]


def _uncertainty(rest: _Rest, recipe: FogThermalRecipe) -> list[dict[str, Any]]:
    """Combined uncertainty of the bias with type B terms of latitude and rate, as a JSON object;
    empty without a bias or such terms.
    """
    if rest.bias_dph is None or recipe.site.latitude_deg is None:
        return []
    known = {
        "latitude_deg": (recipe.site.latitude_deg, -rest.by_latitude),
        "gyro_dph": (rest.rate_dph, 1.0),
        "temp_case_degc": (rest.temp_degc, rest.by_case),
    }
    if (axis := recipe.input_axis) is not None:
        held = axis.elevation_deg, axis.azimuth_deg or 0.0
        slopes = earth.along_axis_slopes(recipe.site.latitude_deg, *held)[1:].tolist()
        names = ("input_axis_elevation_deg", "input_axis_azimuth_deg")
        known |= {n: (at, -slope) for n, at, slope in zip(names, held, slopes, strict=True)}
    parts = type_b.terms_of(recipe.type_b, RESULT, rest.bias_dph, known).components
    if not parts:
        return []
    of_bias = [replace(part, estimate=rest.bias_dph) for part in rest.parts]
    return [budget.combine(f"drift_rate: {RESULT}", "deg/h", [*of_bias, *parts])]


def _rest_table(rest: _Rest) -> Table:
    """Table of mean rate, earth's rate, bias, and the turn-on bias of each log."""
    u = number(rest.uncertainty[0], 2)
    rows = [("mean rate", f"{rest.rate_dph:+.4f}", u)]
    if rest.earth_dph is None:
        rows.append(
            ("earth's rate in it: not known without [site] latitude_deg and [input_axis]", "", "")
        )
    else:
        rows.append(("earth's rate along the input axis", f"{rest.earth_dph:+.4f}", ""))
        rows.append(("bias", f"{rest.rate_dph - rest.earth_dph:+.4f}", u))
    rows += [(f"turn-on bias of {name}", f"{value:+.4f}", "") for name, value in rest.turn_on]
    return Table(
        f"At rest at {rest.temp_degc:g} °C [°/h]; turn-on biases of the logs against their mean",
        ("", "rate", "standard uncertainty"),
        tuple(rows),
    )


def _compare_ways(model: DriftModel, logs: Sequence[PreparedLog]) -> _BothWays | None:
    """Hysteresis of indication and residual drift; None without ramps in both directions."""
    thermal = [log.thermal for log in logs]
    try:
        before = hysteresis.compare_directions(None, thermal)
    except FitError:
        return None
    if model.thermal is None:
        return _BothWays(before, None, None)
    return _BothWays(
        before,
        hysteresis.compare_directions(model.thermal, thermal),
        decision.compare_turn_on(model.thermal, logs),
    )


def _hysteresis_figures(ways: _BothWays) -> list[Figure]:
    """Figures of the hysteresis: rms beyond noise and difference at each temperature, before and
    after compensation.
    """
    figures = []
    for name, side in (("hysteresis_before", ways.before), ("hysteresis", ways.after)):
        if side is not None:
            each = zip(side.temperature, side.difference, side.standard_uncertainty, strict=True)
            figures.append(Figure(f"{name}_rms", side.rms, "deg/h", 0.0))
            figures += [
                Figure(f"{name}_at_{degc:g}_degc", float(value), "deg/h", float(u))
                for degc, value, u in each
            ]
    if ways.constant is not None:
        figures.append(
            Figure("turn_on_bias_cooling_less_heating", ways.constant[0], "deg/h", ways.constant[1])
        )
    return figures


def _hysteresis_table(ways: _BothWays) -> Table:
    """Table of the hysteresis at each case temperature."""
    before, after, left, rms_left = ways.before, ways.before, [""] * len(ways.before.difference), ""
    if ways.after is not None:
        after, rms_left = ways.after, number(ways.after.rms, 2)
        left = [f"{value:+.4f}" for value in after.difference]
    rows = [
        (f"{degc:g}", f"{value:+.4f}", cell, number(float(u), 2))
        for degc, value, cell, u in zip(
            before.temperature, before.difference, left, after.standard_uncertainty, strict=True
        )
    ]
    rows.append(("rms beyond noise", number(before.rms, 2), rms_left, ""))
    if ways.constant is not None:
        difference, u = ways.constant
        rows.append(("turn-on biases", "", f"{difference:+.4f}", number(u, 2)))
    return Table(
        "Hysteresis: cooling less heating at a case temperature [°/h], each log about its mean",
        ("case [°C]", "indication", "left by the model", "standard uncertainty"),
        tuple(rows),
    )

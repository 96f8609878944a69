"""Thermal drift model and its logs → rate at rest at the reference temperature, earth's rate along
the input axis, bias, and hysteresis.

    ω(T_ref, at rest) = bias + ω_e (cos α cos ε cos ψ + sin α sin ε)        (`numeric.earth`)
    h(T) = mean of the blocks that cool through T − mean of those that heat through it, in bins of
           5 °C, each log about its mean, which holds its turn-on bias

α is the latitude, ε and ψ are elevation and azimuth of the input axis. Also stated are the turn-on
bias of each log, and the hysteresis of the residual drift.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from calibkit.instruments.bias import drift_choice, forms
from calibkit.instruments.bias.compensate import TURN_ON, DriftModel
from calibkit.instruments.bias.numeric import bank
from calibkit.instruments.bias.numeric.bank import BankModel, OnLevels
from calibkit.instruments.bias.ramps import PreparedLog
from calibkit.instruments.bias.recipe import FogThermalRecipe
from calibkit.numeric import earth, gum
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.numeric.thermal.left_out import MOVING_DEGC_MIN
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.numeric.thermal.terms import CASE
from calibkit.recipe import type_b
from calibkit.records.coefficients import Condition, Figure
from calibkit.records.frame import Remark
from calibkit.report import budget
from calibkit.report.overview import KeyValue
from calibkit.report.table import number_or_none

RESULT = "bias_at_reference"
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
HYSTERESIS_BIN_DEGC = 5.0
LEAST_BLOCKS = 5
"""Fewest heating and fewest cooling blocks in a bin of the hysteresis."""


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Residual drift on cooling less that on heating ramps [m, °/h] at case temperatures [m, °C],
    with standard uncertainties [m, °/h].
    """

    temperature: Array
    difference: Array
    standard_uncertainty: Array

    @property
    def rms(self) -> float:
        """Root mean square [°/h] of the differences beyond their uncertainties; 0 if the
        uncertainties explain them.
        """
        excess = float(np.mean(self.difference**2 - self.standard_uncertainty**2))
        return float(np.sqrt(max(excess, 0.0)))


@dataclass(slots=True)
class StatedBias:
    """Bias at rest and hysteresis of a run: figures of drift_rate.json, flags, combined
    uncertainties as JSON objects, and named hysteresis curves.
    """

    figures: list[Figure] = field(default_factory=list)
    flags: list[str] = field(default_factory=list)
    uncertainty: list[dict[str, Any]] = field(default_factory=list)
    hysteresis: list[tuple[str, Hysteresis]] = field(default_factory=list)
    at_rest: KeyValue | None = None
    """Bias where the earth's rate is known, else the rate at rest that includes it."""


def state_bias(
    model: DriftModel, logs: Sequence[PreparedLog], recipe: FogThermalRecipe
) -> StatedBias:
    """Bias at rest at the reference temperature and hysteresis, if the logs determine them; a rate
    at rest needs a level or lagged model or a bank, which separates rate and drift.
    """
    statement = StatedBias()
    if model.thermal is None:
        statement.flags.append(NO_BIAS)
    else:
        _state_at_rest(statement, model.thermal, logs, recipe)
        statement.flags += _say_where_observed(logs)
    # of the indication, and of what the model leaves; without ramps both ways nothing is compared
    thermal = [log.thermal for log in logs]
    curves = [("hysteresis_before", "indication", compare_directions(None, thermal))]
    of_turn_on = None
    if model.thermal is not None:
        after = compare_directions(model.thermal, thermal)
        curves.append(("hysteresis", "left by the model", after))
        of_turn_on = drift_choice.compare_turn_on(model.thermal, logs)
    for name, words, side in curves:
        if side is None:
            return statement
        statement.hysteresis.append((words, side))
        statement.figures.append(Figure(f"{name}_rms", side.rms, "deg/h", 0.0))
        points = zip(side.temperature, side.difference, side.standard_uncertainty, strict=True)
        for degc, value, u in points:
            figure_name = f"{name}_at_{degc:g}_degc"
            statement.figures.append(Figure(figure_name, float(value), "deg/h", float(u)))
    # turn-on biases that differ by the way are a constant part of the hysteresis, or chance
    if of_turn_on is not None:
        name = "turn_on_bias_cooling_less_heating"
        statement.figures.append(Figure(name, of_turn_on[0], "deg/h", of_turn_on[1]))
    return statement


def _state_at_rest(
    statement: StatedBias, thermal: OnLevels, logs: Sequence[PreparedLog], recipe: FogThermalRecipe
) -> None:
    """State rate at rest, earth's rate and bias, and the turn-on bias of each log."""
    # a polynomial beyond the fitted range is no measurement
    degc = thermal.nearest_fitted(recipe.reference_temp_degc)
    if degc != recipe.reference_temp_degc:
        statement.flags.append(
            f"reference_temp_degc = {recipe.reference_temp_degc:g} lies outside the fitted"
            f" temperatures: rate and bias are those at {degc:.1f} °C"
        )
    rate, row = bank.at_rest(thermal, degc)
    type_a = float(np.sqrt(row @ thermal.covariance @ row))
    parts = [
        gum.UncertaintyComponent("coefficients", rate, type_a, "A", dof=thermal.constant_dof),
        gum.UncertaintyComponent(
            "model error", rate, thermal.model_error, "A", dof=thermal.model_error_dof
        ),
    ]
    # half the spread by where the gyro came from
    spread = (
        thermal.bank.hysteresis(thermal.coefficients) if isinstance(thermal, BankModel) else 0.0
    )
    if spread:
        u_hysteresis = spread / np.sqrt(3.0)
        parts.append(gum.UncertaintyComponent("hysteresis", rate, u_hysteresis, "B"))
    combined = gum.combine(parts)
    u, dof = combined.standard_uncertainty, number_or_none(combined.effective_dof)

    axis, latitude = recipe.input_axis, recipe.site.latitude_deg
    statement.figures.append(Figure("mean_rate_at_reference", rate, "deg/h", u, dof))
    name, bias = f"rate at rest (includes the earth's rate) at {degc:g} °C", rate
    if axis is None or latitude is None:
        unknown = "the earth's rate in the rate at rest is not known without [site] latitude_deg"
        statement.flags.append(Remark(f"{unknown} and [input_axis]"))
    else:
        axis_angles = latitude, axis.elevation_deg, axis.azimuth_deg or 0.0
        earth_rate = float(earth.along_axis(*axis_angles))
        name, bias = f"bias at {degc:g} °C", rate - earth_rate
        statement.figures.append(Figure("earth_rate_along_input_axis", earth_rate, "deg/h", 0.0))
        statement.figures.append(Figure(RESULT, bias, "deg/h", u, dof))
        by_latitude, by_elevation, by_azimuth = earth.along_axis_slopes(*axis_angles).tolist()
        written = forms.write_thermal(thermal, recipe.drift.interval_s)
        # at rest a case thermometer that is off moves the bias by the slope of the drift
        by_case = float(forms.slope_over_case(written, {CASE: np.array([degc])})[0])
        inputs = {
            # bias = rate - earth's rate: errors of latitude and attitude enter with the opposite
            # sign
            "latitude_deg": (latitude, -by_latitude),
            "gyro_dph": (rate, 1.0),
            "temp_case_degc": (degc, by_case),
            "input_axis_elevation_deg": (axis.elevation_deg, -by_elevation),
            "input_axis_azimuth_deg": (axis.azimuth_deg or 0.0, -by_azimuth),
        }
        of_equipment = type_b.terms_of(recipe.type_b, RESULT, bias, inputs)
        if of_equipment:
            of_bias = [replace(part, estimate=bias) for part in parts]
            statement.uncertainty.append(
                budget.combine(f"drift_rate: {RESULT}", "deg/h", [*of_bias, *of_equipment])
            )
    statement.at_rest = KeyValue.of(name, bias, "°/h", u, dof)
    for log, value in zip(logs, thermal.turn_on.tolist(), strict=True):
        statement.figures.append(Figure(f"{TURN_ON}{log.name}", value, "deg/h", 0.0))
    if spread > thermal.model_error:
        statement.flags.append(
            Remark(
                f"hysteresis of ±{spread:.2g} deg/h: rates at rest are stated in its middle, and"
                " which way the gyro came is in their uncertainty, and in that of a log until the"
                " temperature has turned over the width of the hysteresis"
            )
        )


def _say_where_observed(logs: Sequence[PreparedLog]) -> list[str]:
    """At which temperatures the drift at rest was observed, where soaks lie far apart: between
    them it follows from logs in motion, in which no local anomaly shows.
    """
    at_rest = []
    for log in logs:
        starts = [0, *(ramp.stop for ramp in log.ramps)]
        stops = [*(ramp.start for ramp in log.ramps), log.raw.case.size]
        for start, stop in zip(starts, stops, strict=True):
            if stop > start and log.raw.time[stop - 1] - log.raw.time[start] >= LEAST_SOAK_S:
                at_rest.append(float(log.raw.case[stop - 1]))
    levels = np.sort(at_rest)
    # soaks of heating and cooling logs at one set point end some degrees apart
    groups = np.split(levels, np.flatnonzero(np.diff(levels) > SAME_SOAK_DEGC) + 1)
    observed = [float(group.mean()) for group in groups if group.size]
    widest = max(np.diff(observed), default=0.0)
    if widest <= DENSE_SOAKS_DEGC:
        return []
    observed_text = ", ".join(f"{degc:.0f}" for degc in observed)
    return [
        Remark(
            f"the drift at rest was observed at {observed_text} °C; between them it is inferred"
            f" from logs in motion, and an anomaly narrower than {widest:.0f} °C is not in its"
            f" uncertainty: where that matters, soak every {DENSE_SOAKS_DEGC:g} °C, up and down"
        )
    ]


def conditions(recipe: FogThermalRecipe) -> tuple[Condition, ...]:
    """Latitude [°], and elevation and azimuth of the input axis [°], if given."""
    angles = {"latitude": recipe.site.latitude_deg}
    if recipe.input_axis is not None:
        angles["input_axis_elevation"] = recipe.input_axis.elevation_deg
        angles["input_axis_azimuth"] = recipe.input_axis.azimuth_deg
    return tuple(
        Condition(name, angle, "deg") for name, angle in angles.items() if angle is not None
    )


def compare_directions(model: OnLevels | None, logs: Sequence[ThermalLog]) -> Hysteresis | None:
    """Compare the residual drift of a model (without one, the indication) on heating and on cooling
    ramps at equal case temperature.

    The mean of each log, which contains its turn-on bias, is removed first: the result is the shape
    of the hysteresis without its constant part. None if no temperature was passed in both
    directions.
    """
    parts = []
    for log in logs:
        left = log.indication
        if model is not None:
            left = left - bank.evaluate(model, log.time, log.case, log.env).drift
        # a running mean over nine blocks suppresses the steps of a quantised thermometer
        padded = np.pad(np.gradient(log.case, log.time), 4, mode="edge")
        rate = np.convolve(padded, np.full(9, SECONDS_PER_MINUTE / 9.0), mode="valid")
        # soaks belong to neither direction
        direction = np.sign(rate) * (np.abs(rate) >= MOVING_DEGC_MIN)
        parts.append((np.floor(log.case / HYSTERESIS_BIN_DEGC), direction, left - left.mean()))
    number, direction, left = (np.concatenate(part) for part in zip(*parts, strict=True))
    bins = []
    for k in np.unique(number):
        down, up = (left[(number == k) & (direction == way)] for way in (-1.0, 1.0))
        # fewer show no scatter, by which the difference is judged
        if min(down.size, up.size) >= LEAST_BLOCKS:
            variance = np.var(down, ddof=1) / down.size + np.var(up, ddof=1) / up.size
            bins.append(
                ((k + 0.5) * HYSTERESIS_BIN_DEGC, down.mean() - up.mean(), np.sqrt(variance))
            )
    return Hysteresis(*np.array(bins).T) if bins else None

"""Table runs of one gyro, repeated and over temperature: mean K and F0, polynomials over
temperature, response over rate, repeatability.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Figure
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import forms, table_runs
from calibkit.instruments.gyro_scale.numeric import (
    gjb_figures,
    response as rate_response,
    scale_factor,
)
from calibkit.instruments.gyro_scale.recipe import GyroRecipe, OwnAxisRecipe
from calibkit.numeric import gum
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

ROOM_DEGC = 5.0
"""Largest difference from the reference temperature [°C] of runs that count as repeated (GJB
2426A).
"""
VARIES_DEGC = 5.0
"""Least span of the runs' temperatures [°C] for a fit of K over temperature."""
UNLOGGED = (
    "temperature is not logged in every run: nothing is fitted over it, all runs count as repeated"
)


@dataclass(frozen=True, slots=True)
class GyroOverRuns:
    """One gyro in all runs: the repeated runs at the reference temperature with their mean, and K
    and F0 over temperature.
    """

    gyro: str
    runs: tuple[table_runs.TableRun, ...]
    at_room: tuple[table_runs.TableRun, ...]
    K: tuple[float, float]
    """Mean and its standard uncertainty [1/deg]."""
    F0: tuple[float, float]
    """Mean and its standard uncertainty [1/s]."""
    K_over_temperature: TemperaturePolynomial | None
    F0_over_temperature: TemperaturePolynomial | None
    response: rate_response.Response | None


def fit_over_runs(
    spec: OwnAxisRecipe, gyro: str, runs: Sequence[table_runs.TableRun]
) -> GyroOverRuns:
    """Fit one gyro over all runs: the mean at the reference temperature, and K and F0 over
    temperature where the temperature varies.
    """
    temperature = np.array([run.temp_degc for run in runs])
    near = np.isnan(temperature) | (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC)
    at_room = tuple(run for run, is_near in zip(runs, near, strict=True) if is_near) or tuple(runs)
    varies = np.isfinite(temperature).all() and np.ptp(temperature) >= VARIES_DEGC
    K, F0 = (scale_factor.mean_of_runs(*_points(gyro, at_room, name)) for name in ("K", "F0"))
    K_curve, F0_curve = (
        scale_factor.over_temperature(*_points(gyro, runs, name), temperature) if varies else None
        for name in ("K", "F0")
    )
    return GyroOverRuns(
        gyro, tuple(runs), at_room, K, F0, K_curve, F0_curve, choose_response(spec, gyro, runs)
    )


def _points(gyro: str, runs: Sequence[table_runs.TableRun], name: str) -> tuple[Array, Array]:
    """K or F0 of a gyro in q runs [q], and their standard uncertainties [q]."""
    lines, number = [run.scale(gyro) for run in runs], scale_factor.TERMS.index(name)
    return (
        np.array([getattr(line, name) for line in lines]),
        np.array([float(line.standard_uncertainty[number]) for line in lines]),
    )


def choose_response(
    spec: OwnAxisRecipe, gyro: str, runs: Sequence[table_runs.TableRun]
) -> rate_response.Response | None:
    """Response over rate of all runs together, (F − F0)/K [°/s] against the table rate, chosen by
    leave-one-rate-out error.

    None where the recipe asks for the line alone, or the line is the best.
    """
    if spec.response == "line":
        return None
    rate = np.concatenate([run.plateaus.rate_dps for run in runs])
    lines = [run.scale(gyro) for run in runs]
    indicated = np.concatenate([(line.indication - line.F0) / line.K for line in lines])
    # runs repeat their rates: leaving out a rate means leaving it out of all runs
    group = np.round(rate, 3)
    levels = [group == level for level in np.unique(group)]
    means = [np.array([x[level].mean() for level in levels]) for x in (rate, indicated)]
    try:
        chosen, _ = rate_response.choose(*means)
    except FitError:
        return None
    return None if chosen.form == "odd-polynomial" and chosen.order == 1 else chosen


def run_figures(name: str, one: GyroOverRuns, spec: GyroRecipe) -> list[Figure]:
    """Figures of repeatability and temperature sensitivity, where the runs determine them."""
    figures = []
    if _repeats(one):
        at_room, _ = _points(one.gyro, one.at_room, "K")
        value = gjb_figures.repeatability(at_room)
        u = value / float(np.sqrt(2.0 * (at_room.size - 1)))
        figures.append(
            Figure(forms.FigureName("repeatability", gjb_figures.GJB, name).text, value, "ppm", u)
        )
    if one.K_over_temperature is None:
        return figures
    temperature = np.array([run.temp_degc for run in one.runs])
    K, u_K = _points(one.gyro, one.runs, "K")

    def slope(values: Array) -> float:
        line = scale_factor.over_temperature(values, u_K, temperature, order=1)
        return float(line.coefficients[1] / abs(one.K[0])) * gjb_figures.PPM

    def largest(values: Array) -> float:
        return gjb_figures.temperature_sensitivity(values, temperature, spec.reference_temp_degc)

    spread = np.hypot(u_K, _scatter(one))
    room = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    kinds = (
        [(gjb_figures.GJB, largest), (gjb_figures.IEEE, slope)]
        if room.any() and not room.all()
        else [(gjb_figures.IEEE, slope)]
    )
    for standard, function in kinds:
        value, u = _propagated(function, K, spread)
        figures.append(
            Figure(
                forms.FigureName("temperature_sensitivity", standard, name).text,
                value,
                "ppm/degC",
                u,
            )
        )
    return figures


def _scatter(one: GyroOverRuns) -> float:
    """Standard deviation of K between runs, at the reference temperature and about K(T); raised by
    Student's t for few runs.
    """
    found = []
    if _repeats(one):
        K, _ = _points(one.gyro, one.at_room, "K")
        found.append((K.size - 1, float(np.var(K, ddof=1))))
    curve = one.K_over_temperature
    if curve is not None and curve.dof > 0:
        found.append(
            (curve.dof, curve.residual_rms**2 * (1.0 + curve.coefficients.size / curve.dof))
        )
    if not found:
        return 0.0
    # runs at the reference temperature are in both: the larger count is that of independent ones
    dof = max(count for count, _ in found)
    variance = sum(count * square for count, square in found) / sum(count for count, _ in found)
    return float(np.sqrt(variance)) * gum.widening(dof)


def _repeats(one: GyroOverRuns) -> bool:
    """Whether the mean is of several runs, all at one temperature or all without a known
    temperature.
    """
    temperature = np.array([run.temp_degc for run in one.at_room])
    alike = np.isnan(temperature).any() or np.ptp(temperature) <= 2.0 * ROOM_DEGC
    return bool(temperature.size > 1 and alike)


def _propagated(
    function: Callable[[Array], float], values: Array, uncertainty: Array
) -> tuple[float, float]:
    """Value of a function and its standard uncertainty from those of independent values, by finite
    differences.
    """
    at = function(values)
    steps = [
        function(values + u * row) - at
        for u, row in zip(uncertainty, np.eye(values.size), strict=True)
    ]
    return at, float(np.sqrt(np.sum(np.square(steps))))


def _flag_other_gyro(one: GyroOverRuns) -> list[str]:
    """Flag for a run at the reference temperature whose K differs from the others', as of another
    gyro or setting.
    """
    K, _ = _points(one.gyro, one.at_room, "K")
    off = np.abs(K / np.median(K) - 1.0)
    if not _repeats(one) or not off.max() > table_runs.UNCERTAIN:
        return []
    name = one.at_room[int(np.argmax(off))].log.file
    apart = f"{gjb_figures.PPM * off.max():.0f} ppm off the other runs: another gyro or setting?"
    return [f"{forms.line_name(one.gyro)}: K of {name} is {apart}"]


def flag_runs(gyros: Sequence[GyroOverRuns], spec: GyroRecipe) -> tuple[str, ...]:
    """Flags of figures over several runs."""
    runs = gyros[0].runs
    flags = [flag for run in runs for flag in run.flags]
    for one in gyros:
        for run in runs:
            flags += table_runs.flag_uncertain(
                f"{forms.line_name(one.gyro)} in {run.log.file}", run.scale(one.gyro)
            )
    for one in gyros:
        flags += _flag_other_gyro(one)
    temperature = np.array([run.temp_degc for run in runs])
    near = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if len(temperature) > 1 and np.isnan(temperature).any():
        flags.append(UNLOGGED)
    elif not near.any() and np.isfinite(temperature).all():
        flags.append(
            f"no run within {ROOM_DEGC:g} °C of {spec.reference_temp_degc:g} °C: the mean is that"
            f" of all runs, {temperature.min():.1f} to {temperature.max():.1f} °C"
        )
    return tuple(dict.fromkeys(flags))

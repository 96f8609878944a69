"""Table runs of one gyro, repeated and over temperature → gyro_scale.json: mean, K and F0 over
temperature, repeatability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Figure, Model, Parameter, StageResult
from calibkit.instruments.gyro_scale import shape
from calibkit.instruments.gyro_scale.numeric import gjb_figures, scale_factor
from calibkit.instruments.gyro_scale.pair_files import (
    GJB,
    IEEE,
    PPM,
    UNCERTAIN,
    bias_figures,
    conditions,
    line_figures,
    polynomial_model,
    scale_model,
    uncertain,
    valid_of,
    with_unit,
)
from calibkit.numeric import gum
from calibkit.numeric.dispersion import rms

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from calibkit.arrays import Array
    from calibkit.instruments.gyro_scale.numeric.response import Response
    from calibkit.instruments.gyro_scale.numeric.scale_factor import ScaleFactor
    from calibkit.instruments.gyro_scale.recipe import GyroRecipe, OwnAxisRecipe
    from calibkit.instruments.gyro_scale.runs import TableRun
    from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial


ROOM_DEGC = 5.0
"""Runs this near the reference temperature repeat each other (GJB 2426A)."""
VARIES_DEGC = 5.0
"""Span of the runs' temperatures from which K is fitted over temperature."""


@dataclass(frozen=True, slots=True)
class GyroOverRuns:
    """One gyro in all runs: which repeat each other at the reference temperature, their mean, K and
    F0 over temperature.
    """

    gyro: str
    runs: tuple[TableRun, ...]
    at_room: tuple[TableRun, ...]
    K: tuple[float, float]
    F0: tuple[float, float]
    K_over_temperature: TemperaturePolynomial | None
    F0_over_temperature: TemperaturePolynomial | None
    response: Response | None


def over_runs(gyro: str, runs: Sequence[TableRun], spec: OwnAxisRecipe) -> GyroOverRuns:
    """One gyro over all runs: the mean at the reference temperature, and K and F0 over temperature
    where it varies.
    """
    temperature = np.array([run.temp_degc for run in runs])
    near = np.isnan(temperature) | (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC)
    at_room = tuple(run for run, is_near in zip(runs, near, strict=True) if is_near) or tuple(runs)
    lines = [run.scale(gyro) for run in at_room]
    K = scale_factor.mean_of_runs(
        [s.K for s in lines], [float(s.standard_uncertainty[0]) for s in lines]
    )
    F0 = scale_factor.mean_of_runs(
        [s.F0 for s in lines], [float(s.standard_uncertainty[1]) for s in lines]
    )
    curves = _over_temperature([run.scale(gyro) for run in runs], temperature)
    return GyroOverRuns(
        gyro,
        tuple(runs),
        at_room,
        K,
        F0,
        *curves,
        shape.choose(spec, [(run, gyro) for run in runs]),
    )


def _over_temperature(
    lines: Sequence[ScaleFactor], temperature: Array
) -> tuple[TemperaturePolynomial | None, TemperaturePolynomial | None]:
    """K and F0 as polynomials of temperature, or none where it was not logged or hardly varies."""
    if not np.isfinite(temperature).all() or np.ptp(temperature) < VARIES_DEGC:
        return None, None
    K, F0 = (np.array([getattr(line, name) for line in lines]) for name in ("K", "F0"))
    u_K, u_F0 = np.array([line.standard_uncertainty[:2] for line in lines]).T
    return scale_factor.over_temperature(K, u_K, temperature), scale_factor.over_temperature(
        F0, u_F0, temperature
    )


def rate_table_result(
    gyros: Sequence[GyroOverRuns], flags: Sequence[str], spec: OwnAxisRecipe
) -> StageResult:
    """gyro_scale.json of runs: a line a gyro and run, the mean at the reference temperature, K and
    F0 over temperature.
    """
    models: list[Model] = []
    figures: list[Figure] = []
    for one in gyros:
        name = f"gyro_{one.gyro}"
        models += [_mean_model(name, one), *_temperature_models(name, one)]
        models += [scale_model(f"{name}.{run.log.name}", run, one.gyro) for run in one.runs]
        if one.response is not None:
            models.append(shape.model(f"{name}.response", one.response, one.runs[0]))
        figures += run_figures(name, one, spec)
        figures += [
            figure
            for run in one.runs
            for figure in line_figures(run, one.gyro, f"{name}.{run.log.name}")
        ]
        for run in one.runs:
            figures += bias_figures(f"{name}.{run.log.name}", run.scale(one.gyro), spec)
    return StageResult("gyro_scale", tuple(models), tuple(figures), tuple(flags), conditions(spec))


def _mean_model(name: str, one: GyroOverRuns) -> Model:
    """gyro-scale/1 model of the mean of the runs at the reference temperature."""
    lines = [run.scale(one.gyro) for run in one.at_room]
    noise = np.sum([line.covariance[:2, :2] for line in lines], axis=0)
    correlation = (
        float(noise[0, 1] / np.sqrt(noise[0, 0] * noise[1, 1]))
        if noise[0, 0] * noise[1, 1] > 0.0
        else 0.0
    )
    cross = correlation * one.K[1] * one.F0[1]
    return Model(
        name=name,
        form="gyro-scale/1",
        coefficients=(
            Coefficient("K", *with_unit(one.K, "1/deg")),
            Coefficient("F0", *with_unit(one.F0, "1/s")),
        ),
        covariance=((one.K[1] ** 2, cross), (cross, one.F0[1] ** 2)),
        dof=sum(line.dof for line in lines),
        residual_rms=rms([line.residual_rms for line in lines]),
        residual_unit="1/s",
        valid=valid_of(one.at_room),
        parameters=(Parameter("runs", float(len(lines)), "1"),),
    )


def _temperature_models(name: str, one: GyroOverRuns) -> list[Model]:
    """polynomial/1 models of K and F0 over case temperature, where it varies."""
    curves = (("K", "1/deg", one.K_over_temperature), ("F0", "1/s", one.F0_over_temperature))
    return [
        polynomial_model(f"{name}.{letter}_over_temperature", unit, fit, one.runs)
        for letter, unit, fit in curves
        if fit is not None
    ]


def run_figures(name: str, one: GyroOverRuns, spec: GyroRecipe) -> list[Figure]:
    """Repeatability and temperature sensitivity, where the runs can show them."""
    figures = []
    if len(one.at_room) > 1 and _repeats(one):
        K = np.array([run.scale(one.gyro).K for run in one.at_room])
        value = gjb_figures.repeatability(K)
        u = value / float(np.sqrt(2.0 * (K.size - 1)))
        figures.append(Figure(f"repeatability.{GJB}.{name}", value, "ppm", u))
    if one.K_over_temperature is None:
        return figures
    K, u_K, temperature = (
        np.array(x) for x in zip(*(_point(run, one.gyro) for run in one.runs), strict=True)
    )

    def slope(values: Array) -> float:
        line = scale_factor.over_temperature(values, u_K, temperature, order=1)
        return float(line.coefficients[1] / abs(one.K[0])) * PPM

    def largest(values: Array) -> float:
        return gjb_figures.temperature_sensitivity(values, temperature, spec.reference_temp_degc)

    u_K = np.hypot(u_K, _scatter(one))
    room = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if room.any() and not room.all():
        value, u = _propagated(largest, K, u_K)
        figures.append(Figure(f"temperature_sensitivity.{GJB}.{name}", value, "ppm/degC", u))
    value, u = _propagated(slope, K, u_K)
    figures.append(Figure(f"temperature_sensitivity.{IEEE}.{name}", value, "ppm/degC", u))
    return figures


def _scatter(one: GyroOverRuns) -> float:
    """How much K differs from run to run, at the reference temperature and about K(T); few runs
    widen it by Student's t.
    """
    found = []
    if len(one.at_room) > 1 and _repeats(one):
        K = np.array([run.scale(one.gyro).K for run in one.at_room])
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
    """Whether the runs of the mean are at one temperature, or at none that is known."""
    temperature = np.array([run.temp_degc for run in one.at_room])
    return bool(np.isnan(temperature).any() or np.ptp(temperature) <= 2.0 * ROOM_DEGC)


def _point(run: TableRun, gyro: str) -> tuple[float, float, float]:
    """K, its standard uncertainty and the temperature of one run."""
    line = run.scale(gyro)
    return line.K, float(line.standard_uncertainty[0]), run.temp_degc


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


def _apart(one: GyroOverRuns) -> list[str]:
    """Flag for a run at the reference temperature whose K is not that of the others: another gyro
    or setting.
    """
    K = np.array([run.scale(one.gyro).K for run in one.at_room])
    off = np.abs(K / np.median(K) - 1.0)
    if len(K) < 2 or not _repeats(one) or not off.max() > UNCERTAIN:
        return []
    name = one.at_room[int(np.argmax(off))].log.file
    return [
        (
            f"gyro_{one.gyro}: K of {name} is {PPM * off.max():.0f} ppm off the other runs: another"
            " gyro or setting?"
        )
    ]


def run_flags(gyros: Sequence[GyroOverRuns], spec: GyroRecipe) -> list[str]:
    """What a reader of figures over several runs must know."""
    temperature = np.array([run.temp_degc for run in gyros[0].runs])
    flags = uncertain(
        [
            (f"gyro_{one.gyro} in {run.log.file}", run.scale(one.gyro))
            for one in gyros
            for run in one.runs
        ]
    )
    flags += [flag for one in gyros for flag in _apart(one)]
    if len(temperature) > 1 and np.isnan(temperature).any():
        flags.append(
            "temperature is not logged in every run: nothing is fitted over it, all runs count as"
            " repeated"
        )
    elif (
        not (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC).any()
        and np.isfinite(temperature).all()
    ):
        flags.append(
            f"no run within {ROOM_DEGC:g} °C of {spec.reference_temp_degc:g} °C: the mean is that"
            f" of all runs, {temperature.min():.1f} to {temperature.max():.1f} °C"
        )
    return flags

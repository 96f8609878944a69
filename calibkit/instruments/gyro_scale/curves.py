"""What the figures of gyros on a rate table show, as data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale.axes import AxesFit
from calibkit.instruments.gyro_scale.forms import AXES
from calibkit.instruments.gyro_scale.numeric import gjb_figures
from calibkit.instruments.gyro_scale.numeric.gjb_figures import PPM
from calibkit.instruments.gyro_scale.numeric.pair import GyroPair
from calibkit.instruments.gyro_scale.numeric.triad import Triad
from calibkit.instruments.gyro_scale.over_runs import GyroOverRuns
from calibkit.instruments.gyro_scale.pair import PairFit
from calibkit.instruments.gyro_scale.runs import TableRun
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

MRAD = 1e3


@dataclass(frozen=True, slots=True)
class LineCurve:
    """One gyro in one run: held rates [p, °/s], residual and its standard uncertainty [p], relative
    deviation [p, ppm].
    """

    gyro: str
    run: str
    rate: Array
    residual_ppm: Array
    u_residual_ppm: Array
    deviation_ppm: Array
    u_deviation_ppm: Array


@dataclass(frozen=True, slots=True)
class TemperatureCurve:
    """K of one gyro [q, ppm from the reference] at temperatures [q, °C] and the polynomial with its
    uncertainty.
    """

    gyro: str
    temperature: Array
    K_ppm: Array
    u_ppm: Array
    grid: Array
    curve_ppm: Array
    u_curve_ppm: Array


@dataclass(frozen=True, slots=True)
class SetCurve:
    """A quantity in every set of runs [q] with its standard uncertainty, and its polynomial over
    temperature, or empty.
    """

    name: str
    value: Array
    standard_uncertainty: Array
    grid: Array
    curve: Array


@dataclass(frozen=True, slots=True)
class InputAxes:
    """Input axes of gyros about three axes in every set of runs."""

    temperature: Array
    """[q, °C], NaN where it was not logged."""
    angles: tuple[SetCurve, ...]
    """90° less each angle between two input axes [°]."""
    misalignment: tuple[SetCurve, ...]
    """Components of the input axes across the axis that each senses most [mrad]."""


@dataclass(frozen=True, slots=True)
class GyroReport:
    """All that the figures show."""

    lines: tuple[LineCurve, ...]
    temperatures: tuple[TemperatureCurve, ...] = ()
    pair: GyroPair | None = None
    axes: InputAxes | None = None


def report_runs(gyros: Sequence[GyroOverRuns]) -> GyroReport:
    """Lines of rate-table runs, and K over temperature relative to its mean."""
    return GyroReport(
        tuple(_line_curve(run, one.gyro) for one in gyros for run in one.runs),
        tuple(
            _temperature_curve(one.gyro, one.runs, one.K_over_temperature, one.K[0])
            for one in gyros
            if one.K_over_temperature is not None
        ),
    )


def report_pair(fitted: PairFit) -> GyroReport:
    """Lines of a pair about own axes, and its angle."""
    lines = tuple(_line_curve(run, gyro) for gyro, run in fitted.runs.items())
    return GyroReport(lines, pair=fitted.found)


def report_triad(fitted: AxesFit) -> GyroReport:
    """Lines and K about the axis that each gyro senses most, angles, input axes."""
    main = [(g, AXES.index(fitted.main_axis(gyro))) for g, gyro in enumerate(fitted.gyros)]
    lines, curves = [], []
    for g, a in main:
        gyro, runs = fitted.gyros[g], fitted.runs[AXES[a]]
        lines += [_line_curve(run, gyro) for run in runs]
        if fitted.over is not None:
            K = float(fitted.sets[fitted.reference].triad.sensitivity[g, a])
            curves.append(_temperature_curve(gyro, runs, fitted.over.curves[g][a], K))

    def orthogonality(g: int, h: int) -> Callable[[Triad], tuple[float, float]]:
        return lambda found: (90.0 - found.angles_deg[g, h], found.angle_uncertainty_deg[g, h])

    def component(g: int, a: int) -> Callable[[Triad], tuple[float, float]]:
        return lambda found: (
            MRAD * found.misalignment[g, a],
            MRAD * found.misalignment_uncertainty[g, a],
        )

    gyros = fitted.gyros
    angles = tuple(
        _set_curve(f"{gyros[g]}, {gyros[h]}", fitted, orthogonality(g, h)) for g, h in fitted.pairs
    )
    across = tuple(
        _set_curve(f"{gyros[g]} to {axis}", fitted, component(g, a))
        for g, own in main
        for a, axis in enumerate(AXES)
        if a != own
    )
    temperature = np.array([one.temp_degc for one in fitted.sets])
    return GyroReport(tuple(lines), tuple(curves), axes=InputAxes(temperature, angles, across))


def _line_curve(run: TableRun, gyro: str) -> LineCurve:
    """Errors of one gyro's line over the rates of a run."""
    line, noise = run.scale(gyro), run.noise(gyro)
    full = PPM / float(np.max(np.abs(line.indication)))
    with np.errstate(divide="ignore", invalid="ignore"):
        of_point = PPM / np.abs(line.K * line.rate_dps)
    return LineCurve(
        gyro,
        run.log.name,
        line.rate_dps,
        line.residuals * full,
        noise * full,
        gjb_figures.nonlinearity_per_point(line),
        noise * of_point,
    )


def _temperature_curve(
    gyro: str, runs: Sequence[TableRun], fit: TemperaturePolynomial, reference: float
) -> TemperatureCurve:
    """K of one gyro in every run and as a polynomial, in ppm from a reference K."""
    grid = np.linspace(*fit.valid_degc, 101)
    curve, u_curve = fit.at(grid)
    lines = [run.scale(gyro) for run in runs]
    K = np.array([line.K for line in lines])
    ppm, sign = PPM / abs(reference), float(np.sign(reference))
    return TemperatureCurve(
        gyro,
        np.array([run.temp_degc for run in runs]),
        (K - reference) * sign * ppm,
        np.array([line.standard_uncertainty[0] for line in lines]) * ppm,
        grid,
        (curve - reference) * sign * ppm,
        u_curve * ppm,
    )


def _set_curve(
    name: str, fitted: AxesFit, quantity: Callable[[Triad], tuple[float, float]]
) -> SetCurve:
    """A quantity (value, standard uncertainty) of every set, and over temperature."""
    value, u = np.array([quantity(one.triad) for one in fitted.sets]).T
    if fitted.over is None:
        return SetCurve(name, value, u, np.zeros(0), np.zeros(0))
    grid = np.linspace(*fitted.over.valid_degc, 61)
    curve = np.array([quantity(fitted.over.at(float(degc)))[0] for degc in grid])
    return SetCurve(name, value, u, grid, curve)

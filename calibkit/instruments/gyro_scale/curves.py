"""Data of the figures of gyros on a rate table."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale import (
    forms,
    over_runs,
    pair_fit,
    table_runs,
    triad_fit,
)
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.numeric import (
    gjb_figures,
    pair as gyro_pair,
    triad as gyro_triad,
)
from calibkit.numeric import gum
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial

MRAD = 1e3


@dataclass(frozen=True, slots=True)
class LineCurve:
    """One gyro in one run at p held rates [p, °/s]: residual and its standard uncertainty [p, ppm
    of full scale], relative deviation and its standard uncertainty [p, ppm].
    """

    gyro: str
    run: str
    rate: Array
    residual_ppm: Array
    u_residual_ppm: Array
    deviation_ppm: Array
    u_deviation_ppm: Array


@dataclass(frozen=True, slots=True)
class Curve:
    """A quantity with standard uncertainty in q runs or sets of runs at temperatures [q, °C] (NaN
    where not logged), and its polynomial on a grid of temperatures [n], empty for a single
    temperature.
    """

    name: str
    temperature: Array
    value: Array
    standard_uncertainty: Array
    grid: Array
    curve: Array
    u_curve: Array
    coverage_factor: float = 2.0
    """Of the uncertainty of the polynomial, or of the sets'."""


@dataclass(frozen=True, slots=True)
class GyroReport:
    """Data of all figures of a fit."""

    lines: tuple[LineCurve, ...]
    temperatures: tuple[Curve, ...] = ()
    """K of each gyro [ppm from the reference]."""
    pair: gyro_pair.GyroPair | None = None
    angles: tuple[Curve, ...] = ()
    """90° less each angle between two input axes [°]."""
    misalignment: tuple[Curve, ...] = ()
    """Components of the input axes across each gyro's main axis [mrad]."""

    def residuals(self) -> dict[str, Array]:
        """Columns of a tidy table, one row per held rate of a gyro in a run: indication less its
        straight line, in ppm of full scale.
        """
        parts = {
            "run": [np.full(line.rate.size, line.run, dtype=object) for line in self.lines],
            "gyro": [np.full(line.rate.size, line.gyro, dtype=object) for line in self.lines],
            "table_rate_dps": [line.rate for line in self.lines],
            "residual_ppm": [line.residual_ppm for line in self.lines],
            "standard_uncertainty_ppm": [line.u_residual_ppm for line in self.lines],
        }
        return {name: np.concatenate(columns) for name, columns in parts.items()}

    @classmethod
    def of_runs(cls, gyros: Sequence[over_runs.GyroOverRuns], held: Lines) -> Self:
        """Lines of rate-table runs, and K over temperature relative to its mean."""
        return cls(
            tuple(_line_curve(held, run, one.gyro) for one in gyros for run in one.runs),
            tuple(
                _temperature_curve(
                    held, one.gyro, one.runs, one.K_over_temperature, float(one.K.value)
                )
                for one in gyros
                if one.K_over_temperature is not None
            ),
        )

    @classmethod
    def of_pair(cls, fitted: pair_fit.PairFit) -> Self:
        """Lines of a pair's gyros about their own axes, and the angle between the gyros."""
        held = fitted.held
        lines = [_line_curve(held, run, gyro) for gyro, runs in fitted.runs.items() for run in runs]
        return cls(tuple(lines), pair=fitted.found)

    @classmethod
    def of_triad(cls, fitted: triad_fit.AxesFit) -> Self:
        """Lines and K about each gyro's main axis, angles, and components of the input axes."""
        main = [
            (g, forms.AXES.index(fitted.main_axis(gyro))) for g, gyro in enumerate(fitted.gyros)
        ]
        lines, curves = [], []
        for g, a in main:
            gyro, runs = fitted.gyros[g], fitted.runs[forms.AXES[a]]
            lines += [_line_curve(fitted.held, run, gyro) for run in runs]
            if fitted.over is not None:
                K = float(fitted.sets[fitted.reference].triad.sensitivity[g, a])
                curve = fitted.over.curves[g][a]
                curves.append(_temperature_curve(fitted.held, gyro, runs, curve, K))

        def orthogonality(g: int, h: int) -> Callable[[gyro_triad.Triad], tuple[float, float]]:
            return lambda found: (90.0 - found.angles_deg.value[g, h], found.angles_deg.u[g, h])

        def component(g: int, a: int) -> Callable[[gyro_triad.Triad], tuple[float, float]]:
            return lambda found: (
                MRAD * found.misalignment.value[g, a],
                MRAD * found.misalignment.u[g, a],
            )

        gyros, set_curve = fitted.gyros, partial(_set_curve, fitted, *_over_temperature(fitted))
        angles = tuple(
            replace(
                set_curve(f"{gyros[g]}, {gyros[h]}", orthogonality(g, h)),
                coverage_factor=gum.coverage_factor(
                    min(float(one.triad.angles_deg.dof[g, h]) for one in fitted.sets)
                ),
            )
            for g, h in fitted.pairs
        )
        across = tuple(
            set_curve(f"{gyros[g]} to {axis}", component(g, a))
            for g, own in main
            for a, axis in enumerate(forms.AXES)
            if a != own
        )
        return cls(tuple(lines), tuple(curves), angles=angles, misalignment=across)


def _line_curve(held: Lines, run: table_runs.TableRun, gyro: str) -> LineCurve:
    """Errors of one gyro's line over the rates of a run."""
    line = held.published(run, gyro)
    full = gjb_figures.PPM / line.full_scale
    with np.errstate(divide="ignore", invalid="ignore"):
        of_point = gjb_figures.PPM / line.expected
    return LineCurve(
        gyro,
        run.log.name,
        line.rate_dps,
        line.residuals * full,
        line.noise * full,
        line.per_point_ppm,
        line.noise * of_point,
    )


def _temperature_curve(
    held: Lines,
    gyro: str,
    runs: Sequence[table_runs.TableRun],
    fit: TemperaturePolynomial,
    reference: float,
) -> Curve:
    """K of one gyro in every run and as a polynomial, in ppm from a reference K."""
    grid = np.linspace(*fit.valid_degc, 101)
    curve, u_curve = fit.at(grid)
    K = held.of_runs(runs, gyro)
    ppm, sign = gjb_figures.PPM / abs(reference), float(np.sign(reference))
    return Curve(
        gyro,
        np.array([run.temp_degc for run in runs]),
        (K.value - reference) * sign * ppm,
        K.u * ppm,
        grid,
        (curve - reference) * sign * ppm,
        u_curve * ppm,
        gum.coverage_factor(fit.dof),
    )


def _over_temperature(fitted: triad_fit.AxesFit) -> tuple[Array, list[gyro_triad.Triad]]:
    """Temperatures [°C] at which curves are drawn, and the triad at each; none without a fit over
    temperature.
    """
    if fitted.over is None:
        return np.zeros(0), []
    grid = np.linspace(*fitted.over.curves[0][0].valid_degc, 61)
    return grid, [fitted.over.at(degc) for degc in grid.tolist()]


def _set_curve(
    fitted: triad_fit.AxesFit,
    grid: Array,
    between: Sequence[gyro_triad.Triad],
    name: str,
    quantity: Callable[[gyro_triad.Triad], tuple[float, float]],
) -> Curve:
    """A quantity, given as value and standard uncertainty of a triad, for every set, and of the
    triads at the temperatures of a grid.
    """
    value, u = np.array([quantity(one.triad) for one in fitted.sets]).T
    temperature = np.array([one.temp_degc for one in fitted.sets])
    curve, u_curve = np.array([quantity(one) for one in between]).reshape(-1, 2).T
    return Curve(name, temperature, value, u, grid, curve, u_curve)

"""Data of the figures of gyros on a rate table."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Model
from calibkit.forms import POLYNOMIAL
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
)
from calibkit.numeric import gum

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
    where not logged), and its polynomial on a grid of temperatures [n], empty for sets of runs.
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
                _temperature_curve(held, one.gyro, one.runs, one.curves[0], float(one.K.value))
                for one in gyros
                if one.curves
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
        lines, curves, across = [], [], []
        misalignment = [one.triad.misalignment for one in fitted.sets]
        for g, gyro in enumerate(fitted.gyros):
            main = fitted.main_axis(gyro)
            runs = fitted.runs[main]
            lines += [_line_curve(fitted.held, run, gyro) for run in runs]
            if fitted.curves:
                own = forms.AXES.index(main)
                K = float(fitted.sets[fitted.reference].triad.sensitivity[g, own])
                curve = fitted.curves[len(forms.AXES) * g + own]
                curves.append(_temperature_curve(fitted.held, gyro, runs, curve, K))
            for a, axis in enumerate(forms.AXES):
                if axis != main:
                    shares = [(MRAD * one.value[g, a], MRAD * one.u[g, a]) for one in misalignment]
                    across.append(_set_curve(fitted, f"{gyro} to {axis}", shares))
        angles = []
        for g, h in fitted.pairs:
            between = [one.triad.angles_deg for one in fitted.sets]
            dof = min(float(angle.dof[g, h]) for angle in between)
            off = [(90.0 - angle.value[g, h], angle.u[g, h]) for angle in between]
            found = _set_curve(fitted, f"{fitted.gyros[g]}, {fitted.gyros[h]}", off)
            angles.append(replace(found, coverage_factor=gum.coverage_factor(dof)))
        return cls(tuple(lines), tuple(curves), angles=tuple(angles), misalignment=tuple(across))


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
    fit: Model,
    reference: float,
) -> Curve:
    """K of one gyro in every run and as a polynomial, in ppm from a reference K."""
    grid = np.linspace(*fit.valid[forms.TEMPERATURE], 101)
    at = {forms.TEMPERATURE: grid}
    curve, u_curve = POLYNOMIAL.evaluate(fit, at), POLYNOMIAL.standard_uncertainty(fit, at)
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


def _set_curve(fitted: triad_fit.AxesFit, name: str, found: Sequence[tuple[float, float]]) -> Curve:
    """A quantity in every set of runs, by value and standard uncertainty."""
    value, u = np.array(found).T
    temperature = np.array([one.temp_degc for one in fitted.sets])
    none = np.zeros(0)
    return Curve(name, temperature, value, u, none, none, none)

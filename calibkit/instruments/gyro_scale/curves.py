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
from calibkit.instruments.gyro_scale.numeric.gjb_figures import Line
from calibkit.numeric import gum

MRAD = 1e3


@dataclass(frozen=True, slots=True)
class LineCurve:
    """One gyro in one run: its published line."""

    gyro: str
    run: str
    line: Line

    @property
    def of_full_scale_ppm(self) -> tuple[Array, Array]:
        """Residuals and their standard uncertainties [p, ppm of full scale]."""
        ppm = gjb_figures.PPM / self.line.full_scale
        return self.line.residuals * ppm, self.line.noise * ppm


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
        sizes = [one.line.rate_dps.size for one in self.lines]
        residual, u = np.hstack([one.of_full_scale_ppm for one in self.lines])
        return {
            "run": np.repeat(np.array([one.run for one in self.lines], dtype=object), sizes),
            "gyro": np.repeat(np.array([one.gyro for one in self.lines], dtype=object), sizes),
            "table_rate_dps": np.concatenate([one.line.rate_dps for one in self.lines]),
            "residual_ppm": residual,
            "standard_uncertainty_ppm": u,
        }

    @classmethod
    def of_runs(cls, gyros: Sequence[over_runs.GyroOverRuns], run_lines: Lines) -> Self:
        """Lines of rate-table runs, and K over temperature relative to its mean."""
        return cls(
            tuple(
                LineCurve(one.gyro, run.log.name, run_lines.published(run, one.gyro))
                for one in gyros
                for run in one.runs
            ),
            tuple(
                _temperature_curve(run_lines, one.gyro, one.runs, one.curves[0], float(one.K.value))
                for one in gyros
                if one.curves
            ),
        )

    @classmethod
    def of_pair(cls, fitted: pair_fit.PairFit) -> Self:
        """Lines of a pair's gyros about their own axes, and the angle between the gyros."""
        lines = [
            LineCurve(gyro, run.log.name, fitted.run_lines.published(run, gyro))
            for gyro, runs in fitted.runs.items()
            for run in runs
        ]
        return cls(tuple(lines), pair=fitted.found)

    @classmethod
    def of_triad(cls, fitted: triad_fit.AxesFit) -> Self:
        """Lines and K about each gyro's main axis, angles, and components of the input axes."""
        lines, curves, across = [], [], []
        misalignment = [one.triad.misalignment for one in fitted.sets]
        for g, gyro in enumerate(fitted.gyros):
            main = fitted.main_axis(gyro)
            runs = fitted.runs[main]
            lines += [
                LineCurve(gyro, run.log.name, fitted.run_lines.published(run, gyro)) for run in runs
            ]
            if fitted.curves:
                own = forms.AXES.index(main)
                K = float(fitted.sets[fitted.reference].triad.sensitivity[g, own])
                curve = fitted.curves[len(forms.AXES) * g + own]
                curves.append(_temperature_curve(fitted.run_lines, gyro, runs, curve, K))
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


def _temperature_curve(
    run_lines: Lines,
    gyro: str,
    runs: Sequence[table_runs.TableRun],
    fit: Model,
    reference: float,
) -> Curve:
    """K of one gyro in every run and as a polynomial, in ppm from a reference K."""
    grid = np.linspace(*fit.valid[forms.TEMPERATURE], 101)
    at = {forms.TEMPERATURE: grid}
    curve, u_curve = POLYNOMIAL.evaluate(fit, at), POLYNOMIAL.standard_uncertainty(fit, at)
    K = run_lines.of_runs(runs, gyro)
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

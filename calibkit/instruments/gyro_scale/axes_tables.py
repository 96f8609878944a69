"""Fits and validations of gyros over three table axes → what the console, the report and the
acceptance limits say.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calibkit.instruments.gyro_scale.axes import AXES
from calibkit.instruments.gyro_scale.axes_compensate import worst
from calibkit.instruments.gyro_scale.axes_figures import AxesReport, Curve
from calibkit.instruments.gyro_scale.axes_files import pairs
from calibkit.instruments.gyro_scale.figures import GyroReport, TemperatureCurve
from calibkit.instruments.gyro_scale.tables import (
    limit_on,
    line_criteria,
    line_curve,
    temperature_curve,
)
from calibkit.report.table import Table

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from calibkit.coefficients import Criterion, Figure
    from calibkit.instruments.gyro_scale.axes import AxesFit, AxesSet
    from calibkit.instruments.gyro_scale.numeric.triad import Triad
    from calibkit.instruments.gyro_scale.recipe import TriadAcceptance

    Array = NDArray[np.float64]

GRID = 61
MRAD = 1e3


def tables(fitted: AxesFit) -> tuple[Table, ...]:
    """Sensitivities, input axes and angles of every set of runs."""
    return (_sensitivity_table(fitted), _axis_table(fitted), *_angle_table(fitted))


def _where(one: AxesSet) -> str:
    """Temperature of a set."""
    return f"{one.temp_degc:.1f}" if np.isfinite(one.temp_degc) else ""


def _sensitivity_table(fitted: AxesFit) -> Table:
    """Scale factor of every gyro about every axis."""
    rows = tuple(
        (
            gyro if s == 0 else "",
            _where(one),
            *(f"{value:.4f}" for value in one.triad.sensitivity[g]),
            f"{one.triad.magnitude[g]:.4f}",
            f"{one.triad.magnitude_uncertainty[g]:.2g}",
        )
        for g, gyro in enumerate(fitted.gyros)
        for s, one in enumerate(fitted.sets)
    )
    heads = ("gyro", "°C", *(f"about {axis} [1/deg]" for axis in AXES), "|S| [1/deg]", "u(|S|)")
    return Table("Sensitivity of each gyro about the axes of the base", heads, rows)


def _axis_table(fitted: AxesFit) -> Table:
    """Misalignment matrix: unit vectors of the input axes."""
    rows = tuple(
        (
            gyro if s == 0 else "",
            _where(one),
            *(f"{value:+.7f}" for value in one.triad.misalignment[g]),
            f"{np.max(one.triad.misalignment_uncertainty[g]):.1e}",
        )
        for g, gyro in enumerate(fitted.gyros)
        for s, one in enumerate(fitted.sets)
    )
    heads = ("gyro", "°C", *AXES, "largest u")
    return Table("Misalignment matrix: unit vectors of the input axes", heads, rows)


def _angle_table(fitted: AxesFit) -> tuple[Table, ...]:
    """Angles between every two input axes."""
    rows = tuple(
        (
            f"{fitted.gyros[g]} and {fitted.gyros[h]}" if s == 0 else "",
            _where(one),
            f"{one.triad.angles_deg[g, h]:.6f}",
            f"{90.0 - one.triad.angles_deg[g, h]:+.6f}",
            f"{one.triad.angle_uncertainty_deg[g, h]:.1e}",
        )
        for g, h in pairs(fitted.gyros)
        for s, one in enumerate(fitted.sets)
    )
    heads = ("gyros", "°C", "angle [°]", "90° - angle", "standard uncertainty")
    return (Table("Angles between input axes", heads, rows),) if rows else ()


def criteria(
    fitted: AxesFit, figures: Sequence[Figure], limits: TriadAcceptance
) -> tuple[Criterion, ...]:
    """Limits on a fit: of the lines about main axes, and of the angles in every set."""
    chosen = [(one.triad, g, h) for one in fitted.sets for g, h in pairs(fitted.gyros)]
    error = max((abs(90.0 - float(triad.angles_deg[g, h])) for triad, g, h in chosen), default=0.0)
    u = max((float(triad.angle_uncertainty_deg[g, h]) for triad, g, h in chosen), default=0.0)
    return (
        *line_criteria(figures, limits),
        *limit_on("orthogonality error", error, limits.max_orthogonality_error_deg, "deg"),
        *limit_on("standard uncertainty of an angle", u, limits.max_angle_uncertainty_deg, "deg"),
    )


def drawing(fitted: AxesFit) -> AxesReport:
    """What the figures show: lines and K about the axis that each gyro senses most, angles, input
    axes.
    """
    main = [(gyro, fitted.main_axis(gyro)) for gyro in fitted.gyros]
    lines = tuple(line_curve(run, gyro) for gyro, axis in main for run in fitted.runs[axis])
    curves = (
        () if fitted.over is None else tuple(_main_curve(fitted, gyro, axis) for gyro, axis in main)
    )
    angles = tuple(
        _curve(f"{fitted.gyros[g]}, {fitted.gyros[h]}", fitted, partial(_orthogonality, g, h))
        for g, h in pairs(fitted.gyros)
    )
    across = tuple(
        _curve(f"{gyro} to {axis}", fitted, partial(_component, g, a))
        for g, (gyro, own) in enumerate(main)
        for a, axis in enumerate(AXES)
        if axis != own
    )
    temperature = np.array([one.temp_degc for one in fitted.sets])
    return AxesReport(GyroReport(lines, curves, None), temperature, angles, across)


def _orthogonality(g: int, h: int, found: Triad) -> tuple[float, float]:
    """90° less the angle between two input axes, with its standard uncertainty [°]."""
    return 90.0 - float(found.angles_deg[g, h]), float(found.angle_uncertainty_deg[g, h])


def _component(g: int, a: int, found: Triad) -> tuple[float, float]:
    """Component of an input axis with its standard uncertainty [mrad]."""
    return MRAD * float(found.misalignment[g, a]), MRAD * float(
        found.misalignment_uncertainty[g, a]
    )


def _curve(name: str, fitted: AxesFit, of: Callable[[Triad], tuple[float, float]]) -> Curve:
    """A quantity of every set, and over temperature."""
    value, u = (np.array(x) for x in zip(*(of(one.triad) for one in fitted.sets), strict=True))
    if fitted.over is None:
        return Curve(name, value, u, np.zeros(0), np.zeros(0))
    grid = np.linspace(*fitted.over.valid_degc, GRID)
    return Curve(
        name, value, u, grid, np.array([of(fitted.over.at(float(degc)))[0] for degc in grid])
    )


def _main_curve(fitted: AxesFit, gyro: str, axis: str) -> TemperatureCurve:
    """K of a gyro about its main axis over temperature."""
    assert fitted.over is not None  # noqa: S101 (the caller asked)
    fit = fitted.over.curves[fitted.gyros.index(gyro)][AXES.index(axis)]
    K = float(
        fitted.sets[fitted.reference].triad.sensitivity[fitted.gyros.index(gyro), AXES.index(axis)]
    )
    return temperature_curve(gyro, fitted.runs[axis], fit, K)


def validation_table(named: Sequence[tuple[str, Mapping[str, object]]]) -> Table:
    """Errors along the turned axis and across it, before and after."""
    rows = []
    for name, one in named:
        before, after = one["before"], one["after"]
        assert isinstance(before, dict)  # noqa: S101 (narrows the JSON objects that `stand` made)
        assert isinstance(after, dict)  # noqa: S101 (as above)
        along, across = "rate_error_max_ppm_of_full_scale", "cross_axis_max_ppm_of_full_scale"
        rows.append(
            (
                f"{name} about {one['axis']}",
                f"{before[along]:.1f}",
                f"{after[along]:.1f}",
                f"{before[across]:.1f}",
                f"{after[across]:.1f}",
                f"{float(str(one['rate_gain'])):.6f}",
            )
        )
    heads = ("", "along", "after", "across", "after", "gain")
    title = (
        "Compensated rates of unseen runs: largest error along and across the turned axis, ppm of"
        " full scale"
    )
    return Table(title, heads, tuple(rows))


def validation_criteria(
    stands: Sequence[Mapping[str, object]], limits: TriadAcceptance
) -> tuple[Criterion, ...]:
    """Limits on runs that were not fitted."""
    along, across = (
        worst(stands, f"{kind}_max_ppm_of_full_scale") for kind in ("rate_error", "cross_axis")
    )
    return (
        *limit_on("rate error", along, limits.max_rate_error_ppm, "ppm"),
        *limit_on("rate across the turned axis", across, limits.max_cross_axis_ppm, "ppm"),
    )

"""Gyros over three table axes → gyro_scale.json and gyro_orthogonality.json."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Figure, Model, StageResult
from calibkit.constants import DPH_PER_DPS
from calibkit.instruments.gyro_scale.axes import AXES
from calibkit.instruments.gyro_scale.pair_files import (
    conditions,
    line_figures,
    polynomial_model,
    scale_model,
    valid_of,
)
from calibkit.numeric.dispersion import rms

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.instruments.gyro_scale.axes import AxesFit, AxesSet
    from calibkit.instruments.gyro_scale.recipe import GyroTriadRecipe


def scale_result(fitted: AxesFit, spec: GyroTriadRecipe) -> StageResult:
    """gyro_scale.json: a line for each gyro about each axis in each run, polynomials, figures about
    main axes.
    """
    models: list[Model] = []
    figures: list[Figure] = []
    for gyro in fitted.gyros:
        for axis in AXES:
            for run in fitted.runs[axis]:
                name = fitted.name(gyro, axis, run)
                models.append(scale_model(name, run, gyro))
                figures += line_figures(run, gyro, name) if axis == fitted.main_axis(gyro) else ()
    for one in fitted.sets:
        dph = DPH_PER_DPS / one.triad.magnitude
        figures += [
            Figure(_named(f"bias.{gyro}", fitted, one), value * k, "deg/h", u * k)
            for gyro, value, u, k in zip(
                fitted.gyros,
                one.bias.tolist(),
                one.bias_uncertainty.tolist(),
                dph.tolist(),
                strict=True,
            )
            if np.isfinite(value)
        ]
    return StageResult(
        "gyro_scale",
        (*models, *_temperature_models(fitted)),
        tuple(figures),
        fitted.flags,
        conditions(spec),
    )


def _named(name: str, fitted: AxesFit, one: AxesSet) -> str:
    """Name of a figure, with the temperature of a set that is not the reference."""
    return ".".join(filter(None, (name, fitted.suffix(one))))


def _temperature_models(fitted: AxesFit) -> list[Model]:
    """polynomial/1 models of every sensitivity and bias over case temperature."""
    models = []
    every = [run for axis in AXES for run in fitted.runs[axis]]
    if fitted.over is not None:
        models += [
            polynomial_model(
                f"{gyro}_about_{axis}.K_over_temperature", "1/deg", fitted.over.curves[g][a], every
            )
            for g, gyro in enumerate(fitted.gyros)
            for a, axis in enumerate(AXES)
        ]
    models += [
        polynomial_model(f"{gyro}.bias_over_temperature", "1/s", curve, every)
        for gyro, curve in zip(fitted.gyros, fitted.bias_over, strict=False)
    ]
    return models


def orthogonality_result(fitted: AxesFit, spec: GyroTriadRecipe) -> StageResult:
    """gyro_orthogonality.json: sensitivities and biases of every set with their covariance, angles
    and misalignment matrix.
    """
    models = tuple(_triad_model(fitted, one) for one in fitted.sets)
    figures = tuple(figure for one in fitted.sets for figure in triad_figures(fitted, one))
    return StageResult("gyro_orthogonality", models, figures, fitted.flags, conditions(spec))


def _triad_model(fitted: AxesFit, one: AxesSet) -> Model:
    """gyro-triad/1 model of one set: S_<gyro><axis>, then B_<gyro> where the latitude is known."""
    count = len(fitted.gyros)
    size = 3 * count
    names = [f"S_{gyro}{axis}" for gyro in fitted.gyros for axis in AXES]
    values, units = one.triad.sensitivity.ravel(), ["1/deg"] * size
    covariance = one.triad.covariance.reshape(size, size)
    if np.isfinite(one.bias).all():
        names += [f"B_{gyro}" for gyro in fitted.gyros]
        values, units = np.concatenate([values, one.bias]), units + ["1/s"] * count
        corner = np.zeros((size, count))
        covariance = np.block([[covariance, corner], [corner.T, np.diag(one.bias_uncertainty**2)]])
    u = np.sqrt(np.diag(covariance))
    lines = [line for run in one.runs for line in run.scales.gyros]
    return Model(
        name=".".join(filter(None, ("triad", fitted.suffix(one)))),
        form="gyro-triad/1",
        coefficients=tuple(
            Coefficient(n, float(v), unit, float(e))
            for n, v, unit, e in zip(names, values, units, u, strict=True)
        ),
        covariance=tuple(map(tuple, covariance.tolist())),
        dof=min(line.dof for line in lines),
        residual_rms=rms([line.residual_rms for line in lines]),
        residual_unit="1/s",
        valid=valid_of(one.runs),
    )


def triad_figures(fitted: AxesFit, one: AxesSet) -> list[Figure]:
    """Scale factors about the input axes, misalignment matrix and pairwise angles of one set."""
    found, gyros = one.triad, fitted.gyros
    figures = []
    for g, gyro in enumerate(gyros):
        value, u = float(found.magnitude[g]), float(found.magnitude_uncertainty[g])
        figures.append(Figure(_named(f"scale_factor.{gyro}", fitted, one), value, "1/deg", u))
        for a, axis in enumerate(AXES):
            value, u = float(found.misalignment[g, a]), float(found.misalignment_uncertainty[g, a])
            figures.append(Figure(_named(f"misalignment.{gyro}{axis}", fitted, one), value, "1", u))
    for g, h in pairs(gyros):
        value, u = float(found.angles_deg[g, h]), float(found.angle_uncertainty_deg[g, h])
        name = f"{gyros[g]}_{gyros[h]}"
        figures.append(Figure(_named(f"angle_deg.{name}", fitted, one), value, "deg", u))
        figures.append(
            Figure(_named(f"orthogonality_error_deg.{name}", fitted, one), 90.0 - value, "deg", u)
        )
    return figures


def pairs(gyros: Sequence[str]) -> list[tuple[int, int]]:
    """Every two gyros."""
    return [(g, h) for g in range(len(gyros)) for h in range(g + 1, len(gyros))]

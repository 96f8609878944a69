"""Coefficients of a run → compensated rates of a log.

Ω = S(T)⁻¹ (F − B(T)) of a gyro about its axis, or (SᵀS)⁻¹ Sᵀ (F − B) of several about the axes
of the base; a bent response is solved for Ω by Newton's steps (`forms.GyroMatrix.rates`).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from calibkit import check
from calibkit.arrays import Array
from calibkit.coefficients import Record
from calibkit.errors import CoefficientError
from calibkit.frame import Log, refuse, require, values
from calibkit.ingest import logs, write_back
from calibkit.ingest.write_back import Applied
from calibkit.instruments.gyro_scale.forms import (
    AXES,
    TEMPERATURE,
    GyroMatrix,
    gyro_column,
    read_earth_rate,
    read_matrices,
)
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroTriadRecipe

TEMPERATURE_SLACK = 5.0
"""Temperatures [°C] beyond the calibrated range in which coefficients without a temperature model
are used without a flag.
"""
RESTED = (
    "rates are zero where the gyro rested on the laboratory's table: the earth's rate there"
    " is taken out with the bias (compensation = 'inertial' leaves it in)"
)


def read_invertible(spec: AnyRecipe, records: Mapping[str, Record]) -> tuple[GyroMatrix, ...]:
    """Matrices of a run; raises CoefficientError where they cannot be solved for rates."""
    matrices = read_matrices(spec, records)
    for matrix in matrices if isinstance(spec, GyroTriadRecipe) else ():
        matrix.require_biases()
        rows, _ = matrix.reference
        unit = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        # noise of the gyros is amplified by at most this factor
        if len(unit) < unit.shape[1] or not np.linalg.cond(unit) < 1e3:
            raise CoefficientError(
                f"the gyros {', '.join(matrix.gyros)} do not sense three axes: rates about them"
                " cannot be had",
                hint="log a gyro of the missing direction too",
            )
    return matrices


def correct(spec: AnyRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Add compensated rates to every row of a log: of each gyro about its own axis, or about the
    axes of the base.
    """
    matrices = read_invertible(spec, records)
    log = _read(spec, data, matrices)
    flags = [*log.notes]
    inertial_dps, triad = 0.0, isinstance(spec, GyroTriadRecipe)
    if not isinstance(spec, GyroTriadRecipe):
        inertial_dps = read_earth_rate(spec, records, CoefficientError)
    columns, rows = log.frame.columns, len(log.frame)
    temperature = np.broadcast_to(0.0, rows)
    if TEMPERATURE in columns:
        temperature = values(log.frame, TEMPERATURE)
    derived: dict[str, Array] = {}
    for matrix in matrices:
        if missing := {*map(gyro_column, matrix.gyros)} - {*columns}:
            left_out = f"gyro {matrix.gyros[0]} is left out"
            flags.append(f"{log.file}: no column '{missing.pop()}', {left_out}")
            continue
        if matrix.over_temperature:
            require(log.file, columns, [TEMPERATURE])
        indications = [values(log.frame, gyro_column(gyro)) for gyro in matrix.gyros]
        rates = matrix.rates(np.column_stack(indications), temperature)
        low, high = matrix.rate_limits
        rates_outside = int(np.count_nonzero((rates < low) | (rates > high)))
        derived |= dict(zip(matrix.outputs, (rates + inertial_dps).T, strict=True))
        if TEMPERATURE in columns:
            flags += flag_temperatures(log.file, matrix, temperature)
        if rates_outside:
            flags.append(
                f"{log.file}: gyro {matrix.gyros[0]} beyond the fitted {low:g} to {high:g} °/s over"
                f" {100.0 * (rates_outside / rows):.1f} % of the rows"
            )
    flags += [RESTED] * (not triad and inertial_dps == 0.0)
    return write_back.rewrite_log(spec, data, log, {}, derived), tuple(dict.fromkeys(flags))


def _read(spec: AnyRecipe, data: Path, matrices: Sequence[GyroMatrix]) -> Log:
    """Read a log with its temperature where it is needed or logged; a triad needs all its gyros,
    else the gyros in the log are read.
    """
    gyros = tuple(gyro_column(gyro) for matrix in matrices for gyro in matrix.gyros)
    if isinstance(spec, GyroTriadRecipe):
        required_columns = (*gyros, TEMPERATURE) if matrices[0].over_temperature else gyros
        log = logs.read_log(spec, data, data.name, required_columns, (TEMPERATURE,))
    else:
        log = logs.read_log(spec, data, data.name, (), ("time_s", TEMPERATURE, *gyros))
        if not {*gyros} & {*log.frame.columns}:
            require(log.file, log.frame.columns, gyros[:1])
    columns = list(log.frame.columns)
    refuse([*check.find_too_few_rows(log, 1), *check.find_missing_values(log, columns)])
    if TEMPERATURE in columns:
        refuse(check.find_implausible_temperatures(log, [TEMPERATURE]))
    return log


def flag_temperatures(file: str, matrix: GyroMatrix, temperature: Array) -> list[str]:
    """Flags for temperatures [n, °C] that are clamped, or outside the range of coefficients without
    a temperature model.
    """
    if matrix.temperature is None:
        return []
    slack = 0.0 if matrix.over_temperature else TEMPERATURE_SLACK
    low, high = matrix.temperature
    rows_outside = np.count_nonzero((temperature < low - slack) | (temperature > high + slack))
    if not rows_outside:
        return []
    consequence = "clamped"
    if not matrix.over_temperature:
        letters = "sensitivities and biases" if len(matrix.outputs) == len(AXES) else "K and F0"
        consequence = f"but {letters} are taken as constant"
    share = f"{100.0 * rows_outside / temperature.size:.1f} % of the rows"
    return [f"{file}: temperature outside {low:.1f} … {high:.1f} °C over {share}, {consequence}"]

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
from calibkit.numeric import chunks

LARGEST_CONDITION = 1e3
"""Largest condition number of the unit vectors of the input axes: noise of the gyros is amplified
by at most this factor.
"""
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
    known = read_matrices(spec, records)
    for matrix in known if isinstance(spec, GyroTriadRecipe) else ():
        matrix.require_biases()
        rows, _ = matrix.reference
        unit = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        if len(unit) < unit.shape[1] or not np.linalg.cond(unit) < LARGEST_CONDITION:
            raise CoefficientError(
                f"the gyros {', '.join(matrix.gyros)} do not sense three axes: rates about them"
                " cannot be had",
                hint="log a gyro of the missing direction too",
            )
    return known


def correct(spec: AnyRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Add compensated rates to every row of a log: of each gyro about its own axis, or about the
    axes of the base.
    """
    known = read_invertible(spec, records)
    log = _read(spec, data, known)
    added, flags, last = 0.0, [*log.notes], []
    if not isinstance(spec, GyroTriadRecipe):
        added = read_earth_rate(spec, records, CoefficientError)
        last = [RESTED] if added == 0.0 else []
    derived: dict[str, Array] = {}
    for matrix in known:
        if missing := {*map(gyro_column, matrix.gyros)} - {*log.frame.columns}:
            left_out = f"gyro {matrix.gyros[0]} is left out"
            flags.append(f"{log.file}: no column '{missing.pop()}', {left_out}")
            continue
        rates, new = _compensate(log, matrix, added)
        derived |= rates
        flags += new
    return write_back.rewrite_log(spec, data, log, {}, derived), tuple(
        dict.fromkeys([*flags, *last])
    )


def _read(spec: AnyRecipe, data: Path, known: Sequence[GyroMatrix]) -> Log:
    """Read a log with its temperature where it is needed or logged; a triad needs all its gyros,
    else the gyros in the log are read.
    """
    columns = tuple(gyro_column(gyro) for matrix in known for gyro in matrix.gyros)
    if isinstance(spec, GyroTriadRecipe):
        needed = (*columns, TEMPERATURE) if known[0].over_temperature else columns
        log = logs.read_log(spec, data, data.name, needed, (TEMPERATURE,))
    else:
        log = logs.read_log(spec, data, data.name, (), (TEMPERATURE, *columns))
        there = [name for name in columns if name in log.frame.columns] or [columns[0]]
        there += [TEMPERATURE] if TEMPERATURE in log.frame.columns else []
        log = logs.read_log(spec, data, data.name, there, ("time_s",))
    present = list(log.frame.columns)
    refuse([*check.find_too_few_rows(log, 1), *check.find_missing_values(log, present)])
    if TEMPERATURE in present:
        refuse(check.find_implausible_temperatures(log, [TEMPERATURE]))
    return log


def _compensate(
    log: Log, matrix: GyroMatrix, added_dps: float
) -> tuple[dict[str, Array], list[str]]:
    """Rates [n, °/s] by column name, and flags."""
    if matrix.over_temperature:
        require(log.file, log.frame.columns, [TEMPERATURE])
    logged, rows = TEMPERATURE in log.frame.columns, len(log.frame)
    temperature = values(log.frame, TEMPERATURE) if logged else np.broadcast_to(0.0, rows)
    indications = [values(log.frame, gyro_column(gyro)) for gyro in matrix.gyros]
    made, beyond = {name: log.allocate(rows) for name in matrix.outputs}, 0
    low, high = matrix.rate_limits
    for a, b in chunks.ranges_along(*indications, temperature, *made.values()):
        rates = matrix.rates(np.column_stack([one[a:b] for one in indications]), temperature[a:b])
        beyond += int(np.count_nonzero((rates < low) | (rates > high)))
        for output, rate in zip(made.values(), rates.T, strict=True):
            output[a:b] = rate + added_dps
    flags = flag_temperatures(log.file, matrix, temperature) if logged else []
    if beyond:
        flags.append(
            f"{log.file}: gyro {matrix.gyros[0]} beyond the fitted {low:g} to {high:g} °/s over"
            f" {100.0 * (beyond / rows):.1f} % of the rows"
        )
    return made, flags


def flag_temperatures(file: str, matrix: GyroMatrix, temperature: Array) -> list[str]:
    """Flags for temperatures [n, °C] that are clamped, or outside the range of coefficients without
    a temperature model.
    """
    if matrix.temperature is None:
        return []
    slack = 0.0 if matrix.over_temperature else TEMPERATURE_SLACK
    low, high = matrix.temperature
    beyond = chunks.count(temperature, lambda part: (part < low - slack) | (part > high + slack))
    if not beyond:
        return []
    constant = "sensitivities and biases" if len(matrix.outputs) == len(AXES) else "K and F0"
    what = "clamped" if matrix.over_temperature else f"but {constant} are taken as constant"
    share = f"{100.0 * beyond / temperature.size:.1f} % of the rows"
    return [f"{file}: temperature outside {low:.1f} … {high:.1f} °C over {share}, {what}"]

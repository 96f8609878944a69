"""A log corrected as the exported firmware would: by the bit-exact twin, without what a target
cannot know.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit import check
from calibkit.firmware import chains, formats, program, twin
from calibkit.frame import refuse, values
from calibkit.ingest import logs, write_back
from calibkit.instruments.accelerometer import fit
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.instruments.fog_thermal import ramps
from calibkit.instruments.fog_thermal.numeric import gradient
from calibkit.numeric import attitude, segments
from calibkit.recipe import FogThermalRecipe

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from calibkit.arrays import Array, Integers
    from calibkit.coefficients import Record
    from calibkit.firmware.program import Program
    from calibkit.frame import Log
    from calibkit.procedures import Applied
    from calibkit.recipe import Recipe


def apply(spec: Recipe, records: Mapping[str, Record], data: Path, number: str) -> Applied:
    """Correct every row of a log with the twin of a run's firmware: the new file's bytes, and the
    statuses as flags.
    """
    quantised = program.of(chains.of(spec, records), formats.of(number))
    site = spec.site.model_copy(update={"gravity_mps2": fit.local_gravity(spec.site)})
    spec = spec.model_copy(update={"site": site})
    if isinstance(spec, FogThermalRecipe):
        return _drift(spec, quantised, data)
    indications = _indications(quantised)
    needed = dict.fromkeys(
        [*(entry.name for entry in quantised.structure.inputs), *indications.values()]
    )
    log = logs.read_log(spec, data, data.name, list(needed))
    refuse(check.rows(log, 1))
    words = {
        e.name: twin.encoded(quantised, e.name, values(log.frame, e.name))
        for e in quantised.structure.inputs
    }
    result = twin.call(quantised, words)
    found = {
        o.name: twin.decoded(quantised, o.name, result.outputs[o.name])
        for o in quantised.structure.outputs
    }
    columns, derived = _corrected(log, found, indications)
    if isinstance(spec, AccelerometerRecipe):
        derived |= _angles(found, spec)
    return write_back.replaced(spec, data, columns, derived), _flags(
        log.file, quantised, result.status
    )


def _indications(quantised: Program) -> dict[str, str]:
    """Output → indication that the application itself corrects with it."""
    found = {}
    for output in quantised.structure.outputs:
        kind, _, rest = output.name.partition("_")
        if kind == "bias":
            found[output.name] = rest
        elif kind == "scale":
            found[output.name] = f"gyro_{rest}_dph"
    return found


def _corrected(
    log: Log, found: Mapping[str, Array], indications: Mapping[str, str]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Columns that replace those of the log, and columns that it did not have."""
    columns, derived = {}, {}
    for name, result in found.items():
        if name in indications:
            indication = values(log.frame, indications[name])
            columns[indications[name]] = (
                indication - result if name.startswith("bias_") else indication * result
            )
        elif name in log.frame.columns:
            columns[name] = result
        else:
            derived[name] = result
    return columns, derived


def _angles(found: Mapping[str, Array], spec: AccelerometerRecipe) -> dict[str, Array]:
    """Inclination and toolface of corrected components."""
    vector = np.column_stack([found[f"accel_{axis}_g"] for axis in "xyz"])
    vector = attitude.gravity_positive(vector, spec.reference.convention)
    return {
        "inclination_deg": attitude.inclination(vector),
        "toolface_deg": attitude.toolface(vector),
    }


def _drift(spec: FogThermalRecipe, quantised: Program, data: Path) -> Applied:
    """Drift updated once an interval with means over it, and taken off the rows of the interval
    after.
    """
    log = logs.read_log(spec, data, data.name, ramps.COLUMNS)
    refuse(ramps.usable(log))
    time, case, env, gyro = (values(log.frame, column) for column in ramps.COLUMNS)
    slope = segments.causal_slope(time, env, spec.segments.slope_window_s)
    interval = spec.drift.interval_s
    blocks = gradient.blocks(time, case, env, gyro, slope, interval)
    heard = {
        "temp_case_degc": blocks.case,
        "temp_env_degc": blocks.case - blocks.gradient,
        "temp_env_rate_degc_min": blocks.rate,
    }
    level, status = _updates(quantised, {e.name: heard[e.name] for e in quantised.structure.inputs})
    known = level[np.maximum(gradient.block_index(time, interval) - 1, 0)]
    note = (
        f"{log.file}: each interval of {interval:g} s is corrected by the drift of the one before,"
        " the first by its own"
    )
    flags = (*check.bridged(log), note, *_flags(log.file, quantised, status))
    return write_back.replaced(spec, data, {"gyro_dph": gyro - known}), flags


def _updates(quantised: Program, heard: Mapping[str, Array]) -> tuple[Array, Integers]:
    """Drift [n, °/h] and status [n] update by update from a reset."""
    words = {name: twin.encoded(quantised, name, column) for name, column in heard.items()}
    state, level, status = twin.reset(quantised, 1), [], []
    for k in range(next(iter(heard.values())).size):
        result = twin.call(
            quantised, {name: column[k : k + 1] for name, column in words.items()}, state
        )
        assert result.state is not None  # noqa: S101 (it was called with one)
        state = result.state
        level.append(float(twin.decoded(quantised, "drift_dph", result.outputs["drift_dph"])[0]))
        status.append(int(result.status[0]))
    return np.array(level), np.array(status, dtype=np.int64)


def _flags(file: str, quantised: Program, status: Integers) -> tuple[str, ...]:
    """Share of calls that returned each status."""
    bits = {flag: 1 << k for k, flag in enumerate(quantised.structure.flags)} | {
        "INVALID": twin.INVALID
    }
    shares = {flag: 100.0 * float(np.mean(status & bit != 0)) for flag, bit in bits.items()}
    return tuple(
        f"{file}: status {flag} in {share:.2g} % of the calls"
        for flag, share in shares.items()
        if share > 0.0
    )

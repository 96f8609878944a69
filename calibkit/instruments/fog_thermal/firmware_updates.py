"""Updates of a drift chain along a log, and the thermal history of its self-test."""

from pathlib import Path

import numpy as np

from calibkit.firmware import as_firmware, pace, vectors
from calibkit.firmware.chain import Chain, Trials
from calibkit.firmware.draft import BEYOND
from calibkit.firmware.program import Program
from calibkit.firmware.thermal_steps import AIR
from calibkit.frame import refuse, values
from calibkit.ingest import logs, write_back
from calibkit.ingest.write_back import Applied
from calibkit.instruments.fog_thermal import ramps
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.numeric import intervals, segments

SUMMED = 3
"""Updates per row of IN_TURN for a chain that sums increments, whose error bound grows with their
number.
"""
IN_TURN = (
    (0.0, 0.0, 0.0, 1),
    (0.03, 0.1, 0.3, 1),
    (0.05, 0.3, 0.6, 1),
    (0.04, 0.5, 0.9, 1),
    (0.07, -0.3, 0.5, 1),
    (0.06, 0.4, 0.08, 1),
    (0.1, -0.2, -0.4, 1),
    (0.08, -0.5, -0.7, 1),
    (0.02, -0.8, -0.9, 1),
    (0.09, 0.05, -0.5, 1),
    (0.055, -0.3, -0.08, 1),
    (0.01, 0.05, 0.02, 1),
    (0.1, 0.9, 0.5, 3),
    (0.5, 1.2, 1.4, 3),
    (1.02, 1.2, 4.5, 1),
    (0.96, 2.6, 0.8, 8),
    *((0.96, 0.5, 0.2, updates) for updates in (5, 7, 25, 40, 40, 70, 200)),
    (0.2, -0.4, -0.3, 3),
    (-0.5, -1.2, -1.4, 3),
    (-1.02, -2.6, -4.5, 2),
    (-0.96, -0.7, -0.8, 8),
    *((-0.96, 0.3, 0.1, updates) for updates in (5, 7, 25, 40, 40, 70, 200)),
    (0.98, -0.6, 0.7, 4),
    (-0.2, 0.2, 0.5, 6),
    (0.1, -0.3, -0.2, 12),
    (-1.02, -4.0, 0.2, 500),
    *((1.02, 0.5, 0.2, updates) for updates in (3, 20, 40, 60, 90)),
    (1.02, 4.0, 0.2, 300),
    *((-1.02, -0.5, -0.2, updates) for updates in (3, 20, 40, 60, 90)),
)
"""Thermal history of the self-test from the reset on, one tuple per row: case temperature relative
to the half range of its input, beyond ±1 from the end of what is followed, air less case relative
to the largest gradient, air rate relative to the largest fitted rate, and number of updates. It
reaches both ends of every range.
"""


def correct_as_firmware(
    spec: FogThermalRecipe,
    chain: Chain,
    quantised: Program,
    data: Path,
) -> Applied:
    """Correct every row of a log by the drift of the previous interval; the chain is updated once
    per interval with means over it.
    """
    columns = _columns(chain)
    log = logs.read_log(spec, data, data.name, tuple(dict.fromkeys(columns)))
    refuse(ramps.find_unusable(log))
    time, case, env, gyro = (values(log.frame, column) for column in columns)
    slope = segments.causal_slope(time, env, spec.segments.slope_window_s)
    interval = spec.drift.interval_s
    held = intervals.Intervals.find(time, interval)
    taken = {
        "temp_case_degc": lambda: held.means(case),
        "temp_env_degc": lambda: held.means(env),
        "temp_env_rate_degc_min": lambda: held.last(slope),
    }
    heard = {entry.name: taken[entry.name]() for entry in quantised.structure.inputs}
    found, status = as_firmware.follow(quantised, held, time, heard)
    (output,) = quantised.structure.outputs
    flags = as_firmware.updates_flags(log, quantised, status)
    corrected = {"gyro_dph": gyro - found[output.name]}
    return write_back.rewrite_log(spec, data, log, corrected), flags


def _columns(chain: Chain) -> tuple[str, str, str, str]:
    """Time, case, chamber air and indication of a log; the case again where no air is needed."""
    taken = (entry.name for entry in chain.structure.inputs)
    needs_air = any(name.startswith("temp_env") for name in taken) and AIR not in chain.derived
    air = "temp_env_degc" if needs_air else "temp_case_degc"
    return ("time_s", "temp_case_degc", air, "gyro_dph")


def thermal_history(chain: Chain) -> Trials:
    """Trials of a drift chain: one thermal history that covers every range from end to end."""
    ranges = {entry.name: chain.tables[entry.table] for entry in chain.structure.inputs}
    low, high = (float(limit) for limit in ranges["temp_case_degc"])
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    if "x_map" in chain.tables:  # the case is followed beyond the fitted range, its word further
        middle, reciprocal, *ends = map(float, chain.tables["x_map"])
        half = float(BEYOND) / reciprocal
        low, high = (middle + end / reciprocal for end in ends)
    gradients = [
        abs(chain.tables[step.table][0]) + 1 / chain.tables[step.table][1]
        for step in chain.structure.maps
        if step.source == "apart"
    ]
    case, ahead, climb, updates = (np.array(column) for column in zip(*IN_TURN, strict=True))
    physical = {
        "temp_case_degc": np.select(
            [case > 1.0, case < -1.0],
            [high + (case - 1.0) * half, low + (case + 1.0) * half],
            middle + half * case,
        )
    }
    physical["temp_env_degc"] = (
        physical["temp_case_degc"] + float(max(gradients, default=0)) * ahead
    )
    if chain.structure.summing:
        fastest = float(ranges["temp_env_rate_degc_min"][1])
        physical["temp_env_rate_degc_min"] = fastest / 4.0 * climb
        updates = np.full_like(updates, SUMMED)
    trials = Trials(
        {name: vectors.coarsen(physical[name], half) for name in ranges}, tuple(updates.tolist())
    )
    return pace.by_the_clock(chain, trials)

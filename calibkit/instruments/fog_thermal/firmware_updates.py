"""Thermal history of the self-test of a drift chain."""

import numpy as np

from calibkit.firmware import pace, vectors
from calibkit.firmware.chain import Chain, Trials
from calibkit.firmware.draft import BEYOND

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

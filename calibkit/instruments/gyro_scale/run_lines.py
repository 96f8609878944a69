"""Shapes of the response that runs ask for, each with a straight line of its own."""

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale.equation import Rows
from calibkit.instruments.gyro_scale.numeric import line_terms


def find_shapes(rows: Rows, corrected: Array) -> tuple[str, ...]:
    """Shapes of the response that the runs ask for; `corrected` [n] are the indications without
    what time and temperature added within the runs.
    """
    runs = int(rows.run.max()) + 1
    of_run = (rows.run[:, None] == np.arange(runs)).astype(np.float64)
    lines, asked = np.column_stack((of_run * rows.rate_dps[:, None], of_run)), dict[str, Array]()
    if not rows.both_ways:
        asked, _ = line_terms.ask(lines, corrected, line_terms.shapes(rows.rate_dps))
    sides = np.array([np.sign(rows.rate_dps[rows.run == k]).sum() for k in range(runs)])
    # runs of one direction each tell asymmetry from each other only; what every run has of it is
    # part of the best straight line, what differs is an error
    if rows.shows_asymmetry or (not rows.both_ways and line_terms.turns_both_ways(sides)):
        asked = {line_terms.ASYMMETRY: np.empty(0)} | asked
    return tuple(asked)

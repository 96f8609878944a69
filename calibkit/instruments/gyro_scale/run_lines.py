"""What the straight lines of single runs tell before one equation is fitted to all of them: shapes
of the response, and orders over temperature.
"""

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale.equation import Rows
from calibkit.instruments.gyro_scale.numeric import line_terms
from calibkit.numeric.least_squares import polynomial

LOWEST_ORDER = 1
"""Of K and F0 over temperature: that a slope is not seen is no proof that there is none."""
HIGHER_ORDER = 0.75
"""Factor by which a higher order over temperature must lower the left-out error of K or F0: runs
are few, and an order too high by chance widens intervals more than a bend that is missed.
"""


def find_shapes(rows: Rows, corrected: Array) -> tuple[tuple[str, ...], Array]:
    """Shapes of the response that the runs ask for, each run with a line of its own, and K and F0
    [2, r] of these lines; `corrected` [n] are the indications without what time and temperature
    added within the runs.
    """
    runs = int(rows.run.max()) + 1
    of_run = (rows.run[:, None] == np.arange(runs)).astype(np.float64)
    lines, asked = np.column_stack((of_run * rows.rate_dps[:, None], of_run)), dict[str, Array]()
    if not rows.both_ways:
        asked, _ = line_terms.ask(lines, corrected, line_terms.shapes(rows.rate_dps))
    design = np.column_stack((lines, *asked.values()))
    slopes = (np.linalg.pinv(design) @ corrected)[: 2 * runs].reshape(2, runs)
    sides = np.array([np.sign(rows.rate_dps[rows.run == k]).sum() for k in range(runs)])
    # runs of one direction each tell asymmetry from each other only; what every run has of it is
    # part of the best straight line, what differs is an error
    if rows.shows_asymmetry or (not rows.both_ways and line_terms.turns_both_ways(sides)):
        asked = {line_terms.ASYMMETRY: np.empty(0)} | asked
    return tuple(asked), slopes


def choose_orders(rows: Rows, lines: Array) -> tuple[int, int]:
    """Orders of K and F0 over temperature by the errors of those of the runs' lines [2, r] at
    temperatures that are left out.
    """
    # all runs at a temperature are left out together
    level = np.round(rows.temp_degc)
    highest = min(polynomial.HIGHEST_ORDER, np.unique(level).size - 2)
    if highest <= 0:
        return 0, 0
    K, F0 = (
        polynomial.choose_order(
            rows.temp_degc,
            _without_sides(rows, values, highest),
            highest,
            margin=HIGHER_ORDER,
            groups=level,
            count_dof=True,
        ).order
        for values in lines
    )
    return max(K, LOWEST_ORDER), max(F0, LOWEST_ORDER)


def _without_sides(rows: Rows, values: Array, order: int) -> Array:
    """K or F0 of the runs' lines [r] less what differs between runs of one direction and of the
    other, beside a polynomial of temperature.
    """
    side = np.bincount(rows.run, np.sign(rows.rate_dps)) / np.bincount(rows.run)
    if np.ptp(side) == 0.0:
        return values
    middle, half = polynomial.middle_and_half(rows.temp_degc)
    powers = polynomial.powers(rows.temp_degc, order, middle=middle, half=half or 1.0)
    found = np.linalg.lstsq(np.column_stack((powers, side)), values)[0]
    return np.asarray(values - found[-1] * side, dtype=np.float64)

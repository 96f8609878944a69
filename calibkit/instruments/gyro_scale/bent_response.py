"""Powers of the rate that the response of a gyro asks for.

A fibre-optic gyro without feedback is a sine whose constants follow temperature: to ± 150 °/s a
cubic leaves 0.11 °/s of it, the fifth power with coefficients that are linear in temperature
0.03 °/s; with their squares K(T) is right too (`equation`).
"""

from functools import partial

import numpy as np

from calibkit.fit.complex_step import derivative
from calibkit.instruments.gyro_scale import equation
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares.fit import rank

POWERS = ((3,), (2, 3), (2, 3, 4, 5), (2, 3, 4, 5, 6, 7))
"""What is compared with the line alone, the simplest first."""
MARGIN = 0.9
"""Factor by which more powers must lower the error: of 40 straight lines one standard error of the
difference by groups (`fit.choose`) lets more than four be bent, this factor fewer.
"""


def choose(rows: equation.Rows, terms: equation.Terms) -> equation.Terms:
    """Terms with the powers that the runs of one gyro ask for, by errors at runs that are left out,
    of a single run at rates.
    """
    chosen, least = terms, _left_out_rms(rows, terms)
    for powers in POWERS:
        bent = terms.bent_by(powers)
        error = _left_out_rms(rows, bent)
        if error < MARGIN * least:
            chosen, least = bent, error
    return chosen


def _left_out_rms(rows: equation.Rows, terms: equation.Terms) -> float:
    """Root mean square error at runs, or rates of a single run, that are left out; infinite where
    the rest does not determine the equation.
    """
    design = derivative(partial(equation.residual, rows=rows, terms=terms), terms.start)
    single = not rows.run.any()
    groups = np.round(rows.rate_dps, 3) if single else rows.run
    errors = []
    for label in np.unique(groups):
        out = groups == label
        if rank(design[~out]) < design.shape[1]:
            return np.inf
        coefficients = np.linalg.lstsq(design[~out], rows.indication[~out])[0]
        error = rows.indication[out] - design[out] @ coefficients
        if not single:
            # K and F0 of a run differ from those of the others: its line tells nothing of the bend
            line = np.column_stack((rows.rate_dps[out], np.ones(error.size)))
            error = error - line @ np.linalg.lstsq(line, error)[0]
        errors.append(error)
    return rms(np.concatenate(errors))

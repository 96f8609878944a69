"""Powers of the rate that the response of a gyro asks for.

A fibre-optic gyro without feedback is a sine whose constants follow temperature: to ± 150 °/s a
cubic leaves 0.11 °/s of it, the fifth power with coefficients that are linear in temperature
0.03 °/s.
"""

from functools import partial

import numpy as np

from calibkit.fit.complex_step import derivative
from calibkit.instruments.gyro_scale import equation
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import leave_out
from calibkit.numeric.least_squares.fit import rank

POWERS: tuple[tuple[int, ...], ...] = ((), (3,), (2, 3), (2, 3, 4, 5), (2, 3, 4, 5, 6, 7))
"""What is compared, the simplest first."""


def choose(rows: equation.Rows, terms: equation.Terms) -> equation.Terms:
    """Terms with the powers that the runs of one gyro ask for, by errors at runs that are left out,
    of a single run at rates. More powers must lower the rms error by more than a tenth.
    """
    candidates = [terms.bent_by(powers) for powers in POWERS]
    errors = [_left_out_rms(rows, candidate) for candidate in candidates]
    return candidates[leave_out.choose_simplest(errors)]


def _left_out_rms(rows: equation.Rows, terms: equation.Terms) -> float:
    """Root mean square error at what is left out; infinite where the rest does not determine the
    equation.
    """
    design = derivative(partial(equation.residual, rows=rows, terms=terms), terms.start)
    if rank(design) < design.shape[1]:
        return np.inf
    left = rows.indication - design @ np.linalg.lstsq(design, rows.indication)[0]
    if not rows.run.any():
        rate = np.round(rows.rate_dps, 3)
        return rms(leave_out.left_out_errors(design, left, groups=rate))
    errors = leave_out.left_out_errors(design, left, groups=rows.run.astype(np.float64))
    if not np.isfinite(errors).all():
        return np.inf
    for run in np.unique(rows.run):
        # K and F0 of a run differ from those of the others: its line tells nothing of the bend
        chosen = rows.run == run
        line = np.column_stack((rows.rate_dps[chosen], np.ones(np.count_nonzero(chosen))))
        errors[chosen] -= line @ np.linalg.lstsq(line, errors[chosen])[0]
    return rms(errors)

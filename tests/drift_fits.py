"""Level and lagged drift models fitted to logs, as the choice among candidates fits each."""

import numpy as np

from calibkit.numeric import intervals
from calibkit.numeric.thermal import fits, pooled_fit
from calibkit.numeric.thermal.fits import LAGGED_TERMS
from calibkit.numeric.thermal.terms import TERMS


def block_log(name, columns, interval_s, begins=()):
    """Block means of a log [n] of time [s], case, chamber [°C] and indication [°/h]."""
    *slow, indication = columns
    held = intervals.Intervals.find(slow[0], interval_s)
    means = (held.means(column) for column in slow)
    return pooled_fit.thermal_blocks(name, held, means, indication, begins)


def stated_uncertainty(model):
    """Type A standard uncertainties of coefficients and lags."""
    return np.sqrt(np.clip(np.diag(model.covariance), 0.0, None))


def fit_level(logs, terms=TERMS):
    """Level model of all logs at once."""
    stacked = pooled_fit.Stack.of_logs(logs)
    return fits.finish(fits.level_basis(stacked).solve(terms))


def solve_lagged(stacked, terms=LAGGED_TERMS):
    """Search over the lags of stacked logs at the noise of a level fit, and its solution."""
    search = fits.lagged_basis(fits.level_basis(stacked).rows)
    return search, search.solve(terms)


def fit_lagged(logs, terms=LAGGED_TERMS):
    """Lagged model of all logs at once."""
    stacked = pooled_fit.Stack.of_logs(logs)
    return fits.finish(solve_lagged(stacked, terms)[1])

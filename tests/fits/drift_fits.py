"""Level and lagged drift models fitted to logs, as the choice among candidates fits each."""

import numpy as np

from calibkit.instruments.bias.numeric import published
from calibkit.instruments.bias.numeric.bank import Bank, BankModel
from calibkit.numeric import intervals
from calibkit.numeric.thermal import fits, pooled_fit
from calibkit.numeric.thermal.fits import LAGGED_TERMS
from calibkit.numeric.thermal.pooled_fit import BlockNoise
from calibkit.numeric.thermal.terms import TERMS, ThermalModel, Valid


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


RATES = published.RatePolynomial(
    "heating",
    np.arange(6.0).reshape(3, 2) + 0.25,
    np.diag(np.arange(1.0, 7.0)),
    4,
    0.01,
    (1.0, 10.0),
    1.0,
    (-20.0, -1.0),
    (-40.0, 60.0),
)


BANK = Bank((30.0, 300.0, 3000.0), (-44.0, 0.0, 40.0, 64.0), (4.0, 16.0), (300.0,))


def bank_model(bank=BANK):
    """Return a bank of lags with every term."""
    count = len(bank.terms)
    return BankModel(
        bank=bank,
        coefficients=0.1 * np.random.default_rng(3).normal(size=count),
        static_lag=(250.0, 1400.0, 0.4),
        covariance=covariance(count + 3),
        valid=Valid((-41.0, 61.0), (-10.0, 10.0), (0.0, 0.0), (0.0, 0.0)),
        turn_on=np.zeros(0),
        turn_on_sd=0.02,
        dof=100,
        residual_rms=0.02,
        noise=BlockNoise(1e-4, 0.01),
        model_error=0.005,
        model_error_dof=7.0,
    )


def on_levels(form="lagged", lags=(210.0, 120.0)):
    """Return a model on levels with every term that its form has."""
    coefficients = TRUE if form == "lagged" else np.append(TRUE[:-1], 0.01)
    return ThermalModel(
        form=form,
        terms=TERMS if form == "level" else TERMS[:-1],
        coefficients=coefficients,
        lags=lags if form == "lagged" else (),
        covariance=covariance(9) if form == "level" else covariance(9 + len(lags), absent=[8]),
        window_s=90.0 if form == "level" else 0.0,
        valid=Valid((-41.0, 61.0), (-10.0, 10.0), (-30.0, 30.0), (-5.0, 5.0)),
        turn_on=np.zeros(0),
        turn_on_variance=0.0,
        constant_dof=7.0,
        dof=100,
        residual_rms=0.02,
        noise=BlockNoise(1e-4, 0.01),
        model_error=0.005,
        model_error_dof=7.0,
        entangled=(),
        flags=(),
    )


def covariance(size, absent=()):
    """Return a covariance of that many coefficients that are correlated, but for absent ones."""
    root = 1e-3 * np.random.default_rng(1).normal(size=(size, size))
    root[list(absent)] = 0.0
    return root @ root.T


TRUE = np.array([3.0, 0.02, -3e-4, 2e-6, 0.05, -0.04, 0.003, 4e-4, 0.0])

"""Stated intervals of drift models cover the truth, on a few simulated gyros."""

import importlib
import sys

import numpy as np
import pandas as pd
import pytest

import calibkit
from calibkit.numeric.intervals import Intervals
from calibkit.numeric.thermal import coil, fits, pooled_fit
from calibkit.numeric.thermal.terms import TERMS, Scales
from calibkit.simulate import noise
from conftest import ROOT

SIZES = np.array([1.0, 0.5, 0.2, 0.3, 0.3, 0.05, 0.1, 0.1])
"""Typical sizes of the terms beyond b0 at the end of their range, of the drift."""
RECIPE = {
    "procedure": "fog_thermal",
    "logs": {"files": ["*.csv"]},
    "output": {"drift": True, "rate_uncertainty": True},
}


@pytest.fixture(scope="module")
def gyros():
    """Return the simulator of gyros."""
    folder = str(ROOT / "benchmarks")
    sys.path.insert(0, folder)
    yield importlib.import_module("lumped_gyro")
    sys.path.remove(folder)


def ratios_of_coefficients(gyros, seed):
    """Errors over standard uncertainties of the coefficients of a gyro whose drift, of 0.5 to 3 °/h
    peak to peak, is that of a level model on the read temperatures, where the fit knows them.
    """
    rng = np.random.default_rng([seed, 7])
    size = np.exp(rng.uniform(np.log(0.25), np.log(1.5)))
    terms = size * rng.choice((-1.0, 1.0), 8) * rng.uniform(0.5, 1.5, 8) * SIZES
    truth = Scales(10.0, 50.0, 8.0, 25.0, 8.0).to_raw() @ np.append(0.0, terms)
    logs = []
    device = gyros.LumpedGyro.draw(seed)
    for name, log in gyros.record(device, gyros.ramps((1.0, 5.0, 8.0, 10.0)), seed).items():
        columns = [log.frame[column].to_numpy() for column in log.frame.columns[:3]]
        intervals = Intervals.find(columns[0], 10.0)
        means = [intervals.means(column) for column in columns]
        drivers = coil.level_drivers(*means)
        drift = np.interp(columns[0], means[0], drivers.raw_design() @ truth)
        drift += noise.angle_random_walk(0.01, drift.size, rng)
        drift += noise.flicker(device.flicker_dph, drift.size, rng) + rng.normal(0.0, 0.02)
        logs.append(pooled_fit.thermal_blocks(name, intervals, means, drift))
    model = fits.finish(fits.level_basis(pooled_fit.Stack.of_logs(logs)).solve(TERMS))
    stated = np.sqrt(np.diag(model.covariance))
    alone = np.array([name not in model.entangled for name in TERMS]) & (stated > 0.0)
    return ((model.coefficients - truth) / np.where(alone, stated, np.nan))[alone]


@pytest.mark.slow
def test_intervals_of_level_coefficients_cover_the_truth(gyros):
    """Eight gyros of the fitted family, some three independent coefficients each: 80 % or more
    within 2 u (95 % less 3 sigma).
    """
    z = np.concatenate([ratios_of_coefficients(gyros, 81_000 + k) for k in range(8)])
    assert z.size >= 64
    assert np.mean(np.abs(z) <= 2.0) >= 0.80
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.3


@pytest.mark.slow
def test_the_uncertainty_of_the_compensated_rate_covers_the_truth(gyros):
    """Withheld ramps of six physical gyros, every other one with hysteresis: at least 85 % of the
    errors within 2 u, and 2 u is not twice what they need.
    """
    ratios = []
    for seed in range(81_000, 81_006):
        device = gyros.LumpedGyro.draw(seed).scale_drift(1.0, float(seed % 2))
        fitted = gyros.record(device, gyros.ramps((1.0, 5.0, 8.0, 10.0)), seed)
        logs = {name: log.frame for name, log in fitted.items()}
        run = calibkit.fit(RECIPE, logs=logs, runs=None, date="2026-11-21")
        for log in gyros.record(device, gyros.ramps((3.0, 6.0), "withheld/"), seed).values():
            found = run.apply(log.frame)
            error = pd.Series(log.drift) - found["gyro_drift_dph"]
            ratios.append(error / (2.0 * found["gyro_standard_uncertainty_dph"]))
    ratios = np.concatenate(ratios)
    assert np.mean(np.abs(ratios) <= 1.0) >= 0.85
    assert np.sqrt(np.mean(ratios**2)) > 0.25

"""Stated intervals of drift models cover the truth, on a few gyros of the benchmark that asks five
hundred.
"""

import importlib.util
import sys

import numpy as np
import pytest

from conftest import ROOT


@pytest.fixture(scope="module")
def benchmark():
    """Return the benchmark as a module."""
    spec = importlib.util.spec_from_file_location(
        "drift_coverage", ROOT / "benchmarks" / "drift_coverage.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["drift_coverage"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["drift_coverage"]


@pytest.mark.slow
def test_intervals_of_level_coefficients_cover_the_truth(benchmark):
    """Eight gyros of the fitted family, some three independent coefficients each: 80 % or more
    within 2 u (95 % less 3 sigma).
    """
    found = np.concatenate([benchmark.of_the_family(81_000 + k, "level") for k in range(8)])
    z = found[np.isfinite(found)]
    assert z.size >= 64
    assert np.mean(np.abs(z) <= 2.0) >= 0.80
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.3


@pytest.mark.slow
def test_the_expanded_uncertainty_of_the_compensated_rate_covers_the_truth(benchmark):
    """Withheld ramps of six physical gyros: at least 85 % of the errors within U, and U is not
    twice what they need.
    """
    both = [benchmark.physical(81_000 + k)[0] for k in range(6)]
    errors = np.abs(np.concatenate(both))
    assert np.mean(errors <= 1.0) >= 0.85
    assert np.sqrt(np.mean(errors**2)) > 0.25

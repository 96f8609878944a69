"""Medians of runs: exactly those of numpy, whatever the values are."""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.numeric import dispersion
from calibkit.numeric.wavelet import shrinkage

MANY = 1 << 16


def cases(n):
    """Values of many kinds: smooth, quantised, constant, mostly zero, of two heaps, drifting, far
    from zero.
    """
    rng = np.random.default_rng(0)
    white = rng.normal(size=n)
    return {
        "white": white,
        "quantised": np.round(3.0 * white),
        "constant": np.full(n, -2.5),
        "mostly zero": np.where(white > 1.0, white, 0.0),
        "two heaps": np.where(np.arange(n) % 2 == 0, 1.0, 5.0) + 1e-3 * white,
        "drifting": np.cumsum(white),
        "far": 1e9 + white,
        "sorted": np.sort(white),
        "tiny": 1e-300 * white,
    }


def test_runs_of_any_length_have_the_medians_of_numpy():
    """Runs of one value and of many, of equal and of unequal lengths; a zero is positive."""
    lengths = ([1] * 40, [2, 1, 3] * 9, [300] * 7, [1, 900, 256, 255, 2, 256, 301])
    for count in lengths:
        first = np.cumsum([0, *count[:-1]])
        for name, values in cases(sum(count)).items():
            parts = np.split(values, first[1:])
            found = dispersion.run_medians(values, first)
            assert found.tolist() == [np.median(part) for part in parts], name
    zeros = dispersion.run_medians(np.full(600, -0.0), np.array([0, 300]))
    assert not np.signbit(zeros).any()
    assert dispersion.run_medians(np.zeros(0), np.zeros(0, dtype=np.int64)).size == 0


@pytest.mark.parametrize("n", [100, MANY])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_detail_that_is_not_finite_is_refused(n, bad):
    """Wherever it stands: it would sort last and be overlooked."""
    for place in (0, n // 2, n - 1):
        values = np.random.default_rng(2).normal(size=n)
        values[place] = bad
        with pytest.raises(FitError, match="not finite"):
            shrinkage.estimate_noise(values)

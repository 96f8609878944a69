"""Root mean square and robust standard deviation, each defined once."""

import numpy as np
import pytest

from calibkit.numeric.dispersion import (
    MAD_OF_UNIT_NORMAL,
    MAD_TO_SIGMA,
    mad_sigma,
    rms,
)


def test_the_rms_is_the_root_of_the_mean_square():
    """3, 4 and their zeros by hand; no values have none."""
    assert rms([3.0, 4.0, 0.0, 0.0]) == 2.5
    assert rms(np.array([[1.0, -1.0], [1.0, -1.0]])) == 1.0
    assert np.isnan(rms([]))


def test_the_mad_stands_for_the_standard_deviation_of_normal_noise():
    """Within three standard errors of 100,000 values, a fifth of them outliers or none."""
    noise = 0.3 * np.random.default_rng(1).standard_normal(100_000)
    assert mad_sigma(noise) == pytest.approx(0.3, rel=0.011)
    assert mad_sigma(np.where(np.arange(noise.size) % 5, noise, 1e6)) < 0.3 * 1.5
    assert mad_sigma(np.array([-2.0, 1.0, 3.0])) == 2.0 * MAD_TO_SIGMA


def test_the_published_constant_is_the_exact_one_to_its_digits():
    """0.6745 of the wavelet literature is Φ⁻¹(3/4)."""
    assert round(1.0 / MAD_TO_SIGMA, 4) == MAD_OF_UNIT_NORMAL

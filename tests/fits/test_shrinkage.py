"""Noise, thresholds and shrinkage rules against their definitions, written as loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from calibkit.numeric.wavelet.lifting import find_wavelet
from calibkit.numeric.wavelet.shrinkage import (
    RULES,
    THRESHOLDS,
    _bayes,
    _minimax,
    _sure,
    estimate_noise,
    noise_gains,
)
from fits.transforms import clean_details

finite = st.floats(-1e6, 1e6)
details_of_a_level = arrays(np.float64, st.integers(1, 60), elements=finite)


@given(details_of_a_level)
def test_noise_is_the_median_magnitude_over_0_6745_and_leaves_the_details_alone(details):
    """The in-place partition gives what the median of a copy gives, for odd and even numbers of
    details.
    """
    before = details.copy()
    assert estimate_noise(details) == pytest.approx(np.median(np.abs(before)) / 0.6745, rel=1e-15)
    assert np.array_equal(details, before)


@pytest.mark.parametrize(
    ("name", "printed", "digits"),
    [
        ("haar", [1.00] * 6, 0.0005),
        ("db2", [1.00] * 6, 0.0005),
        ("db4", [1.00] * 6, 0.0005),
        ("sym8", [1.00] * 6, 0.0005),
        ("cdf97", [0.99, 1.06, 1.02, 1.00, 0.995, 0.99], 0.006),
        ("cdf53", [0.87, 1.16, 1.33, 1.42, 1.47, 1.50], 0.006),
    ],
)
def test_noise_gains_are_the_printed_ones(name, printed, digits):
    """Exact filter norms round to the figures the field prints for levels 1 to 6."""
    assert noise_gains(find_wavelet(name).bank, 6) == pytest.approx(printed, abs=digits)


@pytest.mark.parametrize("name", ["cdf97", "cdf53", "db4", "bior3.5"])
def test_noise_gains_are_the_norms_of_the_transform_of_every_impulse(name):
    """Σ over impulses of the square of one interior detail, by the transform itself, is the squared
    gain.
    """
    length, levels = 700, 4
    square = np.zeros(levels)
    for k in range(length):
        impulse = np.zeros(length)
        impulse[k] = 1.0
        for j, (detail, _) in enumerate(clean_details(impulse, name, levels)):
            square[j] += detail[detail.size // 2] ** 2
    gains = noise_gains(find_wavelet(name).bank, levels)
    np.testing.assert_allclose(gains, np.sqrt(square), rtol=1e-11)


def test_universal_and_minimax_have_their_closed_forms():
    """σ √(2 ln N) of the signal, and σ (0.3936 + 0.1829 log₂ n) of the level with nothing below 33
    details.
    """
    assert THRESHOLDS["universal"](np.zeros(5), 0.6, 6000) == pytest.approx(
        0.6 * math.sqrt(2.0 * math.log(6000)), rel=1e-15
    )
    assert _minimax(np.zeros(64), 2.0, 6000) == pytest.approx(
        2.0 * (0.3936 + 0.1829 * 6.0), rel=1e-15
    )
    assert _minimax(np.zeros(32), 2.0, 6000) == 0.0
    assert THRESHOLDS["universal"](np.zeros(0), 1.0, 1) == 0.0


def test_bayes_is_noise_variance_over_signal_deviation():
    """σ²/√(mean d² − σ²) where there is signal; everything goes where there is none."""
    details = np.array([3.0, -4.0, 0.0, 5.0])
    assert _bayes(details, 2.0, 4) == pytest.approx(4.0 / math.sqrt(50.0 / 4.0 - 4.0), rel=1e-15)
    assert _bayes(details, 10.0, 4) == 5.0
    assert not RULES["hard"](details, _bayes(details, 10.0, 4)).any()


@given(
    arrays(np.int64, st.integers(2, 40), elements=st.integers(-5000, 5000)), st.integers(1, 1000)
)
def test_sure_minimises_the_risk_estimate_found_by_brute_force(counts, sigma):
    """No magnitude has a lower estimated risk, unless the level is sparse or the universal ceiling
    comes first.
    """
    details, n = counts / 100.0, counts.size
    sigma = sigma / 100.0
    scaled = [abs(d) / sigma for d in details]
    ceiling = math.sqrt(2.0 * math.log(n))
    found = _sure(details, sigma, 1000) / sigma
    if sum(x * x for x in scaled) / n - 1.0 <= math.log2(n) ** 1.5 / math.sqrt(n):
        assert found == pytest.approx(ceiling, rel=1e-12)
        return
    risks = {
        t: n - 2 * sum(x <= t for x in scaled) + sum(min(x, t) ** 2 for x in scaled) for t in scaled
    }
    least = min(risks.values())
    best = [t for t, risk in risks.items() if risk <= least + 1e-9 * (1.0 + abs(least))]
    assert any(found == pytest.approx(min(t, ceiling), rel=1e-9, abs=1e-12) for t in best)


def naive_rule(name, d, t):
    """Definition of a rule on one detail: soft, hard (Donoho & Johnstone 1994), garrote (Gao 1998),
    firm with 2 t.
    """
    size = abs(d)
    if size <= t:
        return 0.0
    if name == "soft":
        return math.copysign(size - t, d)
    if name == "garrote":
        return d - t * t / d
    if name == "firm" and size <= 2.0 * t:
        return math.copysign(2.0 * t * (size - t) / (2.0 * t - t), d)
    return d


@pytest.mark.parametrize("name", sorted(RULES))
@given(details=details_of_a_level, threshold=st.floats(1e-3, 1e6))
def test_rules_follow_their_definitions(name, details, threshold):
    """Every detail comes out as its case distinction says, to rounding of the larger of detail and
    threshold.
    """
    expected = [naive_rule(name, float(d), threshold) for d in details]
    np.testing.assert_allclose(RULES[name](details, threshold), expected, rtol=1e-12, atol=1e-9)

"""Simulated noise has the Allan deviation that its coefficients promise, by an Allan deviation of
our own.
"""

import numpy as np
import pytest

from calibkit.simulate import noise


def allan_deviation(rate, samples):
    """Overlapping Allan deviation at `samples` intervals, from its definition on the integrated
    rate.
    """
    angle = np.concatenate(([0.0], np.cumsum(rate)))
    second = angle[2 * samples :] - 2.0 * angle[samples:-samples] + angle[: -2 * samples]
    return np.sqrt(np.mean(second**2) / 2.0) / samples


def stream(seed):
    """Return a generator of its own for each test."""
    return np.random.default_rng(seed)


@pytest.mark.parametrize("tau_s", [1, 10, 100])
def test_angle_random_walk_falls_with_the_root_of_tau(tau_s):
    """The Allan deviation of white rate noise is 60 N/√τ with τ in s, here 0.6 °/h at 1 s for 0.01
    °/√h.
    """
    rate = noise.angle_random_walk(0.01, 200_000, stream(1))
    # at 100 s two thousand independent pairs leave 1.9 % (one sigma)
    assert allan_deviation(rate, tau_s) == pytest.approx(0.6 / np.sqrt(tau_s), rel=0.05)


@pytest.mark.parametrize("tau_s", [8, 64, 512, 2048])
def test_flicker_has_a_flat_allan_deviation(tau_s):
    """The Allan deviation of 1/f noise stands at √(2 ln 2/π) B = 0.664 B whatever τ."""
    records = [noise.flicker(0.005, 32_768, stream(seed)) for seed in range(20)]
    pooled = np.sqrt(np.mean([allan_deviation(rate, tau_s) ** 2 for rate in records]))
    assert pooled == pytest.approx(0.664 * 0.005, rel=0.06)


def test_flicker_is_the_half_order_sum_of_its_white_noise():
    """The fast convolution equals Kasdin's recursion written as two loops."""
    count, white = 50, stream(3).normal(0.0, 2.0, 50)
    response = [1.0]
    for k in range(1, count):
        response.append(response[-1] * (k - 1 + 0.5) / k)
    looped = [sum(response[k] * white[n - k] for k in range(n + 1)) for n in range(count)]
    assert noise.flicker(2.0, count, stream(3)) == pytest.approx(looped, abs=1e-12)


@pytest.mark.parametrize("tau_s", [100, 1000])
def test_rate_random_walk_rises_with_the_root_of_tau(tau_s):
    """The Allan deviation of a walking rate is K √(τ/3) with τ in h."""
    records = [noise.rate_random_walk(0.5, 20_000, stream(seed)) for seed in range(40)]
    pooled = np.sqrt(np.mean([allan_deviation(rate, tau_s) ** 2 for rate in records]))
    assert pooled == pytest.approx(0.5 * np.sqrt(tau_s / 3600.0 / 3.0), rel=0.06)


@pytest.mark.parametrize("tau_s", [1, 5, 20])
def test_pulses_have_the_allan_deviation_of_quantisation(tau_s):
    """Counting in pulses adds √3 Q/τ with Q = pulse/√12, and falls faster than white noise."""
    rate = stream(6).normal(8.0, 0.6, 100_000)
    added = noise.pulses(rate, 0.05) - rate
    assert allan_deviation(added, tau_s) == pytest.approx(
        np.sqrt(3.0) * 0.05 / np.sqrt(12.0) / tau_s, rel=0.03
    )

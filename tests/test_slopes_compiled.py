"""Slopes of the compiled kernel are those of arrays to the last bit, and what it does not take is
left to arrays.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit import native
from calibkit.numeric import segments

pytestmark = pytest.mark.skipif(native.kernels() is None, reason="no compiled kernels")


def both(time, temperature, window_s, skipped):
    """Bytes of the slopes by the kernel and by arrays."""
    found = segments._slopes(time, temperature, window_s, skipped)
    expected = segments._slopes_of_arrays(time, temperature, window_s, skipped)
    assert found.shape == expected.shape
    return found.tobytes(), expected.tobytes()


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.integers(1, 400),
    window_s=st.sampled_from([0.05, 1.0, 7.0, 1e4]),
    clock=st.sampled_from(["steady", "jitter", "gaps", "standing"]),
    step_degc=st.sampled_from([0.0, 0.0625, 1.0]),
)
def test_slopes_are_the_same_bits_with_and_without_the_kernel(
    seed, size, window_s, clock, step_degc
):
    """Steady and unsteady clocks, rows of one time, coarse thermometers, windows shorter than a
    step and longer than the log.
    """
    rng = np.random.default_rng(seed)
    steps = {
        "steady": np.full(size, 0.1),
        "jitter": rng.uniform(0.05, 0.15, size),
        "gaps": rng.choice([0.1, 30.0], size, p=[0.95, 0.05]),
        "standing": rng.choice([0.1, 0.0], size),
    }
    time = np.cumsum(steps[clock]) + rng.normal(scale=1e3)
    temperature = rng.normal(size=size) + 0.3 * time
    if step_degc:
        temperature = np.round(temperature / step_degc) * step_degc
    found, expected = both(time, temperature, window_s, int(rng.integers(0, size)))
    assert found == expected


def test_a_temperature_that_stands_still_has_the_same_zeros():
    """The sign of a zero too."""
    time = np.arange(50.0)
    found, expected = both(time, np.full(50, 20.0), 10.0, 0)
    assert found == expected


def test_a_time_that_runs_backwards_is_left_to_arrays():
    """The kernel's windows only move on: it refuses a time that does not."""
    time = np.arange(50.0)
    time[20] = 3.0
    found, expected = both(time, np.sin(time), 10.0, 5)
    assert found == expected

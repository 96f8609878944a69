"""Block means without spikes."""

import numpy as np
import pytest

from calibkit.numeric import intervals
from calibkit.numeric.thermal import pooled_fit

RNG = np.random.default_rng(1)


def blocks_of(size, count):
    """Return the intervals of `count` blocks of `size` samples."""
    return intervals.Intervals.find(np.arange(float(count * size)), float(size))


def test_spikes_are_found_and_normal_noise_is_not():
    """Of 100,000 normal samples at most 0.1 % are called spikes, of 500 spikes of 20 standard
    deviations all.
    """
    held = blocks_of(10, 10_000)
    noise = RNG.normal(0.0, 0.6, 100_000)
    assert pooled_fit.spikes(noise, held).size < 1e-3 * noise.size
    hit = RNG.choice(noise.size, 500, replace=False)
    noise[hit] += 12.0  # °/h
    found = pooled_fit.spikes(noise, held)
    assert np.isin(hit, found).all()
    assert found.size - 500 < 1e-3 * noise.size


def test_a_spike_does_not_move_the_mean_of_its_block():
    """The mean of a block with a spike of 50 °/h is that of its other samples, and the other blocks
    do not change.
    """
    clean = RNG.normal(5.0, 0.6, 1000)
    dirty = clean.copy()
    dirty[123] += 50.0
    held = blocks_of(10, 100)
    means = pooled_fit.means_without_spikes(dirty, held, excluded=pooled_fit.spikes(dirty, held))
    expected = clean.reshape(100, 10).mean(axis=1)
    expected[12] = np.delete(clean[120:130], 3).mean()
    assert means == pytest.approx(expected, abs=1e-12)  # °/h


def test_an_indication_that_moves_within_its_blocks_has_no_spikes():
    """A fast drift after a long quiet time is a drift, though its blocks deviate far more than the
    quiet ones.
    """
    held = blocks_of(10, 200)
    quiet = RNG.normal(0.0, 0.01, 1500)
    moving = np.arange(500) * 0.05 + RNG.normal(0.0, 0.01, 500)
    assert not pooled_fit.spikes(np.concatenate([quiet, moving]), held).size


def test_block_means_are_those_of_a_loop_and_leave_empty_intervals_out():
    """With gaps and jitter each interval that holds a sample has its mean, in order."""
    time = np.sort(RNG.choice(3000, 1200, replace=False)).astype(np.float64)
    time = time[(time < 500) | (time > 900)] - time[0]
    values = RNG.normal(0.0, 1.0, time.size)
    length = 8.0 * np.pi  # no sample lies on an edge, where rounding decides
    held = intervals.Intervals.find(time, length)
    middle, means = held.means(time), held.means(values)
    numbers = [
        int(np.floor(t / length + 0.5 * min(np.median(np.diff(time)) / length, 1.0))) for t in time
    ]
    expected = [
        [values[i] for i in range(time.size) if numbers[i] == k] for k in sorted(set(numbers))
    ]
    assert means == pytest.approx([float(np.mean(block)) for block in expected], abs=1e-12)
    assert np.all(np.diff(middle) > 0.0)

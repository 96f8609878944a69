"""Healthy logs that were called faulty, beside the fault that each looks like."""

import numpy as np
import pandas as pd
import pytest

from calibkit.check import series
from calibkit.numeric import anomalies
from calibkit.records.frame import Log

ROWS = 20_000
ROW = np.arange(ROWS)


def noise(seed, sigma=1.0):
    """White noise [ROWS]."""
    return np.random.default_rng(seed).normal(0.0, sigma, ROWS)


def names(data):
    """Names of the findings in an indication."""
    frame = pd.DataFrame({"time_s": 0.01 * np.arange(len(data)), "gyro_dph": data})
    log = Log("a", "a.csv", "", len(frame), frame)
    return {finding.name for finding in series.check_indication(log, "gyro_dph", "deg/h")}


def counted(rate, seed, sigma):
    """Pulses per row of a counter whose input turns at a rate [pulses per row], with noise."""
    return np.diff(np.floor(np.cumsum(rate + noise(seed, sigma))), prepend=0.0)


def dithered(beat, amplitude, seed):
    """Counts of a dithered gyro, sampled so that the dither beats [cycles per row]."""
    return np.round(amplitude * np.sin(2.0 * np.pi * beat * ROW + seed) + noise(seed, 0.2))


@pytest.mark.parametrize("rows", [2000, 5000, ROWS])
@pytest.mark.parametrize("shape", ["flat", "decays", "rings"])
def test_a_knock_of_100_rows_is_no_jump_and_no_spikes(rows, shape):
    """The levels before and after a knock are the same, and its rows scatter among themselves."""
    at = np.arange(100)
    knock = {
        "flat": np.full(100, 6.0),
        "decays": 50.0 * np.exp(-at / 25.0),
        "rings": 50.0 * np.exp(-at / 25.0) * np.sin(at / 3.0),
    }[shape]
    for seed in range(5):
        data = noise(seed)[:rows]
        data[rows // 2 : rows // 2 + 100] += knock
        assert names(data) == set(), seed


@pytest.mark.parametrize("drift", [0.0, 20.0])
def test_a_level_that_changes_for_good_is_a_jump(drift):
    """A step of ten standard deviations that stays is found, on a drifting log too."""
    for seed in range(5):
        data = noise(seed) + drift * ROW / ROWS
        data[7000:] += 10.0
        assert names(data) == {"jump"}


def test_a_counter_that_stands_still_is_stuck():
    """Sixty equal values among values that change from row to row, whatever the column."""
    for data in (counted(np.linspace(-3.0, 3.0, ROWS), 0, 0.5), dithered(0.137, 50.0, 1), noise(2)):
        data[9000:9060] = data[9000]
        assert "stuck" in names(data)


def test_a_spike_is_judged_by_the_noise_around_it():
    """Thirty standard deviations are a spike in the quiet part of a log whose other part is ten
    times noisier; a burst of 60 noisy rows is not a row of spikes.
    """
    for seed in range(5):
        data = noise(seed) * np.where(ROW < ROWS // 2, 1.0, 10.0)
        data[4321] += 30.0
        assert anomalies.spikes(data).tolist() == [4321]
        burst = noise(seed)
        burst[8000:8060] += noise(seed + 9, 15.0)[:60]
        assert anomalies.spikes(burst).size == 0

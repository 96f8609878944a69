"""Residuals that differ from group to group."""

import numpy as np

from calibkit.instruments.accelerometer.findings import find_lack_of_fit

LABELS = np.repeat(np.arange(6), 20)


def test_a_group_that_is_off_is_found_with_its_size():
    """One of six groups 1.5 standard deviations off, and a second grouping without any."""
    rng = np.random.default_rng(3)
    residuals = rng.normal(size=120) + np.where(LABELS == 4, 1.5, 0.0)
    ((group, label, size),) = find_lack_of_fit(
        residuals, {"soak": LABELS, "face": np.tile(np.arange(20), 6)}
    )
    assert (group, label) == ("soak", 4)
    assert abs(size - 1.5) < 3.0 / np.sqrt(20.0)


def test_faultless_residuals_are_found_off_once_in_a_thousand_times():
    """2,000 sets with two groupings each: at most 8, the 99.9 % limit of the chance stated."""
    rng = np.random.default_rng(4)
    groupings = {"soak": LABELS, "half": LABELS // 3}
    alarms = sum(bool(find_lack_of_fit(rng.normal(size=120), groupings)) for _ in range(2000))
    assert alarms <= 8


def test_a_single_group_and_rows_without_one_are_no_test():
    """Nothing to compare."""
    residuals = np.ones(10)
    assert find_lack_of_fit(residuals, {"soak": np.zeros(10, dtype=np.int64)}) == []
    assert find_lack_of_fit(residuals, {"soak": np.full(10, -1)}) == []

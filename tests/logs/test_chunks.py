"""Long columns: extremes, medians, runs and model intervals."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from calibkit.numeric import chunks, dispersion, intervals

FINITE = st.floats(-1e6, 1e6)


@given(arrays(np.float64, st.tuples(st.integers(1, 7), st.integers(1, 12)), elements=FINITE))
def test_the_median_of_each_row_is_that_of_numpy(rows: np.ndarray) -> None:
    """Of an even and of an odd number of values."""
    first = rows.shape[1] * np.arange(len(rows))
    found = dispersion.run_medians(rows.ravel(), first)
    assert np.array_equal(found, np.median(rows, axis=1))


@pytest.mark.parametrize("size", [1, 2, 9, 10, 200_000, 200_001])
def test_the_median_of_a_column_is_that_of_numpy(size: int) -> None:
    """Of even and odd numbers of values; ties change nothing."""
    rng = np.random.default_rng(size)
    for values in (rng.normal(size=size), rng.integers(0, 3, size).astype(np.float64)):
        assert dispersion.median(values) == np.median(values)


@given(st.lists(st.booleans(), max_size=80))
@settings(max_examples=100, deadline=None)
def test_runs_of_a_mask_are_those_of_a_loop(chosen):
    """First row and row after the last of every run, at both ends too."""
    expected, start = [], None
    for row, inside in enumerate([*chosen, False]):
        if inside and start is None:
            start = row
        elif not inside and start is not None:
            expected.append([start, row])
            start = None
    assert chunks.find_runs(np.array(chosen, dtype=bool)).tolist() == expected


@pytest.mark.parametrize("length_s", [1.0, 250.0, 140_000.0])
def test_means_of_intervals_are_those_of_their_rows(length_s: float) -> None:
    """Intervals of one row, of some, and of more than a chunk holds, above an origin or not."""
    values = np.random.default_rng(5).normal(size=300_000)
    held = intervals.Intervals.find(np.arange(300_000.0), length_s)
    expected = [part.mean() for part in np.split(values, held.first[1:])]
    assert held.means(values) == pytest.approx(expected, abs=1e-12)
    assert held.means(values, origin=3.0) == pytest.approx(np.array(expected) - 3.0, abs=1e-12)

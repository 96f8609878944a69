"""Long columns a span of rows at a time: extremes, medians and steps are those of the whole
column.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from calibkit.check import magnitude
from calibkit.ingest import logs_on_disk
from calibkit.numeric import chunks, dispersion, intervals, order_statistics
from calibkit.numeric.intervals import Intervals

FINITE = st.floats(-1e6, 1e6)


@given(arrays(np.float64, st.tuples(st.integers(1, 7), st.integers(1, 12)), elements=FINITE))
def test_the_median_of_each_row_is_that_of_numpy(rows: np.ndarray) -> None:
    """One selected element and the largest below it give the very median, of an even and of an odd
    number of values.
    """
    first = rows.shape[1] * np.arange(len(rows))
    found = order_statistics.run_medians(rows.ravel(), first)
    assert np.array_equal(found, np.median(rows, axis=1))


def test_rows_where_a_column_changes_are_found() -> None:
    """The first row too, where the one before it differs."""
    values = np.array([1.0, 1.0, 2.0, 2.0, 1.0])
    assert chunks.changed_rows(values, 1.0).tolist() == [2, 4]
    assert chunks.changed_rows(values, 0.0).tolist() == [0, 2, 4]
    assert chunks.changed_rows(values[:0], 0.0).tolist() == []


def test_medians_of_many_rows_are_taken_a_span_at_a_time() -> None:
    """A last span with fewer rows than the others keeps its place."""
    rows = np.random.default_rng(3).normal(size=(1000, 301))
    found = order_statistics.run_medians(rows.ravel(), 301 * np.arange(1000))
    assert np.array_equal(found, np.median(rows, axis=1))


@pytest.mark.parametrize(
    "size",
    [
        1,
        2,
        9,
        10,
        order_statistics.COLLECTED,
        order_statistics.COLLECTED + 1,
        2 * order_statistics.COLLECTED + 7,
    ],
)
def test_the_median_of_a_column_is_that_of_numpy(size: int) -> None:
    """Short columns are parted whole, long ones between two values of a sample; ties change
    nothing.
    """
    rng = np.random.default_rng(size)
    for values in (rng.normal(size=size), rng.integers(0, 3, size).astype(np.float64)):
        assert order_statistics.median(values) == np.median(values)


def test_the_median_with_a_missing_value_is_missing() -> None:
    """Nothing that is not a number passes for a large value."""
    assert np.isnan(order_statistics.median(np.array([1.0, np.nan, 2.0])))


@pytest.mark.parametrize(
    "where", [0, chunks.CACHED_ROWS - 1, chunks.CACHED_ROWS, 2 * chunks.CACHED_ROWS]
)
def test_extremes_are_found_and_a_missing_value_is_not_passed_over(where: int) -> None:
    """The smallest and largest of every part count, and one missing value makes both missing."""
    values = np.random.default_rng(1).normal(size=2 * chunks.CACHED_ROWS + 1)
    assert chunks.extremes(values) == (values.min(), values.max())
    values[where] = 1e3
    assert chunks.extremes(values)[1] == 1e3
    values[where] = np.nan
    assert np.isnan(chunks.extremes(values)).all()
    assert np.isnan(chunks.extremes(values[:0])).all()


@pytest.mark.parametrize(
    "size", [2, 5, 200_000, order_statistics.COLLECTED + 2, order_statistics.COLLECTED + 3]
)
def test_steps_of_a_clock_are_those_of_its_differences(size: int) -> None:
    """Shortest, longest and median step are those of all differences, those across two spans among
    them.
    """
    time = np.cumsum(np.random.default_rng(size).uniform(0.5, 1.5, size))
    time[size // 2 :] += 20.0
    step = np.diff(time)
    assert intervals.Steps.find(time) == intervals.Steps(step.min(), step.max(), np.median(step))
    assert np.isnan(intervals.Steps.find(time[:1]).usual)


def test_an_interval_that_is_known_changes_no_model_interval() -> None:
    """Model intervals are the same whether the sampling interval is given or measured."""
    time = np.arange(0.0, 500.0, 0.1)
    given_step, measured = (
        intervals.Intervals.find(time, 10.0, step)
        for step in (intervals.Steps.find(time).usual, None)
    )
    assert isinstance(given_step, Intervals)
    assert np.array_equal(given_step.first, measured.first)
    assert np.array_equal(given_step.number, measured.number)


@pytest.mark.parametrize("length_s", [1.0, 250.0, 140_000.0])
def test_means_of_intervals_are_those_of_their_rows(length_s: float) -> None:
    """Intervals of one row, of some, and of more than a chunk holds, above an origin or not."""
    values = np.random.default_rng(5).normal(size=300_000)
    held = intervals.Intervals.find(np.arange(300_000.0), length_s)
    expected = [part.mean() for part in np.split(values, held.first[1:])]
    assert held.means(values) == pytest.approx(expected, abs=1e-12)
    assert held.means(values, origin=3.0) == pytest.approx(np.array(expected) - 3.0, abs=1e-12)


@given(
    st.lists(st.floats(-5.0, 5.0).map(lambda x: round(x, 1)), min_size=2, max_size=200),
    st.floats(0.0, 1.0),
)
@settings(max_examples=150, deadline=None)
def test_a_quantile_in_spans_is_that_of_numpy(values, share):
    """Ties and neighbours on both sides of a span: the same number to the last bit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(order_statistics, "COLLECTED", 7)
        parts = [np.array(values[k : k + 9]) for k in range(0, len(values), 9)]
        assert order_statistics.quantile_of_chunks(
            lambda: parts, len(values), share
        ) == np.quantile(values, share)


@given(st.lists(st.booleans(), max_size=80), st.integers(1, 20))
@settings(max_examples=100, deadline=None)
def test_runs_of_chosen_rows_go_on_from_span_to_span(chosen, rows):
    """First and one past the last of each run are those of the whole."""
    mask = np.array(chosen, dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(int), [0])))).reshape(-1, 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunks, "ROWS", rows)
        assert np.array_equal(chunks.find_runs(mask.size, lambda a, b: mask[a:b]), edges)


def test_figures_of_long_columns_are_those_of_numpy(monkeypatch):
    """Mean, deviation, correlation, counts, rows and thinned values over spans of 7 rows: to 1e-12,
    or exactly.
    """
    monkeypatch.setattr(chunks, "ROWS", 7)
    one, other = np.random.default_rng(2).normal(3.0, 1.0, (2, 100))
    other += one
    assert chunks.mean(one) == pytest.approx(one.mean(), rel=1e-12)
    assert np.sqrt(dispersion.variance(one)) == pytest.approx(one.std(), rel=1e-12)
    assert magnitude._correlation(one, other) == pytest.approx(
        np.corrcoef(one, other)[0, 1], rel=1e-12
    )
    assert chunks.count(one, lambda part: part > 3.0) == np.sum(one > 3.0)
    assert (
        chunks.rows_where(one, lambda part: part > 3.0).tolist()
        == np.flatnonzero(one > 3.0).tolist()
    )
    assert (
        chunks.rows_where(one, lambda part: part > 0.5, step=True).tolist()
        == np.flatnonzero(np.diff(one) > 0.5).tolist()
    )
    assert np.array_equal(chunks.take_slice(one, slice(5, 90, 4)), one[5:90:4])
    mapped = logs_on_disk._allocate_column(100)
    mapped[:] = one
    rows = np.array([[2, 3, 4], [5, 6, 7], [6, 7, 8], [90, 91, 92]])
    assert np.array_equal(chunks.take_rows(mapped, rows), one[rows])

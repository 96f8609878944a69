"""Dwells in continuous logs: found, averaged, cut; with the noise that their means really have."""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.numeric import chunks, dwells

HOLDS = [(0, 400), (460, 700), (780, 1400), (1425, 1700)]


def handled(seed=0, *, noise=0.01, rows=1700):
    """A log of four holds with movements between them."""
    rng = np.random.default_rng(seed)
    log = np.cumsum(rng.normal(0.0, 0.2, (rows, 3)), axis=0)
    for start, stop in HOLDS:
        log[start:stop] = rng.normal(0.0, 1.0, 3)
    return log + rng.normal(0.0, noise, log.shape)


def test_holds_are_found_and_their_ends_left_out():
    """Every hold is found once, inside its true limits, with little more than half a window missing
    at each end.
    """
    found = dwells.find_dwells(handled(), 20)
    assert len(found) == len(HOLDS)
    for (start, stop), (begin, end) in zip(HOLDS, found.tolist(), strict=True):
        assert start <= begin <= start + 12
        assert stop - 12 <= end <= stop


def test_a_log_that_stands_still_to_the_last_bit_is_one_dwell():
    """Quantised indications without any noise are held, although their noise at rest is zero."""
    log = np.tile([100.0, -3.0, 5.0], (500, 1))
    log[250:260] += 400.0
    log[260:] += [1.0, 0.0, 0.0]
    assert len(dwells.find_dwells(log, 10)) == 2
    # a last bit that flickers now and then does not cut the hold into pieces
    log[::31, 0] += 1.0
    assert len(dwells.find_dwells(log, 10)) == 2


def test_nothing_held_is_refused_with_the_limit():
    """A log in motion has no dwells, and the message says what was allowed."""
    with pytest.raises(FitError, match="nothing was held still for 40 rows"):
        dwells.find_dwells(handled(), 20, threshold=1e-4)


def test_short_and_broken_logs_are_refused():
    """Too few rows for the window, or a missing value, are said."""
    with pytest.raises(FitError, match="50 rows for windows of 20"):
        dwells.find_dwells(handled()[:50], 20)
    log = handled()
    log[7, 2] = np.nan
    with pytest.raises(FitError, match="not finite"):
        dwells.find_dwells(log, 20)


def test_means_and_noise_are_those_of_the_rows():
    """Mean and standard error of independent rows are the textbook ones."""
    rng = np.random.default_rng(1)
    columns = rng.normal(5.0, 2.0, (200, 2))
    mean, standard_error = dwells.average_dwells(columns, np.array([[0, 50], [50, 200]]))
    np.testing.assert_allclose(mean, [columns[:50].mean(axis=0), columns[50:].mean(axis=0)])
    np.testing.assert_allclose(standard_error[0], columns[:50].std(axis=0, ddof=1) / np.sqrt(50))


def test_noise_that_does_not_average_out_is_not_averaged_away():
    """For correlated noise the standard error is near the scatter of many means, not a tenth of
    it.
    """
    rng = np.random.default_rng(2)
    white = rng.normal(size=(300, 2000))
    red = np.empty_like(white)
    red[:, 0] = white[:, 0]
    for k in range(1, 2000):
        red[:, k] = 0.97 * red[:, k - 1] + white[:, k]
    found = [
        dwells.average_dwells(row[:, None], np.array([[0, 2000]]))
        for row in red[:, :, None][:, :, 0]
    ]
    stated = np.sqrt(np.mean([error[0, 0] ** 2 for _, error in found]))
    independent = np.mean(red.std(axis=1, ddof=1)) / np.sqrt(2000)
    truth = np.std([mean[0, 0] for mean, _ in found])
    assert stated == pytest.approx(truth, rel=0.25)
    assert independent < 0.2 * truth


@pytest.mark.parametrize("quantum", [0.0, 0.01])
def test_dwells_and_their_means_do_not_depend_on_the_length_of_spans(quantum, monkeypatch):
    """Spans of 37 rows find the very dwells, of fine and of coarse indications, and their figures
    to 1e-10.
    """
    log = handled()
    log = np.round(log / quantum) * quantum if quantum else log
    intervals = [dwells.find_dwells(log, 20)]
    found = [dwells.average_dwells(log, intervals[0])]
    monkeypatch.setattr(chunks, "ROWS", 37)
    intervals.append(dwells.find_dwells(log, 20))
    found.append(dwells.average_dwells(log, intervals[1]))
    np.testing.assert_array_equal(*intervals)
    np.testing.assert_allclose(*found, rtol=1e-10, atol=1e-13)

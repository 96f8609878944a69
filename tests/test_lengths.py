"""Lengths of corrected vectors: a twin one row at a time, and the same bits whether or not they are
compiled.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit import native
from calibkit.instruments.accelerometer.numeric import norms

TRIANGLE = np.array([1.01, 0.02, 0.98, -0.01, 0.03, 1.02, 0.005, -0.004, 0.003])
only_compiled = pytest.mark.skipif(native.kernels() is None, reason="no compiled kernels")


def of_arrays(made, monkeypatch):
    """What a call gives where nothing is compiled."""
    with monkeypatch.context() as patch:
        patch.setattr(native, "kernels", lambda: None)
        return made()


def dwells(count, seed=1):
    """Indications of a triad all round, in g."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    return direction / np.linalg.norm(direction, axis=1)[:, None] + rng.normal(
        0.0, 1e-3, (count, 3)
    )


def test_lengths_and_derivatives_are_those_of_one_row_at_a_time():
    """|T (V − b)| − g of each row, and its differences when each of the nine parameters is
    moved.
    """
    indication, root = dwells(9), np.linspace(1.0, 2.0, 9)

    def one(at, row):
        matrix = np.array([[at[0], 0.0, 0.0], [at[1], at[2], 0.0], [at[3], at[4], at[5]]])
        return (np.linalg.norm(matrix @ (indication[row] - at[6:])) - 1.0) * root[row]

    residual, slopes = norms.length_residuals(TRIANGLE, indication, 1.0, root)
    step = 1e-6 * np.eye(9)
    for row in range(9):
        assert residual[row] == pytest.approx(one(TRIANGLE, row), abs=1e-15)
        central = [(one(TRIANGLE + d, row) - one(TRIANGLE - d, row)) / 2e-6 for d in step]
        np.testing.assert_allclose(slopes[row], central, rtol=0, atol=1e-9)


@only_compiled
@given(
    count=st.integers(0, 600),
    seed=st.integers(0, 99),
    scale=st.sampled_from([1.0, 1e-160, 1e150, 9.80665]),
)
@settings(max_examples=60, deadline=None)
def test_compiled_lengths_have_the_bits_of_arrays(count, seed, scale):
    """Residuals, derivatives and sums of squares, of any number of rows and of any size."""
    indication, root = (
        dwells(count, seed) * scale,
        np.random.default_rng(seed).uniform(0.5, 2.0, count),
    )
    with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
        for made in (
            lambda: norms.length_residuals(TRIANGLE, indication, scale, root),
            lambda: (
                norms.sum_squares(
                    np.ascontiguousarray(
                        norms.length_residuals(TRIANGLE, indication, scale, root)[1].T
                    )
                ),
            ),
        ):
            for one, other in zip(made(), of_arrays(made, patch), strict=True):
                assert one.tobytes() == other.tobytes()


@only_compiled
def test_what_is_not_finite_stays_in_its_row_compiled_or_not(monkeypatch):
    """A NaN, an infinity, and a row that is the bias itself: the same numbers in all other rows, no
    number in theirs.
    """
    indication = dwells(40)
    indication[3, 1], indication[17, 2], indication[30] = np.nan, np.inf, TRIANGLE[6:]

    def made():
        with np.errstate(all="ignore"):
            return norms.length_residuals(TRIANGLE, indication, 1.0, np.ones(40))

    for one, other in zip(made(), of_arrays(made, monkeypatch), strict=True):
        lost = np.isnan(one)
        assert np.array_equal(lost, np.isnan(other))
        assert one[~lost].tobytes() == other[~lost].tobytes()
    assert np.flatnonzero(np.isnan(made()[1]).any(axis=1)).tolist() == [3, 17, 30]


@only_compiled
def test_rows_that_do_not_follow_one_another_are_read_as_arrays_read_them():
    """Every third row, single precision, and components as columns."""
    indication, root = dwells(300), np.linspace(1.0, 2.0, 300)
    for rows, weights in (
        (indication[::3], root[::3]),
        (indication.astype(np.float32), root),
        (np.asfortranarray(indication), root),
    ):
        made = norms.length_residuals(TRIANGLE, rows, 1.0, weights)
        expected = norms.length_residuals(
            TRIANGLE, np.array(rows, dtype=np.float64, order="C"), 1.0, weights.copy()
        )
        for one, other in zip(made, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)

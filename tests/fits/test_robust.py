"""Robust linear fits: outliers move nothing and get weight 0."""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.fit import robust
from calibkit.numeric.least_squares import fit


def problem(seed, rows=150, columns=6):
    """Design, coefficients and indications with unit noise."""
    rng = np.random.default_rng(seed)
    design = np.column_stack([np.ones(rows), rng.normal(size=(rows, columns - 1))])
    coefficients = rng.normal(size=columns)
    return design, coefficients, design @ coefficients + rng.normal(size=rows)


def uncertainty_of(design):
    """Standard uncertainties of least squares of unit noise."""
    return np.sqrt(np.diag(np.linalg.inv(design.T @ design)))


def moved(design, before, after):
    """Largest change of a coefficient in standard uncertainties."""
    return np.max(np.abs(after.coefficients - before.coefficients) / uncertainty_of(design))


@pytest.mark.parametrize("reach", [3.0, 30.0, 1e3, 1e6])
def test_one_outlier_of_high_leverage_in_a_hundred_moves_nothing(reach):
    """A row whose regressors are far off drags plain least squares along and leaves the robust fit
    where it was.
    """
    dragged = []
    for seed in range(6):
        design, truth, indication = problem(seed)
        rng = np.random.default_rng(seed)
        spoilt, row = design.copy(), int(rng.integers(0, 150))
        spoilt[row, 1:] += reach * rng.normal(size=5)
        clean = robust.linear(design, indication)
        assert moved(design, clean, robust.linear(spoilt, indication)) < 1.0
        plain = fit.linear(spoilt, indication)
        dragged.append(np.max(np.abs(plain.coefficients - truth) / uncertainty_of(design)))
    assert max(dragged) > 4.0


def test_outliers_that_cover_for_one_another_are_all_named():
    """Eight outliers that lie on a line of their own hide from residuals and deletion, not from
    the start.
    """
    design, _, indication = problem(1)
    spoilt, wrong = design.copy(), indication.copy()
    outliers = np.arange(40, 48)
    spoilt[outliers, 1:] = np.array([12.0, 0.0, 0.0, 0.0, 0.0]) + np.random.default_rng(2).normal(
        0.0, 0.1, (8, 5)
    )
    wrong[outliers] = -40.0
    after = robust.linear(spoilt, wrong)
    assert np.all(after.row_weights[outliers] == 0.0)
    assert moved(design, robust.linear(design, indication), after) < 1.5


def test_clean_rows_are_fitted_as_well_as_by_least_squares():
    """On normal noise the errors are at most 10 % larger, and hardly a row is accused."""
    tough, plain, accused = [], [], 0
    for seed in range(60):
        design, truth, indication = problem(seed)
        found = robust.linear(design, indication)
        tough.append(found.coefficients - truth)
        plain.append(fit.linear(design, indication).coefficients - truth)
        accused += int(np.sum(found.row_weights == 0.0))
    assert 0.95 < np.std(tough) / np.std(plain) < 1.1
    assert accused <= 6


def test_too_few_rows_are_refused():
    """Four rows more than coefficients cannot show which is an outlier."""
    design, _, indication = problem(8, rows=10)
    with pytest.raises(FitError, match="10 rows for 6 coefficients cannot show"):
        robust.linear(design, indication)


def test_a_row_that_alone_fixes_a_coefficient_still_does():
    """A column that is non-zero in one row only is fitted by that row, not refused."""
    design, _, indication = problem(9)
    alone = np.zeros((150, 1))
    alone[33] = 1.0
    result = robust.linear(np.column_stack([design, alone]), indication)
    assert result.residuals[33] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("temperatures", [4, 9])
def test_six_faces_are_fitted_at_few_and_at_many_temperatures(temperatures):
    """Columns that are 0 in most rows, for which half of the rows leave a coefficient open: it is
    found, and one outlier alone has weight 0.
    """
    faces = np.vstack([np.eye(3), -np.eye(3)])
    warm = np.repeat(np.linspace(-1.0, 1.0, temperatures), 6)[:, None]
    plain = np.column_stack([np.ones(6 * temperatures), np.tile(faces, (temperatures, 1))])
    design, truth = np.hstack([plain, plain * warm]), np.linspace(-1.0, 1.0, 8)
    indication = design @ truth + 1e-3 * np.random.default_rng(3).normal(size=len(design))
    indication[7] += 0.5
    found = robust.linear(design, indication)
    assert np.max(np.abs(found.coefficients - truth)) < 2e-3
    assert np.flatnonzero(found.row_weights == 0.0).tolist() == [7]

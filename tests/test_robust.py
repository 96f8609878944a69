"""Robust linear fits: wild rows move nothing and are named."""

import numpy as np
import pytest

from calibkit.errors import FitError
from calibkit.numeric.least_squares import fit, robust


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


@pytest.mark.parametrize("size", [3.0, 5.0, 8.0, 30.0, 1e3, 1e9])
def test_one_wild_indication_in_a_hundred_moves_nothing(size):
    """However large or small the fault, no coefficient moves by its standard uncertainty."""
    for seed in range(6):
        design, _, indication = problem(seed)
        spoilt = indication.copy()
        wild = np.random.default_rng(seed).integers(0, 150, 1)
        spoilt[wild] += size
        assert moved(design, robust.linear(design, indication), robust.linear(design, spoilt)) < 1.0


@pytest.mark.parametrize("reach", [3.0, 30.0, 1e3, 1e6])
def test_one_wild_row_of_high_leverage_in_a_hundred_moves_nothing(reach):
    """A row whose regressors are wild drags plain least squares along and leaves the robust fit
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


def test_wild_rows_that_cover_for_one_another_are_all_named():
    """Eight wild rows that lie on a line of their own hide from residuals and deletion, not from
    the start.
    """
    design, _, indication = problem(1)
    spoilt, wrong = design.copy(), indication.copy()
    wild = np.arange(40, 48)
    spoilt[wild, 1:] = np.array([12.0, 0.0, 0.0, 0.0, 0.0]) + np.random.default_rng(2).normal(
        0.0, 0.1, (8, 5)
    )
    wrong[wild] = -40.0
    after = robust.linear(spoilt, wrong)
    assert set(wild.tolist()) <= set(after.suspects)
    assert moved(design, robust.linear(design, indication), after) < 1.5


def test_suspects_come_worst_first():
    """The list opens with the row that is farthest off."""
    design, _, indication = problem(3)
    indication[[10, 20, 30]] += [20.0, 200.0, -60.0]
    assert robust.linear(design, indication).suspects == (20, 30, 10)


def test_clean_rows_are_fitted_as_well_as_by_least_squares():
    """On normal noise the errors are at most 10 % larger, and hardly a row is accused."""
    tough, plain, accused = [], [], 0
    for seed in range(60):
        design, truth, indication = problem(seed)
        found = robust.linear(design, indication)
        tough.append(found.coefficients - truth)
        plain.append(fit.linear(design, indication).coefficients - truth)
        accused += len(found.suspects)
    assert 0.95 < np.std(tough) / np.std(plain) < 1.1
    assert accused <= 6


def test_residuals_are_those_of_all_rows():
    """A wild row of a million is where it was."""
    design, _, indication = problem(4)
    indication[11] += 1e6
    result = robust.linear(design, indication)
    assert result.residuals.size == 150
    assert result.residuals[11] == pytest.approx(1e6, rel=1e-3)


def test_exact_data_stay_exact_with_a_wild_row_among_them():
    """Without noise the coefficients come out to rounding, and the wild row is the only suspect."""
    design, truth, _ = problem(5)
    indication = design @ truth
    indication[70] += 1.0
    result = robust.linear(design, indication)
    np.testing.assert_allclose(result.coefficients, truth, atol=1e-12)
    assert result.suspects == (70,)


def test_weights_are_honoured():
    """Rows with a hundred times the noise and the weight to match are not suspect, without it they
    are.
    """
    design, truth, _ = problem(6)
    noise = np.where(np.arange(150) < 30, 100.0, 1.0)
    indication = design @ truth + noise * np.random.default_rng(7).normal(size=150)
    assert robust.linear(design, indication, weights=1.0 / noise**2).suspects == ()
    assert len(robust.linear(design, indication).suspects) > 15


def test_too_few_rows_are_refused():
    """Four rows more than coefficients cannot show which is wild."""
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


def test_nonlinear_problem_is_fitted_in_spite_of_a_wild_row():
    """An exponential through forty points, one of them wild, comes out as without it."""
    x = np.linspace(0.0, 3.0, 40)
    y = 2.0 * np.exp(-0.7 * x) + np.random.default_rng(10).normal(0.0, 0.01, 40)
    spoilt = y.copy()
    spoilt[5] += 3.0

    def linearised(data):
        def at(p):
            decay = np.exp(-p[1] * x)
            return p[0] * decay - data, np.column_stack([decay, -p[0] * x * decay])

        return at

    clean, _ = robust.nonlinear(linearised(y), np.array([2.0, 0.7]))
    found, step = robust.nonlinear(linearised(spoilt), np.array([2.5, 0.9]))
    u = 0.01 * uncertainty_of(linearised(y)(clean)[1])
    assert np.max(np.abs(found - clean) / u) < 1.0
    assert step.suspects == (5,)


def six_faces(seed, shared=1.75e-4):
    """Tumbles of one axis on six faces at seven temperatures, noise 20 µg, each face set up a
    little wrong, the same way at every temperature: design, indication, labels of faces and of
    temperatures.
    """
    rng = np.random.default_rng(seed)
    face, soak = np.repeat(np.arange(6), 7), np.tile(np.arange(7), 6)
    gravity = np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 7, axis=0)
    design = np.column_stack([np.ones(42), gravity, (soak - 3.0) / 3.0])
    truth = np.array([1e-3, 1.0, 2e-3, -1e-3, 5e-4])
    wrong = rng.normal(0.0, shared, 6)
    wrong[:3] += wrong[3:].mean() - wrong[:3].mean()
    indication = design @ truth + wrong[face] + rng.normal(0.0, 2e-5, 42)
    return design, truth, indication, face, soak


def test_a_face_that_is_set_up_wrong_is_an_effect_and_is_not_dropped():
    """All rows of a face go one way: they stay in the fit, are reported with their size, and no
    suspect names them.
    """
    dropped = 0
    for seed in range(10):
        design, truth, indication, face, soak = six_faces(seed)
        free = robust.linear(design, indication)
        held = robust.linear(design, indication, groups=(soak, face))
        dropped += any(np.max(free.row_weights[face == k]) < 0.1 for k in range(6))
        assert all(np.mean(held.row_weights[face == k]) > 0.5 for k in range(6))
        assert np.max(np.abs(held.coefficients - truth)) < 5e-4
        assert len(held.suspects) <= 1
        assert {one.group for one in held.structured} <= {1}
        plain = fit.linear(design, indication)
        assert np.max(np.abs(held.coefficients - plain.coefficients)) < 1e-4
    assert dropped >= 3


def test_a_wild_row_of_a_face_with_an_effect_is_still_left_out():
    """A row is held against the other rows of its face."""
    design, _, indication, face, soak = six_faces(1)
    clean = robust.linear(design, indication, groups=(face, soak))
    spoilt = indication.copy()
    row = int(clean.structured[0].rows[3])
    spoilt[row] += 0.3
    found = robust.linear(design, spoilt, groups=(face, soak))
    assert found.suspects[0] == row
    assert found.row_weights[row] == 0.0
    assert np.max(np.abs(found.coefficients - clean.coefficients)) < 5e-5


def test_groups_change_nothing_where_no_level_is_removed():
    """Without an effect, weights and coefficients are the same with and without groups."""
    design, _, indication = problem(14)
    indication[[5, 77]] += 50.0
    labels = np.arange(150) % 15
    free, held = (
        robust.linear(design, indication),
        robust.linear(design, indication, groups=[labels]),
    )
    np.testing.assert_array_equal(free.row_weights, held.row_weights)
    np.testing.assert_array_equal(free.coefficients, held.coefficients)
    assert held.structured == ()


def test_three_wild_rows_in_ten_move_nothing():
    """Where wild rows agree with one another, and are more than any one component leaves out, the
    S-estimate finds the others.
    """
    design, _, indication = problem(2, rows=100, columns=4)
    spoilt = indication.copy()
    spoilt[:30] = 12.0 + 3.0 * design[:30, 1] + 0.3 * np.random.default_rng(1).normal(size=30)
    clean = robust.linear(design[30:], indication[30:])
    assert moved(design[30:], clean, robust.linear(design, spoilt)) < 1.5

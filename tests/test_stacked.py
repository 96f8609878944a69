"""Small fits of many units in stacks: the numbers of a loop, and every unit that cannot be fitted
named.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import k_factor
from calibkit.numeric import attitude, stacked
from calibkit.numeric.least_squares import fit


def fleet(units=40, rows=60, seed=0):
    """Temperatures and biases of a fleet of gyros, each with its own range, curve and noise."""
    rng = np.random.default_rng(seed)
    t = rng.uniform(-40.0, 0.0, (units, 1)) + rng.uniform(60.0, 120.0, (units, 1)) * rng.uniform(
        size=(units, rows)
    )
    curve = rng.normal(size=(units, 4)) * [1.0, 1e-2, 1e-4, 1e-6]
    y = np.einsum("uk,ukn->un", curve, np.stack([t**k for k in range(4)], axis=1))
    return t, y + rng.normal(0.0, 0.05, (units, rows))


@pytest.mark.parametrize("rows", [7, 60, 700])
@pytest.mark.parametrize("weighted", [False, True])
def test_a_stack_of_polynomials_is_a_loop_over_them(rows, weighted):
    """Mapped and raw coefficients, covariances, rms, condition and dof of 40 units equal
    `fit.polynomial` of each.
    """
    t, y = fleet(rows=rows)
    w = np.random.default_rng(1).uniform(0.1, 10.0, t.shape) if weighted else None
    found, raw, covariance = stacked.polynomial(t, y, 3, weights=w)
    assert found.faults == ()
    for k in range(len(t)):
        one, one_raw, one_covariance = fit.polynomial(
            t[k], y[k], 3, weights=None if w is None else w[k]
        )
        u = one.standard_uncertainty
        np.testing.assert_allclose(found.coefficients[k], one.coefficients, atol=1e-12, rtol=1e-12)
        np.testing.assert_allclose(
            raw[k], one_raw, rtol=1e-12, atol=1e-11 * np.min(np.abs(one_raw)) + 1e-15
        )
        np.testing.assert_allclose(np.sqrt(np.diag(found.covariance[k])), u, rtol=1e-9)
        np.testing.assert_allclose(np.diag(covariance[k]), np.diag(one_covariance), rtol=1e-9)
        assert found.residual_rms[k] == pytest.approx(one.residual_rms, rel=1e-10)
        X = np.vander((t[k] - fit.mapping(t[k])[0]) / fit.mapping(t[k])[1], 4) * (
            1.0 if w is None else np.sqrt(w[k, :, None])
        )
        assert found.condition[k] == pytest.approx(
            np.linalg.cond(X / np.linalg.norm(X, axis=0)), rel=1e-9
        )
        assert found.dof[k] == one.dof


def test_k_of_a_fleet_of_triads_is_that_of_each():
    """Ten coefficients of one axis over 24 dwells of 30 triads equal `fit.linear`, the dwells
    shared, the readings not.
    """
    rng = np.random.default_rng(2)
    angle = np.array([[90, 0], [90, 90], [90, 180], [90, -90], [0, 0], [180, 0]], dtype=float)
    reference = np.tile(attitude.gravity_vector(*angle.T), (4, 1))
    u = np.repeat([-1.0, -0.3, 0.4, 1.0], 6)
    indications = reference * (1.0 + 0.01 * rng.normal(size=(30, 1, 3))) + rng.normal(
        0.0, 1e-5, (30, 24, 3)
    )
    design = np.array([k_factor.columns(one, u, 0) for one in indications])
    target = np.broadcast_to(reference[:, 0], (30, 24))
    found = stacked.linear(design, target)
    for k in range(30):
        one = fit.linear(design[k], target[k])
        np.testing.assert_allclose(found.coefficients[k], one.coefficients, atol=1e-13)
        np.testing.assert_allclose(
            np.sqrt(np.diag(found.covariance[k])), one.standard_uncertainty, rtol=1e-8
        )


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), group=st.integers(1, 2000))
def test_groups_leave_no_trace(seed, group):
    """How many units are worked on at once changes no number beyond rounding."""
    t, y = fleet(units=9, rows=20, seed=seed)
    expected = stacked.polynomial(t, y, 2)[1]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stacked, "GROUP_VALUES", group)
        np.testing.assert_allclose(stacked.polynomial(t, y, 2)[1], expected, rtol=1e-10)


def test_units_that_cannot_be_fitted_are_named_and_the_others_fitted():
    """A chamber that stood still, a NaN, rows that a unit does not have: reasons, NaN numbers,
    neighbours untouched.
    """
    t, y = fleet()
    whole = stacked.polynomial(t, y, 2)[1]
    t, y, w = t.copy(), y.copy(), np.ones(t.shape)
    t[3], y[7, 11], w[12, 2:] = 25.0, np.nan, 0.0
    found, raw, _ = stacked.polynomial(t, y, 2, weights=w)
    reasons = dict(found.faults)
    assert sorted(reasons) == [3, 7, 12]
    assert "cannot determine p1, p2" in reasons[3]
    assert "not finite" in reasons[7]
    assert "2 rows for 3 coefficients" in reasons[12]
    for k in range(len(t)):
        if k in reasons:
            assert np.isnan(raw[k]).all()
            assert np.isnan([found.residual_rms[k], found.condition[k]]).all()
        else:
            np.testing.assert_allclose(raw[k], whole[k], rtol=1e-9)


def test_units_of_different_length_are_those_of_their_own_rows():
    """A row of weight 0 is a row that the unit does not have: same numbers, same degrees of
    freedom.
    """
    t, y = fleet(units=5)
    w = np.ones(t.shape)
    for k in range(5):
        w[k, 10 + 8 * k :] = 0.0
    found = stacked.linear(np.stack([np.vander(one / 100.0, 3) for one in t]), y, weights=w)
    for k in range(5):
        own = slice(0, 10 + 8 * k)
        one = fit.linear(np.vander(t[k, own] / 100.0, 3), y[k, own])
        np.testing.assert_allclose(found.coefficients[k], one.coefficients, rtol=1e-11)
        assert (found.dof[k], found.residual_rms[k]) == (
            one.dof,
            pytest.approx(one.residual_rms, rel=1e-11),
        )


def test_a_shared_abscissa_is_given_once():
    """One set of temperatures for all units is the same as its copies."""
    t, y = fleet()
    copies = stacked.polynomial(np.tile(t[0], (len(y), 1)), y, 2)[1]
    assert (stacked.polynomial(t[0], y, 2)[1] == copies).all()


def test_an_ill_conditioned_unit_is_fitted_alone():
    """Powers of 20 … 40 to the fifth lose their digits in moments; the unit has those of
    `fit.linear` to the last bit.
    """
    x = np.linspace(20.0, 40.0, 50)
    X = np.stack([np.vander(x, 6), np.vander((x - 30.0) / 10.0, 6)])
    y = np.random.default_rng(4).normal(size=(2, 50))
    found = stacked.linear(X, y)
    assert (found.coefficients[0] == fit.linear(X[0], y[0]).coefficients).all()
    assert found.condition[0] > 1e4 > found.condition[1]


def test_nearly_parallel_columns_keep_their_digits():
    """At a condition number of 3000 moments alone have nine digits; the units have eleven of
    `fit.linear`.
    """
    rng = np.random.default_rng(5)
    X = rng.normal(size=(4, 80, 2))
    X[:, :, 1] = X[:, :, 0] + 1e-3 * X[:, :, 1]
    y = 1e3 + rng.normal(size=(4, 80))
    found = stacked.linear(X, y)
    for k in range(4):
        assert found.coefficients[k] == pytest.approx(
            fit.linear(X[k], y[k]).coefficients, rel=1e-11
        )


def test_shapes_that_do_not_belong_together_are_refused():
    """A design of other rows than the indications is an error of the call, not of a unit."""
    with pytest.raises(FitError, match=r"designs of shape \(2, 5, 3\) do not belong"):
        stacked.linear(np.zeros((2, 5, 3)), np.zeros((2, 6)))
    with pytest.raises(FitError, match="do not belong"):
        stacked.polynomial(np.zeros((3, 6)), np.zeros((2, 6)), 1)

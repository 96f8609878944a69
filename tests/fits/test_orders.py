"""Average over the orders of a polynomial: weights by AIC, one polynomial, one covariance."""

import numpy as np
import pytest
from scipy import optimize

from calibkit.fit import likelihood, orders
from calibkit.fit.shared import Shared
from calibkit.fit.solve import sensitivities, solve


def polynomials(x, y, highest, shared=(), **options):
    """Fits of all orders to the same rows, in the parameters of the highest."""
    powers = np.vander(x, highest + 1, increasing=True)
    free = np.tri(highest + 1, dtype=bool)
    start = np.zeros(highest + 1)
    return [solve(lambda p: powers @ p - y, start, shared, free=mask, **options) for mask in free]


def test_of_white_noise_the_average_is_that_of_the_formula():
    """Weights by n ln(RSS/n) + 2 (k + 2), coefficients and covariance of plain least squares."""
    rng = np.random.default_rng(7)
    x = np.linspace(-1.0, 1.0, 12)
    y = 1.0 + 0.8 * x + rng.standard_normal(12)
    fit = orders.average(polynomials(x, y, 3))
    aic, b, V, dof = np.zeros(4), np.zeros((4, 4)), np.zeros((4, 4, 4)), 11.0 - np.arange(4)
    for k in range(4):
        X = np.vander(x, k + 1, increasing=True)
        b[k, : k + 1], (square,), *_ = np.linalg.lstsq(X, y, rcond=None)
        aic[k] = 12.0 * np.log(square / 12.0) + 2.0 * (k + 2)
        V[k, : k + 1, : k + 1] = square / dof[k] * np.linalg.inv(X.T @ X)
    w = np.exp(-0.5 * (aic - aic.min()))
    w /= w.sum()
    mean = w @ b
    covariance = np.tensordot(w, V + (b - mean)[:, :, None] * (b - mean)[:, None, :], 1)
    assert fit.weights == pytest.approx(w, rel=1e-6)
    assert fit.parameters == pytest.approx(mean, rel=1e-6, abs=1e-9)
    assert fit.covariance == pytest.approx(covariance, rel=1e-5, abs=1e-9)
    assert fit.residual == pytest.approx(np.vander(x, 4, increasing=True) @ mean - y, abs=1e-6)
    end = fit.of(np.sum)
    assert end.u**2 == pytest.approx(covariance.sum(), rel=1e-5)
    assert end.dof == pytest.approx(w @ dof, rel=1e-6)


def test_likelihoods_of_orders_are_not_restricted_and_have_sizes_of_their_own():
    """-2 log L is the least that the dense formula ln|V| + rᵀ V⁻¹ r reaches over both variances."""
    rng = np.random.default_rng(2)
    run = np.repeat(np.arange(8), 4)
    x = np.linspace(-1.0, 1.0, 8)[run]
    y = x + 2.0 * rng.standard_normal(8)[run] + rng.standard_normal(32)
    error = Shared(group="run", effect="zero", level=run, loading=np.ones((32, 1)), unit="V")
    Z = np.equal.outer(run, np.arange(8)) * 1.0
    for order, fit in enumerate(polynomials(x, y, 2, [error])):
        X = np.vander(x, order + 1, increasing=True)

        def deviance(logs, X=X):
            V = np.exp(logs[0]) * np.eye(32) + np.exp(logs[1]) * Z @ Z.T
            W = np.linalg.inv(V)
            r = y - X @ np.linalg.solve(X.T @ W @ X, X.T @ W @ y)
            return np.linalg.slogdet(V)[1] + r @ W @ r

        least = optimize.minimize(deviance, np.zeros(2), method="Nelder-Mead", tol=1e-10).fun
        assert likelihood.unrestricted(fit.solution) == pytest.approx(least, abs=1e-6)


def test_an_average_moves_with_its_rows_as_its_members_refitted_do():
    """Abscissa and values of all rows off: coefficients of each order refitted, sizes held,
    averaged by the weights of before, to 1e-4 of the change.
    """
    rng = np.random.default_rng(6)
    x, run = np.linspace(-1.0, 1.0, 20), np.arange(20) % 5
    y = x + rng.standard_normal(20) + rng.standard_normal(5)[run]
    error = Shared(group="run", effect="zero", level=run, loading=np.ones((20, 1)), unit="V")
    fit = orders.average(polynomials(x, y, 2, [error]))
    moved_x, moved_y = x + 1e-6 * np.cos(3.0 * x), y + 1e-6 * x**2

    def residual(x, y):
        return lambda p: np.vander(x, 3, increasing=True) @ p - y

    refits = []
    for order, member in enumerate(fit.members):
        X = np.vander(moved_x, order + 1, increasing=True)
        V = np.diag(member.noise**2) + member.shared[0].value ** 2 * np.equal.outer(run, run)
        W = np.linalg.inv(V)
        b = np.linalg.solve(X.T @ W @ X, X.T @ W @ moved_y)
        refits.append(np.append(b, np.zeros(2 - order)))
    (change,) = sensitivities(residual(x, y), [residual(moved_x, moved_y)], fit)
    assert change == pytest.approx(fit.weights @ refits - fit.parameters, rel=1e-4, abs=1e-12)


def test_fits_with_errors_of_unequal_rows_have_no_average():
    """An outlier that one order leaves out makes likelihoods incomparable."""
    x = np.linspace(0.0, 1.0, 9)
    a, b = polynomials(x, np.cos(9.0 * x), 1)
    other = solve(lambda p: p[0] - x[:8], np.zeros(1))
    with pytest.raises(ValueError, match="same rows"):
        orders.average([a, other])
    assert orders.average([a, b]).members == (a, b)


def test_a_published_form_of_an_average_is_the_average_of_the_form():
    """P y has the covariance of the members' mean variances, and their mean degrees of freedom."""
    x = np.linspace(-1.0, 1.0, 10)
    y = x + np.random.default_rng(3).standard_normal(10)
    fit = orders.average(polynomials(x, y, 1))
    P = np.full((1, 10), 0.1)
    mean = fit.linear(P, y).of(lambda p: p)
    assert mean.value == pytest.approx(y.mean())
    assert mean.u**2 == pytest.approx(fit.noise[0] ** 2 / 10.0)
    assert mean.dof == pytest.approx(fit.weights @ [9.0, 8.0], rel=1e-6)


def test_orders_leave_two_runs_over_and_need_as_many_levels():
    """Six runs at four temperatures carry a cubic, four a slope, two at one a constant."""
    assert list(orders.orders(6, 4, 3)) == [0, 1, 2, 3]
    assert list(orders.orders(4, 4, 3)) == [0, 1]
    assert list(orders.orders(2, 1, 3)) == [0]

"""The linear core: digits, rank, covariance."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import lfilter
from scipy.stats import t as student

from calibkit.errors import FitError
from calibkit.numeric.least_squares import fit, hac, polynomial
from naive import corrected_newey_west


def test_a_fit_equals_the_textbook_formula():
    """Coefficients and covariance equal (XᵀWX)⁻¹XᵀWy and s²(XᵀWX)⁻¹ to 1e-10 relative on a
    well-conditioned problem.
    """
    rng = np.random.default_rng(2)
    X, w = rng.normal(size=(50, 3)), rng.uniform(0.5, 2.0, 50)
    y = X @ [1.0, -2.0, 3.0] + rng.normal(size=50)
    found = fit.linear(X, y, weights=w)
    inverse = np.linalg.inv(X.T @ (w[:, None] * X))
    beta = inverse @ X.T @ (w * y)
    s2 = np.sum(w * (y - X @ beta) ** 2) / 47
    assert found.coefficients == pytest.approx(beta, rel=1e-10)
    assert found.covariance == pytest.approx(s2 * inverse, rel=1e-10)
    assert found.dof == 47


@settings(max_examples=40, deadline=None)
@given(exponents=st.lists(st.integers(-40, 40), min_size=4, max_size=4))
def test_units_do_not_change_a_fit(exponents):
    """Scaling a column by a power of two scales its coefficient and its uncertainty by the inverse,
    exactly.
    """
    rng = np.random.default_rng(3)
    X, y = rng.normal(size=(30, 4)), rng.normal(size=30)
    factors = 2.0 ** np.array(exponents)
    plain, scaled = fit.linear(X, y), fit.linear(X * factors, y)
    assert (scaled.coefficients * factors == plain.coefficients).all()
    assert scaled.standard_uncertainty * factors == pytest.approx(
        plain.standard_uncertainty, rel=1e-12
    )


def test_exact_data_of_an_ill_conditioned_polynomial_give_exact_coefficients():
    """Wampler's first problem (order 5 over 0 … 20, integers) comes back to 1e-13, numpy's lstsq
    only to 1e-10.
    """
    x = np.arange(21.0)
    X = np.vander(x, 6, increasing=True)
    y = X.sum(axis=1)
    assert fit.linear(X, y).coefficients == pytest.approx(np.ones(6), rel=1e-13)
    assert np.abs(np.linalg.lstsq(X, y, rcond=None)[0] - 1.0).max() > 1e-10


def test_a_small_term_is_not_cut_off():
    """Where lstsq's default cut silently drops a term (20 … 40 to the 6th power) every term stays
    within 1e-4.
    """
    x = np.linspace(20.0, 40.0, 200)
    truth = (-0.5) ** np.arange(7)
    X = np.vander(x, 7, increasing=True)
    y = np.asarray(X.astype(np.longdouble) @ truth.astype(np.longdouble), dtype=float)
    assert fit.linear(X, y).coefficients == pytest.approx(truth, rel=1e-4)
    assert np.abs(np.linalg.lstsq(X, y, rcond=None)[0] / truth - 1.0).max() > 0.1


def test_what_the_data_cannot_determine_is_named():
    """Two columns that are the same to the last bit are named, the third is not."""
    x = np.arange(10.0)
    X = np.column_stack([x, np.ones(10), 2.0 * x])
    with pytest.raises(FitError, match=r"cannot determine slope, twin: rank 2 of 3"):
        fit.linear(X, x, names=("slope", "offset", "twin"))
    assert fit.undetermined(X, ("slope", "offset", "twin")) == ["slope", "twin"]
    assert fit.rank(X) == 2


def test_a_column_of_zeros_is_undetermined():
    """A term that is zero everywhere is named rather than given any value."""
    with pytest.raises(FitError, match="cannot determine nothing"):
        fit.linear(
            np.column_stack([np.arange(5.0), np.zeros(5)]),
            np.arange(5.0),
            names=("slope", "nothing"),
        )


@pytest.mark.parametrize(
    ("design", "target", "message"),
    [
        (np.ones((1, 2)), np.ones(1), "1 rows for 2 coefficients"),
        (np.ones((3, 1)), np.array([1.0, np.nan, 2.0]), "not finite"),
    ],
)
def test_a_fit_that_makes_no_sense_is_refused(design, target, message):
    """Too few rows and values that are not finite are refused."""
    with pytest.raises(FitError, match=message):
        fit.linear(design, target)


def test_raw_powers_convert_a_mapped_polynomial():
    """The polynomial in u = (x − middle)/half and the one in x agree to 1e-12 of their range."""
    u_coefficients = np.array([1.0, -2.0, 0.5, 0.25])
    raw = np.asarray(polynomial.to_raw_powers(52.5, 72.5, 3) @ u_coefficients, dtype=float)
    x = np.linspace(-20.0, 125.0, 50)
    expected = np.polynomial.polynomial.polyval((x - 52.5) / 72.5, u_coefficients)
    assert np.polynomial.polynomial.polyval(x, raw) == pytest.approx(expected, abs=1e-12)


def test_a_polynomial_fit_equals_numpy():
    """Order 3 over −20 … 125 °C equals numpy's domain-mapped Polynomial.fit to 1e-9 relative."""
    rng = np.random.default_rng(4)
    x = rng.uniform(-20.0, 125.0, 400)
    y = 1.0 + 1e-3 * x - 1e-5 * x**2 + 1e-8 * x**3 + rng.normal(0.0, 1e-3, 400)
    _, raw, covariance = polynomial.fit_polynomial(x, y, 3)
    assert raw == pytest.approx(np.polynomial.Polynomial.fit(x, y, 3).convert().coef, rel=1e-9)
    assert (np.diag(covariance) > 0.0).all()


def test_a_polynomial_needs_an_abscissa_that_varies():
    """A constant abscissa is refused."""
    with pytest.raises(FitError, match="constant at 5"):
        polynomial.fit_polynomial(np.full(9, 5.0), np.arange(9.0), 1)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_hac_equals_its_definition(rho):
    """Covariance and degrees of freedom in one pass are those of whole matrices: of the whitening,
    of the residuals that a fit leaves of white innovations, and of the kernel.
    """
    rng = np.random.default_rng(5)
    noise = rng.normal(size=90)
    for k in range(1, 90):
        noise[k] += rho * noise[k - 1]
    cold = np.exp(-np.arange(90.0) / 12.0)
    X = np.column_stack([np.ones(90), cold, cold**2])
    residuals = fit.linear(X, noise).residuals
    combinations = np.array([[1.0, 0.0, 0.0], [0.3, -2.0, 1.0]])
    found = hac.covariance(lambda part: X[part], residuals, combinations=combinations)
    covariance, dof, order = corrected_newey_west(X, residuals, combinations)
    assert order == (1 if rho else 0)
    assert found.covariance == pytest.approx(covariance, rel=1e-8)
    assert found.effective_dof == pytest.approx(dof, rel=1e-8)


def test_hac_uncertainty_covers_where_ordinary_least_squares_does_not():
    """With AR(1) residuals (ρ = 0.9) the 95 % interval of a mean covers over 88 %; the ordinary one
    under 50 %.
    """
    rng = np.random.default_rng(6)
    X = np.ones((500, 1))
    hits = {"hac": 0, "ols": 0}
    for _ in range(300):
        noise = rng.normal(size=600)
        for k in range(1, 600):
            noise[k] += 0.9 * noise[k - 1]
        found = fit.linear(X, noise[100:])
        robust = np.sqrt(hac.covariance(lambda part: X[part], found.residuals).covariance[0, 0])
        hits["ols"] += abs(found.coefficients[0]) < 1.96 * found.standard_uncertainty[0]
        hits["hac"] += abs(found.coefficients[0]) < 1.96 * robust
    assert hits["ols"] < 150
    assert hits["hac"] > 264


def test_hac_of_no_residuals_is_zero():
    """Data without noise have a covariance of zero, not NaN."""
    found = hac.covariance(lambda part: np.ones((20, 1))[part], np.zeros(20))
    assert (found.covariance == 0.0).all()


def warm_up(rows, order):
    """Design over the temperature of a warm-up, mapped to [−1, 1]: a tenth of the rows are cold."""
    temperature = 50.0 - 35.0 * np.exp(-np.arange(rows) / (0.1 * rows))
    design, _ = polynomial.mapped_powers(temperature, order)
    return design


@pytest.mark.parametrize(
    ("rows", "order", "rho"),
    [
        (300, 1, 0.0),
        (300, 1, 0.5),
        (300, 3, 0.0),
        (600, 1, 0.0),
        (1000, 1, 0.0),
        (1000, 3, 0.5),
    ],
)
def test_hac_intervals_of_a_warm_up_cover(rows, order, rho):
    """95 % intervals by Student's t cover 93 to 97 %, white noise or not, though the few cold rows
    have leverage; a case fails where its binomial 99 % interval lies outside.
    """
    rng = np.random.default_rng(rows + order)
    design = warm_up(rows, order)
    X, hits, runs = design(slice(0, rows)), 0, 400
    for _ in range(runs):
        noise = lfilter([1.0], [1.0, -rho], rng.normal(size=rows + 100))[100:]
        found = fit.linear(X, noise)
        consistent = hac.covariance(design, found.residuals)
        half = student.ppf(0.975, consistent.effective_dof) * np.sqrt(
            np.diag(consistent.covariance)
        )
        hits += abs(found.coefficients[1]) < half[1]
    spread = 2.6 * np.sqrt(0.05 * 0.95 / runs)
    assert 0.93 - spread < hits / runs < 0.97 + spread


def test_hac_covers_where_the_first_rows_are_noisier():
    """Noise that is four times as large in the cold rows: cover 90 % and more, ordinary least
    squares under two thirds.
    """
    rng = np.random.default_rng(9)
    design = warm_up(600, 1)
    X, size = design(slice(0, 600)), 1.0 + 3.0 * np.exp(-np.arange(600) / 60.0)
    hits = {"hac": 0, "ols": 0}
    for _ in range(300):
        found = fit.linear(X, size * rng.normal(size=600))
        consistent = hac.covariance(design, found.residuals)
        half = student.ppf(0.975, consistent.effective_dof[1]) * np.sqrt(
            consistent.covariance[1, 1]
        )
        hits["hac"] += abs(found.coefficients[1]) < half
        hits["ols"] += abs(found.coefficients[1]) < 1.96 * found.standard_uncertainty[1]
    assert hits["hac"] > 270
    assert hits["ols"] < 200

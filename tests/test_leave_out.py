"""Rows that a linear fit leaves out: their errors are those of fits without them, and a model with
more coefficients must be clearly better there.
"""

import numpy as np
import pytest

from calibkit.numeric.least_squares import fit, leave_out, polynomial


@pytest.fixture
def campaign():
    """Cubic with noise at seven temperatures, three values each."""
    rng = np.random.default_rng(7)
    temperature = np.repeat(np.linspace(-40.0, 80.0, 7), 3) + rng.normal(0.0, 0.1, 21)
    mapped = (temperature - 20.0) / 60.0
    values = 1.0 + 0.3 * mapped - 0.2 * mapped**3 + rng.normal(0.0, 1e-3, 21)
    return temperature, values


@pytest.mark.parametrize("grouped", [False, True])
def test_errors_at_left_out_rows_are_those_of_fits_without_them(campaign, grouped):
    """The closed form is the loop that fits again, row by row and group by group."""
    temperature, values = campaign
    groups = np.round(temperature / 20.0) if grouped else np.arange(21.0)
    design = np.vander(temperature / 60.0, 3, increasing=True)
    residuals = fit.linear(design, values).residuals
    found = leave_out.left_out_errors(design, residuals, groups=groups)
    for label in np.unique(groups):
        out = groups == label
        other = fit.linear(design[~out], values[~out])
        np.testing.assert_allclose(
            found[out], values[out] - design[out] @ other.coefficients, rtol=1e-8, atol=1e-12
        )


def test_a_row_that_alone_determines_a_coefficient_has_an_infinite_error():
    """Nothing tells the value there without it."""
    design = np.column_stack([np.ones(6), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    residuals = np.array([1.0, -1.0, 1.0, -1.0, 0.0, 0.0])
    found = leave_out.left_out_errors(design, residuals, groups=np.arange(6))
    assert np.isfinite(found[:5]).all()
    assert np.isinf(found[5])


def test_a_group_of_one_row_is_judged_by_its_leverage_however_it_is_rounded():
    """Its matrix of one number has the condition number 1 whatever is left of it."""
    design = np.column_stack([np.ones(6), np.eye(6)[5]])
    for turn in np.linspace(0.1, 1.5, 50):
        turned = design @ [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        found = leave_out.left_out_errors(turned, np.zeros(6), groups=np.arange(6))
        assert np.isinf(found).tolist() == [False] * 5 + [True]


def test_a_model_with_more_coefficients_must_be_a_tenth_better_than_the_best_so_far():
    """On the margin it is not chosen, below it is; a chain of small gains adds up."""
    assert leave_out.choose_simplest([1.0, 0.9]) == 0
    assert leave_out.choose_simplest([1.0, np.nextafter(0.9, 0.0)]) == 1
    assert leave_out.choose_simplest([1.0, 0.95, 0.85]) == 2
    assert leave_out.choose_simplest([1.0, 0.8, 0.75]) == 1
    assert leave_out.choose_simplest([1.0, 0.95], margin=0.96) == 1
    assert leave_out.choose_simplest([]) == 0


def test_a_polynomial_of_temperature_is_clamped_to_its_range():
    """Beyond the fitted range value and uncertainty are those at its end."""
    curve = polynomial.TemperaturePolynomial(
        np.array([1.0, 0.5]), np.diag([0.01, 0.0004]), 3, 0.1, (-10.0, 30.0)
    )
    value, u = curve.at([-50.0, 30.0, 90.0])
    np.testing.assert_allclose(value, [-4.0, 16.0, 16.0])
    np.testing.assert_allclose(u, np.sqrt([0.05, 0.37, 0.37]))

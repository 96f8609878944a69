"""Model forms of the thermal drift: written and read back, evaluated, propagated, and against the
equations along a log.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibkit.instruments.bias import forms
from calibkit.instruments.bias.numeric import bank
from calibkit.instruments.bias.numeric.bank import Bank
from calibkit.numeric.thermal.terms import Valid
from fits.drift_fits import RATES, bank_model, on_levels
from fits.naive import sensitivities


@pytest.mark.parametrize(
    "model",
    [on_levels("level"), on_levels(), on_levels(lags=(210.0,))],
    ids=["level", "two", "one"],
)
def test_a_model_on_levels_is_read_back_as_it_was_written(model):
    """Terms, coefficients, lags, covariance, ranges and noise, whatever the number of lags."""
    written = forms.write_thermal(model, 10.0)
    found = forms.read_thermal(written)
    assert written.value("interval") == 10.0
    for name in (
        "form",
        "lags",
        "window_s",
        "valid",
        "dof",
        "constant_dof",
        "noise",
        "model_error",
    ):
        assert getattr(found, name) == getattr(model, name)
    assert found.terms == model.terms
    assert np.array_equal(found.coefficients, model.coefficients)
    assert np.array_equal(found.covariance, model.covariance)


def test_polynomials_over_rates_are_read_back_as_they_were_written():
    """Coefficients named c<j><m> with the unit of a_j for each power of the rate."""
    written = forms.write_rates(RATES, 10.0)
    found = forms.read_rates(written)
    assert [c.name for c in written.coefficients] == ["c00", "c01", "c10", "c11", "c20", "c21"]
    assert written.coefficients[3].unit == "deg/h/K/(degC/min)"
    assert np.array_equal(found.c, RATES.c)
    assert np.array_equal(found.covariance, RATES.covariance)
    assert (found.side, found.rates, found.slowest) == ("heating", (1.0, 10.0), 1.0)


def test_the_increment_over_rates_is_that_of_the_recursion():
    """Σ c_jm G^j r^m at random gradients and rates is a0 + a1 G + a2 G² with a_j at the rate."""
    rng = np.random.default_rng(2)
    G, r = rng.uniform(-20.0, -1.0, 30), rng.uniform(1.0, 10.0, 30)
    found = forms.OVER_RATES.evaluate(
        forms.write_rates(RATES, 10.0), {forms.GRADIENT: G, forms.RATE: r}
    )
    a = RATES.evaluate(r)
    assert found == pytest.approx(a[:, 0] + a[:, 1] * G + a[:, 2] * G**2, rel=1e-13)


@pytest.mark.parametrize("lags", [(210.0, 120.0), (210.0,)])
@pytest.mark.parametrize("rate", [5.0, -2.0])
def test_a_lagged_model_at_a_held_rate_is_what_a_ramp_that_lasts_settles_on(lags, rate):
    """After 20 lags of a ramp the drift along the log is the form's, less that at rest at the
    reference, to 1e-6 °/h.
    """
    model = replace(on_levels(lags=lags), valid=Valid(*[(-1e4, 1e4)] * 4))
    time = np.arange(0.0, 20.0 * 210.0, 10.0)
    case = rate / 60.0 * (time - time[-1]) + 20.0
    along = bank.evaluate(model, time, case, case, 25.0).drift[-1]
    written = forms.write_thermal(model, 10.0)
    held = {forms.CASE: case[-1:], forms.RATE: np.array([rate])}
    rest = {forms.CASE: np.array([25.0])}
    settled = forms.LAGGED.evaluate(written, held) - forms.LAGGED.evaluate(written, rest)
    assert along == pytest.approx(settled[0], abs=1e-6)  # °/h


def test_a_bank_is_read_back_as_it_was_written():
    """Lags, table, play operators and warm-up are numbered parameters; all else as it was."""
    model = bank_model()
    written = forms.write_thermal(model, 10.0)
    assert [c.name for c in written.coefficients] == [
        *("b0", "a1", "a2", "a3", "b1", "b2", "b3", "c1", "c2", "c3", "s1", "s2", "s3", "s4"),
        *("g1", "g2", "g3", "g4", "h1", "h2", "w1", "tau_fast", "tau_static", "share_static"),
    ]
    found = forms.read_thermal(written)
    for name in ("bank", "static_lag", "valid", "turn_on_sd", "noise", "model_error_dof"):
        assert getattr(found, name) == getattr(model, name)
    assert np.array_equal(found.coefficients, model.coefficients)
    assert np.array_equal(found.covariance, model.covariance)


def test_a_bank_at_a_held_rate_is_what_a_ramp_that_lasts_settles_on():
    """After fifteen of the longest lags of a ramp the drift along the log is the form's, less that
    at rest at the reference, to 1e-4 °/h.
    """
    model = replace(bank_model(), valid=Valid(*[(-1e4, 1e4)] * 4))
    written = forms.write_thermal(model, 10.0)
    for rate in (5.0, -2.0):
        time = np.arange(0.0, 15.0 * 3000.0, 10.0)
        case = rate / 60.0 * (time - time[-1]) + 20.0
        along = bank.evaluate(model, time, case, case, 25.0).drift[-1]
        held = {forms.CASE: case[-1:], forms.RATE: np.array([rate])}
        settled = forms.BANK.evaluate(written, held) - bank.at_rest(model, 25.0)[0]
        assert along == pytest.approx(settled[0], abs=1e-4)  # °/h


def test_the_sensitivities_of_a_bank_along_a_log_are_those_of_differences():
    """By each coefficient and by the static lag, in a log that heats, cools and leaves the fitted
    rates.
    """
    model = bank_model(Bank((30.0, 300.0, 3000.0), (), (), (300.0,)))
    time = np.arange(0.0, 6000.0, 10.0)
    case = np.interp(time, [600.0, 900.0, 2400.0, 6000.0], [-30.0, 40.0, 20.0, 55.0])
    found = bank.evaluate(model, time, case, case)
    assert found.rate_clamped.any()
    whole = np.concatenate([model.coefficients, model.static_lag])

    def drift(values):
        moved = replace(model, coefficients=values[:-3], static_lag=tuple(values[-3:].tolist()))
        return bank.evaluate(moved, time, case, case).drift

    expected = sensitivities(drift, whole, 1e-5 * np.maximum(np.abs(whole), 1e-2))
    assert found.sensitivities == pytest.approx(expected, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize(
    "model",
    [on_levels("level"), on_levels(), on_levels(lags=(210.0,)), bank_model()],
    ids=["level", "two", "one", "bank"],
)
def test_derivatives_of_a_model_on_levels_are_those_of_differences(model):
    """By every term and lag, and by the case temperature, at rest and on ramps both ways."""
    written = forms.write_thermal(model, 10.0)
    form = forms.ON_LEVELS[written.form]
    at = {forms.CASE: np.array([-20.0, 30.0, 30.0]), forms.RATE: np.array([0.0, 8.0, -8.0])}
    best = np.array([c.value for c in written.coefficients])

    def evaluated(values):
        changed = zip(written.coefficients, values.tolist(), strict=True)
        moved = tuple(replace(c, value=value) for c, value in changed)
        return form.evaluate(replace(written, coefficients=moved), at)

    expected = sensitivities(evaluated, best, 1e-4 * np.maximum(np.abs(best), 1e-3))
    assert form.gradient(written, at) == pytest.approx(expected, rel=1e-6, abs=1e-9)
    warmer, colder = (
        form.evaluate(written, {**at, forms.CASE: at[forms.CASE] + by}) for by in (1e-3, -1e-3)
    )
    slope = (warmer - colder) / 2e-3
    assert forms.slope_over_case(written, at) == pytest.approx(slope, rel=1e-6)

"""The lagged model: coil temperatures by exact lags, time constants by variable projection,
evaluation at run time.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from calibkit.errors import FitError
from calibkit.instruments.bias.numeric import bank
from calibkit.numeric.thermal import coil, fits, left_out, pooled_fit
from calibkit.numeric.thermal.evaluate import _drivers
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.numeric.thermal.terms import TERMS
from fits.drift_fits import fit_lagged, solve_lagged

LAGS = (210.0, 120.0)
TRUE = np.array([8.0, 9e-3, -3e-4, 2e-6, 0.12, -0.03, 4e-4, 1.3e-4, 0.0])
"""A drift of about 1 °/h over −40 … 60 °C."""


def case_of(rate, seconds, step=10.0, lag=250.0):
    """Return time [s] and case temperature [°C] of a ramp between soaks, behind the air by a
    lag.
    """
    time = np.arange(0.0, seconds, step)
    ends = (-40.0, 60.0) if rate > 0 else (60.0, -40.0)
    air = np.clip(
        ends[0] + rate / 60.0 * np.maximum(time - 600.0, 0.0), -40.0, 60.0
    ) + 0.3 * np.sin(time / 400.0)
    case = np.empty_like(air)
    case[0] = air[0]
    for k in range(1, time.size):
        case[k] = air[k] + np.exp(-step / lag) * (case[k - 1] - air[k])
    return time, case


def drift_of(time, case, coefficients=TRUE, lags=LAGS):
    """Return the drift [°/h] of a lagged model."""
    inner = lags[1] if len(lags) > 1 else None
    return coil.path([(time, case)]).drivers(lags[0], inner).raw_design() @ coefficients


def campaign(*, noise=0.0, seed=0, coefficients=TRUE, lags=LAGS):
    """Return logs of heating and cooling at 1, 5, 10 °C/min with alternating turn-on biases."""
    rng = np.random.default_rng(seed)
    logs = []
    for k, rate in enumerate((1.0, -1.0, 5.0, -5.0, 10.0, -10.0)):
        time, case = case_of(rate, 9000.0 if abs(rate) < 2.0 else 4500.0)
        seen = (
            drift_of(time, case, coefficients, lags)
            + 0.03 * (-1.0) ** k
            + rng.normal(0.0, 1.0, time.size) * noise
        )
        logs.append(
            ThermalLog(
                f"ramp {rate:+g}", time, case, case - 2.0, seen, np.zeros(time.size, dtype=np.int64)
            )
        )
    return logs


# coil temperatures


def temperatures(time, case, *lags):
    """Outer and inner temperature [°C] of a coil, and the rate [°C/s] of the outer one."""
    drivers = coil.path([(time, case)]).drivers(*lags)
    return drivers.temperature, drivers.temperature - drivers.gradient, drivers.rate / 60.0


@pytest.mark.parametrize(
    "lags", [(210.0, 120.0), (120.0, 210.0), (150.0, 150.0), (20.0, 3600.0), (3600.0, 20.0)]
)
def test_the_coil_follows_the_matrix_exponential_on_any_sampling(lags):
    """On irregular samples, straight between them, both temperatures agree with the exact solution
    to 1e-9 °C.
    """
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(1.0, 40.0, 200))
    time[120:] += 5000.0
    case = np.cumsum(rng.normal(0.0, 1.0, 200))
    outer, inner, rate = temperatures(time, case, *lags)
    state = np.array([case[0], case[0]])
    for k in range(1, time.size):
        h = time[k] - time[k - 1]
        # states: outer, inner, case, slope of the case
        matrix = np.zeros((4, 4))
        matrix[0, :3] = -1.0 / lags[0], 0.0, 1.0 / lags[0]
        matrix[1, :2] = 1.0 / lags[1], -1.0 / lags[1]
        matrix[2, 3] = 1.0
        start = np.array([*state, case[k - 1], (case[k] - case[k - 1]) / h])
        state = (expm(matrix * h) @ start)[:2]
        assert (outer[k], inner[k]) == pytest.approx(state, abs=1e-9)  # °C
    assert rate == pytest.approx((case - outer) / lags[0], abs=1e-15)  # °C/s


def test_on_a_long_ramp_each_temperature_is_behind_by_rate_times_lag():
    """Outer = case − r τ_o, inner = outer − r τ_i, and both rates are the ramp's; without overflow
    over 300,000 s.
    """
    time = np.arange(0.0, 300_000.0, 10.0)
    drivers = coil.path([(time, 0.001 * time)]).drivers(200.0, 100.0)
    assert 0.001 * time[-1] - drivers.temperature[-1] == pytest.approx(0.2, abs=1e-9)  # °C
    assert drivers.gradient[-1] == pytest.approx(0.1, abs=1e-9)  # °C
    assert drivers.rate[-1] == pytest.approx(0.06, abs=1e-9)  # °C/min
    assert drivers.gradient_rate[-1] == pytest.approx(0.0, abs=1e-9)  # °C/min


# fit


def test_a_drift_of_the_family_is_found_again():
    """Without noise both lags come back within 0.01 s and the coefficients to 1e-4 of
    themselves.
    """
    model = fit_lagged(campaign())
    assert model.lags == pytest.approx(LAGS, abs=0.01)  # s
    assert model.coefficients == pytest.approx(TRUE, rel=1e-4, abs=1e-12)
    assert model.turn_on == pytest.approx([0.03, -0.03] * 3, abs=1e-5)  # °/h
    assert model.coefficients[TERMS.index("s_grad_rate")] == 0.0


def test_a_coil_of_one_mass_has_one_lag():
    """Without a gradient among the terms only tau_outer is fitted, and the gradient terms are
    zero.
    """
    terms = ("b0", "b1", "b2", "b3", "s_rate")
    true = TRUE * np.isin(TERMS, terms)
    model = fit_lagged(campaign(coefficients=true, lags=(260.0,)), terms)
    assert model.lags == pytest.approx((260.0,), abs=0.01)  # s
    assert model.coefficients == pytest.approx(true, rel=1e-4, abs=1e-12)
    assert model.covariance.shape == (10, 10)


def test_the_lags_are_those_of_an_exhaustive_search():
    """In noise no pair of lags on a fine grid fits better, and the best on the grid is next to the
    fit.
    """
    stacked = pooled_fit.Stack.of_logs(campaign(noise=0.02, seed=3))
    _, solution = solve_lagged(stacked)
    outer, inner = np.exp(solution.log_lags)
    grid = [
        (a, b)
        for a in outer * np.geomspace(0.9, 1.1, 21)
        for b in inner * np.geomspace(0.8, 1.25, 21)
    ]
    squares = [_square(solution, np.log(point)) for point in grid]
    least = _square(solution, solution.log_lags)
    assert least <= min(squares) * (1.0 + 1e-9)
    assert grid[int(np.argmin(squares))] == pytest.approx((outer, inner), rel=0.03)


def _square(solution, log_lags):
    """Return the square sum at given lags."""
    return replace(solution, log_lags=log_lags).square


def test_lags_that_leave_no_trace_are_said_to_be_undetermined():
    """Where the drift is a function of the case alone the outer lag is on its bound, a flag
    names it, and no uncertainty is stated.
    """
    logs = []
    for log in campaign(noise=0.02):
        seen = 9e-3 * log.case + np.random.default_rng(len(log.name)).normal(
            0.0, 0.02, log.case.size
        )
        logs.append(ThermalLog(log.name, log.time, log.case, log.env, seen, log.part))
    model = fit_lagged(logs)
    assert any(
        "the logs do not determine it" in flag or "hardly determined" in flag
        for flag in (*model.flags, *model.remarks)
    )
    assert {"tau_outer", "s_rate"} <= set(model.entangled)


def test_the_rate_of_the_gradient_is_refused_as_a_term():
    """It is a sum of the others."""
    with pytest.raises(FitError, match="s_grad_rate is not a term of a lagged model"):
        fit_lagged(campaign(), TERMS)


def test_a_case_that_never_moves_is_refused():
    """Constant temperature determines nothing."""
    still = [
        ThermalLog(
            log.name, log.time, np.full(log.time.size, 20.0), log.env, log.indication, log.part
        )
        for log in campaign(noise=0.02)
    ]
    with pytest.raises(FitError, match="cannot determine"):
        fit_lagged(still)


# leaving out a ramp


def test_leaving_out_a_ramp_is_fitting_the_others():
    """The linearised fit without a ramp predicts it as the full fit to the others does."""
    stacked = pooled_fit.Stack.of_logs(campaign(noise=0.05, seed=9))
    search, solution = solve_lagged(stacked)
    fitted = search.rows.solve(solution.columns, solution.turn_on_variance)
    without = left_out.leave_out(stacked, search.rows)
    predicted = solution.leave_out(without)
    for ramp, (rows, drift) in enumerate(zip(stacked.ramps, predicted, strict=True)):
        others = replace(search, rows=without[ramp])
        full = fits.minimise(replace(solution, basis=others))
        expected = (full.columns @ full.fit.coefficients)[rows]
        moved = (solution.columns @ fitted.coefficients)[rows]
        scale = np.std(expected - expected.mean() - moved + moved.mean())
        assert np.std(drift[rows] - expected) < 0.3 * scale + 1e-5, ramp  # °/h


# evaluation


def test_a_known_log_is_compensated_exactly():
    """On a ramp that was not fitted the drift of a known coil is taken off to 1e-4 °/h."""
    model = fit_lagged(campaign())
    time, case = case_of(3.0, 7000.0)
    found = bank.evaluate(model, time, case, case)
    true = drift_of(time, case)
    assert np.std(true - found.drift) < 1e-4  # °/h, of 0.4
    rest = drift_of(np.arange(3.0), np.full(3, 25.0))[0]
    assert found.drift[0] == pytest.approx(true[0] - rest, abs=1e-4)  # °/h


def test_evaluation_at_1_hz_agrees_with_evaluation_on_blocks():
    """The same log at 1 s and at 10 s gives the same drift at the common instants to 1e-4 °/h."""
    model = fit_lagged(campaign())
    time, case = case_of(6.0, 4000.0)
    fine = np.arange(0.0, time[-1] + 0.5)
    slow = bank.evaluate(model, time, case, case).drift
    fast = bank.evaluate(model, fine, np.interp(fine, time, case), np.zeros(fine.size)).drift
    assert fast[::10] == pytest.approx(slow, abs=1e-9)  # °/h


def test_sensitivities_are_the_derivatives_of_the_drift():
    """A coefficient or a lag moved by a millionth moves the drift as stated."""
    from dataclasses import replace

    model = fit_lagged(campaign(noise=0.01))
    time, case = case_of(6.0, 4000.0)
    found = bank.evaluate(model, time, case, case)
    for k, lag in enumerate(model.lags):
        lags = tuple(value * (1.0 + 1e-6 * (j == k)) for j, value in enumerate(model.lags))
        wide = replace(model, lags=lags)
        moved = (bank.evaluate(wide, time, case, case).drift - found.drift) / (lag * 1e-6)
        assert found.sensitivities[:, 9 + k] == pytest.approx(
            moved, abs=2e-3 * np.max(np.abs(moved))
        )
    for k in range(1, 8):
        step = 1e-6 * abs(model.coefficients[k])
        coefficients = model.coefficients.copy()
        coefficients[k] += step
        moved = (
            bank.evaluate(replace(model, coefficients=coefficients), time, case, case).drift
            - found.drift
        )
        assert found.sensitivities[:, k] == pytest.approx(
            moved / step, rel=1e-5, abs=1e-6 * np.max(np.abs(moved / step))
        )


def test_a_ramp_faster_than_any_fitted_is_clamped_and_flagged():
    """At 30 °C/min rate and gradient are held at the fitted bounds, and the masks say where."""
    model = fit_lagged(campaign())
    time, case = case_of(30.0, 4000.0, lag=60.0)
    found = bank.evaluate(model, time, case, case)
    drivers = _drivers(model, time, case, case)
    assert np.array_equal(found.rate_clamped, drivers.rate > model.valid.rate[1])
    assert np.array_equal(found.gradient_clamped, drivers.gradient > model.valid.gradient[1])
    assert found.rate_clamped.any()
    assert not found.temperature_clamped[time < 500.0].any()

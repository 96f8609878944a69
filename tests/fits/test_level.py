"""The level model: causal rates without delay, one robust fit over all logs, coefficients in raw
units.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.bias.numeric import bank
from calibkit.numeric import flicker
from calibkit.numeric.thermal import coil, terms as thermal_terms
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.numeric.thermal.terms import TERMS, Drivers, Scales
from fits.drift_fits import fit_level, stated_uncertainty

TRUE = np.array([8.0, 9e-3, -3e-4, 2e-6, -0.18, -0.05, 4e-4, 1.3e-3, 0.015])
"""A drift of about 1 °/h over −40 … 60 °C."""


def temperatures(rate, seconds=9000.0, step=10.0, lag=300.0):
    """Return time [s], case and chamber temperature [°C] of a ramp between soaks, the case behind
    by a lag.
    """
    time = np.arange(0.0, seconds, step)
    ends = (-40.0, 60.0) if rate > 0 else (60.0, -40.0)
    start = 900.0
    env = np.clip(ends[0] + rate / 60.0 * np.maximum(time - start, 0.0), -40.0, 60.0)
    env = env + 0.2 * np.sin(time / 170.0)
    case = np.empty_like(env)
    case[0] = env[0]
    decay = np.exp(-step / lag)
    for k in range(1, time.size):
        case[k] = env[k] + decay * (case[k - 1] - env[k])
    return time, case, env


def log_of(name, rate, coefficients=TRUE, *, noise=0.0, turn_on=0.0, seed=0, seconds=9000.0):
    """Return a log whose drift is a level model's on its own temperatures."""
    time, case, env = temperatures(rate, seconds)
    drift = coil.level_drivers(time, case, env).raw_design() @ coefficients
    rng = np.random.default_rng([seed, *name.encode()])
    seen = drift + turn_on + (rng.normal(0.0, noise, time.size) if noise else 0.0)
    return ThermalLog(name, time, case, env, seen, np.zeros(time.size, dtype=np.int64))


def campaign(*, noise=0.0, turn_on=0.0, seed=0, coefficients=TRUE):
    """Return logs of heating and cooling at 1, 5, 8, 10 °C/min; their turn-on biases alternate."""
    return [
        log_of(
            f"ramp {rate:+g}",
            rate,
            coefficients,
            noise=noise,
            turn_on=turn_on * (-1.0) ** k,
            seed=seed,
            seconds=9000.0 if abs(rate) < 2.0 else 4500.0,
        )
        for k, rate in enumerate((1.0, -1.0, 5.0, -5.0, 8.0, -8.0, 10.0, -10.0))
    ]


# rates


def test_the_rate_is_that_of_a_fitted_parabola():
    """It agrees with numpy's polynomial fit over the window before each instant."""
    rng = np.random.default_rng(1)
    time = np.cumsum(rng.uniform(4.0, 16.0, 120))
    values = np.cumsum(rng.normal(0.0, 0.3, 120))
    rate = coil._end_slope(time, values, 90.0)
    for k in range(12, 120):
        window = (time >= time[k] - 90.0) & (time <= time[k])
        slope = np.polynomial.Polynomial.fit(time[window] - time[k], values[window], 2).deriv()(0.0)
        assert rate[k] == pytest.approx(60.0 * slope, abs=1e-9)  # °C/min


def test_the_rate_knows_no_future():
    """Two logs that are equal up to an instant have bit-equal rates up to it."""
    rng = np.random.default_rng(2)
    time, values = np.arange(200) * 10.0, rng.normal(0.0, 1.0, 200)
    other = values.copy()
    other[100:] += 7.0
    assert np.array_equal(coil._end_slope(time, values)[:100], coil._end_slope(time, other)[:100])


def test_too_slow_a_sampling_is_refused_rather_than_given_no_rates():
    """At 60 s a window of 90 s holds no parabola."""
    time = np.arange(50) * 60.0
    with pytest.raises(FitError, match=r"sampled every 60 s.*over 90 s"):
        coil.level_drivers(time, time, time)


# terms


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_scaled_coefficients_mean_the_same_drift_in_raw_units(seed):
    """The design in scaled drivers times β is the raw design times the transformed β."""
    rng = np.random.default_rng(seed)
    drivers = Drivers(*rng.uniform(-60.0, 60.0, (4, 50)))
    scales = Scales(rng.uniform(-20.0, 20.0), rng.uniform(10.0, 60.0), *rng.uniform(1.0, 20.0, 3))
    beta = rng.normal(0.0, 1.0, 9)
    expected = drivers.scaled_design(scales) @ beta
    assert drivers.raw_design() @ (scales.to_raw() @ beta) == pytest.approx(
        expected, rel=1e-9, abs=1e-9
    )


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (("b0", "b2"), "b2 without b1"),
        (("b0", "s_temp_rate"), "s_temp_rate without s_rate"),
        (("b1",), "without b0"),
        (("b0", "s_rat"), "'s_rat' is not a drift term"),
    ],
)
def test_a_term_set_that_means_nothing_is_refused(terms, message):
    """A product needs its factor, a power the one below, and b0 is always there."""
    with pytest.raises(FitError, match=message):
        thermal_terms.chosen_columns(terms)


# fit


def test_a_drift_of_the_family_is_found_again():
    """Without noise all nine coefficients come back to 1e-7 of themselves, and the turn-on biases
    of the logs.
    """
    model = fit_level(campaign(turn_on=0.05))
    assert model.coefficients == pytest.approx(TRUE, rel=1e-7)
    assert model.turn_on == pytest.approx(0.05 * np.array([1.0, -1.0] * 4), abs=1e-9)  # °/h
    assert model.terms == TERMS
    assert model.lags == ()


def test_b0_is_known_no_better_than_the_turn_on_bias_lets_it_be():
    """Eight logs whose bias scatters by 0.5 °/h give their mean to 0.19 °/h, the other coefficients
    nearly as without: how alike the logs are tells those little more here.
    """
    quiet, loud = fit_level(campaign(noise=0.1)), fit_level(campaign(noise=0.1, turn_on=0.5))
    expected = 0.5 * np.sqrt(8.0 / 7.0) / np.sqrt(8.0)
    assert stated_uncertainty(loud)[0] == pytest.approx(expected, rel=0.02)  # °/h
    assert stated_uncertainty(loud)[1:] == pytest.approx(stated_uncertainty(quiet)[1:], rel=0.1)


def short_ramps(seed, turn_on):
    """Return six logs of 15 °C each, side by side from −35 to 55 °C, with random turn-on biases."""
    rng = np.random.default_rng([seed, 3])
    time, found = np.arange(0.0, 1800.0, 10.0), []
    for k in range(6):
        case = -35.0 + 15.0 * k + 15.0 * time / time[-1]
        seen = 8.0 + 9e-3 * case + rng.normal(0.0, turn_on) + rng.normal(0.0, 0.1, time.size)
        found.append(ThermalLog(f"{k}", time, case, case, seen, np.zeros(time.size, np.int64)))
    return found


@pytest.mark.parametrize(("turn_on", "share"), [(0.0, 0.5), (0.02, 0.8), (0.3, 1.4)])
def test_random_turn_on_biases_tell_the_slope_across_logs(turn_on, share):
    """Six logs that each see 15 °C of 90: where their biases are alike the slope is known to half
    of what each log tells by itself, and errors stay within what is stated whatever they are.
    """
    models = [fit_level(short_ramps(seed, turn_on), ("b0", "b1")) for seed in range(40)]
    error = np.array([model.coefficients[1] - 9e-3 for model in models])
    stated = np.array([stated_uncertainty(model)[1] for model in models])
    alone = 0.1 / (np.sqrt(6 * 180.0) * 15.0 / np.sqrt(12.0))  # °/h/°C
    assert np.median(stated) < share * alone
    assert np.mean(np.abs(error) <= 2.0 * stated) >= 0.92


def test_spikes_that_survive_averaging_have_no_say():
    """With 1 % of the blocks off by 30 standard deviations the coefficients move by less than half
    of their uncertainty.
    """
    clean = campaign(noise=0.1, seed=4)
    rng = np.random.default_rng(5)
    spiked = []
    for log in clean:
        seen = log.indication.copy()
        hit = rng.random(seen.size) < 0.01
        seen[hit] += rng.choice((-3.0, 3.0), hit.sum())  # °/h
        spiked.append(ThermalLog(log.name, log.time, log.case, log.env, seen, log.part))
    before, after = fit_level(clean), fit_level(spiked)
    moved = np.abs(after.coefficients - before.coefficients) / stated_uncertainty(before)
    assert np.max(moved) < 0.5


def test_a_constant_chamber_cannot_determine_the_gradient_terms():
    """The refusal names the terms that nothing varies."""
    logs = [
        ThermalLog(log.name, log.time, log.case, log.case - 5.0, log.indication, log.part)
        for log in campaign(noise=0.1)
    ]
    with pytest.raises(FitError, match=r"s_grad, s_grad2, s_grad_rate|cannot determine .*s_grad"):
        fit_level(logs)


@pytest.mark.parametrize(
    ("logs", "message"),
    [
        ([], "no log to fit"),
        (
            [log_of("short", 1.0, seconds=80.0)],
            "short: a ramp of 8 blocks over 70 s, expected at least 10",
        ),
        ([log_of("holed", 1.0, np.full(9, np.nan))], "holed: a value that is not finite"),
    ],
)
def test_unusable_logs_are_refused(logs, message):
    """Nothing is fitted to no log, to a log that is too short, or to one with holes."""
    with pytest.raises(FitError, match=message):
        fit_level(logs)


def test_stated_uncertainties_hold_in_flicker_noise_and_those_of_white_noise_do_not():
    """Of 16 gyros the errors are 0.65 to 1.1 of the stated uncertainties (rms), 1.3 times those of
    ordinary least squares.
    """
    stated, naive = [], []
    # the factor of a shorter log is the corner of that of a longer one
    root = np.linalg.cholesky(flicker.kernel(900))
    for seed in range(16):
        rng = np.random.default_rng([seed, 3])
        logs = []
        for log in campaign(noise=0.1, turn_on=0.02, seed=seed):
            n = log.time.size
            seen = log.indication + 0.02 * root[:n, :n] @ rng.normal(0.0, 1.0, n)
            logs.append(ThermalLog(log.name, log.time, log.case, log.env, seen, log.part))
        model = fit_level(logs)
        error = model.coefficients - TRUE
        stated.append(error / stated_uncertainty(model))
        naive.append(error[1:] / _white_uncertainty(logs))
    assert 0.65 < np.sqrt(np.mean(np.square(stated))) < 1.1
    assert np.sqrt(np.mean(np.square(naive))) > 1.3


def _white_uncertainty(logs):
    """Return ordinary least-squares uncertainties [8] of the coefficients beyond b0 by a plain fit
    with a dummy a log.
    """
    columns, indication = [], np.concatenate([log.indication for log in logs])
    for number, log in enumerate(logs):
        dummy = np.zeros((log.time.size, len(logs)))
        dummy[:, number] = 1.0
        columns.append(
            np.hstack([dummy, coil.level_drivers(log.time, log.case, log.env).raw_design()[:, 1:]])
        )
    design = np.vstack(columns)
    found, square, *_ = np.linalg.lstsq(design, indication)
    variance = float(square[0]) / (len(indication) - len(found))
    scale = np.linalg.norm(design, axis=0)
    return (
        np.sqrt(np.diag(np.linalg.inv((design / scale).T @ (design / scale))) * variance)[
            len(logs) :
        ]
        / scale[len(logs) :]
    )


# evaluation


def test_drift_is_zero_at_rest_at_the_reference_temperature_and_keeps_the_mean_rate():
    """b0 is no drift; at 25 °C at rest nothing is taken off, at 60 °C what the polynomial says."""
    model = fit_level(campaign())
    still = np.arange(30) * 10.0
    rest = bank.evaluate(model, still, np.full(30, 25.0), np.full(30, 25.0))
    assert rest.drift == pytest.approx(np.zeros(30), abs=1e-9)  # °/h
    warm = bank.evaluate(model, still, np.full(30, 50.0), np.full(30, 50.0)).drift
    powers = np.array([[25.0**k, 50.0**k] for k in range(1, 4)])
    assert warm == pytest.approx(
        np.full(30, TRUE[1:4] @ (powers[:, 1] - powers[:, 0])), abs=1e-6
    )  # °/h


def test_outside_the_fitted_ranges_the_drift_is_held_and_flagged():
    """At 80 °C the drift is that of the hottest fitted case, and the mask says so; what was taken
    off is known.
    """
    model = fit_level(campaign())
    time = np.arange(40) * 10.0
    hot = bank.evaluate(model, time, np.full(40, 80.0), np.full(40, 80.0))
    edge = np.full(40, model.valid.temperature[1])
    assert hot.drift == pytest.approx(
        bank.evaluate(model, time, edge, edge).drift, abs=1e-12
    )  # °/h
    assert hot.temperature_clamped.all()
    assert not hot.rate_clamped.any()
    assert not hot.gradient_clamped.any()
    assert np.all(np.abs(hot.extrapolated_drift) > 0.05)  # °/h
    away = bank.evaluate(model, time, np.full(40, 20.0), np.full(40, 90.0))
    assert away.gradient_clamped.all()
    assert not away.temperature_clamped.any()
    assert not away.rate_clamped.any()

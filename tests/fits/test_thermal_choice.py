"""The choice of a drift model by ramps it has not seen, on simulated physical gyros: what is
exported, and when nothing is.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibkit.instruments.bias import (
    compensate,
    simulate_fog as fog,
)
from calibkit.instruments.bias.numeric import bank
from calibkit.instruments.bias.numeric.choice import CANDIDATES, _best_of, choose
from calibkit.numeric import flicker, intervals
from calibkit.numeric.thermal import (
    evaluate,
    fits,
    left_out,
    pooled_fit,
)
from calibkit.numeric.thermal.evaluate import Evaluation
from calibkit.numeric.thermal.left_out import Candidate, LeftOutErrors
from calibkit.numeric.thermal.pooled_fit import BlockNoise
from calibkit.simulate import noise
from calibkit.simulate.chamber import Chamber
from fits.drift_fits import block_log, fit_level

INTERVAL_S = 10.0
WITHHELD = "withheld/"


def simulated(seed, *, drift_scale=1.0, hysteresis_scale=0.0):
    """Return the logs of one gyro on ±1, 5, 8, 10 °C/min and withheld ±3, ±6 °C/min."""
    device = fog.FogGyro.draw(seed).scale_drift(
        drift_scale=drift_scale, hysteresis_scale=hysteresis_scale
    )
    return fog.logs(device, fog.programmes((1.0, 5.0, 8.0, 10.0), (3.0, 6.0)), seed, Chamber())


def blocks(name, made, *, spikes=0.0):
    """Return block means of a simulated log, on request with a share of spikes of 2 to 50 °/h."""
    columns = made.columns
    seen = np.array(columns["gyro_dph"], dtype=np.float64)
    rng = np.random.default_rng([*name.encode()])
    hit = rng.random(seen.size) < spikes
    seen[hit] += rng.choice((-1.0, 1.0), hit.sum()) * rng.uniform(2.0, 50.0, hit.sum())
    time = columns["time_s"].astype(np.float64)
    read = (time, columns["temp_case_degc"], columns["temp_env_degc"], seen)
    return block_log(name, read, INTERVAL_S)


def fitted(logs, **kwargs):
    """Return block means of the logs that are fitted."""
    return [
        blocks(name, made, **kwargs) for name, made in logs.items() if not name.startswith(WITHHELD)
    ]


def drift_uncertainty(model, found):
    """Return the standard uncertainty [n, °/h] that the contributions make together."""
    return np.sqrt(sum(part[2] ** 2 for part in evaluate.contributions(model, found)))


def explained(model, logs):
    """Return what type A and flicker make of neighbouring 100 s means on these logs."""
    along = [bank.evaluate(model, log.time, log.case, log.env).sensitivities for log in logs]
    return evaluate.explained(model, logs, along, 10)


def withheld(logs, model):
    """Return drift rms by truth before and after, and the errors over stated uncertainties, of the
    withheld ramps.
    """
    before, after, normalized = [], [], []
    for name, made in logs.items():
        if name.startswith(WITHHELD):
            log = blocks(name, made)
            true = intervals.Intervals.find(
                made.columns["time_s"].astype(np.float64), INTERVAL_S
            ).means(made.drift)
            found = bank.evaluate(model, log.time, log.case, log.env)
            before.append(np.std(true))
            after.append(np.std(true - found.drift))
            normalized.append((found.drift - true) / drift_uncertainty(model, found))
    return np.array(before), np.array(after), np.concatenate(normalized)


@pytest.fixture(scope="module")
def logs():
    """Return the logs of a gyro without hysteresis."""
    return simulated(31)


@pytest.fixture(scope="module")
def choice(logs):
    """Return the choice for them."""
    return choose(fitted(logs))


# what is exported


def test_the_chosen_model_takes_ten_times_the_drift_off_every_withheld_ramp(logs, choice):
    """On ±3 and ±6 °C/min the true drift is reduced more than 10 times on each, and by the level
    model less.
    """
    assert isinstance(choice.model, bank.BankModel)
    before, after, _ = withheld(logs, choice.model)
    assert len(before) == 4
    assert np.min(before / after) > 10.0
    _, by_level, _ = withheld(logs, fit_level(fitted(logs)))
    assert np.max(after / by_level) < 0.7


def test_the_stated_uncertainty_of_the_compensated_rate_covers_the_truth(logs, choice):
    """Along the withheld ramps at least 85 % of the errors are within twice the stated uncertainty,
    which is below 0.05 °/h.
    """
    _, _, normalized = withheld(logs, choice.model)
    assert np.mean(np.abs(normalized) <= 2.0) > 0.85
    log = blocks(*next(iter(logs.items())))
    found = bank.evaluate(choice.model, log.time, log.case, log.env)
    assert np.max(drift_uncertainty(choice.model, found)) < 0.05  # °/h


@pytest.mark.parametrize("seed", [41, 42, 43])
def test_a_gyro_without_drift_gets_no_drift_term(seed):
    """Noise alone is never worth a model."""
    found = choose(fitted(simulated(seed, drift_scale=0.0)))
    assert found.model is None
    assert found.chosen_errors is None
    assert "no drift term" in found.reason
    assert {one.name for one in found.tested} >= {one.name for one in CANDIDATES}


def test_two_ramps_are_too_few_to_choose():
    """With one rate up and down there is nothing to leave out."""
    found = choose(fitted(simulated(31))[:2])
    assert found.model is None
    assert found.reason == "2 ramps, expected at least 3 to leave one out: no drift term"


# the leave-one-out figures


def test_left_out_errors_of_a_level_model_are_those_of_a_plain_fit_to_the_other_ramps(logs):
    """For each ramp generalised least squares of the other logs, each with a free level held to
    the mean of all by the scatter of turn-on biases, gives the same compensated figure.
    """
    cubic = [Candidate("cubic", "level", ("b0", "b1", "b2", "b3"))]
    stacked = pooled_fit.Stack.of_logs(fitted(logs))
    (found,) = choose(fitted(logs), cubic, figure_blocks=10).tested
    solution = fits.level_basis(stacked).solve(cubic[0].terms)
    sound = solution.rows.sound
    noise, tau = solution.rows.noise, np.sqrt(solution.turn_on_variance)
    for ramp, rows in enumerate(stacked.ramps):
        parts, seen = [], []
        for number, log in enumerate(np.flatnonzero(np.arange(8) != ramp)):
            mine = np.arange(stacked.indication.size)[stacked.log_rows[log]]
            whole = np.array_split(mine, np.arange(0, mine.size, -(-mine.size // 250))[1:])
            place = np.array([k for k, group in enumerate(whole) if sound[group].any()])
            groups = [whole[k][sound[whole[k]]] for k in place]
            count = np.array([group.size for group in groups])
            kernel = flicker.kernel(len(whole))[np.ix_(place, place)]
            V = np.diag(noise.white_variance / count) + noise.flicker**2 * kernel
            root = np.linalg.inv(np.linalg.cholesky(V))
            columns = np.array([solution.columns[group].mean(axis=0) for group in groups])
            level = np.tile(np.eye(7)[number], (count.size, 1))
            parts.append(root @ np.hstack([level, columns]))
            seen.append(root @ [stacked.indication[group].mean() for group in groups])
        held = np.hstack([(np.eye(7) - 1.0 / 7.0) / tau, np.zeros((7, 3))])
        design, target = np.vstack([*parts, held]), np.concatenate([*seen, np.zeros(7)])
        fit = np.linalg.lstsq(design, target)[0][7:]
        left = stacked.indication[rows] - solution.columns[rows] @ fit
        expected = np.std(left_out.figure_means(left, sound[rows], 10))
        assert found.squares[ramp] == pytest.approx(expected**2, rel=2e-6)


def result(compensated, raw=(0.2, 0.2, 0.2), *, parameters=5, endless=False):
    """Return left-out errors of some candidate, of a size on each ramp."""
    sides = np.array([1.0, -1.0, 1.0, -1.0])
    errors, without = ([size * sides for size in sizes] for sizes in (compensated, raw))
    return LeftOutErrors("level T", tuple(errors), tuple(without), parameters, endless)


NEAR, BEST = (0.11, 0.09, 0.1), (0.099, 0.0995, 0.096)
"""Errors on three left-out ramps: less than one standard error apart."""


def test_of_candidates_within_one_standard_error_of_the_best_the_simplest_is_exported():
    """A difference within the scatter of the ramps is no reason for three more coefficients; one
    beyond it is; helping is a condition.
    """
    assert _best_of([result(NEAR, parameters=4), result(BEST, parameters=7)]) == 0
    assert _best_of([result(NEAR, parameters=7), result(BEST, parameters=4)]) == 1
    assert _best_of([result((0.1, 0.1, 0.1), parameters=4), result((0.09,) * 3, parameters=7)]) == 1
    assert _best_of([result((0.001, 0.001, 0.3)), result((0.15,) * 3)]) == 1
    assert _best_of([result((0.3,) * 3)]) is None


def test_a_ramp_that_is_worse_within_its_noise_rejects_no_model():
    """A tenth more than raw on one ramp rejects a model; not where chance makes as much."""
    worse = result((0.05, 0.05, 0.22))
    assert _best_of([worse]) is None
    apart = 0.22**2 - 0.2**2
    uneven = np.sqrt(0.22**2 + apart * np.array([1.0, -1.0, 1.0, -1.0]))
    assert _best_of([replace(worse, errors=(*worse.errors[:2], uneven))]) == 0


# uncertainty


def test_what_is_common_to_a_log_is_no_error_about_its_mean():
    """A coefficient that moves a whole log alike has no part in U about the log's mean, and the
    share of means within U is counted by that; the limits are absolute.
    """
    along = np.linspace(-1.0, 1.0, 400)
    found = Evaluation(
        along,
        np.column_stack([np.ones(400), along]),
        np.zeros(400),
        *[np.zeros(400, dtype=bool)] * 4,
    )
    assert np.allclose(found.about_mean().sensitivities, np.column_stack([np.zeros(400), along]))
    u = np.full(400, 0.01)
    stated = evaluate.Along(along, [], u, u, np.full(400, 3.0), np.full(400, 0.5))
    compared, _, limit = compensate.compare_means(along, stated, BlockNoise(0.0, 0.0), 10)
    assert compared["share_within_expanded_uncertainty"] == pytest.approx(0.5, abs=0.03)
    assert np.allclose(limit, 3.0)


def test_model_error_is_what_lasts_in_left_out_ramps():
    """White errors count for nothing, a slow error for its rms; no ramps, no error."""
    rng = np.random.default_rng(0)
    white = [rng.normal(0.0, 0.05, 4000) for _ in range(4)]
    slow = 0.02 * np.sqrt(2.0) * np.sin(np.arange(4000) / 60.0)
    assert evaluate.model_error(white) < 0.01  # °/h
    assert evaluate.model_error([w + slow for w in white]) == pytest.approx(0.02, rel=0.1)  # °/h
    assert evaluate.model_error([]) == 0.0


def test_what_type_a_and_flicker_explain_is_no_model_error(logs, choice):
    """Left-out errors of 0.01 °/h are a model error where flicker is absent, and none where it
    makes as much.
    """
    errors = [np.full(40, 0.01) * np.where(np.arange(40) < 20, 1.0, -1.0)]
    model = replace(choice.model, covariance=np.zeros_like(choice.model.covariance))
    quiet = replace(model, noise=replace(model.noise, flicker=0.0))
    loud = replace(model, noise=replace(model.noise, flicker=0.02))
    known = [explained(m, fitted(logs)) for m in (quiet, loud)]
    assert known[0] == 0.0
    assert evaluate.model_error(errors, known[0]) == pytest.approx(0.0095, abs=0.0005)
    assert evaluate.model_error(errors, known[1]) == 0.0


def test_what_is_clamped_is_uncertain_by_what_clamping_took_off(choice):
    """At 100 °C the uncertainty is at least the difference to the unclamped model over √3."""
    time = np.arange(100) * 10.0
    hot = bank.evaluate(choice.model, time, np.full(100, 100.0), np.full(100, 100.0))
    stated = drift_uncertainty(choice.model, hot)
    assert hot.temperature_clamped.all()
    assert np.all(stated >= np.abs(hot.extrapolated_drift) / np.sqrt(3.0))
    assert np.all(np.abs(hot.extrapolated_drift) > 0.0)


def test_propagated_uncertainty_agrees_with_monte_carlo(logs, choice):
    """The spread of the drift over 300 draws of coefficients and lags is the stated one within 15
    %.
    """
    model = replace(choice.model, model_error=0.0)
    name = next(name for name in logs if name.startswith(WITHHELD))
    log = blocks(name, logs[name])
    part = slice(0, 400)
    stated = drift_uncertainty(
        model, bank.evaluate(model, log.time[part], log.case[part], log.env[part])
    )
    rng = np.random.default_rng(1)
    small = 1e-3  # of the standard deviation: where the model is linear in the lags
    mean = np.concatenate([model.coefficients, model.static_lag])
    draws = []
    for draw in rng.multivariate_normal(np.zeros(mean.size), model.covariance, 300, method="eigh"):
        at = mean + small * draw
        moved = replace(model, coefficients=at[:-3], static_lag=tuple(at[-3:].tolist()))
        draws.append(bank.evaluate(moved, log.time[part], log.case[part], log.env[part]).drift)
    spread = np.std(draws, axis=0) / small
    inside = stated > 0.2 * stated.max()
    assert spread[inside] == pytest.approx(stated[inside], rel=0.15)


def test_flicker_of_the_simulated_kind_has_the_covariance_that_is_assumed():
    """Variograms of means of 100 samples of simulated flicker agree with the kernel's within 10
    %.
    """
    rng = np.random.default_rng(2)
    means = np.array(
        [noise.flicker(1.0, 4000, rng).reshape(40, 100).mean(axis=1) for _ in range(1500)]
    )
    kernel = flicker.kernel(40)
    for lag in (1, 2, 5, 20):
        seen = np.mean((means[:, lag:] - means[:, :-lag]) ** 2)
        pairs = [
            kernel[i, i] + kernel[i + lag, i + lag] - 2.0 * kernel[i, i + lag]
            for i in range(40 - lag)
        ]
        assert seen == pytest.approx(np.mean(pairs), rel=0.1)


@pytest.mark.parametrize(("first", "stop"), [(0, 60), (20, 45), (59, 60), (0, 2)])
@pytest.mark.parametrize("of_rest", [False, True])
def test_covariances_about_a_level_are_those_of_the_whole_matrix(first, stop, of_rest):
    """Lag by lag, about the mean of the same means or of the others, as by the kernel of all."""
    inside = np.isin(np.arange(60), np.arange(first, stop))
    level = ~inside if of_rest and not inside.all() else inside
    about = np.eye(60)[inside] - level / np.count_nonzero(level)
    whole = about @ flicker.kernel(60) @ about.T
    lags = (0, 1, 2, 3)
    found = flicker.Flicker(60, lags).about_level(first, stop, of_rest=of_rest)
    for lag, covariances in zip(lags, found, strict=True):
        wanted = np.diag(whole, lag) if lag < stop - first else np.zeros(0)
        assert covariances.shape == wanted.shape
        assert np.allclose(covariances, wanted, rtol=1e-11, atol=1e-13)


def test_turned_blocks_have_independent_noise():
    """Blocks of two logs, some missing, of unequal numbers of rows: the covariance of the turned
    rows at white noise of 2 and flicker of 0.3 is diagonal, with 4 + 0.09 λ.
    """
    log, place = np.repeat([0, 1], [5, 4]), np.array([0, 1, 2, 3, 4, 0, 2, 3, 6])
    count = np.array([3.0, 3.0, 3.0, 3.0, 1.0, 2.0, 2.0, 1.0, 2.0])
    turned = flicker.Turned.of_logs(log, place, count)
    same = log[:, None] == log
    covariance = np.diag(4.0 / count) + 0.09 * flicker.kernel(7)[np.ix_(place, place)] * same
    found = turned.rows(turned.rows(covariance).T)
    assert found == pytest.approx(np.diag(4.0 + 0.09 * turned.flicker), abs=1e-12)


def test_noise_is_told_into_white_and_flicker():
    """From residuals of eight logs white variance and flicker level come back within 30 %; no
    flicker is little.
    """
    root = np.linalg.cholesky(flicker.kernel(500))
    rng = np.random.default_rng(3)
    for true, low, high in ((0.0, 0.0, 0.01), (0.02, 0.014, 0.026)):
        seen = [
            true * root @ rng.normal(0.0, 1.0, 500) + rng.normal(0.0, 0.1, 500) for _ in range(8)
        ]
        design = np.tile(np.arange(500.0) / 500.0, 8)[:, None]
        turned = flicker.Turned.of_logs(
            np.repeat(np.arange(8), 500), np.tile(np.arange(500), 8), np.ones(4000)
        )
        found = pooled_fit.estimate_noise(turned, design, np.concatenate(seen))
        assert low <= found.flicker <= high  # °/h
        assert found.white_variance == pytest.approx(0.01, rel=0.3)


# hysteresis

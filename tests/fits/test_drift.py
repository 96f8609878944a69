"""The published drift scheme: its vectors, its traps, its twins."""

import json

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.bias import drift_choice as gradient_choice
from calibkit.instruments.bias.numeric import published as drift
from calibkit.numeric import intervals
from calibkit.numeric.thermal import left_out
from conftest import AUTHORITIES
from fits.naive import block_means, compensate

VECTOR = json.loads((AUTHORITIES / "fog_drift.json").read_text(encoding="utf-8"))
C = np.array(VECTOR["c"])


def vector_blocks(ramp):
    """Block means of one ramp of the vector."""
    gradient = np.array(ramp["gradient_degc"])
    n = gradient.size
    time = np.arange(n) * float(VECTOR["interval_s"])
    rate = np.full(n, ramp["ramp_degc_min"])
    return drift.DriftBlocks(time, gradient, gradient, np.array(ramp["gyro_dph"]), rate)


def vector_fits(estimate="levels"):
    """Fits of every ramp of the vector."""
    return [
        vector_blocks(ramp).fit_ramp(ramp["ramp_degc_min"], estimate=estimate)
        for ramp in VECTOR["ramps"]
    ]


@pytest.mark.parametrize("estimate", ["levels", "increments"])
def test_the_coefficients_of_the_vector_come_out(estimate):
    """a_j of each ramp equal Σ c_jm r^m to 1e-9 relative of their largest term, by either
    estimator.
    """
    for ramp, found in zip(VECTOR["ramps"], vector_fits(estimate), strict=True):
        powers = ramp["ramp_degc_min"] ** np.arange(4)
        scale = np.abs(C * powers).max(axis=1)
        assert (np.abs(found.coefficients - C @ powers) < 1e-9 * scale).all()


@pytest.mark.parametrize("estimate", ["levels", "increments"])
def test_the_cubic_through_four_rates_is_the_published_one(estimate):
    """c_jm come back to 1e-9 relative with the order pinned to 3, and the degrees of freedom are
    zero.
    """
    found = drift.fit_over_rates(vector_fits(estimate), 3, "heating")
    assert np.abs(found.c / C - 1.0).max() < 1e-9
    assert found.dof == 0


def test_the_recursive_output_of_the_vector_stays_at_its_first_sample():
    """Recursive compensation leaves the first sample's value; one-step leaves 0 from the second
    sample on, to 1e-9 °/h.
    """
    polynomial = drift.fit_over_rates(vector_fits(), 3, "heating")
    for ramp in VECTOR["ramps"]:
        blocks = vector_blocks(ramp)
        delta = drift.increments([polynomial], blocks.gradient, blocks.rate).delta
        recursive = blocks.indication - drift.recursive(delta)
        assert np.abs(recursive - blocks.indication[0]).max() < 1e-9
        assert np.abs(drift.one_step(blocks.indication, delta)[1:]).max() < 1e-9


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_compensation_equals_its_loop(seed):
    """The vectorised compensation equals the loop over the equation to 1e-10 °/h."""
    rng = np.random.default_rng(seed)
    n = 40
    G, r, w = rng.uniform(-60, 0, n), rng.uniform(1.0, 10.0, n), rng.normal(9.0, 1.0, n)
    polynomial = drift.RatePolynomial(
        "heating", C, np.eye(12), 0, 0.0, (1.0, 10.0), 1.0, (-100.0, 0.0), (0.0, 1.0)
    )
    delta = drift.increments([polynomial], G, r).delta
    recursive, one_step = compensate(w.tolist(), G.tolist(), r.tolist(), C.tolist())
    assert w - drift.recursive(delta) == pytest.approx(recursive, abs=1e-10)
    assert drift.one_step(w, delta) == pytest.approx(one_step, abs=1e-10)


def test_one_step_removes_the_true_rate_and_recursive_keeps_it():
    """A constant rate survives the recursion whole (gain 1 to 1e-12) and the published step not at
    all (gain 0).
    """
    blocks = vector_blocks(VECTOR["ramps"][2])
    polynomial = drift.fit_over_rates(vector_fits(), 3, "heating")
    delta = drift.increments([polynomial], blocks.gradient, blocks.rate).delta
    gain = left_out.rate_gain(lambda w: w - drift.recursive(delta), blocks.indication)
    lost = left_out.rate_gain(lambda w: drift.one_step(w, delta), blocks.indication)
    assert gain == pytest.approx(1.0, abs=1e-12)
    assert lost == pytest.approx(0.0, abs=1e-12)


def polynomial(rates=(1.0, 10.0), side="heating", c00=1.0):
    """Polynomial of order 0 with a constant increment."""
    c = np.array([[c00], [0.0], [0.0]])
    return drift.RatePolynomial(side, c, np.eye(3), 3, 0.0, rates, 1.0, (-50.0, 0.0), (-40.0, 60.0))


def test_each_side_is_served_by_its_own_polynomial():
    """Heating increments come from the heating side, cooling ones from the cooling side."""
    pair = [polynomial(), polynomial((-10.0, -1.0), "cooling", -2.0)]
    steps = drift.increments(pair, np.zeros(4), np.array([5.0, -5.0, 0.0, 0.0]))
    assert steps.delta.tolist() == [0.0, 1.0, -2.0, 0.0]


def test_rates_and_gradients_beyond_the_fit_are_clamped_and_marked():
    """A rate of 30 °C/min is evaluated at 10, a gradient of −90 K at −50, and both are said."""
    slope = drift.RatePolynomial(
        "heating",
        np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]),
        np.eye(6),
        2,
        0.0,
        (1.0, 10.0),
        1.0,
        (-50.0, 0.0),
        (0.0, 1.0),
    )
    steps = drift.increments([slope], np.array([-90.0, 0.0]), np.array([30.0, 0.0]))
    assert steps.delta[1] == pytest.approx(10.0 - 50.0)
    assert steps.rate_clamped[1]
    assert steps.gradient_clamped[1]


def test_the_drift_is_zero_at_the_reference_temperature():
    """The level is shifted to zero where the temperature is closest to the reference, clamped to
    the valid range.
    """
    temperature = np.linspace(-40.0, 60.0, 101)
    level = temperature**2
    assert drift.referenced(level, temperature, 25.0, (-40.0, 60.0))[65] == 0.0
    assert drift.referenced(level, temperature, 99.0, (-40.0, 60.0))[-1] == 0.0


def filled(time, case, env):
    """Block means at 10 s of a log whose indication and slope are its case temperature."""
    held = intervals.Intervals.find(time, 10.0)
    means = (held.means(column) for column in (time, case, env, case))
    return drift.DriftBlocks.fill(held, means, case)


@pytest.mark.parametrize("step", [0.1, 1.0, 2.5, 10.0])
def test_block_means_equal_their_loop(step):
    """Block means at 10 s equal those of a dictionary for every sampling interval, to 1e-12."""
    time = np.round(np.arange(0.0, 200.0, step), 6)
    value = np.sin(time)
    blocks = filled(time, value, value - 1.0)
    assert blocks.indication == pytest.approx(
        block_means(time.tolist(), value.tolist(), 10.0), abs=1e-12
    )
    assert blocks.gradient == pytest.approx(np.ones(blocks.time.size), abs=1e-12)


def test_a_log_slower_than_the_model_interval_is_refused():
    """Coefficients per 10 s cannot be fitted to samples every 20 s."""
    with pytest.raises(FitError, match="sampled every 20 s, the model interval is 10 s"):
        intervals.Intervals.find(np.arange(0.0, 400.0, 20.0), 10.0)


def test_a_ramp_that_cannot_determine_its_coefficients_is_refused():
    """A constant gradient, and a ramp of five intervals, are refused with the reason."""
    flat = np.full(30, -5.0)
    blocks = drift.DriftBlocks(np.arange(30.0), flat, flat, np.arange(30.0), flat)
    with pytest.raises(FitError, match="cannot determine"):
        blocks.fit_ramp(1.0)
    short = drift.DriftBlocks(*(np.arange(5.0) for _ in range(5)))
    with pytest.raises(FitError, match="5 intervals"):
        short.fit_ramp(1.0)


def test_levels_know_the_coefficients_better_than_increments():
    """With white noise on the indication the level estimator's scatter of a1 is under two thirds of
    the increments'.
    """
    rng = np.random.default_rng(8)
    blocks = vector_blocks(VECTOR["ramps"][3])
    scatter = {"levels": [], "increments": []}
    for _ in range(100):
        noisy = drift.DriftBlocks(
            blocks.time,
            blocks.case,
            blocks.gradient,
            blocks.indication + rng.normal(0.0, 0.1, 40),
            blocks.rate,
        )
        for estimate, found in scatter.items():
            found.append(noisy.fit_ramp(10.0, estimate=estimate).coefficients[1])
    assert np.std(scatter["levels"]) < np.std(scatter["increments"]) / 1.5


def test_more_coefficients_than_rates_are_refused():
    """An order-2 polynomial needs three rates."""
    with pytest.raises(FitError, match="order 2 needs 3 temperature rates, found 2"):
        drift.fit_over_rates(vector_fits()[:2], 2, "heating")


def test_a_lower_order_through_exact_data_finds_the_exact_polynomials():
    """Ramps whose a_j are linear in rate give back the straight lines at order 1, to 1e-9
    relative.
    """
    truth = np.array([[2e-4, -1e-5], [8e-4, 5e-5], [-3e-5, 6e-6]])
    fits = []
    for ramp in VECTOR["ramps"]:
        blocks, r = vector_blocks(ramp), ramp["ramp_degc_min"]
        G = blocks.gradient[:-1]
        steps = np.vander(G, 3, increasing=True) @ (truth @ [1.0, r])
        indication = np.concatenate([[5.0], 5.0 + np.cumsum(steps)])
        exact = drift.DriftBlocks(blocks.time, G, blocks.gradient, indication, blocks.rate)
        fits.append(exact.fit_ramp(r))
    found = drift.fit_over_rates(fits, 1, "heating")
    assert np.abs(found.c / truth - 1.0).max() < 1e-9
    assert found.dof == 2


def physical_log(rate, rng, linear=0.02):
    """Blocks of a gyro whose bias is linear in a case temperature that lags the air by 200 s, with
    0.01 °/h noise.
    """
    n = int(6000 / abs(rate) / 10)
    time = np.arange(n) * 10.0
    air = np.sign(rate) * np.minimum(abs(rate) * time / 60.0, 100.0)
    case = np.zeros(n)
    for k in range(1, n):
        case[k] = case[k - 1] + (air[k - 1] - case[k - 1]) * 10.0 / 200.0
    return drift.DriftBlocks(
        time, case, case - air, linear * case + rng.normal(0.0, 0.01, n), np.full(n, rate)
    )


def test_the_cubic_is_never_chosen_from_four_rates():
    """Leave-one-rate-out tests orders 0, 1 and 2 from four rates: three rates never carry a
    cubic.
    """
    rng = np.random.default_rng(9)
    logs = [physical_log(rate, rng) for rate in (1.0, 5.0, 8.0, 10.0)]
    fits = [log.fit_ramp(log.rate[0]) for log in logs]
    tested = gradient_choice.left_out_rates(fits, logs, "heating", 10)
    assert [result.order for result in tested] == [0, 1, 2]


def test_a_linear_bias_is_caught_by_constant_coefficients():
    """For a bias linear in temperature a_j do not depend on rate: a withheld rate is improved at
    least threefold.
    """
    rng = np.random.default_rng(10)
    logs = [physical_log(rate, rng) for rate in (1.0, 5.0, 8.0, 10.0)]
    fits = [log.fit_ramp(log.rate[0]) for log in logs]
    tested = gradient_choice.left_out_rates(fits, logs, "heating", 10)
    best = min((one for one in tested if one.helps), key=lambda one: one.pooled)
    model = drift.fit_over_rates(fits, best.order, "heating")
    withheld = physical_log(3.0, rng)
    delta = drift.increments([model], withheld.gradient, withheld.rate).delta
    raw = left_out.drift_rms(withheld.indication, 10)
    assert left_out.drift_rms(withheld.indication - drift.recursive(delta), 10) < raw / 3.0


def test_ramps_of_one_rate_are_left_out_together():
    """Two ramps at 5 and 5.2 °C/min count as one rate: three rates test no more than a line."""
    rng = np.random.default_rng(11)
    logs = [physical_log(rate, rng) for rate in (1.0, 5.0, 5.2, 10.0)]
    fits = [log.fit_ramp(log.rate[0]) for log in logs]
    tested = gradient_choice.left_out_rates(fits, logs, "heating", 10)
    assert [result.order for result in tested] == [0, 1]


def test_drift_rms_ignores_the_mean_and_averages_noise():
    """The figure is the standard deviation of group means; a log shorter than two groups uses its
    samples.
    """
    assert left_out.drift_rms(np.array([5.0, 7.0]), 1) == 1.0
    assert left_out.drift_rms(np.array([1.0, -1.0, 1.0, -1.0]) + 3.0, 2) == 0.0
    assert left_out.drift_rms(np.array([1.0, -1.0, 1.0]), 2) == pytest.approx(
        np.std([1.0, -1.0, 1.0])
    )


def test_an_order_that_spoils_a_fitted_ramp_does_not_help():
    """A model that improves every left-out rate but makes a fitted ramp worse than raw is not
    chosen.
    """

    def tested(left_out, fitted):
        errors, raw = (
            tuple(size * np.array([1.0, -1.0]) for _ in range(2)) for size in (left_out, 1.0)
        )
        squares = np.square(fitted)
        return gradient_choice.LeftOutRates(
            "1", errors, raw, side="heating", order=1, fitted=squares
        )

    good, spoilt, small = tested(0.5, (0.4, 0.4)), tested(0.5, (0.4, 1.2)), tested(0.95, (0.4, 0.4))
    assert (good.helps, spoilt.helps, small.helps) == (True, False, False)

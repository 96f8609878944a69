"""Which root, how far trusted, with what uncertainty: history, headings, priors, gates, refusals,
two sensor pairs.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibkit.fit.shared import Shared
from calibkit.instruments.inclinometer import (
    published,
    root_choice,
    scale_fit,
    simulate,
)
from calibkit.instruments.inclinometer.forms import ScaleModel
from calibkit.instruments.inclinometer.published import NO_NOISE
from calibkit.instruments.inclinometer.recipe import HistorySpec
from conftest import AUTHORITIES
from fits.stations import components_of, forward, vector_components, wrapped

STATIONS = json.loads((AUTHORITIES / "four_position.json").read_text(encoding="utf-8"))["stations"]
NOISE = np.diag([2e-5, 2e-5, 0.01, 0.01]) ** 2 / 2.0


def parts_of(theta, phi, psi, latitude, s=1.0, noise=NOISE):
    """Exact components of stations of given attitudes, and their noise."""
    theta, phi, psi, s = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, dtype=float)) for v in (theta, phi, psi, s))
    )
    made = [forward(*row[:3], latitude, row[3]) for row in zip(theta, phi, psi, s, strict=True)]
    gravity, rate = (np.array([pair[k] for pair in made]) for k in (0, 1))
    covariance = np.broadcast_to(noise, (theta.size, 4, 4)).copy()
    return published.Components(gravity[:, 0], gravity[:, 1], rate[:, 0], rate[:, 1], covariance)


def shaken(parts, rng):
    """Components with noise of their own covariance."""
    values = np.column_stack((parts.accel_x, parts.accel_y, parts.gyro_x, parts.gyro_y))
    noise = np.array([rng.multivariate_normal(np.zeros(4), c) for c in parts.covariance[:1]])
    noise = (
        rng.multivariate_normal(np.zeros(4), parts.covariance[0], len(values))
        if len(values) > 1
        else noise
    )
    return published.Components(*(values + noise).T, parts.covariance)


def solved(parts, latitude, prior, *, latitude_uncertainty_deg=0.0, **options):
    """Stations solved with a prior of s."""
    estimates = root_choice.estimate_roots(parts, latitude, **options)
    return root_choice.solve(estimates, prior, latitude_uncertainty_deg)


def solved_in_sequence(parts, latitude, hours, start=root_choice.DEFAULT_HISTORY):
    """Stations solved in order, with the history of s as prior."""
    estimates = root_choice.estimate_roots(parts, latitude)
    return root_choice.solve(estimates, root_choice.history_prior(estimates, hours, start))


def label_of(found, latitude):
    """C of solved stations."""
    return published.root_label(
        np.radians(found.inclination_deg), np.radians(found.azimuth_deg), latitude
    )


def u_of(found, k):
    """Standard uncertainties of inclination, toolface, s or azimuth of solved stations."""
    return np.sqrt(found.pair_covariance[:, k, k] + found.by_latitude[:, k] ** 2)


def prior_of(count, s=1.0, u=0.01):
    """Prior, the same at all stations."""
    return root_choice.ScalePrior(np.full(count, s), np.full(count, u))


def test_of_two_positive_roots_the_prior_chooses():
    """The station of roots 3.32 and 1.003: a prior of 1 takes the −, a prior of 3.3 the + root."""
    station = STATIONS[8]
    parts = replace(vector_components(station, "x"), covariance=NOISE[None])
    low = solved(parts, 34.2, prior_of(1))
    high = solved(parts, 34.2, prior_of(1, 3.3, 0.05))
    assert (low.root[0], high.root[0]) == (-1, 1)
    assert low.s_root[0] == pytest.approx(1.003, abs=1e-9)
    assert high.s_root[0] == pytest.approx(station["expected"]["root_plus"], abs=1e-9)
    assert any("both roots" in flag for flag in low.flags[0])


def test_roots_that_are_as_likely_are_not_used():
    """A prior midway between two good roots: s is the prior, and the flag says why."""
    station = STATIONS[5]
    parts = replace(vector_components(station, "x"), covariance=NOISE[None])
    middle = 0.5 * (station["expected"]["root_plus"] + station["expected"]["root_minus"])
    found = solved(parts, 60.0, prior_of(1, middle, 0.1))
    assert found.weight[0] == 0.0
    assert found.s[0] == pytest.approx(middle)
    assert any("as likely" in flag for flag in found.flags[0])


def test_the_root_is_shrunk_to_its_prior_by_inverse_variance():
    """S = (s_root/u² + s_prior/u_p²)/(1/u² + 1/u_p²), its uncertainty that of the weighted mean."""
    parts = parts_of(30.0, 40.0, 70.0, 34.2, 1.004)
    found = solved(parts, 34.2, prior_of(1, 1.0, 1e-3))
    u = found.s_root_uncertainty[0]
    expected = (1.004 / u**2 + 1.0 / 1e-6) / (1.0 / u**2 + 1.0 / 1e-6)
    assert found.s[0] == pytest.approx(expected, abs=1e-12)
    assert u_of(found, 2)[0] == pytest.approx((1.0 / u**2 + 1e6) ** -0.5, rel=1e-9)


def test_near_c_zero_s_is_its_prior_and_azimuth_is_not_made_worse():
    """At C = 0.004 s is gated: error over noise at most 1.02 that of s = 1 when the prior is 1."""
    rng = np.random.default_rng(0)
    latitude, theta = 60.0, 60.0
    psi = float(np.degrees(np.arccos(-1.0 / 3.0 + 0.005)))
    parts = shaken(parts_of(np.full(400, theta), 20.0, psi, latitude, 1.001), rng)
    found = solved(parts, latitude, prior_of(400))
    assert np.mean(found.weight == 0.0) > 0.95
    error, plain = (
        np.sqrt(np.mean(wrapped(a - psi) ** 2)) for a in (found.azimuth_deg, found.uncorrected_deg)
    )
    assert error <= 1.02 * plain
    gated = int(np.flatnonzero(found.weight == 0.0)[0])
    assert found.flags[gated]


def test_derivatives_are_those_of_differences():
    """Gradients of root and azimuth by every input equal central differences to 1e-6 of their
    largest.
    """
    latitude = np.array([34.2])
    parts = parts_of(40.0, 70.0, 120.0, 34.2, 1.003)
    values = np.array(
        [parts.accel_x[0], parts.accel_y[0], parts.gyro_x[0], parts.gyro_y[0], np.radians(34.2)]
    )

    def both(inputs, s=None):
        moved = published.Components(*(np.array([v]) for v in inputs[:4]), parts.covariance)
        degrees = np.degrees(inputs[4])
        found = published.attitude(moved.accel_x, moved.accel_y)
        root, _, _ = published.scale_roots(moved.gyro_x, moved.gyro_y, found, degrees)
        fixed = root if s is None else np.array([s])
        psi = published.azimuth(
            moved.accel_x, moved.accel_y, fixed * moved.gyro_x, fixed * moved.gyro_y, degrees
        )
        return root[0], psi[0]

    s = np.array([both(values)[0]])
    plus, none, one = np.array([True]), np.zeros(1), np.ones(1)
    by_root = root_choice.seek_with_slopes(parts, latitude, plus, one, none)[1][0, 4]
    by_psi = root_choice.seek_with_slopes(parts, latitude, plus, none, s)[1][0, 3]
    step = 1e-6 * np.maximum(np.abs(values), 0.1)
    for k in range(5):
        up, down = values.copy(), values.copy()
        up[k] += step[k]
        down[k] -= step[k]
        root = (both(up)[0] - both(down)[0]) / (2.0 * step[k])
        psi = (both(up, s[0])[1] - both(down, s[0])[1]) / (2.0 * step[k])
        assert by_root[k] == pytest.approx(root, abs=1e-6 * np.abs(by_root).max())
        assert by_psi[k] == pytest.approx(psi, abs=1e-6 * np.abs(by_psi).max())
    slope = (both(values, s[0] + 1e-6)[1] - both(values, s[0] - 1e-6)[1]) / 2e-6
    assert by_psi[5] == pytest.approx(slope, rel=1e-6)


def test_an_uncertain_latitude_is_in_the_azimuth():
    """0.1° of latitude adds what moving it by 0.1° does, to 1 %."""
    parts = parts_of(40.0, 70.0, 120.0, 34.2, noise=np.zeros((4, 4)))
    prior = prior_of(1, 1.0, 0.0)
    found = solved(parts, 34.2, prior, latitude_uncertainty_deg=0.1)
    moved = [solved(parts, 34.2 + d, prior).azimuth_deg[0] for d in (-0.05, 0.05)]
    assert u_of(found, 3)[0] == pytest.approx(abs(moved[1] - moved[0]), rel=0.01)


@pytest.mark.parametrize(
    ("latitude", "refused"), [(79.0, False), (80.5, True), (-85.0, True), (90.0, True)]
)
def test_high_latitudes_are_refused(latitude, refused):
    """Beyond 80° of either sign there is no azimuth, and the reason names the latitude."""
    found = solved(parts_of(10.0, 40.0, 70.0, latitude), latitude, prior_of(1))
    assert bool(found.status[0]) == refused
    assert not refused or "latitude" in found.status[0]


def test_a_root_too_uncertain_is_not_used():
    """At 1 °/h of noise a root is known to 0.05: beyond the limit of 0.02 its weight is zero,
    though C is 0.8.
    """
    found = solved(parts_of(30.0, 40.0, 70.0, 34.2, noise=NOISE * 1e4), 34.2, prior_of(1, u=0.5))
    assert label_of(found, 34.2)[0] > 0.5
    assert 0.02 < found.s_root_uncertainty[0] < 0.1
    assert found.weight[0] == 0.0


def test_no_positive_root_leaves_the_prior():
    """Beyond the complement of the latitude noise can make both roots negative: s is its prior,
    flagged.
    """
    parts = parts_of(75.0, 0.0, 45.0, 60.0)
    turned = published.Components(
        parts.accel_x, parts.accel_y, -parts.gyro_x, -parts.gyro_y, parts.covariance
    )
    found = solved(turned, 60.0, prior_of(1))
    assert found.root[0] == 0
    assert found.s[0] == 1.0
    assert any("no positive root" in flag for flag in found.flags[0])


def test_a_root_far_from_its_prior_is_flagged():
    """A root of 1.05 under a prior of 1 ± 0.001 is named with both values."""
    found = solved(parts_of(30.0, 40.0, 70.0, 34.2, 1.05), 34.2, prior_of(1, 1.0, 1e-3))
    assert any("1.05" in flag and "standard uncertainties" in flag for flag in found.flags[0])


def test_history_decides_where_both_roots_are_positive():
    """At latitude 60° and θ 35 to 70° s drifts from 1 to 1.06 over 60 stations: history follows it,
    every root right.
    """
    rng = np.random.default_rng(2)
    count, latitude = 60, 60.0
    s = 1.0 + 0.06 * np.linspace(0.0, 1.0, count) ** 1.5
    psi, theta = rng.uniform(0.0, 360.0, count), rng.uniform(35.0, 70.0, count)
    parts = shaken(parts_of(theta, rng.uniform(-180.0, 180.0, count), psi, latitude, s), rng)
    start = HistorySpec(rate_uncertainty=5e-3, rate_walk=5e-3)
    found = solved_in_sequence(parts, latitude, np.arange(count) / 6.0, start=start)
    C = published.root_label(np.radians(theta), np.radians(psi), latitude)
    trusted = found.weight > 0.0
    assert trusted.sum() > 40
    assert (found.root[trusted] == np.sign(C[trusted])).all()
    error = np.abs(found.s - s) / u_of(found, 2)
    assert np.mean(error < 1.96) > 0.9
    assert np.sqrt(np.mean(wrapped(found.azimuth_deg - psi) ** 2)) < 0.15
    # where s = 1 is kept instead, the drift costs an order of magnitude more at the end
    late = slice(-20, None)
    plain, corrected = (wrapped(a - psi)[late] for a in (found.uncorrected_deg, found.azimuth_deg))
    assert np.sqrt(np.mean(plain**2)) > 10.0 * np.sqrt(np.mean(corrected**2))


def test_history_predicts_with_value_and_rate():
    """After 20 exact stations of s rising 5e-4 an hour the next prior is on the line to 1e-4, not
    on the last value.
    """
    hours = np.append(np.arange(20.0), 24.0)
    s = 1.0 + 5e-4 * hours
    parts = parts_of(np.full(21, 20.0), 40.0, 70.0, 34.2, s, noise=NOISE * 1e-4)
    start = HistorySpec(rate_walk=1e-5)
    prior = root_choice.history_prior(root_choice.estimate_roots(parts, 34.2), hours, start=start)
    assert prior.s[-1] == pytest.approx(s[-1], abs=1e-4)
    assert prior.s[0] == 1.0
    assert prior.standard_uncertainty[0] == 0.01
    assert prior.standard_uncertainty[-1] < 1e-3


@pytest.mark.parametrize("hours", [[6.0], [2.0, 6.0], [0.5, 1.0, 3.5, 6.0]])
def test_a_history_without_stations_grows_less_sure_with_the_cube_of_time(hours):
    """Six hours without a usable station: variance 0.01² + (2e-3 · 6)² + 3e-3² · 6³/3, however the
    time is divided: s is the integral of a rate that walks at random.
    """
    elapsed = np.array([0.0, *hours])
    vertical = parts_of(np.full(elapsed.size, 0.1), 40.0, 70.0, 34.2)
    start = HistorySpec(s=1.01, rate=1e-3, rate_uncertainty=2e-3, rate_walk=3e-3)
    prior = root_choice.history_prior(
        root_choice.estimate_roots(vertical, 34.2), elapsed, start=start
    )
    assert prior.s[-1] == pytest.approx(1.01 + 6e-3, rel=1e-12)
    # 1e-4 + 1.44e-4 + 6.48e-4
    assert prior.standard_uncertainty[-1] ** 2 == pytest.approx(8.92e-4, rel=1e-12)


def prior_at(over, temperature):
    """Prior of s that a fit over temperature gives at temperatures."""
    return over.model.prior(np.atleast_1d(temperature))


def fitted(seed, **options):
    """Components of the x pair of a simulated tool, its solution by history, temperatures,
    truth.
    """
    logs = simulate.campaign(seed, **options)
    log = logs.logs["stations.csv"]
    accel, gyro = (log[name].reshape(-1, 4) for name in ("accel_x_g", "gyro_x_dph"))
    parts = components_of(
        *(accel, gyro, "x"),
        accel_noise_g=2e-5,
        gyro_noise_dph=options.get("noise", 0.01),
    )
    found = solved_in_sequence(parts, logs.truth["latitude_deg"], log["time_s"][::4] / 3600.0)
    return parts, found, log["temp_case_degc"][::4], logs.truth["stations"]


def test_s_over_temperature_follows_the_truth():
    """The polynomial is within 3 standard uncertainties and 4e-4 of the simulated s, which is no
    polynomial.
    """
    _, found, temperature, truth = fitted(4, count=120)
    over = scale_fit.fit_over_temperature(found, temperature)
    prior = prior_at(over, temperature)
    error = prior.s - np.array(truth["s_x"])
    assert np.abs(error).max() < 4e-4
    assert np.sqrt(np.mean((error / prior.standard_uncertainty) ** 2)) < 2.0
    assert over.model.valid[0] < 25.0
    assert over.model.valid[1] > 110.0


def roots_of(s, u, temperature, **options):
    """s(T) of roots of equal uncertainty."""
    solution = SimpleNamespace(
        weight=np.ones(s.size),
        s_root=s,
        s_root_uncertainty=np.full(s.size, u),
        root_slopes=np.zeros((s.size, 5)),
    )
    return scale_fit.fit_over_temperature(solution, temperature, **options)


def test_stations_of_one_room_are_one_temperature():
    """Roots at 24.4 and 24.6 °C and at 60 °C tell no square of temperature: between them s is known
    as well as the roots are.
    """
    temperature = np.array([24.4, 24.45, 24.6, 24.6, 60.0, 60.1, 60.2])
    noise = 1e-4 * np.random.default_rng(3).standard_normal(temperature.size)
    over = roots_of(1.0 + noise, 1e-4, temperature)
    assert prior_at(over, 42.0).standard_uncertainty[0] < 5e-4


@pytest.mark.parametrize(("spread", "separable"), [(0.0, False), (0.3, True), (1.0, True)])
def test_a_turn_is_measured_where_stations_separate_it_from_the_polynomial(spread, separable):
    """24 stations: in one fixture noise alone is left of the
    derivatives by a turn, and a turn of 0.3° stays in s(T); where they differ it is measured.
    """
    rng = np.random.default_rng(5)
    temperature = np.linspace(20.0, 120.0, 24)
    by_turn = 0.02 + 0.02 * spread * rng.uniform(-1.0, 1.0, 24)
    by_turn += 1e-5 * rng.standard_normal(24)
    s = 1.0 + 1e-4 * rng.standard_normal(24) + 0.3 * by_turn
    tool = np.zeros(24, dtype=int)
    turn = Shared(
        group="mounting", effect="gyro turn", level=tool, loading=by_turn[:, None], unit="deg"
    )
    over = roots_of(s, 1e-4, temperature, turn=turn)
    assert any("one attitude" in flag for flag in over.flags) is not separable
    angle, u = over.turn_deg
    if separable:
        assert abs(angle - 0.3) < 3.0 * u
    else:
        assert (angle, u) == (0.0, 0.0)
        assert prior_at(over, 70.0).s[0] == pytest.approx(1.006, abs=1e-4)


@pytest.mark.parametrize("logs", [1, 4])
def test_a_station_is_left_out_of_its_own_prior(logs):
    """The closed form of s(T) without station k equals a refit without it, sizes of the scatter
    held, to 1e-9; u too.
    """
    rng = np.random.default_rng(8)
    temperature, log = np.linspace(20.0, 120.0, 16), np.arange(16) % logs
    s = 1.0 + 1e-6 * temperature + 2e-4 * rng.standard_normal(16) + 3e-4 * log
    error = Shared(group="log", effect="scale", level=log, loading=np.ones((16, 1)), unit="1")
    over = roots_of(s, 1e-4, temperature, order=1, log=error if logs > 1 else None)
    sizes = {size.error.group: size.value for size in over.fit.shared}
    V = (1e-8 + sizes["station"] ** 2) * np.eye(16)
    V += sizes.get("log", 0.0) ** 2 * np.equal.outer(log, log)
    X = np.vander(temperature, 2, increasing=True)
    for k in range(4):
        others = np.arange(16) != k
        W = np.linalg.inv(V[np.ix_(others, others)])
        A = np.linalg.inv(X[others].T @ W @ X[others])
        assert over.left_out.s[k] == pytest.approx(X[k] @ A @ X[others].T @ W @ s[others], abs=1e-9)
        if logs == 1:
            u = np.sqrt(X[k] @ A @ X[k] + sizes["station"] ** 2)
            assert over.left_out.standard_uncertainty[k] == pytest.approx(u, rel=0.02)


def test_s_within_the_range_has_the_degrees_of_freedom_of_its_logs():
    """Four logs whose s differ by far more than their stations: three degrees of freedom, although
    a line at 0 °C, 80 °C below the range, is as uncertain as its slope.
    """
    rng = np.random.default_rng(3)
    temperature, log = np.linspace(80.0, 120.0, 40), np.arange(40) % 4
    s = 1.0 + 1e-5 * rng.standard_normal(40) + 1e-5 * np.array([-3.0, 1.0, 4.0, -2.0])[log]
    error = Shared(group="log", effect="scale", level=log, loading=np.ones((40, 1)), unit="1")
    over = roots_of(s, 1e-5, temperature, order=1, log=error)
    assert over.effective_dof[0] == pytest.approx(3.0, rel=0.1)
    assert over.effective_dof[1] > 20.0


def test_scatter_beyond_noise_is_in_the_prior():
    """S that scatters 1e-3 from station to station has a scatter of 0.7 to 1.3e-3, and the prior is
    no surer than it.
    """
    rng = np.random.default_rng(6)
    s = 1.0 + 1e-3 * rng.normal(size=80)
    parts = parts_of(
        np.full(80, 20.0), 40.0, rng.uniform(0.0, 360.0, 80), 34.2, s, noise=NOISE * 1e-2
    )
    found = solved(parts, 34.2, prior_of(80))
    over = scale_fit.fit_over_temperature(found, np.linspace(20.0, 120.0, 80))
    assert over.model.scatter == pytest.approx(1e-3, rel=0.3)
    assert prior_at(over, 60.0).standard_uncertainty[0] > over.model.scatter


def test_beyond_its_temperatures_the_prior_is_clamped_and_less_sure():
    """s(T) of slope 1e-4 over 20 to 120 °C: at 150 °C the value of 120 °C, its uncertainty wider by
    3e-3.
    """
    model = ScaleModel(np.array([1.0, 1e-4]), np.diag([1e-8, 0.0]), 2e-4, (20.0, 120.0), NO_NOISE)
    inside, edge, outside = (model.prior(np.array([degc])) for degc in (70.0, 120.0, 150.0))
    assert inside.s[0] == pytest.approx(1.007)
    assert outside.s[0] == edge.s[0]
    assert edge.standard_uncertainty[0] == pytest.approx(np.hypot(1e-4, 2e-4))
    assert outside.standard_uncertainty[0] == pytest.approx(np.sqrt(1e-8 + 4e-8 + 9e-6))


def test_two_sensor_pairs_are_combined_by_inverse_variance_around_the_circle():
    """359.9° and 0.3° of equal weight combine to 0.1°; three times the noise has a ninth of the
    weight.
    """
    x = solved(parts_of(20.0, 40.0, 359.9, 34.2), 34.2, prior_of(1))
    y = solved(parts_of(20.0, 40.0, 0.3, 34.2), 34.2, prior_of(1))
    found = root_choice.combine({"x": x, "y": y})
    assert abs(wrapped(found.azimuth_deg[0] - 0.1)) < 0.01
    loud = solved(parts_of(20.0, 40.0, 0.3, 34.2, noise=9.0 * NOISE), 34.2, prior_of(1, u=0.03))
    found = root_choice.combine({"x": x, "y": loud})
    assert abs(wrapped(found.azimuth_deg[0] + 0.06)) < 0.005
    assert found.standard_uncertainty[0, 2] < u_of(x, 3)[0]


def test_the_latitude_s_error_is_one_error_of_both_pairs():
    """Readings without noise: both pairs together are as uncertain by the latitude as one, not by
    √2 less, and their agreement is no matter of it; noise of the readings is √2 less.
    """
    u = {}
    for name, noise, latitude in (("latitude", 1e-18 * NOISE, 0.05), ("noise", NOISE, 0.0)):
        pair = solved(
            parts_of(45.0, 40.0, 70.0, 34.2, noise=noise),
            34.2,
            prior_of(1, u=1e-9),
            latitude_uncertainty_deg=latitude,
        )
        both = root_choice.combine({"x": pair, "y": pair})
        u[name] = both.standard_uncertainty[0, 2] / u_of(pair, 3)[0]
    assert u["latitude"] == pytest.approx(1.0, rel=1e-6)
    assert u["noise"] == pytest.approx(np.sqrt(0.5), rel=1e-6)


def test_pairs_that_disagree_are_flagged():
    """Two degrees between the pairs is no noise."""
    x = solved(parts_of(20.0, 40.0, 70.0, 34.2), 34.2, prior_of(1, u=1e-3))
    y = solved(parts_of(20.0, 40.0, 72.0, 34.2), 34.2, prior_of(1, u=1e-3))
    assert any("differ by 2.0" in flag for flag in root_choice.combine({"x": x, "y": y}).flags[0])

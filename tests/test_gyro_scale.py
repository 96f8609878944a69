"""Scale factor of a gyro: the best straight line, the earth's rate in its intercept, the standards'
figures, other shapes.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import simulate_pair as simulated_pair, simulate_rate_table
from calibkit.instruments.gyro_scale.numeric import (
    gjb_figures,
    plateau_means,
    scale_factor,
)
from calibkit.numeric import earth

K = 10000.0
RATES = np.array(simulate_rate_table.both_ways())
UNEQUAL = {
    "both": simulate_rate_table.both_ways(),
    "positive": simulate_rate_table.RATES_DPS,
    "negative": tuple(-rate for rate in simulate_rate_table.RATES_DPS),
    "unequal": (*simulate_rate_table.RATES_DPS, -1.0, -2.0, -5.0, -10.0, -20.0),
}


def line(rates, latitude=34.2, bias_dps=0.0):
    """Indication of a straight-line gyro on a vertical table axis."""
    return K * (np.asarray(rates) + float(earth.vertical_rate(latitude)) / 3600.0 + bias_dps)


def scale_of(log, column="gyro_a_lsb", **options):
    """Scale factor from a simulated log."""
    found = plateau_means.means(
        log["time_s"],
        log["table_rate_dps"],
        log[column],
        table_angle_deg=log["table_angle_deg"],
        temp_degc=log["temp_case_degc"],
    )
    return scale_factor.of_run(found, **options)[0]


@pytest.mark.parametrize("rates", UNEQUAL.values(), ids=UNEQUAL)
def test_rates_of_one_sign_or_unequal_rates_give_the_same_scale_factor(rates):
    """Without noise K comes back to 1e-12 of itself, with the earth's rate present, whatever the
    rates.
    """
    found = scale_factor._scale_factor(np.array(rates), line(rates))
    assert pytest.approx(K, rel=1e-12) == found.K
    assert pytest.approx(K * 15.041067 / 3600.0 * np.sin(np.radians(34.2)), rel=1e-9) == found.F0


def test_a_line_through_the_origin_is_wrong_where_the_rates_are_one_sided():
    """The trap, at 34°: 2336 ppm from +1 °/s alone, 323 ppm from +1, 2, 5, 10; symmetric rates
    cancel it.
    """
    for rates, ppm in (
        (np.array([1.0]), 2336.0),
        (np.array([1.0, 2.0, 5.0, 10.0]), 323.5),
        (RATES, 0.0),
    ):
        through_origin = rates @ line(rates, latitude=34.0) / (rates @ rates)
        assert (through_origin / K - 1.0) * 1e6 == pytest.approx(ppm, abs=0.5)
    with pytest.raises(FitError, match="F0"):
        scale_factor._scale_factor(np.array([1.0, 1.0]), line([1.0, 1.0]), np.ones(2))


@pytest.mark.parametrize("rates", UNEQUAL.values(), ids=UNEQUAL)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_scale_factor_of_a_simulated_gyro_is_within_3_ppm(rates, seed):
    """3 counts a sample, 11 rates, earth's rate, ripple, asymmetry, warming, uneven table: K within
    3 ppm of truth.
    """
    logs = simulated_pair.campaign(seed, rates_dps=rates)
    found = scale_of(logs.logs["table_axis_a.csv"])
    assert abs(found.K / logs.truth["models"]["a_about_a"]["K"] - 1.0) < 3e-6


@pytest.mark.parametrize(
    "rates", [simulate_rate_table.both_ways(), (1.0, 2.0, 5.0, 10.0)], ids=["both", "few"]
)
def test_the_scale_factor_is_within_four_standard_uncertainties(rates):
    """Straight-line gyros, also at +1, 2, 5, 10 °/s alone, where noise is 4 ppm: error below 4 u
    and u below 10 ppm.
    """
    for seed in range(5):
        logs = simulated_pair.campaign(seed, rates_dps=rates, ideal=True)
        found = scale_of(logs.logs["table_axis_a.csv"])
        u = found.standard_uncertainty[0]
        assert abs(found.K - logs.truth["models"]["a_about_a"]["K"]) < 4.0 * u
        assert u / found.K < 10e-6


def test_the_stated_uncertainty_covers_the_truth():
    """From plateau means of unequal noise, 600 data sets: 95 % intervals of K and F0 cover 93.5 to
    97.5 %.
    """
    rng = np.random.default_rng(5)
    u = np.where(np.abs(RATES) > 30.0, 1.0, 0.3)
    inside = []
    for _ in range(600):
        found = scale_factor._scale_factor(RATES, line(RATES) + u * rng.normal(size=RATES.size), u)
        error = found.coefficients - (K, line([0.0])[0])
        inside.append(np.abs(error) < 1.96 * found.standard_uncertainty)
    assert ((np.mean(inside, axis=0) > 0.935) & (np.mean(inside, axis=0) < 0.975)).all()


def test_residuals_beyond_the_noise_raise_the_uncertainty():
    """A ripple of 20 counts under a stated noise of 1 gives a Birge ratio above 10 and an
    uncertainty larger by it.
    """
    rippled = line(RATES) + 20.0 * np.sin(RATES)
    found = scale_factor._scale_factor(RATES, rippled, np.ones(RATES.size))
    quiet = scale_factor._scale_factor(RATES, line(RATES), np.ones(RATES.size))
    assert found.birge_ratio > 10.0
    assert found.standard_uncertainty / quiet.standard_uncertainty == pytest.approx(
        found.birge_ratio
    )


def test_no_more_rates_than_coefficients_need_a_stated_noise():
    """Two rates fit exactly: without noise the uncertainty is unknowable and refused, with it it is
    propagated.
    """
    rates = np.array([-10.0, 10.0])
    with pytest.raises(FitError, match="no noise"):
        scale_factor._scale_factor(rates, line(rates))
    found = scale_factor._scale_factor(rates, line(rates), np.full(2, 2.0))
    assert found.standard_uncertainty == pytest.approx([2.0 / np.sqrt(200.0), 2.0 / np.sqrt(2.0)])


def test_a_misaligned_gyro_loses_the_cosine():
    """One degree between input axis and table axis costs 152 ppm."""
    found = scale_factor._scale_factor(RATES, np.cos(np.radians(1.0)) * line(RATES))
    assert pytest.approx(1.0 - 152.3e-6, abs=0.1e-6) == found.K / K


def test_the_bias_is_what_the_earth_leaves_of_the_intercept():
    """A bias of 1.5 °/h comes back to 1e-9 °/h, along the axis and for a gyro at 60° to it."""
    vertical = float(earth.vertical_rate(34.2)) / 3600.0
    own = scale_factor._scale_factor(RATES, line(RATES, bias_dps=1.5 / 3600.0), np.ones(RATES.size))
    assert own.bias_dps(vertical)[0] * 3600.0 == pytest.approx(1.5, abs=1e-9)
    across = scale_factor._scale_factor(
        RATES, 0.5 * line(RATES) + K * 1.5 / 3600.0, np.ones(RATES.size)
    )
    value, uncertainty = across.bias_dps(vertical, own_K=K)
    assert value * 3600.0 == pytest.approx(1.5, abs=1e-9)
    assert uncertainty == pytest.approx(1.0 / np.sqrt(RATES.size) / K, rel=1e-6)


def test_the_table_angle_is_the_better_reference_where_the_rate_is_noisy():
    """A tachometer noise of 0.02 °/s: ten times the uncertainty of the angle's reference; without
    angle it is refused.
    """
    log = dict(simulated_pair.campaign(1, ideal=True).logs["table_axis_a.csv"])
    log["table_rate_dps"] = log["table_rate_dps"] + 0.02 * np.random.default_rng(0).normal(
        size=log["time_s"].size
    )
    by_rate, by_angle = (scale_of(log, reference=reference) for reference in ("rate", "angle"))
    true = simulated_pair.campaign(1, ideal=True).truth["models"]["a_about_a"]["K"]
    assert by_rate.standard_uncertainty[0] > 10.0 * by_angle.standard_uncertainty[0]
    assert abs(by_angle.K - true) < 4.0 * by_angle.standard_uncertainty[0]
    assert abs(by_rate.K - true) < 4.0 * by_rate.standard_uncertainty[0]
    without = plateau_means.means(log["time_s"], log["table_rate_dps"], log["gyro_a_lsb"])
    with pytest.raises(FitError, match="not logged"):
        scale_factor.of_run(without, reference="angle")


def test_nonlinearity_is_the_largest_residual_over_full_scale_and_per_point():
    """One plateau 20 counts off a straight line: figures equal those of a loop over the
    plateaus.
    """
    indication = line(RATES)
    indication[3] += 20.0
    found = scale_factor._scale_factor(RATES, indication)
    slope, intercept = np.polyfit(RATES, indication, 1)
    residuals = [f - slope * w - intercept for w, f in zip(RATES, indication, strict=True)]
    full = max(abs(r) for r in residuals) / max(abs(f) for f in indication) * 1e6
    each = [r / abs(slope * w) * 1e6 for r, w in zip(residuals, RATES, strict=True)]
    assert gjb_figures._nonlinearity_full_scale(found) == pytest.approx(full, rel=1e-6)
    assert gjb_figures.nonlinearity_per_point(found) == pytest.approx(each, rel=1e-6)


def test_a_plateau_at_rest_has_no_relative_deviation():
    """At rate zero the per-point deviation is not a number, and the figures leave it out."""
    rates = np.append(RATES, 0.0)
    found = scale_factor._scale_factor(
        rates, line(rates) + np.random.default_rng(0).normal(size=rates.size)
    )
    assert np.isnan(gjb_figures.nonlinearity_per_point(found)[-1])
    assert all(
        np.isfinite(figure.value) for figure in gjb_figures.figures(found, np.ones(rates.size))
    )


def test_asymmetry_is_found_in_both_senses():
    """Positive rates 40 ppm steeper: both senses give 40 ppm to 0.1; a cubic is no asymmetry about
    one intercept.
    """
    indication = line(RATES) + 40e-6 * K * np.maximum(RATES, 0.0)
    found = scale_factor._scale_factor(RATES, indication)
    assert gjb_figures._asymmetry_gjb(found) == pytest.approx(40.0, abs=0.1)
    assert gjb_figures._asymmetry_ieee(found) == pytest.approx(40.0, abs=0.1)
    cubic = scale_factor._scale_factor(RATES, line(RATES) + 1e-4 * RATES**3)
    assert gjb_figures._asymmetry_ieee(cubic) < 1e-6


def test_asymmetry_of_one_sided_rates_is_refused():
    """Positive rates alone cannot show asymmetry: refused, and left out of the list of figures."""
    rates = np.array(simulate_rate_table.RATES_DPS)
    found = scale_factor._scale_factor(rates, line(rates) + np.sin(rates))
    with pytest.raises(FitError, match="negative"):
        gjb_figures._asymmetry_gjb(found)
    with pytest.raises(FitError, match="both signs"):
        gjb_figures._asymmetry_ieee(found)
    assert not any(
        "asymmetry" in figure.name for figure in gjb_figures.figures(found, np.ones(rates.size))
    )


def test_figures_are_labelled_with_their_standard_and_unit():
    """Every figure names GJB 2426A or IEEE Std 952; K and arc-seconds a pulse are reciprocal."""
    found = scale_factor._scale_factor(RATES, line(RATES) + np.sin(RATES), np.ones(RATES.size))
    figures = {figure.name: figure for figure in gjb_figures.figures(found, np.ones(RATES.size))}
    assert {figure.standard for figure in figures.values()} == {"GJB 2426A", "IEEE Std 952"}
    pulse = figures["scale_factor_ieee"]
    assert pulse.value * figures["scale_factor_gjb"].value == pytest.approx(3600.0)
    assert pulse.standard_uncertainty / pulse.value == pytest.approx(
        found.standard_uncertainty[0] / found.K
    )
    assert figures["nonlinearity_full_scale"].unit == "ppm"


def test_the_uncertainty_of_an_asymmetry_is_its_scatter():
    """Over 2000 noisy straight lines the signed difference of slopes scatters by the stated
    uncertainty to 5 %.
    """
    rng = np.random.default_rng(2)
    rows = gjb_figures._slopes_of_sides(RATES)
    noise = rng.normal(size=(2000, RATES.size))
    scatter = np.std(noise @ (rows[0] - rows[1])) / K * 1e6
    found = scale_factor._scale_factor(RATES, line(RATES) + noise[0], np.ones(RATES.size))
    stated = {
        f.name: f.standard_uncertainty for f in gjb_figures.figures(found, np.ones(RATES.size))
    }
    assert stated["asymmetry_gjb"] == pytest.approx(scatter, rel=0.05)


def test_repeatability_is_the_relative_standard_deviation_over_runs():
    """Runs of 10000, 10000.1, 10000.2 repeat within 10 ppm; one run is refused."""
    assert gjb_figures.repeatability(np.array([10000.0, 10000.1, 10000.2])) == pytest.approx(
        10.0, rel=1e-4
    )
    with pytest.raises(FitError, match="two runs"):
        gjb_figures.repeatability(np.array([10000.0]))


def test_temperature_sensitivity_is_the_largest_relative_change_a_degree():
    """+10 ppm at 35 °C and −78 ppm at −40 °C from 25 °C: the larger is 1.2 ppm/°C; no run at room
    is refused.
    """
    K_runs = K * (1.0 + np.array([0.0, 10e-6, -78e-6]))
    temperature = np.array([25.0, 35.0, -40.0])
    assert gjb_figures.temperature_sensitivity(K_runs, temperature, 25.0) == pytest.approx(
        1.2, rel=1e-6
    )
    with pytest.raises(FitError, match="within 5 °C"):
        gjb_figures.temperature_sensitivity(K_runs, temperature, 80.0)


def test_threshold_and_resolution_are_the_smallest_tested_rate_and_step_that_respond():
    """A dead band of 0.005 °/s: threshold 0.01 °/s of the tested 0.001, 0.002, 0.005, 0.01; noise
    hides all of it.
    """
    rates = np.sort(
        np.concatenate(
            [s * np.array([0.001, 0.002, 0.005, 0.01, 0.1, 1.0, 10.0]) for s in (1.0, -1.0)]
        )
    )
    dead = K * np.where(np.abs(rates) < 0.008, 0.0, rates)
    found = scale_factor._scale_factor(rates, dead, np.full(rates.size, 0.1))
    assert gjb_figures._threshold_dps(found, np.full(rates.size, 0.1)) == pytest.approx(0.01)
    assert np.isnan(gjb_figures._threshold_dps(found, np.full(rates.size, 1e6)))
    straight = scale_factor._scale_factor(rates, K * rates, np.full(rates.size, 0.1))
    assert gjb_figures._resolution_dps(straight, np.full(rates.size, 0.1)) == pytest.approx(0.001)


def test_the_simulated_runs_give_repeatability_and_sensitivity_to_temperature():
    """Campaign of six runs: repeatability below 2 ppm, sensitivity within 0.1 ppm/°C."""
    logs = simulate_rate_table.campaign(3)
    found = {name: scale_of(log, "gyro_x_lsb") for name, log in logs.logs.items()}
    values = np.array([scale.K for scale in found.values()])
    temperature = np.array([log["temp_case_degc"].mean() for log in logs.logs.values()])
    room = values[[name.startswith("room") for name in found]]
    assert gjb_figures.repeatability(room) < 2.0
    slope = abs(logs.truth["gyro"]["K_per_degc"]) * 1e6
    assert gjb_figures.temperature_sensitivity(values, temperature, 25.0) == pytest.approx(
        slope, abs=0.1
    )


@given(
    st.floats(1.0, 1e6),
    st.floats(-0.1, 0.1),
    st.lists(st.floats(-300.0, 300.0), min_size=3, max_size=12, unique=True),
)
@settings(max_examples=60, deadline=None)
def test_any_rates_give_back_any_line(slope, offset, rates):
    """K and F0 of an exact line come back to 1e-9 of full scale, whatever the rates."""
    rates = np.array(rates)
    if np.ptp(rates) < 1.0:
        return
    found = scale_factor._scale_factor(rates, slope * (rates + offset), np.ones(rates.size))
    assert abs(found.K - slope) < 1e-9 * slope * max(1.0, np.abs(rates).max() / np.ptp(rates))
    assert abs(found.F0 - slope * offset) < 1e-9 * slope * np.abs(rates).max() * max(
        1.0, 300.0 / np.ptp(rates)
    )

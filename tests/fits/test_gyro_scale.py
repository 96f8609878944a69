"""Scale factor of a gyro: the published straight line, the earth's rate in its intercept, the
standards' figures.
"""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale import (
    coefficient_files,
    lines,
    published as gyro_figures,
    simulate as simulated_pair,
    table_runs,
)
from calibkit.instruments.gyro_scale.recipe import RateTableRecipe
from calibkit.numeric import earth, gum
from calibkit.records.frame import Log

GJB, IEEE = gyro_figures.GJB, gyro_figures.IEEE
K = 10000.0
RATES = np.array(simulated_pair.both_ways())


def line(rates, latitude=34.2, bias_dps=0.0):
    """Indication of a straight-line gyro on a vertical table axis."""
    return K * (np.asarray(rates) + float(earth.vertical_rate(latitude)) / 3600.0 + bias_dps)


def published(rates, indication, noise=0.0):
    """Published line of indications at rates, with the noise of each."""
    return gyro_figures.Line(np.asarray(rates), indication, np.full(len(rates), noise))


def figures_of(rates, indication, noise=1.0):
    """Figures by name and standard."""
    found = gyro_figures.figures(published(rates, indication, noise), 0.1, "x")
    return {gyro_figures.FigureName.of(figure.name)[:2]: figure for figure in found}


def run_of(log, gyro="a", **table):
    """Run of one gyro in a simulated log."""
    spec = RateTableRecipe(
        procedure="rate_table", logs={"files": ["*.csv"]}, gyros=(gyro,), table=table
    )
    frame = pd.DataFrame(log)
    return table_runs.fit_run(spec, Log("run", "run.csv", "run", len(frame), frame))


def scale_of(log, gyro="a", **table):
    """K of a simulated log, and its standard uncertainty and degrees of freedom."""
    run = run_of(log, gyro, **table)
    found = lines.Lines.of([[(0, run)]]).of_runs([run], gyro)
    return float(found.value[0]), float(found.u[0]), float(found.dof[0])


def one_row_run(rates, indication):
    """Run of rows that are means over a held rate each."""
    spec = RateTableRecipe(
        procedure="rate_table", logs={"files": ["*.csv"]}, plateaus={"one_row": True}
    )
    frame = pd.DataFrame({"table_rate_dps": rates, "gyro_x_lsb": indication})
    return table_runs.fit_run(spec, Log("run", "run.csv", "run", len(frame), frame))


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
        published([1.0, 1.0], line([1.0, 1.0])).K  # noqa: B018 (it is computed when asked for)


@pytest.mark.parametrize(
    ("rates", "largest_ppm"),
    [(simulated_pair.both_ways(), 3.0), ((1.0, 2.0, 5.0, 10.0), 10.0)],
    ids=["both", "few"],
)
def test_the_scale_factor_is_within_its_expanded_uncertainty(rates, largest_ppm):
    """Straight-line gyros, also at +1, 2, 5, 10 °/s alone, where noise is 4 ppm and two rates are
    left over to tell it.
    """
    for seed in range(5):
        logs = simulated_pair.pair(seed, rates_dps=rates, ideal=True)
        found, u, dof = scale_of(logs.logs["table_axis_a.csv"])
        error = abs(found - logs.truth["models"]["a_about_a"]["K"])
        assert error < gum.coverage_factor(dof) * u
        assert u / found < largest_ppm * 1e-6


def test_residuals_beyond_the_noise_are_told_by_their_ratio():
    """A ripple of 20 counts under a noise of 1: more than ten times what noise lets expect; noise
    alone: as much.
    """
    rng = np.random.default_rng(3)
    rippled = published(RATES, line(RATES) + 20.0 * np.sin(RATES), 1.0)
    assert rippled.residual_over_noise > 10.0
    noise = np.where(np.abs(RATES) > 30.0, 1.0, 0.3)
    ratios = [
        gyro_figures.Line(RATES, noise * rng.normal(size=RATES.size), noise).residual_over_noise
        for _ in range(300)
    ]
    assert np.mean(np.square(ratios)) == pytest.approx(1.0, abs=0.05)
    assert np.isnan(published(RATES, rippled.indication).residual_over_noise)


def test_the_bias_is_what_the_earth_leaves_of_the_intercept():
    """A bias of 1.5 °/h comes back to 1e-9 °/h, along the axis and for a gyro at 60° to it."""
    spec = RateTableRecipe(
        procedure="rate_table", logs={"files": ["*.csv"]}, site={"latitude_deg": 34.2}
    )
    for share, own_K in ((1.0, None), (0.5, K)):
        run = one_row_run(RATES, share * line(RATES) + K * 1.5 / 3600.0)
        found = lines.Lines.of([[(0, run)]]).line(run, "x")
        vertical = table_runs.vertical_rate_dps(spec)
        bias = coefficient_files.bias_figure("x", found, vertical, own_K)
        assert bias.value == pytest.approx(1.5, abs=1e-8)


def test_asymmetry_is_found_in_both_senses():
    """Positive rates 40 ppm steeper: both senses give 40 ppm to 0.1; a cubic is no asymmetry about
    one intercept.
    """
    indication = line(RATES) + 40e-6 * K * np.maximum(RATES, 0.0)
    found = figures_of(RATES, indication)
    assert found["asymmetry", GJB].value == pytest.approx(40.0, abs=0.1)
    assert found["asymmetry", IEEE].value == pytest.approx(40.0, abs=0.1)
    cubic = figures_of(RATES, line(RATES) + 1e-4 * RATES**3)
    assert cubic["asymmetry", IEEE].value < 1e-6


def test_one_sided_rates_have_no_asymmetry():
    """Positive rates alone cannot show it."""
    rates = np.array(simulated_pair.RATES_DPS)
    assert not any(name == "asymmetry" for name, _ in figures_of(rates, line(rates)))


def test_the_uncertainty_of_an_asymmetry_is_its_scatter():
    """Over 2000 noisy straight lines the signed difference of slopes scatters by the stated
    uncertainty to 5 %.
    """
    rng = np.random.default_rng(2)
    positive, negative = RATES > 0.0, RATES < 0.0
    noise = rng.normal(size=(2000, RATES.size))
    apart = [
        np.polyfit(RATES[positive], one[positive], 1)[0]
        - np.polyfit(RATES[negative], one[negative], 1)[0]
        for one in noise
    ]
    stated = figures_of(RATES, line(RATES) + noise[0])["asymmetry", GJB].standard_uncertainty
    assert stated == pytest.approx(np.std(apart) / K * 1e6, rel=0.05)


def test_repeatability_is_the_relative_standard_deviation_over_runs():
    """Runs of 10000, 10000.1, 10000.2 repeat within 10 ppm; one run is refused."""
    assert gyro_figures.repeatability(np.array([10000.0, 10000.1, 10000.2])) == pytest.approx(
        10.0, rel=1e-4
    )
    with pytest.raises(FitError, match="two runs"):
        gyro_figures.repeatability(np.array([10000.0]))


def test_temperature_sensitivity_is_the_largest_relative_change_a_degree():
    """+10 ppm at 35 °C and −78 ppm at −40 °C from 25 °C: the larger is 1.2 ppm/°C; no run at room
    is refused.
    """
    K_runs = K * (1.0 + np.array([0.0, 10e-6, -78e-6]))
    temperature = np.array([25.0, 35.0, -40.0])
    assert gyro_figures.temperature_sensitivity(K_runs, temperature, 25.0) == pytest.approx(
        1.2, rel=1e-6
    )
    with pytest.raises(FitError, match="within 5 °C"):
        gyro_figures.temperature_sensitivity(K_runs, temperature, 80.0)


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
    assert figures_of(rates, dead, 0.1)["threshold", GJB].value == pytest.approx(0.01)
    assert ("threshold", GJB) not in figures_of(rates, dead, 1e6)
    straight = figures_of(rates, K * rates, 0.1)
    assert straight["resolution", GJB].value == pytest.approx(0.001)


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
    found = published(rates, slope * (rates + offset))
    assert abs(found.K - slope) < 1e-9 * slope * max(1.0, np.abs(rates).max() / np.ptp(rates))
    assert abs(found.F0 - slope * offset) < 1e-9 * slope * np.abs(rates).max() * max(
        1.0, 300.0 / np.ptp(rates)
    )

"""Simulated rate tables, gyro pairs and inclinometers: repeatable, physical, with a truth that is
not the fitted model.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibkit.instruments.gyro_scale import simulate as gyros
from calibkit.instruments.inclinometer import simulate
from fits.stations import forward


def plain(**constants):
    """A gyro of a straight line without noise, errors of temperature or lag."""
    gyro = gyros.RateGyro.draw(np.random.default_rng(0), noise_lsb=0.0)
    straight = {"ripple_dps": 0.0, "asymmetry": 0.0, "K_per_degc": 0.0, "bias_dps_per_degc": 0.0}
    return replace(gyro, **(straight | {"bias_dps": 0.0, "lag_s": 1e-3} | constants))


def test_a_gyro_across_the_axis_sees_the_earth_turn_with_the_table():
    """Its rate has the amplitude of the horizontal earth rate, 12.44 °/h at 34.2°, and no mean over
    a revolution.
    """
    table, rng = gyros.TurnedTable(unevenness=0.0), np.random.default_rng(0)
    gyro = plain(axis=(1.0, 0.0, 0.0), K=1e8)
    log = gyros.run({"gyro_x_lsb": gyro}, table, (5.0,), 25.0, rng)
    rate = log["gyro_x_lsb"] / gyro.K * 3600.0
    level = 15.041067 * np.cos(np.radians(34.2))
    assert np.abs(rate).max() == pytest.approx(level, rel=1e-3)
    start = int(np.flatnonzero(np.isclose(log["table_rate_dps"], 5.0, rtol=1e-9))[0])
    assert abs(rate[start : start + round(72.0 / table.interval_s)].mean()) < 0.01


def test_the_best_line_is_that_of_the_response_over_the_rates():
    """A gyro with ripple has a best line that is not its constant K, and one without has."""
    rng = np.random.default_rng(1)
    gyro = gyros.RateGyro.draw(rng)
    table = gyros.TurnedTable()
    slope, _ = gyro.best_line(table, gyros.both_ways(), 25.0)
    line = plain(K=gyro.K, bias_dps=gyro.bias_dps)
    straight, intercept = line.best_line(table, gyros.both_ways(), 25.0)
    assert straight == pytest.approx(gyro.K, rel=1e-12)
    assert abs(slope / gyro.K - 1.0) > 1e-8
    vertical = 15.041067 / 3600.0 * np.sin(np.radians(34.2))
    assert intercept == pytest.approx(gyro.K * (vertical + gyro.bias_dps), rel=1e-6)


def test_the_truth_of_a_pair_is_the_angle_of_its_axes():
    """γ is the cosine of α, and the ratio of the lines to 5 ppm; N is the ratio of the own
    lines.
    """
    truth = gyros.pair(7, alpha_deg=60.0).truth
    assert truth["gamma"] == pytest.approx(0.5)
    models = truth["models"]
    assert models["b_about_a"]["K"] / models["b_about_b"]["K"] == pytest.approx(0.5, abs=5e-6)
    assert truth["N"] == pytest.approx(models["b_about_b"]["K"] / models["a_about_a"]["K"])
    assert truth["side"] == "same"
    assert gyros.pair(7, alpha_deg=120.0).truth["side"] == "opposite"


def test_an_ideal_inclinometer_reads_what_rotation_matrices_say():
    """Means over many stations of one attitude equal readings made by matrices, less bias, to 4 of
    their uncertainties.
    """
    rng = np.random.default_rng(3)
    pair = simulate.draw(rng, gyro_noise_dph=0.01, ideal=True)
    count = 400
    attitudes = np.full((count, 3), (30.0, 40.0, 70.0))
    tool = simulate.Tool((pair, pair), index_deg=0.0)
    columns, scales = tool.stations(attitudes, 34.2, np.full(count, 60.0), rng)
    assert (scales == pair["s"]).all()
    for axis, k in (("x", 0), ("y", 1)):
        accel, gyro = (
            columns[f"{name}_{axis}_{unit}"].reshape(-1, 4)
            for name, unit in (("accel", "g"), ("gyro", "dph"))
        )
        for j, position in enumerate((0, 90, 180, 270)):
            gravity, rate = forward(30.0, 40.0, 70.0, 34.2, pair["s"], position=position)
            assert abs(
                accel[:, j].mean() - gravity[k] - pair["accel_bias_g"]
            ) < 4.0 * 2e-5 / np.sqrt(count)
            assert abs(gyro[:, j].mean() - rate[k] - pair["bias_dph"]) < 4.0 * 0.01 / np.sqrt(count)

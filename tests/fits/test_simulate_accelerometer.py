"""Simulated triads on a table: canonical, reproducible, physical; and what calibration makes of
them.
"""

import numpy as np
import pytest

from calibkit.instruments.accelerometer import published, simulate
from calibkit.numeric import attitude


def read(campaign):
    """Indications [n, 3], temperatures [n], inclinations [n], toolfaces [n] of all logs."""
    logs = list(campaign.logs.values())

    def column(name):
        return np.concatenate([log[name] for log in logs])

    indicated = np.column_stack([column(f"accel_{axis}_g") for axis in "xyz"])
    return indicated, column("temp_case_degc"), column("inclination_deg"), column("toolface_deg")


def test_one_indication_is_the_sensor_written_out():
    """Flux loss by an exponential, a bias that saturates, an axis that turns, IEEE 1293 terms: one
    dwell by hand.
    """
    sensor = {
        "scale_factor": 1.01,
        "flux_loss": 1e-3,
        "flux_curvature": 1e-5,
        "bias": 2e-3,
        "bias_slope": 1e-5,
        "bias_bend": 4e-3,
        "bend_width": 50.0,
        "second_order": 1e-3,
        "third_order": 2e-3,
        "cross_product": 3e-3,
        "axis": (1.0, 0.0, 0.0),
        "axis_turn": (0.0, 0.0, 1e-3),
    }
    other = sensor | {"axis": (0.0, 1.0, 0.0)}
    found = simulate.indications(
        (sensor, other, sensor), np.array([[0.6, 0.8, 0.0]]), np.array([75.0])
    )
    turned, crossed = np.array([1.0, 0.05]), np.array([-0.05, 1.0])
    own = turned @ [0.6, 0.8] / np.linalg.norm(turned)
    beside = crossed @ [0.6, 0.8] / np.linalg.norm(crossed)
    bias = 2e-3 + 1e-5 * 50.0 + 4e-3 * np.tanh(1.0)
    higher = 1e-3 * own**2 + 2e-3 * own**3 + 3e-3 * own * beside
    assert found[0, 0] == pytest.approx(
        1.01 * np.exp(-0.05 - 0.025) * (own + higher + bias), rel=1e-12
    )


def test_truth_describes_the_sensors():
    """The noise-free indications follow from the sensors and angles of the truth."""
    campaign = simulate.campaign(5, noise_g=0.0, thermometer_noise_degc=0.0)
    truth = campaign.truth
    sensors = tuple(truth["sensors"][f"accel_{axis}"] for axis in "xyz")
    vector = attitude.gravity_vector(
        np.array(truth["inclination_deg"]), np.array(truth["toolface_deg"])
    )
    indicated, temperature, _, _ = read(campaign)
    np.testing.assert_allclose(
        simulate.indications(sensors, vector, temperature), indicated, atol=1e-12
    )  # g


def test_a_tumbled_triad_comes_back_from_the_length_of_gravity():
    """The mean of each hold has the length that scale, bias and axes make of gravity, within 0.5
    mg; attitudes are not logged.
    """
    from calibkit.instruments.accelerometer import simulate_magnitude

    simulated = simulate_magnitude.campaign(5, positions=12)
    truth = simulated.truth
    log = simulated.logs["tumble.csv"]
    assert set(log) == {"time_s", "accel_x_g", "accel_y_g", "accel_z_g"}
    samples = np.column_stack([log[f"accel_{axis}_g"] for axis in "xyz"]).reshape(12, 130, 3)
    holds = samples[:, :100].mean(axis=1)
    orthogonal = published.exact_matrix(np.array(truth["Q"]))
    corrected = (holds - truth["b"]) / truth["k"] @ orthogonal.T
    np.testing.assert_allclose(np.linalg.norm(corrected, axis=1), 1.0, atol=5e-4)  # g
    assert np.abs(np.linalg.norm(holds, axis=1) - 1.0).max() > 5e-3
    np.testing.assert_allclose(corrected, truth["gravity"]["tumble.csv"], atol=5e-4)

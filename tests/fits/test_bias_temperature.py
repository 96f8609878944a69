"""Biases as polynomials of a temperature: published coefficients, compensation, validation."""

import json

import numpy as np
import pytest

from calibkit.records import store

PUBLISHED = {
    "accel_x_lsb": ("1.173944e+02", "1.801522e-02", "4.798083e-07"),
    "accel_y_lsb": ("7.382063e+01", "-5.200081e-03", "-7.104300e-08"),
    "accel_z_lsb": ("1.558942e+04", "-1.462879e-01", "-1.899410e-05", "-1.618180e-09"),
    "angular_rate_x_lsb": ("6.699801e+00", "-5.878346e-04", "-4.387634e-08"),
    "angular_rate_y_lsb": ("8.341212e+00", "1.172002e-03", "-1.779335e-08"),
    "angular_rate_z_lsb": ("-2.171155e+01", "-6.897733e-05", "4.216745e-09"),
    "magnetometer_x_lsb": ("-9.083109e+01", "8.186348e-04", "6.166144e-09"),
    "magnetometer_y_lsb": ("-2.437029e+02", "3.763355e-03", "4.833303e-08"),
    "magnetometer_z_lsb": ("-5.383430e+02", "1.190119e-02", "1.240244e-06", "7.820395e-11"),
}
"""Published polynomials of an MPU-6050 warm-up (2014), ascending powers of the raw die temperature.
"""


def test_the_published_polynomials_come_out_to_every_printed_digit(real, tmp_path, calibkit):
    """Nine polynomials of 63,792 rows at irregular times equal the published ones in all seven
    printed digits.
    """
    outcome = calibkit(
        "fit", "mpu6050_warmup", data=real / "mpu6050_warmup", serial="MPU-1", out=tmp_path
    )
    assert outcome.code == 0, outcome.err
    run = store.load(tmp_path / "MPU-1" / "r001")
    record = run.records["bias.json"]
    assert run.document["inputs"][0]["rows"] == 63792
    for name, digits in PUBLISHED.items():
        model = record.model(name)
        assert model.form == "polynomial/1"
        assert tuple(f"{coefficient.value:.6e}" for coefficient in model.coefficients) == digits


def bias_log(folder, log_writer, seed, offset=0.0, rows=4000, slope=0.02, shaken=0.05):
    """Write a static gyro's warm-up: a cubic bias with 0.05 °/h noise, more in a tenth of it."""
    rng = np.random.default_rng(seed)
    time = np.arange(float(rows))
    temperature = 60.0 - 80.0 * np.exp(-time / 1500.0)
    bias = offset + slope * temperature - 1e-4 * temperature**2 + 2e-6 * temperature**3
    noise = np.full(rows, 0.05)
    noise[rows // 2 : rows * 6 // 10] = shaken
    gyro = bias + rng.normal(0.0, noise)
    return log_writer(
        folder / f"warmup_{seed}.csv", time_s=time, temp_case_degc=temperature, gyro_dph=gyro
    )


@pytest.mark.parametrize("column", ["temp_case_degc", "gyro_dph"])
def test_a_sentinel_is_no_data(column, tmp_path, calibkit, log_writer):
    """A temperature that no chamber reaches and a rate that no gyro indicates are refused, with
    their line.
    """
    time = np.arange(400.0)
    log = {"time_s": time, "temp_case_degc": 20.0 + time / 20.0, "gyro_dph": np.sin(time)}
    log[column][100] = 9.9e9
    log_writer(tmp_path / "warmup.csv", **log)
    found = calibkit("fit", "bias_temperature", "--data", tmp_path, "--serial", "G")
    assert found.code == 3
    assert "warmup.csv:102" in found.err


def test_few_cold_rows_leave_few_degrees_of_freedom(tmp_path, calibkit, log_writer):
    """Coefficients of a warm-up state the degrees of freedom of their uncertainty: of 300 rows
    fewer than 100, of 4,000 more.
    """
    few, many = [], []
    for rows, into in ((300, few), (4000, many)):
        bias_log(tmp_path / f"{rows}", log_writer, 1, rows=rows)
        options = ("--data", tmp_path / f"{rows}", "--serial", f"G{rows}", "--out", tmp_path)
        assert calibkit("fit", "bias_temperature", *options).code == 0
        model = store.load(tmp_path / f"G{rows}" / "r001").records["bias.json"].models[0]
        into += [entry.effective_dof for entry in model.coefficients]
        assert model.dof == rows - 4
    assert max(few) < 100.0
    assert min(many) > max(few)


def test_compensation_is_zero_at_the_reference_and_keeps_the_mean_rate(
    tmp_path, calibkit, log_writer
):
    """A withheld warm-up at another true rate keeps its rate at 25 °C to 0.02 °/h and loses its
    drift.
    """
    bias_log(tmp_path / "logs", log_writer, 1)
    withheld = bias_log(tmp_path / "withheld", log_writer, 2, offset=7.5)
    runs = tmp_path / "runs"
    assert (
        calibkit("fit", "bias_temperature", data=tmp_path / "logs", serial="G", out=runs).code == 0
    )
    out = tmp_path / "out.csv"
    assert calibkit("apply", "G", "--runs", runs, "--data", withheld, "--out", out).code == 0
    gyro = np.genfromtxt(out, delimiter=",", names=True)["gyro_dph"]
    at_reference = 7.5 + 0.02 * 25.0 - 1e-4 * 25.0**2 + 2e-6 * 25.0**3
    assert gyro[-1000:].mean() == pytest.approx(at_reference, abs=0.02)
    assert np.std(gyro) < 0.06
    added = ("--set", "output.drift=true", "--out", tmp_path / "drift.csv")
    assert calibkit("apply", "G", "--runs", runs, "--data", withheld, *added).code == 0
    both = np.genfromtxt(tmp_path / "drift.csv", delimiter=",", names=True)
    logged = np.genfromtxt(withheld, delimiter=",", names=True)["gyro_dph"]
    np.testing.assert_allclose(both["gyro_drift_dph"], logged - gyro, rtol=0, atol=1e-12)
    validated = calibkit(
        "validate", "G", runs=runs, data=tmp_path / "withheld", out=tmp_path / "v.json"
    )
    assert validated.code == 0
    channel = json.loads((tmp_path / "v.json").read_text(encoding="utf-8"))["logs"][0]["channels"][
        0
    ]
    assert channel["after"] < 0.15 * channel["before"]  # 0.05 °/h of noise stay


def test_the_drift_of_another_gyro_is_rejected(tmp_path, calibkit, log_writer):
    """A slope of 0.05 instead of 0.02 °/h/°C: the frozen polynomial makes its errors smaller, and
    they are far beyond their uncertainty all the same.
    """
    bias_log(tmp_path / "logs", log_writer, 1)
    bias_log(tmp_path / "other", log_writer, 3, slope=0.05)
    folders = ("--data", tmp_path / "logs", "--serial", "G", "--out", tmp_path / "runs")
    assert calibkit("fit", "bias_temperature", *folders).code == 0
    data = ("--data", tmp_path / "other", "--out", tmp_path / "v.json")
    outcome = calibkit("validate", "G", "--runs", tmp_path / "runs", *data)
    assert outcome.code == 1
    assert "warmup_3.csv gyro_dph: drift over its u" in outcome.out
    document = json.loads((tmp_path / "v.json").read_text(encoding="utf-8"))
    (channel,) = document["logs"][0]["channels"]
    assert channel["after"] < channel["before"]
    assert document["verdict"] == "rejected"


def test_beyond_the_fitted_range_the_polynomial_is_clamped_and_said(tmp_path, calibkit, log_writer):
    """A log that goes beyond the fitted temperatures is compensated with the bias of the range's
    end.
    """
    bias_log(tmp_path / "logs", log_writer, 1)
    hot = log_writer(
        tmp_path / "hot.csv",
        time_s=np.arange(20.0),
        temp_case_degc=np.linspace(25.0, 200.0, 20),
        gyro_dph=np.ones(20),
    )
    calibkit("fit", "bias_temperature", data=tmp_path / "logs", serial="G", out=tmp_path / "runs")
    applied = calibkit("apply", "G", runs=tmp_path / "runs", data=hot, out=tmp_path / "o.csv")
    assert "clamped" in applied.err
    gyro = np.genfromtxt(tmp_path / "o.csv", delimiter=",", names=True)["gyro_dph"]
    assert np.ptp(gyro[5:]) == 0.0

"""Every log of the reference measurements goes in as it is, described by a recipe and nothing
else.
"""

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.logs import log_files

AXES = "xyz"
ACCEL = tuple(f"accel_{axis}_g" for axis in AXES)
GYRO = tuple(f"gyro_{axis}_dph" for axis in AXES)
GRAVITY = 9.81

MPU9150 = """
procedure = "accelerometer"
[logs]
files = ["imu*.log"]
format = "text"
names = ["ax", "ay", "az", "gx", "gy", "gz"]
rate_hz = 100.0
text = { encoding = "utf-8", delimiter = "space", decimal = ".", skip_lines = 0, header_lines = 0 }
[site]
gravity_mps2 = 9.81
[columns]
accel_x_g = { from = "ax", unit = "m/s^2" }
accel_y_g = { from = "ay", unit = "m/s^2" }
accel_z_g = { from = "az", unit = "m/s^2" }
gyro_x_dph = { from = "gx", unit = "rad/s" }
gyro_y_dph = { from = "gy", unit = "rad/s" }
gyro_z_dph = { from = "gz", unit = "rad/s" }
"""


TEN_POSITIONS = """
procedure = "accelerometer"
[logs]
files = ["example_data_*.csv", "imu_*.csv"]
rate_hz = 100.0
[columns]
accel_x_lsb = { from = "ax" }
accel_y_lsb = { from = "ay" }
accel_z_lsb = { from = "az" }
"""

FERRARIS = """
procedure = "accelerometer"
[logs]
files = ["example_ferraris_session.csv"]
rate_hz = 102.4
[site]
gravity_mps2 = 9.81
[columns]
accel_x_g = { from = "acc_x", unit = "m/s^2" }
accel_y_g = { from = "acc_y", unit = "m/s^2" }
accel_z_g = { from = "acc_z", unit = "m/s^2" }
gyro_x_dph = { from = "gyr_x", unit = "deg/s" }
gyro_y_dph = { from = "gyr_y", unit = "deg/s" }
gyro_z_dph = { from = "gyr_z", unit = "deg/s" }
"""

ANNOTATED = """
procedure = "accelerometer"
[logs]
files = ["annotated_session.csv"]
[columns]
time_s = { from = "samples", unit = "s", scale = 0.0048828125 }
accel_x_lsb = { from = "acc_x" }
accel_y_lsb = { from = "acc_y" }
accel_z_lsb = { from = "acc_z" }
"""

LN100 = """
procedure = "accelerometer"
[logs]
files = ["x_LN100_*.ins"]
format = "binary"
[logs.binary]
byte_order = "little"
fields = [
    { name = "t", type = "f8", unit = "s" },
    { name = "gx", type = "f8", unit = "deg/s" },
    { name = "gy", type = "f8", unit = "deg/s" },
    { name = "gz", type = "f8", unit = "deg/s" },
    { name = "ax", type = "f8", unit = "m/s^2" },
    { name = "ay", type = "f8", unit = "m/s^2" },
    { name = "az", type = "f8", unit = "m/s^2" },
]
[site]
gravity_mps2 = 9.8107
[columns]
time_s = { from = "t" }
gyro_x_dph = { from = "gx" }
gyro_y_dph = { from = "gy" }
gyro_z_dph = { from = "gz" }
accel_x_g = { from = "ax" }
accel_y_g = { from = "ay" }
accel_z_g = { from = "az" }
"""

LN100_TEXT = """
procedure = "accelerometer"
[logs]
files = ["ln100_x_*.csv"]
[columns]
time_s = { from = "t_s" }
gyro_x_dph = { from = "gx_dps", unit = "deg/s" }
gyro_y_dph = { from = "gy_dps", unit = "deg/s" }
gyro_z_dph = { from = "gz_dps", unit = "deg/s" }
"""


def logs(text, folder, needed):
    """Return the logs that a recipe finds in a folder, by their names, as arrays [n, columns]."""
    spec = instruments.parse_recipe(recipe.Source("r.toml", text))
    found = [
        log_files.read_log(spec, folder / file, file, needed)
        for file in log_files.find_logs(spec, folder)
    ]
    return {log.name: log.frame[list(needed)].to_numpy() for log in found}


def test_a_log_without_header_and_time_is_described_by_its_columns_and_rate(real):
    """MPU-9150: accelerations in g, rates in °/h, time from 100 Hz; each number as numpy reads
    it.
    """
    folder = real / "mpu9150_multiposition"
    found = logs(MPU9150, folder, ("time_s", *ACCEL, *GYRO))
    assert sorted(found) == ["imu0", "imu1", "imu2"]
    for name, columns in found.items():
        raw = np.loadtxt(folder / f"{name}.log")
        np.testing.assert_array_equal(columns[:, 0], np.arange(len(raw)) / 100.0)
        np.testing.assert_allclose(columns[:, 1:4], raw[:, :3] / GRAVITY, rtol=1e-15)
        np.testing.assert_allclose(columns[:, 4:], np.degrees(raw[:, 3:]) * 3600.0, rtol=1e-15)


def test_a_preamble_of_the_logger_is_stepped_over(real):
    """MPU-6050, four logs with four lines above the header: no row is lost."""
    folder = real / "mpu6050_ten_positions"
    needed = ("time_s", *(f"accel_{axis}_lsb" for axis in AXES))
    found = logs(TEN_POSITIONS, folder, needed)
    assert len(found) == 4
    for name, columns in found.items():
        raw = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=5)
        np.testing.assert_array_equal(columns[:, 1:], raw[:, :3])


def test_a_ferraris_session_goes_in_with_its_sample_numbers(real):
    """Session in m/s² and °/s, and the annotated one in counts with a text column nobody needs."""
    folder = real / "imucal_ferraris"
    session = logs(FERRARIS, folder, ("time_s", *ACCEL, *GYRO))["example_ferraris_session"]
    raw = np.loadtxt(folder / "example_ferraris_session.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(session[:, 0], raw[:, 0] / 102.4)
    np.testing.assert_allclose(session[:, 1:4], raw[:, 4:] / GRAVITY, rtol=1e-15)
    np.testing.assert_array_equal(session[:, 4:], raw[:, 1:4] * 3600.0)
    needed = ("time_s", *(f"accel_{axis}_lsb" for axis in AXES))
    annotated = logs(ANNOTATED, folder, needed)["annotated_session"]
    raw = np.loadtxt(
        folder / "annotated_session.csv", delimiter=",", skiprows=1, usecols=(1, 2, 3, 4)
    )
    np.testing.assert_array_equal(annotated[:, 1:], raw[:, 1:])


def test_binary_records_see_the_earth_as_their_csv_does(real):
    """LN-100 .ins: the CSV's numbers to its ten digits, half difference 11.73 °/h, bias −0.25
    °/h.
    """
    folder = real / "ln100_up_down"
    needed = ("time_s", *GYRO)
    binary, text = logs(LN100, folder, (*needed, *ACCEL)), logs(LN100_TEXT, folder, needed)
    for way in ("up", "down"):
        np.testing.assert_allclose(
            binary[f"x_LN100_{way}"][:, :4], text[f"ln100_x_{way}"], rtol=1e-9, atol=1e-6
        )
        assert np.abs(binary[f"x_LN100_{way}"][:, 4].mean()) == pytest.approx(
            1.0, abs=2e-3
        )  # local g
    up, down = (binary[f"x_LN100_{way}"][:, 1].mean() for way in ("up", "down"))
    assert round(float(up - down) / 2.0, 2) == 11.73
    assert round(float(up + down) / 2.0, 2) == -0.25


def test_a_warm_up_goes_in_by_the_shipped_recipe(real):
    """MPU-6050 warm-up: 63,792 rows at irregular milliseconds, counts as they are."""
    spec = instruments.parse_recipe(recipe.find("mpu6050_warmup"))
    folder = real / "mpu6050_warmup"
    (file,) = log_files.find_logs(spec, folder)
    log = log_files.read_log(spec, folder / file, file, ("time_s", *spec.own_columns()))
    raw = np.loadtxt(folder / file, delimiter=",", skiprows=1)
    assert log.rows == 63792
    np.testing.assert_array_equal(log.frame["time_s"], raw[:, 12] / 1000.0)
    np.testing.assert_array_equal(log.frame["die_temperature_lsb"], raw[:, 9])

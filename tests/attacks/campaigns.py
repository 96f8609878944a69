"""Small campaigns for the attacks, each fitted in a fraction of a second."""

import numpy as np

from attacks.silent import Campaign, Text
from conftest import ROOT

COLUMNS = {
    "bias_temperature": ("temp_case_degc", "gyro_dph"),
    "gyro_pair": ("table_rate_dps", "temp_case_degc", "gyro_a_lsb", "gyro_b_lsb"),
    "inclinometer": ("temp_case_degc", "accel_x_g", "accel_y_g", "gyro_x_dph", "gyro_y_dph"),
    "rate_table": ("table_rate_dps", "table_angle_deg", "temp_case_degc", "gyro_x_lsb"),
    "accelerometer": (
        "temp_case_degc", "inclination_deg", "toolface_deg", "accel_x_g", "accel_y_g", "accel_z_g",
    ),
    "fog_thermal": ("temp_case_degc", "temp_env_degc", "gyro_dph"),
}  # fmt: skip
"""Procedure → columns that are damaged."""


def bias_logs(seed=1, rows=1200, logs=2):
    """Logs of a gyro at rest whose case is heated and cooled at 2 °C/min."""
    generator = np.random.default_rng(seed)
    found = {}
    for number in range(logs):
        time = 2.0 * np.arange(rows)
        case = np.linspace(-20.0, 60.0, rows)
        case = (case if number % 2 == 0 else case[::-1]) + 0.02 * generator.standard_normal(rows)
        bias = 0.5 + 0.01 * case - 1e-4 * case**2 + 0.05 * generator.standard_normal(rows)
        lines = ["time_s,temp_case_degc,gyro_dph"]
        lines += [f"{a:.1f},{b:.3f},{c:.5f}" for a, b, c in zip(time, case, bias, strict=True)]
        found[f"log_{number}.csv"] = Text.parse("\n".join(lines))
    return found


def make(procedure, folder):
    """Campaign of a procedure in a folder of its own."""
    path = folder / procedure
    path.mkdir()
    if procedure == "bias_temperature":
        return Campaign(procedure, bias_logs(), path, (), COLUMNS[procedure])
    logs = {
        found.name: Text.parse(found.read_text(encoding="utf-8"))
        for found in sorted((ROOT / "datasets" / procedure).glob("*.csv"))
    }
    return Campaign(procedure, logs, path, (), COLUMNS[procedure])

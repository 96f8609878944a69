"""Small logs that tests write: a gyro that warms up, sample logs as frames."""

import numpy as np
import pandas as pd

from conftest import ROOT, write_log


def still(folder, count, flat=0.0):
    """Write logs of a static gyro that warms up."""
    rng = np.random.default_rng(5)
    time = np.arange(400.0)
    for k in range(count):
        temp = 20.0 + 0.1 * time * (1.0 + flat * k)
        gyro = 0.5 + 0.01 * temp + 0.02 * rng.standard_normal(time.size)
        write_log(folder / f"warm_{k:02d}.csv", time_s=time, temp_case_degc=temp, gyro_dph=gyro)
    return folder


def warm_up(folder):
    """Write a log of a gyro that warms up."""
    rng, t = np.random.default_rng(4), np.linspace(20.0, 60.0, 4000)
    rate = 2.0 + 0.05 * t - 4e-4 * t**2 + 2e-6 * t**3 + 0.01 * rng.standard_normal(4000)
    frame = pd.DataFrame({"time_s": np.arange(4000.0), "temp_case_degc": t, "gyro_dph": rate})
    folder.mkdir()
    frame.to_csv(folder / "warm.csv", index=False, float_format="%.9g")
    return folder


def sample_logs(name):
    """Frames of a procedure's sample logs; of `bias_temperature` two simulated warm-ups."""
    if name != "bias_temperature":
        paths = sorted((ROOT / "datasets" / name).glob(LOGS.get(name, "*.csv")))
        return {path.name: pd.read_csv(path) for path in paths}
    rng, degc = np.random.default_rng(33), 60.0 - 40.0 * np.exp(-np.arange(300.0) / 90.0)
    turn_on = {"cold.csv": 0.3, "warm.csv": -0.3}
    return {
        file: pd.DataFrame(
            {
                "temp_case_degc": degc,
                "gyro_dph": bias + 0.02 * degc + rng.normal(0.0, 0.05, degc.size),
            }
        )
        for file, bias in turn_on.items()
    }


LOGS = {
    "fog_thermal": "ramp_*_[01][08].csv",
    "gyro_triad": "about_*_25.csv",
    "rate_table": "*m_*.csv",
}
"""Sample logs that are enough for a fit, where it needs less than all."""

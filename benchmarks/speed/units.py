"""A fleet of small devices: their logs, their recipe, and what a fleet has written."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

RECIPE = """\
procedure = "bias_temperature"
[logs]
files = ["*.csv"]
[polynomials]
abscissa = "temp_case_degc"
bias = [{ indication = "gyro_dph", order = 3 }]
"""


def write_units(data: Path, units: int, rows: int) -> list[str]:
    """Write the logs of so many gyros that warm up; return their serials."""
    serials = [f"U{k:04d}" for k in range(units)]
    for k, serial in enumerate(serials):
        rng = np.random.default_rng(k)
        time_s = np.arange(float(rows))
        temperature = 60.0 - 80.0 * np.exp(-3.0 * time_s / rows)
        gyro = (
            0.02 * temperature
            - 1e-4 * temperature**2
            + rng.normal(0.0, 0.05, rows)
            + rng.normal(0.0, 0.1)
        )
        (data / serial).mkdir(parents=True)
        table = np.column_stack((time_s, temperature, gyro))
        np.savetxt(
            data / serial / "w.csv",
            table,
            "%.6f",
            ",",
            header="time_s,temp_case_degc,gyro_dph",
            comments="",
        )
    return serials


def tree(folder: Path) -> dict[str, bytes]:
    """Relative name → bytes of all files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }

"""A fleet of gyros that warm up, small enough to be fitted in a moment."""

import numpy as np

from calibkit import instruments, recipe
from calibkit.fleet import run
from conftest import write_log

RECIPE = """\
procedure = "bias_temperature"
title = "Bias of many"
[logs]
files = ["*.csv"]
[polynomials]
abscissa = "temp_case_degc"
bias = [{ indication = "gyro_dph", order = 1 }]
"""
DAY = "2026-11-21"
ROWS = 40


def unit_log(folder, number, *, offset=0.0):
    """Write a warm-up of one gyro: a bias linear in temperature, 0.01 °/h of noise; return its
    columns.
    """
    rng = np.random.default_rng(number)
    temperature = np.linspace(20.0, 60.0, ROWS)
    gyro = (
        rng.normal(0.5, 0.1)
        + offset
        + rng.normal(0.02, 0.002) * temperature
        + rng.normal(0.0, 0.01, ROWS)
    )
    write_log(
        folder / "warmup.csv",
        time_s=np.arange(float(ROWS)),
        temp_case_degc=temperature,
        gyro_dph=gyro,
    )
    return temperature, gyro


def fleet_logs(data, count):
    """Write the logs of units U000 … and return serial → (temperature, gyro)."""
    return {f"U{k:03d}": unit_log(data / f"U{k:03d}", k) for k in range(count)}


def fit(
    data,
    out,
    *,
    jobs=1,
    keep_going=False,
    date=DAY,
    text=RECIPE,
    progress=instruments.silent,
    address="",
    dry_run=False,
):
    """Run a fleet in this process."""
    source = recipe.Source("bias.toml", text)
    settings = {"jobs": jobs, "address": address, "keep_going": keep_going, "dry_run": dry_run}
    return run.run(source, data, out, date, progress, **settings)


def tree(folder):
    """Relative name → bytes of all files below a folder but those that a killed process left."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not any(part.startswith(".writing-") for part in path.parts)
    }


def left_over(out):
    """What a writer left unfinished."""
    return [path for path in out.rglob(".*") if not path.name.startswith(".highest-")]

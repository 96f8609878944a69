"""A fleet by two processes against the same fleet by one, from files to table, as ratios of the same run.

    PYTHONPATH=. python benchmarks/fleet.py [units] [rows] [repeats]

Each way is a command of its own, start of Python included, one after the other in turn, each into a new folder; both must write
the same bytes. Also printed: what a loop of `calibkit fit` commands would take, from every tenth unit. Exit code 1 where two
processes are less than 1.6 times as fast as one, or the bytes differ.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

TARGET = 1.6
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
        gyro = 0.02 * temperature - 1e-4 * temperature**2 + rng.normal(0.0, 0.05, rows) + rng.normal(0.0, 0.1)
        (data / serial).mkdir(parents=True)
        table = np.column_stack((time_s, temperature, gyro))
        np.savetxt(data / serial / "w.csv", table, "%.6f", ",", header="time_s,temp_case_degc,gyro_dph", comments="")
    return serials


def seconds(*arguments: object) -> float:
    """Wall time of one calibkit command [s]."""
    command = [sys.executable, "-m", "calibkit", *map(str, arguments), "--date", "2026-11-21"]
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def tree(folder: Path) -> dict[str, bytes]:
    """Relative name → bytes of all files below a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def main(units: int = 60, rows: int = 2000, repeats: int = 3) -> int:
    """Print the ratios; 1 where the target is missed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        serials = write_units(folder / "units", units, rows)
        recipe = folder / "bias.toml"
        recipe.write_text(RECIPE, encoding="utf-8")
        ratios, singles = [], []
        for repeat in range(repeats):
            taken = {}
            for jobs in (1, 2):
                out = folder / f"jobs_{jobs}_{repeat}"
                taken[jobs] = seconds("fleet", recipe, "--data", folder / "units", "--out", out, "--jobs", jobs)
            singles.append(taken[1] / units)
            ratios.append(taken[1] / taken[2])
            print(f"one process {taken[1]:.2f} s, two processes {taken[2]:.2f} s, ratio {ratios[-1]:.2f}", flush=True)
        some = serials[::10]
        loop = [
            seconds("fit", recipe, "--data", folder / "units" / s, "--serial", s, "--out", folder / "l") for s in some
        ]
        same = tree(folder / "jobs_1_0") == tree(folder / "jobs_2_0")
    ratio = statistics.median(ratios)
    per_unit = statistics.median(loop) / statistics.median(singles)
    print(f"{units} units of {rows} rows: two processes {ratio:.2f} x one (target {TARGET}); same bytes: {same}")
    print(f"one process of a fleet {per_unit:.1f} x a loop of `calibkit fit` commands")
    return 0 if ratio >= TARGET and same else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))

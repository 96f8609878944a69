"""A fleet by two processes against the same fleet by one, from files to table, as ratios of the same run.

    PYTHONPATH=. python benchmarks/fleet.py [units] [rows] [repeats]

Each way is a command of its own, start of Python included, one after the other in turn, each into a new folder; both must write
the same bytes. Also printed: what a loop of `calibkit fit` commands would take, from every twentieth unit. Exit code 1 where two
processes are less than 1.6 times as fast as one, or the bytes differ. On a machine that others use the wall times say little:
then processor times tell how fast two idle processors would be at best, 2 · one / two.
"""

from __future__ import annotations

import os
import resource
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


def seconds(*arguments: object) -> tuple[float, float]:
    """Wall and processor time [s] of one calibkit command with all its processes."""
    command = [sys.executable, "-m", "calibkit", *map(str, arguments), "--date", "2026-11-21"]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def tree(folder: Path) -> dict[str, bytes]:
    """Relative name → bytes of all files below a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def main(units: int = 100, rows: int = 2000, repeats: int = 3) -> int:
    """Print the ratios; 1 where the target is missed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        serials = write_units(folder / "units", units, rows)
        recipe = folder / "bias.toml"
        recipe.write_text(RECIPE, encoding="utf-8")
        ratios, bounds, singles = [], [], []
        for repeat in range(repeats):
            taken = {}
            for jobs in (1, 2):
                out = folder / f"jobs_{jobs}_{repeat}"
                taken[jobs] = seconds("fleet", recipe, "--data", folder / "units", "--out", out, "--jobs", jobs)
            singles.append(taken[1][1] / units)
            ratios.append(taken[1][0] / taken[2][0])
            bounds.append(2.0 * taken[1][1] / taken[2][1])
            for jobs, (wall, processor) in taken.items():
                print(f"{jobs} process(es): {wall:.2f} s, processor time {processor:.2f} s", flush=True)
        some = serials[::20]
        loop = [
            seconds("fit", recipe, "--data", folder / "units" / s, "--serial", s, "--out", folder / "l") for s in some
        ]
        same = tree(folder / "jobs_1_0") == tree(folder / "jobs_2_0")
    ratio, bound = statistics.median(ratios), statistics.median(bounds)
    per_unit = statistics.median(processor for _, processor in loop) / statistics.median(singles)
    print(f"{units} units of {rows} rows: two processes {ratio:.2f} x one (target {TARGET}); same bytes: {same}")
    print(
        f"by processor time at most {bound:.2f} x; load average now {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors"
    )
    print(f"one process of a fleet takes 1/{per_unit:.1f} of the processor time of a loop of `calibkit fit` commands")
    return 0 if ratio >= TARGET and same else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))

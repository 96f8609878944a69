"""A log larger than memory should be, fitted from disk and in memory: peak resident set, times, and how far coefficients differ.

A simulated gyro on one 5 °C/min ramp of an hour is written as CSV of so many rows (default 40 million, 1.4 GB) unless it is
there, and fitted twice by the command line: with its columns on disk (CALIBKIT_LARGEST_LOG_MB=0) and in memory.

    python benchmarks/out_of_core.py FOLDER                 40 million rows; FOLDER is kept for another run
    python benchmarks/out_of_core.py FOLDER 4000000
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from big_ramps import write

STAGES = ("denoise.json", "drift.json", "drift_rate.json")
LARGEST_DIFFERENCE = 1e-10


def fit(data: Path, out: Path, largest_mb: str) -> tuple[float, float, float]:
    """Fit in a process of its own; peak resident set [MB], wall and processor time [s]."""
    command = [sys.executable, "-m", "calibkit", "fit", "fog_thermal", "--data", str(data), "--serial", "G"]
    command += ["--date", "2026-01-01", "--out", str(out)]
    begun = time.perf_counter()
    environment = os.environ | {"CALIBKIT_LARGEST_LOG_MB": largest_mb}
    child = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 1):
        sys.exit(f"the fit ended with {os.waitstatus_to_exitcode(status)}")
    return usage.ru_maxrss / 1024.0, time.perf_counter() - begun, usage.ru_utime + usage.ru_stime


def numbers(entry: Any) -> list[float]:  # noqa: ANN401 (JSON)
    """Every number of a JSON document, in order."""
    if isinstance(entry, dict):
        return [number for key in sorted(entry) for number in numbers(entry[key])]
    if isinstance(entry, list):
        return [number for member in entry for number in numbers(member)]
    return [float(entry)] if isinstance(entry, int | float) and not isinstance(entry, bool) else []


def difference(one: Path, other: Path) -> float:
    """Largest relative difference of the numbers of two runs' coefficient files."""
    largest = 0.0
    for stage in STAGES:
        pairs = zip(*(numbers(json.loads((run / stage).read_text("utf-8"))) for run in (one, other)), strict=True)
        largest = max([largest, *(abs(a - b) / max(abs(a), abs(b)) for a, b in pairs if a != b)])
    return largest


def main() -> None:
    """Write, fit twice, compare."""
    rows = int(sys.argv[2]) if len(sys.argv) > 2 else 40_000_000
    (log,) = write(Path(sys.argv[1]), rows, (5.0,))
    print(f"{log.stat().st_size / 1e6:.0f} MB, {rows} rows, {8e-6 * 4 * rows:.0f} MB as numbers", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        runs = {name: Path(folder) / name for name in ("on disk", "in memory")}
        for name, largest in (("on disk", "0"), ("in memory", "1e9")):
            peak, wall, cpu = fit(log.parent, runs[name], largest)
            print(f"{name:9s}: peak {peak:5.0f} MB, {wall:6.1f} s, {cpu:6.1f} s of processor", flush=True)
        largest_found = difference(*(run / "G" / "r001" for run in runs.values()))
    print(f"largest relative difference of a number in the coefficient files: {largest_found:.1e}")
    sys.exit(largest_found > LARGEST_DIFFERENCE)


if __name__ == "__main__":
    main()

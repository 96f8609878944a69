"""Memory of `calibkit check` on logs of growing size: peak resident set [MB] and time, one line a
size.

A simulated gyro on one 1 °C/min ramp is written as clean CSV of the sizes asked for (default 0.1,
0.3, 1 GB), sampled as finely as that takes, with one spike in the middle that must be found.

    python benchmarks/check_memory.py 100 300 1000
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

BYTES_A_ROW = 34
BLOCK = 200_000


def write(path: Path, megabytes: float) -> int:
    """Write a log of about so many megabytes and return the line of its spike."""
    rows = int(megabytes * 1e6 / BYTES_A_ROW)
    rng = np.random.default_rng(1)
    duration = 8000.0
    with path.open("w", encoding="ascii") as stream:
        stream.write("time_s,temp_case_degc,temp_env_degc,gyro_dph\n")
        for start in range(0, rows, BLOCK):
            k = np.arange(start, min(start + BLOCK, rows))
            t = k * (duration / rows)
            air = np.clip(-40.0 + (t - 600.0) / 60.0, -40.0, 60.0) + rng.normal(0.0, 0.03, k.size)
            case = np.clip(-40.0 + (t - 900.0) / 60.0, -40.0, 60.0) + rng.normal(0.0, 0.01, k.size)
            gyro = (
                8.0
                + 0.01 * case
                + rng.normal(0.0, 0.5, k.size)
                + np.where(k == rows // 2, 60.0, 0.0)
            )
            stream.write(
                "".join(map("%.6f,%.3f,%.3f,%.4f\n".__mod__, zip(t, case, air, gyro, strict=True)))
            )
    return rows // 2 + 2


def main() -> None:
    """Write, check, measure."""
    for megabytes in map(float, sys.argv[1:] or ("100", "300", "1000")):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "ramp.csv"
            line = write(path, megabytes)
            command = [sys.executable, "-m", "calibkit", "check", "fog_thermal", "--data", folder]
            begun = time.perf_counter()
            with (Path(folder) / "said.txt").open("w", encoding="utf-8") as said:
                child = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
                _, status, usage = os.wait4(child.pid, 0)
            taken = time.perf_counter() - begun
            text = (Path(folder) / "said.txt").read_text(encoding="utf-8")
            found = f"ramp.csv:{line}:" in text
            size, peak = path.stat().st_size / 1e6, usage.ru_maxrss / 1024.0
            code = os.waitstatus_to_exitcode(status)
            print(
                f"{size:7.0f} MB: peak {peak:5.0f} MB, {taken:5.1f} s, exit {code}, spike found:"
                f" {found}",
                flush=True,
            )
            if not found:
                print(text)


if __name__ == "__main__":
    main()

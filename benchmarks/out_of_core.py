"""Logs larger than memory should be, fitted and compensated from disk and in memory: peak resident
set, times, differences.

A simulated log of so many rows (default 40 million, 1.4 GB) is written as CSV unless it is there,
and each procedure fits it twice by the command line: with its columns on disk
(CALIBKIT_LARGEST_LOG_MB=0) and in memory; `apply` then compensates the same log with its run, that
of fog_thermal with a run of the same simulated gyro on eight ramps: one ramp exports no drift. What
differs in the coefficient files is printed; compensated logs must be the same to the byte.

    python benchmarks/out_of_core.py FOLDER                      40 million rows, all procedures
    python benchmarks/out_of_core.py FOLDER 4000000 rate_table   one procedure; FOLDER is kept

Fits end with 0 or 1: what a procedure makes of so plain a log is not asked here.
"""

from __future__ import annotations

import filecmp
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import big_ramps
import big_tables

SETTINGS = {"on disk": "0", "in memory": "1e9"}
SERIES = ("--set", 'logs.files=["*.csv"]', "--set", "dwells.mode=series")
PROCEDURES: dict[str, tuple[str, ...]] = {
    "fog_thermal": (),
    "bias_temperature": (),
    "rate_table": (),
    "accelerometer": SERIES,
}
"""Procedure → options of its fit."""
RAMP_DEGC_MIN = 5.0
LARGEST_DIFFERENCE = 1e-10


def log_of(folder: Path, procedure: str, rows: int) -> Path:
    """Log of so many rows that a procedure fits, alone in its folder."""
    if procedure in big_tables.KINDS:
        return big_tables.write(folder / procedure, procedure, rows)
    return big_ramps.write(folder / "ramp", rows, (RAMP_DEGC_MIN,))[0]


def measured(what: str, place: str, *arguments: str) -> None:
    """Run a command with its columns in a place, in a process of its own, and print peak, wall and
    processor time.
    """
    begun = time.perf_counter()
    environment = os.environ | {"CALIBKIT_LARGEST_LOG_MB": SETTINGS[place]}
    child = subprocess.Popen(
        [sys.executable, "-m", "calibkit", *arguments], env=environment, stdout=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 1):
        sys.exit(f"{what} ended with {os.waitstatus_to_exitcode(status)}")
    wall, cpu = time.perf_counter() - begun, usage.ru_utime + usage.ru_stime
    print(
        f"{what:22s} {place:9s}: peak {usage.ru_maxrss / 1024.0:5.0f} MB, {wall:6.1f} s, {cpu:6.1f}"
        " s of processor",
        flush=True,
    )


def numbers(entry: Any) -> list[float]:  # noqa: ANN401 (JSON)
    """Every number of a JSON document, in order."""
    if isinstance(entry, dict):
        return [number for key in sorted(entry) for number in numbers(entry[key])]
    if isinstance(entry, list):
        return [number for member in entry for number in numbers(member)]
    return [float(entry)] if isinstance(entry, int | float) and not isinstance(entry, bool) else []


def difference(one: Path, other: Path) -> float:
    """Largest relative difference of the numbers of two runs' coefficient files."""
    stages = sorted(path.name for path in one.glob("*.json") if path.name != "run.json")
    largest = 0.0
    for stage in stages:
        pairs = zip(
            *(numbers(json.loads((run / stage).read_text("utf-8"))) for run in (one, other)),
            strict=True,
        )
        largest = max([largest, *(abs(a - b) / max(abs(a), abs(b)) for a, b in pairs if a != b)])
    same = all((one / stage).read_bytes() == (other / stage).read_bytes() for stage in stages)
    print(
        f"{'':22s} {', '.join(stages)}:"
        f" {'the same bytes' if same else f'differ by {largest:.1e} at most'}",
        flush=True,
    )
    return largest


def compared(procedure: str, log: Path, out: Path) -> bool:
    """Fit and compensate from disk and in memory; whether both came out alike."""
    runs = {place: out / place for place in SETTINGS}
    for place, run in runs.items():
        options = (
            "--data",
            str(log.parent),
            "--serial",
            "G",
            "--date",
            "2026-01-01",
            "--out",
            str(run),
        )
        measured(f"fit {procedure}", place, "fit", procedure, *options, *PROCEDURES[procedure])
    alike = difference(*(run / "G" / "r001" for run in runs.values())) <= LARGEST_DIFFERENCE
    run = str(
        _of_eight_ramps(out) if procedure == "fog_thermal" else runs["in memory"] / "G" / "r001"
    )
    written = {place: out / f"{place}.csv" for place in SETTINGS}
    for place, path in written.items():
        measured(f"apply {procedure}", place, "apply", run, "--data", str(log), "--out", str(path))
    same = filecmp.cmp(*written.values(), shallow=False)
    print(f"{'':22s} compensated logs: {'the same bytes' if same else 'they differ'}", flush=True)
    return alike and same


def _of_eight_ramps(out: Path) -> Path:
    """Run of the simulated gyro whose drift the big log shows too."""
    logs = str(out / "ramps")
    for words in (
        ("simulate", "fog_thermal", "--seed", str(big_ramps.SEED), "--out", logs),
        ("fit", "fog_thermal", "--data", logs, "--serial", "E", "--out", str(out)),
    ):
        command = [sys.executable, "-m", "calibkit", *words]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return out / "E" / "r001"


def main() -> None:
    """Write, fit, compensate, compare."""
    folder, *more = sys.argv[1:]
    rows = int(more[0]) if more else 40_000_000
    alike = True
    for procedure in more[1:] or PROCEDURES:
        log = log_of(Path(folder), procedure, rows)
        print(f"{procedure}: {log.stat().st_size / 1e6:.0f} MB, {rows} rows", flush=True)
        with tempfile.TemporaryDirectory() as out:
            alike &= compared(procedure, log, Path(out))
    sys.exit(not alike)


if __name__ == "__main__":
    main()

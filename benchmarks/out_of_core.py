"""Logs larger than memory should be, fitted, validated and compensated from disk and in memory:
peak resident set, times, differences.

A simulated log of so many rows (default 40 million, 1.4 GB) is written as CSV unless it is there,
and each procedure fits it twice by the command line: with its columns on disk
(CALIBKIT_LARGEST_LOG_MB=0) and in memory. `validate` and `apply` then take the same log with a run
of shorter ones: of the same simulated gyro on eight ramps, or of a tenth of the rows. What differs
in the coefficient files is printed; validations and compensated logs must be the same to the byte.

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
ONE_RAMP = ("--set", "drift.model=gradient_rate", "--set", "drift.order=0")
PROCEDURES: dict[str, tuple[str, ...]] = {
    "fog_thermal": ONE_RAMP,
    "bias_temperature": (),
    "rate_table": (),
    "accelerometer": SERIES,
    "thermal": ("--set", 'thermal.channels=["gyro_x_dph","accel_x_g"]'),
    "gyro_noise": (),
}
"""Procedure → options of its fit."""
NOT_APPLIED = {"gyro_noise"}
"""Procedures whose runs hold nothing to compensate with."""
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


def compared(procedure: str, log: Path, rows: int, out: Path) -> bool:
    """Fit, validate and compensate from disk and in memory; whether both came out alike."""
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
    run = str(_run_of_shorter(procedure, rows // 10, out))
    commands = {"validate": str(log.parent), "apply": str(log)}
    for command, data in commands.items():
        if command == "apply" and procedure in NOT_APPLIED:
            continue
        written = {place: out / f"{command} {place}" for place in SETTINGS}
        for place, path in written.items():
            words = (command, run, "--data", data, "--out", str(path))
            measured(f"{command} {procedure}", place, *words)
        same = filecmp.cmp(*written.values(), shallow=False)
        print(f"{'':22s} {'the same bytes' if same else 'the files differ'}", flush=True)
        alike &= same
    return alike


def _run_of_shorter(procedure: str, rows: int, out: Path) -> Path:
    """Run of other logs of what the big log shows: of so many rows, or of eight ramps."""
    logs = out / "shorter"
    options = PROCEDURES[procedure]
    if procedure in big_tables.KINDS:
        big_tables.write(logs, procedure, rows, big_tables.SEED + 1)
    else:
        _run("simulate", "fog_thermal", "--seed", str(big_ramps.SEED), "--out", str(logs))
        options = ()
    _run("fit", procedure, "--data", str(logs), "--serial", "E", "--out", str(out), *options)
    return out / "E" / "r001"


def _run(*words: str) -> None:
    """Run a command that ends with 0 or 1."""
    command = [sys.executable, "-m", "calibkit", *words]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(done.stderr)


def main() -> None:
    """Write, fit, compensate, compare."""
    folder, *more = sys.argv[1:]
    rows = int(more[0]) if more else 40_000_000
    alike = True
    for procedure in more[1:] or PROCEDURES:
        log = log_of(Path(folder), procedure, rows)
        print(f"{procedure}: {log.stat().st_size / 1e6:.0f} MB, {rows} rows", flush=True)
        with tempfile.TemporaryDirectory() as out:
            alike &= compared(procedure, log, rows, Path(out))
    sys.exit(not alike)


if __name__ == "__main__":
    main()

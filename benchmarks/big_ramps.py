"""Logs of a simulated gyro as large as loggers write them, the same for the same seed; time and
memory of `calibkit fit` on them, beside the calibkit of another interpreter.

Gyro, chamber and heat are those of `lumped_gyro`; case and air are read, and the white noise of the
indication is drawn, at every row. Either four heating ramps (1, 5, 8, 10 °C/min) of an hour at
1 kHz, 14.4 million rows, or one log of ramps and soaks between −40 and 60 °C at 1 Hz.

    python benchmarks/big_ramps.py FOLDER                          writes the four ramps
    python benchmarks/big_ramps.py FOLDER --rows 900000 --rate 5   one of them, sampled at 250 Hz
    python benchmarks/big_ramps.py FOLDER --fit fog_thermal        writes and fits them
    python benchmarks/big_ramps.py FOLDER --hours 300 --fit thermal [--python OTHER/bin/python]

With --python both fit in turn, --turns times. Exit code 1 where a log of many hours takes more than
0.6 GB, or the median of the ratios of wall time is above 1.1.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lumped_gyro import (
    ANGLE_RANDOM_WALK,
    CASE_NOISE_DEGC,
    CASE_RESOLUTION_DEGC,
    COLD_DEGC,
    EARTH_RATE_DPH,
    HOT_DEGC,
    LATITUDE_DEG,
    LumpedGyro,
)
from speed.commands import Spent, spent
from speed.pairs import ROOT

from calibkit.simulate import noise
from calibkit.simulate.chamber import Chamber, Programme

if TYPE_CHECKING:
    from collections.abc import Sequence

SEED = 7
DURATION_S = 3600
SOAK_S = 600.0
RATES = (1.0, 5.0, 8.0, 10.0)
HEADER = "time_s,temp_case_degc,temp_env_degc,gyro_dph\n"
BLOCK = 100_000
MOST_BYTES, MOST_TIMES = 0.6e9, 1.1
OPTIONS = {"thermal": ("--set", 'thermal.channels=["gyro_dph"]')}
"""Procedure → options of its fit."""


def write(folder: Path, rows: int = 3_600_000, rates: Sequence[float] = RATES) -> list[Path]:
    """Write one log of so many rows a heating rate [°C/min] unless it is there; returns the
    files.
    """
    paths = []
    for rate in rates:
        ramp_s = min((HOT_DEGC - COLD_DEGC) / rate * 60.0, DURATION_S - SOAK_S)
        # the chamber runs on when the log ends
        after = DURATION_S - SOAK_S - ramp_s + 60.0
        end = COLD_DEGC + rate * ramp_s / 60.0
        soaks = {"soak_before_s": SOAK_S, "soak_after_s": after}
        paths.append(folder / f"ramp_heating_{rate:02g}.csv")
        programme = Programme.ramp(COLD_DEGC, end, rate, **soaks)
        _write_log(paths[-1], programme, DURATION_S / rows, rows, round(1000.0 * rate))
    return paths


def write_hours(folder: Path, hours: float) -> Path:
    """Write one log of so many hours at 1 Hz, an hour at each of many temperatures, unless it is
    there.
    """
    rng = np.random.default_rng([SEED, 300])
    time_s, set_degc, end = [0.0], [25.0], 3600.0 * hours
    while time_s[-1] < end + 60.0:
        degc = float(rng.uniform(COLD_DEGC, HOT_DEGC))
        ramp_s = abs(degc - set_degc[-1]) / rng.uniform(0.5, 5.0) * 60.0
        time_s += [time_s[-1] + 3600.0, time_s[-1] + 3600.0 + ramp_s]
        set_degc += [set_degc[-1], degc]
    path = folder / f"hours_{hours:g}.csv"
    _write_log(path, Programme(tuple(time_s), tuple(set_degc), 0.0), 1.0, round(end), 300)
    return path


def _write_log(path: Path, programme: Programme, step_s: float, rows: int, seed: int) -> None:
    """Write one log, a block of rows at a time."""
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part")
    device, chamber = LumpedGyro.draw(SEED), Chamber()
    rng = np.random.default_rng([SEED, seed])
    seconds, set_degc = programme.set_points()
    air = chamber.air(set_degc, rng)
    heat = device.heat_flow(air, float(set_degc[0]))
    bias = EARTH_RATE_DPH * np.sin(np.radians(LATITUDE_DEG)) + device.bias_dph
    bias = bias + device.drift(air, heat)[0] + noise.flicker(device.flicker_dph, seconds.size, rng)
    line = f"%.{max(4, math.ceil(-math.log10(step_s)))}f,%.4f,%.3f,%.5f\n"
    with unfinished.open("w", encoding="ascii") as stream:
        stream.write(HEADER)
        for start in range(0, rows, BLOCK):
            t = np.arange(start, min(start + BLOCK, rows)) * step_s
            true_case, true_air = np.interp(t, seconds, heat[0]), np.interp(t, seconds, air)
            case = noise.reading(true_case, CASE_RESOLUTION_DEGC, CASE_NOISE_DEGC, rng)
            env = noise.reading(true_air, 0.01, chamber.reading_noise_degc, rng)
            white = noise.angle_random_walk(ANGLE_RANDOM_WALK, t.size, rng, interval_s=step_s)
            gyro = np.interp(t, seconds, bias) + white
            lists = (values.tolist() for values in (t, case, env, gyro))
            stream.write("".join(map(line.__mod__, zip(*lists, strict=True))))
    unfinished.rename(path)


def fit(python: str, procedure: str, logs: Sequence[Path]) -> Spent:
    """Time and memory of a fit of some logs by the calibkit that an interpreter finds."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "logs"
        folder.mkdir()
        for log in logs:
            (folder / log.name).symlink_to(log.resolve())
        command = [python, "-m", "calibkit", "fit", procedure, "--data", folder, "--serial", "G"]
        command += ["--out", Path(name) / "runs", "--date", "2026-11-21"]
        command += OPTIONS.get(procedure, ())
        # another interpreter takes the calibkit that it has installed: no folder stands before it
        root = ROOT if python == sys.executable else Path(name)
        return spent(command, accepted=(0, 1), root=root)


def measure(
    procedure: str, logs: Sequence[Path], other: str | None, turns: int
) -> tuple[int, float]:
    """Fit here and by another interpreter in turn and print what each turn takes; the largest peak
    here [bytes], and the median of the ratios of wall time.
    """
    peaks, times = [], []
    for _ in range(turns):
        both = [fit(python, procedure, logs) for python in (sys.executable, other) if python]
        text = "; ".join(
            f"{part.wall:.1f} s, {part.cpu:.1f} s of processor, peak {part.peak / 1e9:.3f} GB"
            for part in both
        )
        peaks.append(both[0].peak)
        if other:
            times.append(both[0].wall / both[1].wall)
            text += f": {times[-1]:.3f} times as long"
        print(text, flush=True)
    return max(peaks), statistics.median(times) if times else 0.0


def main() -> int:
    """Write the logs that the command line asks for and name them; fit them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rows", type=int, default=3_600_000, help="of a ramp")
    parser.add_argument("--rate", type=float, action="append", help="of a ramp [°C/min]")
    parser.add_argument("--hours", type=float, help="one log of so many hours at 1 Hz")
    parser.add_argument("--fit", help="procedure that fits the logs")
    parser.add_argument("--python", help="interpreter with another calibkit")
    parser.add_argument("--turns", type=int, default=3)
    asked = parser.parse_args()
    if asked.hours:
        logs = [write_hours(asked.folder, asked.hours)]
    else:
        logs = write(asked.folder, asked.rows, asked.rate or RATES)
    for log in logs:
        print(log, log.stat().st_size)
    if not asked.fit:
        return 0
    peak, times = measure(asked.fit, logs, asked.python, asked.turns)
    missed = ["memory"] * bool(asked.hours and peak > MOST_BYTES) + ["time"] * (times > MOST_TIMES)
    beside = f"median {times:.3f} times as long; " if times else ""
    print(f"{beside}missed: {', '.join(missed) or 'nothing'}")
    return bool(missed)


if __name__ == "__main__":
    sys.exit(main())

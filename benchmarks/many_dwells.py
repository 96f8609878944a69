"""Time and memory of `calibkit fit` over the number of dwells: 9 soaks of 42 attitudes, each held
once, 3, 10, 30 and 106 times.

    PYTHONPATH=. python benchmarks/many_dwells.py [HOLDS …]

A triad is simulated on a table whose attitudes are off by 0.003° each, with a zero of its own in
each soak, in the attitudes of the sample log. Printed of each log: dwells, processor time over that
of the sample's size, peak memory, and how the time grows with the dwells (the slope of log t over
log n, the time of starting Python and reading included). Exit code 1 where 11,340 dwells take more
than 3 times as long as 378, or 0.4 GB, or the slope is above 1.1.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))

from intervals.physics import triad as physics  # noqa: E402 the folder is found first

SOAKS_DEGC = np.linspace(-40.0, 120.0, 9)
ATTITUDES = 42
HOLDS = (1, 3, 10, 30, 106)
NOISE_G, SOAK_ZERO_G, INDEX_DEG, MISALIGNED_RAD = 20e-6, 30e-6, 0.003, 3e-3
MOST_TIMES, MOST_GB, MOST_GROWTH = 3.0, 0.4, 1.1
SEED = 34


def simulate(holds: int) -> pd.DataFrame:
    """Means of the dwells of a campaign, soak by soak."""
    rng = np.random.default_rng(SEED)
    sample = pd.read_csv(ROOT / "datasets/accelerometer/positions.csv", nrows=ATTITUDES)
    attitudes = sample[["inclination_deg", "toolface_deg"]].to_numpy()
    triad = physics.draw(rng, np.eye(3) + rng.normal(0.0, MISALIGNED_RAD, (3, 3)))
    shape = len(SOAKS_DEGC), holds, ATTITUDES
    soak, _, attitude = (number.ravel() for number in np.indices(shape))
    degc = SOAKS_DEGC[soak] + rng.normal(0.0, 0.2, soak.size)
    down = physics.gravity(attitudes[attitude], np.array([0.0, 0.0, 1.0]))
    turn = np.radians(INDEX_DEG) * rng.normal(size=(ATTITUDES, 3))[attitude]
    zero = SOAK_ZERO_G * rng.normal(size=(len(SOAKS_DEGC), 3))[soak]
    indication = triad.indication(
        down + np.cross(turn, down), degc, zero, np.zeros(zero.shape), np.zeros(3)
    )
    indication += NOISE_G * rng.normal(size=indication.shape)
    frame = pd.DataFrame({"temp_case_degc": degc})
    frame[["inclination_deg", "toolface_deg"]] = attitudes[attitude]
    frame[[f"accel_{axis}_g" for axis in "xyz"]] = indication
    return frame


def measure(folder: Path, holds: int) -> tuple[int, float, float]:
    """Dwells, processor time [s] and peak memory [GB] of the fit of one campaign."""
    logs = folder / f"holds_{holds}"
    logs.mkdir()
    frame = simulate(holds)
    frame.to_csv(logs / "positions.csv", index=False, float_format="%.8f")
    command = [sys.executable, "-m", "calibkit", "fit", str(ROOT / "recipes/accelerometer.toml")]
    command += ["--data", str(logs), "--serial", "A1", "--out", str(folder / f"runs_{holds}")]
    with (folder / f"printed_{holds}.txt").open("w", encoding="utf-8") as printed:
        child = subprocess.Popen(command, stdout=printed, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) > 1:
        raise SystemExit((folder / f"printed_{holds}.txt").read_text(encoding="utf-8"))
    return len(frame), usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0**2


def main() -> int:
    """Measure every size, print a line of each, and judge them."""
    holds = [int(text) for text in sys.argv[1:]] or list(HOLDS)
    with tempfile.TemporaryDirectory() as folder:
        rows = [measure(Path(folder), count) for count in holds]
    dwells, seconds, peak = np.array(rows).T
    times = seconds / seconds[0]
    growth = np.gradient(np.log(seconds), np.log(dwells)) if len(rows) > 1 else [np.nan]
    print("dwells  processor s  times the first  peak GB  growth")
    for row in zip(dwells, seconds, times, peak, growth, strict=True):
        print("{:6.0f}  {:11.2f}  {:15.2f}  {:7.2f}  {:6.2f}".format(*row))
    judged = dwells <= ATTITUDES * len(SOAKS_DEGC) * 30
    slope = float(np.polyfit(np.log(dwells), np.log(seconds), 1)[0]) if len(rows) > 1 else 0.0
    missed = [
        *["time"] * bool(np.any(times[judged] > MOST_TIMES)),
        *["memory"] * bool(np.any(peak[judged] > MOST_GB)),
        *["growth"] * (slope > MOST_GROWTH),
    ]
    print(f"slope over all sizes {slope:.2f}; missed: {', '.join(missed) or 'nothing'}")
    return bool(missed)


if __name__ == "__main__":
    sys.exit(main())

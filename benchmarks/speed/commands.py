"""Rows of the table that compare whole commands: processes of their own, their time and the peak of
their memory.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import lumped_gyro
import numpy as np

from speed import units
from speed.goals import Goal, Line
from speed.pairs import ONE_THREAD, ROOT, Spread, Worker

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

    Python = Callable[[str], Path]
    """Interpreter of a peer by its name."""

BYTES = 1024
LAUNCHER = """
import ctypes, os, sys, time
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(36, 1)  # what a command leaves to end by itself is counted too
start = time.perf_counter()
beside = [(os.POSIX_SPAWN_DUP2, 2, 1)]
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=beside)
_, status, usage = os.wait4(child, 0)
wall, cpu = time.perf_counter() - start, usage.ru_utime + usage.ru_stime
while True:
    try:
        left = os.wait4(-1, 0)[2]
    except ChildProcessError:
        break
    cpu += left.ru_utime + left.ru_stime
print(os.waitstatus_to_exitcode(status), wall, cpu, usage.ru_maxrss)
"""
LEAST = 10_000
"""Rows of four ramps at an interval that a fit accepts."""
RATES = (1.0, 2.0, 5.0, 10.0)
READ = "import polars as pl, sys\nfor path in sys.argv[1:]: pl.read_csv(path)"
CALIBKIT = (sys.executable, "-m", "calibkit")
DATE = ("--date", "2026-11-21")
PINNED = "lagged"
"""Family of drift models that is fitted beside a read of the logs: the slowest of 0.1.0."""


@dataclass(frozen=True, slots=True)
class Spent:
    """What a process took, with its children: wall and processor time [s], peak resident set
    [bytes].
    """

    wall: float
    cpu: float
    peak: int


def spent(
    command: Sequence[object],
    *,
    accepted: Sequence[int] = (0,),
    compiled: str = "",
    root: Path = ROOT,
) -> Spent:
    """Run a command to its end; raises RuntimeError for an exit code that is not accepted.

    `compiled` is a folder for byte code where starting counts: an installed package has its own;
    `root` holds the calibkit that is run.
    """
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(root)}
    if compiled:
        environment["PYTHONPYCACHEPREFIX"] = compiled
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
    with tempfile.TemporaryFile() as said:
        # a child's peak begins with that of the process that started it: a small one must
        asked = [sys.executable, "-I", "-S", "-c", LAUNCHER, *(str(part) for part in command)]
        # `python -m` takes the package of the folder that it is run in before that of PYTHONPATH
        done = subprocess.run(
            asked,
            stdout=subprocess.PIPE,
            stderr=said,
            env=environment,
            check=True,
            text=True,
            cwd=root,
        )
        code, wall, cpu, peak = map(float, done.stdout.split())
        if code not in accepted:
            said.seek(0)
            text = said.read().decode(errors="replace")[-2000:]
            raise RuntimeError(f"{Path(str(command[0])).name} ended with {code:.0f}: {text}")
    return Spent(wall, cpu, round(peak) * BYTES)


def line(
    goal: Goal,
    rows: int,
    pairs: Sequence[tuple[Spent, Spent]],
    *,
    digits: float | None = None,
    memory: bool = True,
) -> Line:
    """Ratios of turns of calibkit and peer, each turn (ours, theirs); `memory` where a peak tells
    something.
    """
    ratios = {
        clock: Spread.of(
            [
                (
                    getattr(b, clock) / getattr(a, clock)
                    if goal.faster
                    else getattr(a, clock) / getattr(b, clock)
                )
                for a, b in pairs
            ]
        )
        for clock in (("cpu", "wall", "peak") if memory else ("cpu", "wall"))
    }
    middle = sorted(pairs, key=lambda pair: pair[0].wall)[len(pairs) // 2]
    seconds = (middle[0].wall, middle[1].wall)
    peaks = (middle[0].peak, middle[1].peak) if memory else (0, 0)
    return Line(goal.name, rows, ratios, seconds, peaks, digits)


def ramps(rows: int) -> dict[str, dict[str, Array]]:
    """Four heating ramps of a simulated gyro, 27,600 s with their soaks, `rows` samples in all:
    name → columns.
    """
    programmes = {
        f"{programme.rate_degc_per_min:g}_degc_per_min": programme
        for programme in lumped_gyro.ramps(RATES).values()
        if programme.rate_degc_per_min > 0.0
    }
    gyro = lumped_gyro.LumpedGyro.draw(7)
    simulated = lumped_gyro.record(gyro, programmes, 7)
    interval = sum(log.frame["time_s"].iloc[-1] for log in simulated.values()) / rows
    rng = np.random.default_rng(7)
    noise = 60.0 * lumped_gyro.ANGLE_RANDOM_WALK / np.sqrt(interval)
    logs = {}
    for name, log in simulated.items():
        at = log.frame["time_s"].to_numpy()
        t = np.arange(0.0, at[-1], interval)
        case = np.interp(t, at, log.case) + rng.normal(0.0, lumped_gyro.CASE_NOISE_DEGC, t.size)
        air = np.interp(t, at, log.air) + rng.normal(0.0, 0.03, t.size)
        drift = np.interp(t, at, log.drift)
        gyro_dph = drift + gyro.bias_dph + 8.5 + rng.normal(0.0, noise, t.size)
        columns = {"time_s": t, "temp_case_degc": case, "temp_env_degc": air, "gyro_dph": gyro_dph}
        logs[name] = columns
    return logs


def written(folder: Path, rows: int, python: Python) -> tuple[list[Path], int]:
    """Write four ramps by the peer, which is quick at it; their files, and how many rows they
    have.
    """
    paths, count = [], 0
    with Worker(python("polars"), "theirs") as peer:
        for name, columns in ramps(rows).items():
            files = {}
            for column, values in columns.items():
                files[column] = str(folder / f"{column}.npy")
                np.save(files[column], values)
            paths.append(folder / "logs" / f"{name}.csv")
            paths[-1].parent.mkdir(exist_ok=True)
            peer.ask("load", side="write_log", files=files, settings={"path": str(paths[-1])})
            peer.ask("once", times=1)
            count += len(columns["time_s"])
            for file in files.values():
                Path(file).unlink()
    return paths, count


def fit(goals: Sequence[Goal], rows: int, turns: int, python: Python) -> list[Line]:
    """`calibkit fit` of one family of drift models on four ramps beside a process that reads the
    same files with polars, one after the other.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths, count = written(folder, rows, python)
        logs = ("--data", folder / "logs", "--serial", "G", *DATE)
        command = [*CALIBKIT, "fit", "fog_thermal", *logs, "--set", f"drift.model={PINNED}"]
        pairs = []
        for turn in range(turns + 1):
            out = folder / f"out_{turn}"
            ours = spent([*command, "--out", out], accepted=(0, 1), compiled=name)
            theirs = spent([python("polars"), "-c", READ, *paths], compiled=name)
            if turn:  # the first one warms the files up
                pairs.append((ours, theirs))
        found = json.loads(
            (folder / "out_0" / "G" / "r001" / "run.json").read_text(encoding="utf-8")
        )
        read = sum(entry["rows"] for entry in found["inputs"])
    if read != count:
        raise RuntimeError(f"{read} rows fitted, {count} written")
    return [line(goal, count, pairs) for goal in goals]


def help_text(goals: Sequence[Goal], rows: int, turns: int, python: Python) -> list[Line]:
    """`calibkit --help` beside Python that does nothing, both from byte code as an installed
    package is.
    """
    del python
    bare = [sys.executable, "-c", "pass"]
    with tempfile.TemporaryDirectory() as folder:
        pairs = [
            (spent([*CALIBKIT, "--help"], compiled=folder), spent(bare, compiled=folder))
            for _ in range(10 * turns)
        ]
    return [line(goal, rows, pairs[2:], memory=False) for goal in goals]


def pool(goals: Sequence[Goal], rows: int, turns: int, python: Python) -> list[Line]:
    """A fleet of `rows` units by two processes beside the same fleet by one; both must write the
    same bytes.

    Two processes on two idle processors: `cpu` says how fast they would be at best, 2 · one / two.
    """
    del python
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        units.write_units(folder / "units", rows, 2000)
        recipe = folder / "bias.toml"
        recipe.write_text(units.RECIPE, encoding="utf-8")
        command = [*CALIBKIT, "fleet", recipe, "--data", folder / "units", *DATE]
        pairs = []
        for turn in range(turns):
            both = [
                spent([*command, "--jobs", jobs, "--out", folder / f"{turn}_{jobs}"])
                for jobs in (2, 1)
            ]
            pairs.append((both[0], both[1]))
        same = units.tree(folder / "0_1") == units.tree(folder / "0_2")
    if not same:
        raise RuntimeError("one and two processes wrote different bytes")
    halves = [(Spent(a.wall, a.cpu / 2.0, a.peak), b) for a, b in pairs]
    return [line(goal, rows, halves, digits=17.0, memory=False) for goal in goals]


@dataclass(frozen=True, slots=True)
class Command:
    """Goals that one comparison of commands answers, and the sizes it is run at."""

    goals: tuple[Goal, ...]
    run: Callable[[Sequence[Goal], int, int, Python], list[Line]]
    sizes: Callable[[Sequence[int]], list[int]]


def with_all_rows(rows: Sequence[int]) -> list[int]:
    """The four ramps of the target in place of the largest size."""
    return [14_400_000 if size == 10_000_000 else max(size, LEAST) for size in rows]


COMMANDS = (
    Command(
        (
            Goal(
                "fit",
                "`calibkit fit`, four ramps, time",
                "polars",
                2.5,
                14_400_000,
                reach=2.0,
                faster=False,
                clock="wall",
                note=(
                    "a whole process, of one family of drift models, beside one that only reads the"
                    " same files, both from byte code as installed packages are"
                ),
            ),
            Goal(
                "fit_memory",
                "`calibkit fit`, four ramps, memory",
                "polars",
                1.3,
                14_400_000,
                faster=False,
                clock="peak",
                note=(
                    "peak of a whole process beside one that reads the files one after the other"
                    " and keeps none"
                ),
            ),
        ),
        fit,
        with_all_rows,
    ),
    Command(
        (Goal("help", "`calibkit --help`", "bare Python", 6.0, 1, faster=False, rows_are="call"),),
        help_text,
        lambda _: [1],
    ),
    Command(
        (
            Goal(
                "pool",
                "fleet from files, two processes",
                "one process",
                1.6,
                100,
                digits=17.0,
                clock="wall",
                rows_are="units",
                note="processor time: 2 · one / two, what two idle processors would do at best",
            ),
        ),
        pool,
        lambda rows: [4] if max(rows) <= LEAST else [20, 100] if max(rows) > 100_000 else [20],
    ),
)

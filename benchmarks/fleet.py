"""A fleet by two processes against the same fleet by one, from files to table, as ratios of the
same run.

    PYTHONPATH=. python benchmarks/fleet.py [units] [rows] [repeats]

Each way is a command of its own, start of Python included, one after the other in turn, each into a
new folder; both must write the same bytes. How fast two processes can be here at all is measured in
the same run: two that share nothing, warm before the clock starts, each with half of the units,
against one that has all. Two processors that are two halves of a core, or that others use, hold
that under 2; what the fleet reaches of it is its own doing. Also printed: what a loop of `calibkit
fit` commands would take, from every twentieth unit. Exit code 1 where two processes are less than
1.6 times as fast as one, or the bytes differ.
"""

from __future__ import annotations

import contextlib
import ctypes
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
MOST_ALONE = 40
"""Units of the processes that share nothing."""
RECIPE = """\
procedure = "bias_temperature"
[logs]
files = ["*.csv"]
[polynomials]
abscissa = "temp_case_degc"
bias = [{ indication = "gyro_dph", order = 3 }]
"""


PURE = """
import sys
from pathlib import Path
from calibkit import recipe
from calibkit.fleet import device
text, data, out, *serials = sys.argv[1:]
plan = device.Plan(recipe.Source("bias.toml", text), Path(data), Path(out), "2026-11-21")
for number, serial in enumerate(serials):
    if number == 1:
        print("ready", flush=True)
        input()
    assert isinstance(device.fit_device(plan, serial), device.Row)
print("done", flush=True)
input()
"""
"""A process that fits its first unit, waits to be told, and fits the others."""
ADOPT_ORPHANS = 36
"""PR_SET_CHILD_SUBREAPER of Linux: the processes that a command leaves to end by themselves are
waited for, and counted, here.
"""


def write_units(data: Path, units: int, rows: int) -> list[str]:
    """Write the logs of so many gyros that warm up; return their serials."""
    serials = [f"U{k:04d}" for k in range(units)]
    for k, serial in enumerate(serials):
        rng = np.random.default_rng(k)
        time_s = np.arange(float(rows))
        temperature = 60.0 - 80.0 * np.exp(-3.0 * time_s / rows)
        gyro = (
            0.02 * temperature
            - 1e-4 * temperature**2
            + rng.normal(0.0, 0.05, rows)
            + rng.normal(0.0, 0.1)
        )
        (data / serial).mkdir(parents=True)
        table = np.column_stack((time_s, temperature, gyro))
        np.savetxt(
            data / serial / "w.csv",
            table,
            "%.6f",
            ",",
            header="time_s,temp_case_degc,gyro_dph",
            comments="",
        )
    return serials


def seconds(*arguments: object) -> tuple[float, float]:
    """Wall and processor time [s] of one calibkit command with all its processes."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(ADOPT_ORPHANS, 1)
    command = [sys.executable, "-m", "calibkit", *map(str, arguments), "--date", "2026-11-21"]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall = time.perf_counter() - start
    with contextlib.suppress(ChildProcessError):
        while True:
            os.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def alone(crew: int, data: Path, out: Path, serials: list[str]) -> float:
    """Wall time [s] of so many processes that know nothing of each other and share units evenly;
    each is warm before.
    """
    out.mkdir()
    command = [sys.executable, "-c", PURE, RECIPE, str(data), str(out)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    pipes = {
        "stdin": subprocess.PIPE,
        "stdout": subprocess.PIPE,
        "text": True,
        "bufsize": 1,
        "env": environment,
    }
    with contextlib.ExitStack() as stack:
        workers = [
            stack.enter_context(
                subprocess.Popen([*command, serials[k], *serials[crew + k :: crew]], **pipes)
            )
            for k in range(crew)
        ]

        def told(word: str) -> None:
            for worker in workers:
                if worker.stdout.readline().strip() != word:
                    raise RuntimeError("a process that fits units alone ended early")

        def go_on() -> None:
            for worker in workers:
                worker.stdin.write("\n")

        told("ready")
        start = time.perf_counter()
        go_on()
        told("done")
        taken = time.perf_counter() - start
        go_on()
    return taken


def tree(folder: Path) -> dict[str, bytes]:
    """Relative name → bytes of all files below a folder."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def main(units: int = 100, rows: int = 2000, repeats: int = 3) -> int:
    """Print the ratios; 1 where the target is missed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        serials = write_units(folder / "units", units, rows)
        recipe = folder / "bias.toml"
        recipe.write_text(RECIPE, encoding="utf-8")
        ratios, ceilings, bounds, singles = [], [], [], []
        for repeat in range(repeats):
            taken = {}
            for jobs in (1, 2):
                out = folder / f"jobs_{jobs}_{repeat}"
                taken[jobs] = seconds(
                    "fleet", recipe, "--data", folder / "units", "--out", out, "--jobs", jobs
                )
            some = serials[: MOST_ALONE + 2]
            pure = [
                alone(crew, folder / "units", folder / f"alone_{crew}_{repeat}", some)
                for crew in (1, 2)
            ]
            # one that is warm has a unit more before it than two have
            ceilings.append(pure[0] / (len(some) - 1) / (pure[1] / (len(some) - 2)))
            singles.append(taken[1][1] / units)
            ratios.append(taken[1][0] / taken[2][0])
            bounds.append(2.0 * taken[1][1] / taken[2][1])
            for jobs, (wall, processor) in taken.items():
                print(
                    f"{jobs} process(es): {wall:.2f} s, processor time {processor:.2f} s",
                    flush=True,
                )
        loop = [
            seconds(
                "fit", recipe, "--data", folder / "units" / s, "--serial", s, "--out", folder / "l"
            )
            for s in serials[::20]
        ]
        same = tree(folder / "jobs_1_0") == tree(folder / "jobs_2_0")
    ratio, ceiling, bound = (statistics.median(found) for found in (ratios, ceilings, bounds))
    per_unit = statistics.median(processor for _, processor in loop) / statistics.median(singles)
    print(
        f"{units} units of {rows} rows: two processes {ratio:.2f} x one (target {TARGET}); same"
        f" bytes: {same}"
    )
    print(
        f"two processes that share nothing {ceiling:.2f} x one here: the fleet reaches"
        f" {ratio / ceiling:.0%} of that"
    )
    print(
        f"by processor time at most {bound:.2f} x; load average now {os.getloadavg()[0]:.1f} on"
        f" {os.cpu_count()} processors"
    )
    print(
        f"one process of a fleet takes 1/{per_unit:.1f} of the processor time of a loop of"
        " `calibkit fit` commands"
    )
    return 0 if ratio >= TARGET and same else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))

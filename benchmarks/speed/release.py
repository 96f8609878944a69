"""Rows of the table that compare whole commands with those of version 0.1.0."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from speed import units
from speed.commands import CALIBKIT, DATE, LEAST, Command, line, spent, with_all_rows, written
from speed.goals import Goal, Line
from speed.pairs import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from speed.commands import Python, Spent

RELEASE = "adbfa49"
"""Commit of version 0.1.0."""
PEER = "calibkit 0.1.0"
SAMPLES = {
    "gyro_pair": 0.6,
    "rate_table": 0.6,
    "gyro_triad": 0.6,
    "accelerometer": 0.6,
    "inclinometer": 0.6,
    "gyro_noise": 0.6,
    "fog_thermal": 1.0,
}
"""Sample → share of the processor time of 0.1.0 that its fit should take at most."""


@contextlib.contextmanager
def _released() -> Iterator[tuple[Path, Path]]:
    """A folder for results, and in it version 0.1.0 from the repository's history, its kernels
    compiled.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        release = folder / "0.1.0"
        archive = subprocess.run(
            ["git", "-C", str(ROOT), "archive", RELEASE], check=True, capture_output=True
        ).stdout
        with tarfile.open(fileobj=io.BytesIO(archive)) as content:
            content.extractall(release, filter="data")
        spent([sys.executable, "-m", "calibkit.native"], root=release)
        yield folder, release


def _beside(
    command: Sequence[object], folder: Path, release: Path, turns: int
) -> list[tuple[Spent, Spent]]:
    """What a command takes now and what it took in version 0.1.0, turn by turn; each writes into a
    folder of its own. The turn before the first compiles the byte code.
    """
    pairs = []
    for turn in range(turns + 1):
        both = [
            spent(
                [*command, "--out", folder / f"{side}_{turn}"],
                accepted=(0, 1),
                compiled=str(folder / f"compiled_{side}"),
                root=root,
            )
            for side, root in (("now", ROOT), ("then", release))
        ]
        pairs.append((both[0], both[1]))
    return pairs[1:]


def samples(goals: Sequence[Goal], rows: int, turns: int, python: Python) -> list[Line]:
    """`calibkit fit` of each sample on the same logs and recipe, child processes included."""
    del python
    with _released() as (folder, release):
        lines = []
        for goal in goals:
            procedure = goal.name.removeprefix("sample_")
            recipe = release / "recipes" / f"{procedure}.toml"
            logs = ("--data", release / "datasets" / procedure, "--serial", "G", *DATE)
            pairs = _beside([*CALIBKIT, "fit", recipe, *logs], folder / procedure, release, turns)
            lines.append(line(goal, rows, pairs))
    return lines


def ramps(goals: Sequence[Goal], rows: int, turns: int, python: Python) -> list[Line]:
    """`calibkit fit` on four ramps, all families of drift models among the candidates."""
    with _released() as (folder, release):
        _, count = written(folder, rows, python)
        logs = ("--data", folder / "logs", "--serial", "G", *DATE)
        pairs = _beside([*CALIBKIT, "fit", "fog_thermal", *logs], folder, release, turns)
    return [line(goal, count, pairs) for goal in goals]


def devices(goals: Sequence[Goal], rows: int, turns: int, python: Python) -> list[Line]:
    """A fleet of `rows` units by two processes; a unit has the bytes of its own fit."""
    del python
    with _released() as (folder, release):
        serials = units.write_units(folder / "units", rows, 2000)
        recipe = folder / "bias.toml"
        recipe.write_text(units.RECIPE, encoding="utf-8")
        command = [*CALIBKIT, "fleet", recipe, "--data", folder / "units", "--jobs", 2, *DATE]
        pairs = _beside(command, folder, release, turns)
        single = ["--data", folder / "units" / serials[-1], "--serial", serials[-1], *DATE]
        spent([*CALIBKIT, "fit", recipe, *single, "--out", folder / "single"])
        alone = units.tree(folder / "single" / serials[-1])
        if alone != units.tree(folder / "now_0" / serials[-1]):
            raise RuntimeError("a unit of the fleet has other bytes than its own fit")
    return [line(goal, rows, pairs, digits=17.0) for goal in goals]


COMMANDS = (
    Command(
        tuple(
            Goal(
                f"sample_{name}",
                f"`calibkit fit`, sample of {name}",
                PEER,
                share,
                1,
                faster=False,
                rows_are="sample",
                note="a whole process with its children, on the same logs",
            )
            for name, share in SAMPLES.items()
        ),
        samples,
        lambda _: [1],
    ),
    Command(
        (
            Goal(
                "ramps",
                "`calibkit fit`, four ramps, all families",
                PEER,
                1.0,
                14_400_000,
                faster=False,
                clock="wall",
                note="the kernel bank is a candidate now, which 0.1.0 did not have",
            ),
        ),
        ramps,
        with_all_rows,
    ),
    Command(
        (
            Goal(
                "devices",
                "fleet of small devices by two processes",
                PEER,
                1.6,
                200,
                digits=17.0,
                rows_are="units",
                note="all bits are those of a unit's own fit",
            ),
        ),
        devices,
        lambda rows: [4] if max(rows) <= LEAST else [200],
    ),
)

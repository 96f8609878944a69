"""Rows of the table that compare whole commands with those of release 0.2."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from speed.commands import CALIBKIT, DATE, Command, line, spent, with_all_rows, written
from speed.goals import Goal, Line
from speed.pairs import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from speed.commands import Python, Spent

RELEASE = "4d27da91"
"""Commit of release 0.2."""
PEER = "calibkit 0.2.0"
SAMPLES = (
    "gyro_pair",
    "rate_table",
    "gyro_triad",
    "accelerometer",
    "inclinometer",
    "gyro_noise",
    "fog_thermal",
)
MOST = 1.1
"""Times as long as release 0.2 that a fit may take."""


@contextlib.contextmanager
def _released() -> Iterator[tuple[Path, Path]]:
    """A folder for results, and in it release 0.2 from the repository's history, its kernels
    compiled.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        release = folder / "0.2"
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
    """What a command takes now and what it took in release 0.2, turn by turn; each writes into a
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


COMMANDS = (
    Command(
        tuple(
            Goal(
                f"sample_{name}",
                f"`calibkit fit`, sample of {name}",
                PEER,
                MOST,
                1,
                faster=False,
                rows_are="sample",
                note="a whole process with its children, on the same logs",
            )
            for name in SAMPLES
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
                MOST,
                14_400_000,
                faster=False,
                clock="wall",
            ),
        ),
        ramps,
        with_all_rows,
    ),
)

"""Two workers side by side: turns taken A B A B, ratios turn by turn, and whether both gave the
same numbers.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Linear algebra on one thread on both sides, so that processor times are times; polars keeps all
of its threads.
"""
LONG_ENOUGH_S = 0.1
"""A turn repeats a call until it is this long."""
EVERY_BIT = 17.0
"""Digits of values that are equal."""


class WorkerError(RuntimeError):
    """A side that did not do what it was asked."""


class Worker:
    """A process that runs one side."""

    def __init__(self, python: Path | str, module: str) -> None:
        environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(
            [str(python), str(HERE / "worker.py"), module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def ask(self, do: str, **what: object) -> dict[str, Any]:
        """One question and its answer; raises WorkerError where the side failed."""
        if self.process.stdin is None or self.process.stdout is None:
            raise WorkerError("no pipe to the worker")
        self.process.stdin.write(json.dumps({"do": do, **what}) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        said: dict[str, Any] = json.loads(line) if line else {"error": "the worker ended"}
        if "error" in said:
            raise WorkerError(f"{do}: {said['error']}")
        return said

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.process.wait(timeout=60.0)
        if self.process.stdout is not None:
            self.process.stdout.close()


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, least and largest of the ratios of turns."""

    median: float
    least: float
    largest: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of the ratios of all turns."""
        return cls(statistics.median(values), min(values), max(values))

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.least:.3g} to {self.largest:.3g})"


@dataclass(frozen=True, slots=True)
class Turn:
    """Seconds of one call of both sides."""

    ours: Mapping[str, float]
    theirs: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Measured:
    """What turns of two sides on the same data gave."""

    turns: tuple[Turn, ...]
    ours_bytes: int
    theirs_bytes: int
    digits: float

    def ratio(self, clock: str, *, faster: bool) -> Spread:
        """How many times faster ours is than theirs, or how many times as long it takes, by "wall"
        or "cpu".
        """
        pairs = [(turn.ours[clock], turn.theirs[clock]) for turn in self.turns]
        return Spread.of([b / a if faster else a / b for a, b in pairs])

    def seconds(self, side: str, clock: str) -> float:
        """Median seconds of a call of "ours" or "theirs"."""
        return statistics.median(getattr(turn, side)[clock] for turn in self.turns)


def measure(ours: Worker, theirs: Worker, *, turns: int, budget_s: float) -> Measured:
    """Warm both sides up, then take turns: at least two, at most `turns`, fewer where they would
    exceed the budget.
    """
    warm = [side.ask("weigh") for side in (ours, theirs)]
    digits = agreeing_digits(answers(ours), answers(theirs))
    times = [max(1, math.ceil(LONG_ENOUGH_S / max(said["wall"], 1e-6))) for said in warm]
    taken: list[Turn] = []
    begun = time.perf_counter()
    while len(taken) < min(2, turns) or (
        len(taken) < turns and time.perf_counter() - begun < budget_s
    ):
        taken.append(Turn(ours.ask("once", times=times[0]), theirs.ask("once", times=times[1])))
    return Measured(tuple(taken), warm[0]["bytes"], warm[1]["bytes"], digits)


def answers(side: Worker) -> dict[str, NDArray[Any]]:
    """Arrays of a side's last result."""
    with tempfile.TemporaryDirectory() as folder:
        names = side.ask("answer", folder=folder)["names"]
        return {name: np.load(Path(folder) / f"{name}.npy") for name in names}


def agreeing_digits(ours: Mapping[str, NDArray[Any]], theirs: Mapping[str, NDArray[Any]]) -> float:
    """Decimal digits to which all arrays agree, the fewest of them; 17 where every bit is the
    same.
    """
    if sorted(ours) != sorted(theirs):
        raise WorkerError(
            f"one side gave {', '.join(sorted(ours))}, the other {', '.join(sorted(theirs))}"
        )
    return min(_digits(ours[name], theirs[name]) for name in ours)


def _digits(one: NDArray[Any], other: NDArray[Any]) -> float:
    """Digits of two arrays: largest difference over the largest value; text and whole numbers agree
    or do not.
    """
    if one.shape != other.shape:
        return 0.0
    if one.dtype.kind != "f":
        return EVERY_BIT if np.array_equal(one, other) else 0.0
    if not (np.isfinite(one).all() and np.isfinite(other).all()):
        return 0.0
    apart, size = float(np.max(np.abs(one - other))), float(np.max(np.abs(other)))
    return EVERY_BIT if apart == 0.0 else max(0.0, -math.log10(apart / size)) if size > 0.0 else 0.0

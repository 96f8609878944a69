"""All revisions of one serial: which is in force when, and whether each supersedes the one
before.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from calibkit.check import copies
from calibkit.errors import CoefficientError, UsageError
from calibkit.records import store
from calibkit.records.coefficients import Record
from calibkit.records.store import StoredRun

YEAR_DAYS = 365.25


@dataclass(frozen=True, slots=True)
class Timeline:
    """Every revision of a serial, and the faults of its chain."""

    serial: str
    runs: tuple[StoredRun, ...]
    in_force: Mapping[int, tuple[str, str]]
    """Revision → from when and, where another takes over, up to which date (exclusive) it is in
    force; empty: never.
    """
    refused: Mapping[int, str]
    """Revision that cannot be trusted → why."""
    breaks: tuple[str, ...]
    flags: tuple[str, ...]

    @property
    def sound(self) -> bool:
        """Whether every revision could be read and supersedes the one before."""
        return not self.refused and not self.breaks

    @classmethod
    def read(cls, serial: str, runs_folder: Path) -> Self:
        """Timeline of a serial under a folder of runs; UsageError where there is none."""
        numbers = store.revisions(runs_folder / store.check_serial(serial))
        if not numbers:
            raise UsageError(
                f"serial '{serial}': no run under {runs_folder}",
                hint="give --runs, or fit it first",
            )
        runs, refused = list[StoredRun](), dict[int, str]()
        for number in numbers:
            try:
                runs.append(store.load_revision(runs_folder, serial, number))
            except CoefficientError as error:
                refused[number] = str(error)
        in_force = {run.document["revision"]: ("", "") for run in runs}
        # the accelerometer of a device stays in force beside its gyro
        for procedure in {run.document["procedure"] for run in runs}:
            documents = [run.document for run in runs if run.document["procedure"] == procedure]
            winners = store.in_force(documents)
            until = dict(itertools.pairwise([*sorted(winners), ""]))
            in_force |= {revision: (date, until[date]) for date, revision in winners.items()}
        breaks = tuple(_chain_faults(runs, numbers))
        return cls(serial, tuple(runs), in_force, refused, breaks, _flags(runs))


def _chain_faults(runs: Sequence[StoredRun], numbers: Sequence[int]) -> Iterator[str]:
    """One line per fault of the chain: a revision that is missing, a file that does not supersede
    the one before it.
    """
    for number in sorted(set(range(1, numbers[-1] + 1)) - set(numbers)):
        yield f"r{number:03d} is missing"
    readable = {run.document["revision"]: run for run in runs}
    for run in runs:
        number = run.document["revision"]
        if number > 1 and number - 1 not in readable:
            yield (
                f"r{number:03d}: what it supersedes cannot be checked, r{number - 1:03d} is not"
                " here or not readable"
            )
            continue
        before = readable[number - 1].stage_digests() if number > 1 else {}
        for record in run.records.values():
            expected = before.get(record.stage, "")
            if record.supersedes != expected:
                yield _state_break(number, record, expected)


def _state_break(number: int, record: Record, expected: str) -> str:
    """One file that does not supersede the one before it."""
    superseded = f"{record.supersedes[:12]}…" if record.supersedes else "nothing"
    required = (
        f"{expected[:12]}… of r{number - 1:03d}"
        if expected
        else f"nothing: r{number - 1:03d} has no such stage"
    )
    return f"r{number:03d}: {record.stage} supersedes {superseded}, expected {required}"


def _flags(runs: Sequence[StoredRun]) -> tuple[str, ...]:
    """What a reader of a timeline must know."""
    flags = [
        f"{run.name} was rejected: it is never in force by date"
        for run in runs
        if run.document["verdict"] == "rejected"
    ]
    for older, newer in itertools.pairwise(runs):
        dates = older.document["effective_from"], newer.document["effective_from"]
        if dates[1] < dates[0]:
            flags.append(
                f"{newer.name} holds from {dates[1]}, before {older.name} which it supersedes holds"
                f" ({dates[0]}): by date {older.name} stays in force from {dates[0]}"
            )
    flags += [
        f"{newer.name} was fitted to logs of {older.name} as well: one determination, not two;"
        " slopes take the newer"
        for k, newer in enumerate(runs)
        for older in runs[:k]
        if copies.shared_logs(older.document["inputs"], newer.document["inputs"])
    ]
    procedures = dict.fromkeys(run.document["procedure"] for run in runs)
    if len(procedures) > 1:
        flags.append(
            f"runs of several procedures: {', '.join(procedures)}; each holds beside the others,"
            f" and {runs[-1].document['serial']} alone names the newest of all"
        )
    return tuple(flags)


def independent_runs(runs: Sequence[StoredRun]) -> set[int]:
    """Revisions that were not rejected and share no log with a newer one of them."""
    newer_inputs: list[Mapping[str, object]] = []
    independent = set()
    for run in sorted(runs, key=lambda run: -int(run.document["revision"])):
        usable = run.document["verdict"] != "rejected"
        if usable and not copies.shared_logs(run.document["inputs"], newer_inputs):
            independent.add(int(run.document["revision"]))
            newer_inputs += run.document["inputs"]
    return independent

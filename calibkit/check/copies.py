"""Copies: logs that came in twice under two names, and logs that a run was already fitted to.

A copy would confirm the other when that is left out, or be compared with its own fit. The same
bytes are a copy, and so are the same values written otherwise: other line ends, other separators, a
row less, fewer digits. Of logs that are at hand the first rows are compared, and samples of all
rows without their time; of a run's logs the fingerprints that its run.json keeps of them.
"""

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibkit.errors import FrameError
from calibkit.logs import mapping
from calibkit.numeric.arrays import Array
from calibkit.readers import parts
from calibkit.readers.table import Guess
from calibkit.recipe import Exclude, Recipe
from calibkit.records.coefficients import Input
from calibkit.records.frame import KEPT_DIGITS, Log, fingerprint

SHARED = 0.9
"""Share of the shorter log's rows from which two logs are copies; noise makes the rows of two
measurements differ.
"""
FEWEST = 3
"""Different rows below which a copy cannot be distinguished from a log that stands still."""
FINGERPRINT, SAMPLE = "fingerprint", "sample"
"""Keys of a log in run.json that hold the fingerprint of its values, and the same of its sample
without time.
"""
KEPT_HASHES = 24
"""Hashes of a sample that run.json keeps: honest repeats share one in a hundred at most, and the
run of a small device in a fleet has 35 kB.
"""
KEEP_ONE = "keep one of the two logs"
"""Advice where a log is a copy of another."""

MOST_DECIMALS = 12
"""Decimals from which on a column counts as not rounded: its numbers went through arithmetic."""


@dataclass(frozen=True, slots=True)
class Content:
    """What a log holds, by which a copy of it is known."""

    file: str
    sha256: str
    rows: frozenset[bytes]
    """Its first rows, as `Log.first_rows` gives them."""
    sample: frozenset[int]
    """Sample of all its rows, as `Log.sample_without_time` gives it."""
    first: Mapping[str, Array]
    """First values of its columns, as `Log.first_values` gives them."""
    last_places: Mapping[str, float]
    """What the values of each of these columns are multiples of, see `_last_place`."""

    @classmethod
    def of(cls, log: Log) -> "Content":
        """What a log holds."""
        first = log.first_values()
        last_places = {name: _last_place(column) for name, column in first.items()}
        sample = log.sample_without_time()
        return cls(log.file, log.sha256, log.first_rows(), sample, first, last_places)


def find_copies(logs: Iterable[Content]) -> list[tuple[str, str]]:
    """File and, in words, the original of each log that is a copy of one before it."""
    earlier_logs: list[Content] = []
    copies = []
    for log in logs:
        if original := _describe_original(log, earlier_logs):
            copies.append((log.file, original))
        earlier_logs.append(log)
    return copies


def refuse_copies(logs: Iterable[Log]) -> Iterator[Log]:
    """Pass logs through as they are read; FrameError for the first that is a copy of one before
    it.
    """
    earlier_logs: list[Content] = []
    for log in logs:
        content = Content.of(log)
        if original := _describe_original(content, earlier_logs):
            raise FrameError(f"{log.file}: {original}", hint=KEEP_ONE)
        earlier_logs.append(content)
        yield log


def _describe_original(log: Content, earlier_logs: Iterable[Content]) -> str:
    """What a log shares with the first of those seen that it is a copy of, or ""."""
    for other in earlier_logs:
        if log.sha256 == other.sha256:
            return f"the same bytes as {other.file}"
        fewer, shared = min(len(log.rows), len(other.rows)), len(log.rows & other.rows)
        if _are_copies(shared, fewer):
            return f"the same values as {other.file}: {shared} of the first {fewer} different rows"
        fewer, shared = _count_shared(log.sample, other.sample)
        if _are_copies(shared, fewer):
            return (
                f"the same values as {other.file} at other times or in other rows: {shared} of"
                f" {fewer} that were compared"
            )
        for rounded, exact in ((log, other), (other, log)):
            fewer, shared = _count_rounded(rounded, exact)
            if _are_copies(shared, fewer):
                digits_word = "fewer" if rounded is log else "more"
                return (
                    f"the same values as {other.file} with {digits_word} digits: {shared} of the"
                    f" first {fewer} rows"
                )
    return ""


def _count_rounded(rounded: Content, exact: Content) -> tuple[int, int]:
    """Rows that stand at the same place in both logs, and how many of them one log has as the other
    rounded; (0, 0) where it has no fewer digits, or where its own noise does not distinguish its
    rows: at that resolution an honest repeat has the same ones.
    """
    if rounded.first.keys() != exact.first.keys() or not rounded.sample:
        return 0, 0
    places = {name: (rounded.last_places[name], exact.last_places[name]) for name in exact.first}
    # rounding makes columns coarser, none finer
    if any(coarser < finer for coarser, finer in places.values()) or all(
        coarser == finer for coarser, finer in places.values()
    ):
        return 0, 0
    rows = min(len(column) for log in (rounded, exact) for column in log.first.values())
    agrees = np.ones(rows, dtype=np.bool_)
    for name, (last_place, original_place) in places.items():
        # a value between two last places may be rounded either way
        half = 0.5000001 * last_place if last_place > original_place else 0.0
        agrees &= np.abs(rounded.first[name][:rows] - exact.first[name][:rows]) <= half
    return rows, int(agrees.sum())


def _last_place(column: Array) -> float:
    """Power of ten, at most 1000, that all values of a column are multiples of; 0 for none."""
    present = column[np.isfinite(column)]
    for decimals in range(-3, MOST_DECIMALS):
        scaled = present * 10.0**decimals
        arithmetic = 1e-14 * np.max(np.abs(scaled), initial=1.0)
        # with so many digits every float looks like a multiple
        if arithmetic > 0.01:
            break
        if np.all(np.abs(scaled - np.rint(scaled)) <= arithmetic):
            return float(10.0**-decimals)
    return 0.0


def _are_copies(shared: int, fewer: int) -> bool:
    """Whether as many shared rows of the log that has fewer make a copy."""
    return fewer >= FEWEST and shared >= SHARED * fewer


def _count_shared(first: frozenset[Any], second: frozenset[Any]) -> tuple[int, int]:
    """Members of the smaller of two samples up to the member that both reach, and how many of them
    the samples share.
    """
    if first.isdisjoint(second):
        return 0, 0
    # samples keep the smallest hashes: above the largest of the shorter one nothing can be shared
    reach = min(max(first), max(second))
    reached = [sum(member <= reach for member in sample) for sample in (first, second)]
    return min(reached), len(first & second)


def _are_fingerprints_alike(first: str, second: str) -> bool:
    """Whether two fingerprints are of copies."""
    fewer, shared = _count_shared(_split_fingerprint(first), _split_fingerprint(second))
    return _are_copies(shared, fewer)


@functools.lru_cache(maxsize=4096)
def _split_fingerprint(text: str) -> frozenset[str]:
    """Digests of the rows that a fingerprint holds."""
    return frozenset(text[k : k + KEPT_DIGITS] for k in range(0, len(text), KEPT_DIGITS))


def _find_fitted_copy(
    rows: frozenset[bytes],
    inputs: Sequence[Mapping[str, object]],
    sample: frozenset[int] = frozenset(),
) -> str:
    """Name of the log of a run's inputs that a log of these rows and this sample is a copy of, or
    "".
    """
    identity = {"sha256": "", FINGERPRINT: fingerprint(rows), SAMPLE: _write_sample(sample)}
    copies = (fitted_log for fitted_log in inputs if _are_same_log(identity, fitted_log))
    return next((str(fitted_log["name"]) for fitted_log in copies), "")


def _are_same_log(first: Mapping[str, object], second: Mapping[str, object]) -> bool:
    """Whether two logs, as run.json lists them, are one measurement, at whatever times; of runs
    that keep no fingerprint only by their bytes.
    """
    marks = ((str(first.get(key, "")), str(second.get(key, ""))) for key in (FINGERPRINT, SAMPLE))
    return first["sha256"] == second["sha256"] or any(
        all(pair) and _are_fingerprints_alike(*pair) for pair in marks
    )


def _write_sample(sample: frozenset[int]) -> str:
    """The smallest hashes of a sample of rows as run.json keeps them, in the form of a
    fingerprint.
    """
    return "".join(f"{key:016x}"[:KEPT_DIGITS] for key in sorted(sample)[:KEPT_HASHES])


def describe_input(log: Input) -> dict[str, object]:
    """A log as run.json lists it: what identifies it, a fingerprint of its values, how it was read,
    what of that was guessed, the digest of a second logger's file, the date of its last row, the
    range of its thermometers.
    """
    optional_keys = {
        FINGERPRINT: fingerprint(log.content),
        SAMPLE: _write_sample(log.sample),
        "reading": list(log.reading),
        "guesses": [line for line in log.reading if isinstance(line, Guess)],
        "second_logger_sha256": log.second_logger_sha256,
        "last_date": log.last_date,
        "measured": {name: list(ends) for name, *ends in log.measured},
    }
    return log.identity() | {key: value for key, value in optional_keys.items() if value}


def digests_of_input(log: Mapping[str, object]) -> frozenset[str]:
    """Digests of a log, as run.json lists it, and of its rows: a copy has at least one of them
    too.
    """
    marks = (_split_fingerprint(str(log.get(key, ""))) for key in (FINGERPRINT, SAMPLE))
    return frozenset({str(log["sha256"])}).union(*marks)


def shared_logs(
    logs: Sequence[Mapping[str, object]], other_logs: Sequence[Mapping[str, object]]
) -> list[str]:
    """Names of the logs that are among others too, both as run.json lists them."""
    return [
        str(log["name"]) for log in logs if any(_are_same_log(log, other) for other in other_logs)
    ]


def read_unseen(
    read: Callable[[Recipe, Path, str], Log],
    spec: Recipe,
    data: Path,
    files: Iterable[str],
    inputs: Sequence[Mapping[str, object]],
    excluded: Sequence[Exclude],
    run: str,
    fitted_notes: list[str],
) -> Iterator[Log]:
    """Logs that a run was not fitted to; a sentence on each other one, with the same bytes or
    values written otherwise, is added to `fitted_notes`.

    `read` reads a log; `excluded` is what the run left out of its logs: a copy is compared as it
    was fitted too. Raises as reading does, and FrameError where there is no such log.
    """
    fitted_digests, count = {entry["sha256"] for entry in inputs}, 0
    for file in files:
        if parts.digest_log(data / file, file, split=spec.logs.split) in fitted_digests:
            fitted_notes.append(f"{file} was fitted by this run and is left out")
            continue
        log = read(spec, data, file)
        name = _find_fitted_copy(log.first_rows(), inputs, log.sample_without_time())
        usable = [
            entry
            for entry in excluded
            if ("time_s" in log.frame.columns or not entry.timed)
            and not (entry.positions or entry.stations)
        ]
        if not name and usable:
            # the fingerprint of the run is of what it fitted, without what it excluded
            rest = replace(log, frame=mapping.drop_excluded_rows(log.frame, usable, file)[0])
            name = _find_fitted_copy(rest.first_rows(), inputs, rest.sample_without_time())
        if name:
            fitted_notes.append(
                f"{file} holds the values of {name}, which this run was fitted to, and is left out"
            )
            continue
        count += 1
        yield log
    if not count:
        raise FrameError(
            f"{data}: every log here was fitted by {run}: {fitted_notes[0]}",
            hint="validate on logs that it has not seen",
        )


def flag_missing_fingerprints(run: str, inputs: Sequence[Mapping[str, object]]) -> list[str]:
    """Flags of a run that keeps no fingerprints of its logs' values, or none without time."""
    flags = []
    for key, passes in (
        (FINGERPRINT, "with other line ends or separators"),
        (SAMPLE, "with other times, or without its first rows,"),
    ):
        names = [str(entry["name"]) for entry in inputs if not entry.get(key)]
        if names:
            logs_text = f"{len(names)} of its logs" if len(names) > 1 else names[0]
            flags.append(
                f"{run} keeps no {key} of {logs_text}: a copy {passes} passes for a log it has not"
                " seen; fit again so that it is known"
            )
    return flags

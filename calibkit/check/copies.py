"""Logs that came in twice under two names: one would vouch for the other when it is left out, or
held against its own fit.

The same bytes are a copy, and so are the same values written otherwise: other line ends, other
separators, a row less. Of logs that are at hand the first rows are compared, of a run's logs the
fingerprints that its run.json keeps of them.
"""

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence

from calibkit.coefficients import Input
from calibkit.errors import FrameError
from calibkit.frame import KEPT_DIGITS, KEPT_ROWS, Log, fingerprint
from calibkit.readers.table import Guess

SHARED = 0.9
"""Share of the shorter log's rows from which two logs are copies; noise makes the rows of two
measurements differ.
"""
FEWEST = 3
"""Different rows below which nothing tells a copy from a log that stands still."""
FINGERPRINT = "fingerprint"
"""Key of a log in run.json that holds the fingerprint of its values."""


def find_copies(logs: Iterable[tuple[str, str, frozenset[bytes]]]) -> list[tuple[str, str]]:
    """Copies among logs of (file, SHA-256, first rows as `frame.first_rows`): each with what it is
    a copy of.
    """
    seen: list[tuple[str, str, frozenset[bytes]]] = []
    found = []
    for file, sha256, content in logs:
        if not sha256:  # it could not be read
            continue
        said = next((said for other in seen if (said := _same((file, sha256, content), other))), "")
        if said:
            found.append((file, said))
        seen.append((file, sha256, content))
    return found


def refuse_copies(logs: Iterable[Log]) -> Iterator[Log]:
    """Pass logs through as they are read; FrameError for the first that is a copy of one before
    it.
    """
    seen: list[tuple[str, str, frozenset[bytes]]] = []
    for log in logs:
        one = (log.file, log.sha256, log.first_rows())
        for said in (said for other in seen if (said := _same(one, other))):
            raise FrameError(f"{log.file}: {said}", hint="keep one of the two logs")
        seen.append(one)
        yield log


def _same(one: tuple[str, str, frozenset[bytes]], other: tuple[str, str, frozenset[bytes]]) -> str:
    """What one log shares with another, or nothing."""
    if one[1] == other[1]:
        return f"the same bytes as {other[0]}"
    fewer = min(len(one[2]), len(other[2]))
    shared = len(one[2] & other[2])
    if not _are_copies(shared, fewer):
        return ""
    return f"the same values as {other[0]}: {shared} of the first {fewer} different rows"


def _are_copies(shared: int, fewer: int) -> bool:
    """Whether as many shared rows of the log that has fewer make a copy."""
    return fewer >= FEWEST and shared >= SHARED * fewer


def _alike(one: str, other: str) -> bool:
    """Whether two fingerprints are of copies: their rows up to the digest that both samples
    reach.
    """
    samples = [_digests(one), _digests(other)]
    if samples[0].isdisjoint(samples[1]):
        return False
    ends = [max(sample) for sample in samples if len(sample) >= KEPT_ROWS]
    reached = [{row for row in sample if not ends or row <= min(ends)} for sample in samples]
    return _are_copies(len(reached[0] & reached[1]), min(map(len, reached)))


@functools.lru_cache(maxsize=4096)
def _digests(text: str) -> frozenset[str]:
    """Digests of the rows that a fingerprint holds."""
    return frozenset(text[k : k + KEPT_DIGITS] for k in range(0, len(text), KEPT_DIGITS))


def find_fitted_copy(
    sha256: str, rows: frozenset[bytes], inputs: Sequence[Mapping[str, object]]
) -> str:
    """Name of the log of a run's inputs that a log of these rows is a copy of, or nothing."""
    one = {"sha256": sha256, FINGERPRINT: fingerprint(rows)}
    return next((str(other["name"]) for other in inputs if _are_same_log(one, other)), "")


def _are_same_log(one: Mapping[str, object], other: Mapping[str, object]) -> bool:
    """Whether two logs, as run.json lists them, are one measurement; of runs that keep no
    fingerprint only by their bytes.
    """
    marks = str(one.get(FINGERPRINT, "")), str(other.get(FINGERPRINT, ""))
    return one["sha256"] == other["sha256"] or (all(marks) and _alike(*marks))


def describe_input(log: Input) -> dict[str, object]:
    """A log as run.json lists it: what identifies it, a fingerprint of its values, how it was read,
    what of that was guessed, the digest of a second logger's file.
    """
    stated = {
        FINGERPRINT: fingerprint(log.content),
        "reading": list(log.reading),
        "guesses": [line for line in log.reading if isinstance(line, Guess)],
        "second_logger_sha256": log.second_logger_sha256,
    }
    return log.identity() | {key: value for key, value in stated.items() if value}


def digests_of_input(one: Mapping[str, object]) -> frozenset[str]:
    """Digests of a log, as run.json lists it, and of its rows: a copy has at least one of them
    too.
    """
    return _digests(str(one.get(FINGERPRINT, ""))) | {str(one["sha256"])}


def shared_logs(
    some: Sequence[Mapping[str, object]], others: Sequence[Mapping[str, object]]
) -> list[str]:
    """Names of the logs that are among others too, both as run.json lists them."""
    return [str(one["name"]) for one in some if any(_are_same_log(one, other) for other in others)]


def logs_without_fingerprint(inputs: Sequence[Mapping[str, object]]) -> list[str]:
    """Names of the logs of a run of which only a copy of the very bytes can be told."""
    return [str(one["name"]) for one in inputs if not one.get(FINGERPRINT)]

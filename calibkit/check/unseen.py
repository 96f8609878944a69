"""Which logs a run has not seen: told by their bytes, and by the fingerprint of their values that
its run.json keeps.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from calibkit.check import copies
from calibkit.errors import FrameError
from calibkit.ingest import logs, mapping

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from calibkit.check.examination import Examiner
    from calibkit.frame import Log
    from calibkit.recipe import Exclude, Recipe


def read_unseen(
    procedure: Examiner,
    spec: Recipe,
    data: Path,
    file: str,
    inputs: Sequence[Mapping[str, object]],
    excluded: Sequence[Exclude],
) -> Log | str:
    """A log that a run was not fitted to, or what is said of one that it was: the same bytes, or
    values written otherwise.

    `excluded` is what the run left out of its logs: a copy of one is told as it was fitted too.
    Raises as reading does.
    """
    if logs.digest_log(spec, data, file) in {entry["sha256"] for entry in inputs}:
        return f"{file} was fitted by this run and is left out"
    log = procedure.read(spec, data, file)
    name = copies.find_fitted_copy("", log.first_rows(), inputs)
    if not name and excluded and "time_s" in log.frame.columns:
        kept = replace(log, frame=mapping.drop_excluded_rows(log.frame, excluded, file)[0])
        name = copies.find_fitted_copy("", kept.first_rows(), inputs)
    if name:
        return f"{file} holds the values of {name}, which this run was fitted to, and is left out"
    return log


def pass_unseen(read: Iterable[Log | str], seen: list[str], none: str) -> Iterator[Log]:
    """Logs as `read` gives them that a run has not seen; what is said of the others is added to
    `seen`.

    Raises FrameError with the words for it where there is no such log.
    """
    count = 0
    for log in read:
        if isinstance(log, str):
            seen.append(log)
        else:
            count += 1
            yield log
    if not count:
        raise FrameError(f"{none}: {seen[0]}", hint="validate on logs that it has not seen")


def flag_missing_fingerprints(run: str, inputs: Sequence[Mapping[str, object]]) -> list[str]:
    """Flag of a run that keeps no fingerprints of its logs' values."""
    names = copies.logs_without_fingerprint(inputs)
    if not names:
        return []
    listed = f"{len(names)} of its logs" if len(names) > 1 else names[0]
    said = (
        f"{run} keeps no fingerprint of {listed}: a copy with other line ends or separators passes"
        " for a log it has not seen"
    )
    return [f"{said}; fit again to have them told"]

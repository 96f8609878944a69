"""A log that is larger than memory should be: looked at piece by piece, and thinned to block means
for all else.

The memory of a check is that of a piece and of the thinned log, whatever the size of the file. Only
clean CSV can be looked at like this; another format is read whole.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from calibkit import check, units
from calibkit.check import facts
from calibkit.check.facts import Facts
from calibkit.frame import Finding, Log, values
from calibkit.ingest import logs_on_disk, mapping
from calibkit.numeric.chunks import release
from calibkit.readers import clean
from calibkit.recipe import Recipe

LARGEST = 100_000_000
"""Bytes of a log up to which it is read whole."""
CHUNK = 1 << 20
"""Rows of a piece."""
KEPT = 1 << 18
"""Rows of the thinned log, at most."""
FOUND_IN_CHUNKS = (
    "spike",
    "stuck",
    "saturated",
    "start_up",
    "quantisation",
    "gap",
    "missing",
    "clock",
    "range",
)
"""Findings that are looked for in the pieces; the rest in the thinned log."""


@dataclass(frozen=True, slots=True)
class ChunkedLog:
    """A log that was looked at in pieces: thinned to means of `thinned` rows, what the pieces
    showed, the facts of the whole.
    """

    log: Log
    thinned: int
    findings: tuple[Finding, ...]
    facts: Facts


def examine_file(
    recipe: Recipe,
    path: Path,
    file: str,
    needed: Sequence[str],
    optional: Sequence[str],
    *,
    largest: int = LARGEST,
) -> ChunkedLog | None:
    """Look at a large clean log in pieces; none for a log that is read whole. Raises as
    `ingest.read_log`.
    """
    if (
        not logs_on_disk.can_be_chunked(recipe)
        or not path.is_file()
        or path.stat().st_size <= largest
    ):
        return None
    scan = clean.scan_file(path, file)
    if scan is None:
        return None
    every = -(-scan.rows // KEPT)
    tables = clean.read_chunks(path, file, scan, CHUNK // every * every)
    logs = (mapping.map_log(recipe, table, needed, optional, whole=False) for table in tables)
    return _through(recipe, logs, scan.rows, every)


def examine_on_disk(recipe: Recipe, log: Log) -> ChunkedLog:
    """Look at a log whose columns are on disk in pieces."""
    every = -(-len(log.frame) // KEPT)
    rows = CHUNK // every * every

    def parts() -> Iterator[Log]:
        for start in range(0, len(log.frame), rows):
            yield replace(log, frame=log.frame.iloc[start : start + rows], room=np.empty)
            release(*(values(log.frame, str(name)) for name in log.frame.columns))

    found = _through(recipe, parts(), log.rows, every)
    assert found is not None  # noqa: S101 (a log that was read has rows)
    return found


def _through(recipe: Recipe, logs: Iterable[Log], rows: int, every: int) -> ChunkedLog | None:
    """Look at the pieces of a log of so many rows, thinned to means of `every` rows; none where
    they hold no row.
    """
    frames: list[pd.DataFrame] = []
    found: list[Finding] = []
    parts: list[Facts] = []
    last: Log | None = None
    for log in logs:
        if log.frame.empty:
            continue
        found += _looked_at(recipe, log, last, first=not parts)
        parts.append(facts.describe_log(log))
        frames.append(_thinned(log.frame, every))
        last = replace(log, frame=log.frame.iloc[-1:])
    if last is None:
        return None
    note = (
        f"{rows} rows looked at in pieces; segments and fits of this check are of means of {every}"
        " rows"
    )
    thin = replace(last, frame=pd.concat(frames), rows=rows, notes=(*last.notes, note))
    return ChunkedLog(thin, every, tuple(_merged(found)), facts.merge_facts(parts))


def _thinned(frame: pd.DataFrame, every: int) -> pd.DataFrame:
    """Means of blocks of rows, numbered by the line of their first."""
    block = frame.index.to_numpy() // every
    first = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(np.append(first, len(frame)))
    means = {
        name: np.add.reduceat(values(frame, str(name)), first) / count for name in frame.columns
    }
    return pd.DataFrame(means, index=frame.index.to_numpy()[first])


def _looked_at(recipe: Recipe, log: Log, last: Log | None, *, first: bool) -> list[Finding]:
    """Findings of one piece; the last row of the piece before it stands above it."""
    joined = log if last is None else replace(log, frame=pd.concat([last.frame, log.frame]))
    columns = [str(name) for name in log.frame.columns]
    found = check.find_missing_values(log, columns)
    if found:
        return found
    if "time_s" in columns:
        found += [
            *check.find_unordered_times(joined),
            *check.find_gaps(joined, recipe.largest_gap_s()),
        ]
    temperatures = [name for name in columns if name.startswith("temp_")]
    found += check.find_implausible_temperatures(log, temperatures)
    gyros = [name for name in columns if name.endswith("_dph")]
    for name in gyros:
        found += check.find_implausible_rates(log, name)
    for name in dict.fromkeys((*gyros, *recipe.still_columns())):
        found += check.series.check_indication(log, name, units.column_unit(name))
    if {"temp_case_degc", "temp_env_degc"} <= set(columns):
        found += check.series.check_case_and_air(log, "temp_case_degc", "temp_env_degc")
    else:
        found += [
            finding
            for name in temperatures
            for finding in check.series.check_temperature(log, name)
        ]
    return [
        finding
        for finding in found
        if finding.name in FOUND_IN_CHUNKS and (first or finding.name != "start_up")
    ]


def _merged(found: Sequence[Finding]) -> list[Finding]:
    """Findings of one kind in one column told once: the gravest and largest, with the number of
    pieces that have others.
    """
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for finding in found:
        column = finding.place.rpartition("column ")[2]
        groups.setdefault((finding.name, finding.severity, column), []).append(finding)
    told = []
    for group in groups.values():
        worst = (
            max(group, key=lambda finding: abs(finding.figure or 0.0))
            if group[0].name != "clock"
            else group[0]
        )
        others = f" (and {len(group) - 1} more such findings in the log)" if len(group) > 1 else ""
        told.append(replace(worst, found=worst.found + others))
    return told

"""A log that is larger than memory should be: examined in chunks, and thinned to block means for
all else.

The memory of a check is that of a chunk and of the thinned log, whatever the size of the file. Only
clean CSV can be read in chunks; another format is read whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit import check, units
from calibkit.check import facts
from calibkit.logs import logs_on_disk, mapping
from calibkit.readers import clean
from calibkit.records.frame import Log, values

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.check.facts import Facts
    from calibkit.recipe import Recipe
    from calibkit.records.frame import Finding

LARGEST = 100_000_000
"""Bytes of a log up to which it is read whole."""
CHUNK = 1 << 20
"""Rows of a chunk."""
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
"""Findings that are looked for in the chunks; the rest in the thinned log."""


@dataclass(frozen=True, slots=True)
class ChunkedLog:
    """A log that was examined in chunks: thinned to means of `thinned` rows, the findings in the
    chunks, the facts of the whole.
    """

    log: Log
    thinned: int
    findings: tuple[Finding, ...]
    facts: Facts


def examine_file(
    recipe: Recipe,
    path: Path,
    file: str,
    required_columns: Sequence[str],
    optional: Sequence[str],
    *,
    largest: int = LARGEST,
) -> ChunkedLog | None:
    """Examine a large clean log in chunks; None for a log that is read whole. Raises as
    `log_files.read_log`.
    """
    scan = logs_on_disk.scan_large_log(recipe, path, file, largest)
    if scan is None:
        return None
    block_rows = -(-scan.rows // KEPT)
    tables = clean.read_chunks(path, file, scan, CHUNK // block_rows * block_rows)
    logs = (
        mapping.map_log(recipe, table, required_columns, optional, is_whole_log=False)
        for table in tables
    )
    return _examine_chunks(recipe, logs, scan.rows, block_rows)


def _examine_chunks(
    recipe: Recipe, logs: Iterable[Log], rows: int, block_rows: int
) -> ChunkedLog | None:
    """Examine the chunks of a log of so many rows, thinned to means of `block_rows`; None where
    they hold no row.
    """
    import pandas as pd

    frames: list[pd.DataFrame] = []
    findings: list[Finding] = []
    parts: list[Facts] = []
    last: Log | None = None
    for log in logs:
        if log.frame.empty:
            continue
        findings += _examine_chunk(recipe, log, last)
        parts.append(facts.Facts.describe(log))
        frames.append(_thin(log.frame, block_rows))
        last = replace(log, frame=log.frame.iloc[-1:])
    if last is None:
        return None
    note = (
        f"{rows} rows looked at in pieces; segments and fits of this check are of means of"
        f" {block_rows} rows"
    )
    thin = replace(last, frame=pd.concat(frames), rows=rows, notes=(*last.notes, note))
    return ChunkedLog(thin, block_rows, tuple(_merge_findings(findings)), facts.Facts.merge(parts))


def _thin(frame: pd.DataFrame, block_rows: int) -> pd.DataFrame:
    """Means of blocks of rows, numbered by the line of their first."""
    import pandas as pd

    block = frame.index.to_numpy() // block_rows
    first = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(np.append(first, len(frame)))
    means = {
        name: np.add.reduceat(values(frame, str(name)), first) / count for name in frame.columns
    }
    return pd.DataFrame(means, index=frame.index.to_numpy()[first])


def _examine_chunk(recipe: Recipe, log: Log, last: Log | None) -> list[Finding]:
    """Findings of one chunk; `last` is the last row of the chunk before it, None for the first."""
    import pandas as pd

    joined = log if last is None else replace(log, frame=pd.concat([last.frame, log.frame]))
    columns = [str(name) for name in log.frame.columns]
    findings = check.find_missing_values(log, columns)
    if findings:
        return findings
    if "time_s" in columns:
        findings += [
            *check.find_unordered_times(joined),
            *check.find_gaps(joined, recipe.largest_gap_s()),
        ]
    temperatures = [name for name in columns if name.startswith("temp_")]
    findings += check.find_implausible_temperatures(log, temperatures)
    gyros = [name for name in columns if name.endswith("_dph")]
    for name in gyros:
        findings += check.find_implausible_rates(log, name)
    for name in dict.fromkeys((*gyros, *recipe.still_columns())):
        findings += check.series.check_indication(log, name, units.column_unit(name))
    if {"temp_case_degc", "temp_env_degc"} <= set(columns):
        findings += check.series.check_case_and_air(log, "temp_case_degc", "temp_env_degc")
    else:
        for name in temperatures:
            findings += check.series.check_temperature(log, name)
    return [
        finding
        for finding in findings
        if finding.name in FOUND_IN_CHUNKS and (last is None or finding.name != "start_up")
    ]


def _merge_findings(findings: Sequence[Finding]) -> list[Finding]:
    """One finding for those of one kind in one column: the gravest and largest, with the number of
    the others.
    """
    groups: dict[tuple[str, str, str], list[Finding]] = {}
    for finding in findings:
        groups.setdefault((finding.name, finding.severity, finding.column), []).append(finding)
    merged = []
    for group in groups.values():
        worst = group[0]
        if worst.name != "clock":
            worst = max(group, key=lambda finding: abs(finding.figure or 0.0))
        further_text = (
            f" (and {len(group) - 1} more such findings in the log)" if len(group) > 1 else ""
        )
        merged.append(replace(worst, found=worst.found + further_text))
    return merged

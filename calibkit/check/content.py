"""What a log must hold before anything can be said of it: rows, finite numbers, a clock that runs,
plausible values.
"""

import functools
import math
import re
from collections.abc import Callable, Iterator, Sequence
from typing import ParamSpec

import numpy as np

from calibkit import units
from calibkit.numeric.arrays import Array, Integers
from calibkit.records.frame import GAP, Finding, Log, Severity, values

LARGEST_RATE_DPH = 1e7
"""Indication [°/h] beyond which a log is not a gyro's: some 2800 °/s."""
_LARGEST = 1e30
"""Values that no column holds, in whatever unit: counters of 64 bits end at 2e19."""
COLDEST_DEGC, HOTTEST_DEGC = -100.0, 250.0
"""Temperatures that no chamber of this field leaves."""
_FEWEST_COPIED = 3
"""Rows in sequence that, all alike others, are hardly alike by chance."""
P = ParamSpec("P")


def in_stages(stages: Callable[P, Iterator[list[Finding]]]) -> Callable[P, list[Finding]]:
    """Findings of stages that a function yields one after the other: nothing is looked for behind
    one that refuses the log.
    """

    @functools.wraps(stages)
    def find(*args: P.args, **kwargs: P.kwargs) -> list[Finding]:
        findings: list[Finding] = []
        for stage in stages(*args, **kwargs):
            findings += stage
            if any(finding.refused for finding in findings):
                break
        return findings

    return find


@in_stages
def find_unusable(
    log: Log, min_rows: int, columns: Sequence[str] | None = None
) -> Iterator[list[Finding]]:
    """Yield findings of a log of an instrument at rest, for a correction of its columns (absent:
    all that it has); it may have gaps.
    """
    columns = list(log.frame.columns) if columns is None else columns
    yield [*find_too_few_rows(log, min_rows), *find_missing_values(log, columns)]
    findings = find_unordered_times(log) if "time_s" in log.frame.columns else []
    temperatures = [name for name in columns if re.fullmatch("temp_.*degc", name)]
    findings += find_implausible_temperatures(log, temperatures)
    for name in columns:
        if name.endswith("_dph"):
            findings += find_implausible_rates(log, name)
    yield findings


def finding_at_row(
    log: Log,
    row: int,
    column: str,
    observation: str,
    expected: str,
    advice: str,
    name: str,
    *,
    severity: Severity = "refuse",
    figure: float | None = None,
) -> Finding:
    """Finding at a row of a log: its place names file, line and column, and it carries the row's
    time where there is one.
    """
    time = float(log.frame["time_s"].iloc[row]) if "time_s" in log.frame.columns else None
    place = f"{log.place(row)}: column '{column}'"
    return Finding(
        place, observation, expected, advice, severity, name, log.line(row), time, figure, column
    )


def finding_of_column(
    log: Log,
    column: str,
    observation: str,
    expected: str,
    advice: str,
    name: str,
    figure: float | None = None,
    *,
    severity: Severity = "warn",
) -> Finding:
    """Finding about a column of a log as a whole."""
    place = f"{log.file}: column '{column}'"
    return Finding(
        place, observation, expected, advice, severity, name, figure=figure, column=column
    )


def find_too_few_rows(log: Log, minimum: int) -> list[Finding]:
    """Too few rows."""
    count = len(log.frame)
    if count >= minimum:
        return []
    # finding rows: fewer rows than the recipe asks for
    return [
        Finding(
            log.file,
            f"{count} rows",
            expected=f"at least {minimum}",
            advice="log longer, or lower min_rows in the recipe",
            name="rows",
            figure=float(count),
        )
    ]


def find_missing_values(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Missing, infinite or impossibly large values in columns that are needed."""
    findings = []
    for column in columns:
        if all(abs(value) < _LARGEST for value in log.extremes(column)):
            continue
        data = values(log.frame, column)
        bad = np.flatnonzero(~(np.abs(data) < _LARGEST))
        if bad.size:
            first, plural = data[bad[0]], "s" if bad.size > 1 else ""
            observation = f"{bad.size} missing or infinite value{plural} from here on"
            expected = "a number in every row"
            if math.isfinite(first):
                unit = units.column_unit(column)
                limit = LARGEST_RATE_DPH if unit == "deg/h" else _LARGEST
                expected = f"at most {limit:g} {unit}".strip()
                observation = (
                    f"{first:.3g} {unit} ({bad.size} such or missing value{plural} from here on)"
                )
            # finding missing: a value that is needed is missing, infinite or impossibly large
            finding = finding_at_row(
                log,
                int(bad[0]),
                column,
                observation,
                expected=expected,
                advice=f"repair the log, or leave them out: {log.advise_exclude(bad)}",
                name="missing",
                figure=float(bad.size),
            )
            findings.append(finding)
    return findings


def find_copied_rows(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Rows of a table, each the mean of something held, that stand in it twice, one after the other
    as before. A copy would count as a second measurement; so would an honest repeat without digits
    enough, whose rounding is the same again.
    """
    table = np.column_stack([values(log.frame, column) for column in columns])
    first, number = np.unique(table, axis=0, return_index=True, return_inverse=True)[1:]
    original = first[number.reshape(-1)]
    rows = np.arange(original.size)
    copied = original < rows
    # runs of rows whose originals follow each other too
    starts = np.flatnonzero(np.diff(original - rows, prepend=1) != 0)
    runs = [run for run in np.split(rows, starts[1:]) if run.size >= _FEWEST_COPIED]
    copied_rows = np.concatenate([np.empty(0, np.int64), *(run[copied[run]] for run in runs)])
    if not copied_rows.size:
        return []
    row = int(copied_rows[0])
    # finding copied_rows: rows hold the same numbers as earlier rows of the log, in the same order
    return [
        Finding(
            log.place(row),
            f"{copied_rows.size} rows from here on hold the same numbers as the rows from"
            f" {log.place(int(original[row]))} on",
            expected="each measurement once, and repeats that differ by their noise",
            advice="leave the copies out, or repeats in which rounding hides the noise:"
            f" {log.advise_exclude(copied_rows, most=copied_rows.size)}",
            name="copied_rows",
            line=log.line(row),
            figure=float(copied_rows.size),
        )
    ]


def find_unordered_times(log: Log) -> list[Finding]:
    """Time that stands still or runs backwards."""
    if log.steps.shortest > 0.0:
        return []
    time = values(log.frame, "time_s")
    back = np.flatnonzero(time[1:] <= time[:-1])
    if not back.size:
        return []
    k = int(back[0])
    word = "stands still" if time[k + 1] == time[k] else "runs backwards"
    # finding clock: time stands still or runs backwards
    return [
        finding_at_row(
            log,
            k + 1,
            "time_s",
            f"time {word} at {time[k]:.12g} s → {time[k + 1]:.12g} s"
            f" ({back.size} such row{'s' if back.size > 1 else ''})",
            expected="strictly increasing time",
            advice=f"sort or split the log, or leave rows out: {log.advise_exclude(back + 1)}",
            name="clock",
            figure=float(back.size),
        )
    ]


def find_gaps(log: Log, limit_s: float) -> list[Finding]:
    """Gaps in time: refused above the limit, flagged where samples are missing at all.

    A gap that an [[exclude]] table made is called that.
    """
    if not log.steps.shortest > 0.0:
        return []
    before, step = _locate_gaps(log)
    seconds, index = log.frame["time_s"], log.frame.index
    findings = []
    for k, length in zip(before.tolist(), step.tolist(), strict=True):
        if length <= limit_s:
            continue
        observation = f"a gap of {length:g} s at {float(seconds.iloc[k]):.12g} s"
        advice = "split the log at the gap, or raise max_gap_s in the recipe"
        left_out = int(index[k + 1]) - int(index[k]) - 1
        if left_out > 0 and log.excluded_rows:
            observation += f", made by [[exclude]], which leaves out {left_out} rows"
            advice = (
                "exclude from the log's start or to its end, split the log there, or raise"
                " max_gap_s in the recipe"
            )
        # finding gap: rows are missing for longer than the recipe allows
        finding = finding_at_row(
            log,
            k + 1,
            "time_s",
            observation,
            f"at most {limit_s:g} s",
            advice,
            "gap",
            figure=length,
        )
        findings.append(finding)
    short = step <= limit_s
    return [*findings, *_warn_of_gaps(log, before[short], step[short])]


def _warn_of_gaps(log: Log, before: Integers, step: Array) -> list[Finding]:
    """One finding for all gaps that are allowed, at the first."""
    if not before.size:
        return []
    k = int(before[0])
    # finding gap: rows are missing for less long than that
    return [
        finding_at_row(
            log,
            k + 1,
            "time_s",
            f"{before.size} short gap{'s' if before.size > 1 else ''}, the first of {step[0]:g} s"
            f" at {float(log.frame['time_s'].iloc[k]):.12g} s",
            expected=f"a row every {log.steps.usual:g} s",
            advice="see that no row was lost; what lies between them is not known",
            name="gap",
            severity="warn",
            figure=float(step.max()),
        )
    ]


def _locate_gaps(log: Log) -> tuple[Integers, Array]:
    """Rows [m] before a gap in time, and the gaps [m, s]."""
    limit = GAP * log.steps.usual
    if not log.steps.longest > limit:
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    time = values(log.frame, "time_s")
    before = np.flatnonzero(np.diff(time) > limit)
    return before, time[before + 1] - time[before]


def flag_bridged_gaps(log: Log) -> list[str]:
    """Flag for the gaps that a compensation with a memory runs across: their number, the longest,
    the time they take, and what becomes of them.

    What happened in them it does not know, and what it remembers from before them may be over.
    """
    before, step = _locate_gaps(log)
    if not before.size:
        return []
    k = int(before[np.argmax(step)])
    count = "1 gap"
    if before.size > 1:
        count = f"{before.size} gaps, {step.sum():g} s together, the longest"
    return [
        (
            f"{log.place(k + 1)}: {count} of {step.max():g} s from"
            f" {float(log.frame['time_s'].iloc[k]):.12g} s: the compensation runs across a gap and"
            " knows nothing of what happened in it"
        )
    ]


def find_constant_columns(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Columns that the model needs to vary and that are constant."""
    findings = []
    for column in columns:
        low, high = log.extremes(column)
        if low == high:
            # finding constant: a column that must vary does not
            finding = finding_of_column(
                log,
                column,
                f"constant at {low:g} over {len(log.frame)} rows",
                expected="a column that varies",
                advice="check the sensor and the column mapping",
                name="constant",
                severity="refuse",
            )
            findings.append(finding)
    return findings


def find_implausible_temperatures(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Temperatures that no chamber reaches: a wrong unit, or a sentinel of an open sensor."""
    expected = f"{COLDEST_DEGC:g} to {HOTTEST_DEGC:g} °C"
    return [
        finding
        for column in columns
        for finding in find_out_of_range(log, column, COLDEST_DEGC, HOTTEST_DEGC, "°C", expected)
    ]


def find_implausible_rates(log: Log, column: str) -> list[Finding]:
    """Rates that no gyro on a bench indicates: a sentinel, or another unit."""
    expected = f"at most {LARGEST_RATE_DPH:g} deg/h"
    return find_out_of_range(log, column, -LARGEST_RATE_DPH, LARGEST_RATE_DPH, "deg/h", expected)


def find_out_of_range(
    log: Log,
    column: str,
    low: float,
    high: float,
    unit: str,
    expected: str,
    *,
    advice: str = "",
) -> list[Finding]:
    """Values of a column that are below `low` or above `high` [unit], at the first; by default they
    are in another unit or no values.
    """
    smallest, largest = log.extremes(column)
    if smallest >= low and largest <= high:
        return []
    data = values(log.frame, column)
    rows = np.flatnonzero((data < low) | (data > high))
    if not rows.size:
        return []
    first = float(data[rows[0]])
    advice = advice or f"state the log's unit in [columns.{column}], or leave the rows out:"
    # finding range: values that no such sensor gives: a sentinel, or another unit
    return [
        finding_at_row(
            log,
            int(rows[0]),
            column,
            f"{first:g} {unit} ({rows.size} such row{'s' if rows.size > 1 else ''})",
            expected,
            f"{advice} {log.advise_exclude(rows)}",
            name="range",
            figure=first,
        )
    ]

"""What a log must hold before anything can be said of it: rows, finite numbers, a clock that runs,
plausible values.
"""

import math
from collections.abc import Sequence

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.frame import Finding, Log, Severity, values
from calibkit.numeric import chunks

LARGEST_RATE_DPH = 1e7
"""Indication [°/h] beyond which a log is not a gyro's: some 2800 °/s."""
COLDEST_DEGC, HOTTEST_DEGC = -100.0, 250.0
"""Temperatures that no chamber of this field leaves."""
GAP = 2.5
"""Sampling intervals, in medians, that are a gap."""


def line_of_row(log: Log, row: int) -> int:
    """Line of the file that a row of the frame came from, in the part of a split log that holds
    it.
    """
    return int(log.place(row).rsplit(":", 1)[1])


def finding_at_row(
    log: Log,
    row: int,
    column: str,
    found: str,
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
    timed = "time_s" in log.frame.columns
    time = float(log.frame["time_s"].iloc[row]) if timed else None
    place = f"{log.place(row)}: column '{column}'"
    return Finding(
        place, found, expected, advice, severity, name, line_of_row(log, row), time, figure
    )


def find_too_few_rows(log: Log, minimum: int) -> list[Finding]:
    """Too few rows."""
    count = len(log.frame)
    if count >= minimum:
        return []
    advice = "log longer, or lower min_rows in the recipe"
    return [
        Finding(
            log.file,
            f"{count} rows",
            f"at least {minimum}",
            advice,
            name="rows",
            figure=float(count),
        )
    ]


def find_missing_values(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Missing or infinite values in columns that are needed."""
    findings = []
    for column in columns:
        if all(map(math.isfinite, log.extremes(column))):
            continue
        bad = chunks.rows_where(values(log.frame, column), lambda data: ~np.isfinite(data))
        if bad.size:
            found = (
                f"{bad.size} missing or infinite value{'s' if bad.size > 1 else ''} from here on"
            )
            advice = "leave the range out with [[exclude]], or repair the log"
            expected = "a number in every row"
            findings.append(
                finding_at_row(
                    log,
                    int(bad[0]),
                    column,
                    found,
                    expected,
                    advice,
                    "missing",
                    figure=float(bad.size),
                )
            )
    return findings


def find_unordered_times(log: Log) -> list[Finding]:
    """Time that stands still or runs backwards."""
    if log.steps.shortest > 0.0:
        return []
    time = values(log.frame, "time_s")
    back = chunks.rows_where(time, lambda step: step <= 0.0, step=True)
    if not back.size:
        return []
    k = int(back[0])
    word = "stands still" if time[k + 1] == time[k] else "runs backwards"
    rows = f"({back.size} such row{'s' if back.size > 1 else ''})"
    found = f"time {word} at {time[k]:.10g} s → {time[k + 1]:.10g} s {rows}"
    advice = "sort or split the log, or leave the rows out with [[exclude]]"
    return [
        finding_at_row(
            log,
            k + 1,
            "time_s",
            found,
            "strictly increasing time",
            advice,
            "clock",
            figure=float(back.size),
        )
    ]


def find_gaps(log: Log, limit_s: float) -> list[Finding]:
    """Gaps in time: refused above the limit, flagged where samples are missing at all.

    A gap that an [[exclude]] table made is called that.
    """
    known = log.steps
    usual = known.usual
    if not known.shortest > 0.0 or known.longest <= GAP * usual:
        return []
    time = values(log.frame, "time_s")
    missing = chunks.rows_where(time, lambda step: step > GAP * usual, step=True)
    step = time[missing + 1] - time[missing]
    long = step > limit_s
    told = [
        _long_gap(log, int(k), float(length), limit_s)
        for k, length in zip(missing[long], step[long], strict=True)
    ]
    return [*told, *_short_gaps(log, missing[~long], step[~long], usual)]


def _long_gap(log: Log, k: int, step: float, limit_s: float) -> Finding:
    """A gap that is refused."""
    found = f"a gap of {step:g} s at {float(log.frame['time_s'].iloc[k]):g} s"
    advice = "split the log at the gap, or raise max_gap_s in the recipe"
    left_out = int(log.frame.index[k + 1]) - int(log.frame.index[k]) - 1
    if left_out > 0 and any("excluded by" in note for note in log.notes):
        found += f", made by [[exclude]], which leaves out {left_out} rows"
        advice = (
            "exclude from the log's start or to its end, split the log there, or raise max_gap_s in"
            " the recipe"
        )
    return finding_at_row(
        log, k + 1, "time_s", found, f"at most {limit_s:g} s", advice, "gap", figure=step
    )


def _short_gaps(log: Log, missing: Integers, step: Array, usual: float) -> list[Finding]:
    """Gaps that are allowed, told in one finding."""
    if not missing.size:
        return []
    k = int(missing[0])
    first = f"the first of {step[0]:g} s at {float(log.frame['time_s'].iloc[k]):g} s"
    found = f"{missing.size} short gap{'s' if missing.size > 1 else ''}, {first}"
    advice = "see that no row was lost; what lies between them is not known"
    largest = float(step.max())
    every = f"a row every {usual:g} s"
    return [
        finding_at_row(
            log, k + 1, "time_s", found, every, advice, "gap", severity="warn", figure=largest
        )
    ]


def flag_bridged_gaps(log: Log) -> list[str]:
    """Flag for the gaps that a compensation with a memory runs across: their number, the longest,
    the time they take.

    What happened in them it does not know, and what it remembers from before them may be over.
    """
    limit = GAP * log.steps.usual
    if not log.steps.longest > limit:
        return []
    time = values(log.frame, "time_s")
    missing = chunks.rows_where(time, lambda step: step > limit, step=True)
    step = time[missing + 1] - time[missing]
    k = int(missing[np.argmax(step)])
    count = (
        "a gap"
        if missing.size == 1
        else f"{missing.size} gaps, {step.sum():g} s together, the longest"
    )
    them = "it" if missing.size == 1 else "them"
    said = f"{log.place(k + 1)}: {count} of {step.max():g} s from {time[k]:g} s"
    return [f"{said}: the compensation runs across {them} and knows nothing of what happened there"]


def find_constant_columns(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Columns that the model needs to vary and that are constant."""
    findings = []
    for column in columns:
        low, high = log.extremes(column)
        if low == high:
            found = f"constant at {low:g} over {len(log.frame)} rows"
            advice = "check the sensor and the column mapping"
            place = f"{log.file}: column '{column}'"
            findings.append(Finding(place, found, "a column that varies", advice, name="constant"))
    return findings


def find_implausible_temperatures(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Temperatures that no chamber reaches: a wrong unit, or a sentinel of an open sensor."""
    findings = []
    for column in columns:
        low, high = log.extremes(column)
        if low >= COLDEST_DEGC and high <= HOTTEST_DEGC:
            continue
        data = values(log.frame, column)
        bad = chunks.rows_where(data, lambda part: (part < COLDEST_DEGC) | (part > HOTTEST_DEGC))
        if bad.size:
            found = f"{data[bad[0]]:g} °C ({bad.size} such row{'s' if bad.size > 1 else ''})"
            advice = (
                f"state the log's unit in [columns.{column}], or leave the rows out with"
                " [[exclude]]"
            )
            expected = f"{COLDEST_DEGC:g} to {HOTTEST_DEGC:g} °C"
            figure = float(data[bad[0]])
            findings.append(
                finding_at_row(
                    log, int(bad[0]), column, found, expected, advice, "range", figure=figure
                )
            )
    return findings


def find_implausible_rates(log: Log, column: str) -> list[Finding]:
    """Rates that no gyro on a bench indicates: a sentinel, or another unit."""
    low, high = log.extremes(column)
    if low >= -LARGEST_RATE_DPH and high <= LARGEST_RATE_DPH:
        return []
    data = values(log.frame, column)
    wild = chunks.rows_where(data, lambda part: np.abs(part) > LARGEST_RATE_DPH)
    if not wild.size:
        return []
    found = f"{data[wild[0]]:g} deg/h ({wild.size} such row{'s' if wild.size > 1 else ''})"
    advice = f"state the log's unit in [columns.{column}], or leave the rows out with [[exclude]]"
    expected = f"at most {LARGEST_RATE_DPH:g} deg/h"
    return [
        finding_at_row(
            log, int(wild[0]), column, found, expected, advice, "range", figure=float(data[wild[0]])
        )
    ]

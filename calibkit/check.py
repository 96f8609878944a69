"""What is wrong with a log, found before anything is fitted to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.frame import Finding, Log, values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

LARGEST_RATE_DPH = 1e7
"""Indication [°/h] beyond which a log is not a gyro's: some 2800 °/s."""
SPIKE = 20.0
"""Deviation from the neighbours' mean, in medians of it, that counts as a spike: white noise reaches 9 in a million."""
SPIKE_SHARE = 0.25
"""Share of a log's whole span that a spike exceeds."""
FIRST_ROW = 2
"""Line of a file that holds its first row, below the header."""


def rows(log: Log, minimum: int) -> list[Finding]:
    """Too few rows."""
    if len(log.frame) >= minimum:
        return []
    return [
        Finding(
            log.file, f"{len(log.frame)} rows", f"at least {minimum}", "log longer, or lower min_rows in the recipe"
        )
    ]


def finite(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Missing or infinite values in columns that are needed."""
    findings = []
    for column in columns:
        bad = np.flatnonzero(~np.isfinite(values(log.frame, column)))
        if bad.size:
            at = line(log, int(bad[0]))
            findings.append(
                Finding(
                    f"{log.file}:{at}: column '{column}'",
                    f"{bad.size} missing or infinite value{'s' if bad.size > 1 else ''} from here on",
                    "a number in every row",
                    "leave the range out with [[exclude]], or repair the log",
                )
            )
    return findings


def monotonic(log: Log) -> list[Finding]:
    """Time that stands still or runs backwards."""
    time = values(log.frame, "time_s")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if not back.size:
        return []
    k = int(back[0])
    word = "stands still" if time[k + 1] == time[k] else "runs backwards"
    return [
        Finding(
            f"{log.file}:{line(log, k + 1)}: column 'time_s'",
            f"time {word} at {time[k]:.10g} s → {time[k + 1]:.10g} s ({back.size} such row{'s' if back.size > 1 else ''})",
            "strictly increasing time",
            "sort or split the log, or leave the rows out with [[exclude]]",
        )
    ]


def gaps(log: Log, limit_s: float) -> list[Finding]:
    """Gaps in time: refused above the limit, flagged where samples are missing at all."""
    time = values(log.frame, "time_s")
    step = np.diff(time)
    if not step.size or (step <= 0.0).any():
        return []
    usual = float(np.median(step))
    findings = [
        Finding(
            f"{log.file}:{line(log, k + 1)}: column 'time_s'",
            f"a gap of {step[k]:g} s at {time[k]:g} s",
            f"at most {limit_s:g} s",
            "split the log at the gap, or raise max_gap_s in the recipe",
        )
        for k in np.flatnonzero(step > max(limit_s, 2.5 * usual)).tolist()
    ]
    missing = np.flatnonzero((step > 2.5 * usual) & (step <= limit_s))
    if missing.size:
        k = int(missing[0])
        findings.append(
            Finding(
                f"{log.file}:{line(log, k + 1)}: column 'time_s'",
                f"{missing.size} short gap{'s' if missing.size > 1 else ''}, the first of {step[k]:g} s at {time[k]:g} s",
                f"a row every {usual:g} s",
                "see that no row was lost; what lies between them is not known",
                refused=False,
            )
        )
    return findings


def varying(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Columns that the model needs to vary and that are constant."""
    findings = []
    for column in columns:
        data = values(log.frame, column)
        if data.size and np.ptp(data) == 0.0:
            findings.append(
                Finding(
                    f"{log.file}: column '{column}'",
                    f"constant at {data[0]:g} over {data.size} rows",
                    "a column that varies",
                    "check the sensor and the column mapping",
                )
            )
    return findings


def plausible_temperature(log: Log, columns: Sequence[str]) -> list[Finding]:
    """Temperatures that no chamber reaches: a wrong unit, or a sentinel of an open sensor."""
    findings = []
    for column in columns:
        data = values(log.frame, column)
        bad = np.flatnonzero((data < -100.0) | (data > 250.0))
        if bad.size:
            findings.append(
                Finding(
                    f"{log.file}:{line(log, int(bad[0]))}: column '{column}'",
                    f"{data[bad[0]]:g} °C ({bad.size} such row{'s' if bad.size > 1 else ''})",
                    "-100 to 250 °C",
                    f"state the log's unit in [columns.{column}], or leave the rows out with [[exclude]]",
                )
            )
    return findings


def plausible_rate(log: Log, column: str) -> list[Finding]:
    """Rates that no gyro on a bench indicates (a sentinel, another unit), and single samples far from their neighbours."""
    data = values(log.frame, column)
    wild = np.flatnonzero(np.abs(data) > LARGEST_RATE_DPH)
    if wild.size:
        return [
            Finding(
                f"{log.file}:{line(log, int(wild[0]))}: column '{column}'",
                f"{data[wild[0]]:g} deg/h ({wild.size} such row{'s' if wild.size > 1 else ''})",
                f"at most {LARGEST_RATE_DPH:g} deg/h",
                f"state the log's unit in [columns.{column}], or leave the rows out with [[exclude]]",
            )
        ]
    around = np.abs(data[1:-1] - (data[:-2] + data[2:]) / 2.0)
    usual = float(np.median(around)) if around.size else 0.0
    # beyond the scatter, and no small part of all that the log shows: a bend in a quiet log is no spike
    limit = max(SPIKE * usual, SPIKE_SHARE * float(np.ptp(data)))
    spikes = np.flatnonzero(around > limit) if usual > 0.0 else np.zeros(0, dtype=np.int64)
    if not spikes.size:
        return []
    worst = int(spikes[np.argmax(around[spikes])]) + 1
    return [
        Finding(
            f"{log.file}:{line(log, worst)}: column '{column}'",
            f"{data[worst]:g} deg/h between {data[worst - 1]:g} and {data[worst + 1]:g} (spikes near {spikes.size} rows)",
            "samples that scatter alike",
            "leave spikes out with [[exclude]]; only the models on levels are robust against them",
            refused=False,
        )
    ]


def line(log: Log, row: int) -> int:
    """Line of the file that a row of the frame came from; the frame's index counts the file's rows."""
    index: NDArray[np.int64] = log.frame.index.to_numpy()
    return int(index[row]) + FIRST_ROW

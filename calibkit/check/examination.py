"""A folder of logs → what `calibkit check` reports on each: facts, held conditions, findings, and
the curves of the figure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from calibkit.check import copies, facts, magnitude, thermometers
from calibkit.check.report import HeldCondition, LogReport
from calibkit.errors import FitError, FrameError, LogFormatError
from calibkit.records.frame import THERMOMETERS, Examined, Finding, values
from calibkit.report.logs import Curve, LogFigure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.records.frame import Log


class _Examiner(Protocol):
    """The part of a procedure that looks at logs."""

    def read(self, spec: Any, data: Path, file: str) -> Log:  # noqa: ANN401 (each procedure has its own recipe)
        """Read one log in canonical columns."""

    def faults(self, spec: Any, log: Log) -> Examined:  # noqa: ANN401 (the same)
        """Find what is wrong with a log, and its held conditions."""


@dataclass(frozen=True, slots=True)
class _Examination:
    """What was found in a log, and its figure where it could be read."""

    report: LogReport
    figure: LogFigure | None
    drift_slope: float | None = None
    """Slope of a gyro's indication over its case temperature [°/h/K], where both were read whole.
    """
    level: tuple[float, float] | None = None
    """Level and span of that indication [°/h]."""
    lag_s: float = 0.0
    """Lag of that case behind the chamber air [s]."""
    content: copies.Content | None = None
    """What it holds, where it could be read."""


def examine_log(procedure: _Examiner, spec: object, data: Path, file: str) -> _Examination:
    """Read and examine one log as a fit does; one that cannot be read or used is a refused
    finding.
    """
    try:
        log = procedure.read(spec, data, file)
    except (LogFormatError, FrameError, FitError) as error:
        # finding unreadable: the log cannot be read
        finding = Finding.of(error, name="unreadable")
        return _Examination(LogReport(file, "", (), (), None, (), (finding,)), None)
    try:
        examined = procedure.faults(spec, log)
    except (FrameError, FitError) as error:
        # finding unusable: the log is read, and cannot be used as the message states
        examined = Examined((Finding.of(error),))
    findings, log_facts = examined.findings, facts.Facts.describe(log)
    timed = "time_s" in log.frame.columns
    abscissa = values(log.frame, "time_s") if timed else np.arange(float(len(log.frame)))
    conditions = tuple(
        HeldCondition(
            part.kind,
            float(abscissa[part.start]),
            float(abscissa[part.stop - 1]),
            part.level,
            part.unit,
            part.stop - part.start,
            part.pinned,
        )
        for part in examined.held
    )
    report = LogReport(file, log.sha256, log.reading, log.notes, log_facts, conditions, findings)
    slope, level, lag = None, None, 0.0
    if not report.refused and {"gyro_dph", "temp_case_degc", "temp_env_degc"} <= set(
        log.frame.columns
    ):
        case, indication = values(log.frame, "temp_case_degc"), values(log.frame, "gyro_dph")
        slope = magnitude.fit_drift_slope(case, indication)
        level = magnitude.measure_level(indication)
        time, air = (values(log.frame, name) for name in ("time_s", "temp_env_degc"))
        lag = thermometers.measure_lag(time, case, air)
    drawn = LogFigure(
        log.file,
        "time [s]" if timed else "row",
        tuple(
            Curve.thinned(column.name, abscissa, values(log.frame, column.name))
            for column in log_facts.columns
        ),
        tuple((part.kind, part.first, part.last) for part in conditions),
        tuple(
            (finding.time_s, finding.name, finding.severity)
            for finding in findings
            if finding.time_s is not None
        ),
        tuple((part.low, part.high, part.share) for part in log_facts.occupancy),
    )
    return _Examination(report, drawn, slope, level, lag, copies.Content.of(log))


def segment_numbers(
    procedure: _Examiner, spec: object, data: Path, file: str
) -> pd.Series[float] | None:
    """Number of the held condition of each row of a log, from 1 in order of time, NaN between them;
    index as the log's.

    None where the procedure cannot read the log or finds no held condition in it.
    """
    import pandas as pd

    try:
        log = procedure.read(spec, data, file)
        conditions = procedure.faults(spec, log).held
    except (LogFormatError, FrameError, FitError):
        return None
    if not conditions:
        return None
    number = np.full(len(log.frame), np.nan)
    for k, part in enumerate(sorted(conditions, key=lambda part: part.start)):
        number[part.start : part.stop] = k + 1.0
    return pd.Series(number, index=log.frame.index)


def compare_logs(outcomes: Sequence[_Examination]) -> list[tuple[str, Finding]]:
    """What only several logs show: copies, and logs that do not drift like the others."""
    slopes = {
        outcome.report.file: outcome.drift_slope
        for outcome in outcomes
        if outcome.drift_slope is not None
    }
    rates = {}
    for outcome in outcomes:
        ramps = [condition for condition in outcome.report.held if condition.kind == "ramp"]
        if len(ramps) == 1:
            rates[outcome.report.file] = ramps[0].level
    driven = {
        o.report.file: (rates[o.report.file], o.report.facts.duration_s, o.lag_s)
        for o in outcomes
        if o.report.file in rates and o.report.facts is not None and o.lag_s
    }
    measured = {}
    for outcome in outcomes:
        log_facts = outcome.report.facts
        if log_facts is not None:
            measured[outcome.report.file] = [
                (column.name, column.low, column.high)
                for column in log_facts.columns
                if column.name in THERMOMETERS and column.missing < log_facts.rows
            ]
    contents = [outcome.content for outcome in outcomes if outcome.content is not None]
    # finding copy: the same measurement under two names: the same bytes, the same values, or these
    # with another start, fewer rows or fewer digits
    return [
        *(
            (file, Finding(file, original, "another log", copies.KEEP_ONE, name="copy"))
            for file, original in copies.find_copies(contents)
        ),
        *magnitude.find_compensated_logs(slopes),
        *magnitude.find_turned_logs(
            {o.report.file: o.level for o in outcomes if o.level is not None}
        ),
        *thermometers.check_rates_in_names(rates),
        *thermometers.find_late(driven),
        *thermometers.find_other_units(measured),
    ]

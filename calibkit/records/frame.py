"""The tidy frame: one row per instant, one column per variable, the unit in the column's name."""

from __future__ import annotations

import difflib
import hashlib
import json
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from calibkit.errors import (
    FrameError,
    MissingColumnError,
    advise_exclude,
    list_ranges,
    visible,
)
from calibkit.numeric import chunks, intervals, row_sample
from calibkit.records.left_out import Cause, LeftOut

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pandas as pd

    from calibkit.errors import CalibkitError
    from calibkit.libraries.plugins import Plugin
    from calibkit.numeric.arrays import Array, Integers

CANONICAL = (
    "run",
    "time_s",
    "temp_case_degc",
    "temp_env_degc",
    "gyro_dph",
    "table_rate_dps",
    "table_angle_deg",
    "position",
    "inclination_deg",
    "toolface_deg",
    "azimuth_deg",
    "station",
    "position_deg",
    "segment",
)
"""Canonical columns that have one name."""
PATTERNS = (
    r"gyro_[a-z0-9]+_dph",
    r"gyro_[a-z0-9]+_lsb",
    r"accel_[a-z0-9]+_g",
    r"accel_[a-z0-9]+_lsb",
)
"""Canonical columns that are named after their axis."""
THERMOMETERS = ("temp_case_degc", "temp_env_degc")
"""Columns of conditions that logs measure."""
_FIRST_DATE = "2000"
"""Dates before it are those of clocks that were never set: 1970-01-01, 1980-01-06, …"""
GAP = 2.5
"""Sampling intervals, in medians, that are a gap."""
COMPARED_ROWS = 1000
"""Rows of a log by which it is compared with others."""
EXCLUDED = 8
"""Ranges of lines that an exclusion in a message has at most."""
KEPT_ROWS, KEPT_DIGITS = 64, 12
"""Rows that a fingerprint holds, and hexadecimal digits of each."""


@dataclass(frozen=True, slots=True)
class Origin:
    """What the stamps of a log say at its second 0, and of which kind they are: stamps of one kind
    can be compared from file to file.
    """

    kind: Literal["date-times", "date-times with a zone", "times of day", "numbers"]
    nanoseconds: int = 0
    """Since 1970-01-01, since midnight, or since 0."""

    def stamp(self, seconds: float) -> str:
        """What a stamp says a number of seconds later, to the second."""
        if self.kind == "numbers":
            return f"{self.nanoseconds / 1e9 + seconds:.10g} s"
        instant = np.datetime64(self.nanoseconds // 10**9 + round(seconds), "s")
        date, _, time = str(instant).partition("T")
        return time if self.kind == "times of day" else f"{date} {time}"


@dataclass(frozen=True, slots=True)
class Log:
    """One log as it was read: its file, the digest of its bytes, its rows, what was noted, how it
    was read, the tidy frame.

    The frame's index counts lines of the file (minus 2); `parts` are the files of a split log with
    their offset in it.
    """

    name: str
    file: str
    sha256: str
    rows: int
    frame: pd.DataFrame
    notes: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()
    parts: tuple[tuple[str, int], ...] = ()
    clock: tuple[float, float] | None = None
    """Offset of a second logger's clock [s] and the largest standard uncertainty of its times [s],
    where one was joined.
    """
    second_logger_sha256: str = ""
    """Digest of the second logger's file that was joined."""
    overlap: str = ""
    """Where both files overlap, and how their clocks differ, in words."""
    origin: Origin | None = None
    """Stamp of second 0; None where there is no time, or where its date is not certain."""
    plugins: tuple[Plugin, ...] = ()
    """Plugins that read it."""
    lost: tuple[tuple[str, Integers], ...] = ()
    """Rows of the file that the frame is without though nothing excludes them: why, and their
    numbers in its index.
    """
    excluded_rows: int = 0
    """Rows that the recipe's exclusions took."""
    _known: dict[str, Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    """What was asked of the columns before, by many checks; a log that replaces this one begins
    anew.
    """

    @property
    def last_date(self) -> str:
        """Date of the last row as its stamp says it, YYYY-MM-DD; "" where it says none, or one of
        before calibkit's time, as of a clock that was never set.
        """
        if self.origin is None or not self.origin.kind.startswith("date-times"):
            return ""
        if "time_s" not in self.frame.columns or self.frame.empty:
            return ""
        date = self.origin.stamp(float(self.frame["time_s"].iloc[-1]))[:10]
        return date if date >= _FIRST_DATE else ""

    def extremes(self, column: str) -> tuple[float, float]:
        """Smallest and largest value of a column, both not a number where one is missing or there
        is no row.
        """
        if column not in self._known:
            self._known[column] = chunks.extremes(values(self.frame, column))
        limits: tuple[float, float] = self._known[column]
        return limits

    @property
    def steps(self) -> intervals.Steps:
        """Steps of the log's time, which must be finite."""
        if "" not in self._known:
            self._known[""] = intervals.Steps.find(values(self.frame, "time_s"))
        steps: intervals.Steps = self._known[""]
        return steps

    def _file_and_line(self, row: int) -> tuple[str, int]:
        """File and line that a row of the frame came from: of a split log, those of a part."""
        index = int(self.frame.index[row])
        parts = ((file, offset) for file, offset in reversed(self.parts) if index >= offset - 1)
        file, offset = next(parts, (self.file, 0))
        return file, index - offset + 2

    def line(self, row: int) -> int:
        """Line of the file, or of the part of a split log, that a row of the frame came from."""
        return self._file_and_line(row)[1]

    def place(self, row: int) -> str:
        """file:line that a row of the frame came from, in the part of a split log that holds it."""
        return "{}:{}".format(*self._file_and_line(row))

    def advise_exclude(self, rows: Iterable[int], most: int = EXCLUDED) -> str:
        """An [[exclude]] of rows of the frame, of at most so many ranges of lines: those of the
        part of a split log that holds the first of them. It says how many ranges there are where
        it lists fewer.
        """
        numbers = np.fromiter(rows, dtype=np.int64)
        file, _ = self._file_and_line(int(numbers[0]))
        begins = dict(self.parts)
        begin = begins.get(file, 0)
        index = self.frame.index.to_numpy()[numbers]
        # of a split log those of the part alone
        end = min((later for later in begins.values() if later > begin), default=None)
        in_part = index if end is None else index[index < end - 1]
        lines = list_ranges((in_part - begin + 2).tolist())
        advice = advise_exclude(file, lines=lines[:most])
        return advice if len(lines) <= most else f"{advice} (the first {most} of {len(lines)})"

    def list_left_out(self) -> tuple[LeftOut, ...]:
        """Rows that the frame is without: those that the recipe excludes, those that lack a
        value.
        """
        lost = sum(len(rows) for _, rows in self.lost)
        counts: tuple[tuple[Cause, int], ...]
        counts = (("excluded", self.excluded_rows), ("incomplete", lost))
        return tuple(
            LeftOut("rows", count, self.rows, cause, self.file) for cause, count in counts if count
        )

    def measured_conditions(self) -> tuple[tuple[str, float, float], ...]:
        """Column, lowest and highest reading [°C] of each thermometer."""
        read = {name: values(self.frame, name) for name in THERMOMETERS if name in self.frame}
        ends = ((name, *chunks.extremes_of_present(x)) for name, x in read.items())
        return tuple((name, low, high) for name, low, high in ends if np.isfinite(high))

    def first_rows(self) -> frozenset[bytes]:
        """Different ones of the first rows, the bytes of their values as they were mapped; words
        are left out.
        """
        head = self.frame.head(COMPARED_ROWS).select_dtypes("number").to_numpy(dtype=np.float64)
        # −0 is 0
        return frozenset(row.tobytes() for row in head + 0.0) if head.shape[1] else frozenset()

    def first_values(self) -> dict[str, Array]:
        """First values of each numeric column but the time, as they were mapped."""
        head = self.frame.head(COMPARED_ROWS).select_dtypes("number")
        # copied: a view would keep the whole log
        return {
            str(name): head[name].to_numpy(dtype=np.float64, copy=True)
            for name in head
            if name != "time_s"
        }

    def sample_without_time(self) -> frozenset[int]:
        """Sample of the rows of all numeric columns but the time: a copy with another origin of
        time, or without its first or last rows, has the same.
        """
        if "sample" not in self._known:
            self._known["sample"] = row_sample.sample_rows(
                [
                    values(self.frame, str(name))
                    for name, kind in self.frame.dtypes.items()
                    if kind.kind in "fiu" and name != "time_s"
                ]
            )
        sample: frozenset[int] = self._known["sample"]
        return sample


def fingerprint(rows: Iterable[bytes]) -> str:
    """The KEPT_ROWS smallest digests, cut to KEPT_DIGITS, of rows as `Log.first_rows` gives them,
    ascending: a sample that copies share, whichever of the rows they hold.
    """
    digests = {hashlib.sha256(row).hexdigest()[:KEPT_DIGITS] for row in rows}
    return "".join(sorted(digests)[:KEPT_ROWS])


@dataclass(frozen=True, slots=True)
class Held:
    """A held condition of a log: rows start … stop − 1, its kind, its level and the level's
    unit.
    """

    kind: Literal["soak", "ramp", "rate", "dwell", "station"]
    start: int
    stop: int
    level: float
    unit: str
    pinned: bool = False
    """Whether the recipe states it, rather than the log."""


@dataclass(frozen=True, slots=True)
class Examined:
    """What a procedure finds in a log before anything is fitted to it: the findings and the held
    conditions.
    """

    findings: tuple[Finding, ...]
    held: tuple[Held, ...] = ()


class Remark(str):
    """A flag that asks for nothing: a choice that was made, what a record does not show."""

    __slots__ = ()


Severity = Literal["refuse", "warn", "note"]
"""What a finding does to a fit: stops it, is carried along as a flag, or only `check` prints it.
"""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something a check found in a log: where, what, what was expected, what to do; its name, line,
    time and figure.
    """

    place: str
    found: str
    expected: str
    advice: str
    severity: Severity = "refuse"
    name: str = "unusable"
    """Kind of finding, in a word that scripts can rely on."""
    line: int | None = None
    """Line of the file, where there is one."""
    time_s: float | None = None
    """Time since the start of the log [s], where there is one."""
    figure: float | None = None
    """The number that was judged, in the unit that `found` states."""
    column: str = ""
    """Column that it is about, where it is one."""

    @property
    def refused(self) -> bool:
        """Whether a fit refuses the log."""
        return self.severity == "refuse"

    @property
    def flagged(self) -> bool:
        """Whether a fit goes on with a flag."""
        return self.severity == "warn"

    @classmethod
    def of(
        cls,
        error: CalibkitError,
        expected: str = "",
        name: str = "unusable",
    ) -> Finding:
        """Finding that states what an error does, whose message begins with its place."""
        place, _, fault = error.message.partition(": ")
        return cls(place, fault, expected, error.hint, name=name)

    def __str__(self) -> str:
        return f"{self.place}: {self.said}; {self.advice}"

    @property
    def said(self) -> str:
        """What was found and what was expected; an error's message says both itself."""
        return f"{self.found}, expected {self.expected}" if self.expected else self.found


def is_canonical(column: str) -> bool:
    """Whether a column's name is one that every part of calibkit understands."""
    return column in CANONICAL or any(re.fullmatch(pattern, column) for pattern in PATTERNS)


def share_unit(columns: Iterable[str], stated_units: Iterable[str]) -> dict[str, str]:
    """Unit of columns whose records state one and the same; empty where they state several."""
    units = set(stated_units)
    return dict.fromkeys(columns, units.pop()) if len(units) == 1 else {}


def values(frame: pd.DataFrame, column: str, otherwise: float | None = None) -> Array:
    """One column as a float64 array [n], in the unit that its name states; where the frame has none
    and one is given, a constant.
    """
    if otherwise is not None and column not in frame.columns:
        return np.full(len(frame), otherwise)
    return np.ascontiguousarray(frame[column].to_numpy(dtype=np.float64))


def require(file: str, present: Iterable[str], required: Iterable[str], *, of: str = "") -> None:
    """Raise MissingColumnError naming the needed columns that are absent, with the closest one to
    the first that is there.

    `of` is the canonical column that a needed one is mapped to.
    """
    column_names, required = [str(column) for column in present], list(dict.fromkeys(required))
    # a column that is needed itself is no other's
    free = [column for column in column_names if column not in required]
    missing = [column for column in required if column not in column_names]
    if missing:
        first, *further_missing = missing
        close = difflib.get_close_matches(first, free, n=1)
        guess = f"did you mean '{close[0]}'? " if close else ""
        source = json.dumps(close[0] if close else "…", ensure_ascii=False)
        also_missing = ""
        if further_missing:
            verb = "is" if len(further_missing) == 1 else "are"
            also_missing = f" (and so {verb} {', '.join(map(repr, further_missing))})"
        raise MissingColumnError(
            f"{file}:1: column '{first}' is missing{also_missing}, found {', '.join(column_names)}",
            hint=f"{guess}map it in the recipe: [columns.{of or first}] from = {source}",
            columns=(of,) if of else tuple(missing),
        )


def refuse(findings: Iterable[Finding]) -> None:
    """Raise FrameError with every refused finding, each on its own line."""
    refused = [visible(str(finding)) for finding in findings if finding.refused]
    if refused:
        raise FrameError("\n".join(refused))

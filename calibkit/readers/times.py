"""Times as loggers write them → seconds since the first row.

Forms: dates and times of day in any of the orders and separators that are listed in `_DATES`, times
of day alone (a step back is midnight), elapsed `h:m:s`, days since 1899-12-30 as spreadsheets count
them, decimal seconds of any length. Uncertainty: a time is taken as the instant that it names, to
the last digit written; spreadsheet days are rounded to the microsecond, which is what their float64
resolves. Time zones are taken into account where they are written. Where day and month could be
either, the order that makes the log run forwards is taken, and none where both do and would give
different seconds.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import LogFormatError, advise_exclude
from calibkit.readers.table import FIRST_ROW, Guess
from calibkit.records.frame import Origin

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from calibkit.numeric.arrays import Array, Integers, Mask


EXCEL, ELAPSED, DECIMAL = "excel", "elapsed", "decimal"
"""Formats that are words: spreadsheet days, h:m:s since the start, decimal seconds."""
EITHER = "%?"
"""Stands for day and month in an order that is not known yet."""
SPREADSHEET_DAYS = 2_958_466
"""Days from 1899-12-30 to the end of the year 9999."""
_REPAIR = "repair the row, or pin time_format in the recipe"
_SINCE_1899, _SINCE_1900 = -2_209_161_600 * 10**9, 2_208_988_800 * 10**9
"""Nanoseconds of 1970 at spreadsheets' day 0, 1899-12-30, and of midnight in the year 1900 that a
time of day alone is read in, to midnight.
"""
FIRST_YEAR, LAST_YEAR = 1678, 2261
"""Years that nanoseconds in 64 bits reach; a time of day alone counts from 1900."""

_TIME = re.compile(
    r"(?P<h>\d{1,3}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:(?P<mark>[.,:])(?P<f>\d{1,9}))?)?"
    r"(?P<half> ?[AaPp][Mm])?(?P<zone>Z|[+-]\d{2}:?\d{2})?"
)
_DATES = (
    (re.compile(r"(\d{4})([-/.])(\d{1,2})\2(\d{1,2})"), "%Y{0}%m{0}%d"),
    (re.compile(r"(\d{1,2})(\.)(\d{1,2})\2(\d{4})"), "%d{0}%m{0}%Y"),
    (re.compile(r"(\d{1,2})(\.)(\d{1,2})\2(\d{2})(?!\d)"), "%d{0}%m{0}%y"),
    (re.compile(r"(\d{1,2})([-/])(\d{1,2})\2(\d{4})"), EITHER + "{0}%Y"),
    (re.compile(r"(\d{1,2})(/)(\d{1,2})\2(\d{2})(?!\d)"), EITHER + "{0}%y"),
    (re.compile(r"(\d{4})(年)(\d{1,2})月(\d{1,2})日"), "%Y年%m月%d日"),
)


@dataclass(frozen=True, slots=True)
class _TimeColumn:
    """Seconds since the first row [n], NaN where no time is written, what was decided on the way,
    and the stamp of second 0 (None where it is not certain).
    """

    seconds: Array
    notes: tuple[str, ...] = ()
    origin: Origin | None = None


@dataclass(frozen=True, slots=True)
class _Fields:
    """Fields of a column of times, without the blanks around them, and which of them are missing;
    the index counts the file's lines.
    """

    texts: pd.Series
    missing: Mask
    file: str
    column: str

    def fault(self, row: int, expected: str, hint: str) -> LogFormatError:
        """The error of a field that is not what was expected."""
        line = int(self.texts.index[row]) + FIRST_ROW
        return LogFormatError(
            f"{self.file}:{line}: column '{self.column}': found"
            f" '{self.texts.iloc[row][:40]}', expected {expected}",
            hint=f"{hint}, or leave it out: {advise_exclude(self.file, lines=[line])}",
        )


def looks_like_time(field: str) -> bool:
    """Whether a field is a date, a time of day, or both."""
    return any(mark in field for mark in ":-/.年") and bool(_recognise_field(field.strip()))


def is_decimal(field: str) -> bool:
    """Whether a field is a plain decimal number, with a point or a comma."""
    return re.fullmatch(r"\s*[+-]?\d+(?:[.,]\d*)?\s*", field, re.ASCII) is not None


def recognise_format(fields: Sequence[str]) -> str:
    """Format that most of some fields have, or "" where they are no times."""
    stripped = [field.strip() for field in fields]
    forms = list(filter(None, map(_recognise_field, stripped)))
    if 2 * len(forms) <= len(fields):
        return ""
    with_fraction = [form for form in forms if "%f" in form]
    # some loggers leave out a fraction of 0: the longer form reads both
    usual = max(set(with_fraction or forms), key=(with_fraction or forms).count)
    hours = [int(time_match["h"]) for time_match in map(_TIME.fullmatch, stripped) if time_match]
    # no time of day has 25 hours
    if usual.startswith("%H") and max(hours, default=0) > 23:
        return ELAPSED
    return usual


def _recognise_field(field: str) -> str:
    """Format of one field, or "" where it is no time."""
    for pattern, form in _DATES:
        date_match = pattern.match(field)
        if date_match:
            date, time_text = form.format(date_match.group(2)), field[date_match.end() :]
            if not time_text:
                return date
            joint = re.match(r"[ T]+", time_text)
            time = _recognise_time_of_day(time_text[joint.end() :]) if joint else ""
            return date + (joint.group() if joint else "") + time if time else ""
    return _recognise_time_of_day(field) if ":" in field else ""


def _recognise_time_of_day(field: str) -> str:
    """Format of a time of day, or "" where it is none."""
    time_match = _TIME.fullmatch(field)
    if not time_match:
        return ""
    form = ("%I" if time_match["half"] else "%H") + ":%M"
    if time_match["s"]:
        form += ":%S" + (f"{time_match['mark']}%f" if time_match["f"] else "")
    if time_match["half"]:
        form += " %p" if time_match["half"].startswith(" ") else "%p"
    return form + ("%z" if time_match["zone"] else "")


def to_seconds(raw: pd.Series, form: str, file: str, column: str) -> _TimeColumn:
    """Seconds since the first row of a column of times, whose index counts the file's lines.

    Raises LogFormatError naming the line of the first field that the format does not fit.
    """
    texts = raw.astype(str).str.strip()
    missing = (raw.isna() | texts.isin(["", "nan", "NaN", "None"])).to_numpy()
    fields = _Fields(texts, missing, file, column)
    if form == DECIMAL:
        nanoseconds, first = _parse_decimal(fields)
        return _subtract_first(nanoseconds, missing, Origin("numbers", first))
    if form == ELAPSED:
        return _TimeColumn(_parse_elapsed(fields), origin=Origin("numbers"))
    if EITHER in form:
        return _parse_either_order(fields, form)
    nanoseconds = _parse_instants(fields, form)
    if re.search(r"%[dYymj]", form):
        return _subtract_first(nanoseconds, missing, _dated(form))
    # at each midnight, which is a step back by more than half a day, a day is added; a smaller step
    # back is a clock that was set, which checks find
    day = 86_400_000_000_000
    valid_rows = np.flatnonzero(~missing)
    back = np.diff(nanoseconds[valid_rows]) < -day // 2
    added = np.zeros(nanoseconds.shape, dtype=np.int64)
    added[valid_rows] = np.concatenate([[0], np.cumsum(back)])
    count = int(back.sum())
    notes = (f"midnight passed {count} time{'s' if count > 1 else ''}",) if count else ()
    origin = Origin("times of day", _SINCE_1900)
    return _subtract_first(nanoseconds + added * day, missing, origin, notes)


def _dated(form: str) -> Origin | None:
    """Zero of the instants of a format with a date; None for one without the year."""
    if not re.search(r"%[Yy]", form):
        return None
    return Origin("date-times with a zone" if "%z" in form else "date-times")


def spreadsheet_to_seconds(days: Array) -> _TimeColumn:
    """Seconds since the first row of days [n] since 1899-12-30, rounded to the microsecond; days no
    calendar has are missing.
    """
    finite = np.isfinite(days) & (np.abs(days) < SPREADSHEET_DAYS)
    microseconds = np.zeros(days.shape, dtype=np.int64)
    microseconds[finite] = np.round(days[finite] * 86400e6).astype(np.int64)
    # in microseconds: nanoseconds of 64 bits end in the year 2262
    first = int(microseconds[np.argmax(finite)]) if finite.any() else 0
    since = np.where(finite, microseconds - first, 0) * 1000
    origin = Origin("date-times", _SINCE_1899 + 1000 * first)
    return _subtract_first(since, ~finite, origin)


def _subtract_first(
    nanoseconds: Integers, missing: Mask, zero: Origin | None, notes: tuple[str, ...] = ()
) -> _TimeColumn:
    """Seconds since the first time that is there; each the float64 nearest to the written digits.

    `zero` is the stamp of nanosecond 0.
    """
    valid_rows = np.flatnonzero(~missing)
    if not valid_rows.size:
        return _TimeColumn(np.full(nanoseconds.shape, np.nan), notes)
    if zero is not None:
        zero = replace(zero, nanoseconds=zero.nanoseconds + int(nanoseconds[valid_rows[0]]))
    elapsed_ns = nanoseconds - nanoseconds[valid_rows[0]]
    # whole microseconds: one division of exact numbers gives the float64 nearest to the digits
    seconds = elapsed_ns // 1000 / 1e6
    if np.any(elapsed_ns % 1000):
        seconds = np.where(np.abs(elapsed_ns) < 1 << 53, elapsed_ns / 1e9, elapsed_ns / 1e6 / 1e3)
    return _TimeColumn(np.where(missing, np.nan, seconds), notes, zero)


def _parse_instants(fields: _Fields, form: str) -> Integers:
    """Nanoseconds of each field since some fixed instant; raises LogFormatError at the first that
    does not fit.
    """
    import pandas as pd

    texts = fields.texts
    if ":%f" in form:
        # milliseconds behind a colon have three digits: 7 could be 0.7 s or 0.007 s
        short = ~texts.str.contains(r":\d{3}(?:\D|$)", regex=True).to_numpy() & ~fields.missing
        if short.any():
            row = int(np.argmax(short))
            raise LogFormatError(
                f"{fields.file}:{int(texts.index[row]) + 2}: column '{fields.column}':"
                f" '{texts.iloc[row]}': milliseconds without three digits",
                hint="it could be tenths or thousandths; repair the log",
            )
    try:
        instants = pd.to_datetime(texts, format=form, errors="coerce", utc="%z" in form)
    except ValueError as error:
        raise LogFormatError(
            f"{fields.file}: column '{fields.column}': time format '{form}': {error}",
            hint="correct time_format",
        ) from None
    wrong = instants.isna().to_numpy() & ~fields.missing
    if wrong.any() and "%f" in form:
        shorter = re.sub(r"[.,:]%f", "", form)
        without_fraction = pd.to_datetime(
            texts[wrong], format=shorter, errors="coerce", utc="%z" in form
        )
        instants[wrong] = without_fraction.astype(instants.dtype)
        wrong = instants.isna().to_numpy() & ~fields.missing
    years = instants.dt.year.to_numpy()
    wrong |= (years < FIRST_YEAR) | (years > LAST_YEAR)
    if wrong.any():
        raise fields.fault(int(np.argmax(wrong)), f"a time as {form}", _REPAIR)
    if "%z" in form:
        instants = instants.dt.tz_localize(None)
    return instants.astype("datetime64[ns]").to_numpy().astype(np.int64)


def _parse_either_order(fields: _Fields, form: str) -> _TimeColumn:
    """Seconds where day and month could be either: the order that can be, and that runs
    forwards.
    """
    mark, valid = form[len(EITHER)], ~fields.missing
    forms = {
        "day first": form.replace(EITHER, f"%d{mark}%m"),
        "month first": form.replace(EITHER, f"%m{mark}%d"),
    }
    clocks: list[_TimeColumn] = []
    for order, written in forms.items():
        try:
            nanoseconds = _parse_instants(fields, written)
        except LogFormatError as error:
            refused = error
            continue
        guess = Guess(f"dates read {order} (time_format guessed)")
        clocks.append(_subtract_first(nanoseconds, fields.missing, _dated(form), (guess,)))
    if not clocks:
        raise refused
    forwards = [clock for clock in clocks if np.all(np.diff(clock.seconds[valid]) > 0.0)]
    possible_clocks = forwards or clocks
    day = 86_400.0
    leaps = [np.abs(np.diff(clock.seconds[valid])).max(initial=0.0) for clock in possible_clocks]
    if len(leaps) == 2 and min(leaps) < day and max(leaps) > 20.0 * day:
        # one runs on at midnight, the other leaps by weeks
        possible_clocks = [possible_clocks[int(np.argmin(leaps))]]
    if len(possible_clocks) == 1:
        return possible_clocks[0]
    if not np.array_equal(possible_clocks[0].seconds, possible_clocks[1].seconds, equal_nan=True):
        raise LogFormatError(
            f"{fields.file}: column '{fields.column}': '{fields.texts.iloc[0]}': day and month"
            " could be either",
            hint=f"pin time_format in the recipe: {' or '.join(map(repr, forms.values()))}",
        )
    return _TimeColumn(
        possible_clocks[0].seconds,
        ("dates: day and month could be either, the seconds are the same",),
    )


def _parse_elapsed(fields: _Fields) -> Array:
    """Seconds of elapsed h:m:s."""
    seconds = np.full(fields.missing.size, np.nan)
    for row, text in enumerate(fields.texts):
        if fields.missing[row]:
            continue
        time_match = _TIME.fullmatch(text)
        # milliseconds behind a colon have three digits: 7 could be 0.7 s or 0.007 s
        if (
            not time_match
            or not time_match["s"]
            or max(int(time_match["m"]), int(time_match["s"])) > 59
            or (time_match["mark"] == ":" and len(time_match["f"]) != 3)
            or time_match["half"]
            or time_match["zone"]
        ):
            raise fields.fault(row, "elapsed h:m:s", _REPAIR)
        whole_seconds = (
            3600 * int(time_match["h"]) + 60 * int(time_match["m"]) + int(time_match["s"])
        )
        seconds[row] = float(f"{whole_seconds}.{time_match['f'] or 0}")
    return seconds


def _parse_decimal(fields: _Fields) -> tuple[Integers, int]:
    """Nanoseconds of decimal seconds of any length, counted from the first, and those of the
    first.
    """
    nanoseconds = np.zeros(fields.missing.size, dtype=np.int64)
    first: Decimal | None = None
    for row, text in enumerate(fields.texts):
        if fields.missing[row]:
            continue
        try:
            # Python reads 1_000 as a number, no logger does
            value = Decimal(text.replace(",", ".").replace("_", "?"))
            first = value if first is None else first
            nanoseconds[row] = int((value - first).scaleb(9).to_integral_value())
        except (InvalidOperation, OverflowError, ValueError):
            raise fields.fault(row, "a number", "repair the row") from None
    return nanoseconds, 0 if first is None else int(first.scaleb(9).to_integral_value())

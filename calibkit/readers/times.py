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
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.readers.table import Guess

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from calibkit.arrays import Array, Integers, Mask


EXCEL, ELAPSED, DECIMAL = "excel", "elapsed", "decimal"
"""Formats that are words: spreadsheet days, h:m:s since the start, decimal seconds."""
EITHER = "%?"
"""Stands for day and month in an order that is not known yet."""
SPREADSHEET_DAYS = 2_958_466
"""Days from 1899-12-30 to the end of the year 9999."""
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
    """Seconds since the first row [n], NaN where no time is written, and what was decided on the
    way.
    """

    seconds: Array
    notes: tuple[str, ...]


def looks_like_time(field: str) -> bool:
    """Whether a field is a date, a time of day, or both."""
    field = field.strip()
    return (":" in field or "-" in field or "/" in field or "." in field or "年" in field) and bool(
        _form(field)
    )


def is_decimal(field: str) -> bool:
    """Whether a field is a plain decimal number, with a point or a comma."""
    return re.fullmatch(r"\s*[+-]?\d+(?:[.,]\d*)?\s*", field, re.ASCII) is not None


def recognise_format(fields: Sequence[str]) -> str:
    """Format that most of some fields have, or "" where they are no times."""
    forms = [form for form in (_form(field.strip()) for field in fields) if form]
    if 2 * len(forms) <= len(fields):
        return ""
    with_fraction = [form for form in forms if "%f" in form]
    usual = max(set(with_fraction or forms), key=(with_fraction or forms).count)
    hours = [int(found["h"]) for field in fields if (found := _TIME.fullmatch(field.strip()))]
    if usual.startswith("%H") and max(hours, default=0) > 23:
        return ELAPSED
    return usual


def _form(field: str) -> str:
    """Format of one field, or "" where it is no time."""
    for pattern, form in _DATES:
        found = pattern.match(field)
        if found:
            date, rest = form.format(found.group(2)), field[found.end() :]
            if not rest:
                return date
            joint = re.match(r"[ T]+", rest)
            time = _time_form(rest[joint.end() :]) if joint else ""
            return date + (joint.group() if joint else "") + time if time else ""
    return _time_form(field) if ":" in field else ""


def _time_form(field: str) -> str:
    """Format of a time of day, or "" where it is none."""
    found = _TIME.fullmatch(field)
    if not found:
        return ""
    form = ("%I" if found["half"] else "%H") + ":%M"
    if found["s"]:
        form += ":%S" + (f"{found['mark']}%f" if found["f"] else "")
    if found["half"]:
        form += " %p" if found["half"].startswith(" ") else "%p"
    return form + ("%z" if found["zone"] else "")


def to_seconds(fields: pd.Series, form: str, place: str) -> _TimeColumn:
    """Seconds since the first row of a column of times; `place` is file and column, the index
    counts the file's lines.

    Raises LogFormatError naming the line of the first field that the format does not fit.
    """
    texts = fields.astype(str).str.strip()
    missing = (fields.isna() | texts.isin(["", "nan", "NaN", "None"])).to_numpy()
    if form == DECIMAL:
        return _since_first(_decimal(texts, missing, place), missing, ())
    if form == ELAPSED:
        return _TimeColumn(_elapsed(texts, missing, place), ())
    if EITHER in form:
        return _day_or_month(texts, missing, form, place)
    nanoseconds = _instants(texts, missing, form, place)
    notes: tuple[str, ...] = ()
    if not re.search(r"%[dYymj]", form):
        nanoseconds, notes = _past_midnight(nanoseconds, missing)
    return _since_first(nanoseconds, missing, notes)


def spreadsheet_to_seconds(days: Array) -> Array:
    """Seconds since the first row of days [n] since 1899-12-30, rounded to the microsecond; days no
    calendar has are missing.
    """
    finite = np.isfinite(days) & (np.abs(days) < SPREADSHEET_DAYS)
    microseconds = np.zeros(days.shape, dtype=np.int64)
    microseconds[finite] = np.round(days[finite] * 86400e6).astype(np.int64)
    return _since_first(microseconds * 1000, ~finite, ()).seconds


def _since_first(nanoseconds: Integers, missing: Mask, notes: tuple[str, ...]) -> _TimeColumn:
    """Seconds since the first time that is there; each the float64 nearest to the written
    digits.
    """
    there = np.flatnonzero(~missing)
    if not there.size:
        return _TimeColumn(np.full(nanoseconds.shape, np.nan), notes)
    apart = nanoseconds - nanoseconds[there[0]]
    seconds = apart / 1e6 / 1e3 if np.any(apart % 1000) else (apart // 1000) / 1e6
    seconds = (
        np.where(np.abs(apart) < 1 << 53, apart / 1e9, seconds) if np.any(apart % 1000) else seconds
    )
    return _TimeColumn(np.where(missing, np.nan, seconds), notes)


def _instants(texts: pd.Series, missing: Mask, form: str, place: str) -> Integers:
    """Nanoseconds of each field since some fixed instant; raises LogFormatError at the first that
    does not fit.
    """
    import pandas as pd

    if ":%f" in form:
        _three_digits(texts, missing, place)
    try:
        found = pd.to_datetime(texts, format=form, errors="coerce", utc="%z" in form)
    except ValueError as error:
        raise LogFormatError(
            f"{place}: time format '{form}': {error}", hint="correct time_format"
        ) from None
    wrong = found.isna().to_numpy() & ~missing
    if wrong.any() and "%f" in form:
        shorter = re.sub(r"[.,:]%f", "", form)
        again = pd.to_datetime(texts[wrong], format=shorter, errors="coerce", utc="%z" in form)
        found[wrong] = again.astype(found.dtype)
        wrong = found.isna().to_numpy() & ~missing
    years = found.dt.year.to_numpy()
    wrong |= (years < FIRST_YEAR) | (years > LAST_YEAR)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        file, _, column = place.partition(": ")
        raise LogFormatError(
            f"{file}:{int(texts.index[row]) + 2}: {column}: found '{str(texts.iloc[row])[:40]}',"
            f" expected a time as {form}",
            hint="repair the row, or pin time_format in the recipe",
        )
    if "%z" in form:
        found = found.dt.tz_localize(None)
    return found.astype("datetime64[ns]").to_numpy().astype(np.int64)


def _three_digits(texts: pd.Series, missing: Mask, place: str) -> None:
    """Refuse milliseconds behind a colon that have not three digits: 7 could be 0.7 s or 0.007
    s.
    """
    short = ~texts.str.contains(r":\d{3}(?:\D|$)", regex=True).to_numpy() & ~missing
    if short.any():
        row = int(np.flatnonzero(short)[0])
        file, _, column = place.partition(": ")
        raise LogFormatError(
            f"{file}:{int(texts.index[row]) + 2}: {column}: '{texts.iloc[row]}': milliseconds"
            " without three digits",
            hint="it could be tenths or thousandths; repair the log",
        )


def _day_or_month(texts: pd.Series, missing: Mask, form: str, place: str) -> _TimeColumn:
    """Seconds where day and month could be either: the order that can be, and that runs
    forwards.
    """
    mark = form[len(EITHER)]
    orders = {"day first": f"%d{mark}%m", "month first": f"%m{mark}%d"}
    clocks: dict[str, _TimeColumn] = {}
    for name, order in orders.items():
        try:
            nanoseconds = _instants(texts, missing, form.replace(EITHER, order), place)
        except LogFormatError as error:
            refused = error
            continue
        clocks[name] = _since_first(
            nanoseconds, missing, (Guess(f"dates read {name} (time_format guessed)"),)
        )
    if not clocks:
        raise refused
    forwards = {
        name: clock
        for name, clock in clocks.items()
        if np.all(np.diff(clock.seconds[~missing]) > 0.0)
    }
    left = _unbroken(list((forwards or clocks).values()), missing)
    if len(left) == 2 and not np.array_equal(left[0].seconds, left[1].seconds, equal_nan=True):
        file, _, column = place.partition(": ")
        raise LogFormatError(
            f"{file}: {column}: '{texts.iloc[0]}': day and month could be either",
            hint=(
                f"pin time_format in the recipe: '{form.replace(EITHER, orders['day first'])}' or "
                f"'{form.replace(EITHER, orders['month first'])}'"
            ),
        )
    if len(left) == 2:
        return _TimeColumn(
            left[0].seconds, ("dates: day and month could be either, the seconds are the same",)
        )
    return left[0]


def _unbroken(clocks: list[_TimeColumn], missing: Mask) -> list[_TimeColumn]:
    """The clock that runs on at midnight where the other leaps by weeks; both where neither
    shows.
    """
    day = 86_400.0
    largest = [float(np.abs(np.diff(clock.seconds[~missing])).max(initial=0.0)) for clock in clocks]
    if len(clocks) == 2 and min(largest) < day and max(largest) > 20.0 * day:
        return [clocks[largest.index(min(largest))]]
    return clocks


def _past_midnight(nanoseconds: Integers, missing: Mask) -> tuple[Integers, tuple[str, ...]]:
    """Times of day with a day added at each midnight: a step back by more than half a day."""
    day = 86_400_000_000_000
    there = np.flatnonzero(~missing)
    back = np.diff(nanoseconds[there]) < -day // 2
    added = np.zeros(nanoseconds.shape, dtype=np.int64)
    added[there] = np.concatenate([[0], np.cumsum(back)])
    count = int(back.sum())
    notes = (f"midnight passed {count} time{'s' if count > 1 else ''}",) if count else ()
    return nanoseconds + added * day, notes


def _elapsed(texts: pd.Series, missing: Mask, place: str) -> Array:
    """Seconds of elapsed h:m:s."""
    file, _, column = place.partition(": ")
    seconds = np.full(len(texts), np.nan)
    for row, text in enumerate(texts):
        if missing[row]:
            continue
        found = _TIME.fullmatch(text)
        # milliseconds behind a colon have three digits: 7 could be 0.7 s or 0.007 s
        if (
            not found
            or not found["s"]
            or max(int(found["m"]), int(found["s"])) > 59
            or (found["mark"] == ":" and len(found["f"]) != 3)
            or found["half"]
            or found["zone"]
        ):
            raise LogFormatError(
                f"{file}:{int(texts.index[row]) + 2}: {column}: found '{text[:40]}', expected"
                " elapsed h:m:s",
                hint="repair the row, or pin time_format in the recipe",
            )
        whole = 3600 * int(found["h"]) + 60 * int(found["m"]) + int(found["s"])
        seconds[row] = float(f"{whole}.{found['f'] or 0}")
    return seconds


def _decimal(texts: pd.Series, missing: Mask, place: str) -> Integers:
    """Nanoseconds of decimal seconds of any length, counted from the first."""
    file, _, column = place.partition(": ")
    nanoseconds = np.zeros(len(texts), dtype=np.int64)
    first: Decimal | None = None
    for row, text in enumerate(texts):
        if missing[row]:
            continue
        try:
            value = Decimal(
                text.replace(",", ".").replace("_", "?")
            )  # no digit to Python's own taste
            first = value if first is None else first
            nanoseconds[row] = int((value - first).scaleb(9).to_integral_value())
        except (InvalidOperation, OverflowError, ValueError):
            raise LogFormatError(
                f"{file}:{int(texts.index[row]) + 2}: {column}: found '{text[:40]}', expected a"
                " number",
                hint="repair the row, or leave the range out with [[exclude]]",
            ) from None
    return nanoseconds

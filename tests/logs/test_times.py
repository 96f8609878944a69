"""Times as loggers write them, against the calendar of the standard library; what could be two
times is refused.
"""

import datetime as dt

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import LogFormatError
from calibkit.readers import times

WRITTEN = (
    "%Y-%m-%d %H:%M:%S.%f",
    "%Y/%m/%dT%H:%M:%S,%f",
    "%d.%m.%Y %H:%M:%S.%f",
    "%Y年%m月%d日 %H:%M:%S.%f",
    "%Y-%m-%d %I:%M:%S.%f %p",
)


def seconds(*fields, form=""):
    """Clock of a column of fields, whose first stands in line 2."""
    form = form or times.recognise_format([str(field) for field in fields])
    return times.to_seconds(pd.Series(fields), form, "log.csv", "time")


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.integers(0, 100 * 366 * 86_400 * 10**6), min_size=2, max_size=6),
    st.sampled_from(WRITTEN),
)
def test_dates_are_told_apart_as_the_calendar_does(microseconds, form):
    """Any dates of a century, to the microsecond, in the forms that are recognised by
    themselves.
    """
    start = dt.datetime(1990, 1, 1, tzinfo=dt.UTC)
    fields = [(start + dt.timedelta(microseconds=after)).strftime(form) for after in microseconds]
    expected = [(after - microseconds[0]) / 1e6 for after in microseconds]
    assert seconds(*fields).seconds.tolist() == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        (("23:59:58", "23:59:59", "00:00:01"), [0.0, 1.0, 3.0]),
        (("11:59:59 PM", "12:00:01 AM"), [0.0, 2.0]),
        (("10:00:00.5", "10:00:01", "10:00:01.25"), [0.0, 0.5, 0.75]),
        (("10:00:00:500", "10:00:01:007"), [0.0, 0.507]),
        (("2026-03-29T00:30:00+01:00", "2026-03-29T02:30:00+02:00"), [0.0, 3600.0]),
        (("29:59:59.5", "30:00:01.25"), [107999.5, 108001.25]),
        (("29:59:59:500", "30:00:01:250"), [107999.5, 108001.25]),
        (("13.02.26 10:00", "13.02.26 10:01"), [0.0, 60.0]),
        (("2026-01-31", "2026-02-01"), [0.0, 86400.0]),
        ((None, "10:00:00", "10:00:02"), [np.nan, 0.0, 2.0]),
        (("10:00:00", "", "10:00:02"), [0.0, np.nan, 2.0]),
    ],
)
def test_a_time_is_the_instant_that_it_names(fields, expected):
    """Midnight, halves of the day, fractions, zones, hours beyond a day, missing ones."""
    np.testing.assert_allclose(seconds(*fields).seconds, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("fields", "order", "expected"),
    [
        (("31/01/2026 10:00:00", "01/02/2026 10:00:00"), "day first", 86400.0),
        (("01/31/2026 10:00:00", "02/01/2026 10:00:00"), "month first", 86400.0),
        (("11/02/2026 23:00:00", "12/02/2026 01:00:00"), "day first", 7200.0),
        (("02/11/2026 23:00:00", "02/12/2026 01:00:00"), "month first", 7200.0),
    ],
)
def test_day_and_month_are_those_that_the_log_allows(fields, order, expected):
    """A 31st, or a log that would leap by a month at midnight, tells the order; it is said that it
    was guessed.
    """
    found = seconds(*fields)
    assert found.seconds.tolist() == [0.0, expected]
    assert found.notes == (f"dates read {order} (time_format guessed)",)


@pytest.mark.parametrize(
    ("fields", "form", "fragment"),
    [
        (("03/04/2026 10:00:00", "04/04/2026 10:00:00"), "", "day and month could be either"),
        (
            ("13/13/2026 10:00:00", "13/13/2026 10:00:01"),
            "",
            "log.csv:2: column 'time': found '13/13/2026 10:00:00'",
        ),
        (("10:00:00", "10:00:99"), "", "log.csv:3: column 'time': found '10:00:99'"),
        (
            ("10:00:00:500", "10:00:01:7"),
            "%H:%M:%S:%f",
            "log.csv:3: column 'time': '10:00:01:7': milliseconds",
        ),
        (
            ("30:00:00", "30:75:00"),
            "",
            "log.csv:3: column 'time': found '30:75:00', expected elapsed h:m:s",
        ),
        (("30:00:00", "30:00:01:7"), times.ELAPSED, "found '30:00:01:7', expected elapsed h:m:s"),
        (("30:00:00", "3:00:00 PM"), times.ELAPSED, "found '3:00:00 PM', expected elapsed h:m:s"),
        (("1.5", "x"), times.DECIMAL, "log.csv:3: column 'time': found 'x', expected a number"),
        (
            ("1.5", "Infinity"),
            times.DECIMAL,
            "log.csv:3: column 'time': found 'Infinity', expected a number",
        ),
        (("2026-01-01", "2026-01-02"), "%Y-%m-%d %Q", "time format '%Y-%m-%d %Q'"),
        (("1492-10-12", "1492-10-13"), "%Y-%m-%d", "log.csv:2: column 'time': found '1492-10-12'"),
    ],
)
def test_what_is_no_time_or_could_be_two_is_refused_with_its_line(fields, form, fragment):
    """Nothing is rounded into a time: the line, what was found and what was expected."""
    with pytest.raises(LogFormatError) as refused:
        seconds(*fields, form=form)
    assert fragment in str(refused.value)


def test_spreadsheet_days_are_instants_to_the_microsecond():
    """46000.25 days and what follows it; a cell without a value, or beyond the calendar, is
    missing.
    """
    found = times.spreadsheet_to_seconds(
        np.array([np.nan, 46000.25, 46000.25 + 1.5 / 86400.0, 1e9])
    ).seconds
    assert np.isnan(found[[0, 3]]).all()
    assert found[1:3].tolist() == [0.0, pytest.approx(1.5, abs=1e-6)]

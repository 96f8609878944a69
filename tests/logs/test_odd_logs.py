"""Odd files as laboratories and calibrators send them: each gives the coefficients of the clean
log, or is refused with what it is.
"""

import pytest

from calibkit import instruments, recipe
from calibkit.errors import CalibkitError
from calibkit.logs import log_files
from logs.odd_logs import (
    BLANKS,
    BODY,
    DROP,
    GERMAN,
    HEADER,
    LISTED,
    TABLES,
    TIMES,
    TORN,
    Odd,
    clocked,
    exclude,
    text,
)

RECIPE = """procedure = "bias_temperature"
{head}
[polynomials]
abscissa = "temp_case_degc"
min_rows = 10
max_gap_s = 60.0
bias = [{{ indication = "gyro_dph", order = 2 }}]

[logs]
files = ["a{suffix}"]
{logs}

{tables}
"""
ODD = TORN | TIMES | TABLES
SEMICOLONS = HEADER.replace(",", ";")


def read(odd, folder):
    """Return the recipe of an odd file, which is written into a folder, and its logs."""
    (folder / f"a{odd.suffix}").write_bytes(odd.data)
    words = RECIPE.format(head=odd.head, suffix=odd.suffix, logs=odd.logs, tables=odd.tables)
    spec = instruments.parse_recipe(recipe.Source("r.toml", words))
    return spec, log_files.find_logs(spec, folder)


def fit(odd, folder):
    """Return the coefficients that a fit of an odd file gives, by name."""
    spec, names = read(odd, folder)
    fitted = instruments.find(spec.procedure).fit(spec, folder, names, instruments.silent)
    models = [model for result in fitted.results for model in result.models]
    return {entry.name: entry.value for model in models for entry in model.coefficients}


def refusal(odd, folder):
    """Return the words with which an odd file is refused."""
    spec, names = read(odd, folder)
    with pytest.raises(CalibkitError) as refused:
        instruments.find(spec.procedure).read(spec, folder, names[0])
    return str(refused.value)


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Return the coefficients of the clean log."""
    return fit(Odd(text(HEADER, *BODY)), tmp_path_factory.mktemp("clean"))


@pytest.mark.parametrize("name", ODD)
def test_an_odd_file_gives_the_coefficients_of_the_clean_log(name, clean, tmp_path):
    """Every coefficient of every odd file agrees with that of the clean log to 1e-9."""
    found = fit(ODD[name], tmp_path)
    assert found.keys() == clean.keys()
    for key, value in clean.items():
        assert found[key] == pytest.approx(value, rel=1e-9, abs=1e-9)


REFUSED = {
    "a torn line": (
        Odd(text(HEADER, *BODY[:6], "-0.3-0.31", *BODY[6:])),
        ("a.csv:8: 1 fields, expected 3", 'torn_lines = "drop"', 'log = "a.csv", lines = [8]'),
    ),
    "a torn number": (
        Odd(text(HEADER, *BODY[:6], "12.0,-17.-17.6,8.9", *BODY[6:])),
        ("a.csv:8: column 'temp_case_degc'", 'torn_lines = "drop"', "lines = [8]"),
    ),
    "more torn lines than the limit": (
        Odd(text(HEADER, *BODY[:6], *["-0.3-0.31"] * 11, *BODY[6:]), DROP),
        ("11 torn lines (8-18), expected at most torn_limit = 10",),
    ),
    "an incomplete last line": (
        Odd((text(HEADER, *BODY) + "240.0,5").encode()),
        ("a.csv:122: 2 fields", 'last_line = "drop"'),
    ),
    "an incomplete last line where torn lines are dropped": (
        Odd((text(HEADER, *BODY[:-1]) + BODY[-1][:-2]).encode(), DROP),
        ("has 2 decimals and no line end", 'last_line = "drop"'),
    ),
    "a wrong decimal mark": (
        Odd(text(SEMICOLONS, *GERMAN), 'text = { decimal = "." }'),
        ("a.csv:2: column 'time_s': found '0,0'", "decimal comma? Set decimal = ','"),
    ),
    "a decimal point where commas are pinned": (
        Odd(text(SEMICOLONS, *(row.replace(",", ";") for row in BODY)), "text = { decimal = ',' }"),
        ("decimal point? Set decimal = '.'",),
    ),
    "decimal commas between commas": (
        Odd(text(HEADER, *(row.replace(".", ",") for row in BODY))),
        ("a.csv:2: 6 fields, expected 3", "decimal commas between commas?"),
    ),
    "a footer": (
        Odd(text(SEMICOLONS, *GERMAN, "Ende der Messung")),
        ("a.csv:122: 1 fields", "a footer? Set footer_lines = 1"),
    ),
    "a footer with a blank line in it": (
        Odd(text(HEADER, *BODY, "", "Operator,Huber,x", "Mean,12.3")),
        ("a.csv:124: 2 fields", "a footer? Set footer_lines = 2"),
    ),
    "lines above headerless rows": (
        Odd(text("Logger v3", "begin", *BLANKS), LISTED, suffix=".txt"),
        ("a.txt:1: 2 fields", 'skip_lines = { "a.txt" = 2 }'),
    ),
    "a wrong number of lines above the rows": (
        Odd(
            text("Logger v3", "begin", *BLANKS),
            f"{LISTED}\ntext = {{ skip_lines = 1 }}",
            suffix=".txt",
        ),
        ("a.txt:2: found 'begin', expected the header or the first row",),
    ),
    "thousands with and without a mark": (
        Odd(text(SEMICOLONS, "0.0;20.0;1,002.5", "2.0;21.0;1003.5", "4.0;22.0;1,004.5")),
        ("a.csv:2", "'1,002.5' has a mark between its thousands", "'1003.5' in line 3 has none"),
    ),
    "scans above the header of their log": (
        Odd(
            text(
                "1,03/21/2014 17:00:00:000,20.5,9.1",
                "Sweep #,Time,Chan 101 (C),Chan 102 (VDC)",
                "2,03/21/2014 17:00:02:000,20.6,9.2",
            )
        ),
        ("a.csv:1: a scan stands above the header",),
    ),
    "rows that are not there": (
        Odd(text(HEADER, *BODY), head=exclude("rows = [121]")),
        ("no row with number 121; check rows",),
    ),
    "a position that no column states": (
        Odd(text(HEADER, *BODY), head=exclude("positions = [2]")),
        ("column 'position' is missing",),
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_with_a_file_is_named_as_what_it_is(name, tmp_path):
    """A refusal has the line, what it is, and words that can be pasted into the recipe."""
    odd, fragments = REFUSED[name]
    words = refusal(odd, tmp_path)
    for fragment in fragments:
        assert fragment in words


def test_what_is_left_out_is_counted_and_listed(tmp_path):
    """Comments, blank and torn lines are notes of the log with their lines; lines of rows stay."""
    content = text(HEADER, *BODY[:6], "# pause", "-0.3-0.31", "", *BODY[6:])
    spec, names = read(Odd(content, DROP), tmp_path)
    log = instruments.find(spec.procedure).read(spec, tmp_path, names[0])
    notes = "\n".join(log.notes)
    assert "1 comment(s) among the rows left out, line 8" in notes
    assert '1 torn line(s) left out, line 9: torn_lines = "drop"' in notes
    assert "1 blank line(s) left out, line 10" in notes
    assert (log.line(5), log.line(6)) == (7, 11)


@pytest.mark.parametrize(
    ("factor", "rows", "words", "key"),
    [
        (1e6, "120 rows over 2.38e+08 s, one every 2e+06 s", "microseconds?", 'unit = "us"'),
        (5e5, "120 rows over 1.19e+08 s, one every 1e+06 s", "microseconds?", 'unit = "us"'),
        (1e9, "one every 2e+09 s", "nanoseconds?", 'unit = "ns"'),
        (32768.0, "one every 65536 s", "ticks of 1/32768 s?", "scale = 3.0517578125e-05"),
        (1e4, "one every 20000 s", "milliseconds or microseconds?", 'unit = "ms"'),
    ],
)
def test_stamps_that_are_no_seconds_are_questioned(factor, rows, words, key, tmp_path):
    """Numbers without a unit whose spacing no logger has are refused with what they look like; a
    recipe that says seconds is believed.
    """
    content = text(HEADER, *clocked(lambda s: round(s * factor)))
    refused = refusal(Odd(content), tmp_path)
    for fragment in ("column 'time_s': 120 rows over", rows, words, key):
        assert fragment in refused
    spec, names = read(
        Odd(content, tables='[columns]\ntime_s = { from = "time_s", unit = "s" }'), tmp_path
    )
    log = instruments.find(spec.procedure).read(spec, tmp_path, names[0])
    assert log.frame["time_s"].iloc[1] == 2.0 * factor

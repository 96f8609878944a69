"""Units, signs, clocks and counters of columns: what comes out, what is noted, what is refused."""

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.errors import CalibkitError, FrameError, LogFormatError
from calibkit.logs import log_files
from calibkit.readers import parts


def read(tmp_path, content, columns, needed, logs="", name="log.csv", site=""):
    """Read a log by a recipe with the given tables."""
    (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
    text = (
        f'procedure = "accelerometer"\n{site}[logs]\nfiles = ["*"]\n{logs}\n[columns]\n{columns}\n'
    )
    spec = instruments.parse_recipe(recipe.Source("r.toml", text))
    return log_files.read_log(spec, tmp_path / name, name, needed)


def column(log, name):
    """One column as a list."""
    return log.frame[name].tolist()


@pytest.mark.parametrize(
    ("header", "mapping", "value", "name", "expected"),
    [
        ("w (deg/s)", 'from = "w"', "0.5", "gyro_dph", 1800.0),
        ("w", 'from = "w", unit = "deg/s", sign = -1', "0.5", "gyro_dph", -1800.0),
        ("T (℉)", 'from = "T"', "212", "temp_case_degc", 100.0),
        (
            "U (VDC)",
            'from = "U", scale = 100.0, offset = -40.0, unit = "degC"',
            "0.65",
            "temp_case_degc",
            25.0,
        ),
        ("a (m/s²)", 'from = "a"', "9.79", "accel_x_g", 1.0),
        ("n", 'from = "n", unit = "1/sample", interval_s = 0.0025', "100", "gyro_x_lsb", 40000.0),
        ("T", 'from = "T", scale = 0.0625', "-400", "temp_case_degc", -25.0),
    ],
)
def test_a_value_comes_out_in_the_unit_of_its_column(
    tmp_path, header, mapping, value, name, expected
):
    """Sign · (scale · value + offset), from the recipe's unit or the header's."""
    site = "[site]\ngravity_mps2 = 9.79\n"
    log = read(
        tmp_path,
        f"x,{header}\n0,{value}\n1,{value}\n",
        f"{name} = {{ {mapping} }}",
        (name,),
        site=site,
    )
    np.testing.assert_allclose(column(log, name), expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("time_s,gyro_dph (mrad/min)", "mrad/min"),
        ("time_s,gyro_dph [kdeg/h]", "kdeg/h"),
        ("time_s (fortnights),gyro_dph", "fortnights"),
    ],
)
def test_a_unit_that_nobody_knows_is_refused_until_the_recipe_states_it(tmp_path, header, unit):
    """A unit in a header that is not in the table is never taken for the canonical one."""
    content = f"{header}\n0,1\n1,2\n"
    with pytest.raises(FrameError, match=f"states the unit '{unit}', which is not known"):
        read(tmp_path, content, "", ("time_s", "gyro_dph"))
    source = next(name for name in header.split(",") if unit in name)
    name = source.split()[0]
    pinned = f'[columns.{name}]\nfrom = "{source}"\nunit = "{"s" if name == "time_s" else "deg/h"}"'
    log = read(tmp_path, content, pinned, ("time_s", "gyro_dph"))
    np.testing.assert_array_equal(column(log, "gyro_dph"), [1.0, 2.0])


@pytest.mark.parametrize("label", ["x", "axis 1", "case", "raw", "Pt100", "CH 3", "外"])
def test_a_label_in_brackets_is_no_unit(tmp_path, label):
    """A name of a sensor or axis behind a column's name changes nothing."""
    log = read(tmp_path, f"time_s,gyro_dph ({label})\n0,1\n1,2\n", "", ("time_s", "gyro_dph"))
    np.testing.assert_array_equal(column(log, "gyro_dph"), [1.0, 2.0])


def test_a_unit_of_another_dimension_is_refused_with_the_log(tmp_path):
    """Volts are no temperature until a scale says how."""
    with pytest.raises(CalibkitError, match=r"log.csv: column 'T \(VDC\)': 'V' is a voltage"):
        read(tmp_path, "x,T (VDC)\n0,1\n", 'temp_case_degc = { from = "T" }', ("temp_case_degc",))


@pytest.mark.parametrize("unit", ["", 'unit = "1", ', 'unit = "1/sample", '])
@pytest.mark.parametrize("header", ["n", "n (counts)"])
def test_a_counter_counts_whatever_says_so(tmp_path, header, unit):
    """Differences of a counter are counts per sample, said or not; a counter of anything else is
    refused.
    """
    mapping = f'time_s = {{ from = "t" }}\ngyro_x_lsb = {{ from = "n", {unit}accumulated = true }}'
    log = read(tmp_path, f"t,{header}\n0,0\n0.5,10\n1.5,20\n", mapping, ("time_s", "gyro_x_lsb"))
    assert column(log, "gyro_x_lsb") == [20.0, 10.0]
    with pytest.raises(CalibkitError, match="accumulated 1/s, expected accumulated counts"):
        read(
            tmp_path,
            "t,n (counts/s)\n0,0\n1,1\n",
            mapping.replace(unit or "@", ""),
            ("time_s", "gyro_x_lsb"),
        )


@pytest.mark.parametrize(("interval", "told"), [("0.1", True), ("0.5", False)])
def test_an_interval_that_is_not_the_rows_is_told(tmp_path, interval, told):
    """Rows of every half second that are said to count 0.1 s each: right of a thinned log, else
    five times too much.
    """
    content = "t,n\n0,5\n0.5,7\n1.0,6\n"
    mapping = (
        'time_s = { from = "t" }\ngyro_x_lsb = { from = "n", unit = "1/sample", interval_s ='
        f" {interval} }}"
    )
    log = read(tmp_path, content, mapping, ("time_s", "gyro_x_lsb"))
    assert any("0.5 s apart" in note and "are 5 times" in note for note in log.notes) == told


def test_accumulated_pulses_become_rates_across_a_wrap(tmp_path):
    """A sixteen-bit counter at irregular times: counts per second, the wrap said, the first row
    removed and said.
    """
    content = "t,n\n0,65000\n0.5,65500\n1.5,964\n2.0,1464\n"
    mapping = (
        'time_s = { from = "t" }\ngyro_x_lsb = { from = "n", unit = "1", accumulated = true,'
        " wraps_at = 65536.0 }"
    )
    log = read(tmp_path, content, mapping, ("time_s", "gyro_x_lsb"))
    assert column(log, "gyro_x_lsb") == [1000.0, 1000.0, 1000.0]
    assert column(log, "time_s") == [0.5, 1.5, 2.0]
    assert any("1 wrap at 65536" in said for said in log.reading)
    assert any("the first row removed" in note for note in log.notes)
    assert (log.rows, log.place(0)) == (4, "log.csv:3")


@pytest.mark.parametrize(
    "word", ["9.9E+37", "-9.90000000E+37", "+9.0E+9", "-1.0E+9", "OVLD", "LLLL", "", "NaN", "----"]
)
def test_a_value_that_is_none_is_missing_said_and_placed(tmp_path, word):
    """Sentinels and words have no value: counted and placed, or their rows removed where the recipe
    says so.
    """
    content = f"time_s,temp_case_degc\n0,20\n1,{word}\n2,21\n"
    needed = ("time_s", "temp_case_degc")
    log = read(tmp_path, content, "", needed)
    assert np.isnan(column(log, "temp_case_degc")).tolist() == [False, True, False]
    if word not in {"", "NaN"}:
        assert any("1 × no value" in note and "line 3" in note for note in log.notes)
    dropped = read(tmp_path, content, "", needed, logs='missing = "drop"')
    assert column(dropped, "time_s") == [0.0, 2.0]
    assert dropped.rows == 3
    assert any(
        "1 rows removed (1 without temp_case_degc), lines 3" in note for note in dropped.notes
    )
    assert dropped.place(1) == "log.csv:4"


@pytest.mark.parametrize(
    ("stamps", "fragment"),
    [
        (["05/06/2009 10:00:00", "05/07/2009 10:00:00"], "day and month could be either"),
        (["01/02/2009 10:00:00:7", "01/02/2009 10:00:01:7"], "milliseconds without three digits"),
        (
            ["2009-02-28 10:00:00", "2009-02-30 10:00:00"],
            "log.csv:3: column 't': found '2009-02-30 10:00:00'",
        ),
    ],
)
def test_a_time_that_could_be_two_is_refused(tmp_path, stamps, fragment):
    """Ambiguous and impossible times are refused with their line."""
    content = "t;temp_case_degc\n" + "".join(f"{stamp};1,5\n" for stamp in stamps)
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, content, 'time_s = { from = "t" }', ("time_s", "temp_case_degc"))
    assert fragment in str(refused.value)


def test_parts_of_a_split_log_are_one_log(tmp_path):
    """dat00001.csv and dat00002.csv: one log, one digest, rows placed in their own file; a missing
    part is refused.
    """
    for part, start in ((1, 0), (2, 3), (3, 6)):
        rows = "".join(f"{k + 1},{k}.0,2{k}.5,0\n" for k in range(start, start + 3))
        (tmp_path / f"dat0000{part}.csv").write_text("Sweep #,Time,Chan 101 (C),Alarm\n" + rows)
    text = """procedure = "fog_thermal"
[logs]
files = ["dat*.csv"]
format = "keysight"
split = true
[columns]
time_s = { from = "Time", unit = "s" }
temp_case_degc = { from = "Chan 101 (C)" }
"""
    spec = instruments.parse_recipe(recipe.Source("r.toml", text))
    assert log_files.find_logs(spec, tmp_path) == ["dat00001.csv"]
    log = log_files.read_log(
        spec, tmp_path / "dat00001.csv", "dat00001.csv", ("time_s", "temp_case_degc")
    )
    assert column(log, "time_s") == [float(k) for k in range(9)]
    assert [log.place(row) for row in (0, 2, 3, 8)] == [
        "dat00001.csv:2",
        "dat00001.csv:4",
        "dat00002.csv:2",
        "dat00003.csv:4",
    ]
    assert log.sha256 == parts.digest_log(tmp_path / "dat00001.csv", "dat00001.csv", split=True)
    assert log.notes == ()
    (tmp_path / "dat00002.csv").write_text(
        "Sweep #,Time,Chan 101 (C),Alarm\n5,4.0,24.5,1\n6,5.0,25.5,0\n"
    )
    jumped = log_files.read_log(
        spec, tmp_path / "dat00001.csv", "dat00001.csv", ("time_s", "temp_case_degc")
    )
    assert any(
        "scan numbers jump from 3 in dat00001.csv to 5 in dat00002.csv" in note
        for note in jumped.notes
    )
    assert any(
        "dat00002.csv: column 'Chan 101 (C)': alarm in 1 scans, the first in line 2" in n
        for n in jumped.notes
    )
    (tmp_path / "dat00002.csv").unlink()
    with pytest.raises(LogFormatError, match="the next part of this log is number 3, expected 2"):
        log_files.read_log(
            spec, tmp_path / "dat00001.csv", "dat00001.csv", ("time_s", "temp_case_degc")
        )


@pytest.mark.parametrize(
    ("columns", "logs", "fragment"),
    [
        (
            'gyro_dph = { from = "w", time_format = "%H:%M" }',
            "",
            "time_format and date belong to time_s",
        ),
        ('time_s = { from = "t", accumulated = true }', "", "belong to counts"),
        (
            'gyro_dph = { from = "w", interval_s = 1.0 }',
            "",
            "interval_s belongs to unit = '1/sample'",
        ),
        (
            'time_s = { from = "t" }',
            "rate_hz = 10.0",
            "rate_hz = 10, but column 't' holds the time",
        ),
    ],
)
def test_a_key_that_would_say_nothing_is_refused(tmp_path, columns, logs, fragment):
    """A key is never ignored."""
    with pytest.raises(CalibkitError) as refused:
        read(tmp_path, "t,w\n0,1\n", columns, ("time_s",), logs=logs)
    assert fragment in str(refused.value)

"""Formats one by one: what a reader refuses, what it says, what a recipe can pin; the
documentation's recipes are recipes.
"""

import io
import re
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.errors import CalibkitError, LogFormatError, RecipeError, UsageError
from calibkit.logs import log_files
from calibkit.readers import registry
from calibkit.recipe.logs import Logs
from logs.dialects import DIALECTS, Clean

DOCS = Path(__file__).resolve().parents[2] / "docs" / "logs.md"
CLEAN = Clean([[str(k), f"{20 + k}.5", f"{19 + k}.0", f"9.{k:03d}"] for k in range(12)])


def read(tmp_path, data, name="log.dat", needed=("a", "b"), **logs):
    """Read bytes as a log described by keys of [logs]."""
    (tmp_path / name).write_bytes(data)
    return registry.read(tmp_path / name, name, Logs(files=("*",), **logs), set(needed))


@pytest.mark.parametrize(
    ("content", "logs", "fragment"),
    [
        ("a;b\n1,500;2\n1,250;3\n", {}, "log.dat:2: '1,500' is a decimal comma or parts thousands"),
        ("a;b\n1,5;2.5\n1,2;3.5\n", {}, "decimal comma ('1,5') and with a point ('2.5')"),
        ("1;2\n3;4\n", {}, "log.dat:1: 2 columns without names; list the columns in [logs] names"),
        ("1;2\n3;4\n", {"names": ("a", "b", "c")}, "2 fields, the recipe names 3 columns"),
        ("a;b\n1;2\n3;4\n5\n", {}, "log.dat:4: 1 fields, expected 2"),
        ("x\n\na;b;c\n1;2\n3;4\n", {}, "log.dat:3: 3 column names, expected 2"),
        ("a;b\n1;2\n3;4\nend of log\n", {}, "log.dat:4: 1 fields, expected 2"),
        ("one text\nanother\n", {}, "no rows of numbers found"),
        ("a;b\n1;2\n3;4\x01\n", {}, "log.dat:3: a control character (0x01)"),
        ("1;2;3\na;b;c\n4;5;6\n7;8;9\n", {}, "log.dat:1: 3 columns without names"),
    ],
)
def test_text_that_is_not_understood_is_refused_with_what_to_pin(tmp_path, content, logs, fragment):
    """Nothing is guessed where two readings are possible, and no line is taken for what it is
    not.
    """
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, content.encode(), format="text", **logs)
    assert fragment in str(refused.value)


@pytest.mark.parametrize(
    ("raw", "pins", "fragment"),
    [
        ("a;b\n1;°\n2;3\n".encode("cp1252"), {"encoding": "utf-8"}, "byte 0xb0 is not UTF-8 text"),
        (
            b"\xff\xfea\0",
            {"encoding": "utf-8"},
            "the byte-order mark says utf-16-le, the recipe says utf-8",
        ),
        ("°C;温度\n1;2\n".encode()[:-8] + b"\xff;1\n", {}, "is not UTF-8 text"),
        ("a;b\n1;2\n".encode("utf-16-le")[:-1], {"encoding": "utf-16-le"}, "is not UTF-16-LE text"),
        ("温度;b\n1;2\n".encode() + b"\xe6\xb8", {}, "is not UTF-8 text, the rest of the file is"),
    ],
)
def test_a_byte_that_does_not_fit_is_never_replaced(tmp_path, raw, pins, fragment):
    """Wrong encodings, damaged and cut characters are refused with their line."""
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, raw, format="text", text=recipe.logs.TextSpec(**pins))
    assert fragment in str(refused.value)


def test_a_damaged_first_row_is_not_a_preamble(tmp_path):
    """Without a header nothing stands above the rows: a first row with a field too many or too few
    is refused.
    """
    rows = "".join(f"{k},1,2\n" for k in range(2, 9))
    for first in ("0,7,1,2\n", "0,1\n", "damaged\n"):
        with pytest.raises(
            LogFormatError, match=r"log.dat:1: \d fields, expected 3 as in the rows below"
        ):
            read(tmp_path, (first + rows).encode(), format="text", names=("a", "b", "c"))
    pinned = read(
        tmp_path,
        b"title\n" + rows.encode(),
        format="text",
        names=("a", "b", "c"),
        text=recipe.logs.TextSpec(skip_lines=1),
    )
    assert pinned.frame["a"].tolist() == [float(k) for k in range(2, 9)]


@pytest.mark.parametrize("place", [128, 136, 132, 144, 152])
def test_elements_of_a_matlab_file_must_nest(tmp_path, place):
    """A damaged tag is refused before the library that reads it can fall over it."""
    data = bytearray(DIALECTS["MATLAB v5"].write(CLEAN))
    data[place] ^= 0x60
    with pytest.raises(LogFormatError, match=r"x.mat: not a whole MATLAB file: "):
        read(tmp_path, bytes(data), "x.mat", format="matlab", table="log")


def test_a_recording_that_was_cut_off_is_refused(tmp_path):
    """A TDMS file whose second segment was not finished holds whole rows, and is not whole."""
    import nptdms

    stream = io.BytesIO()
    with nptdms.TdmsWriter(stream) as writer:
        for _ in range(2):
            writer.write_segment([nptdms.ChannelObject("run", "a", np.arange(50.0))])
    whole = stream.getvalue()
    assert len(read(tmp_path, whole, "x.tdms").frame) == 100
    with pytest.raises(LogFormatError, match=r"x.tdms: the last segment is not finished"):
        read(tmp_path, whole[:-80], "x.tdms")


def chamber(replies=5, fields=12, echo=""):
    """Return recorded chamber replies at irregular times."""
    lines = []
    for k in range(replies):
        values = [20.0, -40.1 + k, *[0.0] * (fields - 2)]
        lines.append(
            f"2011-12-06 10:0{k}:06 {echo}"
            + " ".join(f"{v:06.1f}" for v in values)
            + " "
            + "01" * 16
        )
    return "\r\n".join(lines) + "\r\n"


@pytest.mark.parametrize("fields", [12, 14])
@pytest.mark.parametrize("echo", ["", "$01I "])
def test_chamber_replies_are_pairs_of_set_and_actual(tmp_path, fields, echo):
    """Twelve or fourteen fields of fixed width, negative ones too, with or without the echo."""
    (tmp_path / "c.txt").write_text(chamber(5, fields, echo), newline="")
    text = """procedure = "fog_thermal"
[logs]
files = ["c.txt"]
format = "chamber"
[columns]
time_s = { from = "time" }
temp_env_degc = { from = "actual 1" }
"""
    log = log_files.read_log(
        instruments.parse_recipe(recipe.Source("r", text)),
        tmp_path / "c.txt",
        "c.txt",
        ("time_s", "temp_env_degc"),
    )
    assert log.frame["time_s"].tolist() == [0.0, 60.0, 120.0, 180.0, 240.0]
    assert log.frame["temp_env_degc"].tolist() == [-40.1, -39.1, -38.1, -37.1, -36.1]


def test_a_chamber_reply_that_is_cut_is_refused(tmp_path):
    """A short reply, and one of another length, are named by their line."""
    cut = chamber().replace(" 0000.0 ", " 0000 ", 1)
    with pytest.raises(LogFormatError, match=r"log.dat:1: found '2011-12-06"):
        read(tmp_path, cut.encode(), format="chamber")
    mixed = chamber(2) + chamber(1, 14)
    with pytest.raises(
        LogFormatError, match=r"log.dat:3: 14 fields and 32 digital channels, expected 12 and 32"
    ):
        read(tmp_path, mixed.encode(), format="chamber")


LVM = DIALECTS["LVM"].write(CLEAN).decode("cp1252")


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        (
            lambda text: text.replace("3\t23.5", "3\t2x.5"),
            "column 'temp_case_degc': found '2x.5', expected a number",
        ),
        (
            lambda text: "\r\n".join(text.split("\r\n")[:-3]) + "\r\n",
            "the segment's header says 12 samples",
        ),
        (lambda text: text.replace("3\t23.5\t", "3\t"), "3 fields, expected 4 and a comment"),
        (lambda text: text.rstrip("\r\n"), "the last line has no end"),
        (
            lambda text: text + text[text.index("Channels") :].replace("gyro_dph", "other"),
            "a segment of other channels: temp_case_degc, temp_env_degc, other",
        ),
    ],
)
def test_a_labview_file_that_is_not_whole_is_refused(tmp_path, change, fragment):
    """Bad numbers, lost rows, lost headers."""
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, change(LVM).encode("cp1252"), "log.lvm", format="lvm")
    assert fragment in str(refused.value)


def test_channels_of_a_labview_file_with_x_columns_of_their_own_share_one_time(tmp_path):
    """X_Columns Multi: the X columns must agree, then they are one; a blank field has no value."""
    head, _, body = LVM.partition("X_Value")
    rows = [line.split("\t") for line in body.split("\r\n")[1:] if line]
    names = "\t".join(
        part
        for name in ("temp_case_degc", "temp_env_degc", "gyro_dph")
        for part in ("X_Value", name)
    )

    def written(at, value):
        lines = [[part for channel in row[1:4] for part in (row[0], channel)] for row in rows]
        lines[3][at] = value
        return (head + "\r\n".join([f"{names}\tComment", *map("\t".join, lines)]) + "\r\n").encode(
            "cp1252"
        )

    table = read(tmp_path, written(3, ""), "log.lvm", format="lvm")
    assert list(table.frame) == ["X_Value", "temp_case_degc", "temp_env_degc", "gyro_dph"]
    assert table.units == {
        "X_Value": "s",
        "temp_case_degc": "degC",
        "temp_env_degc": "degC",
        "gyro_dph": "deg/h",
    }
    plain = read(tmp_path, LVM.encode("cp1252"), "plain.lvm", format="lvm").frame
    plain.iloc[3, 2] = np.nan
    np.testing.assert_array_equal(table.frame.to_numpy(), plain.to_numpy())
    with pytest.raises(LogFormatError, match="channels with times of their own"):
        read(tmp_path, written(2, "3.5"), "log.lvm", format="lvm")


def message(kind, content):
    """One message of a ULog file."""
    return struct.pack("<HB", len(content), ord(kind)) + content


ULOG = DIALECTS["ULog"].write(Clean([[str(k), "1", "2", "3"] for k in range(1, 6)]))


@pytest.mark.parametrize(
    ("data", "fragment"),
    [
        (ULOG[:9], "not a ULog file"),
        (ULOG[:-3], "the file ends inside a message"),
        (ULOG + message("Z", b"123"), f"a message of unknown type 90 at byte {len(ULOG)}"),
        (
            ULOG + message("D", struct.pack("<HQddd", 7, 9, 1, 2, 3)),
            "no subscription found for message id 7",
        ),
        (ULOG + message("D", struct.pack("<HQ", 0, 9)), "marked as corrupt"),
    ],
)
def test_a_flight_log_whose_messages_do_not_add_up_is_refused(tmp_path, data, fragment):
    """Cut, of another kind, of no topic, too short for its topic: a row less would pass for a whole
    log.
    """
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, data, "x.ulg", needed=("case", "air"))
    assert fragment in str(refused.value)


def test_containers_ask_which_table_is_the_log(tmp_path):
    """Several groups, sheets or topics are listed, never chosen among."""
    import h5py
    import nptdms
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["a", "b"])
    book.create_sheet("second").append(["a", "b"])
    stream = io.BytesIO()
    book.save(stream)
    with pytest.raises(LogFormatError, match="2 sheets hold cells: Sheet, second"):
        read(tmp_path, stream.getvalue(), "x.xlsx")
    stream = io.BytesIO()
    with nptdms.TdmsWriter(stream) as writer:
        writer.write_segment(
            [nptdms.ChannelObject(group, "a", np.arange(3.0)) for group in ("one", "two")]
        )
    with pytest.raises(LogFormatError, match="there are: 'one', 'two'"):
        read(tmp_path, stream.getvalue(), "x.tdms")
    stream = io.BytesIO()
    with h5py.File(stream, "w") as made:
        made["one/a"], made["two/a"] = np.arange(3.0), np.arange(4.0)
    with pytest.raises(LogFormatError, match=r"arrays in 2 groups: one/a, two/a"):
        read(tmp_path, stream.getvalue(), "x.h5")
    ulog = DIALECTS["ULog"].write(Clean([["0", "1", "2", "3"], ["10", "1", "2", "3"]]))
    with pytest.raises(LogFormatError, match="there are: battery:0, fog_run:0"):
        read(tmp_path, ulog, "x.ulg")


def test_instants_of_a_parquet_file_are_seconds_with_and_without_a_zone(tmp_path):
    """From the first that is there; text and truth values are no column, and two columns of one
    name are refused as such.
    """
    import pyarrow as pa
    from pyarrow import parquet as pq

    def stored(table):
        stream = io.BytesIO()
        pq.write_table(table, stream)
        return stream.getvalue()

    for zone in (None, "UTC", "Asia/Shanghai"):
        for unit, ticks in (("ms", 1000), ("us", 10**6), ("ns", 10**9)):
            at = pa.array(
                [None, 1_700_000_000 * ticks, 1_700_000_001 * ticks + ticks // 2],
                pa.timestamp(unit, tz=zone),
            )
            table = pa.table({"a": at, "b": [True, None, False], "said": ["x", "y", "z"]})
            found = read(tmp_path, stored(table), "x.parquet").frame
            assert list(found) == ["a"]
            np.testing.assert_array_equal(found["a"], [np.nan, 0.0, 1.5])
    twice = pa.Table.from_arrays([pa.array([1.0, 2.0]), pa.array([3.0, 4.0])], names=["a", "a"])
    with pytest.raises(LogFormatError, match="a column stands twice"):
        read(tmp_path, stored(twice), "x.parquet")


def test_what_netcdf_packed_is_unpacked_and_units_may_be_arrays(tmp_path):
    """scale_factor, add_offset and _FillValue of a variable, `Units` as an array of bytes, and a
    unit that nobody knows as it is written.
    """
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w") as made:
        made["a"] = np.array([10, -999, 30], dtype=np.int16)
        made["a"].attrs.update({"scale_factor": [0.5], "add_offset": 20.0, "_FillValue": -999})
        made["a"].attrs["Units"] = np.array([b"celsius"])
        made["b"] = np.arange(3.0)
        made["b"].attrs["units"] = "mrad/min"
        made["t"] = np.arange(3.0)
        made["t"].attrs["units"] = "seconds since 2020-01-01"
    table = read(tmp_path, stream.getvalue(), "x.h5")
    assert table.units == {"a": "degC", "b": "mrad/min", "t": "s"}
    np.testing.assert_array_equal(table.frame["a"], [25.0, np.nan, 35.0])


@pytest.mark.parametrize(
    ("size", "fragment"),
    [
        (61, "61 bytes behind the header, expected records of 12 bytes (5 and 1 bytes over)"),
        (0, "0 bytes behind"),
    ],
)
def test_binary_records_are_whole(tmp_path, size, fragment):
    """A file that is not a whole number of records is cut off, or described wrongly."""
    spec = {
        "byte_order": "little",
        "fields": [{"name": "a", "type": "f8"}, {"name": "b", "type": "i4"}],
    }
    with pytest.raises(LogFormatError) as refused:
        read(tmp_path, bytes(size), format="binary", binary=recipe.logs.BinarySpec(**spec))
    assert fragment in str(refused.value)


def test_a_record_out_of_step_is_named(tmp_path):
    """A lost byte shows in the sync word of the next record."""
    fields = [
        {"name": "sync", "type": "u2", "byte_order": "big"},
        {"name": "a", "type": "i2", "scale": 0.0625},
    ]
    spec = recipe.logs.BinarySpec(byte_order="little", sync="AA55", fields=fields)
    data = b"".join(b"\xaa\x55" + struct.pack("<h", k) for k in range(-2, 3))
    table = read(tmp_path, data, format="binary", binary=spec)
    assert table.frame["a"].tolist() == [-0.125, -0.0625, 0.0, 0.0625, 0.125]
    assert table.frame["sync"].tolist() == [0xAA55] * 5
    with pytest.raises(LogFormatError, match="record 2 begins with"):
        read(tmp_path, data[:5] + data[6:] + b"\0", format="binary", binary=spec)


@pytest.mark.parametrize(
    ("module", "name", "extra"),
    [
        ("python_calamine", "excel", "excel"),
        ("nptdms", "tdms", "tdms"),
        ("h5py", "hdf5", "hdf5"),
        ("pyarrow", "parquet", "parquet"),
        ("pyulog", "ulog", "ulog"),
    ],
)
def test_a_missing_library_is_named_with_the_command_that_installs_it(
    tmp_path, monkeypatch, module, name, extra
):
    """Exit code 2 and `pip install 'calibkit[extra]'`."""
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(UsageError, match=re.escape(f"pip install 'calibkit[{extra}]'")):
        read(tmp_path, b"anything", format=name)


@pytest.mark.parametrize("name", sorted(set(registry.FORMATS) - {"csv", "binary"}))
def test_what_is_of_another_format_is_refused(tmp_path, name):
    """A file of nonsense is one line of error in every format."""
    for data in (b"", b"\0" * 100, b"nonsense\n", bytes(range(256)) * 4):
        with pytest.raises(CalibkitError) as refused:
            read(tmp_path, data, format=name)
        assert "\n" not in str(refused.value)
        assert "log.dat" in str(refused.value)


@pytest.mark.parametrize(
    "block", re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), flags=re.DOTALL)
)
def test_every_recipe_of_the_documentation_is_one(block):
    """The blocks of docs/logs.md load as they stand, below a procedure."""
    columns = re.findall(r"(?m)^\[columns\.(\w+)\]|^(\w+) = \{ from", block)
    assert columns or "names" in block
    instruments.parse_recipe(recipe.Source("docs.toml", f'procedure = "fog_thermal"\n{block}'))


@pytest.mark.parametrize(
    ("logs", "fragment"),
    [
        (
            'format = "csv"\ntext = { decimal = "," }',
            "[logs.text] says nothing about format = 'csv'",
        ),
        ('format = "binary"', "format = 'binary' and a table [logs.binary] go together"),
        ('text = { delimiter = ",", decimal = "," }', "a comma cannot be both"),
        ('text = { delimiter = "fixed" }', "go together"),
        (
            'format = "lvm"\ntext = { decimal = "," }',
            "decimal in [logs.text] says nothing about format = 'lvm'",
        ),
        ('format = "parquet"\ntable = "x"', "table = 'x' says nothing about format = 'parquet'"),
        ('names = ["a", "a"]', "'a' stands twice"),
        ('format = "exel"', "did you mean 'excel'?"),
        ('text = { encoding = "latin-1" }', "expected 'auto', 'utf-8'"),
    ],
)
def test_a_description_that_cannot_be_meant_is_refused(logs, fragment):
    """Contradictions and misspellings in [logs] are faults of the recipe, with their line."""
    with pytest.raises(RecipeError) as refused:
        instruments.parse_recipe(
            recipe.Source("r.toml", f'procedure = "fog_thermal"\n[logs]\nfiles = ["*"]\n{logs}\n')
        )
    assert fragment in str(refused.value)
    assert "r.toml:" in str(refused.value)

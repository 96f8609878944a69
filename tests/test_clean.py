"""The fast reader: the strict reader's numbers, digest and rows for a clean log, and nothing for any other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibkit.errors import LogFormatError
from calibkit.readers import clean, delimited

NAMES = ("time_s", "temp_case_degc", "gyro_dph")
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(10**17), 10**17).map(str),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:+.17f}"),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:.3E}"),
)
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=40)


def text_of(rows, end="\n", start=""):
    """A log as text."""
    return (start + end.join([",".join(NAMES), *(",".join(row) for row in rows)]) + end).encode()


def same(path):
    """Whether both readers agree on a file to the last bit."""
    quick, strict = clean.read(path, path.name), delimited.read(path, path.name, NAMES)
    assert quick is not None
    assert quick.sha256 == strict.sha256
    assert list(quick.frame.columns) == list(strict.frame.columns)
    assert quick.frame.index.equals(strict.frame.index)
    assert quick.frame.to_numpy().tobytes() == strict.frame.to_numpy().tobytes()
    assert (quick.notes, quick.reading, quick.units) == (strict.notes, strict.reading, strict.units)


@given(ROWS, st.sampled_from(["\n", "\r\n"]), st.sampled_from(["", "\ufeff"]), st.sampled_from([7, 64, 1 << 22]))
@settings(max_examples=150, deadline=None)
def test_clean_logs_come_out_as_from_the_strict_reader(tmp_path_factory, rows, end, start, block):
    """Any numbers, either line end, with or without a byte-order mark, blocks that cut anywhere: bit for bit."""
    path = tmp_path_factory.mktemp("clean") / "log.csv"
    path.write_bytes(text_of(rows, end, start))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clean, "BLOCK", block)
        same(path)


@given(ROWS, st.data())
@settings(max_examples=300, deadline=None)
def test_a_damaged_log_is_left_to_the_strict_reader_or_read_alike(tmp_path_factory, rows, data):
    """One byte changed, removed or added anywhere: nothing, or what the strict reader reads, never other numbers."""
    whole = text_of(rows)
    at = data.draw(st.integers(0, len(whole) - 1))
    byte = bytes([data.draw(st.sampled_from(list(b" ,;\n\r\t\"'-+.eE0a\x00\xff")))])
    kind = data.draw(st.sampled_from(["change", "remove", "add"]))
    spoilt = whole[:at] + (b"" if kind == "remove" else byte) + whole[at + (kind != "add") :]
    path = tmp_path_factory.mktemp("spoilt") / "log.csv"
    path.write_bytes(spoilt)
    quick = clean.read(path, "log.csv")
    if quick is not None:
        strict = delimited.read(path, "log.csv", NAMES)
        assert quick.sha256 == strict.sha256
        assert quick.frame.to_numpy().tobytes() == strict.frame.to_numpy().tobytes()


@pytest.mark.parametrize(
    "body",
    [
        "1,2,3\n4,5\n6,7,8,9\n",
        "1,2,3\n4,5,6",
        "1,2,3\n\n4,5,6\n",
        "1,2,nan\n",
        "1,,3\n\r4,5,6\n",
        "1,2,3\r4,5,6\r",
        "1,2,3 \n",
        "1,2,3\n4,5,6\r\n7,8,9\r",
        "",
    ],
    ids=["fields", "no end", "blank line", "nan", "return first", "old Mac", "blank", "cut return", "no rows"],
)
@pytest.mark.parametrize("block", [3, 1 << 22])
def test_what_is_not_clean_is_not_read(tmp_path, monkeypatch, body, block):
    """Each kind of irregular log gives nothing, wherever a block ends."""
    monkeypatch.setattr(clean, "BLOCK", block)
    path = tmp_path / "log.csv"
    path.write_bytes((",".join(NAMES) + "\n" + body).encode())
    assert clean.read(path, "log.csv") is None


def test_two_wrong_lines_that_make_up_for_each_other_are_seen(tmp_path):
    """A row of two fields beside one of four has the right number of commas: both are still refused."""
    path = tmp_path / "log.csv"
    path.write_bytes(b"a,b,c\n1,2\n3,4,5,6\n")
    assert clean.read(path, "log.csv") is None


def test_a_log_that_changes_while_it_is_read_is_refused(tmp_path, monkeypatch):
    """A row added behind the parser's back: one line that names the log."""
    path = tmp_path / "log.csv"
    path.write_bytes(text_of([("1", "2", "3")]))
    parsed = clean._numbers

    def growing(block, fields):
        with path.open("ab") as stream:
            stream.write(b"4,5,6\n")
        return parsed(block, fields)

    monkeypatch.setattr(clean, "_numbers", growing)
    with pytest.raises(LogFormatError, match=r"log\.csv: it changed while it was read"):
        clean.read(path, "log.csv")


def test_a_missing_file_is_an_error_of_its_name(tmp_path):
    """No such file: one line, no traceback."""
    with pytest.raises(LogFormatError, match=r"x\.csv: cannot be read"):
        clean.read(tmp_path / "x.csv", "x.csv")


def test_numbers_of_seventeen_digits_are_the_nearest(tmp_path):
    """2,000 shortest texts of random doubles read back to the same doubles."""
    rng = np.random.default_rng(5)
    values = rng.normal(0.0, 1.0, (2000, 3)) * 10.0 ** rng.integers(-8, 8, (2000, 3))
    path = tmp_path / "log.csv"
    path.write_bytes(text_of([tuple(map(repr, row)) for row in values.tolist()]))
    assert clean.read(path, "log.csv").frame.to_numpy().tobytes() == values.tobytes()

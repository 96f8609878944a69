"""The fast reader: the strict reader's numbers, digest and rows for a clean log, and nothing for
any other.
"""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibkit.errors import LogFormatError
from calibkit.readers import clean, scratch_files, text
from calibkit.recipe.logs import Logs
from calibkit.records.frame import Log

NAMES = ("time_s", "temp_case_degc", "gyro_dph")
NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.integers(-(10**17), 10**17).map(str),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:+.17f}"),
    st.floats(-1e4, 1e4).map(lambda value: f"{value:.3E}"),
    st.sampled_from(["", "nan", "NaN", "NAN"]),
)
"""What a field may hold: a number, or a missing value."""
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=40)


def text_of(rows, end="\n", start=""):
    """A log as text."""
    return (start + end.join([",".join(NAMES), *(",".join(row) for row in rows)]) + end).encode()


def read_text(path):
    """Read a log as the reader of text does."""
    logs = Logs.model_validate({"files": ["*"]})
    data = path.read_bytes()
    names = data.decode("utf-8-sig", "replace").split("\n")[0].split(",")
    sha256 = hashlib.sha256(data).hexdigest()
    return text.parse_csv(data, sha256, path.name, logs, {name.strip() for name in names})


def same(path):
    """Whether both readers agree on a file to the last bit."""
    quick, strict = clean.read(path, path.name), read_text(path)
    assert quick is not None
    assert quick.sha256 == strict.sha256
    assert list(quick.frame.columns) == list(strict.frame.columns)
    assert quick.frame.index.equals(strict.frame.index)
    assert quick.frame.to_numpy().tobytes() == strict.frame.to_numpy().tobytes()
    assert (quick.notes, quick.reading, quick.units) == (strict.notes, strict.reading, strict.units)


ENDS, STARTS = st.sampled_from(["\n", "\r\n"]), st.sampled_from(["", "\ufeff"])


def compiled(patch, *, use):
    """Let the reader have compiled kernels or not."""
    if not use:
        patch.setattr(clean, "kernels", lambda: None)


@given(ROWS, ENDS, STARTS, st.sampled_from([7, 64, 1 << 22]), st.booleans())
@settings(max_examples=150, deadline=None)
def test_clean_logs_come_out_as_from_the_strict_reader(
    tmp_path_factory, rows, end, start, block, kernels
):
    """Any numbers and missing values, either line end, byte-order mark, blocks that cut anywhere,
    compiled or not: bit for bit.
    """
    path = tmp_path_factory.mktemp("clean") / "log.csv"
    path.write_bytes(text_of(rows, end, start))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clean, "BLOCK", block)
        compiled(patch, use=kernels)
        same(path)


@given(ROWS, st.data(), st.booleans())
@settings(max_examples=400, deadline=None)
def test_a_damaged_log_is_left_to_the_strict_reader_or_read_alike(
    tmp_path_factory, rows, data, kernels
):
    """One byte changed, removed or added anywhere: nothing, or what the strict reader reads, never
    other numbers.
    """
    whole = text_of(rows)
    at = data.draw(st.integers(0, len(whole) - 1))
    byte = bytes([data.draw(st.sampled_from(list(b" ,;\n\r\t\"'-+.eE0aN\x00\xff")))])
    kind = data.draw(st.sampled_from(["change", "remove", "add"]))
    spoilt = whole[:at] + (b"" if kind == "remove" else byte) + whole[at + (kind != "add") :]
    path = tmp_path_factory.mktemp("spoilt") / "log.csv"
    path.write_bytes(spoilt)
    with pytest.MonkeyPatch.context() as patch:
        compiled(patch, use=kernels)
        quick = clean.read(path, "log.csv")
    if quick is not None:
        strict = read_text(path)
        assert quick.sha256 == strict.sha256
        assert quick.frame.to_numpy().tobytes() == strict.frame.to_numpy().tobytes()


@pytest.mark.parametrize(
    "body",
    [
        "1,2,3\n4,5\n6,7,8,9\n",
        "1,2,3\n4,5,6",
        "1,2,3\n\n4,5,6\n",
        "1,2,na\n",
        "1,2,1e999\n",
        "1,2,3\r4,5,6\r",
        "1,2,3 \n",
        "1,2,3\n4,5,6\r\n7,8,9\r",
        "1,2,1e\n4,5,6\n",
        "1,2,0x10\n",
        "1,2,3\x00\n",
        "",
    ],
    ids=repr,
)
@pytest.mark.parametrize("block", [3, 1 << 22])
@pytest.mark.parametrize("kernels", [True, False], ids=["compiled", "pandas"])
def test_what_is_not_clean_is_not_read(tmp_path, monkeypatch, body, block, kernels):
    """Each kind of irregular log gives nothing, wherever a block ends, compiled or not."""
    monkeypatch.setattr(clean, "BLOCK", block)
    compiled(monkeypatch, use=kernels)
    path = tmp_path / "log.csv"
    path.write_bytes((",".join(NAMES) + "\n" + body).encode())
    assert clean.read(path, "log.csv") is None


def test_a_log_that_changes_while_it_is_read_is_refused(tmp_path, monkeypatch):
    """A row added behind the parser's back: one line that names the log."""
    path = tmp_path / "log.csv"
    path.write_bytes(text_of([("1", "2", "3")]))
    read_header = clean._read_header

    def growing(first, file):
        with path.open("ab") as stream:
            stream.write(b"4,5,6\n")
        return read_header(first, file)

    monkeypatch.setattr(clean, "_read_header", growing)
    with pytest.raises(LogFormatError, match=r"log\.csv: it changed while it was read"):
        clean.read(path, "log.csv")


@pytest.mark.parametrize("kernels", [True, False], ids=["compiled", "pandas"])
def test_numbers_half_way_between_two_doubles_or_close_to_it_are_rounded_as_python_does(
    tmp_path, monkeypatch, kernels
):
    """Ties, to all their digits, a digit more and a digit less, and 30,000 numbers of 19 digits."""
    compiled(monkeypatch, use=kernels)
    ties = [str((2 * m + 1) << k) for m in range(2**52 + 5, 2**52 + 300, 7) for k in (0, 1, 4)]
    rng = np.random.default_rng(8)
    long = [f"{digits:019d}" for digits in rng.integers(10**18, 9 * 10**18, 30_000).tolist()]
    cut = [
        f"{text[:at]}.{text[at:]}"
        for text, at in zip(long, rng.integers(0, 19, len(long)).tolist(), strict=True)
    ]
    fields = [text + more for text in ties for more in ("", ".", ".0", ".1", "e0")] + cut
    rows = [(field, f"-{field}", "0") for field in fields]
    path = tmp_path / "log.csv"
    path.write_bytes(text_of(rows))
    expected = np.array([[float(field) for field in row] for row in rows])
    assert clean.read(path, "log.csv").frame.to_numpy().tobytes() == expected.tobytes()


@pytest.mark.parametrize("kernels", [True, False], ids=["compiled", "pandas"])
@pytest.mark.parametrize("size", [50, 1 << 20])
def test_blocks_joined_are_the_log_in_memory_and_on_disk(
    tmp_path, monkeypatch, is_mapped, kernels, size
):
    """Blocks that end anywhere hold the rows of the log, wherever its columns lie."""
    compiled(monkeypatch, use=kernels)
    monkeypatch.setattr(clean, "BLOCK", size)
    values = np.random.default_rng(7).normal(size=(60, 3))
    path = tmp_path / "log.csv"
    path.write_bytes(text_of([tuple(map(repr, row)) for row in values.tolist()]))
    for megabytes in ("0", "100"):
        monkeypatch.setenv(scratch_files.SETTING, megabytes)
        frame = clean.read(path, "log.csv").frame
        assert frame.to_numpy().tobytes() == values.tobytes()
        assert is_mapped(Log("log", "log.csv", "", 60, frame)) == (megabytes == "0")

"""Binary logs that ask for more than a log can need, break their parser, or hold more bytes than
they state: exit code 3, one line.
"""

import os
import struct
import sys
import zlib

import numpy as np
import pytest

from calibkit.errors import LogFormatError
from calibkit.readers import limited, registry
from calibkit.recipe.logs import Logs

NEEDED = ("time_s", "gyro_dph")
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="memory is limited on Linux alone")
ROWS = np.arange(50.0)


def read(path):
    """Read a log as any command does."""
    return registry.read(path, path.name, Logs(files=("*",)), NEEDED)


def refused(path):
    """Return the one line with which a log is refused."""
    with pytest.raises(LogFormatError) as error:
        read(path)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture
def small(monkeypatch):
    """Allow parsers 300 MB, so that a test asks for little more."""
    monkeypatch.setenv(limited.SETTING, "300")


def workbook(path, rows, far=""):
    """Write a workbook of two columns, and one cell elsewhere."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(list(NEEDED))
    for row in rows:
        book.active.append(list(row))
    if far:
        book.active[far] = 1.0
    book.save(path)
    return path


def test_a_cell_at_the_end_of_the_sheet_is_refused_in_one_line(tmp_path, calibkit):
    """One cell in XFD1048576 made the parser ask for 550 GB and end the process."""
    path = workbook(tmp_path / "log.xlsx", zip(ROWS, ROWS, strict=True), "XFD1048576")
    assert "that its parser broke on, or that need more than" in refused(path)
    outcome = calibkit("fit", "bias_temperature", data=tmp_path, serial="S", set='logs.files=["*"]')
    assert (outcome.code, outcome.err.count("\n")) == (3, 1)


@LINUX
def test_a_small_parquet_file_that_needs_gigabytes_is_refused(tmp_path, small):
    """Columns of one value take kilobytes on disk and gigabytes in memory."""
    pyarrow, parquet = (pytest.importorskip(f"pyarrow{part}") for part in ("", ".parquet"))
    zeros = pyarrow.array(np.zeros(20_000_000))
    table = pyarrow.table(dict.fromkeys((*NEEDED, "a", "b"), zeros))
    parquet.write_table(table, tmp_path / "log.parquet", compression="zstd")
    assert (tmp_path / "log.parquet").stat().st_size < 1_000_000
    assert "need more than 300 MB" in refused(tmp_path / "log.parquet")


def element(kind, data):
    """One element of a MAT-file."""
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


@LINUX
def test_a_compressed_matlab_variable_that_needs_gigabytes_is_refused(tmp_path, small):
    """400 MB of zeros in 400 kB."""
    count = 50_000_000
    matrix = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", count, 1))
    matrix += element(1, b"time_s") + element(9, bytes(8 * count))
    packed = zlib.compress(element(14, matrix))
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path = tmp_path / "log.mat"
    path.write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    assert "need more than 300 MB" in refused(path)


def test_a_parser_that_takes_too_long_is_ended(tmp_path, monkeypatch):
    """After the time that a log of this size may take the parser is ended; the next log is read."""
    path = workbook(tmp_path / "log.xlsx", zip(ROWS, ROWS, strict=True))
    with monkeypatch.context() as patch:
        patch.setattr(limited, "SECONDS", 0.0)
        patch.setattr(limited, "PER_MEGABYTE", 0.0)
        limited._PROCESS.end()
        assert "MB or 0 s" in refused(path)
    assert len(read(path).frame) == 50


@pytest.mark.parametrize("kind", ["csv", "tsv", "parquet"])
def test_a_log_of_a_hundred_thousand_columns_is_refused_at_once(tmp_path, kind):
    """Rows and columns exchanged, or a bomb: no minutes are spent on it."""
    names = [f"c{k}" for k in range(100_000 if kind != "parquet" else 12_000)]
    path = tmp_path / f"log.{kind}"
    if kind == "parquet":
        pyarrow, parquet = (pytest.importorskip(f"pyarrow{part}") for part in ("", ".parquet"))
        parquet.write_table(pyarrow.table({name: [1.0, 2.0] for name in names}), path)
    else:
        mark = {"csv": ",", "tsv": "\t"}[kind]
        lines = [mark.join(names), *[mark.join(["1.5"] * len(names))] * 3, ""]
        path.write_text("\n".join(lines), encoding="utf-8")
    assert f"{len(names)} columns, expected at most 10000" in refused(path)


def tdms(path):
    """Write two channels as TDMS."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(str(path)) as writer:
        writer.write_segment([nptdms.ChannelObject("run", name, ROWS) for name in NEEDED])


def hdf5(path):
    """Write two columns as HDF5."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as made:
        for name in NEEDED:
            made[name] = ROWS


@pytest.mark.parametrize("write", [tdms, hdf5])
@pytest.mark.parametrize("damage", ["behind", "inside", "lost"])
def test_bytes_that_were_added_or_lost_are_refused(tmp_path, write, damage):
    """A byte behind the last segment, inside the values, or one less: the libraries read on as if
    nothing were wrong.
    """
    path = tmp_path / f"log.{write.__name__}"
    write(path)
    whole = path.read_bytes()
    read(path)
    at = len(whole) - 300
    damaged = {
        "behind": whole + bytes(7),
        "inside": whole[:at] + b"\1" + whole[at:],
        "lost": whole[:at] + whole[at + 1 :],
    }[damage]
    path.write_bytes(damaged)
    refused(path)


def test_a_number_that_no_instrument_gives_is_refused_by_line(tmp_path, calibkit, log_writer):
    """1e308 in one row made coefficients that are no numbers."""
    bias = np.where(np.arange(600) == 300, 1e308, 1.0 + 1e-3 * np.arange(600))
    log_writer(
        tmp_path / "a.csv",
        time_s=np.arange(600.0),
        temp_case_degc=np.arange(600.0) / 10,
        gyro_dph=bias,
    )
    outcome = calibkit("fit", "bias_temperature", "--data", tmp_path, "--serial", "S", "--dry-run")
    assert outcome.code == 3
    assert "a.csv:302: column 'gyro_dph': 1e+308 deg/h (1 such or missing value" in outcome.err


@pytest.mark.skipif(os.name != "posix", reason="needs sparse files and pipes")
@pytest.mark.parametrize("name", ["a.csv", "a.txt", "a.json", "a.xlsx"])
def test_a_log_that_is_larger_than_what_is_read_at_once_is_refused_unread(tmp_path, calibkit, name):
    """20 GB of nothing behind a first line took 19 GB of memory: exit code 3 in one line."""
    heads = {
        "a.json": b'{"time_s": [',
        "a.xlsx": b"PK\x03\x04",
        "a.txt": b"# log\ntime_s;gyro_dph\n",
    }
    with (tmp_path / name).open("wb") as stream:
        stream.write(heads.get(name, b"time_s,gyro_dph\n0,1\n"))
        stream.truncate(20_000_000_000)
    files = f'logs.files=["{name}"]'
    asked = ("--data", tmp_path, "--serial", "S", "--set", files, "--dry-run")
    outcome = calibkit("fit", "bias_temperature", *asked)
    assert (outcome.code, outcome.err.count("\n")) == (3, 1), outcome
    assert "20.0 GB, at most 2 GB are read at once" in outcome.err

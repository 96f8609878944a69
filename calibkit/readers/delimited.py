"""What readers share: the bytes of a log, the names in the first line of comma-separated text, and
rows of fields into columns.

Uncertainty of reading: numbers are converted to the nearest float64; nothing is rounded, resampled
or dropped.
"""

from __future__ import annotations

import csv
import hashlib
import io
import stat
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import damage, limited, tokens

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    import pandas as pd

    from calibkit.numeric.arrays import Integers

_BLOCK = 1 << 24
"""Bytes whose fields are counted at once."""
LARGEST_BYTES = 2_000_000_000
"""Largest log that is held in memory as bytes: its numbers and texts take some four times as much.
Clean CSV, which is read in blocks, may be larger.
"""
MISSING = frozenset({"", "nan", "NaN", "NAN"})


def read_bytes(path: Path, file: str) -> tuple[bytes, str]:
    """Bytes of a log and their SHA-256; raises LogFormatError where the file cannot be read, or is
    too large to be held in memory.
    """
    with open_log(path, file) as stream:
        if (size := path.stat().st_size) > LARGEST_BYTES:
            raise LogFormatError(
                f"{file}: {size / 1e9:.1f} GB, at most {LARGEST_BYTES / 1e9:g} GB are read at once",
                hint="cut it into several logs, or write it as CSV of nothing but numbers",
            )
        data = stream.read()
    return data, hashlib.sha256(data).hexdigest()


@contextmanager
def open_log(path: Path, file: str) -> Iterator[BinaryIO]:
    """Open a log; raises LogFormatError where the system cannot open or read it, or it is no file:
    the log is read more than once, and a pipe may never end.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise LogFormatError(
                f"{file}: a folder, a pipe or a device, expected a log",
                hint="write what it gives into a file first",
            )
        with path.open("rb") as stream:
            yield stream
    except OSError as error:
        raise LogFormatError(
            f"{file}: cannot be read: {error.strerror}", hint="check the file"
        ) from None


def is_needed(name: str, required_columns: Collection[str]) -> bool:
    """Whether a column is a required one, under its name with or without the unit in brackets."""
    return name in required_columns or units.name_without_unit(name) in required_columns


def parse_rows(body: bytes, kinds: dict[int, str], **dialect: Any) -> pd.DataFrame:  # noqa: ANN401 (options of pandas)
    """Numbers and texts of the rows, with one kind per column, numbered from 0; `dialect` as in
    `pandas.read_csv`.
    """
    import pandas as pd

    frame: pd.DataFrame = pd.read_csv(
        io.BytesIO(body),
        header=None,
        names=list(kinds),
        dtype=kinds,
        quoting=csv.QUOTE_NONE,
        keep_default_na=False,
        na_values=sorted(MISSING),
        skip_blank_lines=False,
        **dialect,
    )
    return frame


def split_names(first: bytes, file: str) -> list[str]:
    """Names of the columns in the first line of comma-separated UTF-8; LogFormatError where it is
    none.
    """
    try:
        line = first.decode("utf-8-sig").rstrip("\r\n")
    except UnicodeDecodeError as error:
        raise LogFormatError(
            f"{file}:1: byte 0x{first[error.start]:02x} is not UTF-8 text",
            hint="save the log as UTF-8 CSV",
        ) from None
    header = [name.strip() for name in line.split(",")]
    limited.require_columns(len(header), file)
    _require_names(header, file)
    return header


def _require_names(header: list[str], file: str) -> None:
    """Raise LogFormatError for a header that is not distinct names separated by commas."""
    if tokens.is_comment(header[0]):
        raise LogFormatError(
            f"{file}:1: a comment, expected column names",
            hint="read it as format = 'text', which knows comments",
        )
    if len(header) == 1:
        other = any(mark in header[0] for mark in ";\t|")
        raise LogFormatError(
            f"{file}:1: one column named '{header[0][:60]}'",
            hint="separate columns with commas" if other else "expected several columns",
        )
    earlier: set[str] = set()
    for number, name in enumerate(header, start=1):
        if not name:
            raise LogFormatError(
                f"{file}:1: column {number} has no name", hint="name every column in the first line"
            )
        if '"' in name:
            raise LogFormatError(
                f"{file}:1: column {number} is quoted: {name}", hint="write names without quotes"
            )
        if name in earlier:
            raise LogFormatError(
                f"{file}:1: column '{name}' stands twice", hint="give each column its own name"
            )
        earlier.add(name)
    if all(_is_number(name) for name in header):
        raise LogFormatError(
            f"{file}:1: numbers where the column names should be", hint="put a header line first"
        )


def _is_number(token: str) -> bool:
    """Whether a token is a number in the sense of Python's float, without its underscores."""
    try:
        float(token)
    except ValueError:
        return False
    return "_" not in token and token.isascii()


def count_fields(body: bytes, delimiter: bytes = b",") -> Integers:
    """Number of fields of every line [n]."""
    field_counts, carried = [], 0
    for start in range(0, len(body), _BLOCK):
        block = np.frombuffer(body, np.uint8, min(_BLOCK, len(body) - start), start)
        ends = np.flatnonzero(block == ord("\n"))
        commas = np.cumsum(block == ord(delimiter))
        upto = np.concatenate([[0], commas[ends]]) if ends.size else np.zeros(1, dtype=np.int64)
        counts = np.diff(upto)
        if counts.size:
            counts[0] += carried
            carried = 0
        field_counts.append(counts + 1)
        carried += int(commas[-1] - upto[-1])
    if not body.endswith(b"\n"):
        field_counts.append(np.array([carried + 1]))
    return np.concatenate(field_counts) if field_counts else np.zeros(0, dtype=np.int64)


def wrong_fields(counts: Integers, row: int, advice: damage.Advice) -> LogFormatError:
    """The error of a row with too few or too many fields."""
    return LogFormatError(
        f"{advice.file}:{int(advice.lines[row])}: {int(counts[row])} fields, expected"
        f" {advice.fields} as in the header",
        hint=advice.of_fields(row),
    )


def check_last_line(
    body: bytes, file: str, line: int, delimiter: str = ",", decimal: str = "."
) -> tuple[str, ...]:
    """Note on a last line without a line end; LogFormatError where its last number is cut."""
    if body.endswith(b"\n"):
        return ()
    lines = body[-20_000:].split(b"\n")
    rows = [
        line.decode().split(delimiter) for line in (lines if len(body) <= 20_000 else lines[1:])
    ][-50:]
    decimals = [len(row[-1].partition(decimal)[2]) for row in rows]
    if len(decimals) > 2 and len(set(decimals[:-1])) == 1 and decimals[-1] < decimals[0]:
        raise LogFormatError(
            f"{file}:{line}: the last number '{rows[-1][-1]}' has {decimals[-1]} decimals and no"
            f" line end, expected {decimals[0]}",
            hint=('the file is cut off: copy it again, or set last_line = "drop" in [logs.text]'),
        )
    return ("the last line has no line end; its row was kept",)

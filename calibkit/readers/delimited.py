"""What readers share: the bytes of a log, and the names in the first line of comma-separated
text.
"""

from __future__ import annotations

import hashlib
import stat
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import limited, tokens

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path


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
    for number, name in enumerate(header, start=1):
        if not name:
            raise LogFormatError(
                f"{file}:1: column {number} has no name", hint="name every column in the first line"
            )
        if '"' in name:
            raise LogFormatError(
                f"{file}:1: column {number} is quoted: {name}", hint="write names without quotes"
            )
        if name in header[: number - 1]:
            raise LogFormatError(
                f"{file}:1: column '{name}' stands twice", hint="give each column its own name"
            )
    if all(tokens.is_number(name, ".") or tokens.is_sentinel(name) for name in header):
        raise LogFormatError(
            f"{file}:1: numbers where the column names should be", hint="put a header line first"
        )
    return header

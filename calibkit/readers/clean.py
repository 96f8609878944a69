"""Fast reader of clean comma-separated logs: what the strict reader would read to the same numbers, or nothing.

Format: that of `delimited` without a missing value, a text, a blank or a last line without its end. The file is scanned in
blocks, for its digest, its bytes and the fields of every line, beside the parser, which reads numbers with every core.
Uncertainty of reading: as of `delimited`.
"""

from __future__ import annotations

import hashlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit.errors import LogFormatError
from calibkit.readers import delimited
from calibkit.readers.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import pandas as pd

BLOCK = 1 << 22
"""Bytes scanned at a time."""
LARGEST_HEADER = 1 << 16
NUMBER = b"0123456789.+-eE\r"
"""Bytes of numbers, and the return before a line end."""


@dataclass(frozen=True, slots=True)
class _Scan:
    """What a pass over the bytes found: digest and rows of a clean file."""

    sha256: str
    rows: int


def read(path: Path, file: str) -> Table | None:
    """Read a log whose every field is a number; none where it is anything else, for a stricter reader to say what.

    Memory beyond the numbers is that of a block. Raises LogFormatError where the file cannot be read.
    """
    try:
        before = path.stat()
        with path.open("rb") as stream:
            first = stream.readline(LARGEST_HEADER)
        header = _header(first, file)
        if header is None:
            return None
        with ThreadPoolExecutor(1) as beside:
            scan = beside.submit(_scan, path, len(first), len(header))
            frame = _parsed(path, len(header))
            seen = scan.result()
        after = path.stat()
    except OSError as error:
        raise LogFormatError(f"{file}: cannot be read: {error.strerror}", hint="check the file") from None
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise LogFormatError(f"{file}: it changed while it was read", hint="wait until the logger has closed it")
    if frame is None or seen is None or len(frame) != seen.rows:
        return None
    frame.columns = header
    return Table(file, seen.sha256, frame)


@dataclass(frozen=True, slots=True)
class Scanned:
    """A clean file that was scanned and not parsed: its columns, digest and rows."""

    header: tuple[str, ...]
    sha256: str
    rows: int


def scanned(path: Path, file: str) -> Scanned | None:
    """Scan a file in the memory of a block; none where it is not clean. Raises LogFormatError where it cannot be read."""
    try:
        with path.open("rb") as stream:
            first = stream.readline(LARGEST_HEADER)
        header = _header(first, file)
        seen = _scan(path, len(first), len(header)) if header is not None else None
    except OSError as error:
        raise LogFormatError(f"{file}: cannot be read: {error.strerror}", hint="check the file") from None
    return Scanned(tuple(header), seen.sha256, seen.rows) if header is not None and seen is not None else None


def pieces(path: Path, file: str, scan: Scanned, rows: int) -> Iterator[Table]:
    """Tables of at most `rows` rows of a scanned file, one after the other; the index counts on."""
    import pandas as pd

    names = list(range(len(scan.header)))
    count = 0
    try:
        with pd.read_csv(path, skiprows=1, header=None, names=names, dtype="float64", chunksize=rows) as chunks:
            for frame in chunks:
                frame.columns = list(scan.header)
                count += len(frame)
                yield Table(file, scan.sha256, frame)
    except (ValueError, OverflowError) as error:
        raise LogFormatError(
            f"{file}: behind line {count + 1}: {error}", hint="repair the row, or leave the range out with [[exclude]]"
        ) from None
    if count != scan.rows:
        raise LogFormatError(f"{file}: it changed while it was read", hint="wait until the logger has closed it")


def _header(first: bytes, file: str) -> list[str] | None:
    """Names of a first line, or none where it is not one of a clean file."""
    try:
        return delimited.split(first + b"0\n", file)[0] if first.endswith(b"\n") else None
    except LogFormatError:
        return None


def _parsed(path: Path, fields: int) -> pd.DataFrame | None:
    """Numbers of the rows, by a parser that is quick only when it is given a path and told nothing else."""
    import pandas as pd

    try:
        return pd.read_csv(path, skiprows=1, header=None, names=list(range(fields)), dtype="float64")
    except (ValueError, OverflowError):
        return None


def _scan(path: Path, skipped: int, fields: int) -> _Scan | None:
    """Digest and rows, or none at the first byte or line that is not clean."""
    digest, rows, rest, last = hashlib.sha256(), 0, b"", b""
    line = b"," * (fields - 1) + b"\n"
    with path.open("rb", buffering=0) as stream:
        digest.update(stream.read(skipped))
        while block := stream.read(BLOCK):
            digest.update(block)
            if not _returns_end_lines(last + block):
                return None
            # what is left of numbers without their digits is the shape of the lines: one comparison for every field
            shape = rest + block.translate(None, NUMBER)
            whole = shape.count(b"\n")
            if shape[: whole * fields] != line * whole or len(shape) >= (whole + 1) * fields:
                return None
            rows += whole
            rest = shape[whole * fields :]
            last = block[-1:]
    return _Scan(digest.hexdigest(), rows) if rows and not rest and last == b"\n" else None


def _returns_end_lines(block: bytes) -> bool:
    """Whether every return of a block stands before a line end, one at the block's own end aside."""
    returns = block.count(b"\r")
    return not returns or returns - block.endswith(b"\r") == block.count(b"\r\n")

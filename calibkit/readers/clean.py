"""Fast reader of clean comma-separated logs: what the strict reader would read to the same numbers,
or nothing.

Format: that of `delimited` without a missing value, a text, a blank or a last line without its end.
The file goes through memory once, a block of whole lines at a time: its digest is taken, its bytes
and the fields of every line are looked at, and its numbers are parsed, several blocks beside each
other, into columns that were made for them. Uncertainty of reading: as of `delimited`.
"""

from __future__ import annotations

import hashlib
import os
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, BinaryIO, cast

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.native import kernels
from calibkit.readers import delimited
from calibkit.readers.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Future
    from pathlib import Path

    from calibkit.arrays import Array


BLOCK = 1 << 20
"""Bytes read and parsed at a time."""
WORKERS = min(4, os.cpu_count() or 1)
"""Blocks that are parsed beside each other."""
LARGEST_HEADER = 1 << 16
LARGEST_LINE = 1 << 20
NUMBER = b"0123456789.+-eE\r"
"""Bytes of numbers, and the return before a line end."""


def read(path: Path, file: str) -> Table | None:
    """Read a log whose every field is a number; none where it is anything else, for a stricter
    reader to say what.

    Memory beyond the numbers is that of a few blocks. Raises LogFormatError where the file cannot
    be read.
    """
    import pandas as pd

    try:
        before = path.stat()
        with path.open("rb") as stream:
            first = stream.readline(LARGEST_HEADER)
            header = _header(first, file)
            columns = (
                _columns(stream, hashlib.sha256(first), len(header), before.st_size)
                if header
                else None
            )
        after = path.stat()
    except OSError as error:
        raise LogFormatError(
            f"{file}: cannot be read: {error.strerror}", hint="check the file"
        ) from None
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise LogFormatError(
            f"{file}: it changed while it was read", hint="wait until the logger has closed it"
        )
    if header is None or columns is None:
        return None
    frame = pd.DataFrame(dict(zip(header, columns.values, strict=True)), copy=False)
    return Table(file, columns.sha256, frame)


@dataclass(frozen=True, slots=True)
class _Columns:
    """Numbers of a clean file, a column an array [rows], and the digest of its bytes."""

    sha256: str
    values: tuple[Array, ...]


def _columns(stream: BinaryIO, digest: hashlib._Hash, fields: int, size: int) -> _Columns | None:
    """Digest and columns of what follows the header in a file of `size` bytes, or none where a
    block is not clean.
    """
    store: tuple[Array, ...] = tuple(np.empty(0) for _ in range(fields))
    rows = seen = 0
    under_way: deque[tuple[Future[bool], Future[None]]] = deque()
    # digests go block after block, in one thread; each block is parsed into its own rows of the
    # columns
    with ThreadPoolExecutor(WORKERS) as beside, ThreadPoolExecutor(1) as hashing:
        for block in _blocks(stream):
            lines = _ends(block)
            seen += len(block)
            if rows + lines > store[0].size:
                if not _done(under_way):
                    return None
                store = _longer(store, rows, int(1.02 * (rows + lines) * size / seen) + 1)
            own = [column[rows : rows + lines] for column in store]
            under_way.append(
                (beside.submit(_parsed, block, own), hashing.submit(digest.update, block))
            )
            rows += lines
            if not _done(under_way, but=WORKERS):
                return None
        if not _done(under_way):
            return None
    return _Columns(digest.hexdigest(), tuple(column[:rows] for column in store)) if rows else None


def _done(under_way: deque[tuple[Future[bool], Future[None]]], but: int = 0) -> bool:
    """Wait for the first blocks under way until so many are left; whether all of them were
    clean.
    """
    clean = True
    while len(under_way) > but:
        parsed, hashed = under_way.popleft()
        hashed.result()
        clean &= parsed.result()
    return clean


def _longer(store: tuple[Array, ...], rows: int, room: int) -> tuple[Array, ...]:
    """Columns with room for more rows, the first so many of which are kept."""
    return tuple(np.concatenate((column[:rows], np.empty(room - rows))) for column in store)


@dataclass(frozen=True, slots=True)
class Scanned:
    """A clean file that was scanned and not parsed: its columns, digest and rows."""

    header: tuple[str, ...]
    sha256: str
    rows: int


def scanned(path: Path, file: str) -> Scanned | None:
    """Scan a file in the memory of a block; none where it is not clean. Raises LogFormatError where
    it cannot be read.
    """
    try:
        with path.open("rb") as stream:
            first = stream.readline(LARGEST_HEADER)
            header = _header(first, file)
            seen = _scan(stream, hashlib.sha256(first), len(header)) if header is not None else None
    except OSError as error:
        raise LogFormatError(
            f"{file}: cannot be read: {error.strerror}", hint="check the file"
        ) from None
    return Scanned(tuple(header), *seen) if header is not None and seen is not None else None


def pieces(path: Path, file: str, scan: Scanned, rows: int) -> Iterator[Table]:
    """Tables of at most `rows` rows of a scanned file, one after the other; the index counts on.

    Raises LogFormatError for a line of anything but numbers, and for a file that changed since it
    was scanned.
    """
    fields, count, filled = len(scan.header), 0, 0
    piece = _room(fields, rows)
    try:
        with path.open("rb") as stream:
            stream.readline(LARGEST_HEADER)
            for block in _blocks(stream):
                numbers = _room(fields, _ends(block))
                if not _parsed(block, numbers):
                    raise _odd(file, block, count + filled, fields)
                taken = 0
                while taken < numbers[0].size:
                    more = min(numbers[0].size - taken, rows - filled)
                    for column, values in zip(piece, numbers, strict=True):
                        column[filled : filled + more] = values[taken : taken + more]
                    taken, filled = taken + more, filled + more
                    if filled == rows:
                        yield _piece(file, scan, piece, count)
                        piece, count, filled = _room(fields, rows), count + rows, 0
    except OSError as error:
        raise LogFormatError(
            f"{file}: cannot be read: {error.strerror}", hint="check the file"
        ) from None
    if filled:
        yield _piece(file, scan, [column[:filled] for column in piece], count)
    if count + filled != scan.rows:
        raise LogFormatError(
            f"{file}: it changed while it was read", hint="wait until the logger has closed it"
        )


def _piece(file: str, scan: Scanned, columns: list[Array], first: int) -> Table:
    """Rows of a file from a first one on."""
    import pandas as pd

    index = pd.RangeIndex(first, first + columns[0].size)
    return Table(
        file,
        scan.sha256,
        pd.DataFrame(dict(zip(scan.header, columns, strict=True)), index=index, copy=False),
    )


def _odd(file: str, block: bytes, rows: int, fields: int) -> LogFormatError:
    """What is to be said of the first line of a block, `rows` rows into a file, that is not one of
    numbers.
    """
    lines = block.splitlines(keepends=True)
    odd = next((k for k, line in enumerate(lines) if not _parsed(line, _room(fields, 1))), 0)
    found = lines[odd].decode("ascii", "backslashreplace").strip()
    return LogFormatError(
        f"{file}:{rows + odd + 2}: found {found!r}, expected {fields} numbers",
        hint="repair the row, or leave the range out with [[exclude]]",
    )


def _room(fields: int, rows: int) -> list[Array]:
    """Columns [rows] to put numbers in."""
    return [np.empty(rows) for _ in range(fields)]


def _header(first: bytes, file: str) -> list[str] | None:
    """Names of a first line, or none where it is not one of a clean file."""
    try:
        return delimited.split(first + b"0\n", file)[0] if first.endswith(b"\n") else None
    except LogFormatError:
        return None


def _scan(stream: BinaryIO, digest: hashlib._Hash, fields: int) -> tuple[str, int] | None:
    """Digest and rows of what follows the header, or none at the first block that is not clean."""
    total = 0
    for block in _blocks(stream):
        digest.update(block)
        rows = _clean_rows(block, fields)
        if not rows:
            return None
        total += rows
    return (digest.hexdigest(), total) if total else None


def _blocks(stream: BinaryIO) -> Iterator[bytes]:
    """Whole lines of what is left of a file, about BLOCK bytes at a time; the last may lack its
    end.
    """
    while block := stream.read(BLOCK):
        yield block if block.endswith(b"\n") else block + stream.readline(LARGEST_LINE)


def _ends(block: bytes) -> int:
    """Line ends in a block: a comparison of all bytes, a fifth of the time of a search for one
    after the other.
    """
    return int(np.count_nonzero(np.frombuffer(block, np.uint8) == ord("\n")))


def _clean_rows(block: bytes, fields: int) -> int:
    """Rows of a block of whole lines of so many fields, of the bytes of numbers alone; 0 where it
    is anything else.
    """
    if not block.endswith(b"\n") or (b"\r" in block and block.count(b"\r") != block.count(b"\r\n")):
        return 0
    # what is left of numbers without their digits is the shape of the lines: one comparison for
    # every field
    shape = block.translate(None, NUMBER)
    rows, odd = divmod(len(shape), fields)
    return rows if not odd and shape == (b"," * (fields - 1) + b"\n") * rows else 0


class _Lines:
    """Bytes as a file that the parser takes as they are: of a `BytesIO` it would decode and encode
    every character.
    """

    def __init__(self, block: bytes) -> None:
        self._left = memoryview(block)

    def read(self, size: int = -1) -> bytes:
        """The next bytes, at most so many."""
        part = bytes(self._left[:size] if size >= 0 else self._left)
        self._left = self._left[len(part) :]
        return part

    def __iter__(self) -> Iterator[bytes]:
        """No lines: pandas asks only whether a file could be gone through."""
        return iter(())


def _parsed(block: bytes, columns: list[Array]) -> bool:
    """Put the numbers of a block of lines into columns [rows]; whether it is clean and has so many
    rows.
    """
    library = kernels()
    if library is None:
        return _parsed_by_pandas(block, columns)
    from ctypes import POINTER, c_double

    doubles = POINTER(c_double)
    places = (doubles * len(columns))(*(column.ctypes.data_as(doubles) for column in columns))
    rows: int = library.calibkit_numbers(block, len(block), len(columns), columns[0].size, places)
    return rows == columns[0].size


def _parsed_by_pandas(block: bytes, columns: list[Array]) -> bool:
    """As `_parsed`, where there are no compiled kernels."""
    import pandas as pd

    fields = len(columns)
    rows = _clean_rows(block, fields)
    if not rows or rows != columns[0].size:
        return False
    lines = cast("BinaryIO", _Lines(block))
    try:
        frame = pd.read_csv(
            lines, header=None, names=list(range(fields)), dtype="float64", low_memory=False
        )
    except (ValueError, OverflowError):
        return False
    if len(frame) != rows:
        return False
    for k, column in enumerate(columns):
        column[:] = frame[k].to_numpy()
    return True

"""Fast reader of clean comma-separated logs: what the strict reader would read to the same numbers, or nothing.

Format: that of `delimited` without a missing value, a text, a blank or a last line without its end. The file goes through
memory once, a block of whole lines at a time: its digest is taken, its bytes and the fields of every line are looked at, and
its numbers are parsed, several blocks beside each other, into columns that were made for them.
Uncertainty of reading: as of `delimited`.
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
from calibkit.readers import delimited
from calibkit.readers.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator
    from concurrent.futures import Future
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

BLOCK = 1 << 20
"""Bytes read and parsed at a time."""
WORKERS = min(4, os.cpu_count() or 1)
"""Blocks that are parsed beside each other."""
LARGEST_HEADER = 1 << 16
LARGEST_LINE = 1 << 20
NUMBER = b"0123456789.+-eE\r"
"""Bytes of numbers, and the return before a line end."""


def read(path: Path, file: str) -> Table | None:
    """Read a log whose every field is a number; none where it is anything else, for a stricter reader to say what.

    Memory beyond the numbers is that of a few blocks. Raises LogFormatError where the file cannot be read.
    """
    import pandas as pd

    try:
        before = path.stat()
        with path.open("rb") as stream:
            first = stream.readline(LARGEST_HEADER)
            header = _header(first, file)
            columns = _columns(stream, hashlib.sha256(first), len(header), before.st_size) if header else None
        after = path.stat()
    except OSError as error:
        raise LogFormatError(f"{file}: cannot be read: {error.strerror}", hint="check the file") from None
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise LogFormatError(f"{file}: it changed while it was read", hint="wait until the logger has closed it")
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
    """Digest and columns of what follows the header in a file of `size` bytes, or none where a block is not clean."""
    store: tuple[Array, ...] = tuple(np.empty(0) for _ in range(fields))
    rows = seen = 0
    with ThreadPoolExecutor(WORKERS) as beside:
        parsing: deque[tuple[int, Future[list[Array] | None]]] = deque()
        blocks = _blocks(stream)
        while (block := next(blocks, b"")) or parsing:
            if block:
                digest.update(block)
                parsing.append((len(block), beside.submit(_numbers, block, fields)))
            if block and len(parsing) <= WORKERS:
                continue
            length, parsed = parsing.popleft()
            numbers = parsed.result()
            if numbers is None:
                return None
            seen += length
            store = _stored(store, numbers, rows, size / seen)
            rows += numbers[0].size
    return _Columns(digest.hexdigest(), tuple(column[:rows] for column in store)) if rows else None


def _stored(store: tuple[Array, ...], numbers: list[Array], row: int, share: float) -> tuple[Array, ...]:
    """Columns with those [m] of a block from a row on; made longer for the rest of the file where they are full.

    `share` is the length of the file, of what has been read of it.
    """
    stop = row + numbers[0].size
    if stop > store[0].size:
        more = int(1.02 * stop * share) + 1
        store = tuple(np.concatenate((column[:row], np.empty(more - row))) for column in store)
    for column, values in zip(store, numbers, strict=True):
        column[row:stop] = values
    return store


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
            seen = _scan(stream, hashlib.sha256(first), len(header)) if header is not None else None
    except OSError as error:
        raise LogFormatError(f"{file}: cannot be read: {error.strerror}", hint="check the file") from None
    return Scanned(tuple(header), *seen) if header is not None and seen is not None else None


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
    """Whole lines of what is left of a file, about BLOCK bytes at a time; the last may lack its end."""
    rest = b""
    while part := stream.read(BLOCK):
        end = part.rfind(b"\n") + 1
        if end or len(rest) > LARGEST_LINE:
            yield rest + part[:end]
            rest = part[end:]
        else:
            rest += part
    if rest:
        yield rest


def _clean_rows(block: bytes, fields: int) -> int:
    """Rows of a block of whole lines of so many fields, of the bytes of numbers alone; 0 where it is anything else."""
    if not block.endswith(b"\n") or (b"\r" in block and block.count(b"\r") != block.count(b"\r\n")):
        return 0
    # what is left of numbers without their digits is the shape of the lines: one comparison for every field
    shape = block.translate(None, NUMBER)
    rows, odd = divmod(len(shape), fields)
    return rows if not odd and shape == (b"," * (fields - 1) + b"\n") * rows else 0


class _Lines:
    """Bytes as a file that the parser takes as they are: of a `BytesIO` it would decode and encode every character."""

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


def _numbers(block: bytes, fields: int) -> list[Array] | None:
    """Columns [rows] of a block of lines, or none where it is not clean."""
    import pandas as pd

    rows = _clean_rows(block, fields)
    if not rows:
        return None
    lines = cast("BinaryIO", _Lines(block))
    try:
        frame = pd.read_csv(lines, header=None, names=list(range(fields)), dtype="float64", low_memory=False)
    except (ValueError, OverflowError):
        return None
    return [frame[k].to_numpy() for k in range(fields)] if len(frame) == rows else None

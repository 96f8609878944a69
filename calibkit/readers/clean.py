"""Fast reader of clean comma-separated logs: the numbers that `text` would read, or nothing.

Format: UTF-8 (a byte-order mark is accepted), one line of names, then one row a line of nothing but
numbers between commas, with decimal points; an empty field or `nan` is a missing value; LF or CRLF
line ends, also of the last line. The rows are parsed in blocks of whole lines, several beside each
other. Uncertainty of reading: the nearest float64.
"""

import hashlib
import io
import itertools
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from calibkit.errors import LogFormatError, advise_exclude
from calibkit.native import kernels
from calibkit.numeric.arrays import Array
from calibkit.readers import delimited
from calibkit.readers.table import Table

BLOCK = 1 << 20
"""Bytes read and parsed at a time."""
WORKERS = min(4, os.cpu_count() or 1)
"""Blocks that are parsed beside each other."""
_LARGEST_HEADER = 1 << 16
_LARGEST_LINE = 1 << 20
_NUMBER = b"0123456789.+-eEnaNA\r"
"""Bytes of numbers and missing values (`delimited.MISSING`), and the return before a line end."""


def read(path: Path, file: str) -> Table | None:
    """Read a log whose every field is a number or missing; None where one is not, for the reader of
    text to name it. Raises LogFormatError where the file cannot be read.
    """
    with delimited.open_log(path, file) as stream, ThreadPoolExecutor(WORKERS) as threads:
        before = path.stat()
        first = stream.readline(_LARGEST_HEADER)
        header = _read_header(first, file)
        if header is None:
            return None
        columns = _allocate_columns(len(header), sum(map(_count_line_ends, _read_blocks(stream))))
        clean = columns[0].size > 0
        stream.seek(len(first))
        blocks, sha256, row = _read_blocks(stream), hashlib.sha256(first), 0
        # few blocks at a time, so that little of the file is in memory beside its numbers
        while clean and (batch := list(itertools.islice(blocks, WORKERS))):
            parsed = []
            for block in batch:
                stop = row + _count_line_ends(block)
                rows = [column[row:stop] for column in columns]
                parsed.append(threads.submit(_parse, block, rows))
                row = stop
            for block in batch:
                sha256.update(block)
            clean = all(future.result() for future in parsed)
        after = path.stat()
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise changed(file)
    if not clean:
        return None
    import pandas as pd  # beside a long log, in another thread, before this

    frame = pd.DataFrame(dict(zip(header, columns, strict=True)), copy=False)
    return Table(file, sha256.hexdigest(), frame)


@dataclass(frozen=True, slots=True)
class Scan:
    """What is known of a clean file that was not parsed: its columns, digest and rows."""

    header: tuple[str, ...]
    sha256: str
    rows: int


def scan_file(path: Path, file: str) -> Scan | None:
    """Scan a file in the memory of a block; None where it is not clean. Raises LogFormatError where
    it cannot be read.
    """
    with delimited.open_log(path, file) as stream:
        first = stream.readline(_LARGEST_HEADER)
        header, sha256, rows = _read_header(first, file), hashlib.sha256(first), 0
        if header is None:
            return None
        for block in _read_blocks(stream):
            sha256.update(block)
            clean = _count_clean_rows(block, len(header))
            if not clean:
                return None
            rows += clean
    return Scan(tuple(header), sha256.hexdigest(), rows) if rows else None


def read_chunks(path: Path, file: str, scan: Scan, rows: int) -> Iterator[Table]:
    """Tables of at most `rows` rows of a scanned file, one after the other; the index counts on.

    Raises LogFormatError for a line of anything but numbers, and for a file that changed since it
    was scanned.
    """
    fields, count, filled = len(scan.header), 0, 0
    chunk = _allocate_columns(fields, rows)
    with delimited.open_log(path, file) as stream:
        stream.readline(_LARGEST_HEADER)
        for block in _read_blocks(stream):
            numbers = _allocate_columns(fields, _count_line_ends(block))
            if not _parse(block, numbers):
                raise _first_fault(file, block, count + filled, fields)
            if count + filled + numbers[0].size > scan.rows:
                raise changed(file)
            row = 0
            while row < numbers[0].size:
                count_to_copy = min(numbers[0].size - row, rows - filled)
                for column, values in zip(chunk, numbers, strict=True):
                    column[filled : filled + count_to_copy] = values[row : row + count_to_copy]
                row, filled = row + count_to_copy, filled + count_to_copy
                if filled == rows:
                    yield _chunk_table(file, scan, chunk, count)
                    chunk, count, filled = _allocate_columns(fields, rows), count + rows, 0
    if filled:
        yield _chunk_table(file, scan, [column[:filled] for column in chunk], count)
    if count + filled != scan.rows:
        raise changed(file)


def changed(file: str) -> LogFormatError:
    """The error of a log that is another when it is read again."""
    return LogFormatError(
        f"{file}: it changed while it was read", hint="wait until the logger has closed it"
    )


def _chunk_table(file: str, scan: Scan, columns: list[Array], first: int) -> Table:
    """Table of the rows of a file from a first one on."""
    import pandas as pd

    frame = pd.DataFrame(dict(zip(scan.header, columns, strict=True)), copy=False)
    return Table(file, scan.sha256, frame.set_axis(frame.index + first))


def _first_fault(file: str, block: bytes, rows: int, fields: int) -> LogFormatError:
    """The error of the first line of a block, `rows` rows into a file, that is not one of
    numbers.
    """
    lines = block.splitlines(keepends=True)
    odd = next(
        (k for k, line in enumerate(lines) if not _parse(line, _allocate_columns(fields, 1))), 0
    )
    return LogFormatError(
        f"{file}:{rows + odd + 2}: found"
        f" {lines[odd].decode('ascii', 'backslashreplace').strip()!r}, expected {fields} numbers",
        hint=f"repair the row, or leave it out: {advise_exclude(file, lines=[rows + odd + 2])}",
    )


def _allocate_columns(fields: int, rows: int) -> list[Array]:
    """Columns [rows] to put numbers in."""
    return [np.empty(rows) for _ in range(fields)]


def _read_header(first: bytes, file: str) -> list[str] | None:
    """Names in a first line, or None where it is not the header of a clean file."""
    odd = b"\0" in first or b"\r" in first.removesuffix(b"\r\n")
    if odd or not first.endswith(b"\n"):
        return None
    try:
        return delimited.split_names(first, file)
    except LogFormatError:
        return None


def _read_blocks(stream: BinaryIO) -> Iterator[bytes]:
    """Whole lines of the rest of a file, about BLOCK bytes at a time; the last may lack its end."""
    while block := stream.read(BLOCK):
        yield block if block.endswith(b"\n") else block + stream.readline(_LARGEST_LINE)


def _count_line_ends(block: bytes) -> int:
    """Number of line ends in a block, by comparing all bytes: five times as fast as a search."""
    return int(np.count_nonzero(np.frombuffer(block, np.uint8) == ord("\n")))


def _count_clean_rows(block: bytes, fields: int) -> int:
    """Number of rows of a block of whole lines of so many numbers; 0 where it is anything else."""
    if not block.endswith(b"\n") or (b"\r" in block and block.count(b"\r") != block.count(b"\r\n")):
        return 0
    # what is left of numbers without their digits is the shape of the lines: one comparison for
    # every field
    shape = block.translate(None, _NUMBER)
    rows, odd = divmod(len(shape), fields)
    return rows if not odd and shape == (b"," * (fields - 1) + b"\n") * rows else 0


def _parse(block: bytes, columns: list[Array]) -> bool:
    """Parse a block of lines into columns [rows]; whether it is clean and has that many rows."""
    library = kernels()
    if library is None:
        return _parse_by_pandas(block, columns)
    from ctypes import POINTER, c_double

    doubles = POINTER(c_double)
    places = (doubles * len(columns))(*(column.ctypes.data_as(doubles) for column in columns))
    rows: int = library.calibkit_numbers(block, len(block), len(columns), columns[0].size, places)
    return rows == columns[0].size


def _parse_by_pandas(block: bytes, columns: list[Array]) -> bool:
    """As `_parse`, where there are no compiled kernels."""
    import pandas as pd

    fields = len(columns)
    rows = _count_clean_rows(block, fields)
    if not rows or rows != columns[0].size:
        return False
    try:
        frame = pd.read_csv(
            io.BytesIO(block),
            header=None,
            names=list(range(fields)),
            dtype="float64",
            keep_default_na=False,
            na_values=sorted(delimited.MISSING),
            low_memory=False,
        )
    except (ValueError, OverflowError):
        return False
    if len(frame) != rows or np.isinf(frame.to_numpy()).any():
        return False
    for k, column in enumerate(columns):
        column[:] = frame[k].to_numpy()
    return True

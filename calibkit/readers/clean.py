"""Fast reader of clean comma-separated logs: the numbers that `text` would read, or nothing.

Format: UTF-8 (a byte-order mark is accepted), one line of names, then one row a line of nothing but
numbers between commas, with decimal points; an empty field or `nan` is a missing value; LF or CRLF
line ends, also of the last line. The rows are parsed in blocks of whole lines, several beside each
other; the columns of a large log lie in scratch files. Uncertainty of reading: the nearest float64.
"""

import hashlib
import io
import itertools
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.native import kernels
from calibkit.numeric.arrays import Array
from calibkit.readers import delimited, scratch_files
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
        rows = sum(map(_count_line_ends, _read_blocks(stream)))
        is_large = before.st_size > scratch_files.largest_in_memory()
        columns = [
            scratch_files.allocate_column(rows) if is_large else np.empty(rows) for _ in header
        ]
        clean = columns[0].size > 0
        stream.seek(len(first))
        blocks, sha256, row = _read_blocks(stream), hashlib.sha256(first), 0
        # few blocks at a time, so that little of the file is in memory beside its numbers
        while clean and (batch := list(itertools.islice(blocks, WORKERS))):
            parsed = []
            for block in batch:
                stop = row + _count_line_ends(block)
                rows_of_block = [column[row:stop] for column in columns]
                parsed.append(threads.submit(_parse, block, rows_of_block))
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


def changed(file: str) -> LogFormatError:
    """The error of a log that is another when it is read again."""
    return LogFormatError(
        f"{file}: it changed while it was read", hint="wait until the logger has closed it"
    )


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

"""Reader of MATLAB MAT-files: v4 to v7 by scipy, v7.3 (HDF5) by h5py.

Format: named variables; structs hold fields. The vectors of one struct, or of the top level, are
the columns of one log ([logs] table names the struct, or the matrix whose columns [logs] names
lists). Uncertainty: values as stored in float64; text, cells and objects are not read.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.readers import hdf5, limited
from calibkit.readers.table import Table

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from calibkit.recipe.logs import Logs

HEADER_BYTES = 128
KINDS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 14, 15, 16, 17, 18})
"""Types of data elements that the format defines."""
MATRIX, COMPRESSED = 14, 15
DEEPEST = 30
"""Nesting beyond which a file is not believed."""


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read one struct, or one matrix, of a MAT-file, or raise LogFormatError."""
    from calibkit.readers import arrays, delimited

    data, sha256 = delimited.read_bytes(path, file)
    if data[:20].startswith((b"MATLAB 7.3", b"\x89HDF")):
        return hdf5.read(path, file, logs, required_columns)
    if not data.startswith(b"MATLAB 5.0") and data[:4] not in {b"\0\0\0\0", b"\x0a\0\0\0"}:
        raise LogFormatError(
            f"{file}: not a MATLAB file; it begins with {data[:12]!r}",
            hint="a text of that name is read with format = 'text'",
        )
    variables = limited.parse(parse, file, data).arrays
    frame, how = arrays.select_columns(variables, file, logs, required_columns)
    return Table(file, sha256, frame, (), (f"MATLAB, {len(frame)} rows", *how))


def parse(data: bytes, file: str) -> limited.Parsed:
    """Arrays of all variables and fields by their paths."""
    from scipy import io as scipy_io

    if data.startswith(b"MATLAB 5.0"):
        _require_nested(data, HEADER_BYTES, len(data), "<" if data[126:128] == b"IM" else ">", file)
    with limited.refuse_damaged(file, "MATLAB"):
        variables = scipy_io.loadmat(io.BytesIO(data), simplify_cells=True)  # type: ignore[arg-type] # files are read too
    return limited.Parsed(_flatten_structs(variables))


def _require_nested(
    data: bytes, start: int, stop: int, order: str, file: str, depth: int = 0
) -> None:
    """Raise LogFormatError for elements that do not nest: the library that reads the file does not
    check this, and can crash.
    """
    position = start
    while position < stop:
        if position + 8 > stop or depth > DEEPEST:
            raise _nesting_error(file, position)
        word, size = struct.unpack_from(order + "II", data, position)
        kind, begin = word, position + 8
        if word >> 16:  # a small element: its size and bytes stand in the tag
            kind, size, begin = word & 0xFFFF, word >> 16, position + 4
        end = begin + size
        if kind not in KINDS or end > stop or (word >> 16 and size > 4):
            raise _nesting_error(file, position)
        if kind == COMPRESSED:
            with limited.refuse_damaged(file, "MATLAB"):
                inner = zlib.decompress(data[begin:end])
            _require_nested(inner, 0, len(inner), order, file, depth + 1)
        elif kind == MATRIX and size:
            _require_nested(data, begin, end, order, file, depth + 1)
        position = end if kind == COMPRESSED else position + 8 if word >> 16 else end + -size % 8
    if position != stop:
        raise _nesting_error(file, position)


def _nesting_error(file: str, position: int) -> LogFormatError:
    """The error of elements that do not nest."""
    return LogFormatError(
        f"{file}: not a whole MATLAB file: broken at byte {position}",
        hint="the file is damaged or cut off; copy it again",
    )


def _flatten_structs(
    variables: Mapping[str, Any], prefix: str = ""
) -> dict[str, NDArray[np.generic]]:
    """Arrays of all variables and of the fields of all structs, by their paths."""
    arrays: dict[str, NDArray[np.generic]] = {}
    for name, value in variables.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict):
            arrays |= _flatten_structs(value, f"{prefix}{name}/")
        elif isinstance(value, np.ndarray):
            arrays[f"{prefix}{name}"] = value
    return arrays

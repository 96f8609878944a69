"""Reader of HDF5 files, MATLAB v7.3 among them, by h5py.

Format: named datasets in groups. One group is one log ([logs] table, needed where several groups
hold numbers): its vectors are columns, with an attribute `units` or `unit` as their unit; a single
matrix needs the recipe's `names`; a compound dataset is a table, its fields the columns.
Uncertainty: values as stored, integers above 2⁵³ rounded to float64. Values that lie in other
files, which the log's digest does not cover, and values that were never written, which read as
zeros, are refused.
"""

import io
import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import arrays, delimited, optional
from calibkit.readers.table import Table
from calibkit.recipe.logs import Logs


def read(path: Path, file: str, logs: Logs, needed: Collection[str]) -> Table:
    """Read one group of an HDF5 file, or raise LogFormatError."""
    h5py = optional.import_library("h5py", "hdf5", file)
    data, sha256 = delimited.read_bytes(path, file)
    found: dict[str, Any] = {}
    stated: dict[str, str] = {}

    def collect(name: str, node: Any) -> None:  # noqa: ANN401 (h5py's callback)
        if not isinstance(node, h5py.Dataset) or node.shape is None or name.startswith("#refs#"):
            return
        numeric = bool(node.dtype.names) or node.dtype.kind in "fiub"
        if numeric and (not logs.table or f"{name}/".startswith(f"{logs.table}/")):
            _require_own_values(name, node, file)
        text = node.attrs.get("units", node.attrs.get("unit", ""))
        unit = units.parse_unit(
            text.decode(errors="replace") if isinstance(text, bytes) else str(text)
        )
        if node.dtype.names:
            whole = node[()]
            found.update({f"{name}/{field}": whole[field] for field in node.dtype.names})
        elif node.dtype.kind in "fiub":
            found[name] = node[()]
        if unit:
            stated[name.rpartition("/")[2]] = unit

    with optional.refuse_damaged(file, "HDF5"), h5py.File(io.BytesIO(data), "r") as opened:
        opened.visititems(collect)
    frame, how = arrays.select_columns(found, file, logs, needed)
    return Table(file, sha256, frame, (), (f"HDF5, {len(frame)} rows", *how), stated)


def _require_own_values(name: str, node: Any, file: str) -> None:  # noqa: ANN401 (h5py's dataset)
    """Raise LogFormatError for a dataset whose values are not all in this file."""
    if node.is_virtual or node.external:
        raise LogFormatError(
            f"{file}: the values of '{name}' lie in other files, which the log's digest does not"
            " cover",
            hint="write a file that holds its own values, by h5repack or by the logger's export",
        )
    if node.chunks is None:
        whole = not node.size or node.id.get_storage_size() > 0
    else:
        counts = (-(-n // size) for n, size in zip(node.shape, node.chunks, strict=True))
        whole = node.id.get_num_chunks() >= math.prod(counts)
    if not whole:
        raise LogFormatError(
            f"{file}: '{name}' was not written to its end: what is missing would read as zeros",
            hint="cut the log at its last written row, or measure again",
        )

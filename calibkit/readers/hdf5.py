"""Reader of HDF5 files, MATLAB v7.3 among them, by h5py.

Format: named datasets in groups. One group is one log ([logs] table, needed where several groups
hold numbers): its vectors are columns, with an attribute `units` or `unit` as their unit; what
netCDF packed by scale_factor, add_offset and _FillValue is unpacked; a single matrix needs the
recipe's `names`; a compound dataset is a table, its fields the columns.
Uncertainty: values as stored, integers above 2⁵³ rounded to float64. Values that lie in other
files, which the log's digest does not cover, and values that were never written, which read as
zeros, are refused.
"""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import limited
from calibkit.readers.table import Table

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from calibkit.recipe.logs import Logs


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read one group of an HDF5 file, or raise LogFormatError."""
    from calibkit.readers import arrays, delimited

    limited.require_library("hdf5", file)
    data, sha256 = delimited.read_bytes(path, file)
    side_by_side, table = logs.table == arrays.SIDE_BY_SIDE, (*logs.tables, logs.table)[0]
    parsed = limited.parse(parse, file, data, "" if side_by_side or logs.tables else table)
    frame, how = arrays.select_columns(parsed.arrays, file, logs, required_columns)
    column_units = {
        name if side_by_side else name.rpartition("/")[2]: unit
        for name, unit in parsed.facts["units"].items()
        if side_by_side or not table or f"{name}/".startswith(f"{table}/")
    }
    return Table(file, sha256, frame, (), (f"HDF5, {len(frame)} rows", *how), column_units)


def parse(data: bytes, file: str, table: str) -> limited.Parsed:
    """Arrays and units of all datasets by their paths."""
    import h5py

    arrays: dict[str, Any] = {}
    dataset_units: dict[str, str] = {}

    def collect(name: str, node: Any) -> None:  # noqa: ANN401 (h5py's callback)
        if not isinstance(node, h5py.Dataset) or node.shape is None or name.startswith("#refs#"):
            return
        numeric = bool(node.dtype.names) or node.dtype.kind in "fiu"
        if numeric and (not table or f"{name}/".startswith(f"{table}/")):
            _require_own_values(name, node, file)
        attributes = {key.lower(): node.attrs[key] for key in node.attrs}
        stated = np.ravel(attributes.get("units", attributes.get("unit", "")))
        text = stated[0] if stated.size else ""
        text = text.decode(errors="replace") if isinstance(text, bytes) else str(text)
        unit = units.as_stated(text)
        if node.dtype.names:
            table_rows = node[()]
            arrays.update({f"{name}/{field}": table_rows[field] for field in node.dtype.names})
        elif node.dtype.kind in "fiu":
            arrays[name] = _unpacked(node[()], attributes)
        if unit:
            dataset_units[name] = unit

    with limited.refuse_damaged(file, "HDF5"), h5py.File(io.BytesIO(data), "r") as opened:
        # the library passes over bytes behind the end that the superblock states: base address,
        # free space or extension, end of file, eight bytes each
        base = opened.userblock_size
        addresses = base + (24 if data[base + 8] < 2 else 12) + (4 if data[base + 8] == 1 else 0)
        end = int.from_bytes(data[addresses + 16 : addresses + 24], "little")
        if len(data) not in {end, end + base}:
            raise LogFormatError(
                f"{file}: {len(data)} bytes, its own end is stated at {end}",
                hint="bytes were lost, added or shifted; copy it again",
            )
        opened.visititems(collect)
    return limited.Parsed(arrays, {"units": dataset_units})


def _unpacked(values: Any, attributes: Mapping[str, Any]) -> Any:  # noqa: ANN401 (h5py's values)
    """Values of a variable that netCDF packed (CF conventions 8.1): missing ones as NaN, times
    scale_factor, plus add_offset.
    """
    packing = {key: attributes[key] for key in ("scale_factor", "add_offset") if key in attributes}
    missing = [attributes[key] for key in ("_fillvalue", "missing_value") if key in attributes]
    if not packing and not missing:
        return values
    unpacked = np.asarray(values, dtype=np.float64)
    for fill in np.ravel(missing):
        unpacked = np.where(np.asarray(values) == fill, np.nan, unpacked)
    scale, offset = (
        float(np.ravel(packing.get(key, default))[0])
        for key, default in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    return units.scaled(unpacked, scale, offset=offset)


def _require_own_values(name: str, node: Any, file: str) -> None:  # noqa: ANN401 (h5py's dataset)
    """Raise LogFormatError for a dataset whose values are not all in this file."""
    if node.is_virtual or node.external:
        raise LogFormatError(
            f"{file}: the values of '{name}' lie in other files, which the log's digest does not"
            " cover",
            hint="write a file that holds its own values, by h5repack or by the logger's export",
        )
    if node.chunks is None:
        complete = not node.size or node.id.get_storage_size() > 0
    else:
        counts = (-(-n // size) for n, size in zip(node.shape, node.chunks, strict=True))
        complete = node.id.get_num_chunks() >= math.prod(counts)
    if not complete:
        raise LogFormatError(
            f"{file}: '{name}' was not written to its end: what is missing would read as zeros",
            hint="cut the log at its last written row, or measure again",
        )

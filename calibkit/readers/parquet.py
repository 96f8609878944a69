"""Reader of Apache Parquet files, by pyarrow.

Format: columns of one length; a column's field metadata `unit` or `units` is its unit. Columns of
instants become seconds since their first. Uncertainty: values as stored, integers above 2⁵³ rounded
to float64; nulls have no value.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import limited
from calibkit.readers.table import Table

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from calibkit.numeric.arrays import Array
    from calibkit.recipe.logs import Logs


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:  # noqa: ARG001 (the readers' shape)
    """Read a Parquet file, or raise LogFormatError."""
    from calibkit.readers import arrays, delimited

    data, sha256 = delimited.read_bytes(path, file)
    parsed = limited.parse(parse, file, data)
    frame = arrays.join_vectors(parsed.arrays, file, required_columns)
    return Table(file, sha256, frame, (), (f"Parquet, {len(frame)} rows",), parsed.facts["units"])


def parse(data: bytes, file: str) -> limited.Parsed:
    """Columns of numbers and their units, pages held against their checksums where they have
    them.
    """
    import pyarrow as pa
    from pyarrow import parquet

    columns, column_units = {}, {}
    with limited.refuse_damaged(file, "Parquet"):
        opened = parquet.ParquetFile(io.BytesIO(data), page_checksum_verification=True)
        limited.require_columns(opened.metadata.num_columns, file)
        table = opened.read(use_threads=False)
        if len(set(table.schema.names)) != len(table.schema.names):
            raise LogFormatError(
                f"{file}: a column stands twice", hint="give each column its own name"
            )
        for field in table.schema:
            column = _to_numbers(table.column(field.name), field.type, pa)
            if column is not None:
                columns[field.name] = column
            metadata = {
                key.decode(): value.decode() for key, value in (field.metadata or {}).items()
            }
            if unit := units.as_stated(metadata.get("units", metadata.get("unit", ""))):
                column_units[field.name] = unit
    return limited.Parsed(columns, {"units": column_units})


def _to_numbers(column: Any, kind: Any, pyarrow: Any) -> Array | None:  # noqa: ANN401 (pyarrow ships no types)
    """A column as float64, instants as seconds since the first, nulls as NaN; None for
    text and truth values.
    """
    types = pyarrow.types
    if types.is_timestamp(kind):
        # an instant with a zone is stored as that of UTC
        values = column.cast(pyarrow.timestamp(kind.unit)).to_numpy()
        instants = values[~np.isnat(values)]
        start = instants[0] if instants.size else np.datetime64(0, "ns")
        return np.asarray((values - start) / np.timedelta64(1, "ns"), dtype=np.float64) / 1e9
    if types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind):
        return np.asarray(column.cast(pyarrow.float64(), safe=False).to_numpy(), dtype=np.float64)
    return None

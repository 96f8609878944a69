"""Reader of raw binary records that the recipe describes.

Format ([logs.binary]): `header_bytes` that are skipped, then records of one length to the end of
the file, each the listed fields without gaps: integers of 1, 2, 4, 8 bytes, signed (i) or not (u),
IEEE floats (f4, f8), `skip` for bytes without meaning; `byte_order` of the record, or of a field of
its own; `sync`, bytes that every record must begin with (part of the first fields, or skipped).
value = scale · stored + offset. Uncertainty: stored values exactly, scaled to the nearest float64,
integers above 2⁵³ rounded. A file that is not a whole number of records is refused: it is cut off,
or described wrongly.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import arrays, delimited
from calibkit.readers.table import Table
from calibkit.recipe.logs import Logs


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:  # noqa: ARG001 (the readers' shape)
    """Read raw records whole, or raise LogFormatError that names the record."""
    assert logs.binary is not None  # noqa: S101 (the recipe's own check: format = 'binary' has [logs.binary])
    spec = logs.binary
    data, sha256 = delimited.read_bytes(path, file)
    types = []
    for number, field in enumerate(spec.fields):
        if field.type == "skip":
            types.append((f"skipped {number}", np.dtype(f"V{field.bytes}")))
        else:
            order = spec.byte_order if field.byte_order == "record" else field.byte_order
            types.append((field.name, np.dtype(field.type).newbyteorder(order)))
    layout = np.dtype(types)
    body = len(data) - spec.header_bytes
    if body <= 0 or body % layout.itemsize:
        raise LogFormatError(
            f"{file}: {body} bytes behind the header, expected records of {layout.itemsize} bytes "
            f"({body // layout.itemsize} and {body % layout.itemsize} bytes over)",
            hint="the file is cut off, or [logs.binary] describes it wrongly",
        )
    records = np.frombuffer(data, layout, offset=spec.header_bytes)
    # from a record that begins with other bytes on every field would hold what is another's
    sync = np.frombuffer(bytes.fromhex(spec.sync), np.uint8)
    stored = np.frombuffer(data, np.uint8, offset=spec.header_bytes)
    begins = stored.reshape(-1, layout.itemsize)[:, : sync.size]
    wrong = np.flatnonzero((begins != sync).any(axis=1))
    if wrong.size:
        record = int(wrong[0])
        raise LogFormatError(
            f"{file}:{record + 1}: record {record + 1} begins with"
            f" {begins[record].tobytes().hex()}, expected {spec.sync.lower()}",
            hint="bytes were lost or added before it; copy the file again",
        )
    fields = [field for field in spec.fields if field.type != "skip"]
    columns = {
        field.name: units.scaled(
            records[field.name].astype(np.float64), field.scale, offset=field.offset
        )
        for field in fields
    }
    return Table(
        file,
        sha256,
        arrays.make_frame(columns),
        reading=(f"binary records of {layout.itemsize} bytes, {len(records)} rows",),
        units={field.name: units.parse_unit(field.unit) for field in fields if field.unit},
    )

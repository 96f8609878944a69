"""Reader of NI TDMS files, by npTDMS.

Format: binary segments of groups, channels, properties and raw data (little- or big-endian,
interleaved or not, DAQmx raw data scaled by its own properties). One group is one log ([logs]
table, needed where there are several); its channels are columns, with `unit_string` as their unit.
Where the group holds no channel `time_s` one is made from wf_start_offset + k·wf_increment;
channels of times become seconds since their first. Uncertainty: values as stored, scaled in
float64; a file whose last segment was not finished is refused.
"""

from __future__ import annotations

import io
import logging
import struct
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.readers import limited
from calibkit.readers.table import Guess, Table

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from numpy.typing import NDArray

    from calibkit.numeric.arrays import Array
    from calibkit.recipe.logs import Logs

LEAD_BYTES = 28
"""Bytes of a segment before its metadata: mark, flags, version, lengths of segment and metadata."""
UNFINISHED = 0xFFFFFFFFFFFFFFFF
"""Length of a segment whose writing was not finished."""


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read one group of a TDMS file, or raise LogFormatError."""
    from calibkit.readers import arrays, delimited

    data, sha256 = delimited.read_bytes(path, file)
    parsed = limited.parse(parse, file, data, logs.table)
    group = parsed.facts["group"]
    frame = arrays.join_vectors(parsed.arrays, file, required_columns)
    how = () if logs.table else (Guess(f"table = '{group}' (guessed)"),)
    how = (f"TDMS, group '{group}', {len(frame)} rows", *how)
    return Table(file, sha256, frame, (), how, parsed.facts["units"])


def parse(data: bytes, file: str, table: str) -> limited.Parsed:
    """Channels of one group, their units and the group's name."""
    import nptdms

    _require_segments(data, file)
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("nptdms")]:
        logging.getLogger(name).setLevel(logging.ERROR)  # what it warns of is refused here
    with limited.refuse_damaged(file, "TDMS"), nptdms.TdmsFile.open(io.BytesIO(data)) as opened:
        if opened.file_status.incomplete_final_segment:
            raise LogFormatError(
                f"{file}: the last segment is not finished", hint="the recording was cut off"
            )
        filled = [g for g in opened.groups() if any(len(channel) for channel in g.channels())]
        candidates = [g for g in filled if g.name == table] if table else filled
        if len(candidates) != 1:
            group_names = ", ".join(f"'{g.name}'" for g in filled) or "none"
            fault = f"no group {table!r}" if table else f"{len(filled)} groups with channels"
            raise LogFormatError(
                f"{file}: {fault}",
                hint=f"name one in [logs] table of the recipe; there are: {group_names}",
            )
        (group,) = candidates
        channels = {channel.name: channel for channel in group.channels() if len(channel)}
        columns = {name: _to_numbers(channel[:]) for name, channel in channels.items()}
        channel_units = {}
        for name, channel in channels.items():
            unit = units.as_stated(str(channel.properties.get("unit_string", "")))
            if unit:
                channel_units[name] = unit
        increments = set()
        for channel in channels.values():
            step = float(channel.properties.get("wf_increment") or 0.0)
            start = float(channel.properties.get("wf_start_offset", 0.0)) if step else 0.0
            increments.add((start, step))
    number_columns = {name: column for name, column in columns.items() if column is not None}
    lengths = {len(column) for column in number_columns.values()}
    if len(lengths) == 1 and len(increments) == 1 and "time_s" not in number_columns:
        (rows,), ((start, step),) = lengths, increments
        if step:
            samples = np.arange(rows, dtype=np.float64)
            number_columns["time_s"] = start + units.scaled(samples, step)
    return limited.Parsed(dict(number_columns), {"units": channel_units, "group": group.name})


def _require_segments(data: bytes, file: str) -> None:
    """Raise LogFormatError for bytes behind the last whole segment, which the library that reads
    the file passes over.
    """
    position = 0
    while position + LEAD_BYTES <= len(data) and data[position : position + 4] == b"TDSm":
        order = ">" if data[position + 4] & 0x40 else "<"
        (size,) = struct.unpack_from(order + "Q", data, position + 12)
        if size == UNFINISHED:
            return  # refused as not finished
        position += LEAD_BYTES + size
    if position < len(data):
        raise LogFormatError(
            f"{file}: {len(data) - position} bytes behind the last segment, at byte {position}",
            hint="the file is damaged or was written on; copy it again",
        )


def _to_numbers(values: NDArray[Any]) -> Array | None:
    """A channel as float64; times as seconds since the first; None for text."""
    if values.dtype.kind == "M":
        return np.asarray((values - values[0]) / np.timedelta64(1, "us"), dtype=np.float64) / 1e6
    return np.asarray(values, dtype=np.float64) if values.dtype.kind in "fiu" else None

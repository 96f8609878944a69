"""Reader of NI TDMS files, by npTDMS.

Format: binary segments of groups, channels, properties and raw data (little- or big-endian,
interleaved or not, DAQmx raw data scaled by its own properties). One group is one log ([logs]
table, needed where there are several); its channels are columns, with `unit_string` as their unit.
Where the group holds no channel `time_s` one is made from wf_start_offset + k·wf_increment;
channels of times become seconds since their first. Uncertainty: values as stored, scaled in
float64; a file whose last segment was not finished is refused.
"""

import io
import logging
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibkit import units
from calibkit.arrays import Array
from calibkit.errors import LogFormatError
from calibkit.readers import arrays, delimited, optional
from calibkit.readers.table import Guess, Table
from calibkit.recipe.logs import Logs


def read(path: Path, file: str, logs: Logs, needed: Collection[str]) -> Table:
    """Read one group of a TDMS file, or raise LogFormatError."""
    nptdms = optional.import_library("nptdms", "tdms", file)
    data, sha256 = delimited.read_bytes(path, file)
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("nptdms")]:
        logging.getLogger(name).setLevel(logging.ERROR)  # what it warns of is refused here
    with optional.refuse_damaged(file, "TDMS"), nptdms.TdmsFile.open(io.BytesIO(data)) as opened:
        if opened.file_status.incomplete_final_segment:
            raise LogFormatError(
                f"{file}: the last segment is not finished", hint="the recording was cut off"
            )
        group, how = _find_group(opened.groups(), file, logs.table)
        channels = {channel.name: channel for channel in group.channels() if len(channel)}
        columns = {name: _to_numbers(channel[:]) for name, channel in channels.items()}
        stated = {
            name: unit
            for name, channel in channels.items()
            if (unit := units.as_stated(str(channel.properties.get("unit_string", ""))))
        }
        increments = {_waveform_increment(channel) for channel in channels.values()}
    kept = {name: column for name, column in columns.items() if column is not None}
    lengths = {len(column) for column in kept.values()}
    if len(lengths) == 1 and len(increments) == 1 and "time_s" not in kept:
        kept |= _waveform_time(next(iter(increments)), next(iter(lengths)))
    frame = arrays.join_vectors(kept, file, needed)
    how = (f"TDMS, group '{group.name}', {len(frame)} rows", *how)
    return Table(file, sha256, frame, (), how, stated)


def _find_group(groups: Sequence[Any], file: str, table: str) -> tuple[Any, tuple[str, ...]]:
    """The group that the recipe names, or the only one that holds channels."""
    filled = [group for group in groups if any(len(channel) for channel in group.channels())]
    named = [group for group in filled if group.name == table] if table else filled
    if len(named) != 1:
        there = ", ".join(f"'{group.name}'" for group in filled) or "none"
        raise LogFormatError(
            f"{file}:"
            f" {'no group ' + repr(table) if table else f'{len(filled)} groups with channels'}",
            hint=f"name one in [logs] table of the recipe; there are: {there}",
        )
    return named[0], (() if table else (Guess(f"table = '{named[0].name}' (guessed)"),))


def _to_numbers(values: NDArray[Any]) -> Array | None:
    """A channel as float64; times as seconds since the first; None for text."""
    if values.dtype.kind == "M":
        return np.asarray((values - values[0]) / np.timedelta64(1, "us"), dtype=np.float64) / 1e6
    return np.asarray(values, dtype=np.float64) if values.dtype.kind in "fiub" else None


def _waveform_increment(channel: Any) -> tuple[float, float] | None:  # noqa: ANN401 (npTDMS ships no types)
    """Offset and increment [s] of a waveform channel, None where it is none."""
    step = channel.properties.get("wf_increment")
    return (
        None if not step else (float(channel.properties.get("wf_start_offset", 0.0)), float(step))
    )


def _waveform_time(increment: tuple[float, float] | None, rows: int) -> dict[str, Array]:
    """Time [s] of a waveform's samples, none where there is no increment."""
    if increment is None:
        return {}
    return {"time_s": increment[0] + units.scaled(np.arange(rows, dtype=np.float64), increment[1])}

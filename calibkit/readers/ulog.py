"""Reader of PX4 ULog files, by pyulog.

Format: magic bytes, definitions, then messages of 2 bytes length, 1 byte type and content; each
topic has one instance a sensor. One topic is one log: [logs] table is its name, with the instance
behind a colon where that is not 0 (`sensor_gyro:1`). Columns are the topic's fields, `timestamp` in
µs (uint64). Uncertainty: fields as stored, float32 as they are, the timestamp exact to 2⁵³ µs;
dropouts of the logger are counted and noted. A file that ends inside a message is refused.
"""

import io
import struct
from collections.abc import Collection
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.readers import arrays, delimited, limited
from calibkit.readers.table import Guess, Table
from calibkit.recipe.logs import Logs

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
KINDS = frozenset(b"BFIMPQARDLCSO")
"""Types of messages that the format defines."""
DATA = ord("D")


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read one topic of a ULog file, or raise LogFormatError."""
    import pyulog

    data, sha256 = delimited.read_bytes(path, file)
    counted = _count_messages(data, file)
    with limited.refuse_damaged(file, "ULog"):
        printed = io.StringIO()
        with redirect_stdout(printed):  # pyulog prints what it finds wrong
            log = pyulog.ULog(io.BytesIO(data))
        topics, (name, _, instance) = log.data_list, logs.table.partition(":")
        if logs.table:
            topics = [
                topic
                for topic in topics
                if topic.name == name and (not instance or str(topic.multi_id) == instance)
            ]
        if len(topics) != 1:
            there = sorted(f"{topic.name}:{topic.multi_id}" for topic in log.data_list)
            fault = f"no single topic {logs.table!r}" if logs.table else f"{len(topics)} topics"
            raise LogFormatError(
                f"{file}: {fault}",
                hint=(
                    "name one in [logs] table of the recipe; there are:"
                    f" {', '.join(there[:12]) or 'none'}"
                ),
            )
        (topic,) = topics
        how = () if logs.table else (Guess(f"table = '{topic.name}' (guessed)"),)
        columns = {
            name: np.asarray(values, dtype=np.float64) for name, values in topic.data.items()
        }
        dropouts = [int(dropout.duration) for dropout in log.dropouts]
        if log.file_corruption or printed.getvalue().strip():
            fault = " ".join(printed.getvalue().split())[:100] or "it is marked as corrupt"
            raise LogFormatError(f"{file}: {fault}", hint="copy it again from the logger")
    frame = arrays.join_vectors(columns, file, required_columns)
    if counted.get(topic.msg_id) != len(frame):
        raise LogFormatError(
            f"{file}: {counted.get(topic.msg_id, 0)} messages of '{topic.name}' gave {len(frame)}"
            " rows",
            hint="the file is damaged; copy it again",
        )
    lost = (
        f"{len(dropouts)} dropout{'s' * (len(dropouts) > 1)} of the logger,"
        f" {sum(dropouts)} ms in all"
    )
    return Table(
        file,
        sha256,
        frame,
        notes=(lost,) if dropouts else (),
        reading=(f"ULog, topic '{topic.name}:{topic.multi_id}', {len(frame)} rows", *how),
        units={"timestamp": "us"},
    )


def _count_messages(data: bytes, file: str) -> dict[int, int]:
    """Message number of a topic → messages of data; refuses a file whose messages do not end where
    it ends.
    """
    if not data.startswith(MAGIC) or len(data) < HEADER_BYTES:
        raise LogFormatError(
            f"{file}: not a ULog file; it begins with {data[:8]!r}", hint="check [logs] format"
        )
    position, counted = HEADER_BYTES, dict[int, int]()
    while position + 3 <= len(data):
        size, kind = struct.unpack_from("<HB", data, position)
        if kind not in KINDS:
            raise LogFormatError(
                f"{file}: a message of unknown type {kind} at byte {position}",
                hint="the file is damaged; copy it again",
            )
        if kind == DATA and position + 5 <= len(data):
            number = int(struct.unpack_from("<H", data, position + 3)[0])
            counted[number] = counted.get(number, 0) + 1
        position += 3 + int(size)
    if position != len(data):
        raise LogFormatError(
            f"{file}: the file ends inside a message, at byte {len(data)}",
            hint="it is cut off or damaged; copy it again",
        )
    return counted

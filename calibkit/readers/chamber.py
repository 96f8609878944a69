"""Reader of recorded replies of Vötsch and Weiss chambers to `$01I` (ASCII-2 protocol of SIMPAC and
MINCON controllers).

Format: one line per reply: a time written by the recording program (any form of `times`, or
seconds), then, with or without the echo `$01I`, 12 or 14 fields of `%06.1f` between blanks
(`0023.0 -040.1`), then 16 or 32 digits 0 and 1 of digital channels, which are not kept. The fields
go in pairs of set value and actual value; the first pair is the temperature [°C], the second, in
climatic chambers, the relative humidity [%]. No header; replies come every 5 to 136 s as the
program asks. Columns: `time`, `set 1`, `actual 1`, `set 2`, …; [logs] names renames them.
Uncertainty: 0.1 in each field; what the pairs beyond the first mean, and that the set value stands
first, depends on the chamber's configuration: the recipe says which column is which.
"""

import re
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd

from calibkit.errors import LogFormatError
from calibkit.readers import damage, delimited, encoding as encodings, times
from calibkit.readers.table import FIRST_ROW, Table
from calibkit.recipe.logs import Logs

_REPLY = re.compile(
    r"(?P<time>.*?)[\s,;]*(?:\$\d\dI[\s,;]*)?"
    r"(?P<fields>(?:[+-]?\d{3,4}\.\d ){11,13}[+-]?\d{3,4}\.\d)(?: +(?P<bits>[01]{16,32}))?\s*"
)


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:  # noqa: ARG001 (the readers' shape)
    """Read recorded replies whole, or raise LogFormatError that names the line."""
    data, sha256 = delimited.read_bytes(path, file)
    content, encoding = encodings.decode(data, file, logs.text.encoding)
    torn = damage.Torn.of(file, logs)
    numbered = enumerate(torn.cut_lines(content), start=1)
    layout: tuple[int, int] | None = None

    def match(number: int, line: str) -> re.Match[str]:
        nonlocal layout
        reply = _REPLY.fullmatch(line)
        hint = damage.advise_torn(file, number)
        if reply is None or len(reply["fields"].split()) % 2:
            raise LogFormatError(
                f"{file}:{number}: found '{line[:60]}', expected a time and 12 or 14 fields as"
                " 0023.0",
                hint=hint,
            )
        # one with other numbers than the first is cut, or of another chamber
        counts = len(reply["fields"].split()), len(reply["bits"] or "")
        layout = layout or counts
        if counts != layout:
            raise LogFormatError(
                f"{file}:{number}: {counts[0]} fields and {counts[1]} digital channels, expected"
                f" {layout[0]} and {layout[1]}",
                hint=hint,
            )
        return reply

    replies = torn.parse(numbered, match)
    if layout is None:
        raise damage.no_rows(file)
    width = layout[0]
    names = ["time", *(f"{word} {k + 1}" for k in range(width // 2) for word in ("set", "actual"))]
    if logs.names and len(logs.names) != len(names):
        raise LogFormatError(
            f"{file}:1: {len(names)} columns with the time, the recipe names {len(logs.names)}",
            hint="correct [logs] names",
        )
    frame = pd.DataFrame(
        [[float(field) for field in reply["fields"].split()] for reply in replies.values()],
        columns=names[1:],
    )
    written = [reply["time"].strip() for reply in replies.values()]
    decimal_times = all(map(times.is_decimal, written))
    frame.insert(0, "time", [float(field) for field in written] if decimal_times else written)
    frame.columns = list(logs.names) or names
    lines = np.array(list(replies))
    frame.index = pd.Index(lines - FIRST_ROW)
    reading = (
        f"chamber replies of {width} fields, {encoding}, {len(frame)} rows",
        "set value before actual value (assumed)",
    )
    return Table(
        file,
        sha256,
        frame,
        tuple(torn.notes),
        reading,
        dict.fromkeys(frame.columns[1:3], "degC"),
        left_out=tuple(torn.left_out),
        numbers=lines - 1 if torn.any else None,
    )

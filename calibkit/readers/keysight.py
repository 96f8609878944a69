"""Reader of Keysight 34970A, 34972A and DAQ970A scans, as the instrument or BenchLink Data Logger
writes them.

Format: lines about the instrument and its channels (none in the instrument's own dat00001.csv),
then a header that begins with `Sweep #`, `Scan` or `Sweep` and `Time`, then one line per scan:
number, time (`01/26/2009 08:07:12:237`), and for each channel its value and its alarm (`Chan 101
(VDC),Alarm,…` or `101 (C),Alarm 101,…`). UTF-8, UTF-16 or a Windows code page; commas, semicolons
or tabs. A log is split after 65,535 scans ([logs] split), the scan number going on. Uncertainty:
times to 1 ms, of the start of a scan: channels are read one after another within it. 9.9E+37 is an
overload, an alarm other than 0 a limit that was passed; both are counted and noted. Day and month
can be either way round (the instrument writes month first, BenchLink what Windows is set to): the
order that runs forwards is taken, or the recipe's time_format.
"""

import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.readers import delimited, encoding as encodings, sniff, text, tokens
from calibkit.readers.table import FIRST_ROW, Table
from calibkit.recipe.logs import Logs
from calibkit.records.frame import values

SCAN_NUMBERS = ("sweep #", "sweep", "scan", "scan #", "scan number")
"""Names of the column that counts scans, in lower case."""
_MOST_LINES = 400
_CLOCK = re.compile(r"\d:\d\d:\d\d")


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read a scan log whole, or raise LogFormatError that names the line."""
    data, sha256 = delimited.read_bytes(path, file)
    content, encoding = encodings.decode(data, file, logs.text.encoding)
    line, delimiter = _find_header(content, file)
    spec = logs.text.model_copy(
        update={"skip_lines": line, "header_lines": 1, "delimiter": delimiter}
    )
    dialect = sniff.Dialect.recognise(content, encoding, file, spec, ())
    scan = dialect.names[0]
    alarms = [name for name in dialect.names if name.lower().startswith("alarm")]
    table = text.parse_text(
        content,
        sha256,
        file,
        dialect,
        logs,
        {*required_columns, scan, *alarms},
    )
    names, notes = list(table.frame.columns), list(table.notes)
    lines = table.frame.index + FIRST_ROW
    for alarm in alarms:
        raised = np.flatnonzero(np.nan_to_num(values(table.frame, alarm)) != 0.0)
        if raised.size:
            channel = names[names.index(alarm) - 1]
            notes.append(
                f"column '{channel}': alarm in {raised.size} scans, the first in line"
                f" {lines[raised[0]]}"
            )
    number = values(table.frame, scan)
    jumps = np.flatnonzero(np.diff(number) != 1.0)
    if jumps.size:
        row = int(jumps[0])
        notes.append(
            f"scan numbers jump at {jumps.size} places, the first from {number[row]:g} to"
            f" {number[row + 1]:g} in line {lines[row + 1]}"
        )
    return replace(table, notes=tuple(notes))


def _find_header(content: str, file: str) -> tuple[int, str]:
    """Lines above the header, and the delimiter."""
    lines = content.split("\n", _MOST_LINES)[:_MOST_LINES]
    for number, line in enumerate(lines):
        for delimiter in (",", ";", "\t"):
            fields = tokens.split_line(line, delimiter)
            if (
                len(fields) > 2
                and fields[0].lower() in SCAN_NUMBERS
                and fields[1].lower().startswith("time")
            ):
                for above, earlier in enumerate(lines[:number], start=1):
                    # it would pass for a line about the instrument and be lost
                    start = tokens.split_line(earlier, delimiter)
                    if len(start) > 2 and start[0].isdigit() and _CLOCK.search(start[1]):
                        raise LogFormatError(
                            f"{file}:{above}: a scan stands above the header",
                            hint=(
                                "the lines are not in the order of the instrument; export the log"
                                " again"
                            ),
                        )
                return number, delimiter
    raise LogFormatError(
        f"{file}: no header 'Sweep #, Time, …' or 'Scan, Time, …' in the first {_MOST_LINES} lines",
        hint="the log is not a scan of this instrument; try format = 'text'",
    )

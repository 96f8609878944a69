"""Reader of LabVIEW measurement files (.lvm).

Format: text; a file header of `key<separator>value` lines from `LabVIEW Measurement` to
`***End_of_Header***` (Separator, Decimal_Separator, X_Columns, Time_Pref, Date, Time), then one or
more segments: a header (Channels, Samples, Y_Unit_Label, X0, Delta_X) to `***End_of_Header***`, a
line of names (`X_Value`, one name per channel, `Comment`), and one line per sample. With X_Columns
`No` the first field is empty and the time is X0 + k·Delta_X; with `Multi` every channel has its own
X column, which must agree. The time column is called `X_Value` [s]. Segments follow each other
where their channels are the same; with Multi_Headings `No` packets of as many samples follow each
other below one header, and then X values are needed. Uncertainty: X_Value to the digits written; a
computed time is the float64 nearest to X0 + k·Delta_X.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from calibkit import units
from calibkit.errors import LogFormatError
from calibkit.numeric.arrays import Array, Integers
from calibkit.readers import damage, delimited, encoding as encodings, tokens
from calibkit.readers.table import FIRST_ROW, Table
from calibkit.recipe.logs import Logs

_END = "***End_of_Header***"
_TIME = "X_Value"


@dataclass(frozen=True, slots=True)
class _Segment:
    """Names, units and rows of one segment; `lines` are the lines of the file that the rows [n, k]
    stand in, `numbers` those of the rows among the `written` ones, from 0, torn ones counted.
    """

    names: tuple[str, ...]
    units: dict[str, str]
    lines: Integers
    rows: Array
    numbers: Integers
    written: int


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:  # noqa: ARG001 (every column holds numbers)
    """Read a measurement file whole, or raise LogFormatError that names line and column."""
    data, sha256 = delimited.read_bytes(path, file)
    content, encoding = encodings.decode(data, file, logs.text.encoding)
    torn = damage.Torn.of(file, logs)
    lines = torn.cut_lines(content)
    if not lines[0].startswith("LabVIEW Measurement"):
        raise LogFormatError(f"{file}:1: no 'LabVIEW Measurement'", hint="the log is no .lvm file")
    separator = {"comma": ","}.get(_read_key(lines, "Separator", "Tab").lower(), "\t")
    decimal = _read_key(lines, "Decimal_Separator", ".")
    if decimal not in tokens.NUMBER:
        raise LogFormatError(
            f"{file}: Decimal_Separator is '{decimal[:20]}', expected '.' or ','",
            hint="the file is damaged; copy it again",
        )
    segments = _read_segments(lines, separator, decimal, torn)
    first = segments[0]
    frame = pd.DataFrame(
        np.vstack([segment.rows for segment in segments]), columns=list(first.names)
    )
    frame.index = pd.Index(np.concatenate([segment.lines for segment in segments]) - FIRST_ROW)
    # numbers of the rows among those of the file, torn ones counted
    before = np.cumsum([0, *(segment.written for segment in segments[:-1])])
    numbers = [segment.numbers + n for segment, n in zip(segments, before, strict=True)]
    if (
        not (content.endswith("\n") or logs.text.footer_lines or logs.text.last_line == "drop")
        and len(lines[-1].split(separator)) <= frame.shape[1]
    ):
        raise LogFormatError(  # it may be cut in its last number
            f"{file}:{len(lines)}: the last line has no end",
            hint='the file is cut off; copy it again, or set last_line = "drop" in [logs.text]',
        )
    how = f"LabVIEW measurement file, {encoding}, {len(segments)} segments, {len(frame)} rows"
    return Table(
        file,
        sha256,
        frame,
        tuple(torn.notes),
        (how,),
        first.units,
        left_out=tuple(torn.left_out),
        numbers=np.concatenate(numbers) if torn.any else None,
    )


def _read_key(lines: Sequence[str], key: str, default: str) -> str:
    """Value of a key of the file's header."""
    for line in lines:
        if line.startswith(_END):
            break
        if line.startswith(key) and len(line) > len(key) and line[len(key)] in "\t,":
            return line[len(key) + 1 :].split("\t")[0].strip() or default
    return default


def _read_segments(
    lines: Sequence[str], separator: str, decimal: str, torn: damage.Torn
) -> list[_Segment]:
    """Segments of a file in order."""
    file = torn.file
    ends = [number for number, line in enumerate(lines) if line.startswith(_END)]
    if len(ends) < 2:
        raise LogFormatError(
            f"{file}: {len(ends)} × '{_END}', expected two or more", hint="the file is cut off"
        )
    segments = []
    for k, end in enumerate(ends[1:]):
        start = ends[k] + 1
        if k > 0:  # the header of a later segment begins behind the rows of the one before
            start = next((n for n in range(ends[k], end) if lines[n].startswith("Channels")), end)
        stop = len(lines)
        if k + 2 < len(ends):
            stop = next(
                (n for n in range(end, ends[k + 2]) if lines[n].startswith("Channels")), ends[k + 2]
            )
        segments.append(_read_segment(lines, start, end, stop, separator, decimal, torn))
    for segment in segments[1:]:
        if segment.names != segments[0].names:
            raise LogFormatError(
                f"{torn.file}:{segment.lines[0] - 1}: a segment of other channels:"
                f" {', '.join(segment.names[1:])}",
                hint="save segments of different channels in files of their own",
            )
    return segments


def _read_segment(
    lines: Sequence[str],
    start: int,
    end: int,
    stop: int,
    separator: str,
    decimal: str,
    torn: damage.Torn,
) -> _Segment:
    """One segment: header lines start … end − 1, names at end + 1, rows to stop − 1."""
    file = torn.file
    header = {
        line.split(separator)[0]: line.split(separator)[1:]
        for line in lines[start:end]
        if line.strip()
    }
    if end + 1 >= stop:
        raise LogFormatError(
            f"{file}:{end + 1}: no names below '{_END}'", hint="the file is cut off"
        )
    names = [name.strip() for name in lines[end + 1].split(separator)]
    while names and names[-1] in {"", "Comment"}:
        names.pop()
    if len(names) < 2 or names[0] != _TIME:
        raise LogFormatError(
            f"{file}:{end + 2}: found '{lines[end + 1][:40]}', expected '{_TIME}' and channels"
        )
    written = {n + 1: lines[n] for n in range(end + 2, stop) if lines[n].strip()}
    parsed = torn.parse(
        written.items(), lambda n, line: _parse_row(line, names, separator, decimal, n, file)
    )
    if not parsed:
        raise LogFormatError(
            f"{file}:{end + 2}: names but no rows", hint="remove the segment or copy the file again"
        )
    last = list(written)[-1]
    if not (torn.cut and stop == len(lines)):  # more rows were still to come
        packets = _read_key(lines, "Multi_Headings", "Yes").lower() == "no"
        count, samples = len(written), _stated_samples(header, 0)
        # packets of so many rows follow each other
        if samples and (count % samples if packets else count - samples):
            raise LogFormatError(
                f"{file}:{last}: {count} rows, the segment's header says {samples} samples",
                hint="the file is cut off or was written on; copy it again",
            )
    channels = [name for name in names if name != _TIME]
    channel_units = {}
    for name, label in zip(channels, header.get("Y_Unit_Label", []), strict=False):
        unit = units.as_stated(label)
        if unit:
            channel_units[name] = unit
    line_numbers = np.array(list(parsed), dtype=np.int64)
    numbers = np.searchsorted(np.array(list(written)), line_numbers)
    rows = np.array(list(parsed.values()))
    timed, names = _join_times(rows, names, header, file, int(line_numbers[0]), numbers)
    return _Segment(
        tuple(names), {_TIME: "s", **channel_units}, line_numbers, timed, numbers, len(written)
    )


def _parse_row(
    line: str, names: Sequence[str], separator: str, decimal: str, number: int, file: str
) -> list[float]:
    """Numbers of a line; a comment may stand behind them."""
    fields = line.split(separator)
    if len(fields) < len(names) or len(fields) > len(names) + 1:
        raise LogFormatError(
            f"{file}:{number}: {len(fields)} fields, expected {len(names)} and a comment",
            hint=damage.advise_torn(file, number),
        )
    numbers = []
    for name, field in zip(names, fields, strict=False):
        text = field.strip()
        if not text or tokens.is_sentinel(text):
            numbers.append(np.nan)
        elif tokens.NUMBER[decimal].fullmatch(text):
            numbers.append(float(text.replace(decimal, ".").replace(" ", "")))
        else:
            raise LogFormatError(
                f"{file}:{number}: column '{name}': found '{text[:40]}', expected a number",
                hint=damage.advise_torn(file, number),
            )
    return numbers


def _stated_samples(header: Mapping[str, Sequence[str]], default: int) -> int:
    """Largest number of samples that a segment's header states, or the default."""
    entries = header.get("Samples", [])
    return max((int(entry) for entry in entries if entry.strip().isdigit()), default=default)


def _join_times(
    rows: Array,
    names: Sequence[str],
    header: dict[str, list[str]],
    file: str,
    line: int,
    numbers: Integers,
) -> tuple[Array, list[str]]:
    """Rows with one time column in front: written, computed from X0 and Delta_X by the numbers of
    the rows, or one of several that agree.
    """
    time_columns = [k for k, name in enumerate(names) if name == _TIME]
    for k in time_columns[1:]:
        if not np.array_equal(rows[:, k], rows[:, 0], equal_nan=True):
            raise LogFormatError(
                f"{file}:{line}: channels with times of their own",
                hint="save them with one X column",
            )
    keep = [k for k in range(len(names)) if k not in time_columns]
    time = rows[:, 0]
    if np.isnan(time).all():
        stated: dict[str, set[float]] = {}
        for key in ("X0", "Delta_X"):
            fields = header.get(key, [])
            try:
                stated[key] = {float(field.replace(",", ".")) for field in fields if field.strip()}
            except ValueError:
                raise LogFormatError(
                    f"{file}:{line}: {key} in the header above: found '{' '.join(fields)[:60]}',"
                    " expected numbers",
                    hint="the file is damaged; copy it again",
                ) from None
        samples = _stated_samples(header, int(numbers[-1]) + 1)
        if any(len(values) != 1 for values in stated.values()) or numbers[-1] >= samples:
            raise LogFormatError(
                f"{file}:{line}: no X column, and no single X0 and Delta_X for all rows",
                hint="save with an X column",
            )
        (start,), (step,) = stated.values()
        time = start + units.scaled(numbers.astype(np.float64), step)
    return np.column_stack([time, rows[:, keep]]), [_TIME, *(names[k] for k in keep)]

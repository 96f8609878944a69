"""The logs of a folder, grouped by how they are written and what they hold."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import takewhile
from pathlib import Path
from typing import TypeAlias

from calibkit import units
from calibkit.errors import (
    FrameError,
    LogFormatError,
    NamelessColumnsError,
    SeveralTablesError,
    UsageError,
)
from calibkit.logs import column_names, nameless
from calibkit.logs.column_names import LogColumn
from calibkit.logs.glimpse import Glimpse
from calibkit.readers import registry, sniff, times
from calibkit.readers.arrays import SIDE_BY_SIDE
from calibkit.recipe.logs import ARRAYS, FORMATS, Logs, TextSpec

_SKIPPED = re.compile(
    r"\.(json|md|toml|pdf|png|py|txt\.gz|zip|log\.gz)$|^(SHA256SUMS|LICENSE|README|SOURCE)",
    re.IGNORECASE,
)
"""Names of files that are no logs."""
_Mend: TypeAlias = dict[str, str | int | list[int]]
"""Keys of [logs.text]."""
_MENDS: tuple[_Mend, ...] = (
    {},
    {"last_line": "drop"},
    *(dict[str, str | int | list[int]](footer_lines=count) for count in range(1, 6)),
    {"torn_lines": "drop"},
    {"torn_lines": "drop", "last_line": "drop"},
)
"""What [logs.text] can say of lines that are no rows, the least first: nothing, where all are."""
LARGEST = 50_000_000
"""Bytes up to which a log is read whole before a recipe is proposed for it."""
_OF_ONE = ("skip_lines", "footer_lines", "last_line", "torn_lines")
"""Keys of [logs.text] that differ from log to log."""
_MENDED = ("last_line", "torn_lines")
"""Those of which one log asks for all."""
_MAGNETIC = re.compile(r"(^|[/_ ])mag(net|$|[/_ ])|compass")
"""Names of tables of a magnetometer."""
_TEMPERATURES = frozenset({"temp_case_degc", "temp_env_degc", "temp_degc"})


@dataclass(frozen=True, slots=True)
class _GroupLayout:
    """How a log is written: format, columns, keys of [logs.text] for its dialect, sheet or table,
    tables that follow each other, and the names that were made for columns without any.
    """

    format: str
    columns: tuple[LogColumn, ...]
    text: Mapping[str, str | int | list[int]]
    table: str = ""
    tables: tuple[str, ...] = ()
    names: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """What logs of one group share: all but the number of lines above the header."""
        text = {key: value for key, value in self.text.items() if key not in _OF_ONE}
        return repr(replace(self, text=text))


@dataclass(frozen=True, slots=True)
class Group:
    """Logs of one layout: their files, how they are written, and what their numbers show."""

    files: tuple[str, ...]
    layout: _GroupLayout
    glimpse: Glimpse

    @property
    def columns(self) -> tuple[LogColumn, ...]:
        """Columns of the logs."""
        return self.layout.columns

    @property
    def meant(self) -> set[str]:
        """Canonical columns that the columns could be."""
        return {column.guess_canonical() for column in self.columns}

    @property
    def second_logger(self) -> bool:
        """Whether the logs hold temperatures over time and nothing else that is known, as those of
        a chamber's logger do.
        """
        logger_columns = {"", "time_s", *_TEMPERATURES}
        return (
            "time_s" in self.meant
            and bool(self.meant & _TEMPERATURES)
            and self.meant <= logger_columns
        )

    def joined_by(self, file: str, layout: _GroupLayout, glimpse: Glimpse | None) -> "Group":
        """The group with one more log of its layout."""
        earlier, later = self.layout.text, layout.text
        common_text = {
            key: value
            for text, other in ((earlier, later), (later, earlier))
            for key, value in text.items()
            if key in _MENDED or other.get(key) == value
        }
        glimpses = self.glimpse if glimpse is None else self.glimpse.joined_by(glimpse)
        return Group((*self.files, file), replace(layout, text=common_text), glimpses)


def group_logs(folder: Path, sheet: str = "") -> list[Group]:
    """Group the logs of a folder by their layout; files that are no logs are left out. `sheet` is
    that of workbooks; without it each sheet is a layout of its own.

    Raises UsageError for a folder that is not there, FrameError or LogFormatError for one without a
    log.
    """
    if not folder.is_dir():
        raise UsageError(
            f"--from {folder}: no such folder", hint="name the folder that holds the logs"
        )
    groups: dict[str, Group] = {}
    failed: LogFormatError | None = None
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    logs = [path for path in files if not _SKIPPED.search(path.name)]
    for path in logs or [path for path in files if path.suffix == ".json"]:
        try:
            layouts = _read_layouts(path, sheet)
        except LogFormatError as error:
            failed = failed or error
            continue
        for layout, glimpse in layouts:
            before = groups.get(layout.key, Group((), layout, Glimpse({}, {}, logs=0)))
            groups[layout.key] = before.joined_by(path.name, layout, glimpse)
    if not groups:
        raise failed or FrameError(f"{folder}: no logs", hint="name the folder that holds the logs")
    return list(groups.values())


_Described: TypeAlias = tuple[_GroupLayout, Glimpse | None]
"""How a log is written, and what its numbers show; None where they cannot be read."""


def _read_layouts(path: Path, sheet: str) -> list[_Described]:
    """Layouts of a log, one for each sheet of a workbook or table that can be read: by the format
    that it shows, else as text, else by a plugin.
    """
    with path.open("rb") as stream:
        head = stream.read(4096)
    format_name = registry.recognise_format(head)
    if format_name in (*ARRAYS, "excel"):
        return _layouts_of_tables(path, format_name, sheet if format_name == "excel" else "")
    try:
        described = _read_layout(path, Logs(files=("*",), format=format_name or "text"))
    except LogFormatError:
        plugin = "" if format_name else registry.recognise_plugin(head)
        if not plugin:
            raise
    else:
        plugin = registry.recognise_plugin(head) if described[0].names else ""
        if not plugin:
            return [described]
    return [_read_layout(path, Logs(files=("*",), format=plugin))]


def _layouts_of_tables(path: Path, name: str, sheet: str) -> list[_Described]:
    """Layout of the named sheet, or of the only table of a file; of several, of all side by side
    where they have one clock, of all behind each other where matrices are alike, else of each.
    """
    logs = Logs(files=("*",), format=name, table=sheet)
    try:
        return [_read_layout(path, logs)]
    except SeveralTablesError as error:
        tables = error.tables
    if name in ARRAYS:
        with suppress(LogFormatError):
            joint = _read_layout(path, logs.model_copy(update={"table": SIDE_BY_SIDE}))
            if any(column.guess_canonical() == "time_s" for column in joint[0].columns):
                return [joint]
    described, failed = [], None
    for table in tables:
        try:
            described.append(_read_layout(path, logs.model_copy(update={"table": table})))
        except LogFormatError as error:
            failed = failed or error
    if not described and failed is not None:
        raise failed
    layouts = [layout for layout, _ in described]
    first = layouts[0]
    if name in ARRAYS and first.names and "time_s" not in first.names and failed is None:
        has_sensor_names = any(not heading.startswith("column ") for heading in first.names)
        if has_sensor_names and all(
            replace(layout, table=first.table) == first for layout in layouts
        ):
            return [(replace(first, table="", tables=tables), described[0][1])]
    return described


def _read_layout(path: Path, logs: Logs) -> _Described:
    """Layout of a log, with what [logs.text] must say of lines that are no rows for it to be read.
    A log that nothing mends, or that is too large to be read for a guess, has the layout of its
    head; clean CSV has format "csv" and no dialect to state.
    """
    failed: LogFormatError | None = None
    head: _GroupLayout | None = None
    is_text = logs.format in FORMATS and "text" in FORMATS[logs.format].keys
    for mend in _MENDS if is_text else _MENDS[:1]:
        mended = logs.model_copy(update={"text": TextSpec.model_validate(mend)})
        try:
            layout, named = _describe_named(path, mended, mend)
            head = head or layout
            if path.stat().st_size > LARGEST:
                return layout, Glimpse({}, {})
            numeric = [column.name for column in layout.columns if column.kind == "number"]
            frame = registry.read(path, path.name, named, numeric).frame
        except LogFormatError as error:
            failed = failed or error
        else:
            return layout, Glimpse.of(frame[[name for name in numeric if name in frame]])
    if head is None:
        assert failed is not None  # noqa: S101 (nothing was read)
        raise failed
    return head, None


def _describe_named(path: Path, logs: Logs, mend: _Mend) -> tuple[_GroupLayout, Logs]:
    """Layout of a log, and the recipe's table on it; columns without names get some by their
    numbers.
    """
    try:
        return _describe(path, logs, mend), logs
    except NamelessColumnsError as error:
        numbered = tuple(f"column {k + 1}" for k in range(error.columns))
    named = logs.model_copy(update={"names": numbered})
    kinds = [column.kind for column in _describe(path, named, mend).columns]
    numeric = [name for name, kind in zip(numbered, kinds, strict=True) if kind == "number"]
    frame = registry.read(path, path.name, named, numeric).frame
    numbers = [frame[name].to_numpy() if name in numeric else None for name in numbered]
    names = nameless.name_columns(numbers, timed="time" in kinds)
    if "time" in kinds and "time_s" not in names:
        names[kinds.index("time")] = "time_s"
    # the field of a magnetometer that is turned lies on a sphere too, but not of gravity
    magnetic = _MAGNETIC.search(logs.table.lower())
    named = logs.model_copy(update={"names": numbered if magnetic else tuple(names)})
    return _describe(path, named, mend), named


def _describe(path: Path, logs: Logs, mend: _Mend) -> _GroupLayout:
    """Layout of a log by the head of a text, or by the whole table of another format."""
    columns, text = [], mend
    if logs.format == "text":
        dialect = sniff.Dialect.guess(path, path.name, logs.text, logs.names)
        for sniffed in dialect.columns:
            is_time, form = sniffed.kind == "time", sniffed.time_format
            columns.append(LogColumn(sniffed.name, sniffed.unit, is_time, form, sniffed.kind))
        is_clean = dialect.clean and not logs.names and not mend
        text = {} if is_clean else dialect.recipe_keys() | mend
    else:
        is_clean = False
        table = registry.read(path, path.name, logs, ())
        for name in map(str, table.frame.columns):
            fields = list(map(str, table.frame[name].iloc[:50]))
            is_number = all(field == "nan" or times.is_decimal(field) for field in fields)
            form = "" if is_number else times.recognise_format(fields)
            kind = "number" if is_number else "time" if form else "text"
            unit = units.parse_unit(table.units.get(name, ""))
            columns.append(LogColumn(name, unit, bool(form), form, kind))
    named_columns = tuple(column_names.name_sensor(f"{path.stem} {logs.table}", columns))
    form = "csv" if is_clean else logs.format
    return _GroupLayout(form, named_columns, text, logs.table, names=logs.names)


def file_patterns(files: Sequence[str], names: Sequence[str]) -> list[str]:
    """One pattern that matches these files and none of the other names, else the files' names."""
    if len(files) == 1:
        return [files[0]]
    start = _common_beginning(files)
    end = _common_beginning([name[::-1] for name in files])[::-1]
    pattern = f"{start.rstrip('0123456789')}*{end.lstrip('0123456789')}"
    matches = {name for name in names if fnmatchcase(name, pattern)}
    return [pattern] if matches == set(files) and "[" not in pattern else list(files)


def _common_beginning(names: Sequence[str]) -> str:
    """Longest beginning that all names share."""
    common_letters = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in common_letters)

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
from calibkit.readers import registry, sniff, times
from calibkit.readers.arrays import SIDE_BY_SIDE
from calibkit.readers.table import Table
from calibkit.recipe.logs import ARRAYS, FORMATS, Logs, TextSpec

_SKIPPED = re.compile(
    r"\.(json|md|toml|pdf|png|py|txt\.gz|zip|log\.gz)$|^(SHA256SUMS|LICENSE|README|SOURCE)",
    re.IGNORECASE,
)
"""Names of files that are no logs."""
_Mend: TypeAlias = dict[str, str | int | list[int]]
"""Keys of [logs.text]."""
_MENDS: tuple[_Mend, ...] = (
    {"last_line": "drop"},
    *(dict[str, str | int | list[int]](footer_lines=count) for count in range(1, 6)),
    {"torn_lines": "drop"},
    {"torn_lines": "drop", "last_line": "drop"},
)
"""What [logs.text] can say of lines that are no rows, the least first."""
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
    columns: tuple[column_names.LogColumn, ...]
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
    """Logs of one layout: their files, and how they are written."""

    files: tuple[str, ...]
    layout: _GroupLayout

    @property
    def columns(self) -> tuple[column_names.LogColumn, ...]:
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

    def logs(self) -> Logs:
        """The recipe's table on these logs."""
        form = "text" if self.layout.format == "csv" else self.layout.format
        text = TextSpec.model_validate(self.layout.text) if self.layout.text else TextSpec()
        return Logs(
            files=self.files,
            format=form,
            names=self.layout.names,
            table=self.layout.table,
            tables=self.layout.tables,
            text=text,
        )


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
        for layout in layouts:
            before = groups.get(layout.key, Group((), layout))
            earlier, later = before.layout.text, layout.text
            common_text: dict[str, str | int | list[int]] = {}
            for text, other in ((earlier, later), (later, earlier)):
                common_text |= {
                    key: value
                    for key, value in text.items()
                    if key in _MENDED or other.get(key) == value
                }
            groups[layout.key] = Group(
                (*before.files, path.name), replace(layout, text=common_text)
            )
    if not groups:
        raise failed or FrameError(f"{folder}: no logs", hint="name the folder that holds the logs")
    return list(groups.values())


def _read_layouts(path: Path, sheet: str) -> list[_GroupLayout]:
    """Layouts of a log, one for each sheet of a workbook or table that can be read: by the format
    that it shows, else as text, else by a plugin.
    """
    with path.open("rb") as stream:
        head = stream.read(4096)
    format_name = registry.recognise_format(head)
    if format_name == "excel":
        return _layouts_of_sheets(path, sheet)
    if format_name in ARRAYS:
        return _layouts_of_tables(path, format_name)
    try:
        layout = (
            _layout_of_format(path, Logs(files=("*",), format=format_name)) if format_name else None
        )
        layout = layout or _layout_of_text(path)
    except LogFormatError:
        plugin = "" if format_name else registry.recognise_plugin(head)
        if not plugin:
            raise
    else:
        plugin = registry.recognise_plugin(head) if layout.names else ""
        if not plugin:
            return [layout]
    return [_layout_of_format(path, Logs(files=("*",), format=plugin))]


def _layouts_of_sheets(path: Path, sheet: str) -> list[_GroupLayout]:
    """Layout of the named sheet, or of each sheet with a table."""
    from calibkit.readers import excel

    sheets = excel.list_sheets(path, path.name)
    layouts, failed = [], None
    for name in [sheet] if sheet or len(sheets) < 2 else sheets:
        try:
            layouts.append(_layout_of_format(path, Logs(files=("*",), format="excel", table=name)))
        except LogFormatError as error:
            failed = failed or error
    if not layouts and failed is not None:
        raise failed
    return layouts


def _layouts_of_tables(path: Path, name: str) -> list[_GroupLayout]:
    """Layout of the only table of named arrays; of several, of all side by side where they have one
    clock, of all behind each other where matrices are alike, else of each.
    """
    try:
        return [_layout_of_format(path, Logs(files=("*",), format=name))]
    except SeveralTablesError as error:
        tables = error.tables
    with suppress(LogFormatError):
        side_by_side = _layout_of_format(path, Logs(files=("*",), format=name, table=SIDE_BY_SIDE))
        if any(column.guess_canonical() == "time_s" for column in side_by_side.columns):
            return [side_by_side]
    layouts = []
    for table in tables:
        with suppress(LogFormatError):
            logs = Logs(files=("*",), format=name, table=table)
            layouts.append(_layout_of_format(path, logs))
    first = layouts[0] if layouts else None
    if first and first.names and "time_s" not in first.names and len(layouts) == len(tables):
        has_sensor_names = any(not heading.startswith("column ") for heading in first.names)
        if has_sensor_names and all(
            replace(layout, table=first.table) == first for layout in layouts
        ):
            return [replace(first, table="", tables=tables)]
    return layouts


def _layout_of_format(path: Path, logs: Logs) -> _GroupLayout:
    """Layout of a log in a format that its reader reads whole; columns without names get some. A
    footer is left out.
    """
    names: tuple[str, ...] = ()
    try:
        table, text = _read_whole(path, logs, ())
    except NamelessColumnsError as error:
        numbered = tuple(f"column {k + 1}" for k in range(error.columns))
        frame = _read_whole(path, logs.model_copy(update={"names": numbered}), ())[0].frame
        magnetic = _MAGNETIC.search(logs.table.lower())  # on a sphere too, but not of gravity
        arrays = [frame[name].to_numpy() for name in numbered]
        names = numbered if magnetic else tuple(nameless.name_columns(arrays))
        table, text = _read_whole(path, logs.model_copy(update={"names": names}), ())
    columns = []
    for column in map(str, table.frame.columns):
        fields = list(map(str, table.frame[column].iloc[:50]))
        numbers = all(field == "nan" or times.is_decimal(field) for field in fields)
        form = "" if numbers else times.recognise_format(fields)
        kind = "number" if numbers else "time" if form else "text"
        unit = units.parse_unit(table.units.get(column, ""))
        columns.append(column_names.LogColumn(column, unit, bool(form), form, kind))
    if "text" in FORMATS[logs.format].keys if logs.format in FORMATS else False:
        numeric = [column.name for column in columns if column.kind == "number"]
        with suppress(LogFormatError):
            text = _read_whole(path, logs, numeric)[1]
    sensor_columns = tuple(column_names.name_sensor(f"{path.stem} {logs.table}", columns))
    return _GroupLayout(logs.format, sensor_columns, text, logs.table, names=names)


def _read_whole(path: Path, logs: Logs, required_columns: Sequence[str]) -> tuple[Table, _Mend]:
    """A log, and what [logs.text] must say for it to be read: a footer, torn lines, or a last line
    that was still being written are left out.
    """
    try:
        return registry.read(path, path.name, logs, required_columns), {}
    except NamelessColumnsError:
        raise
    except LogFormatError as error:
        failed = error
    if logs.format not in FORMATS or "text" not in FORMATS[logs.format].keys:
        raise failed
    for mend in _MENDS:
        mended = logs.model_copy(update={"text": TextSpec.model_validate(mend)})
        with suppress(LogFormatError):
            return registry.read(path, path.name, mended, required_columns), mend
    raise failed


def _layout_of_text(path: Path) -> _GroupLayout:
    """Layout of a text log, with what mends it; clean CSV has format "csv" and no dialect to
    state. A log that nothing mends has the layout of its head.
    """
    failed: LogFormatError | None = None
    head: _GroupLayout | None = None
    for mend in ({}, *_MENDS):
        logs = Logs(files=("*",), format="text", text=TextSpec.model_validate(mend))
        try:
            layout, logs = _guess_text(path, logs, mend)
            head = head or layout
            if path.stat().st_size <= LARGEST:
                registry.read(path, path.name, logs, _numeric(layout))
        except LogFormatError as error:
            failed = failed or error
        else:
            return layout
    if head is not None:
        return head
    assert failed is not None  # noqa: S101 (nothing was read)
    raise failed


def _guess_text(path: Path, logs: Logs, mend: _Mend) -> tuple[_GroupLayout, Logs]:
    """Layout of a text log that is mended, and the recipe's table on it."""
    names: tuple[str, ...] = ()
    try:
        dialect = sniff.Dialect.guess(path, path.name, logs.text)
    except NamelessColumnsError as error:
        names = _guess_names(path, error.columns, logs)
        dialect = sniff.Dialect.guess(path, path.name, logs.text, names)
    columns = column_names.name_sensor(
        path.stem,
        [
            column_names.LogColumn(
                column.name, column.unit, column.kind == "time", column.time_format, column.kind
            )
            for column in dialect.columns
        ],
    )
    logs = logs.model_copy(update={"names": names})
    if dialect.clean and not names and not mend:
        return _GroupLayout("csv", tuple(columns), {}), logs
    text = dialect.recipe_keys() | mend
    return _GroupLayout("text", tuple(columns), text, names=names), logs


def _numeric(layout: _GroupLayout) -> list[str]:
    """Names of the columns of a text log that hold numbers."""
    return [column.name for column in layout.columns if column.kind == "number"]


def _guess_names(path: Path, columns: int, logs: Logs) -> tuple[str, ...]:
    """Names for the columns of a log without any, from its first rows."""
    numbered = tuple(f"column {k + 1}" for k in range(columns))
    dialect = sniff.Dialect.guess(path, path.name, logs.text, numbered)
    kinds = [column.kind for column in dialect.columns]
    number_columns = [name for name, kind in zip(numbered, kinds, strict=True) if kind == "number"]
    numbered_logs = logs.model_copy(update={"names": numbered})
    frame = registry.read(path, path.name, numbered_logs, number_columns).frame
    numbers = [frame[name].to_numpy() if name in number_columns else None for name in numbered]
    names = nameless.name_columns(numbers, timed="time" in kinds)
    for k, kind in enumerate(kinds):
        if kind == "time" and "time_s" not in names:
            names[k] = "time_s"
    return tuple(names)


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

"""The logs of a folder, grouped by how they are written and what they hold."""

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import takewhile
from pathlib import Path

from calibkit import units
from calibkit.errors import FrameError, LogFormatError, NamelessColumnsError, UsageError
from calibkit.ingest import column_names, nameless
from calibkit.readers import registry, sniff, times
from calibkit.recipe.logs import Logs

_SKIPPED = re.compile(
    r"\.(json|md|toml|pdf|png|py|txt\.gz|zip|log\.gz)$|^(SHA256SUMS|LICENSE|README|SOURCE)",
    re.IGNORECASE,
)
"""Names of files that are no logs."""
_TEMPERATURES = frozenset({"temp_case_degc", "temp_env_degc", "temp_degc"})


@dataclass(frozen=True, slots=True)
class _Layout:
    """How a log is written: format, columns, keys of [logs.text] for its dialect, sheet of a
    workbook, and the names that were made for columns without any.
    """

    format: str
    columns: tuple[column_names.LogColumn, ...]
    text: Mapping[str, str | int | list[int]]
    table: str = ""
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Group:
    """Logs of one layout: their files, format, columns, keys of [logs.text] for their dialect,
    sheet of a workbook, and the names that were made for columns without any.
    """

    files: tuple[str, ...]
    format: str
    columns: tuple[column_names.LogColumn, ...]
    text: Mapping[str, str | int | list[int]]
    table: str = ""
    names: tuple[str, ...] = ()

    @property
    def second_logger(self) -> bool:
        """Whether the logs hold temperatures over time and nothing else that is known, as those of
        a chamber's logger do.
        """
        meant = {column.guess_canonical() for column in self.columns}
        known = {"", "time_s", *_TEMPERATURES}
        return "time_s" in meant and bool(meant & _TEMPERATURES) and meant <= known


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
            key = repr(layout)
            before = groups[key].files if key in groups else ()
            fields = (getattr(layout, field.name) for field in dataclasses.fields(layout))
            groups[key] = Group((*before, path.name), *fields)
    if not groups:
        raise failed or FrameError(f"{folder}: no logs", hint="name the folder that holds the logs")
    return list(groups.values())


def _read_layouts(path: Path, sheet: str) -> list[_Layout]:
    """Layouts of a log, one for each sheet of a workbook that can be read: by the format that it
    shows, else as text, else by a plugin.
    """
    with path.open("rb") as stream:
        head = stream.read(4096)
    found = registry.recognise_format(head)
    if found == "excel":
        return _layouts_of_sheets(path, sheet)
    try:
        layout = _layout_of_format(path, found) if found else _layout_of_text(path)
    except LogFormatError:
        plugin = "" if found else registry.recognise_plugin(head)
        if not plugin:
            raise
    else:
        plugin = registry.recognise_plugin(head) if layout.names else ""
        if not plugin:
            return [layout]
    return [_layout_of_format(path, plugin)]


def _layouts_of_sheets(path: Path, sheet: str) -> list[_Layout]:
    """Layout of the named sheet, or of each sheet with a table."""
    from calibkit.readers import excel

    sheets = excel.list_sheets(path, path.name)
    if sheet or len(sheets) < 2:
        return [_layout_of_format(path, "excel", sheet)]
    layouts, failed = [], None
    for name in sheets:
        try:
            layouts.append(_layout_of_format(path, "excel", name))
        except LogFormatError as error:
            failed = failed or error
    if not layouts and failed is not None:
        raise failed
    return layouts


def _layout_of_format(path: Path, name: str, sheet: str = "") -> _Layout:
    """Layout of a log in a format that its reader reads whole."""
    logs = Logs(files=(path.name,), format=name, table=sheet)
    table = registry.read(path, path.name, logs, ())
    columns = []
    for column in map(str, table.frame.columns):
        fields = list(map(str, table.frame[column].iloc[:50]))
        form = "" if all(map(times.is_decimal, fields)) else times.recognise_format(fields)
        columns.append(
            column_names.LogColumn(
                column, units.parse_unit(table.units.get(column, "")), bool(form), form
            )
        )
    return _Layout(name, tuple(columns), {}, sheet)


def _layout_of_text(path: Path) -> _Layout:
    """Layout of a text log; clean CSV has format "csv" and no dialect to state."""
    names: tuple[str, ...] = ()
    try:
        dialect = sniff.Dialect.guess(path, path.name)
    except NamelessColumnsError as error:
        names = _guess_names(path, error.columns)
        dialect = sniff.Dialect.guess(path, path.name, names=names)
    columns = tuple(
        column_names.LogColumn(column.name, column.unit, column.kind == "time", column.time_format)
        for column in dialect.columns
    )
    if dialect.clean and not names:
        return _Layout("csv", columns, {})
    return _Layout("text", columns, dialect.recipe_keys(), names=names)


def _guess_names(path: Path, columns: int) -> tuple[str, ...]:
    """Names for the columns of a log without any, from its first rows."""
    numbered = tuple(f"column {k + 1}" for k in range(columns))
    dialect = sniff.Dialect.guess(path, path.name, names=numbered)
    kinds = [column.kind for column in dialect.columns]
    needed = [name for name, kind in zip(numbered, kinds, strict=True) if kind == "number"]
    logs = Logs(files=(path.name,), format="text", names=numbered)
    frame = registry.read(path, path.name, logs, needed).frame
    numbers = [frame[name].to_numpy() if name in needed else None for name in numbered]
    names = nameless.name_columns(numbers)
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
    alike = {name for name in names if fnmatchcase(name, pattern)}
    return [pattern] if alike == set(files) and "[" not in pattern else list(files)


def _common_beginning(names: Sequence[str]) -> str:
    """Longest beginning that all names share."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in alike)

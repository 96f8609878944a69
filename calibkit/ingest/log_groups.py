"""The logs of a folder, grouped by how they are written and what they hold."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import takewhile
from pathlib import Path
from typing import TypeAlias

from calibkit import units
from calibkit.errors import FrameError, LogFormatError, UsageError
from calibkit.ingest import column_names
from calibkit.readers import registry, sniff, times
from calibkit.recipe.logs import Logs

_SKIPPED = re.compile(
    r"\.(json|md|toml|pdf|png|py|txt\.gz|zip|log\.gz)$|^(SHA256SUMS|LICENSE|README|SOURCE)",
    re.IGNORECASE,
)
"""Names of files that are no logs."""
_TEMPERATURES = frozenset({"temp_case_degc", "temp_env_degc", "temp_degc"})


_Layout: TypeAlias = (
    "tuple[str, tuple[column_names.LogColumn, ...], Mapping[str, str | int | list[int]]]"
)
"""Format, columns, and keys of [logs.text] for the dialect of a log."""


@dataclass(frozen=True, slots=True)
class Group:
    """Logs of one layout: their files, format, columns, and keys of [logs.text] for their
    dialect.
    """

    files: tuple[str, ...]
    format: str
    columns: tuple[column_names.LogColumn, ...]
    text: Mapping[str, str | int | list[int]]

    @property
    def second_logger(self) -> bool:
        """Whether the logs hold temperatures over time and nothing else that is known, as those of
        a chamber's logger do.
        """
        meant = {column.guess_canonical() for column in self.columns}
        known = {"", "time_s", *_TEMPERATURES}
        return "time_s" in meant and bool(meant & _TEMPERATURES) and meant <= known


def group_logs(folder: Path) -> list[Group]:
    """Group the logs of a folder by their layout; files that are no logs are left out.

    Raises UsageError for a folder that is not there, FrameError or LogFormatError for one without a
    log.
    """
    if not folder.is_dir():
        raise UsageError(
            f"--from {folder}: no such folder", hint="name the folder that holds the logs"
        )
    groups: dict[str, Group] = {}
    failed: LogFormatError | None = None
    for path in sorted(folder.iterdir()):
        if not path.is_file() or _SKIPPED.search(path.name):
            continue
        try:
            layout = _read_layout(path)
        except LogFormatError as error:
            failed = failed or error
            continue
        key = repr(layout)
        files = (*(groups[key].files if key in groups else ()), path.name)
        groups[key] = Group(files, *layout)
    if not groups:
        raise failed or FrameError(f"{folder}: no logs", hint="name the folder that holds the logs")
    return list(groups.values())


def _read_layout(path: Path) -> _Layout:
    """Layout of a log: by the format that it shows, else as text, else by a plugin."""
    with path.open("rb") as stream:
        head = stream.read(4096)
    found = registry.recognise_format(head)
    try:
        return _layout_of_format(path, found) if found else _layout_of_text(path)
    except LogFormatError:
        plugin = "" if found else registry.recognise_plugin(head)
        if not plugin:
            raise
    return _layout_of_format(path, plugin)


def _layout_of_format(path: Path, name: str) -> _Layout:
    """Layout of a log in a format that its reader reads whole."""
    table = registry.read(path, path.name, Logs(files=(path.name,), format=name), ())
    columns = []
    for column in map(str, table.frame.columns):
        fields = list(map(str, table.frame[column].iloc[:50]))
        form = "" if all(map(times.is_decimal, fields)) else times.recognise_format(fields)
        columns.append(
            column_names.LogColumn(
                column, units.parse_unit(table.units.get(column, "")), bool(form), form
            )
        )
    return name, tuple(columns), {}


def _layout_of_text(path: Path) -> _Layout:
    """Layout of a text log; clean CSV has format "csv" and no dialect to state."""
    dialect = sniff.Dialect.guess(path, path.name)
    columns = tuple(
        column_names.LogColumn(column.name, column.unit, column.kind == "time", column.time_format)
        for column in dialect.columns
    )
    if not dialect.header_lines:
        raise LogFormatError(
            f"{path.name}: {len(columns)} columns without names",
            hint="give [logs] names = […] in a copy of a shipped recipe",
        )
    return ("csv", columns, {}) if dialect.clean else ("text", columns, dialect.recipe_keys())


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

"""Logs of a folder → a commented recipe for them: a shipped recipe, in which only the mapping of
the logs is another.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, TypeAlias

from calibkit import recipe, units
from calibkit.errors import FrameError, LogFormatError, UsageError
from calibkit.ingest import naming
from calibkit.readers import registry, sniff, times
from calibkit.recipe.logs import Logs

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibkit.ingest.naming import Column
    from calibkit.recipe import Recipe

SKIPPED = re.compile(
    r"\.(json|md|toml|pdf|png|py|txt\.gz|zip|log\.gz)$|^(SHA256SUMS|LICENSE|README|SOURCE)",
    re.IGNORECASE,
)
"""Files that are no logs."""


TEMPERATURES = frozenset({"temp_case_degc", "temp_env_degc", "temp_degc"})


UNSTATED = "# No unit in the logs: "
"""Beginning of the line that names columns whose unit has to be stated; it is said aloud too."""


@dataclass(frozen=True, slots=True)
class Group:
    """Logs that are written alike: their files, columns, and how they are written."""

    files: tuple[str, ...]
    format: str
    columns: tuple[Column, ...]
    text: Mapping[str, str | int | list[int]]


def propose(folder: Path, parse: Parse, proposers: Sequence[Proposer]) -> str:
    """Text of a recipe for the logs of a folder, by the first instrument that recognises them.

    Raises LogFormatError or FrameError where none can be proposed.
    """
    groups = grouped(folder)
    choices = [
        (chosen, group)
        for group in groups
        if (chosen := _choose(Evidence.of(folder, group, groups, parse), proposers)) is not None
    ]
    if not choices:
        columns = "; ".join(
            f"{group.files[0]}: {', '.join(column.name for column in group.columns)}"
            for group in groups
        )
        raise FrameError(
            f"{folder}: no shipped procedure reads these columns: {columns}",
            hint=_told_by_hand([column for group in groups for column in group.columns]),
        )
    # the procedure that more of the logs are for
    chosen, group = max(choices, key=lambda choice: len(choice[1].files))
    return _written(folder, chosen, group, [other for other in groups if other is not group], parse)


def _told_by_hand(columns: Sequence[Column]) -> str:
    """What to do where columns do not say what they are; of those without a unit, that it is
    missing.
    """
    silent = [json.dumps(column.name, ensure_ascii=False) for column in columns if _silent(column)]
    units_too = (
        f"no unit is stated for {', '.join(dict.fromkeys(silent))}: write it behind the name (like"
        ' "Channel 1 [deg/s]"), or state it with the mapping (like [columns.gyro_dph] from = "…",'
        ' unit = "deg/s"); '
        if silent
        else ""
    )
    return (
        f"{units_too}name headerless columns in [logs] names, or copy a shipped recipe and map the"
        " columns by hand"
    )


def _silent(column: Column) -> bool:
    """Whether nothing says in which unit a column is."""
    return not column.stated and not column.is_time


def _unstated(choice: Choice) -> list[str]:
    """Comment on the mapped columns that are in a unit which the log does not state, and what each
    would be taken in.
    """
    silent = {
        name: column
        for name, column in choice.mapping.items()
        if _silent(column) and column.name != name and units.column_unit(name) != "1"
    }
    if not silent:
        return []
    taken = (
        f"{json.dumps(column.name, ensure_ascii=False)} in {units.column_unit(name)}"
        for name, column in silent.items()
    )
    keys = ", ".join(f"[columns.{name}]" for name in silent)
    return [f'{UNSTATED}{", ".join(taken)} would be taken; state unit = "…" in {keys}']


def grouped(folder: Path) -> list[Group]:
    """Groups of logs that have the same columns and are written alike; files that are no logs are
    left out.
    """
    if not folder.is_dir():
        raise UsageError(
            f"--from {folder}: no such folder", hint="name the folder that holds the logs"
        )
    found: dict[tuple[object, ...], list[str]] = {}
    kinds: dict[
        tuple[object, ...], tuple[str, tuple[Column, ...], Mapping[str, str | int | list[int]]]
    ] = {}
    failed: LogFormatError | None = None
    for path in sorted(folder.iterdir()):
        if not path.is_file() or SKIPPED.search(path.name):
            continue
        try:
            kind = _looked_at(path)
        except LogFormatError as error:
            failed = failed or error
            continue
        key = (kind[0], kind[1], json.dumps(dict(kind[2])))
        found.setdefault(key, []).append(path.name)
        kinds[key] = kind
    if not found:
        if failed is not None:
            raise failed
        raise FrameError(f"{folder}: no logs", hint="name the folder that holds the logs")
    return [Group(tuple(files), *kinds[key]) for key, files in found.items()]


def _looked_at(path: Path) -> tuple[str, tuple[Column, ...], Mapping[str, str | int | list[int]]]:
    """Format, columns and text dialect of a file; clean CSV has format "csv" and no dialect to
    state.
    """
    with path.open("rb") as stream:
        head = stream.read(4096)
    found = registry.signature(head[:32]) or registry.shown(head)
    if found:
        table = registry.read(
            path, path.name, Logs.model_validate({"files": [path.name], "format": found}), ()
        )
        columns = tuple(
            _column(
                str(name),
                table.units.get(str(name), ""),
                [str(field) for field in table.frame[name].iloc[:50]],
            )
            for name in table.frame.columns
        )
        return found, columns, {}
    dialect = sniff.guess(path, path.name)
    columns = tuple(
        naming.Column(column.name, column.unit, column.kind == "time", column.time_format)
        for column in dialect.columns
    )
    if not dialect.header_lines:
        raise LogFormatError(
            f"{path.name}: {len(columns)} columns without names",
            hint="give [logs] names = […] in a copy of a shipped recipe",
        )
    return ("csv", columns, {}) if dialect.clean else ("text", columns, dialect.table())


def _column(name: str, unit: str, fields: list[str]) -> Column:
    """A column of a format that is no text: times are fields that are no numbers and look like
    times.
    """
    form = ""
    if any(not times.is_decimal(field) for field in fields):
        form = times.form_of(fields)
    return naming.Column(name, unit, bool(form), form)


@dataclass(frozen=True, slots=True)
class Choice:
    """A shipped recipe, and canonical column → column of the logs that it reads."""

    recipe: str
    mapping: Mapping[str, Column]
    others: tuple[tuple[str, Column], ...]
    keys: Mapping[str, str]
    """Keys of the shipped recipe that must be another, as TOML values."""
    beside_files: str = ""
    """Comment under the names of the logs."""
    remark: str = ""
    """Comment at the head of the recipe."""

    def with_others(self, more: Sequence[tuple[str, Column]]) -> Choice:
        """The choice with more columns that could be something else."""
        return replace(self, others=(*self.others, *more))


Parse: TypeAlias = "Callable[[recipe.Source], Recipe]"
"""Turns the text of a recipe into its record."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What an instrument recognises its logs by."""

    folder: Path
    group: Group
    second_logger: bool
    """Whether other logs of the folder look like those of a chamber's logger."""
    columns: Mapping[str, Column]
    """Canonical column → column of the logs."""
    others: tuple[tuple[str, Column], ...]
    """Columns that could be canonical ones too."""
    parse: Parse

    @classmethod
    def of(cls, folder: Path, group: Group, groups: Sequence[Group], parse: Parse) -> Evidence:
        """Evidence of a group among all groups of a folder."""
        columns, others = naming.named(group.columns)
        second_logger = any(_second_logger(other) for other in groups)
        return cls(folder, group, second_logger, columns, tuple(others), parse)

    def gyros(self, units: str = "lsb|dph") -> dict[str, Column]:
        """Indications of gyros, in counts per second or as rates."""
        pattern = rf"gyro(_[a-z0-9]+)?_({units})"
        return {name: one for name, one in self.columns.items() if re.fullmatch(pattern, name)}

    def choose(
        self,
        name: str,
        wanted: Sequence[str],
        columns: Mapping[str, Column] | None = None,
        keys: Mapping[str, str] | None = None,
    ) -> Choice:
        """Choice of a shipped recipe with those columns that it reads; the rest could be something
        else.
        """
        taken = self.columns if columns is None else columns
        rest = [(name, column) for name, column in taken.items() if name not in wanted]
        mapping = {name: taken[name] for name in wanted if name in taken}
        return Choice(name, mapping, (*self.others, *rest), keys or {})

    def recipe(self, choice: Choice) -> Recipe:
        """Recipe that a choice gives."""
        text = _written(self.folder, choice, self.group, (), self.parse)
        return self.parse(recipe.Source("proposed recipe", text))


Proposer: TypeAlias = Callable[[Evidence], Choice | None]
"""Recognises the logs of one instrument."""


def _choose(evidence: Evidence, proposers: Sequence[Proposer]) -> Choice | None:
    """Shipped recipe that maps columns of just these names, else that of the first instrument that
    recognises the logs.
    """
    written = {column.name for column in evidence.group.columns}
    for name in recipe.shipped():
        mapped = evidence.parse(recipe.find(name)).columns
        if mapped and {column.source for column in mapped.values()} <= written:
            return Choice(name, {}, (), {})
    found = (propose(evidence) for propose in proposers)
    return next((choice for choice in found if choice is not None), None)


def _written(
    folder: Path, choice: Choice, group: Group, rest: Sequence[Group], parse: Parse
) -> str:
    """Text of the shipped recipe with the log mapping of these logs."""
    text = recipe.find(choice.recipe).text
    shipped = parse(recipe.find(choice.recipe))
    for key, value in choice.keys.items():
        text = re.sub(
            rf"(?m)^{key} = [^#\n]*?(?=\s*(#|$))",
            f"{key} = {value}".replace("\\", r"\\"),
            text,
            count=1,
        )
    names = [path.name for path in folder.iterdir() if path.is_file()]
    matched = {
        name for name in names if any(fnmatchcase(name, pattern) for pattern in shipped.logs.files)
    }
    if matched != set(group.files):
        patterns = json.dumps(file_patterns(group.files, names), ensure_ascii=False)
        text = re.sub(r"(?m)^files = .*$", lambda _: f"files = {patterns}", text, count=1)
    if choice.beside_files:
        text = re.sub(
            r"(?m)^(files = .*)$", lambda m: f"{m.group(1)}\n{choice.beside_files}", text, count=1
        )
    if group.format not in ("csv", "text"):
        text = re.sub(
            r"(?m)^(files = .*)$",
            lambda m: f'{m.group(1)}\nformat = "{group.format}"',
            text,
            count=1,
        )
    text = text.rstrip("\n") + "\n" + _mapping(choice, group)
    return _header(choice, group, rest) + text


def file_patterns(files: Sequence[str], names: Sequence[str]) -> list[str]:
    """One pattern that matches these files and no other, or their names."""
    if len(files) == 1:
        return [files[0]]
    start = _common(files)
    end = _common([name[::-1] for name in files])[::-1]
    pattern = f"{start.rstrip('0123456789')}*{end.lstrip('0123456789')}"
    alike = {name for name in names if fnmatchcase(name, pattern)}
    return [pattern] if alike == set(files) and "[" not in pattern else list(files)


def _common(names: Sequence[str]) -> str:
    """Longest common beginning."""
    first, last = min(names), max(names)
    return first[
        : next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    ]


def _mapping(choice: Choice, group: Group) -> str:
    """Tables that map and pin, and what was not used, as comments."""
    lines = [""]
    if group.text:
        lines += [
            (
                "[logs.text] # how these logs are written, as guessed from their first lines;"
                " correct what is wrong"
            )
        ]
        lines += [
            f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in group.text.items()
        ] + [""]
    for name, column in choice.mapping.items():
        if column.name == name and not column.is_time:
            continue
        by_reader = column.unit or units.of_header(column.name)
        said = f"the log states {column.stated}" if column.stated else _taken_in(name)
        lines.append(f"[columns.{name}]" + ("" if column.is_time else f" # {said}"))
        lines.append(f"from = {json.dumps(column.name, ensure_ascii=False)}")
        if column.stated and not by_reader and not column.is_time:
            lines.append(f'unit = "{column.stated}"')
        if column.is_time and "%" in column.time_format:
            lines.append(f"time_format = {json.dumps(column.time_format)}")
        lines.append("")
    lines += [
        f"# could be {name} too: {json.dumps(column.name, ensure_ascii=False)}"
        for name, column in choice.others
    ]
    if not choice.mapping:
        return "\n".join(lines).rstrip("\n") + "\n" if len(lines) > 1 else ""
    used = {column.name for column in choice.mapping.values()} | {
        column.name for _, column in choice.others
    }
    unused = [column.name for column in group.columns if column.name not in used]
    lines += [f"# not used: {', '.join(unused)}"] if unused else []
    return "\n".join(lines).rstrip("\n") + "\n" if len(lines) > 1 else ""


def _taken_in(name: str) -> str:
    """What is said of a mapped column without a unit."""
    unit = units.column_unit(name)
    return "no unit" if unit == "1" else f'no unit in the log: taken in {unit}, or state unit = "…"'


def _header(choice: Choice, group: Group, rest: Sequence[Group]) -> str:
    """Comment that says what was guessed from what, and which logs are not read."""
    count = (
        f"{len(group.files)} log{'s' if len(group.files) > 1 else ''} of {len(group.columns)}"
        " columns"
    )
    lines = [
        (
            f"# Proposed for {count} ({group.files[0]}{', …' if len(group.files) > 1 else ''})"
            f" after the recipe {choice.recipe}."
        )
    ]
    lines.append(
        "# Check every unit, sign and column below before you trust a number: calibkit check RECIPE"
        " --data DIR"
    )
    lines += _unstated(choice)
    if choice.remark:
        lines.append(choice.remark)
    for other in rest:
        names = ", ".join(column.name for column in other.columns)
        lines.append(
            f"# Not read: {', '.join(other.files[:4])}{', …' if len(other.files) > 4 else ''}"
            f" ({names})"
        )
        if _second_logger(other):
            lines.append(
                "# These look like a second logger's (a chamber's): see [chamber] in docs/check.md"
                " to join them."
            )
    return "\n".join(lines) + "\n"


def _second_logger(group: Group) -> bool:
    """Whether logs hold temperatures over time and nothing else that is known."""
    meant = {naming.canonical(column) for column in group.columns}
    return (
        "time_s" in meant and bool(meant & TEMPERATURES) and meant <= {"", "time_s", *TEMPERATURES}
    )

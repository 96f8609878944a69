"""Logs of a folder → a commented recipe for them: a shipped recipe with the mapping of these
logs.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Self, TypeAlias

from calibkit import recipe, units
from calibkit.errors import FrameError
from calibkit.ingest import column_names
from calibkit.ingest.column_names import LogColumn
from calibkit.ingest.log_groups import Group, file_patterns, group_logs
from calibkit.recipe import Recipe


@dataclass(frozen=True, slots=True)
class Proposal:
    """Text of a recipe, and a note on columns whose unit has to be stated, or ""."""

    text: str
    note: str


@dataclass(frozen=True, slots=True)
class Choice:
    """A shipped recipe for logs, and the mapping of canonical columns to columns of the logs."""

    recipe: str
    mapping: Mapping[str, LogColumn]
    others: tuple[tuple[str, LogColumn], ...]
    keys: Mapping[str, str]
    """Keys of the shipped recipe with other values, as TOML."""
    beside_files: str = ""
    """Comment under the names of the logs."""
    remark: str = ""
    """Comment at the head of the recipe."""
    reason: str = ""
    """What of the logs says that it is this recipe."""
    runner_up: str = ""
    """The next recipe that reads the logs, and why."""

    def with_others(self, more: Sequence[tuple[str, LogColumn]]) -> Self:
        """The choice with more columns that could be canonical ones too."""
        return replace(self, others=(*self.others, *more))


Parse: TypeAlias = Callable[[recipe.Source], Recipe]
"""Turns the text of a recipe into its record."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What an instrument knows of logs when it decides whether they are its own."""

    folder: Path
    group: Group
    second_logger: bool
    """Whether other logs of the folder look like those of a chamber's logger."""
    columns: Mapping[str, LogColumn]
    """Canonical column → column of the logs."""
    others: tuple[tuple[str, LogColumn], ...]
    """Columns that could be canonical ones too."""
    parse: Parse

    @classmethod
    def of(cls, folder: Path, group: Group, groups: Sequence[Group], parse: Parse) -> Self:
        """Evidence of a group among all groups of a folder."""
        columns, others = column_names.assign_columns(group.columns)
        second_logger = any(other.second_logger for other in groups)
        return cls(folder, group, second_logger, columns, tuple(others), parse)

    def gyros(self, units: str = "lsb|dph") -> dict[str, LogColumn]:
        """Indications of gyros, in counts per second or as rates."""
        pattern = rf"gyro(_[a-z0-9]+)?_({units})"
        return {name: one for name, one in self.columns.items() if re.fullmatch(pattern, name)}

    def choose(
        self,
        name: str,
        wanted: Sequence[str],
        columns: Mapping[str, LogColumn] | None = None,
        keys: Mapping[str, str] | None = None,
        reason: str = "",
    ) -> Choice:
        """Choice of a shipped recipe that reads the wanted columns; the rest could be canonical
        columns too.
        """
        taken = self.columns if columns is None else columns
        rest = [(name, column) for name, column in taken.items() if name not in wanted]
        mapping = {name: taken[name] for name in wanted if name in taken}
        return Choice(name, mapping, (*self.others, *rest), keys or {}, reason=reason)

    def recipe(self, choice: Choice) -> Recipe:
        """Recipe that a choice gives."""
        text = _write_recipe(self.folder, choice, self.group, (), self.parse)
        return self.parse(recipe.Source("proposed recipe", text))


_CHECK_FIRST = (
    "Check every unit, sign and column below before you trust a number: calibkit check RECIPE"
    " --data DIR"
)
_GUESSED = "how these logs are written, as guessed from their first lines; correct what is wrong"
_NAMES_GUESSED = (
    "# The logs name no columns: [logs] names was guessed from their numbers, and units are those"
    " of the names. Correct both."
)
_NO_PROCEDURE = (
    "# No procedure was recognised: put canonical names into [logs] names, or map the columns under"
    " [columns], and run init again or choose a shipped recipe."
)
Proposer: TypeAlias = Callable[[Evidence], Choice | None]
"""Recognises the logs of one instrument."""


def propose(
    folder: Path, parse: Parse, proposers: Sequence[Proposer], skeleton: str, sheet: str = ""
) -> Proposal:
    """Recipe for the logs of a folder, by the first instrument that recognises them; for logs
    without names that none recognises a recipe as a skeleton.

    Raises LogFormatError or FrameError where none can be proposed.
    """
    groups = group_logs(folder, sheet)
    choices = [
        (chosen, group)
        for group in groups
        if (chosen := _choose_recipe(Evidence.of(folder, group, groups, parse), proposers))
        is not None
    ]
    if not choices and (nameless := [group for group in groups if group.names or group.table]):
        choices = [(Choice(skeleton, {}, (), {}, remark=_NO_PROCEDURE), nameless[0])]
    if not choices:
        columns = "; ".join(
            f"{group.files[0]}: {', '.join(column.name for column in group.columns)}"
            for group in groups
        )
        raise FrameError(
            f"{folder}: no shipped procedure reads these columns: {columns}",
            hint=_mapping_advice([column for group in groups for column in group.columns]),
        )
    # the procedure that more of the logs are for
    chosen, group = max(choices, key=lambda choice: len(choice[1].files))
    rest = [other for other in groups if other is not group]
    return Proposal(_write_recipe(folder, chosen, group, rest, parse), _note_missing_units(chosen))


def _mapping_advice(columns: Sequence[LogColumn]) -> str:
    """Hint for columns whose names do not show what they are; it lists those without a unit."""
    silent = [
        json.dumps(column.name, ensure_ascii=False) for column in columns if _lacks_unit(column)
    ]
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


def _lacks_unit(column: LogColumn) -> bool:
    """Whether the log states no unit of a column."""
    return not column.stated and not column.is_time


def _note_missing_units(choice: Choice) -> str:
    """Note on the mapped columns without a unit in the log, with the unit that each would be taken
    in; "" where every unit is stated.
    """
    silent = {
        name: column
        for name, column in choice.mapping.items()
        if _lacks_unit(column) and column.name != name and units.column_unit(name) != "1"
    }
    if not silent:
        return ""
    taken = (
        f"{json.dumps(column.name, ensure_ascii=False)} in {units.column_unit(name)}"
        for name, column in silent.items()
    )
    keys = ", ".join(f"[columns.{name}]" for name in silent)
    return f'No unit in the logs: {", ".join(taken)} would be taken; state unit = "…" in {keys}'


def _choose_recipe(evidence: Evidence, proposers: Sequence[Proposer]) -> Choice | None:
    """Shipped recipe that maps columns of just these names, else that of the first instrument that
    recognises the logs.
    """
    written = {column.name for column in evidence.group.columns}
    for name in recipe.shipped():
        mapped = evidence.parse(recipe.find(name)).columns
        if mapped and {column.source for column in mapped.values()} <= written:
            return Choice(name, {}, (), {})
    found = [choice for recognise in proposers if (choice := recognise(evidence)) is not None]
    if not found:
        return None
    others = (choice for choice in found if choice.recipe != found[0].recipe)
    second = next((f"{other.recipe} ({other.reason})" for other in others), "none")
    return replace(found[0], runner_up=second)


def _write_recipe(
    folder: Path, choice: Choice, group: Group, rest: Sequence[Group], parse: Parse
) -> str:
    """Text of the chosen shipped recipe, with the mapping of these logs in place of its own."""
    source = recipe.find(choice.recipe)
    text, shipped = source.text, parse(source)
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
    written_as = "" if group.format in ("csv", "text") else f'format = "{group.format}"'
    table = f"table = {json.dumps(group.table, ensure_ascii=False)}" if group.table else ""
    listed = f"names = {json.dumps(group.names, ensure_ascii=False)}" if group.names else ""
    below = [line for line in (written_as, table, listed, choice.beside_files) if line]
    text = re.sub(
        r"(?m)^files = .*$", lambda found: "\n".join((found.group(), *below)), text, count=1
    )
    return (
        _write_header(choice, group, rest)
        + text.rstrip("\n")
        + "\n"
        + _write_mapping(choice, group)
    )


def _write_mapping(choice: Choice, group: Group) -> str:
    """Tables [logs.text] and [columns] of a recipe, and comments on columns that are not used."""
    lines = [""]
    if group.text:
        pinned = (
            f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in group.text.items()
        )
        lines += [f"[logs.text] # {_GUESSED}", *pinned, ""]
    for name, column in choice.mapping.items():
        if column.name == name and not column.is_time:
            continue
        by_reader = column.unit or units.unit_in_header(column.name)
        unit = units.column_unit(name)
        taken = "" if unit == "1" else f' in the log: taken in {unit}, or state unit = "…"'
        remark = f"the log states {column.stated}" if column.stated else f"no unit{taken}"
        lines.append(f"[columns.{name}]" + ("" if column.is_time else f" # {remark}"))
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
    used = {
        column.name
        for column in (*choice.mapping.values(), *(column for _, column in choice.others))
    }
    unused = [column.name for column in group.columns if column.name not in used]
    if choice.mapping and unused:
        lines.append(f"# not used: {', '.join(unused)}")
    return "\n".join(lines).rstrip("\n") + "\n" if len(lines) > 1 else ""


def _write_header(choice: Choice, group: Group, rest: Sequence[Group]) -> str:
    """Comment at the head of a recipe: for which logs it is, and which logs it does not read."""
    several = len(group.files) > 1
    note = _note_missing_units(choice)
    because = (
        f"# Procedure: {choice.recipe}, because the logs hold {choice.reason}. Runner-up:"
        f" {choice.runner_up or 'none'}."
    )
    remarks = (
        (
            f"# Proposed for {len(group.files)} log{'s' * several} of {len(group.columns)} columns"
            f" ({group.files[0]}{', …' * several}) after the recipe {choice.recipe}."
        ),
        f"# {_CHECK_FIRST}",
        because if choice.reason else "",
        f"# {note}" if note else "",
        _NAMES_GUESSED if group.names else "",
        choice.remark,
    )
    lines = list(filter(None, remarks))
    for other in rest:
        names = ", ".join(column.name for column in other.columns)
        lines.append(
            f"# Not read: {', '.join(other.files[:4])}{', …' if len(other.files) > 4 else ''}"
            f" ({names})"
        )
        if other.second_logger:
            lines.append(
                "# These look like a second logger's (a chamber's): see [chamber] in docs/check.md"
                " to join them."
            )
    return "\n".join(lines) + "\n"

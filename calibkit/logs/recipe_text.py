"""A choice of a shipped recipe for logs → its text, with the mapping of these logs."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Self, TypeAlias

from calibkit import recipe, units
from calibkit.errors import visible
from calibkit.logs.column_names import LogColumn
from calibkit.logs.log_groups import Group, file_patterns
from calibkit.recipe import Recipe
from calibkit.recipe.toml_text import write_value


@dataclass(frozen=True, slots=True)
class RecipeChoice:
    """A shipped recipe for logs, and the mapping of canonical columns to columns of the logs."""

    recipe: str
    mapping: Mapping[str, LogColumn]
    alternatives: tuple[tuple[str, LogColumn], ...]
    keys: Mapping[str, str]
    """Keys of the shipped recipe with other values, as TOML."""
    beside_files: str = ""
    """Comment or key under the names of the logs."""
    lines: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Canonical column → further lines of its mapping."""
    tables: str = ""
    """Further tables of the recipe."""
    guessed: bool = False
    """Whether numbers alone say what the columns are."""
    joined: tuple[str, ...] = ()
    """Files of a second logger that the recipe reads too."""
    remark: str = ""
    """Comment at the head of the recipe."""
    reason: str = ""
    """What of the logs says that it is this recipe."""
    runner_up: str = ""
    """The next recipe that reads the logs, and why."""

    def with_others(self, columns: Sequence[tuple[str, LogColumn]]) -> Self:
        """The choice with more columns that could be canonical ones too."""
        return replace(self, alternatives=(*self.alternatives, *columns))


Parse: TypeAlias = Callable[[recipe.Source], Recipe]
"""Turns the text of a recipe into its record."""
UNSTATED = "# state: "
"""Mark before a line that a person has to complete."""
_SI = units.TABLE["m/s^2"].dimension
_CONVERTED = {"acceleration", _SI}
"""Dimensions between which the site's gravity converts."""
_CHECK_FIRST = (
    "Check every unit, sign and column below before you trust a number: calibkit check RECIPE"
    " --data DIR"
)
_GUESSED = "how these logs are written, as guessed from their first lines; correct what is wrong"
_NAMES_GUESSED = (
    "# The logs name no columns: [logs] names was guessed from their numbers, and units are those"
    " of the names. Correct both."
)


def note_missing_units(choice: RecipeChoice) -> str:
    """Note on the mapped columns without a unit in the log, with the unit that each would be taken
    in; "" where every unit is stated.
    """
    silent = {
        name: column
        for name, column in choice.mapping.items()
        if not (column.stated or column.is_time)
        and column.name != name
        and not choice.lines.get(name)
        and units.column_unit(name) != "1"
    }
    if not silent:
        return ""
    assumed_units = (
        f"{write_value(column.name)} in {units.column_unit(name)}"
        for name, column in silent.items()
    )
    keys = ", ".join(f"[columns.{name}]" for name in silent)
    units_text = ", ".join(assumed_units)
    return f'No unit in the logs: {units_text} would be taken; state unit = "…" in {keys}'


def write_recipe(
    folder: Path, choice: RecipeChoice, group: Group, unread_groups: Sequence[Group], parse: Parse
) -> str:
    """Text of the chosen shipped recipe, with the mapping of these logs in place of its own."""
    source = recipe.find(choice.recipe)
    text, shipped = source.text, parse(source)
    for key, value in choice.keys.items():
        written = f"{key} = {value}".replace("\\", r"\\")
        for mark in ("", "# "):  # a key that the shipped recipe shows as a comment
            text, replacements = re.subn(
                rf"(?m)^{mark}{key} = [^#\n]*?(?=\s*(#|$))", written, text, count=1
            )
            if replacements:
                break
    names = [path.name for path in folder.iterdir() if path.is_file()]
    matched = {
        name for name in names if any(fnmatchcase(name, pattern) for pattern in shipped.logs.files)
    }
    if matched != set(group.files):
        patterns = write_value(file_patterns(group.files, names))
        text = re.sub(r"(?m)^files = .*$", lambda _: f"files = {patterns}", text, count=1)
    layout = group.layout
    log_keys = {
        "format": "" if layout.format in ("csv", "text") else layout.format,
        "table": layout.table,
        "tables": layout.tables,
        "names": layout.names,
    }
    keys = (f"{k} = {write_value(v)}" for k, v in log_keys.items() if v)
    lines_below_files = [line for line in (*keys, choice.beside_files) if line]
    text = re.sub(
        r"(?m)^files = .*$",
        lambda files_line: "\n".join((files_line.group(), *lines_below_files)),
        text,
        count=1,
    )
    return (
        _write_header(choice, group, unread_groups)
        + text.rstrip("\n")
        + "\n"
        + _write_mapping(choice, group)
    )


def _write_mapping(choice: RecipeChoice, group: Group) -> str:
    """Tables [logs.text] and [columns] of a recipe, and comments on columns that are not used."""
    lines = [""]
    if group.layout.text:
        pinned = (f"{key} = {write_value(value)}" for key, value in group.layout.text.items())
        lines += [f"[logs.text] # {_GUESSED}", *pinned, ""]
    for name, column in choice.mapping.items():
        lines += _map_column(name, column, choice.lines.get(name, ()))
    lines += [
        f"# could be {name} too: {write_value(column.name)}" for name, column in choice.alternatives
    ]
    used = {column.name for column in choice.mapping.values()}
    used |= {column.name for _, column in choice.alternatives}
    unused = [column.name for column in group.columns if column.name not in used]
    if choice.mapping and unused:
        lines.append(visible(f"# not used: {', '.join(unused)}"))
    by_gravity = any(
        column.dimension == _SI or any("m/s^2" in line for line in choice.lines.get(name, ()))
        for name, column in choice.mapping.items()
        if name.startswith("accel_") and name.endswith("_g")
    )
    if by_gravity and not re.search(r"(?m)^\[site\]", recipe.find(choice.recipe).text):
        lines += [
            "[site] # gravity divides m/s²",
            f"{UNSTATED}gravity_mps2 = 9.8 # take the mark off",
        ]
    lines.append(choice.tables)
    return "\n".join(lines).rstrip("\n") + "\n" if any(lines) else ""


def _map_column(name: str, column: LogColumn, further_lines: Sequence[str]) -> list[str]:
    """Table of a canonical column, and a blank line; nothing for one that is called so itself."""
    if column.name == name and not column.is_time:
        return []
    by_reader = column.unit or units.unit_in_header(column.name)
    unit = units.column_unit(name)
    unit_assumed = "" if unit == "1" else f' in the log: taken in {unit}, or state unit = "…"'
    log_unit = visible(column.stated)
    remark = f"the log states {log_unit}" if column.stated else f"no unit{unit_assumed}"
    lines = [
        f"[columns.{name}]" + ("" if column.is_time else f" # {remark}"),
        f"from = {write_value(column.name)}",
    ]
    # only a stated scale turns a unit of another dimension into the canonical one
    foreign = False
    if column.stated and not column.is_time and unit in units.TABLE:
        dimensions = {column.dimension, units.TABLE[unit].dimension}
        foreign = len(dimensions) > 1 and not dimensions <= _CONVERTED
    if foreign:
        lines += [
            f'unit = "{unit}"',
            f"{UNSTATED}scale = 1.0 # {unit} per {log_unit}; take the mark off",
        ]
    if column.stated and not (by_reader or foreign or column.is_time):
        lines.append(f"unit = {write_value(column.stated)}")
    if column.is_time and "%" in column.time_format:
        lines.append(f"time_format = {write_value(column.time_format)}")
    return [*lines, *further_lines, ""]


def _write_header(choice: RecipeChoice, group: Group, unread_groups: Sequence[Group]) -> str:
    """Comment at the head of a recipe: for which logs it is, and which logs it does not read."""
    plural = len(group.files) > 1
    note = note_missing_units(choice)
    because = (
        f"# Procedure: {choice.recipe}, because the logs hold {choice.reason}. Runner-up:"
        f" {choice.runner_up or 'none'}."
    )
    remarks = (
        (
            f"# Proposed for {len(group.files)} log{'s' * plural} of {len(group.columns)} columns"
            f" ({group.files[0]}{', …' * plural}) after the recipe {choice.recipe}."
        ),
        f"# {_CHECK_FIRST}",
        because if choice.reason else "",
        f"# {note}" if note else "",
        _NAMES_GUESSED if group.layout.names else "",
        choice.remark,
    )
    lines = list(filter(None, remarks))
    for other in unread_groups:
        names = ", ".join(column.name for column in other.columns)
        lines.append(
            f"# Not read: {', '.join(other.files[:4])}{', …' if len(other.files) > 4 else ''}"
            f" ({names})"
        )
        if other.second_logger:
            lines.append(
                "# These look like a second logger's (a chamber's): see [chamber] in docs/logs.md"
                " to join them."
            )
    # names come from files that anybody may have written: a line end would end the comment
    return "\n".join(map(visible, lines)) + "\n"

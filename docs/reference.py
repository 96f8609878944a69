"""Reference pages from the code: recipe keys, commands, units, findings of `check`.

A line `<!-- from the code: keys -->` of a page is replaced by what stands here, by Sphinx. On a
terminal: `python docs/reference.py keys`; keys of recipes, `profile`, `commands`, `units`,
`findings`.
"""

from __future__ import annotations

import ast
import itertools
import json
import re
import sys
import typing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from pydantic import BaseModel
from sphinx.pycode import ModuleAnalyzer

from calibkit import cli, instruments, units
from calibkit.certificate.profile import Profile
from calibkit.recipe.tables import Recipe

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sphinx.application import Sphinx

PACKAGE = Path(__file__).resolve().parents[1] / "calibkit"
MARK = re.compile(r"^<!-- from the code: (\w+) -->$", re.MULTILINE)
LIMITS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
SHARED_OPTIONS = ("json", "quiet", "verbose", "dry_run", "details", "help")
"""Options that the page states once for all commands."""
POSITION_OF_NAME = {"Finding": 5, "finding_at_row": 6, "finding_of_column": 5, "Finding.of": 9}
"""Function that makes a finding → position of its name among the arguments."""
FINDING = re.compile(r"# finding (\w+): (.*(?:\n *# (?!finding).*)*)")
UNITS = {
    **units.COLUMN_UNITS,
    "min": "degC/min",
    "ppm": "ppm",
    "mg": "mg",
    "hz": "Hz",
    "mps2": "m/s^2",
    "m": "m",
}
"""Last word of a key → unit of its number."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Table in Markdown."""
    lines = [
        "| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |"
        for line in (head, *rows)
    ]
    return "\n".join((lines[0], "|---" * len(head) + "|", *lines[1:]))


def find_tables(annotation: Any) -> Iterator[type[BaseModel]]:  # noqa: ANN401 (any annotation)
    """Recipe tables within an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from find_tables(argument)


def find_meaning(model: type[BaseModel], name: str) -> str:
    """Comment `#:` above a key, in the class that states it."""
    for owner in model.__mro__[: model.__mro__.index(BaseModel)]:
        comments = ModuleAnalyzer.for_module(owner.__module__).find_attr_docs()
        if comment := comments.get((owner.__name__, name)):
            return " ".join(comment).strip()
    return ""


def describe_values(schema: dict[str, Any]) -> str:
    """Values that a key may have, from its JSON schema."""
    if "anyOf" in schema:
        choices = [entry for entry in schema["anyOf"] if entry.get("type") != "null"]
        return " or ".join(dict.fromkeys(map(describe_values, choices)))
    if "const" in schema or "enum" in schema:
        return ", ".join(f"`{json.dumps(v)}`" for v in schema.get("enum", [schema.get("const")]))
    if schema.get("type") == "array":
        entries = schema.get("prefixItems") or [schema["items"]]
        return f"list of {describe_values(entries[0])}"
    if schema.get("type") == "object":
        return f"name = {describe_values(schema['additionalProperties'])}"
    names = {"string": "text", "boolean": "`true`, `false`", "integer": "whole number"}
    limits = [f"{sign} {schema[limit]:g}" for limit, sign in LIMITS.items() if limit in schema]
    if schema.get("format") == "date":
        return "date"
    return " ".join([names.get(schema.get("type", ""), "number"), ", ".join(limits)]).strip()


def list_keys(
    model: type[BaseModel], place: str, leave_out: frozenset[str], seen: dict[type, str]
) -> Iterator[str]:
    """Table of the keys of a model, then those of the tables in it; a table stands once."""
    schema = model.model_json_schema()
    rows, inner = [], []
    for name, field in model.model_fields.items():
        key = field.alias or name
        tables = list(find_tables(field.annotation))
        if name in leave_out:
            continue
        if tables and tables[0] in seen:
            rows.append((f"`{key}`", "table", "–", f"Keys of `[{seen[tables[0]]}]`."))
        elif tables:
            brackets = "[[{}]]" if "tuple" in str(field.annotation) else "[{}]"
            inner.append((tables[0], brackets.format(f"{place}{key}"), f"{place}{key}"))
            seen[tables[0]] = f"{place}{key}"
        else:
            entry = schema["properties"][key]
            default = "required" if field.is_required() else "–"
            if entry.get("default") not in (None, "", [], {}):
                default = f"`{json.dumps(entry['default'], ensure_ascii=False)}`"
            values = describe_values(entry)
            unit = UNITS.get(key.rpartition("_")[2]) if "_" in key else None
            values = values.replace("number", f"number [{unit}]") if unit else values
            rows.append((f"`{key}`", values, default, find_meaning(model, name)))
    if rows:
        yield table(("key", "values", "default", "meaning"), rows)
    for table_model, heading, key in inner:
        yield f"**`{heading}`**"
        yield " ".join((table_model.__doc__ or "").split("\n\n")[0].split())
        stated = next((other for other in seen if other in table_model.__mro__[1:]), None)
        if stated is not None:
            yield f"All keys of `[{seen[stated]}]`, and:"
        known = frozenset() if stated is None else frozenset(stated.model_fields)
        yield from list_keys(table_model, f"{key}.", known, seen)


def describe_keys() -> str:
    """Keys of every recipe, then those of each procedure."""
    seen: dict[type, str] = {}
    parts = ["## Every recipe", *list_keys(Recipe, "", frozenset({"procedure"}), seen)]
    for name, instrument in sorted(instruments.list_usable().items()):
        model = instrument.Recipe
        shared = set(Recipe.model_fields) & set(model.model_fields)
        changed = {
            key
            for key in shared
            if model.model_fields[key].annotation != Recipe.model_fields[key].annotation
        }
        parts += [f"## `{name}`", " ".join((model.__doc__ or "").split())]
        left_out = frozenset(shared - changed | {"procedure"})
        parts += list_keys(model, "", left_out, dict(seen))
    return "\n\n".join(parts)


def describe_profile() -> str:
    """Keys of a laboratory's profile."""
    return "\n\n".join(list_keys(Profile, "", frozenset({"type_b"}), {}))


def describe_commands() -> str:
    """Arguments and options of each command; the options of all commands stand on the page."""
    parts = []
    for name, command in cli.cli.commands.items():
        paragraphs = (command.help or "").split("\n\n")
        examples = re.compile(r"^\s*calibkit ", re.MULTILINE)
        text = " ".join(" ".join(p.split()) for p in paragraphs if not examples.search(p))
        arguments = [p.make_metavar(click.Context(command)) for p in command.params]
        shown = [
            metavar
            for metavar, p in zip(arguments, command.params, strict=True)
            if isinstance(p, click.Argument)
        ]
        parts += [f"### `calibkit {' '.join([name, *shown])}`", text]
        options = [
            p
            for p in command.params
            if isinstance(p, click.Option) and p.name not in (*SHARED_OPTIONS, "as_json")
        ]
        if options:
            parts.append(table(("option", "meaning"), map(describe_option, options)))
    return "\n\n".join(parts)


def describe_option(option: click.Option) -> tuple[str, str]:
    """Spelling and help text of an option, with its default."""
    record = option.get_help_record(click.Context(click.Command("calibkit")))
    spelling, text = record or (option.opts[0], "")
    return f"`{spelling}`", text


def describe_units() -> str:
    """Units by what they measure, with their other spellings."""
    rows = []
    for dimension, names in itertools.groupby(
        units.TABLE, key=lambda name: units.TABLE[name].dimension
    ):
        spellings = []
        for name in names:
            others = [other for other, unit in units.ALIASES.items() if unit == name]
            few = ", ".join(
                f"`{other}`" for other in others[:4] if other.isascii() or len(other) < 4
            )
            spellings.append(f"`{name}`" + (f" ({few} …)" if few else ""))
        rows.append((dimension, ", ".join(spellings)))
    return table(("quantity", "units (and other spellings)"), rows)


def name_findings(function: ast.FunctionDef) -> Iterator[tuple[str, str]]:
    """Name, or "" where the call does not show it, and severity of each finding of a function."""
    texts = {
        ast.unparse(entry.targets[0]): entry.value
        for entry in ast.walk(function)
        if isinstance(entry, ast.Assign)
    }
    for call in ast.walk(function):
        if not isinstance(call, ast.Call):
            continue
        called = ast.unparse(call.func).removeprefix("check.")
        if called not in POSITION_OF_NAME:
            continue
        stated = {entry.arg: entry.value for entry in call.keywords}
        behind = dict(enumerate(call.args))
        name = stated.get("name", behind.get(POSITION_OF_NAME[called]))
        severity = stated.get("severity", behind.get(POSITION_OF_NAME[called] - 1))
        severities = list_words(severity, texts) & {"refuse", "warn", "note"}
        usual = "warn" if called == "finding_of_column" else "refuse"
        for word in list_words(name, texts) or {""}:
            yield word, " or ".join(sorted(severities)) or usual


def list_words(node: ast.expr | None, texts: dict[str, ast.expr]) -> set[str]:
    """Words that an expression can be, also one of a variable or of a choice between two."""
    if isinstance(node, ast.Name):
        node = texts.get(node.id)
    if isinstance(node, ast.IfExp):
        return list_words(node.body, texts) | list_words(node.orelse, texts)
    if isinstance(node, ast.Constant) and str(node.value).isidentifier():
        return {str(node.value)}
    return set()


def describe_findings() -> str:
    """Findings by name and severity, with the comments `# finding NAME: …` beside them."""
    meanings: dict[tuple[str, str], list[str]] = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "# finding " not in text:
            continue
        for function in ast.walk(ast.parse(text)):
            if not isinstance(function, ast.FunctionDef):
                continue
            source = ast.get_source_segment(text, function) or ""
            stated = {
                name: " ".join(meaning.replace("#", "").split())
                for name, meaning in FINDING.findall(source)
            }
            named = list(name_findings(function))
            for name, meaning in stated.items():
                exact = [severity for word, severity in named if word == name]
                for severity in exact or [severity for word, severity in named if not word]:
                    found = meanings.setdefault((name, severity), [])
                    found += [] if meaning in found else [meaning]
    rows = [
        (f"`{name}`", severity, "; ".join(found)) for (name, severity), found in meanings.items()
    ]
    return table(("name", "severity", "what it is"), sorted(rows))


PARTS = {
    "keys": describe_keys,
    "profile": describe_profile,
    "commands": describe_commands,
    "units": describe_units,
    "findings": describe_findings,
}


def insert_parts(app: Sphinx, name: str, source: list[str]) -> None:  # noqa: ARG001 (Sphinx's signature)
    """Put what the code states into a page."""
    source[0] = MARK.sub(lambda mark: PARTS[mark[1]](), source[0])


if __name__ == "__main__":
    for part in sys.argv[1:]:
        click.echo(PARTS[part]())

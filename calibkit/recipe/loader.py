"""Strict loader of recipes: every fault at once, each with file, line, value, allowed set and the
closest known name.
"""

import codecs
import contextlib
import hashlib
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from calibkit.errors import RecipeError, UsageError, did_you_mean
from calibkit.recipe.tables import Recipe
from calibkit.records.frame import CANONICAL, is_canonical

LARGEST_BYTES = 10_000_000
"""Of a recipe, a profile or a mark: the shipped ones have some thousands."""
_KEY = re.compile(
    r"""^\s*((?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*'))*)\s*="""
)
_QUOTED = re.compile(
    r""""{3}(?:\\.|[^\\])*?"{3}|'{3}.*?'{3}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|#[^\n]*""", re.DOTALL
)
"""Strings and comments of a TOML text."""
_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]\]?")

_CHANGE = "change it or remove it"

Location = tuple[str | int, ...]
AnyTable = TypeVar("AnyTable", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Source:
    """A recipe as it was written: its name, its text, and what the command line changed in it."""

    name: str
    text: str
    overrides: tuple[str, ...] = ()

    @property
    def sha256(self) -> str:
        """Digest of the text and, behind it, one line per override."""
        lines = (f"# --set {override}\n" for override in self.overrides)
        return hashlib.sha256("".join((self.text, *lines)).encode()).hexdigest()

    def table(self, model: type[AnyTable]) -> AnyTable:
        """Turn a TOML text into any strict record, or raise RecipeError with every fault, one a
        line.
        """
        return _validate(self, model, *_read_tables(self))

    def located(self, error: RecipeError) -> RecipeError:
        """The same error with file and line of the key that is at fault, where it names one."""
        if not error.at:
            return error
        _, lines = _read_tables(self)
        return RecipeError(
            f"{_format_place(self, error.at, lines)}: {error.message}", hint=error.hint
        )

    @contextlib.contextmanager
    def placing(self) -> Iterator[None]:
        """Name file and line of the recipe's key in errors that the logs gave rise to."""
        try:
            yield
        except RecipeError as error:
            raise self.located(error) from None


def shipped() -> dict[str, Path]:
    """Name → file of the recipes that come with calibkit, installed or in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "recipes", package.parent / "recipes"):
        if folder.is_dir():
            return {path.stem: path for path in sorted(folder.glob("*.toml"))}
    return {}


def read_limited(path: Path) -> bytes:
    """Bytes of a recipe, profile or image, also of a stream; RecipeError where there are too many.
    Raises OSError.
    """
    with path.open("rb") as stream:
        content = stream.read(LARGEST_BYTES + 1)
    if len(content) > LARGEST_BYTES:
        raise RecipeError(
            f"{path}: more than {LARGEST_BYTES / 1e6:g} MB, expected at most that",
            hint="name a recipe, a profile or an image",
        )
    return content


def find(name: str, overrides: tuple[str, ...] = ()) -> Source:
    """Find a recipe by file or by the name of a shipped one, or raise UsageError with the names
    there are.
    """
    path = Path(name)
    if not path.is_file():
        recipes = shipped()
        if name not in recipes:
            raise UsageError(
                f"recipe '{name}' is neither a file nor a shipped recipe",
                hint=f"{did_you_mean(name, recipes, '')} shipped: {', '.join(recipes)}".lstrip(),
            )
        path = recipes[name]
    return Source(path.name, read_utf8(path, "save the recipe as UTF-8"), overrides)


def read_utf8(path: Path, hint: str) -> str:
    """Text of a recipe or profile, with LF line ends; RecipeError where it cannot be read."""
    try:
        content = read_limited(path)
        # PowerShell's > writes UTF-16
        utf_16 = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = content.decode("utf-16" if utf_16 else "utf-8-sig")
    except OSError as error:
        advice = "see its name and folder" if isinstance(error, FileNotFoundError) else hint
        raise RecipeError(f"{path}: cannot be read: {error.strerror}", hint=advice) from None
    except UnicodeDecodeError as error:
        raise RecipeError(f"{path}: cannot be read as UTF-8 text: {error}", hint=hint) from None
    return text.replace("\r\n", "\n")


class _Kind(Protocol):
    """What the recipes of a procedure are read into."""

    Recipe: type[Recipe]
    """Record that the recipe must fill."""


def parse(source: Source, kinds: Mapping[str, _Kind]) -> Recipe:
    """Turn a recipe's text into its frozen record, or raise RecipeError with every fault, one a
    line; `kinds` are the known procedures.
    """
    data, lines = _read_tables(source)
    procedure = data.get("procedure")
    if not isinstance(procedure, str) or procedure not in kinds:
        procedure_text = "missing" if procedure is None else repr(procedure)
        raise RecipeError(
            f"{_format_place(source, ('procedure',), lines)}: procedure: found {procedure_text},"
            f" expected one of {', '.join(sorted(kinds))}",
            hint=did_you_mean(str(procedure), kinds, "name one of them"),
        )
    recipe = _validate(source, kinds[procedure].Recipe, data, lines)
    # a misspelt column would be read by nothing, and lose its unit and sign
    recipe_columns = recipe.own_columns()
    patterns = ("gyro_x_dph", "gyro_x_lsb", "accel_x_g", "accel_x_lsb")
    valid_names = [*CANONICAL, *patterns, *recipe_columns]
    faults = [
        f"{_format_place(source, ('columns', name), lines)}: columns.{name}: not a canonical"
        f" column; {did_you_mean(name, valid_names, _CHANGE)}"
        for name in recipe.columns
        if not is_canonical(name) and name not in recipe_columns
    ]
    if faults:
        raise RecipeError("\n".join(faults))
    return recipe


def _read_tables(source: Source) -> tuple[dict[str, Any], dict[Location, str]]:
    """Tables of a TOML text with the command line's overrides, and where each key stands."""
    try:
        data: dict[str, Any] = tomllib.loads(source.text)
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"at line (\d+)", str(error))
        place = f"{source.name}:{line.group(1)}" if line else source.name
        raise RecipeError(
            f"{place}: not TOML: {error}", hint="see the shipped recipes for the syntax"
        ) from None
    lines = _key_lines(source.text)
    for override in source.overrides:
        lines |= _apply_override(data, override)
    return data, lines


def _validate(
    source: Source, model: type[AnyTable], data: dict[str, Any], lines: Mapping[Location, str]
) -> AnyTable:
    """Record of the tables, or RecipeError with one line for each place that has a fault; the
    alternatives that a place allows are joined.
    """
    grouped: dict[Location, list[dict[str, Any]]] = {}
    try:
        return model.model_validate(data)
    except ValidationError as error:
        for fault in error.errors():
            # parts of these names are the branches of a union that were tried
            location = tuple(
                part
                for part in fault["loc"]
                if part not in {"int", "float", "str"}
                and not str(part).startswith(("literal[", "constrained-", "tuple["))
            )
            grouped.setdefault(location, []).append(dict(fault))
    raise RecipeError(
        "\n".join(
            _describe_fault(_format_place(source, location, lines), location, faults, model)
            for location, faults in grouped.items()
        )
    )


def _key_lines(text: str) -> dict[Location, str]:
    """Location of every table and key of a TOML text → its line number, as text."""
    lines: dict[Location, str] = {}
    table: Location = ()
    counts: dict[Location, int] = {}
    # a line within a string of several lines, or within a list, is no key and no table
    bare = _QUOTED.sub(lambda quoted: "[" + "\n" * quoted[0].count("\n") + "]", text).split("\n")
    depth = 0
    for number, (line, bare_line) in enumerate(zip(text.split("\n"), bare, strict=True), start=1):
        inside = depth > 0
        depth += sum(map(bare_line.count, "[{")) - sum(map(bare_line.count, "]}"))
        if inside:
            continue
        if header := _HEADER.match(line):
            path = _split_key(header.group(2))
            if header.group(1) == "[[":
                index = counts.get(path, 0)
                counts[path] = index + 1
                table = (*path, index)
            else:
                table = path
            lines.setdefault(path, str(number))
            lines.setdefault(table, str(number))
        elif key := _KEY.match(line):
            lines.setdefault((*table, *_split_key(key.group(1))), str(number))
    return lines


def _split_key(dotted: str) -> Location:
    """Parts of a dotted TOML key, without their quotes."""
    parts = re.findall(r"\"([^\"]*)\"|'([^']*)'|([A-Za-z0-9_-]+)", dotted)
    return tuple(map("".join, parts))


def _apply_override(data: dict[str, Any], override: str) -> dict[Location, str]:
    """Apply one `table.key=value` of the command line and say where a fault in it is."""
    key, separator, value = override.partition("=")
    path = _split_key(key.strip())
    if not separator or not path:
        raise UsageError(
            f"--set {override}: expected table.key=value", hint="for example --set drift.order=2"
        )
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value
    node: Any = data
    for part in path[:-1]:
        node = node.setdefault(str(part), {})
        if not isinstance(node, dict):
            raise UsageError(
                f"--set {override}: '{part}' is not a table",
                hint="name the table, a dot, and the key",
            )
    node[str(path[-1])] = parsed
    return {path: f"--set {override}"}


def _format_place(source: Source, location: Location, lines: Mapping[Location, str]) -> str:
    """file:line of the closest place that is written, or the command line's own words."""
    for end in range(len(location), 0, -1):
        line = lines.get(location[:end])
        if line is not None:
            return line if line.startswith("--set") else f"{source.name}:{line}"
    return source.name


def _describe_fault(
    place: str, location: Location, faults: list[dict[str, Any]], model: type[BaseModel]
) -> str:
    """One line for one place: where, what was found, what was expected, what to do."""
    dotted = ".".join(str(part) for part in location)
    kind, value = faults[0]["type"], faults[0]["input"]
    if kind == "extra_forbidden":
        valid_keys = _allowed_keys(model, location[:-1])
        return (
            f"{place}: unknown key '{dotted}' = {value!r}, allowed: {', '.join(valid_keys)};"
            f" {did_you_mean(str(location[-1]), valid_keys, _CHANGE)}"
        )
    if kind == "missing":
        return f"{place}: missing key '{dotted}'; add it"
    if kind == "value_error":
        return f"{place}: {dotted or 'table'}: {faults[0]['msg'].removeprefix('Value error, ')}"
    expectations: dict[str, None] = {}
    for fault in faults:
        expectation = fault["msg"].removeprefix("Input should be ")
        for pattern, words in _PLAIN:
            if re.fullmatch(pattern, expectation):
                expectation = re.sub(pattern, words, expectation)
                break
        expectations[expectation] = None
    expected = " or ".join(expectations)
    advice = "change it"
    if isinstance(value, str):
        advice = did_you_mean(value, re.findall(r"'([^']+)'", expected), _CHANGE)
    return f"{place}: {dotted}: found {value!r}, expected {expected}; {advice}"


_PLAIN = (
    (r"a valid (tuple|list|set)\b.*", "a list in brackets"),
    (r"a valid (dictionary|mapping)\b.*", "a table"),
    (r"a valid string", "text in quotes"),
    (r"a valid integer.*", "a whole number"),
    (r"a valid number.*", "a number"),
    (r"a finite number", "a finite number"),
    (r"a valid boolean.*", "true or false"),
    (r"(?:Tuple|List) should have at least (\d+) items?.*", r"at least \1 entries in the list"),
    (r"String should have at least 1 character", "text that is not empty"),
    (r"String should match pattern '(.*)'", r"text of the form \1"),
)
"""What the validator expected, in its words → in words of TOML."""


def _allowed_keys(model: type[BaseModel], location: Location) -> list[str]:
    """Keys that the table at a location may hold."""
    current: Any = model
    for part in location:
        current = _member_type(current, part)
        options = get_args(current)
        tables = [
            kind for kind in options if isinstance(kind, type) and issubclass(kind, BaseModel)
        ]
        if len(tables) == 1 and type(None) in options:  # a table that may be absent
            current = tables[0]
    if isinstance(current, type) and issubclass(current, BaseModel):
        return [field.alias or name for name, field in current.model_fields.items()]
    return []


def _member_type(annotation: Any, part: str | int) -> Any:  # noqa: ANN401 (walks type annotations, which have no common type)
    """Type of the member `part` of a table, an array of tables, or a table of tables."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        field = next(
            (f for name, f in annotation.model_fields.items() if part in (name, f.alias)), None
        )
        return field.annotation if field else None
    if get_origin(annotation) is tuple:
        return get_args(annotation)[0]
    return get_args(annotation)[-1] if get_origin(annotation) is dict else None

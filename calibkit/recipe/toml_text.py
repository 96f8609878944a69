"""Recipes of Python tables as the TOML text that a file of them would have."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from calibkit.errors import RecipeError
from calibkit.recipe.loader import Source


def from_tables(tables: Mapping[str, Any], overrides: tuple[str, ...] = ()) -> Source:
    """Recipe of nested tables, lists and values; RecipeError for a value that TOML has not."""
    return Source("recipe", "\n".join(_write_table(tables, ())) + "\n", overrides)


def write_overrides(settings: Mapping[str, object]) -> tuple[str, ...]:
    """Settings of Python as those of the command line: a double underscore is the dot."""
    return tuple(
        f"{key.replace('__', '.')}={write_value(value)}" for key, value in settings.items()
    )


def _write_table(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    """Lines of a table: its own values first, then the tables in it."""
    inner = {}
    for key, value in table.items():
        if isinstance(value, Mapping) or _is_list_of_tables(value):
            inner[key] = value
        else:
            yield f"{write_key(key)} = {write_value(value)}"
    for key, value in inner.items():
        place = (*path, write_key(key))
        is_array = not isinstance(value, Mapping)
        for inner_table in value if is_array else [value]:
            yield ("[[{}]]" if is_array else "[{}]").format(".".join(place))
            yield from _write_table(inner_table, place)


def _is_list_of_tables(value: object) -> bool:
    """Whether a value is a list of nothing but tables."""
    if not isinstance(value, list | tuple) or not value:
        return False
    return all(isinstance(item, Mapping) for item in value)


def write_key(key: str) -> str:
    """A key, in quotes where it needs them."""
    import tomlkit

    return tomlkit.key(key).as_string()


def write_value(value: object) -> str:
    """A value on one line; RecipeError for one that TOML has not."""
    import tomlkit

    if hasattr(value, "tolist"):  # a number or an array of numpy's
        value = value.tolist()
    if isinstance(value, Mapping):
        pairs = (f"{write_key(key)} = {write_value(item)}" for key, item in value.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, str | bytes):
        return f"[{', '.join(map(write_value, value))}]"
    try:
        return tomlkit.item(value).as_string()
    except ValueError:
        raise RecipeError(
            f"recipe: {value!r:.60} is {type(value).__name__}, expected text, a number, a truth"
            " value, a date, a list or a table",
            hint="leave the key out to have its default",
        ) from None

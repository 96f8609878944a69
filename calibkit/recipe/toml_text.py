"""Recipes of Python tables as the TOML text that a file of them would have."""

import datetime as dt
from collections.abc import Mapping, Sequence
from typing import Any

from calibkit.errors import RecipeError
from calibkit.recipe.loader import Source


def from_tables(tables: Mapping[str, Any], overrides: tuple[str, ...] = ()) -> Source:
    """Recipe of nested tables, lists and values; RecipeError for a value that TOML has not."""
    import tomlkit

    return Source("recipe", tomlkit.dumps(_plain(tables)), overrides)


def write_overrides(settings: Mapping[str, object]) -> tuple[str, ...]:
    """Settings of Python as those of the command line: a double underscore is the dot."""
    return tuple(
        f"{key.replace('__', '.')}={write_value(value)}" for key, value in settings.items()
    )


def write_value(value: object) -> str:
    """A value on one line; RecipeError for one that TOML has not."""
    import tomlkit

    plain = _plain(value)
    if isinstance(plain, dict):
        pairs = (f"{tomlkit.key(key).as_string()} = {write_value(v)}" for key, v in plain.items())
        return f"{{{', '.join(pairs)}}}"
    if isinstance(plain, list):
        return f"[{', '.join(map(write_value, plain))}]"
    return str(tomlkit.item(plain).as_string())


def _plain(value: Any) -> Any:  # noqa: ANN401 (any value of Python)
    """A value in the types that TOML has; RecipeError for another."""
    if hasattr(value, "tolist"):  # a number or an array of numpy's
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, str | bytes):
        return [_plain(item) for item in value]
    if not isinstance(value, str | int | float | dt.date | dt.time):
        raise RecipeError(
            f"recipe: {value!r:.60} is {type(value).__name__}, expected text, a number, a truth"
            " value, a date, a list or a table",
            hint="leave the key out to have its default",
        )
    return value

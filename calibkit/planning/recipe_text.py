"""The recipe by which the logs of a planned campaign are fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.recipe import toml_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from calibkit.recipe import Recipe
    from calibkit.recipe.tables import ErrorComponent

_OF_OTHER_LOGS = ("exclude", "segment", "correction", "serial")
"""Tables and keys of a recipe that belong to the logs it was written for."""


def write_recipe(
    spec: Recipe,
    files: Sequence[str],
    components: Sequence[ErrorComponent],
    changes: Mapping[str, Any],
    *,
    added: bool,
) -> str:
    """Text of a recipe for the logs of a plan, with the errors that were assumed; `changes` are
    keys and tables with other values. Logs that are `added` stand beside those that the recipe
    reads already.
    """
    stated = spec.model_dump(mode="json", by_alias=True, exclude_unset=True)
    others = () if added else _OF_OTHER_LOGS
    tables = {name: value for name, value in stated.items() if name not in others}
    own = tables["logs"]["files"] if added else []
    tables["logs"] = {**tables["logs"], "files": [*own, *files]}
    if components:
        assumed = [one.model_dump(mode="json") for one in components]
        tables["errors"] = {**tables.get("errors", {}), "component": assumed}
    for name, value in changes.items():
        tables[name] = {**tables.get(name, {}), **value} if isinstance(value, dict) else value
    head = "# Written by calibkit plan: the recipe of the plan, with the errors that it assumes.\n"
    return head + "\n".join(_lines(tables)) + "\n"


def _lines(tables: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """Lines of TOML: keys first, then tables, then arrays of tables."""
    for name, value in tables.items():
        if not _is_table(value) and not _is_array_of_tables(value):
            yield f"{toml_text.write_key(name)} = {toml_text.write_value(value)}"
    for name, value in tables.items():
        full = f"{path}{toml_text.write_key(name)}"
        if _is_table(value):
            yield f"\n[{full}]"
            yield from _lines(value, f"{full}.")
        elif _is_array_of_tables(value):
            for one in value:
                yield f"\n[[{full}]]"
                yield from _lines(one, f"{full}.")


def _is_table(value: object) -> bool:
    return isinstance(value, dict)


def _is_array_of_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(map(_is_table, value))

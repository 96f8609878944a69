"""The recipe by which the logs of a planned campaign are fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit.recipe import toml_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.planning.proposal import Design
    from calibkit.recipe import Recipe
    from calibkit.recipe.tables import ErrorComponent

HEAD = "# Written by calibkit plan: the recipe of the plan, with the errors that it assumes.\n"
_OF_OTHER_LOGS = ("exclude", "segment", "correction", "serial")
"""Tables and keys of a recipe that belong to the logs it was written for."""


def write_recipe(
    spec: Recipe, design: Design, components: Sequence[ErrorComponent], *, added: bool
) -> str:
    """Text of a recipe for the logs of a design, with the errors that were assumed. Logs that are
    `added` stand beside those that the recipe reads already.
    """
    tables = spec.model_dump(mode="json", by_alias=True, exclude_unset=True)
    files = list(design.logs)
    if added:
        files = [*tables["logs"]["files"], *files]
    else:
        tables = {name: value for name, value in tables.items() if name not in _OF_OTHER_LOGS}
    tables["logs"] = {**tables["logs"], "files": files}
    if components:
        assumed = [one.model_dump(mode="json") for one in components]
        tables["errors"] = {**tables.get("errors", {}), "component": assumed}
    for name, value in design.changes.items():
        tables[name] = {**tables.get(name, {}), **value} if isinstance(value, dict) else value
    # a line begins with a bracket where a table does
    return HEAD + toml_text.from_tables(tables).text.replace("\n[", "\n\n[")

"""A log written again, row for row and column for column, with some of its columns replaced."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.readers import delimited
from calibkit.stages.ingest import unmapped

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from calibkit.recipe import Recipe


def replaced(
    recipe: Recipe,
    path: Path,
    columns: Mapping[str, NDArray[np.float64]],
    derived: Mapping[str, NDArray[np.float64]] | None = None,
) -> bytes:
    """Bytes of a log with canonical columns replaced, in the log's own unit and sign, and derived ones added behind.

    Every other field keeps its own characters. A reference column that a derived one would shadow is renamed
    reference_<column>. Numbers are written with the fewest digits that read back to the same float64.
    """
    header, body = delimited.split(path.read_bytes(), path.name)
    position = {name: header.index(_source(recipe, name)) for name in columns}
    texts = {position[name]: _texts(_own_unit(recipe, name, values)) for name, values in columns.items()}
    added = derived or {}
    names = [f"reference_{name}" if name in added else name for name in header]
    lines = [",".join([*names, *added])]
    extra = [_texts(values) for values in added.values()]
    for row, line in enumerate(body.decode().rstrip("\n").split("\n")):
        fields = line.split(",")
        for column, text in texts.items():
            fields[column] = text[row]
        lines.append(",".join([*fields, *(text[row] for text in extra)]))
    return ("\n".join(lines) + "\n").encode()


def _source(recipe: Recipe, name: str) -> str:
    """Name that a canonical column has in the log."""
    return recipe.columns[name].source if name in recipe.columns else name


def _own_unit(recipe: Recipe, name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values in the unit and sign that the log's own column has."""
    return unmapped(values, recipe.columns[name], name, recipe) if name in recipe.columns else values


def _texts(values: NDArray[np.float64]) -> list[str]:
    """Shortest texts that read back to the same numbers; a missing value is an empty field."""
    return ["" if np.isnan(value) else repr(value) for value in values.tolist()]

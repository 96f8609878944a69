"""Logs as they are on disk → tidy frames, by the recipe's mapping and exclusions."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

import numpy as np

from calibkit import units
from calibkit.errors import FrameError, RecipeError, UsageError
from calibkit.frame import Log, is_canonical, require
from calibkit.readers import delimited

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.recipe import Column, Exclude, Recipe


def find_logs(recipe: Recipe, folder: Path) -> list[str]:
    """Names, relative to the data folder, of the logs that the recipe's patterns match, in order."""
    if not folder.is_dir():
        raise UsageError(f"--data {folder}: no such folder", hint="name the folder that holds the logs")
    found: list[str] = []
    for pattern in recipe.logs.files:
        matches = sorted(path.relative_to(folder).as_posix() for path in folder.glob(pattern) if path.is_file())
        if not matches:
            there = ", ".join(sorted(path.name for path in folder.iterdir())[:8]) or "nothing"
            raise FrameError(
                f"{folder}: no log matches '{pattern}', found {there}",
                hint="check --data, or [logs] files in the recipe",
            )
        found += [match for match in matches if match not in found]
    skipped = {exclude.log for exclude in recipe.exclude if exclude.from_s is None and exclude.to_s is None}
    _known_exclusions(recipe, found)
    kept = [name for name in found if not skipped & {name, log_name(name)}]
    if not kept:
        raise FrameError(f"{folder}: every log is excluded by the recipe", hint="remove an [[exclude]] table")
    return kept


def _known_exclusions(recipe: Recipe, found: Sequence[str]) -> None:
    """Refuse an exclusion of a log that is not there."""
    known_logs("[[exclude]] log", [exclude.log for exclude in recipe.exclude], found)


def known_logs(where: str, names: Iterable[str], found: Sequence[str]) -> None:
    """Refuse a recipe that names a log which is not there: a typing error would let bad data in."""
    there = {*found, *map(log_name, found)}
    for name in names:
        if name not in there:
            close = difflib.get_close_matches(name, sorted(there), n=1)
            guess = f"did you mean '{close[0]}'?" if close else f"logs: {', '.join(found)}"
            raise RecipeError(f"{where} = '{name}': no such log", hint=guess)


def log_name(file: str) -> str:
    """Name of a log: its file without the suffix."""
    return file.rsplit(".", 1)[0]


def read_log(recipe: Recipe, path: Path, file: str, needed: Sequence[str], optional: Sequence[str] = ()) -> Log:
    """Read one log and map it to canonical columns; raises LogFormatError, FrameError or RecipeError."""
    sources = {name: column.source for name, column in recipe.columns.items()}
    wanted = {sources.get(name, name) for name in (*needed, *optional)}
    table = delimited.read(path, file, wanted)
    present = [name for name in (*needed, *optional) if sources.get(name, name) in table.frame.columns]
    for name, source in sources.items():
        if source not in table.frame.columns and name in needed:
            require(file, table.frame.columns, [source])
    require(file, dict.fromkeys([*table.frame.columns, *present]), needed)
    frame = table.frame[[sources.get(name, name) for name in present]].set_axis(present, axis=1)
    for name in present:
        if name in recipe.columns:
            frame[name] = _mapped(frame[name].to_numpy(dtype=np.float64), recipe.columns[name], name, recipe)
    frame, notes = _without_exclusions(frame, recipe.exclude, file)
    return Log(log_name(file), file, table.sha256, len(table.frame), frame, (*table.notes, *notes))


def _mapped(raw: np.ndarray, column: Column, name: str, recipe: Recipe) -> np.ndarray:
    """Canonical values of a mapped column: sign · (scale · raw + offset), converted to the unit of its name."""
    target = units.column_unit(name)
    stated = raw * column.scale + column.offset
    converted = units.convert(stated, column.unit or target, target, gravity_mps2=recipe.site.gravity_mps2)
    return column.sign * converted


def unmapped(values: np.ndarray, column: Column, name: str, recipe: Recipe) -> np.ndarray:
    """Values of a canonical column in the log's own unit and sign: the inverse of the mapping."""
    target = units.column_unit(name)
    stated = units.convert(column.sign * values, target, column.unit or target, gravity_mps2=recipe.site.gravity_mps2)
    return (stated - column.offset) / column.scale


def _without_exclusions(
    frame: pd.DataFrame, excludes: Sequence[Exclude], file: str
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The frame without the ranges that the recipe leaves out; the index keeps counting the file's rows."""
    notes = []
    for exclude in excludes:
        if exclude.log not in (file, log_name(file)) or (exclude.from_s is None and exclude.to_s is None):
            continue
        require(file, frame.columns, ["time_s"])
        low = -np.inf if exclude.from_s is None else exclude.from_s
        high = np.inf if exclude.to_s is None else exclude.to_s
        out = frame["time_s"].between(low, high)
        if not out.any():
            raise RecipeError(
                f"[[exclude]] of {file}: no row between {low:g} s and {high:g} s", hint="check from_s and to_s"
            )
        frame = frame[~out]
        notes.append(
            f"{int(out.sum())} rows from {low:g} s to {high:g} s excluded by {exclude.person}: {exclude.reason}"
        )
    return frame, tuple(notes)


def mapped_names(recipe: Recipe) -> None:
    """Refuse a mapping to a column that nothing understands."""
    for name in recipe.columns:
        if not is_canonical(name):
            raise RecipeError(
                f"[columns.{name}]: not a canonical column", hint="see the list of columns in the documentation"
            )

"""Logs that are split over numbered files: dat00001.csv, dat00002.csv, … are one log.

Format: files whose names differ only in the digits before the suffix, in the order of that number
and without a gap; each in the same format with the same columns. The digest of a split log is that
of its files' bytes one after another.
"""

from __future__ import annotations

import hashlib
import itertools
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import LogFormatError
from calibkit.readers import in_memory, registry
from calibkit.readers.keysight import SCAN_NUMBERS

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence
    from pathlib import Path

    from calibkit.numeric.arrays import Integers
    from calibkit.readers.table import Table
    from calibkit.recipe.logs import Logs

_NUMBERED = re.compile(r"(?P<stem>.*?)(?P<number>\d+)(?P<suffix>\.[^.]*)?")


def group_parts(files: Sequence[str]) -> list[list[str]]:
    """Group files into logs, the parts of each in the order of their numbers; a file without a
    number is a log by itself.
    """
    logs: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for file in files:
        numbered = _NUMBERED.fullmatch(file)
        key = (numbered["stem"], numbered["suffix"] or "") if numbered else (file, "")
        logs.setdefault(key, []).append((int(numbered["number"]) if numbered else 0, file))
    return [[file for _, file in sorted(parts)] for parts in logs.values()]


def _find_parts(path: Path, file: str) -> list[str]:
    """Files of the split log whose first part is given; raises LogFormatError where one in between
    is missing.
    """
    folder = file.rpartition("/")[0]
    siblings = [
        f"{folder}/{p.name}" if folder else p.name for p in path.parent.iterdir() if p.is_file()
    ]
    parts = next((parts for parts in group_parts(sorted(siblings)) if file in parts), [file])
    numbered_parts = map(_NUMBERED.fullmatch, parts)
    numbers = [int(numbered["number"]) for numbered in numbered_parts if numbered]
    for (number, part), after in zip(zip(numbers, parts, strict=False), numbers[1:], strict=False):
        if after != number + 1:
            raise LogFormatError(
                f"{part}: the next part of this log is number {after}, expected {number + 1}",
                hint="a part of the log is missing; add it, or set [logs] split = false",
            )
    return parts


def digest_log(path: Path, file: str, *, split: bool) -> str:
    """SHA-256 of a log's bytes, of all parts one after another where it is split."""
    table_in_memory = in_memory.find(path)
    if table_in_memory is not None:
        return table_in_memory.sha256
    parts = _find_parts(path, file) if split else [file]
    sha256 = hashlib.sha256()
    for part in parts:
        with (path.parent / part.rpartition("/")[2]).open("rb") as stream:
            hashlib.file_digest(
                stream, lambda: sha256
            )  # goes on with the digest of the parts before
    return sha256.hexdigest()


def read(path: Path, file: str, logs: Logs, required_columns: Collection[str]) -> Table:
    """Read all parts of a split log as one table, or raise LogFormatError that names the part and
    the line.
    """
    import pandas as pd

    parts = [file] if in_memory.find(path) else _find_parts(path, file)
    tables = [
        registry.read(path.parent / part.rpartition("/")[2], part, logs, required_columns)
        for part in parts
    ]
    if len(tables) == 1:
        return tables[0]
    first, frames, begins, offset = tables[0], [], [], 0
    numbers: list[Integers] = []
    for table in tables:
        if list(table.frame.columns) != list(first.frame.columns):
            raise LogFormatError(
                f"{table.file}: columns {', '.join(map(str, table.frame.columns[:8]))}, expected"
                f" those of {first.file}",
                hint=(
                    "parts of one log have the same columns; set [logs] split = false for logs of"
                    " their own"
                ),
            )
        frames.append(table.frame.set_axis(table.frame.index + offset))
        begins.append((table.file, offset))
        offset = int(frames[-1].index[-1]) + 2
        # among the rows of all parts, torn ones counted
        rows = np.arange(len(table.frame)) if table.numbers is None else table.numbers
        numbers.append(rows + (int(numbers[-1][-1]) + 1 if numbers else 0))
    any_torn = any(table.numbers is not None for table in tables)
    notes = [f"{table.file}: {note}" for table in tables for note in table.notes]
    name = str(first.frame.columns[0])
    for before, after in itertools.pairwise(tables if name.lower() in SCAN_NUMBERS else ()):
        ends = before.frame[name], after.frame[name]
        if ends[0].dtype.kind == "f" == ends[1].dtype.kind:
            last, following = float(ends[0].iloc[-1]), float(ends[1].iloc[0])
            if following != last + 1 and np.isfinite(following + last):
                notes.append(
                    f"scan numbers jump from {last:g} in {before.file} to {following:g} in"
                    f" {after.file}"
                )
    return replace(
        first,
        sha256=digest_log(path, file, split=True),
        frame=pd.concat(frames),
        notes=tuple(notes),
        reading=(
            f"{len(parts)} parts, {parts[0]} to {parts[-1]}",
            *dict.fromkeys(text for table in tables for text in table.reading),
        ),
        parts=tuple(begins),
        left_out=tuple(
            line + begin for k, (_, begin) in enumerate(begins) for line in tables[k].left_out
        ),
        numbers=np.concatenate(numbers) if any_torn else None,
    )

"""The record that every reader returns: a log before any mapping."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

    from calibkit.libraries.plugins import Plugin
    from calibkit.numeric.arrays import Integers

FIRST_ROW = 2
"""Line of a file that holds its first row where one header line stands above; a frame's index
counts from there.
"""


class Guess(str):
    """A sentence on how a log was read that states what was guessed, not taken from a recipe."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Table:
    """A log before any mapping: the SHA-256 of its bytes, its columns, notes on its content, and
    how it was read.

    The frame's index is the line (or record) of the file minus 2, so that every row can be found
    again; `units` holds the unit that the log itself states of a column; `reading` is how the file
    was read, each guess a `Guess`; `parts` are the files of a split log, each with the number that
    was added to its index; `plugins` are those that read it; `decimal` is the decimal mark of its
    texts; `left_out` are lines that are no rows and that the recipe's exclusions leave out;
    `numbers` are those of the rows among all rows of the log, from 0, where torn ones are left out.
    """

    file: str
    sha256: str
    frame: pd.DataFrame
    notes: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    parts: tuple[tuple[str, int], ...] = ()
    plugins: tuple[Plugin, ...] = ()
    decimal: str = "."
    left_out: tuple[int, ...] = ()
    numbers: Integers | None = None

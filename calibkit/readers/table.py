"""What every reader returns: a log before any mapping."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

FIRST_ROW = 2
"""Line of a file that holds its first row where one header line stands above; a frame's index
counts from there.
"""


@dataclass(frozen=True, slots=True)
class Table:
    """A log before any mapping: its bytes' digest, its names and numbers, what was noted, and how
    it was read.

    The frame's index is the line (or record) of the file minus 2, so that every row can be found
    again; `units` holds what the log itself says of a column's unit; `reading` is how the file was
    read, guesses named as such; `parts` are the files of a split log, each with what its own index
    was raised by.
    """

    file: str
    sha256: str
    frame: pd.DataFrame
    notes: tuple[str, ...] = ()
    reading: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    parts: tuple[tuple[str, int], ...] = ()

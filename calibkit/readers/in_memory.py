"""Frames that stand for the files of a data folder while a command works on them: logs that are on
no disk.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from calibkit import units
from calibkit.errors import FrameError
from calibkit.readers.table import Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pandas as pd

UNITS = "units"
"""Key of `frame.attrs` whose value is column → unit."""
_HELD: dict[Path, Table] = {}
_FOLDERS = itertools.count(1)
_GIVE = "give {name of the log: frame}"


@contextlib.contextmanager
def hold(frames: Mapping[str, pd.DataFrame], patterns: Sequence[str]) -> Iterator[Path]:
    """Data folder of frames, which is there until the context ends; a frame has the name of a file
    that a recipe's patterns match, with or without its suffix.

    Raises FrameError for a name that no pattern matches, and for what is no frame of named columns.
    """
    folder, tables = Path(f"<frames {next(_FOLDERS)}>"), dict[Path, Table]()
    if not isinstance(frames, Mapping):
        raise FrameError(f"logs: found {_kind(frames)}", hint=_GIVE)
    if not frames:
        raise FrameError("logs: no frame", hint=_GIVE)
    for name, frame in frames.items():
        written = str(name)
        files = [
            file
            for pattern in patterns
            for file in (written, written + PurePosixPath(pattern).suffix)
            if "/" not in file and fnmatchcase(file, pattern)
        ]
        if not files:
            raise FrameError(
                f"logs: '{name}' is none of the logs that the recipe reads, {', '.join(patterns)}",
                hint="name it like one of them, with or without the suffix",
            )
        file = files[0]
        if folder / file in tables:
            raise FrameError(
                f"logs: '{name}' and a frame before it both stand for {file}",
                hint="give each log one name",
            )
        tables[folder / file] = _tabulate(file, frame)
    _HELD.update(tables)
    try:
        yield folder
    finally:
        for path in tables:
            del _HELD[path]


def _kind(value: object) -> str:
    """Type of what is no frame, for people."""
    return f"{type(value).__module__}.{type(value).__qualname__}".removeprefix("builtins.")


def _tabulate(file: str, frame: pd.DataFrame) -> Table:
    """A frame as a log before any mapping; its digest is that of its names and values."""
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        advice = "frame.to_pandas()" if hasattr(frame, "to_pandas") else "pandas.DataFrame(…)"
        raise FrameError(f"{file}: found {_kind(frame)}, expected a frame", hint=f"give {advice}")
    columns, attrs_units = list(map(str, frame.columns)), frame.attrs.get(UNITS, {})
    if len(set(columns)) < len(columns) or not columns:
        raise FrameError(
            f"{file}: columns {', '.join(columns) or 'none'}", hint="give each column its own name"
        )
    if not isinstance(attrs_units, Mapping):
        raise FrameError(
            f"{file}: attrs['{UNITS}'] is {_kind(attrs_units)}", hint="give {column: unit}"
        )
    table = frame.set_axis(columns, axis=1).reset_index(drop=True)
    sha256 = hashlib.sha256()
    for name in columns:
        column = table[name]
        if column.dtype.kind in "iuf":
            content = column.to_numpy(dtype="<f8").tobytes()
        else:
            table[name] = column = column.astype(str).fillna("")
            content = "\n".join(column).encode()
        sha256.update(f"{name}\0{len(content)}\0".encode() + content)
    column_units = {str(name): str(unit) for name, unit in attrs_units.items()}
    return Table(file, sha256.hexdigest(), table, units=column_units)


def find(path: Path) -> Table | None:
    """Frame that stands for a file; None of a file on disk."""
    return _HELD.get(path)


def match(folder: Path, pattern: str) -> list[Path]:
    """Frames of a folder that a pattern matches; none of a folder on disk."""
    return [p for p in list(_HELD) if p.parent == folder and fnmatchcase(p.name, pattern)]


def label_units(frame: pd.DataFrame) -> pd.DataFrame:
    """The frame with the unit of each column whose name states one in `frame.attrs`."""
    last = {name: name.rpartition("_")[2] for name in map(str, frame.columns) if "_" in name}
    frame.attrs[UNITS] = {
        name: word if word in units.SHARES else units.column_unit(name)
        for name, word in last.items()
        if word in units.COLUMN_UNITS or word in units.SHARES
    }
    return frame

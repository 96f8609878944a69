"""Files and folders that are on the disk when they have their name, and what killed processes left
of those that never got one.
"""

import contextlib
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

UNFINISHED = ".writing-"
"""Start of the name of what is not finished."""
ABANDONED_S = 86_400.0
"""Seconds after which what is not finished belongs to a process that was killed: no write takes a
day.
"""


def write_synced(path: Path, content: bytes | Iterable[bytes]) -> None:
    """Write bytes, whole or as they come in parts, and wait until they are on the disk."""
    with path.open("wb") as stream:
        for part in (content,) if isinstance(content, bytes) else content:
            stream.write(part)
        stream.flush()
        os.fsync(stream.fileno())


def sync_folder(folder: Path) -> None:
    """Wait until a folder's entries are on the disk, where the system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def make_folder(folder: Path) -> None:
    """Make a folder with its parents and wait until their entries are on the disk; raises
    OSError.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in reversed(missing):
        sync_folder(path.parent)


def remove_abandoned(temporary: Path) -> None:
    """Remove what killed processes left beside a file or folder that was just begun: unfinished,
    and older by a day. Both times are those of the file system, whatever clock it has.
    """
    with contextlib.suppress(OSError):
        begun = temporary.stat().st_mtime
        for path in temporary.parent.glob(f"{UNFINISHED}*"):
            if begun - path.stat().st_mtime <= ABANDONED_S:
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()

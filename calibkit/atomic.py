"""Files that are on the disk when they are there, and a lock between processes."""

import contextlib
import errno
import hashlib
import logging
import os
import platform
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from calibkit.errors import OutputError, visible

_WAIT_S = 120.0
"""Seconds to wait for another process that holds a lock: it draws a report and writes a run folder
meanwhile.
"""
_PAUSE_S = 0.05
_BUSY = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)
"""Errors of a lock that another process holds; any other means that the file system has no locks.
"""

_REMOVABLE = os.name == "posix"
"""Whether an open file can be removed; where it cannot, as on Windows, an empty lock file stays and
keeps its name.
"""
_WRITING = ".writing-"
UNFINISHED = f"{_WRITING}{hashlib.sha256(platform.node().encode()).hexdigest()[:8]}-"
"""Start of the name of what this machine has not finished. Some network shares give every machine
locks of its own: what another one has begun is never removed.
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


@contextlib.contextmanager
def locked(path: Path, target: str, wait_s: float = _WAIT_S) -> Iterator[bool]:
    """Hold a lock file against other processes and threads; the system releases it when the process
    ends, killed or not, and nothing stays behind. Gives whether the system has locks there.

    Raises OutputError that names `what` where it cannot be made or is still held after wait_s [s].
    On a file system without locks the work goes on without one: renames that replace nothing keep
    the record whole, the lock only spares a second fit a refusal; what others have begun must then
    be left alone. (The library filelock ends with the system's error on ENOLCK, or leaves a marker
    there that outlives a killed process, and takes 0.2 s to import.)
    """
    handle, has_locks = _acquire(path, target, round(wait_s / _PAUSE_S))
    try:
        yield has_locks
    finally:
        if _REMOVABLE:
            with contextlib.suppress(OSError):
                path.unlink()
        os.close(handle)


def _acquire(path: Path, target: str, attempts: int) -> tuple[int, bool]:
    """File descriptor that holds the lock, and whether the system has locks."""
    for attempt in range(attempts + 1):
        if attempt:
            time.sleep(_PAUSE_S)
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise OutputError(
                f"{target}: cannot be written: {error.strerror}",
                hint="free space or give another --out",
            ) from None
        try:
            lock_state = take_lock(handle)
            if lock_state is not False and (not _REMOVABLE or _has_name(path, handle)):
                return handle, bool(lock_state)
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
    raise OutputError(
        f"{target} is being written by another calibkit",
        hint="wait until it has finished and run again",
    )


def list_unfinished(folder: Path) -> list[Path]:
    """Files and folders in a folder whose writing was begun, by whatever machine; none where it
    cannot be read.
    """
    try:
        paths = (path for path in folder.iterdir() if path.name.startswith(_WRITING))
        return sorted(paths, reverse=True)
    except OSError:
        return []


def hold_unfinished(path: Path) -> int | None:
    """File descriptor by which this process holds what it is writing until it closes it; None where
    an open file could not be renamed. Raises OSError, FileNotFoundError where it was taken away.
    """
    if not _REMOVABLE:
        return None
    handle = os.open(path, os.O_RDONLY)
    if take_lock(handle) is not False and _has_name(path, handle):
        return handle
    os.close(handle)
    raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))


def remove_abandoned(folder: Path) -> None:
    """Remove the files in a folder that a process of this machine was killed while writing; name
    those of which it is not known.
    """
    for path in list_unfinished(folder):
        if not path.is_file():
            continue
        lock_state, handle = None, None
        with contextlib.suppress(OSError):
            if _REMOVABLE and path.name.startswith(UNFINISHED):
                handle = os.open(path, os.O_RDONLY)
                lock_state = take_lock(handle)
            if lock_state:
                path.unlink()
        if lock_state is None:
            name_unfinished(path)
        if handle is not None:
            os.close(handle)


def name_unfinished(path: Path) -> None:
    """Name a file or folder that was left unfinished, or is being written."""
    logging.getLogger("calibkit").warning(
        "! %s: left by a calibkit that was killed, or being written by one on another machine or"
        " file system; remove it when none is running",
        visible(str(path)),
    )


def take_lock(handle: int) -> bool | None:
    """Whether the system gave this process the lock on a file; None where it has none to give."""
    try:
        return _system_lock(handle)
    except OSError as error:
        return False if error.errno in _BUSY else None


def _system_lock(handle: int) -> bool | None:
    """Take the system's lock on a file without waiting; None where it has no locks. Raises
    OSError.
    """
    try:
        import fcntl
    except ImportError:
        try:
            import msvcrt
        except ImportError:
            return None
        locking, without_waiting = vars(msvcrt)["locking"], vars(msvcrt)["LK_NBLCK"]
        locking(handle, without_waiting, 1)
    else:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return True


def _has_name(path: Path, handle: int) -> bool:
    """Whether the locked file still has its name: the one who held it before removed it."""
    try:
        return os.path.samestat(path.stat(), os.fstat(handle))
    except FileNotFoundError:
        return False

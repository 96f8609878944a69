"""Files that are on the disk when they are there, and a lock between processes."""

import contextlib
import errno
import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from calibkit.errors import OutputError

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
def locked(path: Path, what: str, wait_s: float = _WAIT_S) -> Iterator[None]:
    """Hold a lock file against other processes and threads; the system releases it when the process
    ends, killed or not, and nothing stays behind.

    Raises OutputError that names `what` where it cannot be made or is still held after wait_s [s].
    On a file system without locks the work goes on without one: renames that replace nothing keep
    the record whole, the lock only spares a second fit a refusal. (The library filelock refuses
    such a file system or leaves a marker there that outlives a killed process, leaves its lock
    files behind elsewhere, and takes 0.2 s to import.)
    """
    handle = _acquire(path, what, round(wait_s / _PAUSE_S))
    try:
        yield
    finally:
        if _REMOVABLE:
            with contextlib.suppress(OSError):
                path.unlink()
        os.close(handle)


def _acquire(path: Path, what: str, attempts: int) -> int:
    """File descriptor that holds the lock."""
    for attempt in range(attempts + 1):
        if attempt:
            time.sleep(_PAUSE_S)
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise OutputError(
                f"{what}: cannot be written: {error.strerror}",
                hint="free space or give another --out",
            ) from None
        try:
            if _take(handle) and (not _REMOVABLE or _has_name(path, handle)):
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
    raise OutputError(
        f"{what} is being written by another calibkit",
        hint="wait until it has finished and run again",
    )


def _take(handle: int) -> bool:
    """Whether the system gave this process the lock; True where it has none to give."""
    try:
        _system_lock(handle)
    except OSError as error:
        return error.errno not in _BUSY
    return True


def _system_lock(handle: int) -> None:
    """Take the system's lock on a file without waiting; nothing where it has no locks. Raises
    OSError.
    """
    try:
        import fcntl
    except ImportError:
        with contextlib.suppress(ImportError):
            import msvcrt

            locking, without_waiting = vars(msvcrt)["locking"], vars(msvcrt)["LK_NBLCK"]
            locking(handle, without_waiting, 1)
    else:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _has_name(path: Path, handle: int) -> bool:
    """Whether the locked file still has its name: the one who held it before removed it."""
    try:
        return os.path.samestat(path.stat(), os.fstat(handle))
    except FileNotFoundError:
        return False

"""Files that are written whole where nothing stands: one, or several that belong together.

Nothing is overwritten, and nothing is added to a run folder.
"""

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from itertools import takewhile
from pathlib import Path

from calibkit.errors import OutputError
from calibkit.records import atomic, names

RUN_FILE = "run.json"
"""File by which a run folder is known."""


@contextlib.contextmanager
def output_errors(path: Path, hint: str) -> Iterator[None]:
    """Turn errors of the system into OutputError that names a path."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}", hint=hint) from None


def refuse_existing(path: Path) -> None:
    """Raise OutputError when something of that name exists, or when it would lie in a run
    folder.
    """
    if os.path.lexists(path):
        raise OutputError(
            f"{path}: exists already", hint="nothing is overwritten; give another name or remove it"
        )
    nearest_parent = next((parent for parent in path.parents if os.path.lexists(parent)), None)
    if nearest_parent is not None and not os.path.isdir(nearest_parent):  # noqa: PTH112 - Path.is_dir raises where it may not look
        raise OutputError(
            f"{nearest_parent}: is no folder, {path.name} cannot lie in it",
            hint="give another place",
        )
    for part in takewhile(lambda part: not os.path.lexists(part), (path, *path.parents)):
        if fault := names.find_fault(part.name):
            raise OutputError(
                f"{part}: the name {fault}", hint="give another name, in letters of one alphabet"
            )
    refuse_run_folder(path)


def refuse_run_folder(path: Path) -> None:
    """Raise OutputError for a path inside a run folder, which is written once and whole."""
    inside = next(
        (parent for parent in path.absolute().parents if os.path.lexists(parent / RUN_FILE)), None
    )
    if inside is not None:
        raise OutputError(
            f"{path}: lies in the run folder {inside.name}",
            hint="a run folder is never added to; give another place",
        )


def write_new(path: Path, content: bytes | Iterable[bytes], *, dry_run: bool = False) -> None:
    """Write one file atomically, whole or as its bytes come in parts; a dry run only looks.

    Raises OutputError when it exists or cannot be written; what making a part raises leaves no file
    either.
    """
    write_all({path: content}, dry_run=dry_run)


def write_all(files: Mapping[Path, bytes | Iterable[bytes]], *, dry_run: bool = False) -> None:
    """Write files that belong together, a header and its source: all, or none where one of them
    cannot be written.

    All are on the disk under temporary names before the first gets its own. Raises OutputError when
    one exists or cannot be written. A dry run only looks.
    """
    for path in files:
        refuse_existing(path)
    if dry_run:
        return
    with contextlib.ExitStack() as temporaries, contextlib.ExitStack() as renames:
        ready = {path: _write_beside(path, files[path], temporaries) for path in files}
        for path, temporary in ready.items():
            with output_errors(path, "give another place"):
                try:
                    _rename_new(temporary, path)
                except FileExistsError:
                    raise OutputError(
                        f"{path}: exists already", hint="nothing is overwritten; give another name"
                    ) from None
            renames.callback(_remove, path)
        renames.pop_all()
    for folder in {path.parent for path in files}:
        atomic.sync_folder(folder)


def _write_beside(
    path: Path, content: bytes | Iterable[bytes], temporaries: contextlib.ExitStack
) -> Path:
    """Write a temporary file beside a path, which goes with the stack, and return its path."""
    with output_errors(path, "give another place"):
        atomic.make_folder(path.parent)
        handle, name = tempfile.mkstemp(prefix=atomic.UNFINISHED, dir=path.parent)
        os.close(handle)
        temporaries.callback(_remove, Path(name))
        atomic.remove_abandoned(Path(name))
        atomic.write_synced(Path(name), content)
        Path(name).chmod(0o644)
        return Path(name)


def _rename_new(temporary: Path, path: Path) -> None:
    """Give a file a name that nothing has: a hard link fails where the name was taken meanwhile.
    Raises OSError.
    """
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links; what took the name is still not replaced
        if path.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path)) from None
        temporary.rename(path)


def _remove(path: Path) -> None:
    """Remove a file where it can be removed."""
    with contextlib.suppress(OSError):
        path.unlink()

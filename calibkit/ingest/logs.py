"""The logs of a data folder: which they are, and how each is read."""

import importlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Protocol, TypeVar

from calibkit import names
from calibkit.errors import FrameError, RecipeError, UsageError, did_you_mean, visible
from calibkit.frame import Log
from calibkit.ingest import logs_on_disk, second_logger
from calibkit.ingest.mapping import log_name, read_file
from calibkit.readers import in_memory, parts
from calibkit.recipe import Recipe

_Read = TypeVar("_Read")
_NEEDED_LATER = (
    "pandas",
    "calibkit.lean_imports",
    "scipy.linalg",
    "scipy.special",
    "calibkit.report.svg_canvas",
    "matplotlib.figure",
)
"""Libraries that are slow to import and that every fit needs when its logs have been read."""


def find_logs(recipe: Recipe, folder: Path) -> list[str]:
    """Names of the logs that the recipe reads, relative to the data folder: in the order of its
    patterns, without those that it excludes.

    Raises UsageError, FrameError or RecipeError where there is no folder or log, or where the
    recipe excludes a log that is not there.
    """
    held = in_memory.match(folder, "*")
    if not held and not folder.is_dir():
        raise UsageError(
            f"--data {folder}: no such folder", hint="name the folder that holds the logs"
        )
    found: list[str] = []
    for pattern in recipe.logs.files:
        there = in_memory.match(folder, pattern) if held else _glob(recipe, folder, pattern)
        matches = sorted(path.relative_to(folder).as_posix() for path in there)
        if not matches:
            near = sorted(path.name for path in held or folder.iterdir())
            beside = ", ".join(near[:8]) or "nothing"
            raise FrameError(
                f"{folder}: no log matches '{pattern}', found {visible(beside)}",
                hint="check --data, or [logs] files in the recipe",
            )
        found += [match for match in matches if match not in found]
    files = found
    if recipe.logs.split and not held:
        found = [log[0] for log in parts.group_parts(found)]
    if recipe.chamber is not None:
        found = second_logger.exclude_second_logger(recipe.chamber, found, folder)
    skipped = {exclude.log for exclude in recipe.exclude if exclude.whole}
    _require_named_there(recipe, found, files)
    kept = [name for name in found if not skipped & {name, log_name(name)}]
    _require_plain_names(kept)
    if not kept:
        raise FrameError(
            f"{folder}: every log is excluded by the recipe", hint="remove an [[exclude]] table"
        )
    return kept


def _glob(recipe: Recipe, folder: Path, pattern: str) -> list[Path]:
    """Files of a folder that a pattern matches; raises FrameError for what is no file."""
    try:
        there = [path for path in folder.glob(pattern) if not path.is_dir()]
    except OSError as error:
        raise FrameError(
            f"{folder}: cannot be read: {error.strerror}", hint="check --data and its disk"
        ) from None
    _require_files(recipe, folder, there)
    return [path for path in there if path.is_file()]


def _require_plain_names(logs: Sequence[str]) -> None:
    """Raise FrameError for a log whose name is another one to some reader or system."""
    for name in logs:
        if fault := names.find_fault(name.rpartition("/")[2]):
            raise FrameError(
                f"{visible(name)}: the file's name {fault}",
                hint="rename the file: letters that look alike would be two logs",
            )


def _require_files(recipe: Recipe, folder: Path, matches: Sequence[Path]) -> None:
    """Raise FrameError for a match that is no file and that no exclusion names: a link that leads
    nowhere may stand for a log that is missing.
    """
    excluded = {exclude.log for exclude in recipe.exclude}
    for path in sorted(matches):
        name = path.relative_to(folder).as_posix()
        if not path.is_file() and not excluded & {name, log_name(name)}:
            what = "a link that leads nowhere" if path.is_symlink() else "a pipe or a device"
            raise FrameError(
                f"{visible(str(path))}: {what}, expected a log",
                hint="restore or remove it, or narrow [logs] files in the recipe",
            )


def _require_named_there(recipe: Recipe, found: Sequence[str], files: Sequence[str]) -> None:
    """Raise RecipeError where an exclusion or a number of lines to skip is of no log that is there;
    lines may be those of the files of a split log.
    """
    for number, exclude in enumerate(recipe.exclude):
        there = files if exclude.lines else found
        _require_there("[[exclude]] log", [exclude.log], there, at=("exclude",), first=number)
    if isinstance(recipe.logs.text.skip_lines, dict):
        at = ("logs", "text", "skip_lines")
        _require_there(".".join(at), recipe.logs.text.skip_lines, files, at=at)


def require_named_logs(recipe: Recipe, found: Sequence[str]) -> None:
    """Raise RecipeError where a recipe states rates or segments of logs that it does not read."""
    for at, stated in recipe.named_logs():
        _require_there(".".join(at), stated, found, at=at)
    _require_there("[[segment]] log", [pin.log for pin in recipe.segment], found, at=("segment",))


def _require_there(
    where: str, names: Iterable[str], found: Sequence[str], *, at: tuple[str, ...], first: int = 0
) -> None:
    """Raise RecipeError for the name of a log that is not there: a typing error would let bad data
    in.

    `at` is the recipe's table: an array of tables whose entries have a `log`, or a table whose keys
    are the names.
    """
    there = {*found, *map(log_name, found)}
    for number, name in enumerate(names, first):
        if name not in there:
            place: tuple[str | int, ...] = (*at, name) if len(at) > 1 else (*at, number, "log")
            raise RecipeError(
                f"{where} = '{name}': no such log",
                hint=did_you_mean(name, sorted(there), f"logs: {', '.join(found)}"),
                at=place,
            )


def read_log(
    recipe: Recipe, path: Path, file: str, needed: Sequence[str], optional: Sequence[str] = ()
) -> Log:
    """Read one log, joined with the recipe's second logger where it has one, and map it to
    canonical columns.

    Raises LogFormatError, FrameError, RecipeError, or FitError where two clocks cannot be related.
    """
    if recipe.chamber is None or not {*recipe.chamber.provides} & {*needed, *optional}:
        return logs_on_disk.read_to_disk(recipe, path, file, needed, optional) or read_file(
            recipe, path, file, needed, optional
        )
    return second_logger.read_joined(recipe, recipe.chamber, path, file, needed, optional)


def read_ahead(files: Iterable[str], read: Callable[[str], _Read]) -> Iterator[_Read]:
    """Logs in order, each read while the one before it is processed; an error is raised when its
    log's turn comes.

    While the first is read, the libraries that a fit needs later are imported.
    """
    from concurrent.futures import ThreadPoolExecutor

    left = iter(files)
    with ThreadPoolExecutor(1) as beside:
        coming = deque(beside.submit(read, file) for file in islice(left, 2))
        try:
            for name in _NEEDED_LATER:
                importlib.import_module(name)
            while coming:
                # no reference to the yielded log is kept: two are in memory, never three
                yield coming.popleft().result()
                coming.extend(beside.submit(read, file) for file in islice(left, 1))
        finally:
            for future in coming:
                future.cancel()


class Reader(Protocol):
    """Reads one log, as `read_log` does."""

    def __call__(
        self,
        recipe: Recipe,
        path: Path,
        file: str,
        needed: Sequence[str],
        optional: Sequence[str] = (),
    ) -> Log:
        """Read one log in canonical columns."""
        ...

"""The logs of a data folder: which they are, and how each is read."""

import importlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TypeVar

from calibkit.errors import FrameError, RecipeError, UsageError, did_you_mean, visible
from calibkit.logs import second_logger
from calibkit.logs.mapping import log_name, read_file
from calibkit.readers import in_memory, parts
from calibkit.recipe import Recipe
from calibkit.records import names
from calibkit.records.frame import Log

_Read = TypeVar("_Read")
_NEEDED_LATER = (
    "pandas",
    "calibkit.libraries.lean_imports",
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
    frames_in_memory = in_memory.match(folder, "*")
    if not frames_in_memory and not folder.is_dir():
        raise UsageError(
            f"--data {folder}: no such folder", hint="name the folder that holds the logs"
        )
    logs: list[str] = []
    for pattern in recipe.logs.files:
        candidates = (
            in_memory.match(folder, pattern) if frames_in_memory else _glob(recipe, folder, pattern)
        )
        matches = sorted(path.relative_to(folder).as_posix() for path in candidates)
        if not matches:
            folder_names = sorted(path.name for path in frames_in_memory or folder.iterdir())
            listing = ", ".join(folder_names[:8]) or "nothing"
            raise FrameError(
                f"{folder}: no log matches '{pattern}', found {visible(listing)}",
                hint="check --data, or [logs] files in the recipe (of a run: --set logs.files=…)",
            )
        logs += [match for match in matches if match not in logs]
    files = logs
    if recipe.logs.split and not frames_in_memory:
        logs = [log[0] for log in parts.group_parts(logs)]
    if recipe.chamber is not None:
        logs = second_logger.exclude_second_logger(recipe.chamber, logs, folder)
    skipped = {exclude.log for exclude in recipe.exclude if exclude.whole}
    for number, exclude in enumerate(recipe.exclude):
        # lines may be those of the files of a split log
        valid_names = files if exclude.lines else logs
        _require_there(
            "[[exclude]] log", [exclude.log], valid_names, key_path=("exclude",), first=number
        )
    if isinstance(recipe.logs.text.skip_lines, dict):
        key_path = ("logs", "text", "skip_lines")
        _require_there(".".join(key_path), recipe.logs.text.skip_lines, files, key_path=key_path)
    used_logs = [name for name in logs if not skipped & {name, log_name(name)}]
    for name in used_logs:
        if fault := names.find_fault(name.rpartition("/")[2]):
            raise FrameError(
                f"{visible(name)}: the file's name {fault}",
                hint="rename the file: letters that look alike would be two logs",
            )
    if not used_logs:
        raise FrameError(
            f"{folder}: every log is excluded by the recipe", hint="remove an [[exclude]] table"
        )
    return used_logs


def _glob(recipe: Recipe, folder: Path, pattern: str) -> list[Path]:
    """Files of a folder that a pattern matches. Raises FrameError for a match that is no file and
    that no exclusion names: a link that leads nowhere may stand for a log that is missing.
    """
    try:
        matches = [path for path in folder.glob(pattern) if not path.is_dir()]
    except OSError as error:
        raise FrameError(
            f"{folder}: cannot be read: {error.strerror}", hint="check --data and its disk"
        ) from None
    excluded = {exclude.log for exclude in recipe.exclude}
    for path in sorted(matches):
        name = path.relative_to(folder).as_posix()
        if not path.is_file() and not excluded & {name, log_name(name)}:
            kind = "a link that leads nowhere" if path.is_symlink() else "a pipe or a device"
            raise FrameError(
                f"{visible(str(path))}: {kind}, expected a log",
                hint="restore or remove it, or narrow [logs] files in the recipe",
            )
    return [path for path in matches if path.is_file()]


def require_named_logs(recipe: Recipe, logs: Sequence[str]) -> None:
    """Raise RecipeError where a recipe states rates or segments of logs that it does not read."""
    for key_path, log_names in recipe.named_logs():
        _require_there(".".join(key_path), log_names, logs, key_path=key_path)
    _require_there(
        "[[segment]] log", [pin.log for pin in recipe.segment], logs, key_path=("segment",)
    )


def _require_there(
    table_name: str,
    names: Iterable[str],
    logs: Sequence[str],
    *,
    key_path: tuple[str, ...],
    first: int = 0,
) -> None:
    """Raise RecipeError for the name of a log that is not there: a typing error would let bad data
    in.

    `key_path` is that of the recipe's table: an array of tables whose entries have a `log`, or a
    table whose keys are the names.
    """
    valid_names = {*logs, *map(log_name, logs)}
    for number, name in enumerate(names, first):
        if name not in valid_names:
            key: tuple[str | int, ...] = (
                (*key_path, name) if len(key_path) > 1 else (*key_path, number, "log")
            )
            raise RecipeError(
                f"{table_name} = '{name}': no such log",
                hint=did_you_mean(name, sorted(valid_names), f"logs: {', '.join(logs)}"),
                at=key,
            )


def read_log(
    recipe: Recipe,
    path: Path,
    file: str,
    required_columns: Sequence[str],
    optional: Sequence[str] = (),
) -> Log:
    """Read one log, joined with the recipe's second logger where it has one, and map it to
    canonical columns.

    Raises LogFormatError, FrameError, RecipeError, or FitError where two clocks cannot be related.
    """
    if recipe.chamber is None or not {*recipe.chamber.provides} & {*required_columns, *optional}:
        return read_file(recipe, path, file, required_columns, optional)
    return second_logger.read_joined(recipe, recipe.chamber, path, file, required_columns, optional)


def read_ahead(files: Iterable[str], read: Callable[[str], _Read]) -> Iterator[_Read]:
    """Logs in order, each read while the one before it is processed; an error is raised when its
    log's turn comes.

    While the first is read, the libraries that a fit needs later are imported.
    """
    from concurrent.futures import ThreadPoolExecutor

    remaining_files = iter(files)
    with ThreadPoolExecutor(1) as reader_thread:
        coming = deque(reader_thread.submit(read, file) for file in islice(remaining_files, 2))
        try:
            for name in _NEEDED_LATER:
                importlib.import_module(name)
            while coming:
                # no reference to the yielded log is kept: two are in memory, never three
                yield coming.popleft().result()
                coming.extend(
                    reader_thread.submit(read, file) for file in islice(remaining_files, 1)
                )
        finally:
            for future in coming:
                future.cancel()

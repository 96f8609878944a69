"""Logs as they are on disk → tidy frames, by the recipe's mapping and exclusions."""

from __future__ import annotations

import difflib
import importlib
from collections import deque
from itertools import islice
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from calibkit import units
from calibkit.errors import FrameError, RecipeError, UsageError
from calibkit.frame import Log, require
from calibkit.ingest import door, reference_corrections
from calibkit.readers import parts, registry

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    import pandas as pd

    from calibkit.arrays import Array
    from calibkit.readers.table import Table
    from calibkit.recipe import Column, Exclude, Recipe


Read = TypeVar("Read")
NEEDED_LATER = (
    "scipy.linalg",
    "scipy.special",
    "matplotlib.figure",
    "calibkit.report.backends",
)
"""Libraries that are slow to import and that every fit needs once its logs were read."""


def find_logs(recipe: Recipe, folder: Path) -> list[str]:
    """Names, relative to the data folder, of the logs that the recipe's patterns match, in
    order.
    """
    if not folder.is_dir():
        raise UsageError(
            f"--data {folder}: no such folder", hint="name the folder that holds the logs"
        )
    found: list[str] = []
    for pattern in recipe.logs.files:
        matches = sorted(
            path.relative_to(folder).as_posix() for path in folder.glob(pattern) if path.is_file()
        )
        if not matches:
            there = ", ".join(sorted(path.name for path in folder.iterdir())[:8]) or "nothing"
            raise FrameError(
                f"{folder}: no log matches '{pattern}', found {there}",
                hint="check --data, or [logs] files in the recipe",
            )
        found += [match for match in matches if match not in found]
    if recipe.logs.split:
        found = [log[0] for log in parts.group_parts(found)]
    if recipe.chamber is not None:
        from calibkit.ingest import loggers

        found = loggers.without(recipe.chamber, found, folder)
    skipped = {
        exclude.log for exclude in recipe.exclude if exclude.from_s is None and exclude.to_s is None
    }
    _known_exclusions(recipe, found)
    kept = [name for name in found if not skipped & {name, log_name(name)}]
    for name in kept:
        _require_text(name)
    if not kept:
        raise FrameError(
            f"{folder}: every log is excluded by the recipe", hint="remove an [[exclude]] table"
        )
    return kept


def _require_text(name: str) -> None:
    """Refuse a log whose name is bytes that no text is: it could not be written down whose digest
    stands in the record.
    """
    try:
        name.encode()
    except UnicodeEncodeError:
        shown = name.encode("utf-8", "backslashreplace").decode()
        raise FrameError(f"{shown}: the file's name is not UTF-8", hint="rename the file") from None


def _known_exclusions(recipe: Recipe, found: Sequence[str]) -> None:
    """Refuse an exclusion of a log that is not there."""
    known_logs(
        "[[exclude]] log", [exclude.log for exclude in recipe.exclude], found, at=("exclude",)
    )


def known_names(recipe: Recipe, found: Sequence[str]) -> None:
    """Refuse rates and segments of logs that are not there, in a recipe whose own logs these
    are.
    """
    for at, names in recipe.named_logs():
        known_logs(".".join(at), names, found, at=at)
    known_logs("[[segment]] log", [pin.log for pin in recipe.segment], found, at=("segment",))


def known_logs(
    where: str, names: Iterable[str], found: Sequence[str], *, at: tuple[str, ...]
) -> None:
    """Refuse a recipe that names a log which is not there: a typing error would let bad data in.

    `at` is the table of the recipe: an array of tables whose entries have a `log`, or a table whose
    keys are the names.
    """
    there = {*found, *map(log_name, found)}
    for number, name in enumerate(names):
        if name not in there:
            close = difflib.get_close_matches(name, sorted(there), n=1)
            guess = f"did you mean '{close[0]}'?" if close else f"logs: {', '.join(found)}"
            place: tuple[str | int, ...] = (*at, name) if len(at) > 1 else (*at, number, "log")
            raise RecipeError(f"{where} = '{name}': no such log", hint=guess, at=place)


def log_name(file: str) -> str:
    """Name of a log: its file without the suffix."""
    return file.rsplit(".", 1)[0]


def read_log(
    recipe: Recipe, path: Path, file: str, needed: Sequence[str], optional: Sequence[str] = ()
) -> Log:
    """Read one log, joined with the recipe's second logger where it has one, and map it to
    canonical columns.

    Raises LogFormatError, FrameError, RecipeError, or FitError where two clocks cannot be related.
    """
    if recipe.chamber is None:
        from calibkit.ingest import long_logs

        return long_logs.read(recipe, path, file, needed, optional) or read_one(
            recipe, path, file, needed, optional
        )
    from calibkit.ingest import loggers

    return loggers.joined(recipe, recipe.chamber, path, file, needed, optional)


def ahead(files: Iterable[str], read: Callable[[str], Read]) -> Iterator[Read]:
    """Logs in order, each read while the one before it is worked on; errors come when their log's
    turn does.

    While the first is read, what the fit needs later is imported.
    """
    from concurrent.futures import ThreadPoolExecutor

    left = iter(files)
    with ThreadPoolExecutor(1) as beside:
        coming = deque(beside.submit(read, file) for file in islice(left, 2))
        try:
            for name in NEEDED_LATER:
                importlib.import_module(name)
            while coming:
                # the log that is handed on is not kept here: two are in memory, never three
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


def read_one(
    recipe: Recipe, path: Path, file: str, needed: Sequence[str], optional: Sequence[str] = ()
) -> Log:
    """Read one file and map it to canonical columns; raises LogFormatError, FrameError or
    RecipeError.
    """
    sources = {name: column.source for name, column in recipe.columns.items()}
    timed = recipe.columns.get("time_s")
    written = {timed.source} if timed and (timed.time_format or timed.date) else set()
    wanted = {sources.get(name, name) for name in (*needed, *optional)} - written
    table = (parts.read if recipe.logs.split else registry.read)(path, file, recipe.logs, wanted)
    return mapped_log(recipe, table, needed, optional)


def mapped_log(
    recipe: Recipe,
    table: Table,
    needed: Sequence[str],
    optional: Sequence[str] = (),
    *,
    whole: bool = True,
) -> Log:
    """Canonical columns of a log, or of a piece of one, that was read; raises as `read_one`."""
    import pandas as pd

    file = table.file
    sources = {name: column.source for name, column in recipe.columns.items()}
    own = _own_names(recipe, table, sources, needed, optional)
    mapped = _canonical(recipe, table, own)
    columns = {name: mapped[name].column for name in own} | _counted_time(
        recipe, table, own, needed
    )
    require(file, columns, needed)
    # a column that needed no conversion is a view of what was read, which is kept for it: not where
    # much else was read
    many = table.frame.shape[1] > 2 * len(columns)
    kept = {name: columns[name] for name in (*needed, *optional) if name in columns}
    frame = pd.DataFrame(kept, index=table.frame.index, copy=many)
    frame, begun = _from_second_row(frame, mapped)
    frame, corrected = reference_corrections.corrected(frame, recipe.correction, file)
    frame, dropped = door.complete(frame, needed, recipe)
    frame, taken = without_exclusions(frame, recipe.exclude, file)
    excluded = exclusion_notes(recipe.exclude, {k: n for k, n in taken.items() if n or whole}, file)
    notes = (
        *table.notes,
        *(note for column in mapped.values() for note in column.notes),
        *begun,
        *dropped,
        *excluded,
    )
    reading = (
        *table.reading,
        *(said for column in mapped.values() for said in column.reading),
        *corrected,
    )
    return Log(
        log_name(file),
        file,
        table.sha256,
        len(table.frame),
        frame,
        notes,
        reading,
        table.parts,
        plugins=table.plugins,
    )


def _from_second_row(
    frame: pd.DataFrame, mapped: Mapping[str, door.Mapped]
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The frame without its first row where counts since the row before are read: it has none
    before.
    """
    counted = [name for name, column in mapped.items() if column.since_row_before]
    if not counted:
        return frame, ()
    return frame.iloc[1:], (
        f"the first row removed: {', '.join(counted)} are counts since the row before",
    )


def digest(recipe: Recipe, data: Path, file: str) -> str:
    """SHA-256 of a log's bytes, of all its parts where it is split."""
    return parts.digest_log(data / file, file, split=recipe.logs.split)


def _own_names(
    recipe: Recipe,
    table: Table,
    sources: Mapping[str, str],
    needed: Sequence[str],
    optional: Sequence[str],
) -> dict[str, str]:
    """Canonical name → the log's own name of every column that is there; a needed one that the
    recipe maps must be.
    """
    own = {}
    for name in (*needed, *optional):
        found = door.resolved(sources.get(name, name), table)
        if found is not None:
            own[name] = found
        elif name in needed and name in sources:
            require(table.file, table.frame.columns, [sources[name]], of=name)
    present = [*table.frame.columns, *own, *(["time_s"] if recipe.logs.rate_hz else [])]
    require(table.file, dict.fromkeys(present), needed)
    return own


def _canonical(recipe: Recipe, table: Table, own: Mapping[str, str]) -> dict[str, door.Mapped]:
    """Canonical name → column, the time first: counts per sample need it."""
    made: dict[str, door.Mapped] = {}
    if "time_s" in own:
        made["time_s"] = _time(recipe, table, own["time_s"])
    seconds = made["time_s"].column if "time_s" in made else None
    for name, source in own.items():
        if name != "time_s":
            made[name] = door.value(table, source, recipe.columns.get(name), name, recipe, seconds)
    return made


def _time(recipe: Recipe, table: Table, source: str) -> door.Mapped:
    """Seconds of a log: times as they are written, or a number in the unit that recipe or header
    state.
    """
    column = recipe.columns.get("time_s")
    written = door.time(table, source, column, "time_s")
    if written.reading or table.frame[source].dtype.kind not in "fiub":
        return written
    return door.value(table, source, column, "time_s", recipe, None)


def _counted_time(
    recipe: Recipe, table: Table, own: Mapping[str, str], needed: Sequence[str]
) -> dict[str, Array]:
    """Time of a log that has none, from the sampling rate that the recipe states."""
    if recipe.logs.rate_hz is None or ("time_s" not in own and "time_s" not in needed):
        return {}
    if "time_s" in own:
        raise RecipeError(
            f"{table.file}: [logs] rate_hz = {recipe.logs.rate_hz:g}, but column '{own['time_s']}'"
            " holds the time",
            hint="remove rate_hz, or map time_s to nothing that the log has",
        )
    return {"time_s": np.arange(len(table.frame), dtype=np.float64) / recipe.logs.rate_hz}


def unmapped(
    values: np.ndarray, column: Column, name: str, recipe: Recipe, stated: str = ""
) -> np.ndarray:
    """Values of a canonical column in the log's own unit and sign: the inverse of the mapping.

    `stated` is the unit that the log's header states; the recipe's stands above it.
    """
    target = units.column_unit(name)
    own = column.unit or stated or target
    converted = units.convert(
        column.sign * values, target, own, gravity_mps2=recipe.site.gravity_mps2
    )
    return (converted - column.offset) / column.scale


def without_exclusions(
    frame: pd.DataFrame, excludes: Sequence[Exclude], file: str
) -> tuple[pd.DataFrame, dict[int, int]]:
    """The frame without the ranges that the recipe leaves out, and how many rows each took; the
    index keeps counting.
    """
    taken = {}
    for number, exclude in enumerate(excludes):
        if exclude.log not in (file, log_name(file)) or (
            exclude.from_s is None and exclude.to_s is None
        ):
            continue
        require(file, frame.columns, ["time_s"])
        out = frame["time_s"].between(*_range_of(exclude))
        taken[number] = int(out.sum())
        frame = frame[~out] if taken[number] else frame
    return frame, taken


def exclusion_notes(
    excludes: Sequence[Exclude], taken: Mapping[int, int], file: str
) -> tuple[str, ...]:
    """What is noted of exclusions; raises RecipeError for one that took no row."""
    notes = []
    for number, rows in taken.items():
        exclude = excludes[number]
        low, high = _range_of(exclude)
        if not rows:
            raise RecipeError(
                f"[[exclude]] of {file}: no row between {low:g} s and {high:g} s",
                hint="check from_s and to_s",
                at=("exclude", number),
            )
        notes.append(
            f"{rows} rows from {low:g} s to {high:g} s excluded by {exclude.person}:"
            f" {exclude.reason}"
        )
    return tuple(notes)


def _range_of(exclude: Exclude) -> tuple[float, float]:
    """Times [s] from and to which an exclusion goes."""
    return (
        -np.inf if exclude.from_s is None else exclude.from_s,
        np.inf if exclude.to_s is None else exclude.to_s,
    )

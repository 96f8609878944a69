"""Two loggers, one log: the second logger's columns on the clock of the log, its gaps kept as
gaps.
"""

from __future__ import annotations

import fnmatch
from dataclasses import replace
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError, FrameError
from calibkit.frame import Log, values
from calibkit.ingest import clocks
from calibkit.ingest import logs as ingest
from calibkit.recipe.logs import Logs

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from calibkit.arrays import Array, Mask
    from calibkit.recipe import Recipe
    from calibkit.recipe.tables import SecondLogger


GAIN = 0.1
"""Departure from 1 of the gain between two sensors of one quantity that is noted."""
PROBE = "shared_quantity"
"""Name under which the log's own column of the shared quantity is read."""


def without(chamber: SecondLogger, found: Sequence[str], folder: Path) -> list[str]:
    """Logs that are not the second logger's own files."""
    its = {
        path.relative_to(folder).as_posix()
        for pattern in chamber.files
        for path in folder.glob(pattern.replace("{log}", "*"))
    }
    left = [name for name in found if name not in its]
    if not left:
        raise FrameError(
            f"{folder}: every log matches [chamber] files too",
            hint="make [logs] files and [chamber] files differ",
        )
    return left


def joined(
    recipe: Recipe,
    chamber: SecondLogger,
    path: Path,
    file: str,
    needed: Sequence[str],
    optional: Sequence[str],
) -> Log:
    """One log with the columns of its second logger on its own clock; raises FitError where the
    clocks cannot be related.
    """
    names = _files(chamber, path, file)
    if not names and (alone := _complete(recipe, path, file, needed, optional)) is not None:
        return alone
    if len(names) != 1:
        there = f"{len(names)} files ({', '.join(names[:4])})" if names else "no file"
        raise FrameError(
            f"{file}: [chamber] files matches {there}, expected the one of this log",
            hint=(
                'it lies in the folder of the log; name it with "{log}" in place of the log\'s name'
            ),
        )
    first, probe = _first(recipe, chamber, path, file, needed, optional)
    second = _second(recipe, chamber, path.parent / names[0])
    clock = _clock(chamber, first, probe, second)
    time = values(first.frame, "time_s")
    on_a = clock.on_a(values(second.frame, "time_s"))
    if np.any(np.diff(on_a) <= 0.0):
        raise FrameError(
            f"{second.file}: its time does not increase",
            hint="sort or split the file, or repair its clock",
        )
    frame = first.frame.drop(columns=[probe] if probe else [])
    for name in chamber.provides:
        frame[name] = _at(on_a, values(second.frame, name), time)
    lost = frame[list(chamber.provides)].isna().any(axis=1).to_numpy()
    frame = frame[~lost]
    if frame.empty:
        raise FrameError(
            f"{file}: no row has a value of {second.file}", hint="state offset_s in [chamber]"
        )
    frame = frame[[name for name in (*needed, *optional) if name in frame.columns]]
    return replace(
        first,
        clock=_uncertain(chamber, clock, second),
        second_logger_sha256=second.sha256,
        frame=frame,
        notes=(
            *first.notes,
            *_lost(time, on_a, lost, second.file),
            *(f"{second.file}: {note}" for note in second.notes),
        ),
        reading=(*first.reading, *_said(chamber, clock, second, time, on_a), *second.reading),
        plugins=tuple(dict.fromkeys((*first.plugins, *second.plugins))),
    )


def _first(
    recipe: Recipe,
    chamber: SecondLogger,
    path: Path,
    file: str,
    needed: Sequence[str],
    optional: Sequence[str],
) -> tuple[Log, str]:
    """The log itself without the columns of the second logger, and the name of the shared quantity
    in it.
    """
    own = [name for name in needed if name not in chamber.provides]
    extra = [name for name in optional if name not in chamber.provides]
    if "time_s" not in own:
        own.append("time_s")
    if chamber.clock != "estimate" or chamber.log_column is None:
        return ingest.read_one(recipe, path, file, own, extra), ""
    probe = f"{PROBE}_{chamber.shared.rsplit('_', 1)[-1]}"
    probed = recipe.model_copy(update={"columns": {**recipe.columns, probe: chamber.log_column}})
    return ingest.read_one(probed, path, file, [*own, probe], extra), probe


def _files(chamber: SecondLogger, path: Path, file: str) -> list[str]:
    """Files of the second logger that belong to a log."""
    log = ingest.log_name(PurePosixPath(file).name)
    patterns = [PurePosixPath(pattern.replace("{log}", log)).name for pattern in chamber.files]
    names = sorted(found.name for found in path.parent.iterdir() if found.is_file())
    return [
        name for name in names if any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)
    ]


def _complete(
    recipe: Recipe, path: Path, file: str, needed: Sequence[str], optional: Sequence[str]
) -> Log | None:
    """A log that has every column itself, as one from another place than the laboratory may; else
    none.
    """
    try:
        log = ingest.read_one(recipe, path, file, needed, optional)
    except FrameError:
        return None
    return replace(
        log, notes=(*log.notes, "every column is in the log itself: no second logger was read")
    )


def _second(recipe: Recipe, chamber: SecondLogger, path: Path) -> Log:
    """The second logger's file in canonical columns, rows without a value left out and counted."""
    logs = Logs.model_validate({name: getattr(chamber, name) for name in Logs.model_fields})
    alone = recipe.model_copy(
        update={"logs": logs, "columns": chamber.columns, "exclude": (), "chamber": None}
    )
    wanted = tuple(
        dict.fromkeys(("time_s", *chamber.provides, *([chamber.shared] if chamber.shared else [])))
    )
    second = ingest.read_one(alone, path, path.name, wanted)
    bad = [name for name in wanted if not np.isfinite(values(second.frame, name)).all()]
    if bad:
        whole = np.isfinite(second.frame[list(wanted)].to_numpy(dtype=np.float64)).all(axis=1)
        note = f"{int((~whole).sum())} rows without a value of {', '.join(bad)} left out"
        second = replace(second, frame=second.frame[whole], notes=(*second.notes, note))
    return second


def _clock(chamber: SecondLogger, first: Log, probe: str, second: Log) -> clocks.Clocks:
    """Clock of the second logger on that of the log, as the recipe says: the same, stated, or
    estimated.
    """
    time_b = values(second.frame, "time_s")
    if not probe:
        u = chamber.standard_uncertainty_s or 0.0
        stated = np.diag([u**2, 0.0])
        return clocks.Clocks(chamber.offset_s, chamber.drift_ppm * 1e-6, stated, 0.0, 1.0, 0.0, 0)
    try:
        found = clocks.estimate(
            values(first.frame, "time_s"),
            values(first.frame, probe),
            time_b,
            values(second.frame, chamber.shared),
            near_s=chamber.offset_s,
            search_s=chamber.search_s,
            drift=chamber.drift,
        )
    except FitError as error:
        raise FitError(f"{first.file}, {second.file}: {error.message}", hint=error.hint) from None
    worst = found.largest_uncertainty(time_b)
    if worst > chamber.max_uncertainty_s:
        raise FitError(
            f"{first.file}, {second.file}: the clocks are known to {worst:.2g} s (standard"
            f" uncertainty at the worse end), expected {chamber.max_uncertainty_s:g} s or better",
            hint=(
                "log a change that both loggers see, set drift = false, or raise max_uncertainty_s"
                " in [chamber]"
            ),
        )
    return found


def _uncertain(
    chamber: SecondLogger, clock: clocks.Clocks, second: Log
) -> tuple[float, float] | None:
    """Offset of the clock and its standard uncertainty at the worse end of the log [s]; none where
    the clock is one.
    """
    if chamber.clock == "same":
        return None
    return clock.offset_s, clock.largest_uncertainty(values(second.frame, "time_s"))


def _at(time_b: Array, value: Array, time: Array) -> Array:
    """Values of the second logger [m] at the log's times [n]: linear between its rows, means where
    it is the faster one.
    """
    ratio = float(np.median(np.diff(time))) / float(np.median(np.diff(time_b)))
    if ratio < 2.0:
        return clocks.resampled(time_b, value, time)
    return clocks.averaged(time_b, value, time)


def _lost(time: Array, on_a: Array, lost: Mask, file: str) -> tuple[str, ...]:
    """Which rows of the log have no value of the second logger, and why."""
    if not lost.any():
        return ()
    before, after = int(np.sum(lost & (time < on_a[0]))), int(np.sum(lost & (time > on_a[-1])))
    within = int(lost.sum()) - before - after
    parts = [
        f"{count} {where}"
        for count, where in (
            (before, "before its start"),
            (after, "after its end"),
            (within, "in its gaps"),
        )
        if count
    ]
    return (f"{int(lost.sum())} rows without a value of {file} left out: {', '.join(parts)}",)


def _said(
    chamber: SecondLogger, clock: clocks.Clocks, second: Log, time: Array, on_a: Array
) -> tuple[str, ...]:
    """How the second logger was joined, for run.json."""
    columns = ", ".join(chamber.provides)
    steps = [float(np.median(np.diff(t))) for t in (on_a, time)]
    way = "means about" if steps[1] >= 2.0 * steps[0] else "linear between its rows at"
    source = (
        f"{columns} from {second.file} (sha256 {second.sha256}, {second.rows} rows of"
        f" {steps[0]:.4g} s)"
    )
    said = [
        f"{source}: {way} the log's rows of {steps[1]:.4g} s",
        f"clock of {second.file} ({chamber.clock}): offset {clock.offset_s:+.3f} s",
    ]
    u = clock.standard_uncertainty
    if chamber.clock != "same":
        said[1] += (
            f", standard uncertainty {u[0]:.2g} s, at {clock.middle_s:.6g} s; drift"
            f" {clock.drift * 1e6:+.4g} ppm"
        )
        said[1] += f", standard uncertainty {u[1] * 1e6:.2g} ppm" if u[1] else ""
    if chamber.clock == "estimate" and abs(clock.gain - 1.0) > GAIN:
        said.append(f"the two sensors of the shared quantity differ: gain {clock.gain:.3f}")
    return tuple(said)

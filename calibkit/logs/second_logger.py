"""A log and its second logger, joined: the second logger's columns on the clock of the log, by
what the stamps of both files say or by a quantity that both measured.
"""

import contextlib
import fnmatch
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from calibkit.errors import FitError, FrameError
from calibkit.logs import clocks, mapping
from calibkit.numeric.arrays import Array
from calibkit.readers import in_memory
from calibkit.recipe import Recipe
from calibkit.recipe.logs import Logs
from calibkit.recipe.tables import SecondLogger
from calibkit.records.frame import Log, values

_GAIN = 0.1
"""Departure from 1 of the gain between two sensors of one quantity that is noted."""
_HOW_RELATED = {"same": "one clock", "stated": "stated", "estimate": "estimated"}
"""[chamber] clock → how the two clocks are related, in words."""
_DAY_S = 86400.0
_ALIKE = 0.5
"""Share of the best overlap beyond which another day explains two times of day as well."""
_PROBE = "shared_quantity"
"""Name under which the log's own column of the shared quantity is read."""


def exclude_second_logger(chamber: SecondLogger, logs: Sequence[str], folder: Path) -> list[str]:
    """Logs that are not the second logger's own files."""
    second_files = set()
    for pattern in (pattern.replace("{log}", "*") for pattern in chamber.files):
        on_disk = (path for path in folder.glob(pattern) if path.is_file())
        for path in in_memory.match(folder, pattern) or on_disk:
            second_files.add(path.relative_to(folder).as_posix())
    first_logs = [name for name in logs if name not in second_files]
    if not first_logs:
        raise FrameError(
            f"{folder}: every log matches [chamber] files too",
            hint="make [logs] files and [chamber] files differ",
        )
    return first_logs


def read_joined(
    recipe: Recipe,
    chamber: SecondLogger,
    path: Path,
    file: str,
    required_columns: Sequence[str],
    optional: Sequence[str],
) -> Log:
    """Read one log with the columns of its second logger; one from the place of use may have every
    column itself. Raises FitError where the two clocks cannot be related, otherwise as
    `mapping.read_file`.
    """
    patterns = [
        PurePosixPath(pattern.replace("{log}", mapping.log_name(path.name))).name
        for pattern in chamber.files
    ]
    candidates = in_memory.match(path.parent, "*") or filter(Path.is_file, path.parent.iterdir())
    names = sorted(
        candidate.name
        for candidate in candidates
        if any(fnmatch.fnmatchcase(candidate.name, pattern) for pattern in patterns)
    )
    if not names:
        with contextlib.suppress(FrameError):
            log = mapping.read_file(recipe, path, file, required_columns, optional)
            note = "every column is in the log itself: no second logger was read"
            return replace(log, notes=(*log.notes, note))
    if len(names) != 1:
        matches_text = f"{len(names)} files ({', '.join(names[:4])})" if names else "no file"
        raise FrameError(
            f"{file}: [chamber] files matches {matches_text}, expected the one of this log",
            hint=(
                'it lies in the folder of the log; name it with "{log}" in place of the log\'s name'
            ),
        )
    first, probe = _read_first(recipe, chamber, path, file, required_columns, optional)
    second = _read_second(recipe, chamber, path.parent / names[0])
    begins = _relate_origins(first, second, same_clock=chamber.clock == "same")
    if begins:
        second = replace(second, frame=second.frame.assign(time_s=second.frame["time_s"] + begins))
    if probe:
        # of a file of the whole day the clock is wanted where the log is
        time = values(first.frame, "time_s") - chamber.offset_s
        margin = chamber.search_s
        near_log = second.frame["time_s"].between(time[0] - margin, time[-1] + margin)
        second = replace(second, frame=second.frame[near_log]) if near_log.any() else second
    clock = _relate_clocks(chamber, first, probe, second, begins)
    return _join(first, second, clock, chamber, (*required_columns, *optional))


def _join(
    first: Log,
    second: Log,
    clock: clocks.Clocks,
    chamber: SecondLogger,
    columns: Sequence[str],
) -> Log:
    """The log with the second logger's values at its own times; rows without one are left out."""
    time, on_a = values(first.frame, "time_s"), clock.on_a(values(second.frame, "time_s"))
    second_columns, joined = _take(chamber, second, on_a, time)
    frame = first.frame.assign(**second_columns)
    lost = frame[list(chamber.provides)].isna().any(axis=1).to_numpy()
    before, after = time < on_a[0], time > on_a[-1]
    places = {
        "before its start": lost & before,
        "after its end": lost & after,
        "in its gaps": lost & ~(before | after),
    }
    numbers = first.frame.index.to_numpy()
    lost_rows = {place: numbers[rows] for place, rows in places.items() if rows.any()}
    frame = frame.loc[~lost, [name for name in columns if name in frame.columns]]
    if frame.empty:
        raise FrameError(
            f"{first.file}: no row has a value of {second.file}: the log goes from"
            f" {_describe_span(first, time)}, that file from {_describe_span(first, on_a)} of the"
            " log's clock",
            hint="name the file of the same hours in [chamber] files, or state offset_s there",
        )
    lost_notes = []
    if lost_rows:
        counts = ", ".join(f"{rows.size} {place}" for place, rows in lost_rows.items())
        lost_notes.append(
            f"{int(lost.sum())} rows without a value of {second.file} left out: {counts}"
        )
    offset_s, way = round(clock.offset_s, 1), "behind" if clock.offset_s > 0.0 else "ahead"
    offset_text = f"{abs(offset_s):.10g} s {way}" if offset_s else "as it is"
    overlap = (
        f"files overlap {_describe_span(first, time[~lost])}; clock of {second.file}"
        f" {offset_text} ({_HOW_RELATED[chamber.clock]})"
    )
    u = clock.largest_uncertainty(values(second.frame, "time_s"))
    clock_text = f"clock of {second.file} ({chamber.clock}): offset {clock.offset_s:+.3f} s"
    if chamber.clock != "same":
        u_offset, u_drift = clock.standard_uncertainty
        clock_text += (
            f", standard uncertainty {u_offset:.2g} s, at {clock.middle_s:.6g} s; drift"
            f" {clock.drift * 1e6:+.4g} ppm"
        )
        clock_text += f", standard uncertainty {u_drift * 1e6:.2g} ppm" if u_drift else ""
    clock_texts = [clock_text]
    if chamber.clock == "estimate" and abs(clock.gain - 1.0) > _GAIN:
        clock_texts.append(f"the two sensors of the shared quantity differ: gain {clock.gain:.3f}")
    return replace(
        first,
        overlap=overlap,
        clock=None if chamber.clock == "same" else (clock.offset_s, u),
        second_logger_sha256=second.sha256,
        lost=(
            *first.lost,
            *((f"no value of {second.file}: {place}", rows) for place, rows in lost_rows.items()),
        ),
        frame=frame,
        notes=(
            *first.notes,
            *lost_notes,
            *(f"{second.file}: {note}" for note in second.notes),
        ),
        reading=(
            *(overlap, *first.reading, joined),
            *clock_texts,
            *second.reading,
        ),
        plugins=tuple(dict.fromkeys((*first.plugins, *second.plugins))),
    )


def _take(
    chamber: SecondLogger, second: Log, on_a: Array, time: Array
) -> tuple[dict[str, Array], str]:
    """Values [n] of the second logger's columns at the times [n, s] of a log, from its own on the
    log's clock [m, s], and a text on how they were taken.
    """
    if np.any(np.diff(on_a) <= 0.0):
        raise FrameError(
            f"{second.file}: its time does not increase",
            hint="sort or split the file, or repair its clock",
        )
    steps = [float(np.median(np.diff(times))) for times in (on_a, time)]
    take, how = clocks.resample, "linear between its rows at"
    # single rows of a faster logger would carry its whole noise, and alias what is between them
    if steps[1] >= 2.0 * steps[0]:
        take, how = clocks.average, "means about"
    return {name: take(on_a, values(second.frame, name), time) for name in chamber.provides}, (
        f"{', '.join(chamber.provides)} from {second.file} (sha256 {second.sha256},"
        f" {second.rows} rows of {steps[0]:.4g} s): {how} the log's rows of {steps[1]:.4g} s"
    )


def _read_first(
    recipe: Recipe,
    chamber: SecondLogger,
    path: Path,
    file: str,
    required_columns: Sequence[str],
    optional: Sequence[str],
) -> tuple[Log, str]:
    """Read the log itself, without the columns of the second logger, and the name that the shared
    quantity has in it ("" where none is needed).
    """
    log_columns = [name for name in required_columns if name not in chamber.provides]
    optional_columns = [name for name in optional if name not in chamber.provides]
    if "time_s" not in log_columns:
        log_columns.append("time_s")
    if chamber.clock != "estimate" or chamber.log_column is None:
        return mapping.read_file(recipe, path, file, log_columns, optional_columns), ""
    probe = f"{_PROBE}_{chamber.shared.rsplit('_', 1)[-1]}"
    probed = recipe.model_copy(update={"columns": {**recipe.columns, probe: chamber.log_column}})
    return mapping.read_file(probed, path, file, [*log_columns, probe], optional_columns), probe


def _read_second(recipe: Recipe, chamber: SecondLogger, path: Path) -> Log:
    """Read the second logger's file in canonical columns, without rows that lack a value."""
    logs = Logs.model_validate({name: getattr(chamber, name) for name in Logs.model_fields})
    # exclusions name rows of the log, not of its second logger
    second_recipe = recipe.model_copy(
        update={"logs": logs, "columns": chamber.columns, "exclude": (), "chamber": None}
    )
    columns = list(dict.fromkeys(filter(None, ("time_s", *chamber.provides, chamber.shared))))
    second = mapping.read_file(second_recipe, path, path.name, columns)
    finite = np.isfinite(second.frame[columns].to_numpy(dtype=np.float64))
    complete_rows = finite.all(axis=1)
    if complete_rows.all():
        return second
    bad = [name for name, complete in zip(columns, finite.all(axis=0), strict=True) if not complete]
    note = f"{int((~complete_rows).sum())} rows without a value of {', '.join(bad)} left out"
    return replace(second, frame=second.frame[complete_rows], notes=(*second.notes, note))


def _relate_clocks(
    chamber: SecondLogger, first: Log, probe: str, second: Log, begins: float
) -> clocks.Clocks:
    """Clock of the second logger against that of the log: the same, stated or estimated, as the
    recipe says. A stated drift counts from the second logger's own second 0, `begins`.
    """
    if not probe:
        # a stated drift is taken as exact: the recipe has no uncertainty of it
        covariance = np.diag([(chamber.standard_uncertainty_s or 0.0) ** 2, 0.0])
        return clocks.Clocks(
            chamber.offset_s, chamber.drift_ppm * 1e-6, covariance, begins, 1.0, 0.0, 0
        )
    time_b = values(second.frame, "time_s")
    try:
        clock = clocks.estimate_clock(
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
    worst = clock.largest_uncertainty(time_b)
    if worst > chamber.max_uncertainty_s:
        raise FitError(
            f"{first.file}, {second.file}: the clocks are known to {worst:.2g} s (standard"
            f" uncertainty at the worse end), expected {chamber.max_uncertainty_s:g} s or better",
            hint=(
                "log a change that both loggers see, set drift = false, or raise max_uncertainty_s"
                " in [chamber]"
            ),
        )
    return clock


def _relate_origins(first: Log, second: Log, *, same_clock: bool) -> float:
    """Seconds from second 0 of one log to second 0 of the other by their stamps, 0 where these
    cannot be compared; FrameError where they must be, as on the `same_clock`.
    """
    a, b = first.origin, second.origin
    if a is None or b is None or a.kind != b.kind:
        if same_clock:
            raise FrameError(
                f'{first.file}: clock = "same", but the log has {_describe_kind(first)} and'
                f" {second.file} has {_describe_kind(second)}, expected stamps of one kind",
                hint=(
                    'state in [chamber] clock = "stated", offset_s = seconds from the log\'s first'
                    " row to the other file's, and standard_uncertainty_s; or pin time_format"
                    " where a date can be read in two ways"
                ),
            )
        return 0.0
    begins = (b.nanoseconds - a.nanoseconds) / 1e9
    return begins if a.kind != "times of day" else begins + _find_day(first, second, begins)


def _describe_kind(log: Log) -> str:
    """Kind of a log's stamps, for a message."""
    return "stamps without a certain date" if log.origin is None else log.origin.kind


def _find_day(first: Log, second: Log, begins: float) -> float:
    """Days [s] between two logs with times of day alone: those at which they overlap most."""
    ends = [values(log.frame, "time_s")[[0, -1]] for log in (first, second)]
    (low, high), second_ends = ends[0], ends[1] + begins
    common = {
        day: float(min(high, second_ends[1] + day) - max(low, second_ends[0] + day))
        for day in (0.0, -_DAY_S, _DAY_S)
    }
    best = max(common, key=lambda day: common[day])
    rivals = [day for day in common if day != best and common[day] > _ALIKE * common[best]]
    if rivals and common[best] > 0.0:
        raise FrameError(
            f"{first.file}: the times of day of {second.file} fit it on two days, expected one",
            hint="log dates, or take the other days out of that file",
        )
    return best if common[best] > 0.0 else 0.0


def _describe_span(log: Log, time_s: Array) -> str:
    """First and last of times [n, s] of a log's clock as its stamps would say them."""
    origin = log.origin
    stamp = "{:.10g} s".format if origin is None else origin.stamp
    first, last = stamp(float(time_s[0])), stamp(float(time_s[-1]))
    date, _, time_of_day = last.rpartition(" ")
    return f"{first}–{time_of_day if date and first.startswith(date) else last}"

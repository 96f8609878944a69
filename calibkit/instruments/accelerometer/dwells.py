"""Logs of a triad → dwells: mean indication, temperature, reference attitude, noise."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calibkit import check
from calibkit.arrays import Array, Integers
from calibkit.errors import FitError, FrameError
from calibkit.frame import Examined, Finding, Held, Log, Remark, refuse, values
from calibkit.ingest import stated_segments
from calibkit.instruments.accelerometer.forms import COMPONENTS, TEMPERATURE
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.numeric import attitude, chunks, dwells

ATTITUDE = ("inclination_deg", "toolface_deg")
SATURATED_G = 50.0
"""Indication [g] above which a log cannot be in g: a triad is calibrated in the earth's gravity."""
UNSTATED_DEGC = 25.0
"""Case temperature [°C] assumed for a magnitude-only log without a temperature column."""


@dataclass(frozen=True, slots=True)
class DwellSet:
    """Dwells of all logs: indication [n, 3, g, positive along gravity], temperature [n, °C], angles
    [n, °], weights.

    Angles are NaN where the reference is the magnitude alone; `noise` [n, 3, g] is the standard
    error of each mean, NaN where a dwell is one row; `time` [n, s] is that of the log, NaN where it
    has none; `log` [n] counts the logs, `place` says where each dwell came from.
    """

    indication: Array
    temperature: Array
    inclination: Array
    toolface: Array
    noise: Array
    time: Array
    log: Integers
    place: tuple[str, ...]
    flags: tuple[str, ...]

    @property
    def valid(self) -> dict[str, tuple[float, float]]:
        """Temperature range [°C] of the dwells, by the name of its column."""
        return {TEMPERATURE: (float(self.temperature.min()), float(self.temperature.max()))}

    @property
    def reference(self) -> Array:
        """Reference gravity vectors [n, 3, g] from inclination and toolface."""
        return attitude.gravity_vector(self.inclination, self.toolface)

    @property
    def weights(self) -> Array | None:
        """Weights 1/variance [n, 3] of the means; None unless every dwell has a standard error."""
        return (
            1.0 / self.noise**2
            if np.isfinite(self.noise).all() and (self.noise > 0.0).all()
            else None
        )

    def without(self, rows: Iterable[int], flags: Iterable[str] = ()) -> "DwellSet":
        """Dwells without those at the rows, with further flags."""
        keep = np.setdiff1d(np.arange(len(self.place)), list(rows))
        arrays = ("indication", "temperature", "inclination", "toolface", "noise", "time", "log")
        return replace(
            self,
            **{name: getattr(self, name)[keep] for name in arrays},
            place=tuple(self.place[k] for k in keep),
            flags=(*self.flags, *flags),
        )


def needed_columns(spec: AccelerometerRecipe) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Columns that the recipe needs, and optional columns that it uses where a log has them."""
    series = ("time_s",) if spec.dwells.mode == "series" else ()
    if spec.reference.kind == "attitude":
        return (*series, TEMPERATURE, *ATTITUDE, *COMPONENTS), () if series else ("time_s",)
    return (*series, *COMPONENTS), (TEMPERATURE, *ATTITUDE, *(() if series else ("time_s",)))


def find_faults(log: Log, spec: AccelerometerRecipe) -> list[Finding]:
    """Faults of a log; a log with a refused fault is not fitted."""
    columns = [column for column in log.frame.columns if column != "time_s"]
    early = [
        *check.find_too_few_rows(log, 1),
        *check.find_missing_values(log, list(log.frame.columns)),
    ]
    if any(finding.refused for finding in early):
        return early
    timed = "time_s" in log.frame.columns
    found = [
        *early,
        *(check.find_unordered_times(log) if timed else ()),
        *_find_beyond(log, COMPONENTS, SATURATED_G, "g"),
    ]
    if TEMPERATURE in columns:
        found += check.find_implausible_temperatures(log, [TEMPERATURE])
    if spec.reference.kind == "attitude":
        found += [
            *_find_beyond(log, ["inclination_deg"], 180.0, "deg"),
            *_find_beyond(log, ["toolface_deg"], 360.0, "deg"),
        ]
    if any(finding.refused for finding in found):
        return found
    return [*found, *_find_wrong_units(log, spec)]


def _find_wrong_units(log: Log, spec: AccelerometerRecipe) -> list[Finding]:
    """Findings on units and signs that the values contradict, and on gaps of a continuous log,
    which end a dwell.
    """
    found = [
        *check.magnitude.check_gravity_unit(log, COMPONENTS),
        *check.magnitude.find_compensated_names(log, spec, COMPONENTS),
    ]
    if spec.dwells.mode == "series":
        found += check.find_gaps(log, float("inf"))
        if TEMPERATURE in log.frame.columns:
            found += check.series.check_temperature(log, TEMPERATURE)
    if all(column in log.frame.columns for column in ATTITUDE) and not found:
        held = [chunks.row_reader(values(log.frame, column)) for column in ATTITUDE]

        def expected(first: int, stop: int) -> Array:
            reference = attitude.gravity_vector(*(angle(first, stop) for angle in held))
            return attitude.gravity_positive(reference, spec.reference.convention)

        found += check.magnitude.check_triad_sign(log, COMPONENTS, expected)
    return found


def _find_beyond(log: Log, columns: Sequence[str], limit: float, unit: str) -> list[Finding]:
    """Findings on columns with values above the limit that is plausible in their unit."""
    found = []
    for column in columns:
        if max(map(abs, log.extremes(column))) <= limit:
            continue
        data = values(log.frame, column)
        bad = chunks.rows_where(data, lambda part: np.abs(part) > limit)
        if bad.size:
            what = f"{data[bad[0]]:g} {unit} ({bad.size} such row{'s' if bad.size > 1 else ''})"
            advice = f"state the log's unit in [columns.{column}]"
            expected = f"at most {limit:g} {unit}"
            found.append(
                check.finding_at_row(log, int(bad[0]), column, what, expected, advice, "range")
            )
    return found


def collect_dwells(logs: Sequence[Log], spec: AccelerometerRecipe) -> DwellSet:
    """Check every log and gather its dwells; raises FrameError or FitError naming the log."""
    parts = []
    flags = []
    for log in logs:
        found = find_faults(log, spec)
        refuse(found)
        flags += [str(finding) for finding in found if finding.flagged]
        parts.append(
            read_row_dwells(log, spec)
            if spec.dwells.mode == "rows"
            else _read_series_dwells(log, spec)
        )
    return DwellSet(
        np.concatenate([part.indication for part in parts]),
        np.concatenate([part.temperature for part in parts]),
        np.concatenate([part.inclination for part in parts]),
        np.concatenate([part.toolface for part in parts]),
        np.concatenate([part.noise for part in parts]),
        np.concatenate([part.time for part in parts]),
        np.concatenate(
            [np.full(len(part.place), number, dtype=np.int64) for number, part in enumerate(parts)]
        ),
        tuple(place for part in parts for place in part.place),
        (*(flag for part in parts for flag in part.flags), *flags),
    )


def read_indication(log: Log, spec: AccelerometerRecipe) -> Array:
    """Indications [n, 3, g] of a log, positive along gravity whatever the log's convention."""
    return _stack_columns(log, [values(log.frame, column) for column in COMPONENTS], spec)


def _stack_columns(log: Log, columns: Sequence[Array], spec: AccelerometerRecipe) -> Array:
    """Columns stacked into an array [n, c], in the log's own storage (memory or mapped file); the
    sign of the first three, the indications, is made positive along gravity.
    """
    made = log.allocate(len(log.frame) * len(columns)).reshape(-1, len(columns))
    for a, b in chunks.ranges_along(made, *columns):
        beside = np.column_stack([column[a:b] for column in columns])
        made[a:b, :3] = attitude.gravity_positive(beside[:, :3], spec.reference.convention)
        made[a:b, 3:] = beside[:, 3:]
    return made


def optional_column(log: Log, column: str, otherwise: float = np.nan) -> Array:
    """A column of a log [n], or a constant where the log does not have it."""
    return (
        values(log.frame, column)
        if column in log.frame.columns
        else np.broadcast_to(otherwise, len(log.frame))
    )


def read_row_dwells(log: Log, spec: AccelerometerRecipe) -> DwellSet:
    """Dwells of a log with one row per dwell."""
    count = len(log.frame)
    return DwellSet(
        read_indication(log, spec),
        optional_column(log, TEMPERATURE, UNSTATED_DEGC),
        optional_column(log, "inclination_deg"),
        optional_column(log, "toolface_deg"),
        np.full((count, 3), np.nan),
        np.asarray(optional_column(log, "time_s")),
        np.zeros(count, dtype=np.int64),
        tuple(f"{log.file}:{log.line(row)}" for row in range(count)),
        tuple(f"{log.file}: {note}" for note in log.notes),
    )


def _read_series_dwells(log: Log, spec: AccelerometerRecipe) -> DwellSet:
    """Dwells of a continuous log: stretches at rest, cut at gaps, and divided into pieces where the
    recipe states piece_s.
    """
    time = values(log.frame, "time_s")
    step = log.steps.usual
    temperature = optional_column(log, TEMPERATURE, UNSTATED_DEGC)
    columns = _stack_columns(
        log, [*(values(log.frame, column) for column in COMPONENTS), temperature], spec
    )
    intervals = _find_dwell_rows(log, columns[:, :3], time, step, spec)
    if spec.dwells.piece_s is not None:
        intervals = dwells.cut_dwells(intervals, max(2, round(spec.dwells.piece_s / step)))
    means = dwells.average_dwells(columns, intervals)
    # reference angles are read at the middle of the dwell
    middle = intervals.mean(axis=1).astype(np.int64)
    return DwellSet(
        means.mean[:, :3],
        means.mean[:, 3],
        chunks.take_rows(optional_column(log, "inclination_deg"), middle),
        chunks.take_rows(optional_column(log, "toolface_deg"), middle),
        means.standard_error[:, :3],
        chunks.take_rows(time, middle),
        np.zeros(len(intervals), dtype=np.int64),
        tuple(f"{log.file}:{log.line(a)}-{log.line(b - 1)}" for a, b in intervals.tolist()),
        (
            *(f"{log.file}: {note}" for note in log.notes),
            Remark(f"{log.file}: {len(intervals)} dwells found"),
        ),
    )


def _find_dwell_rows(
    log: Log, triad: Array, time: Array, step: float, spec: AccelerometerRecipe
) -> Integers:
    """First and end row [m, 2] of each dwell: pinned by the recipe, or detected as rest between the
    gaps of the log.
    """
    pinned = stated_segments.stated_rows(log, spec, ["dwell"])
    if pinned is not None:
        return pinned
    window = max(4, round(spec.dwells.window_s / step))
    gap = max(spec.dwells.max_gap_s, 2.5 * step)
    bounds = [
        0,
        *(chunks.rows_where(time, lambda apart: apart > gap, step=True) + 1).tolist(),
        time.size,
    ]
    limit, shortest = spec.dwells.noise_limit_g, max(2, round(spec.dwells.shortest_s / step))
    try:
        found = [
            start
            + dwells.find_dwells(triad[start:stop], window, threshold=limit, shortest=shortest)
            for start, stop in pairwise(bounds)
            if stop - start >= 4 * window
        ]
    except FitError as error:
        raise FitError(f"{log.file}: {error.message}", hint=error.hint) from None
    if not found:
        raise FrameError(
            f"{log.file}: too short for dwells of {spec.dwells.window_s:g} s", hint="log longer"
        )
    return np.concatenate(found)


def examine(spec: AccelerometerRecipe, log: Log) -> Examined:
    """Findings of a log, and the dwells where the log is continuous."""
    found = find_faults(log, spec)
    if any(finding.refused for finding in found) or spec.dwells.mode == "rows":
        return Examined(tuple(found))
    time, triad = values(log.frame, "time_s"), read_indication(log, spec)
    try:
        rows = _find_dwell_rows(log, triad, time, log.steps.usual, spec).tolist()
        pinned = stated_segments.stated_rows(log, spec, ["dwell"]) is not None
    except (FitError, FrameError) as error:
        return Examined((*found, Finding.of(error)))
    held = (
        Held("dwell", a, b, float(np.linalg.norm(triad[a:b].mean(axis=0))), "g", pinned)
        for a, b in rows
    )
    return Examined(tuple(found), tuple(held))

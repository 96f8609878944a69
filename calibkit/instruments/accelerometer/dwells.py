"""Logs of a triad → dwells: mean indication, temperature, reference attitude, noise."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np

from calibkit import check
from calibkit.errors import FitError, FrameError
from calibkit.instruments.accelerometer.forms import COMPONENTS, TEMPERATURE
from calibkit.instruments.accelerometer.recipe import AccelerometerRecipe
from calibkit.logs import stated_segments
from calibkit.numeric import attitude, dwells as stretches
from calibkit.numeric.arrays import Array, Integers
from calibkit.records.frame import Finding, Log, Remark, refuse, values

ATTITUDE = ("inclination_deg", "toolface_deg")
SATURATED_G = 50.0
"""Indication [g] above which a log cannot be in g: a triad is calibrated in the earth's gravity."""
COLUMNS = ("indication", "temperature", "inclination", "toolface", "noise", "time", "log")
"""Fields of `DwellSet` that are arrays, one entry per dwell."""
UNSTATED_DEGC = 25.0
"""Case temperature [°C] assumed for a magnitude-only log without a temperature column."""


@dataclass(frozen=True)
class DwellSet:
    """Dwells of all logs: indication [n, 3, g, positive along gravity], temperature [n, °C], angles
    [n, °], noise.

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

    @cached_property
    def reference(self) -> Array:
        """Reference gravity vectors [n, 3, g] from inclination and toolface."""
        return attitude.gravity_vector(self.inclination, self.toolface)

    def relative_noise(self, *, lengths: bool) -> Array:
        """Standard error [3 n] of each component, or [n] of each length [g]; 1 unless that of every
        dwell was measured.
        """
        noise = self.noise if np.all(self.noise > 0.0) else np.ones_like(self.noise)
        return np.sqrt(np.mean(noise**2, axis=1)) if lengths else noise.ravel()

    def without(self, rows: Iterable[int], flags: Iterable[str] = ()) -> "DwellSet":
        """Dwells without those at the rows, with further flags."""
        keep = np.setdiff1d(np.arange(len(self.place)), list(rows))
        return replace(
            self,
            **{name: getattr(self, name)[keep] for name in COLUMNS},
            place=tuple(self.place[k] for k in keep),
            flags=(*self.flags, *flags),
        )


def find_faults(log: Log, spec: AccelerometerRecipe) -> list[Finding]:
    """Faults of a log; a log with a refused fault is not fitted."""
    columns = log.frame.columns
    findings = [*check.find_too_few_rows(log, 1), *check.find_missing_values(log, list(columns))]
    if any(finding.refused for finding in findings):
        return findings
    if "time_s" in columns:
        findings += check.find_unordered_times(log)
    if TEMPERATURE in columns:
        findings += check.find_implausible_temperatures(log, [TEMPERATURE])
    limits = [(component, SATURATED_G, "g") for component in COMPONENTS]
    if spec.reference.kind == "attitude":
        limits += [("inclination_deg", 180.0, "deg"), ("toolface_deg", 360.0, "deg")]
    for column, limit, unit in limits:
        expected = f"at most {limit:g} {unit}"
        findings += check.find_out_of_range(log, column, -limit, limit, unit, expected)
    if any(finding.refused for finding in findings):
        return findings
    if spec.dwells.mode == "rows":
        findings += check.find_copied_rows(
            log, [name for name in (*COMPONENTS, TEMPERATURE, *ATTITUDE) if name in columns]
        )
    findings += check.magnitude.check_gravity_unit(log, COMPONENTS)
    findings += check.magnitude.find_compensated_names(log, spec, COMPONENTS)
    if spec.dwells.mode == "series":  # a gap ends a dwell
        findings += check.find_gaps(log, float("inf"))
        if TEMPERATURE in columns:
            findings += check.series.check_temperature(log, TEMPERATURE)
    return findings


def collect_dwells(logs: Iterable[Log], spec: AccelerometerRecipe) -> DwellSet:
    """Check every log and gather its dwells; raises FrameError or FitError naming the log."""
    parts, flags = [], []
    for log in logs:
        log_findings = find_faults(log, spec)
        refuse(log_findings)
        flags += [str(finding) for finding in log_findings if finding.flagged]
        parts.append(read_dwells(log, spec)[0])
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    columns["log"] = np.repeat(np.arange(len(parts)), [len(part.place) for part in parts])
    return DwellSet(
        **columns,
        place=tuple(chain.from_iterable(part.place for part in parts)),
        flags=(*chain.from_iterable(part.flags for part in parts), *flags),
    )


def read_dwells(log: Log, spec: AccelerometerRecipe) -> tuple[DwellSet, Integers]:
    """Dwells of a log, and first and end row [n, 2] of each: a row each, or stretches at rest of a
    continuous log, cut at gaps, and divided into pieces where the recipe states piece_s.
    """
    notes: tuple[str, ...] = tuple(f"{log.file}: {note}" for note in log.notes)
    inclination, toolface, time = (
        values(log.frame, name, np.nan) for name in (*ATTITUDE, "time_s")
    )
    temperature = values(log.frame, TEMPERATURE, UNSTATED_DEGC)
    logged = log.frame[[*COMPONENTS]].to_numpy(dtype=np.float64)
    indication = attitude.gravity_positive(logged, spec.reference.convention)
    columns = np.column_stack([indication, temperature])
    if spec.dwells.mode == "rows":
        first_rows = np.arange(len(columns))
        intervals = np.column_stack([first_rows, first_rows + 1])
        # a row is the mean of a dwell; how noisy it is, the fit finds from the residuals
        means, standard_errors = columns, np.full_like(columns, np.nan)
    else:
        intervals = find_intervals(log, indication, spec)
        means, standard_errors = stretches.average_dwells(columns, intervals)
        notes += (Remark(f"{log.file}: {len(intervals)} dwells found"),)
    # reference angles are read at the middle of the dwell
    middle = intervals.mean(axis=1).astype(np.int64)
    places = []
    for first, end in intervals.tolist():
        last = f"-{log.line(end - 1)}" if end - first > 1 else ""
        places.append(f"{log.file}:{log.line(first)}{last}")
    dwells = DwellSet(
        means[:, :3],
        means[:, 3],
        inclination[middle],
        toolface[middle],
        standard_errors[:, :3],
        time[middle],
        np.zeros(len(intervals), dtype=np.int64),
        tuple(places),
        notes,
    )
    return dwells, intervals


def find_intervals(log: Log, indication: Array, spec: AccelerometerRecipe) -> Integers:
    """First and end row [n, 2] of the dwells of a continuous log: those that the recipe states, or
    rest between the gaps of the log.
    """
    time, step = values(log.frame, "time_s"), log.steps.usual
    intervals = stated_segments.stated_rows(log, spec, ["dwell"])
    if intervals is None:
        # of three rows and fewer a standard deviation says nothing
        window = max(4, round(spec.dwells.window_s / step))
        limit, shortest = spec.dwells.noise_limit_g, max(2, round(spec.dwells.shortest_s / step))
        # a slow log has no gap where no row is missing
        gap = max(spec.dwells.max_gap_s, 2.5 * step)
        gaps = np.flatnonzero(np.diff(time) > gap) + 1
        at_rest = []
        try:
            for first, end in pairwise([0, *gaps.tolist(), time.size]):
                if end - first >= 4 * window:
                    part = indication[first:end]
                    rests = stretches.find_dwells(part, window, threshold=limit, shortest=shortest)
                    at_rest.append(first + rests)
        except FitError as error:
            raise FitError(f"{log.file}: {error.message}", hint=error.hint) from None
        if not at_rest:
            raise FrameError(
                f"{log.file}: too short for dwells of {spec.dwells.window_s:g} s", hint="log longer"
            )
        intervals = np.concatenate(at_rest)
    if spec.dwells.piece_s is not None:
        piece = max(2, round(spec.dwells.piece_s / step))
        intervals = stretches.cut_dwells(intervals, piece)
    return intervals

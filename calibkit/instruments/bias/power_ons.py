"""Logs → power-ons: spans of rows between which the instrument stayed on, as block means.

Each power-on has a turn-on bias of its own, and lags of the temperature go on within it: so a log
is cut where its clock begins anew, at gaps and at stated instants, and logs are joined where one
goes on when the other ends. Power-ons are cut into stretches, which `choice` leaves out in turn.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calibkit import units
from calibkit.errors import FitError
from calibkit.instruments.bias.numeric import settling
from calibkit.instruments.bias.recipe import ThermalTable
from calibkit.numeric import intervals
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.numeric.least_squares.fit import linear
from calibkit.numeric.thermal import pooled_fit
from calibkit.numeric.thermal.pooled_fit import Stack, ThermalLog
from calibkit.records.frame import Log, values

CASE = "temp_case_degc"
COLUMNS = ("time_s", CASE)
USUAL_INTERVAL_S = 10.0
RESTARTED_S, RESTARTED = 60.0, 0.05
"""How far [s], and by what share of the time before, a clock that runs backwards may be beyond its
first stamp and still have begun anew.
"""
STARTING_S = 180.0
"""Time after the start of a span over which its rate is measured, twice in turn."""
STEADY = 0.2
"""Relative difference of both rates up to which the temperature came to the log as it goes on."""
ON_A_RAMP_DEGC_MIN = 0.1
"""Rate from which on a span starts on a ramp."""
SURELY = 4.0
"""The same in standard uncertainties of the rate."""
STRETCHES = 12
"""Stretches of all power-ons together that are left out in turn."""
LEAST_BLOCKS = 12
"""Fewest blocks of a stretch, and of a power-on."""
SAME_SPAN = 0.9
"""Least share of the span of temperatures that a power-on keeps where its head is left out."""


@dataclass(frozen=True, slots=True)
class _Span:
    """Rows first … stop − 1 of a log, on a clock that other spans share where it is known, in one
    power-on or after another.
    """

    log: Log
    first: int
    stop: int
    begins: float
    """Instant of the first row [s], on the clock of all logs of `clock`."""
    ends: float
    """Instant of the last row [s]."""
    clock: str
    switched_on: bool
    """Whether the instrument was switched on again before."""
    note: str
    """Why it is another power-on, where a gap makes it one."""


@dataclass(frozen=True, slots=True)
class PowerOn:
    """Block means [n] of one power-on."""

    blocks: ThermalLog
    """Its indication is that of no channel."""
    indications: Mapping[str, Array]
    """Channel → block means without spikes [n]."""
    withheld: Mask
    """[n], blocks that the recipe keeps for a test."""
    fitted: Mask
    """[n], all others, without the head in which it settles."""
    spans: tuple[tuple[int, int, float], ...]
    """First row, row after the last and instant [s] of the first row on the blocks' clock."""
    notes: tuple[str, ...]
    """Notes on spans that start on a ramp, and on a head that is left out."""
    settles_s: float = 0.0
    """Time since its begin within which it settles."""

    def of_channel(self, channel: str) -> ThermalLog:
        """Block means of one channel."""
        return replace(self.blocks, indication=self.indications[channel])


def _restarted_rows(time: Array) -> Array:
    """Rows [k] at which the clock of a log [n, s] begins anew, as after a reboot; a stamp that is
    merely out of order is none.
    """
    back = np.flatnonzero(np.diff(time) <= 0.0) + 1
    elapsed = time[back - 1] - time[0]
    # a reboot begins near the first stamp; a row out of order lies near its neighbours
    anew = time[back] - time[0] <= np.maximum(RESTARTED_S, RESTARTED * elapsed)
    return np.asarray(back[anew & (elapsed > RESTARTED_S)])


def mend_clock(log: Log, spec: ThermalTable) -> Log:
    """Log whose time goes on where its clock begins anew, a whole model interval later."""
    import pandas as pd

    if "time_s" not in log.frame.columns:
        return log
    interval_s = USUAL_INTERVAL_S if spec.interval_s == "auto" else float(spec.interval_s)
    time = values(log.frame, "time_s")
    rows = _restarted_rows(time).tolist() if np.isfinite(time).all() else []
    if not rows:
        return log
    mended = time.copy()
    for row in rows:
        # on the grid of model intervals, so that no block holds rows of both power-ons
        passed = np.floor((mended[row - 1] - mended[0]) / interval_s) + 2.0
        mended[row:] += mended[0] + passed * interval_s - mended[row]
    note = f"the clock begins anew at {log.place(rows[0])}: taken as a power-on"
    columns = {str(name): values(log.frame, str(name)) for name in log.frame.columns}
    frame = pd.DataFrame(columns | {"time_s": mended}, log.frame.index, copy=False)
    return replace(log, frame=frame, notes=(*log.notes, note))


def find_power_ons(
    logs: Sequence[Log], raw: Sequence[Log], spec: ThermalTable, interval_s: float
) -> list[PowerOn]:
    """Power-ons of all logs, of which `raw` are as they were read, before their clocks were
    mended.
    """
    spans: list[_Span] = []
    for log, as_read in zip(logs, raw, strict=True):
        spans += _cut(log, as_read, spec, interval_s)
    # in the order of time where all logs have dates, else in the order of the files
    if all(span.clock.startswith("date-times") for span in spans):
        spans.sort(key=lambda span: span.begins)
    groups: list[list[_Span]] = []
    for span in spans:
        if groups and _goes_on(groups[-1][-1], span, spec):
            groups[-1].append(span)
        else:
            groups.append([span])
    # a power-on is named by its logs, and numbered where they have several
    names = [" + ".join(dict.fromkeys(span.log.name for span in group)) for group in groups]
    power_ons = []
    for k, (group, name) in enumerate(zip(groups, names, strict=True)):
        numbered = name if names.count(name) == 1 else f"{name}:{names[:k].count(name) + 1}"
        power_ons.append(_average(group, spec, interval_s, numbered))
    return power_ons


def leave_out_settling(power_ons: Sequence[PowerOn], channels: Sequence[str]) -> list[PowerOn]:
    """Power-ons without the heads in which channels settle by more than their temperature explains,
    where the rest goes over the same temperatures.
    """
    settled = list(power_ons)
    numbers = [k for k, entry in enumerate(power_ons) if entry.fitted.sum() >= LEAST_BLOCKS]
    of_channels = []
    for name in channels if numbers else ():
        stacked = Stack.of_logs([power_ons[number].of_channel(name) for number in numbers])
        of_channels.append(settling.find_settling(stacked))
    for number, *seen in zip(numbers, *of_channels, strict=True):
        power_on, until_s = power_ons[number], max(seconds for seconds, _ in seen)
        blocks, before = power_on.blocks, power_on.fitted
        after = before & (blocks.time - blocks.time[0] > until_s)
        # a head with temperatures of its own is needed for the model there, settled or not
        span = np.ptp(blocks.case[before])
        if until_s and after.any() and np.ptp(blocks.case[after]) >= SAME_SPAN * span:
            sizes = ", ".join(
                f"{name} settles by {-size:+.3g} {units.column_unit(name)}"
                for name, (seconds, size) in zip(channels, seen, strict=True)
                if seconds
            )
            note = (
                f"{blocks.name}: {sizes} within {until_s / SECONDS_PER_MINUTE:.0f} min of"
                " power-on, beyond what the temperature explains: this warm-up is left out of the"
                " fit, and the model holds after it"
            )
            settled[number] = replace(
                power_on,
                blocks=replace(blocks, fitted=after),
                fitted=after,
                notes=(*power_on.notes, note),
                settles_s=until_s,
            )
    return settled


def cut_stretches(
    power_ons: Sequence[PowerOn], interval_s: float
) -> tuple[list[PowerOn], tuple[str, ...]]:
    """Power-ons cut into stretches that are left out in turn, and notes on those that are too short
    to be fitted. Raises FitError for logs too short to leave stretches out.
    """
    counts = [int(np.count_nonzero(power_on.fitted)) for power_on in power_ons]
    total = sum(count for count in counts if count >= LEAST_BLOCKS)
    if total < 4 * LEAST_BLOCKS:
        raise FitError(
            f"{', '.join(entry.blocks.name for entry in power_ons)}: {total} intervals of"
            f" {interval_s:g} s in power-ons of at least {LEAST_BLOCKS}, expected at least"
            f" {4 * LEAST_BLOCKS} to leave stretches out",
            hint="log longer, or shorten [thermal] interval_s",
        )
    size = max(total / STRETCHES, LEAST_BLOCKS)
    cut, notes = [], []
    for power_on, count in zip(power_ons, counts, strict=True):
        if count < LEAST_BLOCKS:
            notes.append(
                f"{power_on.blocks.name}: a power-on of {count} intervals is not fitted, expected"
                f" at least {LEAST_BLOCKS}"
            )
            continue
        # stretches of about equal length: errors on them are pooled
        stretches = max(round(count / size), 1)
        place = np.cumsum(power_on.fitted) - 1
        part = np.clip(place * stretches // count, 0, stretches - 1).astype(np.int64)
        cut.append(replace(power_on, blocks=replace(power_on.blocks, part=part)))
    return cut, tuple(notes)


def _cut(log: Log, raw: Log, spec: ThermalTable, interval_s: float) -> Iterator[_Span]:
    """Spans of a log between gaps, restarts of its clock and stated power-ons."""
    time = values(log.frame, "time_s")
    # a gap is an interval at least, so that no block holds rows of both sides
    longest = max(spec.max_gap_s, interval_s, 2.5 * log.steps.usual)
    gaps = np.flatnonzero(np.diff(time) > longest)
    # The index numbers the rows of the file: where it jumps at a gap, the file has rows there that
    # the recipe excludes, or that lack a value. The instrument was logged, so it stayed on.
    skipped = log.frame.index[gaps + 1].to_numpy() - log.frame.index[gaps].to_numpy()
    logged_gaps = gaps[skipped > 1]
    power_on_times = [entry.at_s for entry in spec.power_on if entry.log in (log.file, log.name)]
    switched_on = {int(row) for row in np.searchsorted(time, power_on_times) if 0 < row < time.size}
    switched_on |= {int(row) for row in _restarted_rows(values(raw.frame, "time_s"))}
    unexplained = {int(row) + 1 for row in np.setdiff1d(gaps, logged_gaps)} - switched_on
    switched_on |= unexplained
    edges = sorted({0, time.size} | switched_on | {int(row) + 1 for row in gaps})
    zero, clock = 0.0, log.file
    if log.origin is not None:
        zero, clock = log.origin.nanoseconds / 1e9, log.origin.kind
    for first, stop in pairwise(edges):
        note = ""
        if first in unexplained:
            note = (
                f"{log.place(first)}: after a gap of {float(time[first] - time[first - 1]):g} s the"
                " instrument counts as switched on again; if it stayed on, raise [thermal]"
                " max_gap_s"
            )
        begins, ends = zero + float(time[first]), zero + float(time[stop - 1])
        yield _Span(log, first, stop, begins, ends, clock, first in switched_on, note)


def _goes_on(before: _Span, span: _Span, spec: ThermalTable) -> bool:
    """Whether a span belongs to the power-on of the one before: in the same log, in a log that goes
    on where the other ended, or as the recipe states.
    """
    if span.switched_on:
        return False
    if before.log is span.log:
        return True
    for session in spec.sessions:
        inside = [
            neighbour.log.file in session or neighbour.log.name in session
            for neighbour in (before, span)
        ]
        if any(inside):
            return all(inside)
    return _adjoins(before, span, spec)


def _adjoins(before: _Span, span: _Span, spec: ThermalTable) -> bool:
    """Whether a span begins on the same clock after another one has ended, without a long gap."""
    gap_s = span.begins - before.ends
    return before.clock == span.clock and 0.0 < gap_s <= spec.max_gap_s


def _average(group: Sequence[_Span], spec: ThermalTable, interval_s: float, name: str) -> PowerOn:
    """Block means of the spans of one power-on, on one clock."""
    parts: list[Array] = []
    starts, spans = [], []
    notes = [span.note for span in group if span.note]
    first_block, begins = 0, 0.0
    for before, span in zip([None, *group], group, strict=False):
        log = span.log
        time, case, *indications = (
            values(log.frame, column)[span.first : span.stop]
            for column in (*COLUMNS, *spec.channels)
        )
        blocks = intervals.Intervals.find(time, interval_s, log.steps.usual)
        seconds, temperature = blocks.means(time, origin=float(time[0])), blocks.means(case)
        # in a log the temperature before a gap says nothing of that after it
        joined = before is not None and not span.first and _adjoins(before, span, spec)
        if before is not None:
            gap_s = span.begins - before.ends if joined else interval_s
            begins += before.ends - before.begins + gap_s
        if not joined:
            rate = _starting_rate(seconds, temperature)
            starts.append((first_block, rate))
            if rate:
                notes.append(
                    f"{log.file}: begins while the temperature changes by {rate:+.2g} °C/min:"
                    " lags are taken as those of a steady ramp"
                )
        fitted, instants = np.ones(seconds.size, dtype=bool), seconds + time[0]
        for entry in spec.withheld:
            if entry.log in (log.file, log.name):
                # withheld indications are not fitted; their temperatures drive the lags all the
                # same
                fitted &= (instants < entry.from_s) | (instants > entry.to_s)
        means = [
            pooled_fit.means_without_spikes(
                indication, blocks, excluded=pooled_fit.spikes(indication, blocks)
            )
            for indication in indications
        ]
        parts.append(np.vstack([seconds + begins, temperature, fitted, *means]))
        spans.append((span.first, span.stop, begins))
        first_block += seconds.size
    time, case, is_fitted, *means = np.hstack(parts)
    fitted, no_indication = is_fitted == 1.0, np.zeros_like(time)
    part = np.zeros(time.size, dtype=np.int64)
    return PowerOn(
        ThermalLog(name, time, case, case, no_indication, part, fitted, tuple(starts)),
        dict(zip(spec.channels, means, strict=True)),
        ~fitted,
        fitted,
        tuple(spans),
        tuple(notes),
    )


def _starting_rate(time: Array, case: Array) -> float:
    """Rate [°C/min] at which the temperature came to the first of blocks [n], 0 unless it goes on
    steadily: a warm-up slows down, and a ramp that begins in the log speeds up.
    """
    rates = []
    for start in (0.0, STARTING_S):
        inside = (time >= start) & (time < start + STARTING_S)
        if np.count_nonzero(inside) < 5:
            return 0.0
        minutes = (time[inside] - time[inside][0]) / SECONDS_PER_MINUTE
        line = linear(np.column_stack([minutes, np.ones_like(minutes)]), case[inside])
        rates.append((float(line.coefficients[0]), float(line.standard_uncertainty[0])))
    (first, u_first), (second, u_second) = rates
    # a coil on a ramp has a constant rate; one that settles slows down
    steady = abs(first - second) <= STEADY * max(abs(first), abs(second))
    sure = abs(first) > SURELY * u_first and abs(second) > SURELY * u_second
    return 0.5 * (first + second) if steady and sure and abs(first) >= ON_A_RAMP_DEGC_MIN else 0.0

"""What a sensor or its logger did to a column that physics did not, as findings with their places.

A column is judged in chunks of at most CHUNK rows, so that a log of any length is judged alike,
whether it is read whole or in chunks.
"""

from itertools import pairwise

import numpy as np

from calibkit.check.content import finding_at_row
from calibkit.errors import advise_exclude
from calibkit.numeric import anomalies, chunks, dispersion
from calibkit.numeric.arrays import Array, Integers
from calibkit.records.frame import Finding, Log, values

SPIKE_DEGC = 0.5
"""Departure from its neighbours [°C] below which a temperature is no spike: air is turbulent."""
LEAD_DEGC = 5.0
"""Change of the chamber air [°C] that every case thermometer answers."""
UNEVEN = 1e-4
"""Share of an indication's span that the unevenness of a table may move it by."""
ONE_WAY = 0.8
"""Share of its span that a run ordered one way has gone when it ends."""
ONE_WAY_BLOCKS = 2000
"""Block medians that the course of a run is judged by."""
TURNED_BACK_DEGC, TURNED_BACK = 1.5, 0.02
"""How far [°C], and what share of its span, a run may go back: a case overshoots less."""
COARSE = 4.0
"""Resolution in standard deviations of the noise above which an indication is quantised."""
LEVELS = 16
"""Distinct values of a quantised indication, at most."""
CHUNK = 1 << 20
"""Rows of a column that are judged at once."""
RANGE_ENDED = "the range of the sensor or its logger ended there: log again, or leave the rows out:"
"""Advice where an indication is saturated."""


def check_indication(log: Log, column: str, unit: str) -> list[Finding]:
    """Spikes, stuck and clipped values, jumps of the bias, start-up rows and coarse steps of a
    static indication.
    """
    data = values(log.frame, column)
    stuck = anomalies.stuck(data)
    steps = _check_resolution(log, column, data, unit)
    return [
        *_check_start_up(log, column, data, unit),
        *_check_spikes(log, column, data, unit),
        *_report_stuck(log, column, data, stuck, unit),
        *(() if len(stuck) else _check_clipping(log, column, data, unit)),
        *(() if steps else _check_jumps(log, column, data, unit)),
        *steps,
    ]


def check_case_and_air(log: Log, case: str, air: str) -> list[Finding]:
    """Spikes and stuck thermometers of a case and the chamber air around it."""
    findings = []
    of_case, of_air = values(log.frame, case), values(log.frame, air)
    for column, data in ((case, of_case), (air, of_air)):
        findings += _check_spikes(log, column, data, "°C", least_height=SPIKE_DEGC)
    least_move_degc = max(LEAD_DEGC, 5.0 * anomalies.resolution(of_case))
    runs = anomalies.equal_runs(of_case, anomalies.SHORTEST_RUN)
    frozen = _merge_runs(
        anomalies.stuck_against(of_air, least_move_degc, runs),
        anomalies.frozen(of_case, SPIKE_DEGC, runs),
    )
    findings += _report_stuck(log, case, of_case, frozen, "°C")
    # a case comes to meet the air that stands still; a case that leaves it was driven by air that
    # the log does not show
    runs = anomalies.equal_runs(of_air, anomalies.SHORTEST_RUN)
    first, last = runs[:, 0], runs[:, 1] - 1
    left_air = (
        np.abs(of_case[last] - of_air[last]) - np.abs(of_case[first] - of_air[first])
        > least_move_degc
    )
    frozen = _merge_runs(runs[left_air], anomalies.frozen(of_air, SPIKE_DEGC, runs))
    return [*findings, *_report_stuck(log, air, of_air, frozen, "°C")]


def _merge_runs(first: Integers, second: Integers) -> Integers:
    """Runs [k, 2] of two searches, each once."""
    return np.unique(np.concatenate((first, second)), axis=0)


def check_temperature(log: Log, column: str) -> list[Finding]:
    """Spikes of one thermometer."""
    return _check_spikes(log, column, values(log.frame, column), "°C", least_height=SPIKE_DEGC)


def find_turn_back(log: Log, column: str) -> list[Finding]:
    """A run one way, from a temperature to another, that turns back on its way: the chamber stopped
    or was opened.

    A log that ends near where it began was ordered both ways and is not judged.
    """
    data = values(log.frame, column)
    block = max(data.size // ONE_WAY_BLOCKS, 5)
    count = data.size // block
    if count < 10:
        return []
    course = dispersion.run_medians(data[: count * block], block * np.arange(count))
    net, span = float(course[-1] - course[0]), float(np.ptp(course))
    if abs(net) < ONE_WAY * span:
        return []
    course = np.copysign(1.0, net) * course
    back = np.maximum.accumulate(course) - course
    k = int(np.argmax(back))
    if back[k] <= max(TURNED_BACK_DEGC, TURNED_BACK * span):
        return []
    first = int(np.argmax(course[: k + 1]))
    # finding turned_back: the case goes back in a log that otherwise goes one way
    return [
        finding_at_row(
            log,
            first * block,
            column,
            f"{'falls' if net > 0.0 else 'rises'} by {back[k]:.1f} °C from"
            f" {_format_times(log, first * block, (k + 1) * block)} of a run that goes the other"
            " way",
            expected="a temperature that goes one way",
            advice=(
                "if the chamber was not ordered so, cut the run with [[segment]], or leave it out:"
                f" {advise_exclude(log.file)}"
            ),
            name="turned_back",
            severity="warn",
            figure=float(back[k]),
        )
    ]


def check_driven_indication(
    log: Log, column: str, driver: str, unit: str, full_span: float
) -> list[Finding]:
    """Stuck or clipped values of an indication: it stands still while what drives it moves by a
    hundredth of its span and by three of the indication's own steps.

    `full_span` is the largest span of an indication in the log: a table's unevenness is a share of
    it, across its axis too.
    """
    data, cause = values(log.frame, column), values(log.frame, driver)
    low, high = log.extremes(driver)
    smallest, largest = log.extremes(column)
    share = max(
        0.01, 3.0 * anomalies.resolution(data) / max(largest - smallest, np.finfo(float).tiny)
    )
    runs = anomalies.stuck_against(
        cause, share * (high - low), anomalies.equal_runs(data, anomalies.SHORTEST_RUN)
    )
    noisy = anomalies.stuck(data)
    # an indication of held rates may be coarser than its noise: only values at an extreme are
    # called clipped then
    at_end = np.isin(data[noisy[:, 0]], log.extremes(column))
    findings = _report_stuck(log, column, data, _merge_runs(runs, noisy[at_end]), unit)
    # each hold by its own scatter: an acceleration is no spike
    moving = np.flatnonzero(np.abs(np.diff(cause)) > 1e-3 * (high - low)) + 1
    shortest = 8 * anomalies.WIDTH + 6
    spike_rows = [
        anomalies.spikes(data[a + 3 : b - 3], smallest_departure=UNEVEN * full_span) + a + 3
        for a, b in pairwise([0, *moving.tolist(), data.size])
        if b - a >= shortest
    ]
    if spike_rows:
        findings += _report_spikes(log, column, data, np.concatenate(spike_rows), unit)
    return findings


def _check_spikes(
    log: Log, column: str, data: Array, unit: str, *, least_height: float = 0.0
) -> list[Finding]:
    """Single rows far from their neighbours, looked for in chunks of CHUNK rows."""
    spike_rows = [
        anomalies.spikes(data[start:stop], smallest_departure=least_height) + start
        for start, stop in chunks.ranges(data.size, CHUNK)
    ]
    return _report_spikes(log, column, data, np.concatenate(spike_rows), unit) if spike_rows else []


def _report_spikes(
    log: Log, column: str, data: Array, spike_rows: Integers, unit: str
) -> list[Finding]:
    """One finding for the spikes at the rows found, at the worst."""
    if not spike_rows.size:
        return []
    height = anomalies.from_median(data, spike_rows)
    worst = int(spike_rows[np.argmax(height)])
    count = int(np.sum(np.diff(spike_rows, prepend=-2) > 1))
    before, after = data[max(worst - 1, 0)], data[min(worst + 1, data.size - 1)]
    # finding spike: a deviation from the neighbours that is gone after at most three rows
    return [
        finding_at_row(
            log,
            worst,
            column,
            f"a spike: {data[worst]:g} {unit} between {before:g} and {after:g} ({count} in the log,"
            " this the largest)",
            expected="samples that scatter alike",
            advice=(
                "only the models on levels are robust against spikes; leave them out:"
                f" {log.advise_exclude(spike_rows)}"
            ),
            name="spike",
            severity="warn",
            figure=float(height.max()),
        )
    ]


def _report_stuck(log: Log, column: str, data: Array, runs: Integers, unit: str) -> list[Finding]:
    """Values that stand still: saturated where they stand at the column's extreme, else stuck."""
    if not len(runs):
        return []
    length = runs[:, 1] - runs[:, 0]
    first, stop = runs[int(np.argmax(length))].tolist()
    value = float(data[first])
    name, advice = "stuck", "see to the sensor, and leave the range out:"
    # only an indication is called saturated, a reference is not
    if column.startswith(("gyro", "accel")) and value in chunks.extremes(data):
        name, advice = "saturated", RANGE_ENDED
    span = f" ({_format_times(log, first, stop)})" if "time_s" in log.frame.columns else ""
    further_text = f", the longest of {len(runs)} such runs" if len(runs) > 1 else ""
    # finding stuck: equal values for longer than chance explains
    # finding saturated: equal values at the extreme of the column
    return [
        finding_at_row(
            log,
            first,
            column,
            f"{name} at {value:g} {unit} for {stop - first} rows{span}{further_text}",
            "values that move",
            f"{advice} {log.advise_exclude(range(first, stop))}",
            name,
            severity="warn",
            figure=value,
        )
    ]


def _format_times(log: Log, first: int, stop: int) -> str:
    """Time that rows first … stop − 1 span, as words."""
    time = values(log.frame, "time_s")
    return f"{time[first]:.12g} s to {time[stop - 1]:.12g} s"


def _check_clipping(log: Log, column: str, data: Array, unit: str) -> list[Finding]:
    """Values that pile up at the largest or smallest."""
    pile = anomalies.clipped(data)
    if pile is None:
        return []
    count, value = pile
    rows = np.flatnonzero(data == value)
    # finding saturated: values pile up at the extreme of the column
    return [
        finding_at_row(
            log,
            int(rows[0]),
            column,
            f"saturated: {count} rows at the extreme value {value:g} {unit}",
            expected="extremes that few rows reach",
            advice=f"{RANGE_ENDED} {log.advise_exclude(rows)}",
            name="saturated",
            severity="warn",
            figure=value,
        )
    ]


def _check_jumps(log: Log, column: str, data: Array, unit: str) -> list[Finding]:
    """One finding for the sudden changes of the bias that stay, at the largest; a spike is none."""
    calm = anomalies.remove_spikes(data)
    rows, change = anomalies.jumps(calm, int(np.clip(data.size // 50, 20, 2000)))
    if not rows.size:
        return []
    k = int(np.argmax(np.abs(change)))
    further_text = f", the largest of {rows.size}" if rows.size > 1 else ""
    # finding jump: the bias changes suddenly and stays
    return [
        finding_at_row(
            log,
            int(rows[k]),
            column,
            f"the bias jumps by {change[k]:+.3g} {unit} and stays{further_text}",
            expected="a bias that drifts",
            advice=(
                "see that nothing was moved or restarted; split the log there, or leave the part"
                f" behind it out: {log.advise_exclude(range(int(rows[k]), len(data)))}"
            ),
            name="jump",
            severity="warn",
            figure=float(change[k]),
        )
    ]


def _check_start_up(log: Log, column: str, data: Array, unit: str) -> list[Finding]:
    """Rows at the head of a log that were written before the instrument ran."""
    count = anomalies.start_up(data)
    if not count:
        return []
    after = float(np.median(data[count : count + 100]))
    advice = f"leave them out: {log.advise_exclude(range(count))}"
    # finding start_up: rows at the head lie off the line through the rows behind them
    return [
        finding_at_row(
            log,
            0,
            column,
            f"{count} start-up row{'s' if count > 1 else ''}: {data[0]:g} {unit} at first,"
            f" {after:g} {unit} behind them",
            "a log that begins with the instrument running",
            advice,
            "start_up",
            severity="warn",
            figure=float(count),
        )
    ]


def _check_resolution(log: Log, column: str, data: Array, unit: str) -> list[Finding]:
    """An indication whose steps hide its noise."""
    step = anomalies.resolution(data)
    if data.size < 100 or step == 0.0 or np.unique(anomalies.sample(data)).size > LEVELS:
        return []
    distinct = int(np.unique(data[: 4 * CHUNK]).size)
    if distinct > LEVELS or anomalies.repeats(data) < anomalies.NOISY:
        return []
    if step < COARSE * anomalies.scatter(data) and distinct > 4:
        return []
    # finding quantisation: an indication has so few values that its steps hide its noise
    return [
        finding_at_row(
            log,
            0,
            column,
            f"{distinct} distinct values in {data.size} rows, {step:g} {unit} apart",
            expected="steps smaller than the noise",
            advice=(
                "log with a finer resolution: what is smaller than a step is not seen, and noise"
                " does not average out"
            ),
            name="quantisation",
            severity="warn",
            figure=step,
        )
    ]

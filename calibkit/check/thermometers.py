"""Case and chamber air: whether they are read in one unit and sign, and which of the two is which.

On a ramp the case follows the air behind a lag, and in time it moves as far: case − air = offset +
(gain − 1) · air − lag · rate with a gain of 1 and a positive lag. A gain of 9/5 or 5/9 with the
zero point of °F is a unit, a negative lag an exchange.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from calibkit.check.content import finding_at_row, finding_of_column
from calibkit.check.magnitude import SPAN_DEGC
from calibkit.errors import advise_exclude
from calibkit.numeric import segments
from calibkit.numeric.anomalies import LEVEL_ROWS, level_steps
from calibkit.numeric.arrays import Array
from calibkit.records.frame import Finding, Log, Severity, values

APART_DEGC = 20.0
"""Difference [°C] of case and air that no self-heating keeps up in a soak."""
STILL_DEGC = 0.3
"""Change [°C] within a fiftieth of a log below which a temperature stands still."""
FAHRENHEIT, ZERO_DEGF = 1.8, 32.0
GAIN = 0.12
"""Deviation of the gain from 1 from which the unit is looked into.

On 400 simulated ramps of 1 to 10 °C/min in one unit the gain is 0.91 to 1 (air over case: 1 to
1.05): a lag of more than one node is no pure delay.
"""
LAGS_S = np.geomspace(10.0, 7200.0, 40)
"""Lags of a case behind the air [s]."""
FOLLOWS = 0.5
"""Misfit of a lag with one of the two in °F over that with both in °C, below which it is in °F."""
MISFIT_DEGC = 6.0
"""Misfit of one lag that a case of several lags, and a warmer inside, may have [°C].

Of 270 simulated logs of one to three lags of 60 to 1200 s and soaks of 60 to 2400 s it is more in
one (6.1).
"""
LEAST_LEAD_DEGC = 2.0
"""_Lead of the case over the air [°C] that noisy thermometers do not show."""
SURE = 0.5
"""Correlation of the lead with the rate from which it is one; on the same ramps, exchanged, it is
0.8 and more.
"""
ORDERED = 0.3
"""Relative deviation of a measured rate from the recipe's that a chamber may have."""
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_SIGNED = re.compile(r"[-+mnp]?\d+(?:\.\d+)?", re.IGNORECASE)
"""The same with what stands for a sign: −40 is m40 in names."""
AGREE = 0.06
"""Relative deviation of measured rates from 9/5 of those that were ordered, up to which all are
that.
"""
NAMED_DEGC, NAMED_SPREAD = 4.0, 20.0
"""Difference [°C] of a temperature from the set point that its log is named after, at most, and
least spread of such numbers: those of runs that are counted are closer together.
"""
ALIKE_NAMES, MISNAMED_DEGC = 3, 10.0
"""Different set points in names that agree, at least, where one that does not is named, and how far
[°C] that is off, at least: a chamber may miss its set point.
"""
SAME_DEGC = 2.0
"""Difference [°C] of the ends of two logs that were driven between the same set points."""
BEYOND_DEGC, HOT_DEGC = 5.0, 100.0
"""How far [°C] beyond all others a log in °F goes, at least, and from where on no chamber may have
gone there: −40 to 70 °C beside −40 to 21 °C are two ranges as well as one.
"""
LATE_DEGC, LATE = 1.5, 0.06
"""How much later [°C], and as a share of the lag, a case follows the air in one of two ramps alike.

In 24 ramps of 3 simulated gyros it is 0.3 °C and 3 % at most, in 30 pairs of other cases of one to
three lags 0.14 °C.
"""
_STATION_SPREAD_DEGC, _STATION_STEP_DEGC = 5.0, 15.0
"""Spread of temperature within a station, and least step to the next one, that are looked into."""
_STEPS = 10.0
"""Steps from station to station, in medians, that a tool which warms steadily does not make."""
_SAME = 4
"""Stations at one reading of a thermometer that else never reads the same twice."""
_STEP_DEGC, _STEP_DEGC_MIN = 5.0, 60.0
"""Least change of the level [°C] and its rate [°C/min] that are a step."""
BLOCKS = 600
"""Block means that the two are compared by."""
NEAR_ZERO_DEGC = 1.0
"""Lowest reading [°C] from which on a log does not come to 0."""
TURN_S, COURSE_S = 60.0, 300.0
"""Times [s] on each side of a lowest reading over which its turn and its course are measured."""
TURNS_AT_ONCE, AS_FAST = 0.7, 0.65
"""Share of the rate of its course that a temperature without sign has within TURN_S, and of the
larger rate that the smaller one is. A case with a lag of 30 s that is driven to and fro has 0.63
and less.
"""
LEAST_RATE_DEGC_MIN = 0.3
"""Rate [°C/min] below which a turn is not judged."""


@dataclass(frozen=True, slots=True)
class _Lead:
    """The follower f and its driver d: f = offset + gain · d − lag · rate, by least squares."""

    gain: float
    offset: float
    """Follower where the driver is 0, at rest [unit]."""
    lag_s: float
    """Lag of the follower [s]; negative where it runs ahead."""
    correlation: float
    """Of the follower's deficit with the rate, both without what offset and gain explain: 1 for a
    pure lag, −1 for a lead.
    """
    swing: float
    """Range of the deficit that the rates make [unit]."""


def _fit_lead(time: Array, follower: Array, driver: Array) -> _Lead:
    """Gain, offset and lag of a follower [n] to its driver [n] over time [n, s].

    The rate is that of the mean of both, by central differences of block means: an exchange of the
    two changes the sign of the lag and nothing else, and so does a unit of time that is not
    seconds.
    """
    count = min(BLOCKS, time.size // 3)
    if count < 10:
        return _Lead(1.0, 0.0, 0.0, 0.0, 0.0)
    t, f, d = (_block_means(series, count) for series in (time, follower, driver))
    scale = (float(np.ptp(f)) or 1.0) / (float(np.ptp(d)) or 1.0)
    rate = np.gradient(0.5 * (f / scale + d), t)
    nuisance = np.column_stack([np.ones(count), d])
    design = np.column_stack([nuisance, -rate])
    offset, gain, lag = np.linalg.lstsq(design, f, rcond=None)[0].tolist()
    residual_rate, residual = (
        series - nuisance @ np.linalg.lstsq(nuisance, series, rcond=None)[0]
        for series in (-rate, f)
    )
    power = float(np.sqrt((residual_rate @ residual_rate) * (residual @ residual)))
    correlation = float(residual_rate @ residual) / power if power > 0.0 else 0.0
    return _Lead(gain, offset, lag, correlation, abs(lag) * float(np.ptp(rate)))


def _block_means(series: Array, count: int) -> Array:
    """Means of `count` blocks."""
    edges = np.linspace(0, series.size, count + 1).astype(np.int64)
    sums: Array = np.add.reduceat(series, edges[:-1])
    return sums / np.diff(edges)


def check_stations(log: Log, station: str, column: str) -> list[Finding]:
    """A thermometer that jumps within a station or between two of a tool that warms steadily, or
    that stays while the tool goes on.
    """
    numbers, data = values(log.frame, station), values(log.frame, column)
    first = np.flatnonzero(np.diff(numbers, prepend=np.nan) != 0.0)
    if first.size < 2 * _SAME:
        return []
    spread = np.maximum.reduceat(data, first) - np.minimum.reduceat(data, first)
    level = np.add.reduceat(data, first) / np.diff(first, append=data.size)
    steps = np.abs(np.diff(level))
    usual = float(np.median(steps))
    outliers = []
    k = int(np.argmax(spread))
    if spread[k] > max(_STATION_SPREAD_DEGC, 5.0 * float(np.median(spread))):
        outliers.append(
            (first[k], f"{spread[k]:.1f} °C within a station", "one temperature", spread[k])
        )
    k = int(np.argmax(steps))
    if usual > STILL_DEGC and steps[k] > max(_STATION_STEP_DEGC, _STEPS * usual):
        usually = f"about {usual:.1f} °C, as between the others"
        jump = f"{steps[k]:.1f} °C from one station to the next"
        outliers.append((first[k + 1], jump, usually, steps[k]))
    run_starts = np.concatenate([[0], np.flatnonzero(steps != 0.0) + 1, [level.size]])
    run_lengths = np.diff(run_starts)
    k = int(np.argmax(run_lengths))
    # a coarse thermometer repeats its reading in several places; one that was not read, in one
    is_only_run = np.sum(run_lengths > 1) == 1
    if run_lengths[k] >= _SAME and is_only_run and run_starts.size > 2 * _SAME:
        stays = f"{level[run_starts[k]]:g} °C at {run_lengths[k]} stations in a row"
        outliers.append((first[run_starts[k]], stays, "readings that differ, as elsewhere", 0.0))
    # finding thermometer: a thermometer jumps within or between stations, or stays while the tool
    # warms
    return [
        finding_at_row(
            log,
            int(row),
            column,
            observation,
            expected,
            "see whether the thermometer was read; else leave the station out:"
            f" {advise_exclude(log.file, stations=[numbers[row]])}",
            "thermometer",
            severity="warn",
            figure=figure,
        )
        for row, observation, expected, figure in outliers
    ]


def check_steps(log: Log, column: str) -> list[Finding]:
    """A thermometer of a sampled log that steps from one row to the next, and stays there for four
    rows or more, further than it moves within four rows elsewhere and than a chamber can.
    """
    data, time = values(log.frame, column), values(log.frame, "time_s")
    if data.size < 5 * LEVEL_ROWS:
        return []
    steps = level_steps(data)
    k = int(np.argmax(steps))
    step = float(steps[k])
    if step <= max(_STEP_DEGC, _STEP_DEGC_MIN / 60.0 * float(time[k + LEVEL_ROWS] - time[k])):
        return []
    if step <= _STEPS * float(np.quantile(steps, 0.9)):
        return []
    row = k + 1 + int(np.argmax(np.abs(np.diff(data[k : k + 2 * LEVEL_ROWS]))))
    # finding thermometer: a thermometer steps further between two rows than a chamber can
    return [
        finding_at_row(
            *(log, row, column),
            f"{data[row - 1]:.2f} → {data[row]:.2f} °C from one row to the next",
            "a temperature that moves as elsewhere in the log",
            "see whether the thermometer was exchanged, or its range or unit; leave out the rows:"
            f" {log.advise_exclude([row])}",
            "thermometer",
            severity="warn",
            figure=step,
        )
    ]


def find_lost_sign(log: Log, column: str) -> list[Finding]:
    """A temperature that falls to 0 °C and rises at once as fast as it fell: it lost its sign, as
    the heat in a case lets none turn within a minute.
    """
    low, _ = log.extremes(column)
    if not 0.0 <= low <= NEAR_ZERO_DEGC:
        return []
    data, time = values(log.frame, column), values(log.frame, "time_s")
    row = int(np.argmin(data))
    # rates [°C/min] before and after the lowest reading, in its turn and in its course
    rates = np.zeros((2, 2))
    for side, way in enumerate((-1.0, 1.0)):
        for k, seconds in enumerate((TURN_S, COURSE_S)):
            ends = sorted((time[row], time[row] + way * seconds))
            first, stop = np.searchsorted(time, ends, side="left")
            if stop - first >= 5 and abs(time[stop - 1] - time[first]) >= 0.5 * seconds:
                rates[side, k] = segments.straight_slope(time[first:stop], data[first:stop])
    turn, course = rates[:, 0] * [-1.0, 1.0], rates[:, 1] * [-1.0, 1.0]
    if not (
        course.min() > LEAST_RATE_DEGC_MIN
        and turn.min() > AS_FAST * turn.max()
        and np.all(turn > TURNS_AT_ONCE * course)
    ):
        return []
    # finding lost_sign: a temperature falls to 0 °C and rises at once as fast: it lost its sign
    return [
        finding_at_row(
            log,
            row,
            column,
            f"it falls to {low:.2g} °C at {-rates[0, 0]:.2g} °C/min and rises at once at"
            f" {rates[1, 0]:.2g} °C/min",
            "a temperature that goes on below 0 °C, or turns within minutes",
            "the thermometer is logged without its sign: log it with its sign",
            "lost_sign",
            severity="refuse",
            figure=float(low),
        )
    ]


def check_pair(log: Log, case: str, air: str) -> list[Finding]:
    """Case and chamber air that do not move together, or do not meet in a soak, as one unit and
    sign do, or are exchanged.
    """
    (a_low, a_high), (b_low, b_high) = log.extremes(case), log.extremes(air)
    if b_high - b_low < 2.0 * SPAN_DEGC or a_high - a_low < SPAN_DEGC:
        return []
    a, b = values(log.frame, case), values(log.frame, air)
    thinned = slice(None, None, a.size // 20_000 + 1)
    correlation = float(np.corrcoef(a[thinned], b[thinned])[0, 1])
    if correlation < -0.5:
        # finding sign: case and chamber air move against each other
        return [
            finding_of_column(
                log,
                case,
                "it falls while the chamber air rises",
                expected="both to rise together",
                advice=(
                    f"a sign is wrong: state sign = -1 in [columns.{case}] or [columns.{air}], or"
                    " see to the wiring"
                ),
                name="sign",
                figure=correlation,
            )
        ]
    lead = _fit_lead(values(log.frame, "time_s"), a, b)
    findings = _find_unit(log, case, air, lead) or _find_apart(log, case, air, a, b)
    if findings or lead.correlation > -SURE or lead.swing < LEAST_LEAD_DEGC:
        return findings
    # finding swapped: the case runs ahead of the air that drives it: the columns are exchanged
    return [
        finding_of_column(
            log,
            case,
            f"it runs ahead of the chamber air, by {lead.swing:.1f} °C at the log's fastest"
            f" ({-lead.lag_s:.3g} s)",
            expected="a case that lags behind",
            advice=f"{case} and {air} are swapped, in the log or in [columns]",
            name="swapped",
            figure=-lead.lag_s,
            severity="refuse",
        )
    ]


def _find_unit(log: Log, case: str, air: str, lead: _Lead) -> list[Finding]:
    """One of the two in °F: with it the case follows the air through a lag; with both in °C neither
    follows the other.

    A case that soaks are too short for moves less than the air, by as much as °C in place of °F
    would: its gain alone is no proof. Nor is a lag that fits better in °F, where that of °C fits as
    well as a case of several lags lets expect.
    """
    if abs(lead.gain - 1.0) < GAIN:
        return []
    time, a, b = (values(log.frame, column) for column in ("time_s", case, air))
    in_degc = min(_misfit(time, a, b), _misfit(time, b, a))
    if in_degc < MISFIT_DEGC:
        return []
    cooler = [(x - ZERO_DEGF) / FAHRENHEIT for x in (a, b)]
    for column, other, misfit_in_degf in (
        (case, air, _misfit(time, cooler[0], b)),
        (air, case, _misfit(time, a, cooler[1])),
    ):
        if misfit_in_degf < FOLLOWS * in_degc and misfit_in_degf < MISFIT_DEGC:
            gain = lead.gain if column == case else 1.0 / lead.gain
            offset = lead.offset if column == case else -lead.offset / lead.gain
            # finding unit: one of case and chamber air is in °F
            finding = finding_of_column(
                log,
                column,
                f"it moves by {gain:.3g} for each °C of '{other}' and is {offset:.3g} at 0 °C",
                expected="a case that follows the air through a lag, as it does if this is °F",
                advice=f'it is in °F: state it, [columns.{column}] unit = "degF"',
                name="unit",
                figure=gain,
                severity="refuse",
            )
            return [finding]
    return []


def _misfit(time: Array, case: Array, air: Array) -> float:
    """Rms [°C] of a case [n, °C] about the best first-order lag of the air [n, °C], which starts at
    the first case temperature.
    """
    count = min(BLOCKS, time.size // 3)
    if count < 10:
        return 0.0
    t, c, d = (_block_means(series, count) for series in (time, case, air))
    decay = np.exp(-np.diff(t)[:, None] / LAGS_S)
    lagged_air = np.empty((count, LAGS_S.size))
    lagged_air[0] = c[0]
    middle = 0.5 * (d[1:] + d[:-1])
    for k in range(count - 1):
        lagged_air[k + 1] = middle[k] + (lagged_air[k] - middle[k]) * decay[k]
    return float(np.sqrt(np.mean((lagged_air - c[:, None]) ** 2, axis=0)).min())


def _find_apart(log: Log, case: str, air: str, a: Array, b: Array) -> list[Finding]:
    """A case [n, °C] that does not come to the temperature of the air [n, °C] in a soak at an end
    of the log, where both stand still.
    """
    rows = max(20, a.size // 50)
    for end in (slice(0, rows), slice(a.size - rows, None)):
        half = a[end].size // 2
        moves = [column[end][half:].mean() - column[end][:half].mean() for column in (a, b)]
        of_case, of_air = float(a[end].mean()), float(b[end].mean())
        if max(map(abs, moves)) >= STILL_DEGC or abs(of_case - of_air) <= APART_DEGC:
            continue
        advice = (
            f"one of them is in another unit or belongs to another sensor: see [columns.{case}] and"
            f" [columns.{air}]"
        )
        for column, value, other in ((case, of_case, of_air), (air, of_air, of_case)):
            if abs((value - ZERO_DEGF) / FAHRENHEIT - other) < APART_DEGC / 2.0:
                advice = f'it looks like °F: state it, [columns.{column}] unit = "degF"'
                break
        # finding unit: the case does not come to the temperature of the air in a soak
        finding = finding_of_column(
            log,
            case,
            f"{of_case:.4g} °C in a soak at {of_air:.4g} °C of '{air}'",
            expected="a case that comes to the air's temperature",
            advice=advice,
            name="unit",
            figure=of_case - of_air,
        )
        return [finding]
    return []


def check_stated_rate(log: Log, air: str, recipe_rate: float, measured: float) -> list[Finding]:
    """A ramp whose measured rate [°C/min] is not the one that the recipe gives."""
    if recipe_rate and abs(measured / recipe_rate - 1.0) <= ORDERED:
        return []
    advice = "correct the rate in [drift.rates_degc_min], or leave it out: it is measured then"
    if recipe_rate and abs(measured / recipe_rate / FAHRENHEIT - 1.0) <= AGREE:
        advice = (
            'the temperatures look like °F (9/5): state unit = "degF" of each in [columns]; or'
            " correct the rate"
        )
    # finding unit: a ramp is not at the rate that the recipe or the logs' names state
    return [
        finding_of_column(
            log,
            air,
            f"the chamber air changes at {measured:+.3g} °C/min, the recipe says {recipe_rate:+g}",
            "the rate that the recipe gives",
            advice,
            "unit",
            measured,
        )
    ]


def check_rates_in_names(measured: Mapping[str, float]) -> list[tuple[str, Finding]]:
    """Logs that are named after their rates and ran 9/5 times as fast; `measured` is log file →
    rate [°C/min].
    """
    numbers = _numbers_in_names(measured)
    places = range(min(map(len, numbers.values()), default=0))
    for k in places:
        # the number in this place of the names may be what was ordered
        rates = {file: (numbers[file][k], rate) for file, rate in measured.items()}
        findings = _find_fahrenheit(rates)
        if findings:
            return findings
    return []


def measure_lag(time: Array, case: Array, air: Array) -> float:
    """Lag [s] of a case [n, °C] behind the air [n, °C] over time [n, s]."""
    return _fit_lead(time, case, air).lag_s


def find_late(ramps: Mapping[str, tuple[float, float, float]]) -> list[tuple[str, Finding]]:
    """Pairs of logs of one ramp each, at the same rate up or down and between the same soaks, in
    one of which the case follows the air later; `ramps` is log file → rate [°C/min], duration [s]
    and lag [s].
    """
    findings = []
    for pair in combinations(ramps, 2):
        early, late = sorted(pair, key=lambda file: ramps[file][2])
        rate, duration, lag = np.abs(ramps[late])
        other_rate, other_duration, other_lag = np.abs(ramps[early])
        same_ramp = (
            abs(rate / other_rate - 1.0) < AGREE and abs(duration / other_duration - 1.0) < AGREE
        )
        delay_degc = (lag - other_lag) * rate / 60.0
        if same_ramp and delay_degc > LATE_DEGC and lag - other_lag > LATE * other_lag:
            # finding thermometer: the case follows the air later than in another ramp of the same
            # rate
            finding = Finding(
                f"{late}: column 'temp_case_degc'",
                f"it follows the air {delay_degc:.1f} °C later ({lag:.0f} s) than in {early}"
                f" ({other_lag:.0f} s), a ramp at the same rate",
                expected="a case with one lag",
                advice=(
                    "a thermometer was stuck or late in one of the two: see which, and leave that"
                    f" one out: {advise_exclude(late)}"
                ),
                severity="warn",
                name="thermometer",
                figure=delay_degc,
                column="temp_case_degc",
            )
            findings.append((late, finding))
    return findings


def find_other_units(
    measured: Mapping[str, Sequence[tuple[str, float, float]]],
) -> list[tuple[str, Finding]]:
    """Logs whose thermometer is in °F beside logs in °C, or shows another level than the set point
    of their name; `measured` is log file → (column, lowest, highest reading).
    """
    findings = []
    for column in dict.fromkeys(name for ends in measured.values() for name, *_ in ends):
        ends = {
            file: np.array([low, high])
            for file, readings in measured.items()
            for name, low, high in readings
            if name == column
        }
        groups: dict[str, dict[str, Array]] = {}
        for file, pair in ends.items():
            groups.setdefault(_SIGNED.sub("#", file), {})[file] = pair
        findings += list(
            chain(*(_find_unnamed_levels(group, column) for group in groups.values()))
        ) or _find_ends_in_degf(ends, column)
    return findings


def _find_unnamed_levels(ends: Mapping[str, Array], column: str) -> list[tuple[str, Finding]]:
    """Logs whose names differ by set points, and whose lowest, highest or mean temperature shows
    them in °F, or those of the others do and theirs does not.
    """
    numbers = _numbers_in_names(ends)
    for place in range(min(map(len, numbers.values()), default=0)):
        set_point = {file: numbers[file][place] for file in ends}
        deviation = {file: _off_set_point(ends[file], set_point[file]) for file in ends}
        agreeing = {set_point[file] for file in ends if deviation[file] <= NAMED_DEGC}
        deviating = [file for file in ends if deviation[file] > NAMED_DEGC]
        in_degf = [
            file
            for file in deviating
            if _off_set_point(_from_degf(ends[file]), set_point[file]) <= NAMED_DEGC
        ]
        if np.ptp(list(set_point.values())) < NAMED_SPREAD or not deviating:
            continue
        if in_degf == deviating:
            return [
                (
                    file,
                    _in_degf(file, column, ends[file], f"the {set_point[file]:g} °C of its name"),
                )
                for file in in_degf
            ]
        file = deviating[0]
        is_only_one = len(agreeing) >= ALIKE_NAMES and len(deviating) == 1
        if is_only_one and deviation[file] > MISNAMED_DEGC:
            # finding thermometer: a log's temperatures belie the set point in its name
            finding = Finding(
                f"{file}: column '{column}'",
                "{:.1f} to {:.1f} °C".format(*ends[file]) + f", its name says {set_point[file]:g}",
                expected=f"what its name says, as in the other {len(ends) - 1} logs",
                advice="see whether the thermometer was read and its place, or name the log anew",
                severity="warn",
                name="thermometer",
                figure=deviation[file],
                column=column,
            )
            return [(file, finding)]
    return []


def _off_set_point(ends: Array, number: float) -> float:
    """Least distance [°C] of the lowest, highest and mean temperature [2, °C] from a number, of
    either sign: names write −40 as m40.
    """
    levels = np.array([*ends, ends.mean()])
    return float(np.abs(np.abs(levels) - number).min())


def _find_ends_in_degf(ends: Mapping[str, Array], column: str) -> list[tuple[str, Finding]]:
    """Logs over a range that in °F is the range of another log, and goes beyond all of those in °C;
    sure where it goes further than such logs do in °C.
    """
    twins = {}
    for file, ends_degf in ends.items():
        if np.ptp(ends_degf) >= NAMED_SPREAD:
            ends_degc = _from_degf(ends_degf)
            twins[file] = [
                other
                for other, pair in ends.items()
                if np.abs(ends_degc - pair).max() <= SAME_DEGC and other != file
            ]
    in_degc = {file: pair for file, pair in ends.items() if not twins.get(file)}
    highest = max((pair[1] for pair in in_degc.values()), default=np.inf)
    findings = []
    for file, file_twins in twins.items():
        twins_in_degc = [other for other in file_twins if other in in_degc]
        if twins_in_degc and ends[file][1] > highest + BEYOND_DEGC:
            severity: Severity = "refuse" if ends[file][1] > HOT_DEGC else "warn"
            range_text = f"the range of {twins_in_degc[0]}"
            findings.append((file, _in_degf(file, column, ends[file], range_text, severity)))
    return findings


def _from_degf(temperature: Array) -> Array:
    """Temperatures [n] in °C from those in °F."""
    return (temperature - ZERO_DEGF) / FAHRENHEIT


def _in_degf(
    file: str, column: str, ends: Array, equivalent: str, severity: Severity = "refuse"
) -> Finding:
    """Finding on a log's thermometer in °F."""
    # finding unit: a log's temperatures are in °F beside other logs in °C
    return Finding(
        f"{file}: column '{column}'",
        "{:.1f} to {:.1f}".format(*ends) + f", in °F {equivalent}",
        expected="the logs of a campaign in one unit",
        advice=(
            f"it is in °F: write the unit into the log's header, state [columns.{column}] unit ="
            f' "degF" where all logs are, or leave the log out: {advise_exclude(file)}'
        ),
        severity=severity,
        name="unit",
        figure=float(ends[1]),
        column=column,
    )


def _numbers_in_names(files: Iterable[str]) -> dict[str, list[float]]:
    """File → the numbers in its name."""
    return {
        file: [float(text) for text in _NUMBER.findall(file.rsplit(".", 1)[0])] for file in files
    }


def _find_fahrenheit(rates: Mapping[str, tuple[float, float]]) -> list[tuple[str, Finding]]:
    """Logs whose chamber changed 9/5 times as fast as was ordered: all temperatures are in °F,
    which no other check can show.

    `rates` holds log file → (ordered, measured) rate [°C/min]; at least two different ones must
    agree.
    """
    ratios = {
        file: abs(measured / ordered) for file, (ordered, measured) in rates.items() if ordered
    }
    different = {abs(ordered) for ordered, _ in rates.values()}
    if len(different) < 2 or any(
        abs(ratio / FAHRENHEIT - 1.0) > AGREE for ratio in ratios.values()
    ):
        return []
    file = next(iter(ratios))
    ordered, measured = rates[file]
    # finding unit: all temperatures are in °F: the chamber was 9/5 as fast as ordered
    finding = Finding(
        file,
        f"{abs(measured):.3g} °C/min where {abs(ordered):g} was ordered, and as much too fast in"
        f" all {len(rates)} logs (9/5)",
        expected="the rates that the logs are named after",
        advice=(
            'all temperatures look like °F: state unit = "degF" of each temperature in [columns]'
        ),
        severity="warn",
        name="unit",
        figure=ratios[file],
    )
    return [(file, finding)]

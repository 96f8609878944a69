"""Logs of a rate table → held rates Ω of the table and means F of every gyro over them.

They are the rows of `equation`, (1), in every run (`held_rates`). What is wrong with a log is found
here too: columns, units and signs, too few rates, and held rates in which a gyro does not follow:

    F < F0 + ½ K Ω (towards rest), between rows that respond: pulses were lost               (1)
    F passes halfway between two held rates later, or earlier, than the table's rate does    (2)

K and F0 are medians over the held rates; (2) means that rows of the gyro are stamped late or
early, or that it is filtered.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from calibkit import check
from calibkit.check.content import finding_of_column
from calibkit.errors import FitError, advise_exclude
from calibkit.instruments.gyro_scale import forms, held_rates
from calibkit.instruments.gyro_scale.held_rates import HeldMeans
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroRecipe
from calibkit.logs import log_files, stated_segments
from calibkit.numeric import anomalies, chunks, dispersion, earth
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import DPH_PER_DPS
from calibkit.numeric.dispersion import mad_sigma
from calibkit.records.frame import Examined, Finding, Held, Log, refuse, values

ANGLE = "table_angle_deg"
FASTEST_DPS = 2e4
"""Table rate [°/s] above every real table's: the column is in another unit."""
HALF_TURN_DEG = 180.0
"""Turn [°] between two rows from which the wrapped angle is ambiguous."""
SHARE = 0.5
"""Share of the expected indication below which a row is a dropout."""
CLEAR = 8.0
"""Standard deviations of single rows that a dropout is below what is expected."""
CERTAIN, LEAST_OFF = 5.0, 3e-6
"""Standard uncertainties, and relative difference, from which the table's angle contradicts its
rate: encoders keep a rate within 1 ppm.
"""
BETWEEN, LEAST_CHANGES = 0.05, 3
"""Share of the change from one held rate to the next by which a row lies between both, and changes
from which a delay is measured, at least.
"""


@dataclass(frozen=True)
class TableRun:
    """One log: its held rates.

    Attributes
    ----------
    reference : logged table rate, or the rate that the logged table angle turned by: the better
        one where the rate is noisy or only commanded.
    temp_range : lowest and highest row temperature [°C]: of the whole run where it was
        isothermal, else of its held rates; NaN where none was logged. The calibrated range is
        that of the soak's rows, not of their mean: it contains all rows of the run.

    """

    log: Log
    gyros: tuple[str, ...]
    plateaus: HeldMeans
    reference: Literal["rate", "angle"]
    flags: tuple[str, ...]
    temp_range: tuple[float, float]

    @property
    def rate_dps(self) -> Array:
        """Reference [p] [°/s]."""
        means = self.plateaus
        return means.rate_dps if self.reference == "rate" else means.angle_rate_dps

    @property
    def slopes(self) -> Array:
        """Scale factors [m] of the gyros, by least squares over the held rates as they were
        logged.
        """
        return np.asarray(np.polyfit(self.rate_dps, self.plateaus.indication, 1)[0])

    @property
    def temp_degc(self) -> float:
        """Mean temperature [°C] of the held rates; NaN where none was logged."""
        return float(self.plateaus.temp_degc.mean())


def read(spec: AnyRecipe, data: Path, file: str) -> Log:
    """Read one log of the table in canonical columns; table angle and temperature are optional, and
    times of rows that are means over a held rate each.
    """
    gyros = tuple(forms.gyro_column(gyro) for gyro in spec.gyros)
    required = (forms.RATE, *gyros) if spec.plateaus.one_row else ("time_s", forms.RATE, *gyros)
    if spec.table.reference == "angle":
        required = (*required, ANGLE)
    beside = ("time_s", ANGLE, forms.TEMPERATURE)
    optional = tuple(name for name in beside if name not in required)
    return log_files.read_log(spec, data / file, file, required, optional)


def vertical_rate_dps(spec: GyroRecipe) -> float | None:
    """Earth rate about the table axis [°/s], positive as positive table rates; None where the
    latitude is unknown.
    """
    latitude, sign = spec.site.latitude_deg, 1.0 if spec.table.axis == "up" else -1.0
    return None if latitude is None else sign * float(earth.vertical_rate(latitude)) / DPH_PER_DPS


def valid_ranges(runs: Sequence[TableRun]) -> dict[str, tuple[float, float]]:
    """Ranges of rate and temperature that runs cover."""
    rate = np.concatenate([run.plateaus.rate_dps for run in runs])
    temperature = np.array([run.temp_range for run in runs])
    spans = {forms.RATE: rate}
    if np.isfinite(temperature).all():
        spans[forms.TEMPERATURE] = temperature
    return {name: (float(span.min()), float(span.max())) for name, span in spans.items()}


def group_by_temperature(
    runs: Mapping[str, tuple[TableRun, ...]],
) -> list[dict[str, tuple[TableRun, ...]]]:
    """Runs grouped by temperature, coldest first, each group with every axis."""
    pairs = sorted(
        ((run.temp_degc, axis, run) for axis in forms.AXES for run in runs[axis]),
        key=lambda pair: pair[0],
    )
    groups: list[dict[str, tuple[TableRun, ...]]] = []
    last = float("-inf")
    for degc, axis, run in pairs:
        if degc - last > 5.0:  # more than runs of one set differ
            groups.append({})
        groups[-1][axis] = (*groups[-1].get(axis, ()), run)
        last = degc
    for group in groups:
        if missing := [axis for axis in forms.AXES if axis not in group]:
            file_names = ", ".join(run.log.file for axis in group for run in group[axis])
            degc = float(np.mean([run.temp_degc for axis in group for run in group[axis]]))
            raise FitError(
                f"no log about table axis {missing[0]} near {degc:.1f} °C, where there are"
                f" {file_names}",
                hint=(
                    "each temperature needs a run about each axis; leave the others out:"
                    f" {advise_exclude(file_names.split(', ')[0])}"
                ),
            )
    return groups


def faults(spec: AnyRecipe, log: Log) -> Examined:
    """Findings of one log, and its held rates."""
    findings, means = _find_faults(spec, log)
    if means is None:
        return Examined(tuple(findings), ())
    pinned = stated_segments.stated_rows(log, spec, ["rate"]) is not None
    rates = zip(means.span.tolist(), means.rate_dps.tolist(), strict=True)
    return Examined(
        tuple(findings), tuple(Held("rate", a, b, rate, "°/s", pinned) for (a, b), rate in rates)
    )


def fit_run(spec: AnyRecipe, log: Log) -> TableRun:
    """Held rates of one log; raises FrameError or FitError that names it."""
    findings, means = _find_faults(spec, log)
    refuse(findings)
    if means is None:
        raise FitError(f"{log.file}: no held rates")
    # a remark stays one
    notes = (type(note)(f"{log.file}: {note}") for note in (*log.notes, *means.flags))
    flags = (*notes, *(str(finding) for finding in findings if finding.flagged))
    low = high = float("nan")
    if forms.TEMPERATURE in log.frame.columns:
        temperature = anomalies.remove_spikes(values(log.frame, forms.TEMPERATURE))
        low, high = chunks.extremes(temperature)
        # rows of an isothermal run, of 2 °C, all count, else those of held rates
        if high - low > 2.0:
            ends = [chunks.extremes(temperature[a:b]) for a, b in means.span.tolist()]
            low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    return TableRun(log, spec.gyros, means, spec.table.reference, flags, (low, high))


def _find_faults(spec: AnyRecipe, log: Log) -> tuple[list[Finding], HeldMeans | None]:
    """Findings of a log, and its held rates unless a finding prevents them."""
    one_row, logged = spec.plateaus.one_row, list(log.frame.columns)
    findings = [
        *check.find_too_few_rows(log, spec.plateaus.min_rates if one_row else 16),
        *check.find_missing_values(log, logged),
    ]
    gyros = [forms.gyro_column(gyro) for gyro in spec.gyros]
    thermometers = [name for name in logged if name == forms.TEMPERATURE]
    if not findings:
        expected = f"at most {FASTEST_DPS:g} °/s"
        findings += check.find_unordered_times(log) if "time_s" in logged else ()
        findings += check.find_constant_columns(log, [forms.RATE, *gyros])
        findings += check.find_out_of_range(
            log, forms.RATE, -FASTEST_DPS, FASTEST_DPS, "°/s", expected
        )
        for gyro in gyros:
            # counts that no rate of the log explains, a thousand times the 99 % quantile, as
            # loggers write for overload
            usual = float(np.quantile(np.abs(values(log.frame, gyro)), 0.99))
            limit = 1000.0 * usual if usual > 0.0 else np.inf
            expected = f"counts like those of the other rows, up to {usual:.4g} 1/s"
            advice = "a logger writes such numbers for overload or nothing: leave the rows out:"
            findings += check.find_out_of_range(
                log, gyro, -limit, limit, "1/s", expected, advice=advice
            )
        findings += check.find_implausible_temperatures(log, thermometers)
        if one_row:
            findings += check.find_copied_rows(log, [*gyros, forms.RATE, *thermometers])
    if any(finding.refused for finding in findings):
        return findings, None
    try:
        columns = {name: values(log.frame, name) for name in logged if name != "run"}
        rate, temp_degc = columns[forms.RATE], columns.get(forms.TEMPERATURE)
        signals = np.column_stack([columns[gyro] for gyro in gyros])
        if one_row:
            means = held_rates.of_rows(columns.get("time_s"), rate, signals, temp_degc)
        else:
            motion = held_rates.Motion.of(columns["time_s"], rate, columns.get(ANGLE))
            spans = stated_segments.stated_rows(log, spec, ["rate"])
            spans = held_rates.find(motion, spec.plateaus) if spans is None else spans
            along_axis = spec.procedure == "rate_table"
            means = held_rates.average(motion, signals, spans, temp_degc, along_axis=along_axis)
    except FitError as error:
        advice = error.hint or "check the table's columns and [plateaus] in the recipe"
        expected = "held rates of the table"
        # finding held_rates: the table held no rate
        findings.append(Finding(log.file, error.message, expected, advice, name="held_rates"))
        return findings, None
    findings += _find_wrong_rates(spec, log, means)
    if not one_row and not any(finding.refused for finding in findings):
        # suspicious sensors, loggers and signs, which do not stop a fit
        for name in thermometers:
            findings += check.series.check_temperature(log, name)
            findings += check.thermometers.check_steps(log, name)
        # from the 0.5 % to the 99.5 % quantile, which excludes spikes
        reach = [float(np.ptp(np.quantile(F, (0.005, 0.995)))) for F in signals.T]
        for gyro in gyros:
            findings += check.series.check_driven_indication(
                log, gyro, forms.RATE, "1/s", max(reach)
            )
        # a gyro across the table axis indicates its misalignment, of either sign; with two gyros of
        # a triad, neither need be along this axis
        if spec.procedure != "gyro_triad" or len(gyros) >= 3:
            driven_gyro = gyros[int(np.argmax(reach))]
            findings += check.magnitude.check_gyro_sign(log, driven_gyro, forms.RATE)
        findings += check.magnitude.find_compensated_names(log, spec, gyros)
    findings += _find_dropouts(log, means, gyros)
    return findings, means


def _find_wrong_rates(spec: GyroRecipe, log: Log, means: HeldMeans) -> Iterator[Finding]:
    """Findings on fewer distinct held rates than a line and its range need, where rates closer than
    a held rate may vary count as one; and on table angle and table rate that differ by more than a
    table can: one is in another unit or sign.

    The angle is unwrapped about the turn expected from the rate. Where that is half a turn or more
    from row to row, the angle agrees with any rate within half a turn and cannot contradict it.
    """
    rates, rules = np.sort(means.rate_dps), spec.plateaus
    least_step = np.maximum(2.0 * rules.floor_dps, 2.0 * rules.relative * np.abs(rates[1:]))
    rates = rates[np.concatenate(([True], np.diff(rates) > least_step))]
    if rates.size < rules.min_rates:
        rates_text = ", ".join(f"{rate:.4g}" for rate in rates)
        count = f"{rates.size} held rate{'s' if rates.size > 1 else ''}"
        # finding held_rates: the table held too few different rates
        yield Finding(
            log.file,
            f"{count} ({rates_text} °/s) on {means.rate_dps.size} plateaus",
            f"at least {rules.min_rates} different ones",
            "hold more rates, or allow shorter ones: plateaus.shortest_s",
            name="held_rates",
        )
    if np.isnan(means.angle_rate_dps).any():
        return
    turn = np.abs(means.rate_dps) * log.steps.usual
    slow = turn < HALF_TURN_DEG
    place = f"{log.file}: column '{ANGLE}'"
    if not slow.all():
        fast = turn[~slow]
        slower_text = f"the {int(slow.sum())} slower ones" if slow.any() else "none"
        # finding aliased: the table turns by half a turn or more from row to row, so that its
        # angle cannot check the rate
        yield Finding(
            place,
            f"the table turns by up to {fast.max():.0f}° from row to row at {fast.size} held rates",
            f"less than {HALF_TURN_DEG:g}°",
            f"log faster; the rate is compared with the angle at {slower_text} only, and a wrong"
            " unit of a fast rate is not seen",
            "warn",
            "aliased",
            figure=float(fast.max()),
        )
    angle, rate = means.angle_rate_dps[slow], means.rate_dps[slow]
    power = float(rate @ rate)
    if not power:
        return
    ratio = float(angle @ rate) / power
    # a table turns as its rate says within 1 %: one of both is in another unit or sign
    if abs(ratio - 1.0) > 0.01:
        text = f"it turns {ratio:.4g} times as fast as '{forms.RATE}' says"
        sign = "one of the two has the other sign: state sign = -1"
        advice = f"{sign if ratio < 0.0 else 'state the unit'} in [columns.{ANGLE}] or"
        advice = f"{advice} [columns.{forms.RATE}]"
        # finding unit: table angle and table rate are not of one table: another unit or sign
        yield Finding(place, text, "the same rate from both", advice, name="unit", figure=ratio)
        return
    off, left = ratio - 1.0, angle - ratio * rate
    u = float(np.sqrt(left @ left / max(rate.size - 1, 1) / power))
    if spec.table.reference == "rate" and abs(off) > max(LEAST_OFF, CERTAIN * u):
        # finding rate_and_angle: the logged angle turns at another rate than the logged one, by
        # more than 3 ppm and five standard uncertainties
        yield Finding(
            place,
            f"it turns at a rate {1e6 * off:+.2g} ± {2e6 * u:.1g} ppm off '{forms.RATE}': by the"
            " wrong one K of every gyro is as far off",
            "the same rate from both",
            'where the angle is right, as of an encoder, state table.reference = "angle"',
            "warn",
            "rate_and_angle",
            figure=off,
        )


def _find_late(log: Log, means: HeldMeans, column: str) -> list[Finding]:
    """A gyro that still indicates the last held rate, or already the next one, while the table
    holds: its rows are stamped late or early, or it is filtered.

    Changes between held rates that stand out of the noise are judged; most of them must say so,
    which lost pulses at some rates do not.
    """
    time, data, rate_dps = (values(log.frame, name) for name in ("time_s", column, forms.RATE))
    # a filter has settled in the second half of a held rate, if it does at all
    halves = [(first, (first + stop) // 2, stop) for first, stop in means.span.tolist()]
    levels = [dispersion.median(data[middle:stop]) for _, middle, stop in halves]
    noise = [
        mad_sigma(data[middle:stop] - level)
        for (_, middle, stop), level in zip(halves, levels, strict=True)
    ]
    delays, rows_between = [], []
    for k in range(len(levels) - 1):
        (_, start, stop), (first, end, _) = halves[k : k + 2]
        change = levels[k + 1] - levels[k]
        clear = CLEAR * max(noise[k : k + 2])
        if abs(change) <= 2.0 * clear or end == first:
            continue
        # the last row of one held rate, and the first row of the next
        departures = np.array([data[stop - 1] - levels[k], levels[k + 1] - data[first]])
        rows_between.append(bool(np.max(departures / change) > max(BETWEEN, clear / abs(change))))
        sides = ((data, levels[k : k + 2]), (rate_dps, means.rate_dps[k : k + 2]))
        rows_after = [
            int(np.sum(_is_beyond(of_side[start:end], 0.5 * (x + y), y - x)))
            for of_side, (x, y) in sides
        ]
        gyro_passed_s, table_passed_s = (time[max(end - 1 - count, 0)] for count in rows_after)
        delays.append(float(gyro_passed_s - table_passed_s))
    if len(delays) < LEAST_CHANGES or not any(rows_between):
        return []
    delay = float(np.median(delays))
    # a table's rate at the end of a row, beside a mean over the row, is a row off by itself
    least_rows = 0.9 if np.median(rows_between) >= 1.0 else 1.5
    if abs(delay) < least_rows * log.steps.usual:
        return []
    # finding late: a gyro comes to the next held rate seconds after the table, or before it
    return [
        finding_of_column(
            log,
            column,
            f"it comes to the next held rate {abs(delay):.3g} s"
            f" {'after' if delay > 0.0 else 'before'} the table, at most changes of the rate",
            expected="a gyro that turns with the table",
            advice=(
                "correct the times of the gyro or of the table; where the gyro is filtered, leave"
                f" out what it takes to settle: plateaus.settle_s = {10.0 * abs(delay):.2g}"
            ),
            name="late",
            figure=delay,
            severity="refuse",
        )
    ]


def _is_beyond(data: Array, level: float, change: float) -> Mask:
    """Which values [n] lie beyond a level in the direction of a change."""
    return np.asarray((data - level) * np.sign(change) > 0.0, dtype=np.bool_)


def _find_dropouts(log: Log, means: HeldMeans, columns: Sequence[str]) -> Iterator[Finding]:
    """Findings by (2), else on the first dropout by (1), of each gyro's column, with the number of
    rows and what the other held rates let expect there.

    A held rate without any response is a dead zone or a gyro across the table axis, no dropout; nor
    is one whose rows differ by less than pulses that are lost: the earth's rate moves all of them
    where the table turns by a part of a revolution.
    """
    for column in columns:
        data = values(log.frame, column)
        medians = np.array([dispersion.median(data[a:b]) for a, b in means.span.tolist()])
        late = _find_late(log, means, column) if "time_s" in log.frame.columns else []
        if late:
            yield from late
            continue
        fast = np.abs(means.rate_dps) >= np.median(np.abs(means.rate_dps))
        # a gyro across the axis may respond less than it indicates at rest
        F0 = 0.0
        off_mean = means.rate_dps - means.rate_dps.mean()
        if np.any(off_mean):
            slope = off_mean @ medians / (off_mean @ off_mean)
            F0 = float(medians.mean() - slope * means.rate_dps.mean())
        K = float(np.median((medians[fast] - F0) / means.rate_dps[fast]))
        # a gyro across the axis: less than a millionth of the largest indication is no rotation
        least_response = 1e-6 * max(map(abs, log.extremes(column)))
        lost, first, expected = 0, -1, 0.0
        for (a, b), rate, median in zip(
            means.span.tolist(), means.rate_dps.tolist(), medians.tolist(), strict=True
        ):
            deficit = SHARE * abs(K * rate)
            if deficit <= least_response or np.ptp(data[a:b]) < deficit:
                continue
            noise = mad_sigma(data[a:b] - median)
            if deficit <= CLEAR * noise:
                continue
            # not even a share of the expected response
            level = F0 + SHARE * K * rate
            low = np.flatnonzero(_is_beyond(data[a:b], level, -K * rate))
            if 0 < low.size < b - a:
                first, expected = (first, expected) if lost else (a + int(low[0]), F0 + K * rate)
                lost += low.size
        if lost:
            # finding dropout: rows in which a gyro indicates nothing while the table turns
            yield check.finding_at_row(
                log,
                first,
                column,
                f"{data[first]:.4g} 1/s while the table turns ({lost} such"
                f" row{'s' if lost > 1 else ''})",
                f"about {expected:.4g} 1/s, as the other held rates let expect",
                "pulses were lost: repair the logger, or leave the rows out:"
                f" {log.advise_exclude([first])}",
                "dropout",
                figure=float(data[first]),
            )

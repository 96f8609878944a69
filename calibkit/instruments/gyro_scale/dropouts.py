"""Rows of held rates in which a gyro indicates far less than the table turns.

    F < F0 + ½ K Ω (towards rest), between rows that respond: pulses were lost               (1)
    F passes halfway between two held rates later, or earlier, than the table's rate does    (2)

K and F0 are medians over the held rates; (2) means that rows of the gyro are stamped late or early,
or that it is filtered.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from calibkit import check
from calibkit.arrays import Array, Mask
from calibkit.check.content import finding_of_column
from calibkit.frame import Finding, Log, values
from calibkit.instruments.gyro_scale import forms
from calibkit.instruments.gyro_scale.held_means import HeldMeans
from calibkit.numeric import order_statistics
from calibkit.numeric.dispersion import MAD_TO_SIGMA

SHARE = 0.5
"""Share of the expected indication below which a row is a dropout."""
CLEAR = 8.0
"""Standard deviations of single rows that a dropout is below what is expected."""
RESOLVED = 1e-6
"""Share of the largest indication below which a response is no rotation: a gyro across the axis."""
BETWEEN, LEAST_CHANGES = 0.05, 3
"""Share of the change from one held rate to the next by which a row lies between both, and changes
from which a delay is measured, at least.
"""


def _find_late(log: Log, means: HeldMeans, column: str) -> list[Finding]:
    """A gyro that still indicates the last held rate, or already the next one, while the table
    holds: its rows are stamped late or early, or it is filtered.

    Changes between held rates that stand out of the noise are judged; most of them must say so,
    which lost pulses at some rates do not.
    """
    time, data = values(log.frame, "time_s"), values(log.frame, column)
    # a filter has settled in the second half of a held rate, if it does at all
    halves = [(first, (first + stop) // 2, stop) for first, stop in means.span.tolist()]
    levels = [order_statistics.median(data[middle:stop]) for _, middle, stop in halves]
    noise = [
        MAD_TO_SIGMA * order_statistics.median_magnitude(data[middle:stop], level)
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
        sides = ((column, levels[k : k + 2]), (forms.RATE, means.rate_dps[k : k + 2]))
        rows_after = [
            int(np.sum(_is_beyond(values(log.frame, name)[start:end], 0.5 * (x + y), y - x)))
            for name, (x, y) in sides
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


def find(log: Log, means: HeldMeans, columns: Sequence[str]) -> Iterator[Finding]:
    """Findings on the first dropout of each gyro's column, with the number of rows and what the
    other held rates let expect there.

    A held rate without any response is a dead zone or a gyro across the table axis, no dropout; nor
    is one whose rows differ by less than pulses that are lost: the earth's rate moves all of them
    where the table turns by a part of a revolution.
    """
    for column in columns:
        data = values(log.frame, column)
        medians = np.array([order_statistics.median(data[a:b]) for a, b in means.span.tolist()])
        late = _find_late(log, means, column) if "time_s" in log.frame.columns else []
        if late:
            yield from late
            continue
        fast = np.abs(means.rate_dps) >= np.median(np.abs(means.rate_dps))
        # a gyro across the axis may respond less than it indicates at rest
        F0 = 0.0
        if np.ptp(means.rate_dps) > 0.0:
            F0 = float(np.polyfit(means.rate_dps, medians, 1)[1])
        K = float(np.median((medians[fast] - F0) / means.rate_dps[fast]))
        least_response = RESOLVED * max(map(abs, log.extremes(column)))
        lost, first, expected = 0, -1, 0.0
        for (a, b), rate, median in zip(
            means.span.tolist(), means.rate_dps.tolist(), medians.tolist(), strict=True
        ):
            deficit = SHARE * abs(K * rate)
            if deficit <= least_response or np.ptp(data[a:b]) < deficit:
                continue
            noise = MAD_TO_SIGMA * order_statistics.median_magnitude(data[a:b], median)
            if deficit <= CLEAR * noise:
                continue
            # not even a share of the expected response
            level = F0 + SHARE * K * rate
            low = np.flatnonzero(_is_beyond(data[a:b], level, -K * rate))
            if 0 < low.size < b - a:
                first, expected = (first, expected) if lost else (a + int(low[0]), F0 + K * rate)
                lost += low.size
        if lost:
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

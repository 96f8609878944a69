"""Detection of sensor and logger faults in a series: spikes, stuck and clipped values, jumps that
stay, and start-up rows.

    spike     |y - median of 7 rows| > 10 σ, σ of the rows around, robust
    stuck     n p^(L-1) < 1e-9 for a run of L equal values, p the share of values that repeat
    clipped   five times as many rows at an extreme value as at the next one
    jump      |(c - b) - ((b - a) + (d - c))/2| > 8 σ, sudden, and it stays: the change from b to c
              less the trend of the series, a, b, c, d the means of four windows in a row

The thresholds are wide on purpose: a false alarm in a healthy log does more harm than a missed
spike of six standard deviations.
"""

import numpy as np

from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array, Integers
from calibkit.numeric.dispersion import mad_sigma

SAMPLE = 1 << 16
"""Largest number of rows from which the noise of a series is estimated."""
HIGH = 0.85
"""Quantile of the deviations from which the noise is estimated: larger deviations may be faults."""
HIGH_TO_SIGMA = 1.0 / 1.4395314709384563
"""Standard deviation of normal noise divided by the quantile HIGH of its magnitude."""
BLOCK = 512
"""Rows of a block, whose noise a spike must exceed."""
AROUND = 32
"""Rows on each side of a spike whose noise it must exceed, too: a knock rings for tens of rows."""
QUIET_SHARE = 0.3
"""Quantile of the steps that the rows tested closely are chosen by: that of a quiet third."""
QUIET_TO_SIGMA = 1.0 / 0.38532046640756773
"""Standard deviation of normal noise divided by the quantile QUIET_SHARE of its magnitude."""
SPIKE = 10.0
"""Deviation from the median of seven rows, in standard deviations, above which a row is a spike."""
SMALL = 0.01
"""Deviation, as a share of the span of the series, below which no row is a spike."""
QUIET = 1e-4
"""Noise, as a share of the span, below which a series counts as smooth, not noisy: a smooth series
may repeat values.
"""
WIDTH = 3
"""Rows on each side of a row that enter its running median; a spike is at most this wide."""
SHORTEST_RUN = 10
"""Fewest equal consecutive values that count as stuck."""
CHANCE = 1e-9
"""Probability with which a healthy series contains a run of equal values that is called stuck."""
NOISY = 0.5
"""Share of repeated values up to which a series counts as noisy: a quantised thermometer repeats
most of its values.
"""
COUNTED, PASSED = 0.55, 2.0
"""Rms of a counter about its smooth input [pulses], at most: 0.5 at half a pulse a row, and noise;
and the mean of that input over a run of L equal values off that value, in 1/√L pulses: rounding
moves the parabola.

Of 800 simulated counters (still, drifting, swinging, on a table, dithered) one is called stuck; of
300 that were stopped for 60 or 150 rows 258 are found, 272 without this.
"""
LEVEL_ROWS = 4
"""Rows whose medians are compared for a step."""
PILE = 10
"""Fewest rows at an extreme value for which clipping is tested."""
PILED = 5.0
"""Ratio of the rows at an extreme value to those at the next value above which a series is clipped.
"""
MOST_MEANS = 1 << 17
"""Largest number of rows in which jumps are searched directly; a longer series is averaged first.
"""
JUMP = 8.0
"""Smallest change of level, in its standard deviations, that is a jump."""
SUDDEN = 0.6
"""Share of a change of level that must happen within an eighth of the window: drift is slower."""
SETTLED_WINDOWS, SETTLED_ROWS = 4, 300
"""Windows, and rows at least, on each side of a change whose outer halves show the settled levels.
"""
STAYS, STAYS_SIGMA = 0.5, 3.0
"""Share of a change, and its standard deviations, by which the settled levels must differ."""
START_UP = 10.0
"""Deviation from the line through the later rows, in standard deviations, that marks start-up rows.
"""


def sample(values: Array) -> Array:
    """Sample of a series [n]: all rows, or 65,536 of them in sixteen evenly spaced sections."""
    if values.size <= SAMPLE:
        return values
    starts = np.linspace(0, values.size - SAMPLE // 16, 16).astype(np.int64).tolist()
    return np.concatenate([values[first : first + SAMPLE // 16] for first in starts])


def scatter(values: Array) -> float:
    """Standard deviation of the noise of a series [n] from second differences; 0 if most of them
    are 0.
    """
    if values.size < 3:
        return 0.0
    values = sample(values)
    second = values[:-2] - 2.0 * values[1:-1] + values[2:]
    return mad_sigma(second) / float(np.sqrt(6.0))


def resolution(values: Array) -> float:
    """Smallest step between distinct values in the first 20,000 rows of a series [n]; 0 if there is
    one value.
    """
    distinct = np.unique(values[:20_000])
    steps = np.diff(distinct)
    if steps.size:
        steps = steps[steps > 1e-9 * max(abs(float(distinct[0])), abs(float(distinct[-1])))]
    return float(steps.min()) if steps.size else 0.0


def span(values: Array) -> float:
    """Span between the 1 % and 99 % quantiles of a series [n], from at most 20,000 of its rows."""
    thinned = values[:: max(1, values.size // 20_000)]
    low, high = np.quantile(thinned, (0.01, 0.99)).tolist()
    return float(high - low)


def repeats(values: Array) -> float:
    """Share [1] of a series' values that equal the value before them."""
    values = sample(values)
    return float(np.mean(values[1:] == values[:-1])) if values.size > 1 else 0.0


def spikes(values: Array, *, smallest_departure: float = 0.0) -> Integers:
    """Rows [m] of a series [n] that hold a spike of at most three rows.

    A row is a spike if it differs from the median of the seven rows around it by more than ten
    standard deviations, five resolutions and `smallest_departure` [unit of the series]; steps and
    bends do not. The standard deviation is that of the row's block of 512 rows or of the 65 rows
    around it, whichever is larger: a series may be noisier elsewhere, and a knock is no row of
    spikes. A level that does not come back begins something else.
    """
    if values.size < 8 * WIDTH:
        return np.zeros(0, dtype=np.int64)
    floor = max(smallest_departure, 5.0 * resolution(values), SMALL * span(values))
    # an outlier steps away from a neighbour: only rows after a large step are tested closely
    steps = float(np.quantile(np.abs(np.diff(sample(values))), QUIET_SHARE))
    usual = QUIET_TO_SIGMA * steps / np.sqrt(2.0)
    wide_step = max(SPIKE / 2.0 * usual, floor / 2.0)
    wide = np.flatnonzero(np.abs(np.diff(values)) > wide_step)
    suspects = [np.zeros(0, dtype=np.int64)]
    # seven rows around each: in parts, as nearly every row of a noisy series is beside a wide step
    for a, b in chunks.ranges(wide.size):
        rows = np.unique(np.clip(wide[a:b, None] + np.arange(-1, 3), 0, values.size - 1))
        departure = from_median(values, rows)
        suspects.append(rows[departure > max(SPIKE / 2.0 * usual, floor)])
    rows = np.unique(np.concatenate(suspects))
    # the noise of the block of a row, then that of the rows around it
    edges = np.linspace(0, values.size, max(1, values.size // BLOCK) + 1).astype(np.int64)
    block = np.searchsorted(edges, rows, side="right") - 1
    noise = _noise_between(values, edges[block], edges[block + 1])
    rows = rows[from_median(values, rows) > np.maximum(SPIKE * noise, floor)]
    first = np.clip(rows - AROUND, 0, max(values.size - 2 * AROUND - 1, 0))
    noise = _noise_between(values, first, first + 2 * AROUND + 1)
    rows = rows[from_median(values, rows) > np.maximum(SPIKE * noise, floor)]
    # the medians of the three rows before and of the three behind the seven rows around each
    farther = np.arange(WIDTH + 1, 2 * WIDTH + 1)
    before, after = (
        np.median(values[np.clip(rows[:, None] + side, 0, values.size - 1)], axis=1)
        for side in (-farther, farther)
    )
    comes_back = np.abs(after - before) < from_median(values, rows)
    return np.asarray(rows[comes_back], dtype=np.int64)


def from_median(values: Array, rows: Integers) -> Array:
    """Absolute deviations [m] of rows [m] of a series [n] from the medians of the seven rows around
    them.
    """
    neighbours = np.clip(rows[:, None] + np.arange(-WIDTH, WIDTH + 1), 0, values.size - 1)
    return np.asarray(np.abs(values[rows] - np.median(values[neighbours], axis=1)))


def _noise_between(values: Array, first: Integers, stop: Integers) -> Array:
    """Standard deviation [m] of the noise of the rows first … stop − 1 [m] of a series [n].

    It is that of a high quantile of the deviations from the mean of both neighbours: in a coarsely
    quantised series most deviations are 0, and so would be an estimate from the median.
    """
    stretches, which = np.unique(np.column_stack([first, stop]), axis=0, return_inverse=True)
    noise = np.zeros(len(stretches))
    for k, (begin, end) in enumerate(stretches.tolist()):
        part = values[begin:end]
        deviations = np.abs(part[1:-1] - (part[:-2] + part[2:]) / 2.0)
        high = float(np.quantile(deviations, HIGH)) if deviations.size else 0.0
        noise[k] = HIGH_TO_SIGMA * high / float(np.sqrt(1.5))
    return noise[which.ravel()]


def equal_runs(values: Array, shortest: int) -> Integers:
    """First row and row after the last [m, 2] of each run of at least `shortest` equal values."""
    runs = chunks.find_runs(values[1:] == values[:-1])
    runs[:, 1] += 1
    return runs[runs[:, 1] - runs[:, 0] >= shortest]


def stuck(values: Array) -> Integers:
    """Runs [m, 2] of equal values that are too long to be chance in a noisy series [n]; none if the
    series is smooth or mostly repeats values.

    If a share p of the values repeats the one before, a run of L equal values has probability n
    p^(L−1). The share is that of the series, or that of as many rows before and behind the run
    where it is larger: a counter at a slow rate, or a dithered gyro at the turn of a beat, repeats
    values there too. Nor is a counter stuck that repeats a number where its input passes it.
    """
    runs = equal_runs(values, SHORTEST_RUN)
    if not len(runs):
        return runs
    inside = int(np.sum(runs[:, 1] - runs[:, 0] - 1))
    outside_runs = max(values.size - 1 - inside, 1)
    share = (repeats(values) * (values.size - 1) - inside) / outside_runs
    if share > NOISY or outside_runs < values.size // 4 or scatter(values) < QUIET * span(values):
        return runs[:0]
    quantum, stuck_runs = resolution(values), []
    for first, stop in runs.tolist():
        length = stop - first
        sides = values[max(first - length, 0) : first], values[stop : stop + length]
        equal = sum(int(np.count_nonzero(side[1:] == side[:-1])) for side in sides)
        share_beside = equal / max(sum(side.size for side in sides), 1)
        chance = values.size * max(share_beside, share) ** (length - 1)
        if chance < CHANCE and not _is_counted(values, first, stop, quantum):
            stuck_runs.append((first, stop))
    return np.array(stuck_runs, dtype=np.int64).reshape(-1, 2)


def _is_counted(values: Array, first: int, stop: int, quantum: float) -> bool:
    """Whether a parabola through as many rows before and behind a run of equal values as it has
    passes them as closely as whole pulses let it, and the run too.

    A counter of a smooth input is within a pulse of it, and by no more than a pulse in all off the
    sum over a run.
    """
    length = stop - first
    beside_rows = np.r_[max(first - length, 0) : first, stop : min(stop + length, values.size)]
    if beside_rows.size <= SHORTEST_RUN:
        return False
    middle = 0.5 * (first + stop - 1)
    parabola = np.polyfit((beside_rows - middle) / length, values[beside_rows], 2)
    residuals = values[beside_rows] - np.polyval(parabola, (beside_rows - middle) / length)
    inside = np.polyval(parabola, (np.arange(first, stop) - middle) / length).mean()
    return bool(
        np.sqrt(np.mean(residuals**2)) <= COUNTED * quantum
        and abs(inside - values[first]) <= PASSED / np.sqrt(length) * quantum
    )


def stuck_against(driver: Array, least_change: float, runs: Integers) -> Integers:
    """Runs [m, 2] of equal values during which the driving quantity [n] changes by more than
    `least_change`.
    """
    if not len(runs):
        return runs
    # the runs' rows are pairs of first and stop: every second part between them is a run
    pairs = np.minimum(runs.ravel(), driver.size - 1)
    moves = (np.maximum.reduceat(driver, pairs) - np.minimum.reduceat(driver, pairs))[::2]
    return runs[moves > least_change]


def frozen(values: Array, smallest_leap: float, runs: Integers) -> Integers:
    """Runs [m, 2] of equal values of a smooth series [n] that end in a leap: changes during the run
    were not logged.

    The leap exceeds twenty times the median non-zero step of the series, and `smallest_leap` [unit
    of the series].
    """
    step = np.abs(np.diff(sample(values)))
    if not len(runs) or not step.any():
        return runs[:0]
    limit = max(20.0 * float(np.median(step[step > 0.0])), smallest_leap)
    stop = np.minimum(runs[:, 1], values.size - 1)
    leaps = np.abs(values[stop] - values[runs[:, 1] - 1]) > limit
    return np.asarray(runs[leaps], dtype=np.int64)


def remove_spikes(values: Array) -> Array:
    """Series [n] with each spike replaced by the median of the seven rows around it."""
    rows = spikes(values)
    if not rows.size:
        return values
    clean = values.copy()
    neighbours = np.clip(rows[:, None] + np.arange(-WIDTH, WIDTH + 1), 0, values.size - 1)
    clean[rows] = np.median(values[neighbours], axis=1)
    return clean


def level_steps(values: Array) -> Array:
    """Changes [n − 2 LEVEL_ROWS + 1] of the lower median of LEVEL_ROWS rows of a series [n] to that
    of the next as many, from each row on that has them.
    """
    steps = np.empty(values.size - 2 * LEVEL_ROWS + 1)
    for a, b in chunks.ranges(steps.size):
        part = values[a : b + 2 * LEVEL_ROWS - 1]
        # the second smallest of two pairs
        low, high = np.minimum(part[:-1], part[1:]), np.maximum(part[:-1], part[1:])
        level = np.minimum(np.maximum(low[:-2], low[2:]), np.minimum(high[:-2], high[2:]))
        steps[a:b] = np.abs(level[LEVEL_ROWS:] - level[:-LEVEL_ROWS])
    return steps


def clipped(values: Array) -> tuple[int, float] | None:
    """Number of rows at the largest or smallest value of a noisy series [n], and this value, if the
    series is clipped there; otherwise None.
    """
    if values.size < 10 * PILE or repeats(values) > NOISY or scatter(values) < QUIET * span(values):
        return None
    for end, nearest in (
        (values.max(), np.max(values, where=values < values.max(), initial=-np.inf)),
        (values.min(), np.min(values, where=values > values.min(), initial=np.inf)),
    ):
        at_end = int(np.count_nonzero(values == end))
        at_next = int(np.count_nonzero(values == nearest))
        if at_end >= PILE and at_next and at_end > PILED * at_next:
            return at_end, float(end)
    return None


def jumps(values: Array, window: int) -> tuple[Integers, Array]:
    """Rows [m] at which the level of a series [n] changes suddenly and stays, and the changes [m]
    in its unit.

    The change is the difference of the means of the windows before and after a row, less the trend
    that the next windows outwards show. It must exceed eight standard deviations and happen within
    an eighth of a window, which drift does not; and the settled levels on both sides must differ by
    half of it, which those beside a knock do not: within 300 rows of an end none is found.
    """
    step = values.size // MOST_MEANS + 1
    if step > 1:
        rows, change = jumps(chunks.block_means(values, step), max(window // step, 20))
        return np.asarray(rows * step + step // 2, dtype=np.int64), change
    none = np.zeros(0, dtype=np.int64), np.zeros(0)
    short = max(window // 8, 3)
    if values.size < 5 * window:
        return none
    noise = scatter(values)
    # without the outermost values, which must not pass for a level
    low, high = np.quantile(values, (0.001, 0.999)).tolist()
    calm = np.clip(values, low - 3.0 * noise, high + 3.0 * noise)
    total = np.concatenate(([0.0], np.cumsum(calm - calm.mean())))
    means = (total[window:] - total[:-window]) / window
    a, b, c, d = (means[k * window : means.size - (3 - k) * window] for k in range(4))
    change = (c - b) - ((b - a) + (d - c)) / 2.0
    row = np.arange(change.size) + 2 * window
    brief = (total[row + short] - 2.0 * total[row] + total[row - short]) / short
    limit = JUMP * max(noise * np.sqrt(5.0 / window), mad_sigma(change))
    sure = (
        (np.abs(change) > limit)
        & (brief * change > 0.0)
        & (np.abs(brief) > SUDDEN * np.abs(change))
    )
    sure &= np.abs(brief) > JUMP * noise * np.sqrt(2.0 / short)
    sure &= np.abs(change) > max(2.0 * resolution(values), 2.0 * SMALL * span(values))

    # of each group of rows nearer than two windows the one with the largest change
    row, change = row[sure], change[sure]
    groups = np.split(np.arange(row.size), np.flatnonzero(np.diff(row) > 1) + 1)
    tops = [int(group[np.argmax(np.abs(change[group]))]) for group in groups if group.size]
    peaks = list[int]()
    for k in sorted(tops, key=lambda k: -abs(float(change[k]))):
        if all(abs(int(row[k] - row[j])) >= 2 * window for j in peaks):
            peaks.append(k)

    # the settled levels on both sides: of straight lines through the outer halves of `reach` rows
    reach = max(SETTLED_WINDOWS * window, SETTLED_ROWS)
    staying = list[int]()
    for k in sorted(peaks):
        middle = int(row[k])
        if not SETTLED_ROWS <= middle <= values.size - SETTLED_ROWS:
            continue
        level, variance = [], 0.0
        for side in (
            values[max(middle - reach, 0) : middle][::-1],
            values[middle : middle + reach],
        ):
            inner, outer = np.array_split(side[side.size // 2 :], 2)
            # the quarters' middles lie 5/8 and 7/8 of the side away; a median has π/2 of the
            # variance
            level.append(3.5 * float(np.median(inner)) - 2.5 * float(np.median(outer)))
            variance += (3.5**2 + 2.5**2) * np.pi / 2.0 * noise**2 / inner.size
        least_change = max(STAYS * abs(float(change[k])), STAYS_SIGMA * float(np.sqrt(variance)))
        if (level[1] - level[0]) * np.sign(change[k]) > least_change:
            staying.append(k)
    return row[staying], change[staying]


def start_up(values: Array) -> int:
    """Number of rows at the start of a series [n] that lie off the line through the later rows; 0
    if none do.

    The line passes through the medians of the second and the third window of the series. Start-up
    rows lie further off it than those of later windows do off theirs, which may oscillate.
    """
    window = 100
    if values.size < 10 * window:
        return 0
    deviations, change = _off_line(values, window)
    usual = max(
        float(np.quantile(_off_line(values[k * window :], window)[0], 0.98)) for k in range(1, 8)
    )
    sigma = max(
        scatter(values[window : 10 * window]),
        resolution(values) / np.sqrt(12.0),
    )
    inside = np.flatnonzero(deviations <= max(START_UP * sigma + 2.0 * change, 1.5 * usual))
    return int(inside[0]) if inside.size else window


def _off_line(values: Array, window: int) -> tuple[Array, float]:
    """Deviations [window] of the first window of a series from the line through the medians of the
    second and the third, and the difference of these.
    """
    first, second = (float(np.median(values[k * window : (k + 1) * window])) for k in (1, 2))
    line = first + (np.arange(window) - 1.5 * window) * (second - first) / window
    return np.abs(values[:window] - line), abs(second - first)

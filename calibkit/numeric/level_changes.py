"""Levels of a series that change suddenly: jumps that stay, and start-up rows.

    Δ = (c - b) - ((b - a) + (d - c))/2        a, b, c, d the means of four windows in a row

Δ is the change between b and c less the trend of the series; it is a jump where it exceeds eight of
its standard deviations, happens suddenly and stays.
"""

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric import chunks
from calibkit.numeric.anomalies import SMALL, resolution, scatter, span
from calibkit.numeric.dispersion import mad_sigma

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

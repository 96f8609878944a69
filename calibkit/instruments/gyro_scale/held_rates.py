"""Rows of a rate-table log in which the table holds a rate, and means of the gyros over them.

    max Ω − min Ω ≤ max(relative · max|Ω|, floor, 10 σ, 3.5 q)     over a window of rows    (1)
    F - mean = h_c cos θ + h_s sin θ + Ω (u_c cos θ + u_s sin θ) + K (rate - Ω) + e         (2)

(1) finds held rates: σ is the noise of the rate, from the smallest fifth of its second differences,
which excludes steady acceleration and steps; q the quantum between whose multiples a logged rate
flickers. Overlapping windows make a held rate, of which the settling time and the first and last
interval are left out. The mean is over whole revolutions of the table; (2) tells the noise e, and
what the earth's rate adds where a hold is shorter than that: θ is the angle of the table, h what
the earth's horizontal rate adds as it turns, u the unevenness of the table per mean rate Ω of the
hold, K the scale factor along the logged rate.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.recipe import PlateauSpec
from calibkit.numeric import chunks, dispersion
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.constants import REVOLUTION_DEG
from calibkit.numeric.dispersion import mad_sigma
from calibkit.records.frame import Remark

FIFTH_TO_SIGMA = 1.0 / 0.2533471031357997
"""Standard deviation of normal noise over the 0.2 quantile of its magnitude."""
NOISE_RANGE = 10.0
"""Largest peak-to-peak range of a held rate, in standard deviations of the rate's noise."""
QUANTA = 3.5
"""Largest range, in quanta, that a rate flickering between quantised values adds."""
BLOCKS = 16
"""Number of blocks that a held rate is divided into for the test of white noise."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of the table in the n rows of a log and the sampling intervals that end at them.

    Attributes
    ----------
    time_s : strictly increasing.
    rate_dps : commanded or measured.
    turn_deg : turn in the interval.
    middle_rad : angle in mid-interval.

    """

    time_s: Array
    rate_dps: Array
    interval_s: Array
    turn_deg: Array
    middle_rad: Array
    angle_logged: bool

    @classmethod
    def of(
        cls,
        time_s: Array,
        rate_dps: Array,
        angle_deg: Array | None = None,
    ) -> Self:
        """Motion by the logged angle, of any wrapping, unwrapped about the turn that the rate lets
        expect; without one, by the rate.
        """
        interval = np.diff(time_s, prepend=2.0 * time_s[0] - time_s[1])
        turn_deg = expected = rate_dps * interval
        end_angle = np.cumsum(expected)
        if angle_deg is not None:
            end_angle = angle_deg
            steps = np.diff(angle_deg, prepend=angle_deg[0] - expected[0]) - expected
            turn_deg = expected + np.remainder(steps + 180.0, REVOLUTION_DEG) - 180.0
        middle = np.radians(end_angle - turn_deg / 2.0)
        return cls(time_s, rate_dps, interval, turn_deg, middle, angle_deg is not None)


@dataclass(frozen=True, slots=True)
class HeldMeans:
    """Means over p held rates of m gyros.

    Attributes
    ----------
    rate_dps : table rate [p] [°/s], the mean over the same samples as the indication.
    indication : means [p, m] in the unit of the indication.
    standard_uncertainty : standard uncertainties of the means [p, m] by the noise within each
        held rate, type A.
    revolutions : whole revolutions averaged [p]; 0 where the table turned less than one.
    temp_degc : mean temperature [p] [°C]; NaN where none was logged.
    angle_rate_dps : rate [p] [°/s] by the logged table angle; NaN where none was logged.
    span : first row and one past the last row used [p, 2].
    hours : times [p] [h] from the middle of the log; zeros where they are not known.

    """

    rate_dps: Array
    indication: Array
    standard_uncertainty: Array
    revolutions: Integers
    temp_degc: Array
    angle_rate_dps: Array
    span: Integers
    hours: Array
    flags: tuple[str, ...]


def find(motion: Motion, rules: PlateauSpec) -> Integers:
    """First row and one past the last row [p, 2] of each held rate, by the rate and, where it is
    logged, by the angle too.

    Raises FitError where no rate is held.
    """
    time_s, rate_dps = motion.time_s, motion.rate_dps
    interval = dispersion.median(motion.interval_s)
    window = max(rules.shortest_samples, int(np.ceil(rules.shortest_s / interval)))
    quantum, windows = 0.0, np.zeros(0, dtype=np.bool_)
    if time_s.size >= window:
        quantum = QUANTA * _quantum(rate_dps)
        # windows that contain no gap, an interval of more than three usual ones
        gaps = np.concatenate(([0], np.cumsum(motion.interval_s[1:] > 3.0 * interval)))
        windows = gaps[window - 1 :] == gaps[: gaps.size - window + 1]
        windows &= _is_held(rate_dps, window, rules.relative, max(rules.floor_dps, quantum))
        if motion.angle_logged:
            # a commanded rate steps at once, while the table takes its time: only the angle shows
            # that
            # the rate by the angle includes the jitter of the time stamps: ten times the range
            by_turn, wide = motion.turn_deg / motion.interval_s, 10.0 * rules.relative
            floor_dps = max(rules.floor_dps, QUANTA * _quantum(by_turn))
            windows &= _is_held(by_turn, window, wide, floor_dps)
    fewest, spans, covered = max(rules.shortest_samples // 2, 2), [], 0
    for first_window, end in chunks.find_runs(windows).tolist():
        # rows that two runs of windows share belong to the first
        begin, covered = max(first_window, covered), end - 1 + window
        if covered <= begin:
            continue
        # the longest stretch that stays near the median; a slow creep at its ends is cut off
        part = rate_dps[begin:covered]
        middle = dispersion.median(part)
        noise = mad_sigma(part - middle)
        range_limit = max(rules.relative * abs(middle), rules.floor_dps, NOISE_RANGE * noise)
        near = chunks.find_runs(np.abs(part - middle) <= max(range_limit, quantum))
        first, stop = (begin + near[np.argmax(near[:, 1] - near[:, 0])]).tolist()
        # without its settling time and without its first and last sampling interval
        wait = min(rules.settle_s, 0.25 * float(time_s[stop - 1] - time_s[first]))
        first_settled = int(np.searchsorted(time_s, time_s[first] + wait, side="right"))
        first, stop = max(first_settled, first + 1), stop - 1
        if stop - first >= fewest:
            spans.append((first, stop))
    if not spans:
        low, high = chunks.extremes(rate_dps)
        span = f"{time_s.size} rows with table rates of {low:g} to {high:g} °/s"
        angle_text = ", by table rate and table angle together" if motion.angle_logged else ""
        raise FitError(
            f"no held rate of {rules.shortest_s:g} s in {span}{angle_text}",
            hint=(
                "check that the rate column is the table's, or allow shorter plateaus or a wider"
                " range of rate; where each row is the mean over a held rate:"
                " plateaus.one_row = true"
            ),
        )
    return np.array(spans, dtype=np.int64)


def average(
    motion: Motion,
    indication: Array,
    held_rows: Integers,
    temp_degc: Array | None = None,
    *,
    along_axis: bool = False,
) -> HeldMeans:
    """Average each held rate of a rate-table log over whole revolutions of the table.

    Over a whole revolution the horizontal part of the earth's rate vanishes; where the table turned
    less than one and its angle is logged, the modulation with the angle, fitted to all rates
    together, is taken out. Without an angle a rate of less than a revolution is kept and flagged;
    so is one at rest along the axis, one across it is left out.

    Parameters
    ----------
    indication : [n, m], one column per gyro; each row is the mean rate over the interval that ends
        at it.
    held_rows : [p, 2], rows of the held rates, as `held_rates.find` gives them.
    temp_degc : [n] [°C].
    along_axis : whether every gyro lies along the table's axis, where the earth's horizontal rate
        reaches it through its misalignment alone.

    """
    parts = [_whole_revolutions(motion, first, stop) for first, stop in held_rows.tolist()]
    # (2) by least squares over all held rates; the angle has no columns where it is not logged
    centred_columns, centred_F = [], []
    for part in parts:
        rate, F = motion.rate_dps[part.rows], indication[part.rows]
        of_angle = _of_angle(motion, part.rows) if motion.angle_logged else np.zeros((rate.size, 2))
        # unevenness grows with the table rate and the earth's rate does not: that separates them
        columns = np.column_stack((of_angle, of_angle * rate.mean(), rate))
        centred_columns.append(columns - columns.mean(axis=0))
        centred_F.append(F - F.mean(axis=0))
    X, F = np.concatenate(centred_columns), np.concatenate(centred_F)
    gram, count = X.T @ X, len(X)
    length = np.sqrt(np.diag(gram))
    fastest = max(map(abs, chunks.extremes(motion.rate_dps)))
    largest = np.sqrt(count) * np.array([1.0, 1.0, fastest, fastest, fastest])
    # a smaller column is rounding of a commanded angle or rate
    present = length > 1e-7 * largest
    inverse_length = np.where(present, 1.0 / np.where(present, length, 1.0), 0.0)
    eigenvalues, vectors = np.linalg.eigh(gram * np.outer(inverse_length, inverse_length))
    # combinations of columns with smaller eigenvalues are not determined
    determined = eigenvalues > 1e-8 * max(float(eigenvalues[-1]), np.finfo(np.float64).tiny)
    inverse = (vectors[:, determined] / eigenvalues[determined]) @ vectors[:, determined].T
    factors = (inverse @ (inverse_length[:, None] * (X.T @ F))) * inverse_length[:, None]
    # whether h, the earth's horizontal rate, is separable from the other columns
    # of which they make a share in no combination that is not determined
    earth_known = bool(present[:2].all() and np.all(np.abs(vectors[:2, ~determined]) < 1e-3))
    rest = F - X @ factors
    rests = np.split(rest, np.cumsum([len(columns) for columns in centred_columns])[:-1])
    dof = max(count - len(parts) - int(determined.sum()), 1)
    h_unit_covariance = (inverse * np.outer(inverse_length, inverse_length))[:2, :2]
    h_covariance = (np.sum(rest**2, axis=0) / dof)[:, None, None] * h_unit_covariance

    turning = [
        k
        for k, part in enumerate(parts)
        if part.revolutions or abs(np.sum(motion.turn_deg[part.rows])) > 1.0
    ]
    if not (turning or earth_known):
        raise FitError(
            "the table never turns in this log",
            hint="a scale factor needs held rates other than zero",
        )
    used = range(len(parts)) if earth_known or along_axis else turning
    resting_count = len(parts) - len(used)
    parts, rests = [parts[k] for k in used], [rests[k] for k in used]

    def means(column: Array) -> Array:
        return np.array([part.average(column[part.rows]) for part in parts])

    values = means(indication)
    variance, noise_flags = _variance(motion, parts, rests, values)
    for j, part in enumerate(parts):
        if earth_known and not part.revolutions:
            mean = part.average(_of_angle(motion, part.rows))
            values[j] -= mean @ factors[:2]
            variance[j] += mean @ h_covariance @ mean
    rate = means(motion.rate_dps)
    nan = np.full(len(parts), np.nan)
    angle_rate = means(motion.turn_deg / motion.interval_s) if motion.angle_logged else nan
    revolutions = np.array([part.revolutions for part in parts], dtype=np.int64)
    partial_count = int(np.sum(revolutions == 0))
    fate = "was fitted and taken out" if earth_known else "is not averaged out"
    flags = (
        (
            resting_count > 0,
            (
                f"{resting_count} plateaus at rest left out: their share of the earth's horizontal"
                " rate is unknown"
            ),
        ),
        (
            partial_count > 0,
            (
                f"{partial_count} plateaus of less than a revolution: the earth's horizontal rate"
                f" {fate}"
            ),
        ),
        *noise_flags,
    )
    span = np.array([(part.rows.start, part.rows.stop) for part in parts], dtype=np.int64)
    return HeldMeans(
        rate_dps=rate,
        indication=values,
        standard_uncertainty=np.sqrt(variance),
        revolutions=revolutions,
        temp_degc=nan if temp_degc is None else means(temp_degc),
        angle_rate_dps=angle_rate,
        span=span,
        hours=_hours(
            motion.time_s, 0.5 * (motion.time_s[span[:, 0]] + motion.time_s[span[:, 1] - 1])
        ),
        flags=tuple(sentence for holds, sentence in flags if holds),
    )


def of_rows(
    time_s: Array | None, table_rate_dps: Array, indication: Array, temp_degc: Array | None
) -> HeldMeans:
    """Rows that are means over a held rate each, as they are: columns as for `average`, times None
    where they were not logged.

    Their noise is not known by itself: it is that of the residuals of straight lines.
    """
    count = table_rate_dps.size
    q, _ = np.linalg.qr(np.column_stack((table_rate_dps, np.ones(count))))
    residual = indication - q @ (q.T @ indication)
    nan = np.full(count, np.nan)
    variance = np.sum(residual**2, axis=0) / max(count - 2, 1)
    return HeldMeans(
        rate_dps=np.array(table_rate_dps),
        indication=np.array(indication),
        standard_uncertainty=np.tile(np.sqrt(variance), (count, 1)),
        revolutions=np.zeros(count, dtype=np.int64),
        temp_degc=nan if temp_degc is None else np.array(temp_degc),
        angle_rate_dps=nan,
        span=np.arange(count)[:, None] + np.array([0, 1]),
        hours=np.zeros(count) if time_s is None else _hours(time_s, time_s),
        flags=(Remark("one row per held rate: noise is that of the residuals of the line"),),
    )


def _hours(time_s: Array, middle_s: Array) -> Array:
    """Times [p] [h] from the middle of a log."""
    return np.asarray((middle_s - 0.5 * float(time_s[0] + time_s[-1])) / 3600.0)


def _is_held(rate: Array, window: int, relative: float, floor_dps: float) -> Mask:
    """Mask [n − window + 1] of the windows over which a rate [n, °/s] is held."""
    # small second differences: excludes steady acceleration and the steps between short holds
    bends = np.abs(np.diff(rate, 2))
    noise = FIFTH_TO_SIGMA * float(np.quantile(bends, 0.2)) / np.sqrt(6.0)
    held = np.empty(rate.size - window + 1, dtype=np.bool_)
    for a, b in chunks.ranges(held.size):  # a log's extremes take as much memory as the log
        part = rate[a : b + window - 1]
        highest, lowest = (_of_windows(end, part, window) for end in (np.maximum, np.minimum))
        range_limit = relative * np.maximum(np.abs(highest), np.abs(lowest))
        limit = np.maximum(range_limit, max(floor_dps, NOISE_RANGE * noise))
        held[a:b] = highest - lowest <= limit
    return held


def _of_windows(extreme: np.ufunc, values: Array, window: int) -> Array:
    """np.maximum or np.minimum of each window of values [n]: [n − window + 1], of two windows half
    as long each time.
    """
    width = 1
    while width < window:
        step = min(width, window - width)
        values = extreme(values[:-step], values[step:])
        width += step
    return values


def _quantum(rate: Array) -> float:
    """Resolution [°/s] of a logged rate [n] that flickers between neighbouring values; 0 where it
    does not.

    A flicker is the smallest change there is, small against the rates, frequent, and soon taken
    back.
    """
    steps = np.diff(rate)
    changes = np.abs(steps)
    quantum = float(np.min(changes, where=changes > 0.0, initial=np.inf))
    # a larger change, relative to the largest rate, is a step of the table
    if not quantum < 5e-3 * float(np.max(np.abs(rate))):
        return 0.0
    rows = np.flatnonzero(steps)
    change = steps[rows]
    flicker = np.abs(change) < 1.5 * quantum
    # a flicker reverses within 8 rows, at 2 % of the rows at least
    taken_back = (change[1:] * change[:-1] < 0.0) & (np.diff(rows) < 8)
    count = int(np.count_nonzero(flicker[1:] & flicker[:-1] & taken_back))
    return quantum if count > 0.02 * rate.size else 0.0


@dataclass(frozen=True, slots=True)
class _Part:
    """Rows of one held rate, over whole revolutions or all of them, with the durations [k] [s] of
    the intervals that end at them, as they count.
    """

    rows: slice
    weights: Array
    revolutions: int

    def average(self, values: Array) -> Array:
        """Time average [...] of values [k, ...] of the rows."""
        # summed along contiguous values, pairwise: indications are large, their differences small
        total = np.sum(values.T * self.weights, axis=-1)
        return np.asarray(total / np.sum(self.weights), dtype=np.float64)


def _whole_revolutions(motion: Motion, first: int, stop: int) -> _Part:
    """Part of a held rate over whole revolutions; its last interval is weighted by the fraction
    that completes the last revolution.
    """
    turn_deg = motion.turn_deg[first:stop]
    travel = np.abs(np.cumsum(turn_deg))
    # a table that stops exactly after a revolution may log slightly less than 360°
    revolutions, share = int(np.floor(travel[-1] / REVOLUTION_DEG + 1e-6)), 1.0
    if revolutions:
        last = int(np.searchsorted(travel, revolutions * REVOLUTION_DEG))
        last = min(last, travel.size - 1)
        excess = float(travel[last]) - revolutions * REVOLUTION_DEG
        share = 1.0 - min(max(excess / abs(float(turn_deg[last])), 0.0), 1.0)
        stop = first + last + 1
    weights = motion.interval_s[first:stop].copy()
    weights[-1] *= share
    return _Part(slice(first, stop), weights, revolutions)


def _of_angle(motion: Motion, rows: slice) -> Array:
    """Means [k, 2] of cos and sin of the table angle over the intervals that end at rows."""
    half = np.radians(motion.turn_deg[rows]) / 2.0
    fading = np.sinc(half / np.pi)
    middle = motion.middle_rad[rows]
    return np.column_stack((np.cos(middle) * fading, np.sin(middle) * fading))


def _variance(
    motion: Motion, parts: list[_Part], rests: list[Array], values: Array
) -> tuple[Array, tuple[tuple[bool, str], ...]]:
    """Variance [p, m] of the means from what (2) leaves within each held rate [k, m], raised where
    it is not white; flags, each after its test.
    """
    variances, ratios, creeping = [], [], 0
    # a gyro that departs by less than 1 ppm of full scale counts as settled
    least_departure = 1e-6 * float(np.max(np.abs(values)))
    for part, rest in zip(parts, rests, strict=True):
        noise = rest
        if part.revolutions and not motion.angle_logged:
            # the phase of the earth's rate differs between held rates
            of_angle = _of_angle(motion, part.rows)
            of_angle -= of_angle.mean(axis=0)
            # over less of a turn cos and sin of the angle are one column
            noise = rest - of_angle @ np.linalg.lstsq(of_angle, noise, rcond=1e-7)[0]
        variance = np.sum(noise**2, axis=0) / max(len(noise) - 1, 1)
        weights = part.weights
        variances.append(variance * (np.sum(weights**2) / np.sum(weights) ** 2))
        length = len(noise) // BLOCKS
        if not length:
            continue
        blocks = chunks.block_means(noise, length)[:BLOCKS]
        # shorter blocks do not tell of autocorrelation
        if length >= 4:
            tiny = np.finfo(np.float64).tiny
            ratios.append(blocks.var(axis=0, ddof=1) * length / np.maximum(variance, tiny))
        # a first block that differs from the second half by 8 standard deviations of a block
        later = blocks[BLOCKS // 2 :]
        departure = np.abs(blocks[0] - later.mean(axis=0))
        creeping += bool(
            np.any(departure > np.maximum(8.0 * later.std(axis=0, ddof=1), least_departure))
        )
    raised = np.ones(values.shape[1])
    if ratios:
        mean = np.mean(ratios, axis=0)
        # a variance with b − 1 degrees of freedom has a relative standard deviation √(2/(b − 1)):
        # noise counts as autocorrelated from four of these on, and from a ratio of 1.3
        chance = 1.0 + 4.0 * np.sqrt(2.0 / ((BLOCKS - 1) * len(ratios)))
        raised = np.where(mean > max(1.3, chance), mean, 1.0)
    return np.array(variances) * raised, (
        (
            bool((raised > 1.0).any()),
            (
                "noise within plateaus is autocorrelated: variances raised up to"
                f" {raised.max():.1f} times"
            ),
        ),
        (
            # a lagging gyro is unsettled after most changes of rate, one may be by chance
            creeping > 0.1 * len(parts),
            (
                f"{creeping} of {len(parts)} plateaus begin off their mean: the gyro had not"
                " settled, allow a longer plateaus.settle_s"
            ),
        ),
    )

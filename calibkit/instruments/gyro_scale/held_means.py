"""Means over the held rates of a rate-table log, over whole revolutions of the table, and their
noise. The rows of one held rate at a time are in memory.

    F - mean = h_c cos θ + h_s sin θ + Ω (u_c cos θ + u_s sin θ) + K (rate - Ω) + e        (1)

θ is the angle of the table, h what the earth's horizontal rate adds as it turns, u the unevenness
of the table per mean rate Ω of the hold, K the scale factor along the logged rate.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import REVOLUTION_DEG
from calibkit.errors import FitError
from calibkit.frame import Remark
from calibkit.instruments.gyro_scale.held_rates import Motion
from calibkit.numeric import chunks, dwells

DISAGREEMENT = 10e-6
"""Relative difference between table angle and table rate above which it is flagged."""
BLOCKS = 16
"""Number of blocks that a held rate is divided into for the test of white noise."""
LEAST_BLOCK = 4
"""Rows of a block from which its mean tells of autocorrelation."""
ONE_PHASE = 1e-7
"""Singular value, relative to the largest, below which cos and sin of the angle are one column."""
ROUNDED = 1e-7
"""Size of a column, relative to the largest it can have, below which it is rounding of a commanded
angle or rate.
"""
SINGULAR = 1e-8
"""Eigenvalue, relative to the largest, below which the columns do not determine a combination."""
INVOLVED = 1e-3
"""Share of the earth's columns in such a combination from which they are not determined either."""
WHITE_RATIO = 1.3
"""Ratio of the variance of block means to that of white noise, above which the noise counts as
autocorrelated.
"""
CHANCE = 4.0
"""Standard deviations by which the ratio must exceed 1."""
SETTLING = 8.0
"""Departure of the first block mean of a held rate, in standard deviations of block means, from
which the gyro counts as not settled.
"""
ONE_PPM = 1e-6
"""Least such departure, relative to full scale."""
UNSETTLED = 0.1
"""Least share of unsettled rates for a flag: a lagging gyro is unsettled after most changes of
rate, a single one may be by chance.
"""


@dataclass(frozen=True, slots=True)
class HeldMeans:
    """Means over p held rates of m gyros."""

    rate_dps: Array
    """Table rate [p] [°/s], the mean over the same samples as the indication."""
    indication: Array
    """Means [p, m] in the unit of the indication."""
    standard_uncertainty: Array
    """Standard uncertainties of the means [p, m] by the noise within each held rate, type A."""
    revolutions: Integers
    """Whole revolutions averaged [p]; 0 where the table turned less than one."""
    temp_degc: Array
    """Mean temperature [p] [°C]; NaN where none was logged."""
    angle_rate_dps: Array
    """Rate [p] [°/s] from the logged table angle over the same samples; NaN where no angle was
    logged.
    """
    span: Integers
    """First row and one past the last row used [p, 2]."""
    hours: Array
    """Times [p] [h] from the middle of the log; zeros where they are not known."""
    flags: tuple[str, ...]


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
    wave = _fit_modulation(motion, indication, parts)
    turning = [
        k
        for k, part in enumerate(parts)
        if part.revolutions or abs(np.sum(motion.turn_deg[part.rows])) > 1.0
    ]
    if not (turning or wave.earth):
        raise FitError(
            "the table never turns in this log",
            hint="a scale factor needs held rates other than zero",
        )
    used = range(len(parts)) if wave.earth or along_axis else turning
    resting_count = len(parts) - len(used)
    parts, rests = [parts[k] for k in used], [wave.rests[k] for k in used]

    def means(column: Array) -> Array:
        return np.array([part.average(motion, column[part.rows]) for part in parts])

    values = means(indication)
    variance, noise_flags = _variance(motion, parts, rests, values)
    for j, part in enumerate(parts):
        if wave.earth and not part.revolutions:
            mean = part.average(motion, _basis(motion, part.rows))
            values[j] -= mean @ wave.factors[:2]
            variance[j] += mean @ wave.covariance @ mean
    rate = means(motion.rate_dps)
    nan = np.full(len(parts), np.nan)
    angle_rate = means(motion.turn_deg / motion.interval_s) if motion.angle_logged else nan
    revolutions = np.array([part.revolutions for part in parts], dtype=np.int64)
    partial_count = int(np.sum(revolutions == 0))
    fate = "was fitted and taken out" if wave.earth else "is not averaged out"
    relative = float(angle_rate @ rate / (rate @ rate)) - 1.0 if rate.any() else 0.0
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
        (
            abs(relative) > DISAGREEMENT,  # not where no angle is logged
            f"the table angle turns {relative * 1e6:+.0f} ppm faster than the table rate says",
        ),
    )
    span = np.array([(part.first, part.stop) for part in parts], dtype=np.int64)
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


@dataclass(frozen=True, slots=True)
class _Part:
    """Rows first … stop − 1 of one held rate, over whole revolutions or over all its rows."""

    first: int
    stop: int
    last: float
    """Weight of the last interval, as a share of its length."""
    revolutions: int

    @property
    def rows(self) -> slice:
        """Its rows."""
        return slice(self.first, self.stop)

    def weights(self, motion: Motion) -> Array:
        """Durations [k] [s] of the intervals that end at the rows, as they count."""
        weights = motion.interval_s[self.rows].copy()
        weights[-1] *= self.last
        return weights

    def average(self, motion: Motion, values: Array) -> Array:
        """Time average [...] of values [k, ...] of the rows."""
        weights = self.weights(motion)
        # summed along contiguous values, pairwise: indications are large, their differences small
        total = np.sum(values.T * weights, axis=-1)
        return np.asarray(total / np.sum(weights), dtype=np.float64)

    def centred(self, motion: Motion, indication: Array) -> tuple[Array, Array]:
        """Columns [k, 5] of (1) and indications [k, m] of the rows, less their means; the columns
        of the angle are zero where it is not logged.
        """
        rate, signals = motion.rate_dps[self.rows], indication[self.rows]
        basis = _basis(motion, self.rows) if motion.angle_logged else np.zeros((rate.size, 2))
        # the unevenness grows with the table rate and the earth's rate does not, which separates
        # them
        columns = np.column_stack((basis, basis * rate.mean(), rate))
        signals = signals - signals.mean(axis=0)
        return columns - columns.mean(axis=0), signals


@dataclass(frozen=True, slots=True)
class _Modulation:
    """Equation (1), common to all held rates."""

    factors: Array
    """[5, m]."""
    covariance: Array
    """[m, 2, 2] of the factors of cos and sin."""
    rests: list[Array]
    """[k, m] of each held rate, what (1) leaves of its rows."""
    earth: bool
    """Whether the factors of cos and sin, the earth's horizontal rate, are separable from the
    others.
    """


def _whole_revolutions(motion: Motion, first: int, stop: int) -> _Part:
    """Part of a held rate over whole revolutions; its last interval is weighted by the fraction
    that completes the last revolution.
    """
    turn_deg = motion.turn_deg[first:stop]
    travel = np.abs(np.cumsum(turn_deg))
    # a table that stops exactly after a revolution may log slightly less than 360°
    revolutions = int(np.floor(travel[-1] / REVOLUTION_DEG + 1e-6))
    if revolutions < 1:
        return _Part(first, stop, 1.0, 0)
    last = min(int(np.searchsorted(travel, revolutions * REVOLUTION_DEG)), travel.size - 1)
    excess = float(travel[last]) - revolutions * REVOLUTION_DEG
    share = 1.0 - min(max(excess / abs(float(turn_deg[last])), 0.0), 1.0)
    return _Part(first, first + last + 1, share, revolutions)


def _basis(motion: Motion, rows: slice) -> Array:
    """Means [k, 2] of cos and sin of the table angle over the intervals that end at rows."""
    half = np.radians(motion.turn_deg[rows]) / 2.0
    fading = np.sinc(half / np.pi)
    middle = motion.middle_rad[rows]
    return np.column_stack((np.cos(middle) * fading, np.sin(middle) * fading))


def _fit_modulation(motion: Motion, indication: Array, parts: list[_Part]) -> _Modulation:
    """Equation (1) by least squares over all held rates."""
    centred = [part.centred(motion, indication) for part in parts]
    columns = np.concatenate([columns for columns, _ in centred])
    target = np.concatenate([signals for _, signals in centred])
    gram, count = columns.T @ columns, len(columns)
    length = np.sqrt(np.diag(gram))
    fastest = max(map(abs, chunks.extremes(motion.rate_dps)))
    largest = np.sqrt(count) * np.array([1.0, 1.0, fastest, fastest, fastest])
    present = length > ROUNDED * largest
    inverse_length = np.where(present, 1.0 / np.where(present, length, 1.0), 0.0)
    values, vectors = np.linalg.eigh(gram * np.outer(inverse_length, inverse_length))
    determined = values > SINGULAR * max(float(values[-1]), np.finfo(np.float64).tiny)
    inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T
    product = columns.T @ target
    factors = (inverse @ (inverse_length[:, None] * product)) * inverse_length[:, None]
    earth_alone = np.all(np.abs(vectors[:2, ~determined]) < INVOLVED)
    rest = target - columns @ factors
    dof = max(count - len(parts) - int(determined.sum()), 1)
    variance = np.sum(rest**2, axis=0) / dof
    unit_covariance = (inverse * np.outer(inverse_length, inverse_length))[:2, :2]
    return _Modulation(
        factors=factors,
        covariance=variance[:, None, None] * unit_covariance,
        rests=np.split(rest, np.cumsum([len(signals) for _, signals in centred])[:-1]),
        earth=bool(present[:2].all() and earth_alone),
    )


def _variance(
    motion: Motion, parts: list[_Part], rests: list[Array], values: Array
) -> tuple[Array, tuple[tuple[bool, str], ...]]:
    """Variance [p, m] of the means from what (1) leaves within each held rate [k, m], raised where
    it is not white; flags, each after its test.
    """
    variances, ratios, creeping = [], [], 0
    least_departure = ONE_PPM * float(np.max(np.abs(values)))
    for part, rest in zip(parts, rests, strict=True):
        noise = rest
        if part.revolutions and not motion.angle_logged:
            # the phase of the earth's rate differs between held rates
            basis = _basis(motion, part.rows)
            basis -= basis.mean(axis=0)
            noise = rest - basis @ np.linalg.lstsq(basis, noise, rcond=ONE_PHASE)[0]
        variance = np.sum(noise**2, axis=0) / max(len(noise) - 1, 1)
        weights = part.weights(motion)
        variances.append(variance * (np.sum(weights**2) / np.sum(weights) ** 2))
        blocks = dwells.batch_means(noise, BLOCKS)
        if not len(blocks):
            continue
        length = len(noise) // BLOCKS
        if length >= LEAST_BLOCK:
            tiny = np.finfo(np.float64).tiny
            ratios.append(blocks.var(axis=0, ddof=1) * length / np.maximum(variance, tiny))
        # a first block that differs from the second half by more than noise
        later = blocks[BLOCKS // 2 :]
        departure = np.abs(blocks[0] - later.mean(axis=0))
        creeping += bool(
            np.any(departure > np.maximum(SETTLING * later.std(axis=0, ddof=1), least_departure))
        )
    raised = np.ones(values.shape[1])
    if ratios:
        mean = np.mean(ratios, axis=0)
        # a variance with b − 1 degrees of freedom has a relative standard deviation √(2/(b − 1))
        chance = 1.0 + CHANCE * np.sqrt(2.0 / ((BLOCKS - 1) * len(ratios)))
        raised = np.where(mean > max(WHITE_RATIO, chance), mean, 1.0)
    return np.array(variances) * raised, (
        (
            bool((raised > 1.0).any()),
            (
                "noise within plateaus is autocorrelated: variances raised up to"
                f" {raised.max():.1f} times"
            ),
        ),
        (
            creeping > UNSETTLED * len(parts),
            (
                f"{creeping} of {len(parts)} plateaus begin off their mean: the gyro had not"
                " settled, allow a longer plateaus.settle_s"
            ),
        ),
    )

"""Variation of indications within held rates of a rate table: the earth's horizontal rate, the
unevenness of the table, and noise. The rows of one plateau at a time are in memory.

    F - mean = h_c cos θ + h_s sin θ + Ω (u_c cos θ + u_s sin θ) + K (rate - Ω) + e

θ is the angle of the table, h what the earth's horizontal rate adds as it turns, u the unevenness
of the table per mean rate Ω of the plateau, K the scale factor along the logged rate.
"""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale.numeric.plateaus import Turn
from calibkit.numeric import chunks, dwells

BLOCKS = 16
"""Number of blocks that a plateau is divided into for the test of white noise."""
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
"""Departure of a plateau's first block mean, in standard deviations of block means, from which the
gyro counts as not settled.
"""
ONE_PPM = 1e-6
"""Least such departure, relative to full scale."""
UNSETTLED = 0.1
"""Least share of unsettled plateaus for a flag: a lagging gyro is unsettled after most changes of
rate, a single plateau may be by chance.
"""


@dataclass(frozen=True, slots=True)
class Record:
    """Columns of a log: motion of the table, its rate [n] [°/s], and the indications [n, m]."""

    turn: Turn
    rate: Array
    signals: Array

    def release(self) -> None:
        """Release the memory pages of columns that are mapped from files."""
        turn = self.turn
        chunks.release(turn.interval_s, turn.turn_deg, turn.middle_rad, self.rate, self.signals)

    def basis(self, rows: slice) -> Array:
        """Means [k, 2] of cos and sin of the table angle over the intervals that end at rows."""
        half = np.radians(self.turn.turn_deg[rows]) / 2.0
        fading = np.sinc(half / np.pi)
        middle = self.turn.middle_rad[rows]
        return np.column_stack((np.cos(middle) * fading, np.sin(middle) * fading))

    def columns(self, rows: slice) -> Array:
        """Design matrix [k, 5] of the variation within a plateau; the angle's columns are zero
        where the angle is not logged.
        """
        rate = self.rate[rows]
        basis = self.basis(rows) if self.turn.logged else np.zeros((rate.size, 2))
        # the unevenness grows with the table rate and the earth's rate does not, which separates
        # them
        return np.column_stack((basis, basis * rate.mean(), rate))

    def modulation(self, parts: "list[Part]") -> "Modulation":
        """Least-squares fit of the variation within plateaus, common to all plateaus."""
        count = sum(part.stop - part.first for part in parts)
        gram, product = np.zeros((5, 5)), np.zeros((5, self.signals.shape[1]))
        for part in parts:
            columns, target = part.centred(self)
            gram += columns.T @ columns
            product += columns.T @ target
        length = np.sqrt(np.diag(gram))
        fastest = max(map(abs, chunks.extremes(self.rate)))
        largest = np.sqrt(count) * np.array([1.0, 1.0, fastest, fastest, fastest])
        present = length > ROUNDED * largest
        inverse_length = np.where(present, 1.0 / np.where(present, length, 1.0), 0.0)
        values, vectors = np.linalg.eigh(gram * np.outer(inverse_length, inverse_length))
        determined = values > SINGULAR * max(float(values[-1]), np.finfo(np.float64).tiny)
        inverse = (vectors[:, determined] / values[determined]) @ vectors[:, determined].T
        factors = (inverse @ (inverse_length[:, None] * product)) * inverse_length[:, None]
        dof = max(count - len(parts) - int(determined.sum()), 1)
        left = sum(
            np.sum((target - columns @ factors) ** 2, axis=0)
            for columns, target in (part.centred(self) for part in parts)
        )
        earth_alone = np.all(np.abs(vectors[:2, ~determined]) < INVOLVED)
        return Modulation(
            factors=factors,
            unit_covariance=(inverse * np.outer(inverse_length, inverse_length))[:2, :2],
            variance=np.asarray(left / dof, dtype=np.float64),
            earth=bool(present[:2].all() and earth_alone),
        )

    def noise(
        self, parts: "list[Part]", wave: "Modulation", values: Array
    ) -> tuple[Array, tuple[str, ...]]:
        """Variance [p, m] of the means from the noise within plateaus, raised where the noise
        is not white, and flags.
        """
        variances, ratios, shares, creeping = [], [], [], 0
        least = ONE_PPM * float(np.max(np.abs(values)))
        for part in parts:
            noise = part.noise(self, wave)
            variance = np.sum(noise**2, axis=0) / max(len(noise) - 1, 1)
            weights = part.weights(self)
            variances.append(variance)
            shares.append(np.sum(weights**2) / np.sum(weights) ** 2)
            blocks = dwells.batch_means(noise, BLOCKS)
            if not len(blocks):
                continue
            length = len(noise) // BLOCKS
            if length >= LEAST_BLOCK:
                tiny = np.finfo(np.float64).tiny
                ratios.append(blocks.var(axis=0, ddof=1) * length / np.maximum(variance, tiny))
            # a first block that differs from the second half by more than noise
            later = blocks[BLOCKS // 2 :]
            off = np.abs(blocks[0] - later.mean(axis=0))
            creeping += bool(np.any(off > np.maximum(SETTLING * later.std(axis=0, ddof=1), least)))
        raised = _raise(ratios) if ratios else np.ones(self.signals.shape[1])
        flags = []
        if (raised > 1.0).any():
            flags.append(
                "noise within plateaus is autocorrelated: variances raised up to"
                f" {raised.max():.1f} times"
            )
        if creeping > UNSETTLED * len(parts):
            flags.append(
                f"{creeping} of {len(parts)} plateaus begin off their mean: the gyro had not"
                " settled, allow a longer plateaus.settle_s"
            )
        return np.array(variances) * np.array(shares)[:, None] * raised, tuple(flags)


@dataclass(frozen=True, slots=True)
class Part:
    """Rows first … stop − 1 of one plateau, over whole revolutions or over all its rows."""

    first: int
    stop: int
    last: float
    """Weight of the last interval, as a share of its length."""
    revolutions: int

    @property
    def rows(self) -> slice:
        """Its rows."""
        return slice(self.first, self.stop)

    def weights(self, record: Record) -> Array:
        """Durations [k] [s] of the intervals that end at the rows, as they count."""
        weights = record.turn.interval_s[self.rows].copy()
        weights[-1] *= self.last
        return weights

    def average(self, record: Record, values: Array) -> Array:
        """Time average [...] of values [k, ...] of the rows."""
        weights = self.weights(record)
        # summed along contiguous values, pairwise: indications are large, their differences small
        total = np.sum(values.T * weights, axis=-1)
        record.release()
        return np.asarray(total / np.sum(weights), dtype=np.float64)

    def centred(self, record: Record) -> tuple[Array, Array]:
        """Design matrix [k, 5] and indications [k, m] of the rows, less their means."""
        columns, signals = record.columns(self.rows), record.signals[self.rows]
        signals = signals - signals.mean(axis=0)
        record.release()
        return columns - columns.mean(axis=0), signals

    def noise(self, record: Record, wave: "Modulation") -> Array:
        """Samples [k, m] less their mean and less the fitted variation with table angle and
        rate.
        """
        columns, target = self.centred(record)
        noise = target - columns @ wave.factors
        if self.revolutions and not record.turn.logged:
            # the phase of the earth's rate differs between plateaus
            basis = record.basis(self.rows)
            basis -= basis.mean(axis=0)
            noise -= basis @ np.linalg.lstsq(basis, noise, rcond=ONE_PHASE)[0]
        return noise


@dataclass(frozen=True, slots=True)
class Modulation:
    """Variation within plateaus, common to all: with the table angle, and by the unevenness of the
    table.
    """

    factors: Array
    """[5, m]: factors of cos and sin of the angle, of both times the mean rate, and of the rate's
    departure from its mean.
    """
    unit_covariance: Array
    """[2, 2] of the factors of cos and sin, for unit variance."""
    variance: Array
    """Variance [m] of one sample about the fit."""
    earth: bool
    """Whether the factors of cos and sin, the earth's horizontal rate, are separable from the
    others.
    """


def _raise(ratios: list[Array]) -> Array:
    """Factor [m] on variances by the mean ratio of the variance of block means to that of white
    noise; 1 where the noise passes for white.
    """
    mean = np.mean(ratios, axis=0)
    # the relative standard deviation of a variance with b − 1 degrees of freedom is √(2/(b − 1))
    chance = 1.0 + CHANCE * np.sqrt(2.0 / ((BLOCKS - 1) * len(ratios)))
    return np.where(mean > max(WHITE_RATIO, chance), mean, 1.0)

"""Variation of indications within held rates of a rate table: the earth's horizontal rate, the
unevenness of the table, and noise.

Rows are processed in spans of limited length, so that memory does not grow with the length of a
plateau.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale.numeric.plateaus import Series, Turn
from calibkit.numeric import chunks

BLOCKS = 16
"""Number of blocks that a plateau is divided into for the test of white noise."""
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

    def basis(self, first: int, stop: int) -> Array:
        """Means [k, 2] of cos and sin of the table angle over the intervals that end at rows first
        … stop − 1.
        """
        half = np.radians(self.turn.turn_deg[first:stop]) / 2.0
        fading = np.sinc(half / np.pi)
        middle = self.turn.middle_rad[first:stop]
        return np.column_stack((np.cos(middle) * fading, np.sin(middle) * fading))

    def columns(self, first: int, stop: int, own: float) -> Array:
        """Design matrix [k, 5] of the variation within a plateau of mean rate `own`; the angle's
        columns are zero where the angle is not logged.
        """
        basis = self.basis(first, stop) if self.turn.logged else np.zeros((stop - first, 2))
        # the unevenness grows with the table rate and the earth's rate does not, which separates
        # them
        return np.column_stack((basis, basis * own, self.rate[first:stop]))

    def modulation(self, parts: "list[Part]") -> "Modulation":
        """Least-squares fit of the variation within plateaus, common to all plateaus."""
        count = sum(part.stop - part.first for part in parts)
        gram, product = np.zeros((5, 5)), np.zeros((5, self.signals.shape[1]))
        for columns, target in _read_spans(self, parts):
            gram += columns.T @ columns
            product += columns.T @ target
        size = np.sqrt(np.diag(gram))
        # rounding errors of a commanded rate are not unevenness
        present = size > 1e-7 * np.sqrt(count) * np.array(
            [1.0, 1.0, *[max(map(abs, chunks.extremes(self.rate)))] * 3]
        )
        to_raw = np.where(present, 1.0 / np.where(present, size, 1.0), 0.0)
        values, vectors = np.linalg.eigh(gram * np.outer(to_raw, to_raw))
        firm = values > 1e-8 * max(float(values[-1]), np.finfo(np.float64).tiny)
        inverse = (vectors[:, firm] / values[firm]) @ vectors[:, firm].T
        factors = (inverse @ (to_raw[:, None] * product)) * to_raw[:, None]
        dof = max(count - len(parts) - int(firm.sum()), 1)
        left = sum(
            np.sum((target - columns @ factors) ** 2, axis=0)
            for columns, target in _read_spans(self, parts)
        )
        return Modulation(
            factors=factors,
            unit_covariance=(inverse * np.outer(to_raw, to_raw))[:2, :2],
            variance=np.asarray(left / dof, dtype=np.float64),
            earth=bool(present[:2].all() and np.all(np.abs(vectors[:2, ~firm]) < 1e-3)),
        )

    def noise(
        self, parts: "list[Part]", wave: "Modulation", values: Array
    ) -> tuple[Array, tuple[str, ...]]:
        """Covariance [p, m, m] of the means from the noise within plateaus, raised where the noise
        is not white, and flags.
        """
        scatters = [_scatter(self, part, wave) for part in parts]
        ratio = np.sqrt(np.maximum(_block_ratio(scatters), 1.0))
        covariance = np.array(
            [
                one.square / max(one.rows - 1, 1) * part.square_s2 / part.duration_s**2
                for one, part in zip(scatters, parts, strict=True)
            ]
        )
        flags = []
        if (ratio > 1.0).any():
            flags.append(
                "noise within plateaus is autocorrelated: variances raised up to"
                f" {ratio.max() ** 2:.1f} times"
            )
        creeping = sum(_creeps(one, float(np.max(np.abs(values)))) for one in scatters)
        if creeping > UNSETTLED * len(scatters):
            flags.append(
                f"{creeping} of {len(scatters)} plateaus begin off their mean: the gyro had not"
                " settled, allow a longer plateaus.settle_s"
            )
        return covariance * np.outer(ratio, ratio), tuple(flags)


@dataclass(frozen=True, slots=True)
class Part:
    """Rows first … stop − 1 of one plateau, over whole revolutions or over all its rows, with their
    sums.
    """

    first: int
    stop: int
    last: float
    """Weight of the last interval, as a share of its length."""
    revolutions: int
    duration_s: float
    square_s2: float
    """Sum of the squared durations of its rows."""
    columns: Array
    """Time-weighted means [5] of the columns of the design matrix."""
    signals: Array
    """Unweighted means [m] of the indications."""

    @classmethod
    def of(cls, record: Record, first: int, stop: int, last: float, revolutions: int) -> Self:
        """Part with the sums over the rows of a plateau."""
        count, duration, square = stop - first, 0.0, 0.0
        own = chunks.mean(record.rate[first:stop])
        columns, signals = np.zeros(5), np.zeros(record.signals.shape[1])
        for a, b in chunks.ranges(count):
            rows = first + a, first + b
            weights = _weights(record, *rows, last if b == count else 1.0)
            duration, square = duration + float(weights.sum()), square + float(np.sum(weights**2))
            columns += record.columns(*rows, own).sum(axis=0)
            signals += record.signals[slice(*rows)].sum(axis=0)
            record.release()
        return cls(
            first, stop, last, revolutions, duration, square, columns / count, signals / count
        )

    def spans(self) -> Iterator[tuple[int, int]]:
        """First and end row of each of the spans that it is processed in."""
        return ((self.first + a, self.first + b) for a, b in chunks.ranges(self.stop - self.first))

    def average(self, record: Record, values: Series) -> Array:
        """Time average [...] of values [n, ...]."""
        total: Array = np.zeros(())
        for a, b in self.spans():
            weights = _weights(record, a, b, self.last if b == self.stop else 1.0)
            total = total + np.sum((values(a, b).T * weights).T, axis=0)
            record.release()
        return np.asarray(total / self.duration_s, dtype=np.float64)

    def centred(self, record: Record, first: int, stop: int) -> tuple[Array, Array]:
        """Design matrix [k, 5] and indications [k, m] of rows first … stop − 1, less their means
        over the plateau.
        """
        # the mean of the last column is the plateau's mean rate
        columns = record.columns(first, stop, float(self.columns[-1])) - self.columns
        return columns, record.signals[first:stop] - self.signals


def _weights(record: Record, first: int, stop: int, last: float) -> Array:
    """Durations [k] [s] of the rows; that of the last row is multiplied by `last`."""
    weights = record.turn.interval_s[first:stop].copy()
    weights[-1] *= last
    return weights


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


def _read_spans(record: Record, parts: list[Part]) -> Iterator[tuple[Array, Array]]:
    """Centred design matrix and indications of all rows of the plateaus, span by span."""
    for part in parts:
        for a, b in part.spans():
            yield part.centred(record, a, b)
            record.release()


@dataclass(frozen=True, slots=True)
class _Scatter:
    """Noise of one plateau of `rows` rows: sums of products [m, m], and means [BLOCKS, m] of blocks
    of `length` rows.
    """

    rows: int
    square: Array
    length: int
    blocks: Array


def _scatter(record: Record, part: Part, wave: Modulation) -> _Scatter:
    """Noise of one plateau: its samples less their mean and less the fitted variation with table
    angle and rate.
    """
    rows, gyros = part.stop - part.first, part.signals.size
    phase = _phase(record, part, wave) if part.revolutions and not record.turn.logged else None
    length = rows // BLOCKS
    square, sums = np.zeros((gyros, gyros)), np.zeros((BLOCKS + 1, gyros))
    for a, b in part.spans():
        columns, target = part.centred(record, a, b)
        noise = target - columns @ wave.factors
        if phase is not None:
            noise -= (record.basis(a, b) - phase[0]) @ phase[1]
        square += noise.T @ noise
        block = np.minimum(np.arange(a - part.first, b - part.first) // max(length, 1), BLOCKS)
        begins = np.flatnonzero(np.diff(block, prepend=-1))
        sums[block[begins]] += np.add.reduceat(noise, begins)
        record.release()
    return _Scatter(rows, square, length, sums[:BLOCKS] / max(length, 1))


def _phase(record: Record, part: Part, wave: Modulation) -> tuple[Array, Array]:
    """Mean [2] of the angle's columns, and their factors [2, m] fitted to what the common fit
    leaves in this plateau: the phase of the earth's rate differs between plateaus.
    """
    mean = sum(record.basis(a, b).sum(axis=0) for a, b in part.spans()) / (part.stop - part.first)
    gram, product = np.zeros((2, 2)), np.zeros((2, part.signals.size))
    for a, b in part.spans():
        columns, target = part.centred(record, a, b)
        basis = record.basis(a, b) - mean
        gram += basis.T @ basis
        product += basis.T @ (target - columns @ wave.factors)
        record.release()
    return mean, np.asarray(
        np.linalg.pinv(gram, rcond=1e-14, hermitian=True) @ product, dtype=np.float64
    )


def _block_ratio(scatters: list[_Scatter]) -> Array:
    """Ratio [m] of the variance of block means to that of white noise, averaged over the plateaus;
    1 where the noise passes for white.
    """
    ratios = []
    for one in scatters:
        if one.length < 4:
            continue
        variance = np.maximum(np.diag(one.square) / (one.rows - 1), np.finfo(np.float64).tiny)
        ratios.append(one.blocks.var(axis=0, ddof=1) * one.length / variance)
    if not ratios:
        return np.ones(len(scatters[0].square))
    mean = np.mean(ratios, axis=0)
    # the relative standard deviation of a variance with b − 1 degrees of freedom is √(2/(b − 1))
    chance = 1.0 + CHANCE * np.sqrt(2.0 / ((BLOCKS - 1) * len(ratios)))
    return np.asarray(np.where(mean > max(WHITE_RATIO, chance), mean, 1.0), dtype=np.float64)


def _creeps(one: _Scatter, full_scale: float) -> bool:
    """Whether the first block of a plateau differs from its second half by more than noise and 1
    ppm of full scale.
    """
    if one.length < 1:
        return False
    later = one.blocks[BLOCKS // 2 :]
    difference = np.abs(one.blocks[0] - later.mean(axis=0))
    return bool(
        np.any(
            (difference > SETTLING * later.std(axis=0, ddof=1)) & (difference > 1e-6 * full_scale)
        )
    )

"""What varies within held rates of a rate table: the earth's horizontal rate, the table's
unevenness, and noise.

All of it is gone through a span of rows at a time: whatever the length of a plateau, its memory is
that of a span.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.gyro_scale.numeric.plateaus import Series, Turn
from calibkit.numeric import chunks

BLOCKS = 16
"""Blocks that a plateau is cut into to see whether its noise is white."""
WHITE_RATIO = 1.3
"""Variance of block means over that of white noise from which the noise is taken to be
autocorrelated.
"""
CHANCE = 4.0
"""Standard deviations by which that ratio must exceed one."""
SETTLING = 8.0
"""Standard deviations of block means by which a plateau's first differs when the gyro has not
settled.
"""
UNSETTLED = 0.1
"""Share of the plateaus that must differ: a gyro that lags does so after most changes of rate, one
plateau is chance.
"""


@dataclass(frozen=True, slots=True)
class Record:
    """Columns of a log along its rows: what the table did, its rate [n] [°/s], and the indications
    [n, m].
    """

    turn: Turn
    rate: Array
    signals: Array

    def release(self) -> None:
        """Let go of the pages of columns that lie in files."""
        turn = self.turn
        chunks.release(turn.interval_s, turn.turn_deg, turn.middle_rad, self.rate, self.signals)

    def basis(self, first: int, stop: int) -> Array:
        """Means of cos and sin of the table angle over each interval of rows first … stop − 1: [k,
        2].
        """
        half = np.radians(self.turn.turn_deg[first:stop]) / 2.0
        fading = np.sinc(half / np.pi)
        middle = self.turn.middle_rad[first:stop]
        return np.column_stack((np.cos(middle) * fading, np.sin(middle) * fading))

    def columns(self, first: int, stop: int, own: float) -> Array:
        """What may vary within a plateau of mean rate `own`: [k, 5]; the angle's columns are zero
        where it is not logged.
        """
        basis = self.basis(first, stop) if self.turn.logged else np.zeros((stop - first, 2))
        # the table's unevenness grows with its rate, the earth's rate does not: this tells them
        # apart
        return np.column_stack((basis, basis * own, self.rate[first:stop]))

    def modulation(self, parts: "list[Part]") -> "Modulation":
        """Least squares of what varies within plateaus, all plateaus together."""
        count = sum(part.stop - part.first for part in parts)
        gram, product = np.zeros((5, 5)), np.zeros((5, self.signals.shape[1]))
        for columns, target in _read_spans(self, parts):
            gram += columns.T @ columns
            product += columns.T @ target
        size = np.sqrt(np.diag(gram))
        # rounding of a commanded rate is no unevenness
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
        """Covariance of the means [p, m, m] from the noise in the plateaus, raised where the noise
        is not white.
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
    """Rows first … stop − 1 of one plateau, over whole revolutions or over all; for how long they
    count.
    """

    first: int
    stop: int
    last: float
    """Share of its last interval that counts."""
    revolutions: int
    duration_s: float
    square_s2: float
    """Sum of the squares of the times for which its rows count."""
    columns: Array
    """Means [5] of what may vary within it."""
    signals: Array
    """Means [m] of its indications, each row alike."""

    @classmethod
    def of(cls, record: Record, first: int, stop: int, last: float, revolutions: int) -> Self:
        """Sums over the rows of a plateau."""
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
        """First row and row after the last of its spans."""
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
        """What may vary within it [k, 5], and the indications [k, m], of some of its rows, without
        their means over all.
        """
        # the mean rate is the mean of the last column
        columns = record.columns(first, stop, float(self.columns[-1])) - self.columns
        return columns, record.signals[first:stop] - self.signals


def _weights(record: Record, first: int, stop: int, last: float) -> Array:
    """Times [k] [s] for which rows count; the last of them by a share."""
    weights = record.turn.interval_s[first:stop].copy()
    weights[-1] *= last
    return weights


@dataclass(frozen=True, slots=True)
class Modulation:
    """What varies within plateaus, common to all: with the table angle, and with the table's own
    unevenness.
    """

    factors: Array
    """[5, m]: of cos and sin of the angle, of both times the mean rate, and of the rate's departure
    from its mean.
    """
    unit_covariance: Array
    """[2, 2] of the first two, for unit variance."""
    variance: Array
    """Of one sample about the fit [m]."""
    earth: bool
    """Whether the first two, the earth's horizontal rate, are told from the others."""


def _read_spans(record: Record, parts: list[Part]) -> Iterator[tuple[Array, Array]]:
    """What may vary, and the indications, of all rows of plateaus, a span after the other."""
    for part in parts:
        for a, b in part.spans():
            yield part.centred(record, a, b)
            record.release()


@dataclass(frozen=True, slots=True)
class _Scatter:
    """Noise of one plateau of so many rows: sums of products [m, m], and means [BLOCKS, m] of
    blocks of `length` rows.
    """

    rows: int
    square: Array
    length: int
    blocks: Array


def _scatter(record: Record, part: Part, wave: Modulation) -> _Scatter:
    """Noise of one plateau: its samples less their mean and less what varies with table angle and
    rate.
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
    """Mean [2] of the angle's columns and their factors [2, m]: the phase of the earth's rate is
    each plateau's own.
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
    """Variance of block means over that of white noise [m], averaged over the plateaus; 1 where it
    passes for white.
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
    # a variance of b − 1 degrees of freedom is uncertain by √(2/(b − 1)) of itself
    chance = 1.0 + CHANCE * np.sqrt(2.0 / ((BLOCKS - 1) * len(ratios)))
    return np.asarray(np.where(mean > max(WHITE_RATIO, chance), mean, 1.0), dtype=np.float64)


def _creeps(one: _Scatter, full_scale: float) -> bool:
    """Whether a plateau's first sixteenth differs from its second half by more than noise and 1 ppm
    of full scale.
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

"""Means over the held rates of a rate-table log: whole revolutions, the earth's rate, and the noise of the means."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.plateaus import DEFAULT_RULES, REVOLUTION_DEG, Rules, Turn, find, turn_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Counts = NDArray[np.int64]

BLOCKS = 16
"""Blocks that a plateau is cut into to see whether its noise is white."""
WHITE_RATIO = 1.3
"""Variance of block means over that of white noise from which the noise is taken to be autocorrelated."""
CHANCE = 4.0
"""Standard deviations by which that ratio must exceed one."""
DISAGREEMENT = 10e-6
"""Relative difference of table angle and table rate from which it is flagged."""
SETTLING = 8.0
"""Standard deviations of block means by which a plateau's first differs when the gyro has not settled."""
UNSETTLED = 0.1
"""Share of the plateaus that must differ: a gyro that lags does so after most changes of rate, one plateau is chance."""


@dataclass(frozen=True, slots=True)
class Plateaus:
    """Means over p held rates of m gyros."""

    rate_dps: Array
    """Table rate [p] [°/s], the mean over the same samples as the indication."""
    indication: Array
    """Means [p, m] in the unit of the indication."""
    covariance: Array
    """Of the means [p, m, m]: noise within each plateau, type A."""
    revolutions: Counts
    """Whole revolutions averaged [p]; 0 where the table turned less than one."""
    samples: Counts
    """Samples used [p]."""
    duration_s: Array
    """Time averaged [p] [s]."""
    temp_degc: Array
    """Mean temperature [p] [°C]; NaN where none was logged."""
    angle_rate_dps: Array
    """Rate [p] [°/s] that the logged table angle gives over the same samples; NaN where none was logged."""
    span: Counts
    """First row and one past the last row used [p, 2]."""
    flags: tuple[str, ...]

    @property
    def standard_uncertainty(self) -> Array:
        """Of the means [p, m]."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


@dataclass(frozen=True, slots=True)
class _Part:
    """Rows first … of one plateau and the time [s] for which each counts, over whole revolutions or over all."""

    first: int
    weights_s: Array
    revolutions: int

    @property
    def rows(self) -> slice:
        return slice(self.first, self.first + self.weights_s.size)


def means(
    time_s: Array,
    table_rate_dps: Array,
    indication: Array,
    *,
    table_angle_deg: Array | None = None,
    temp_degc: Array | None = None,
    rules: Rules = DEFAULT_RULES,
    held: Counts | None = None,
) -> Plateaus:
    """Average each held rate of a rate-table log over whole revolutions of the table.

    Parameters
    ----------
    time_s, table_rate_dps, table_angle_deg, rules : as for `find`.
    held : [p, 2], rows of the held rates where they are known; found by `find` otherwise.
    indication : [n, m], one column a gyro; each row is the mean rate over the interval that ends at it.
    temp_degc : [n] [°C].

    Returns
    -------
    Plateaus. Over a whole revolution the horizontal part of the earth's rate vanishes; where the table turned less
    than one and its angle is logged, the modulation with the angle, fitted to all plateaus together, is taken out.
    Without an angle a plateau at rest is left out, and one of less than a revolution is kept and flagged.

    Raises
    ------
    FitError
        As `find`, or an indication that is not finite.

    """
    signals = indication.reshape(time_s.size, -1)
    if not np.isfinite(signals).all():
        row = int(np.flatnonzero(~np.isfinite(signals).all(axis=1))[0])
        raise FitError(f"the indication in row {row} is not finite", hint="exclude the rows that hold it")
    turn = turn_of(time_s, table_rate_dps, table_angle_deg)
    found = find(time_s, table_rate_dps, table_angle_deg=table_angle_deg, rules=rules) if held is None else held
    parts = [_whole_revolutions(turn, first, stop) for first, stop in found]
    wave = _modulation(turn, table_rate_dps, signals, parts)
    parts, left_out = _without_rest(turn, parts, determined=wave.earth)
    residuals = [_residuals(turn, table_rate_dps, signals, part, wave) for part in parts]
    values = _averages(signals, parts)
    covariance, flags = _noise(residuals, parts, values)
    if wave.earth:
        values, covariance = _unmodulated(turn, parts, wave, values, covariance)
    rate = _averages(table_rate_dps, parts)
    nan = np.full(len(parts), np.nan)
    angle_rate = _averages(turn.turn_deg / turn.interval_s, parts) if turn.logged else nan
    revolutions = np.array([part.revolutions for part in parts], dtype=np.int64)
    return Plateaus(
        rate_dps=rate,
        indication=values,
        covariance=covariance,
        revolutions=revolutions,
        samples=np.array([part.weights_s.size for part in parts], dtype=np.int64),
        duration_s=np.array([part.weights_s.sum() for part in parts]),
        temp_degc=nan if temp_degc is None else _averages(temp_degc, parts),
        angle_rate_dps=angle_rate,
        span=np.array([(part.first, part.first + part.weights_s.size) for part in parts], dtype=np.int64),
        flags=(*left_out, *_partial(revolutions, corrected=wave.earth), *flags, *_disagreement(rate, angle_rate)),
    )


def _whole_revolutions(turn: Turn, first: int, stop: int) -> _Part:
    """Time weights of a plateau: the last interval counts for the fraction that completes the last whole revolution."""
    interval, turned = turn.interval_s[first:stop], turn.turn_deg[first:stop]
    travel = np.abs(np.cumsum(turned))
    # a table that stops on the revolution it began with may log a hair less
    whole = int(np.floor(travel[-1] / REVOLUTION_DEG + 1e-6))
    if whole < 1:
        return _Part(first, interval.copy(), 0)
    last = min(int(np.searchsorted(travel, whole * REVOLUTION_DEG)), interval.size - 1)
    weights = interval[: last + 1].copy()
    excess = travel[last] - whole * REVOLUTION_DEG
    weights[last] *= 1.0 - min(max(excess / abs(turned[last]), 0.0), 1.0)
    return _Part(first, weights, whole)


def _averages(values: Array, parts: list[_Part]) -> Array:
    """Time averages [p, ...] of values [n, ...] over the plateaus."""
    return np.array([np.average(values[part.rows], axis=0, weights=part.weights_s) for part in parts])


def _basis(turn: Turn, rows: slice) -> Array:
    """Means of cos and sin of the table angle over each interval [k, 2]."""
    half = np.radians(turn.turn_deg[rows]) / 2.0
    fading = np.sinc(half / np.pi)
    middle = turn.middle_rad[rows]
    return np.column_stack((np.cos(middle) * fading, np.sin(middle) * fading))


@dataclass(frozen=True, slots=True)
class _Modulation:
    """What varies within plateaus, common to all: with the table angle, and with the table's own unevenness."""

    factors: Array
    """[5, m]: of cos and sin of the angle, of both times the mean rate, and of the rate's departure from its mean."""
    unit_covariance: Array
    """[2, 2] of the first two, for unit variance."""
    variance: Array
    """Of one sample about the fit [m]."""
    earth: bool
    """Whether the first two, the earth's horizontal rate, are told from the others."""


def _columns(turn: Turn, rate: Array, part: _Part) -> Array:
    """What may vary within a plateau [k, 5], without means; the angle's columns are zero where it is not logged."""
    own = rate[part.rows]
    basis = _basis(turn, part.rows) if turn.logged else np.zeros((own.size, 2))
    # the table's unevenness grows with its rate, the earth's rate does not: this tells them apart
    columns = np.column_stack((basis, basis * float(own.mean()), own))
    return np.asarray(columns - columns.mean(axis=0), dtype=np.float64)


def _modulation(turn: Turn, rate: Array, signals: Array, parts: list[_Part]) -> _Modulation:
    """Least squares of what varies within plateaus, all plateaus together."""
    design = np.vstack([_columns(turn, rate, part) for part in parts])
    target = np.vstack([signals[part.rows] - signals[part.rows].mean(axis=0) for part in parts])
    size = np.linalg.norm(design, axis=0)
    # rounding of a commanded rate is no unevenness
    present = size > 1e-7 * np.sqrt(len(design)) * np.array([1.0, 1.0, *[float(np.max(np.abs(rate)))] * 3])
    scaled = np.where(present, design / np.where(present, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    firm = values > 1e-8 * max(float(values[-1]), np.finfo(np.float64).tiny)
    inverse = (vectors[:, firm] / values[firm]) @ vectors[:, firm].T
    to_raw = np.where(present, 1.0 / np.where(present, size, 1.0), 0.0)
    factors = (inverse @ (scaled.T @ target)) * to_raw[:, None]
    dof = max(len(design) - len(parts) - int(firm.sum()), 1)
    return _Modulation(
        factors=factors,
        unit_covariance=(inverse * np.outer(to_raw, to_raw))[:2, :2],
        variance=np.sum((target - design @ factors) ** 2, axis=0) / dof,
        earth=bool(present[:2].all() and np.all(np.abs(vectors[:2, ~firm]) < 1e-3)),
    )


def _without_rest(turn: Turn, parts: list[_Part], *, determined: bool) -> tuple[list[_Part], tuple[str, ...]]:
    """Plateaus without those at rest whose share of the earth's horizontal rate nobody knows."""
    kept = [
        part for part in parts if determined or part.revolutions or abs(float(np.sum(turn.turn_deg[part.rows]))) > 1.0
    ]
    if not kept:
        raise FitError("the table never turns in this log", hint="a scale factor needs held rates other than zero")
    rest = len(parts) - len(kept)
    note = f"{rest} plateaus at rest left out: their share of the earth's horizontal rate is unknown"
    return kept, (note,) if rest else ()


def _residuals(turn: Turn, rate: Array, signals: Array, part: _Part, wave: _Modulation) -> Array:
    """Noise [k, m] of one plateau: its samples less their mean and less what varies with table angle and rate."""
    noise = signals[part.rows] - signals[part.rows].mean(axis=0) - _columns(turn, rate, part) @ wave.factors
    if part.revolutions and not turn.logged:
        # the phase of the earth's horizontal rate is each plateau's own
        design = _basis(turn, part.rows)
        design = design - design.mean(axis=0)
        noise = noise - design @ np.linalg.lstsq(design, noise, rcond=None)[0]
    return np.asarray(noise, dtype=np.float64)


def _noise(residuals: list[Array], parts: list[_Part], values: Array) -> tuple[Array, tuple[str, ...]]:
    """Covariance of the means [p, m, m] from the noise in the plateaus, raised where the noise is not white."""
    ratio = np.sqrt(np.maximum(_block_ratio(residuals), 1.0))
    covariance = np.array(
        [
            r.T @ r / max(len(r) - 1, 1) * np.sum(part.weights_s**2) / np.sum(part.weights_s) ** 2
            for r, part in zip(residuals, parts, strict=True)
        ]
    )
    flags = []
    if (ratio > 1.0).any():
        flags.append(f"noise within plateaus is autocorrelated: variances raised up to {ratio.max() ** 2:.1f} times")
    full = float(np.max(np.abs(values)))
    creeping = sum(_creeps(r, full) for r in residuals)
    if creeping > UNSETTLED * len(residuals):
        flags.append(
            f"{creeping} of {len(residuals)} plateaus begin off their mean: the gyro had not settled, "
            "allow a longer plateaus.settle_s"
        )
    return covariance * np.outer(ratio, ratio), tuple(flags)


def _block_ratio(residuals: list[Array]) -> Array:
    """Variance of block means over that of white noise [m], averaged over the plateaus; 1 where it passes for white."""
    ratios = []
    for noise in residuals:
        length = len(noise) // BLOCKS
        if length < 4:
            continue
        blocks = noise[: length * BLOCKS].reshape(BLOCKS, length, -1).mean(axis=1)
        variance = np.maximum(noise.var(axis=0, ddof=1), np.finfo(np.float64).tiny)
        ratios.append(blocks.var(axis=0, ddof=1) * length / variance)
    if not ratios:
        return np.ones(residuals[0].shape[1])
    mean = np.mean(ratios, axis=0)
    # a variance of b − 1 degrees of freedom is uncertain by √(2/(b − 1)) of itself
    chance = 1.0 + CHANCE * np.sqrt(2.0 / ((BLOCKS - 1) * len(ratios)))
    return np.asarray(np.where(mean > max(WHITE_RATIO, chance), mean, 1.0), dtype=np.float64)


def _creeps(noise: Array, full_scale: float) -> bool:
    """Whether a plateau's first sixteenth differs from its second half by more than noise and 1 ppm of full scale."""
    length = len(noise) // BLOCKS
    if length < 1:
        return False
    blocks = noise[: length * BLOCKS].reshape(BLOCKS, length, -1).mean(axis=1)
    later = blocks[BLOCKS // 2 :]
    difference = np.abs(blocks[0] - later.mean(axis=0))
    return bool(np.any((difference > SETTLING * later.std(axis=0, ddof=1)) & (difference > 1e-6 * full_scale)))


def _unmodulated(
    turn: Turn, parts: list[_Part], wave: _Modulation, values: Array, covariance: Array
) -> tuple[Array, Array]:
    """Means without the earth's horizontal rate where the table turned less than a revolution, and their covariance."""
    values, covariance = values.copy(), covariance.copy()
    for j, part in enumerate(parts):
        if part.revolutions:
            continue
        mean = np.average(_basis(turn, part.rows), axis=0, weights=part.weights_s)
        values[j] -= mean @ wave.factors[:2]
        covariance[j] += np.diag(wave.variance * float(mean @ wave.unit_covariance @ mean))
    return values, covariance


def _partial(revolutions: Counts, *, corrected: bool) -> tuple[str, ...]:
    """Flag for plateaus of less than a revolution."""
    count = int(np.sum(revolutions == 0))
    if not count:
        return ()
    if corrected:
        return (f"{count} plateaus of less than a revolution: the earth's horizontal rate was fitted and taken out",)
    return (f"{count} plateaus of less than a revolution: the earth's horizontal rate is not averaged out",)


def _disagreement(rate: Array, angle_rate: Array) -> tuple[str, ...]:
    """Flag where the logged angle and the logged rate are not of one table."""
    if np.isnan(angle_rate).any() or not np.any(rate):
        return ()
    relative = float(angle_rate @ rate / (rate @ rate)) - 1.0
    if abs(relative) <= DISAGREEMENT:
        return ()
    return (f"the table angle turns {relative * 1e6:+.0f} ppm faster than the table rate says",)

"""Means over the held rates of a rate-table log: averages over whole revolutions, correction for
the earth's rate, noise of the means.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.constants import REVOLUTION_DEG
from calibkit.errors import FitError
from calibkit.instruments.gyro_scale.numeric import plateau_noise, plateaus
from calibkit.instruments.gyro_scale.numeric.plateaus import Allocate, Turn
from calibkit.numeric import chunks

DISAGREEMENT = 10e-6
"""Relative difference between table angle and table rate above which it is flagged."""


@dataclass(frozen=True, slots=True)
class Plateaus:
    """Means over p held rates of m gyros."""

    rate_dps: Array
    """Table rate [p] [°/s], the mean over the same samples as the indication."""
    indication: Array
    """Means [p, m] in the unit of the indication."""
    variance: Array
    """Variance of the means [p, m] by the noise within each plateau, type A."""
    revolutions: Integers
    """Whole revolutions averaged [p]; 0 where the table turned less than one."""
    samples: Integers
    """Samples used [p]."""
    temp_degc: Array
    """Mean temperature [p] [°C]; NaN where none was logged."""
    angle_rate_dps: Array
    """Rate [p] [°/s] from the logged table angle over the same samples; NaN where no angle was
    logged.
    """
    span: Integers
    """First row and one past the last row used [p, 2]."""
    flags: tuple[str, ...]
    time_s: Array = field(default_factory=lambda: np.empty(0))
    """Middle [p] [s] of each; empty where times are not known."""
    middle_s: float = 0.0
    """Middle of the log [s]."""

    @property
    def hours(self) -> Array:
        """Times [p] [h] from the middle of the log; zeros where they are not known."""
        if not self.time_s.size:
            return np.zeros(self.rate_dps.size)
        return (self.time_s - self.middle_s) / 3600.0

    @property
    def standard_uncertainty(self) -> Array:
        """Standard uncertainties [p, m] of the means."""
        return np.sqrt(self.variance)


def means(
    time_s: Array,
    table_rate_dps: Array,
    indication: Array,
    *,
    table_angle_deg: Array | None = None,
    temp_degc: Array | None = None,
    rules: plateaus.Rules = plateaus.DEFAULT_RULES,
    held: Integers | None = None,
    along_axis: bool = False,
    allocate: Allocate = np.empty,
) -> Plateaus:
    """Average each held rate of a rate-table log over whole revolutions of the table.

    Parameters
    ----------
    time_s, table_rate_dps, table_angle_deg, rules : as for `find`.
    held : [p, 2], rows of the held rates where they are known; found by `find` otherwise.
    indication : [n, m], one column per gyro; each row is the mean rate over the interval that ends
        at it.
    temp_degc : [n] [°C].
    along_axis : whether every gyro lies along the table's axis, where the earth's horizontal rate
        reaches it through its misalignment alone.
    allocate : makes arrays along the rows; columns that lie in mapped files are worked on in the
        memory of a chunk.

    Returns
    -------
    Plateaus. Over a whole revolution the horizontal part of the earth's rate vanishes; where the
    table turned less than one and its angle is logged, the modulation with the angle, fitted to all
    plateaus together, is taken out. Without an angle a plateau of less than a revolution is kept
    and flagged; so is one at rest along the axis, one across it is left out.

    Raises
    ------
    FitError
        As `find`, or an indication that is not finite.

    """
    signals = indication.reshape(time_s.size, -1)
    if not chunks.all_finite(signals):
        row = int(np.flatnonzero(~np.isfinite(signals).all(axis=1))[0])
        raise FitError(
            f"the indication in row {row} is not finite", hint="exclude the rows that hold it"
        )
    turn = plateaus.turn_of(time_s, table_rate_dps, table_angle_deg, allocate=allocate)
    found = plateaus.find(time_s, table_rate_dps, rules=rules, turn=turn) if held is None else held
    record = plateau_noise.Record(turn, table_rate_dps, signals)
    averaged = _means(record, found, temp_degc, along_axis=along_axis)
    return replace(
        averaged,
        time_s=0.5 * (time_s[averaged.span[:, 0]] + time_s[averaged.span[:, 1] - 1]),
        middle_s=0.5 * float(time_s[0] + time_s[-1]),
    )


def of_rows(
    time_s: Array | None, table_rate_dps: Array, indication: Array, temp_degc: Array | None
) -> Plateaus:
    """Rows that are means over a held rate each, as they are: columns as for `means`, times None
    where they were not logged.

    Their noise is not known by itself: it is that of the residuals of straight lines.
    """
    count = table_rate_dps.size
    q, _ = np.linalg.qr(np.column_stack((table_rate_dps, np.ones(count))))
    left = indication - q @ (q.T @ indication)
    nan = np.full(count, np.nan)
    return Plateaus(
        rate_dps=np.array(table_rate_dps),
        indication=np.array(indication),
        variance=np.tile(np.sum(left**2, axis=0) / max(count - 2, 1), (count, 1)),
        revolutions=np.zeros(count, dtype=np.int64),
        samples=np.ones(count, dtype=np.int64),
        temp_degc=nan if temp_degc is None else np.array(temp_degc),
        angle_rate_dps=nan,
        span=np.arange(count)[:, None] + np.array([0, 1]),
        flags=("one row per held rate: noise is that of the residuals of the line",),
        time_s=np.zeros(0) if time_s is None else np.array(time_s),
        middle_s=0.0 if time_s is None else 0.5 * float(time_s[0] + time_s[-1]),
    )


def _means(
    record: plateau_noise.Record, held: Integers, temp_degc: Array | None, *, along_axis: bool
) -> Plateaus:
    """Plateaus of the held rates with rows [p, 2]."""
    turn = record.turn
    parts = [_whole_revolutions(record, first, stop) for first, stop in held.tolist()]
    wave = record.modulation(parts)
    parts, left_out = _without_rest(turn, parts, determined=wave.earth, along_axis=along_axis)
    values = _averages(record, parts, record.signals)
    variance, noise_flags = record.noise(parts, wave, values)
    for j, part in enumerate(parts):
        if wave.earth and not part.revolutions:
            mean = part.average(record, record.basis(part.rows))
            values[j] -= mean @ wave.factors[:2]
            variance[j] += wave.variance * float(mean @ wave.unit_covariance @ mean)
    rate = _averages(record, parts, record.rate)
    nan = np.full(len(parts), np.nan)
    by_angle = [part.average(record, turn.rate(part.first, part.stop)) for part in parts]
    angle_rate = np.array(by_angle) if turn.logged else nan
    revolutions = np.array([part.revolutions for part in parts], dtype=np.int64)
    flags = [*left_out]
    if not revolutions.all():
        fate = "was fitted and taken out" if wave.earth else "is not averaged out"
        flags.append(
            f"{int(np.sum(revolutions == 0))} plateaus of less than a revolution: the earth's"
            f" horizontal rate {fate}"
        )
    flags += noise_flags
    if turn.logged and rate.any():
        relative = float(angle_rate @ rate / (rate @ rate)) - 1.0
        if abs(relative) > DISAGREEMENT:
            flags.append(
                f"the table angle turns {relative * 1e6:+.0f} ppm faster than the table rate says"
            )
    return Plateaus(
        rate_dps=rate,
        indication=values,
        variance=variance,
        revolutions=revolutions,
        samples=np.array([part.stop - part.first for part in parts], dtype=np.int64),
        temp_degc=nan if temp_degc is None else _averages(record, parts, temp_degc),
        angle_rate_dps=angle_rate,
        span=np.array([(part.first, part.stop) for part in parts], dtype=np.int64),
        flags=tuple(flags),
    )


def _whole_revolutions(record: plateau_noise.Record, first: int, stop: int) -> plateau_noise.Part:
    """Part of a plateau over whole revolutions; its last interval is weighted by the fraction that
    completes the last revolution.
    """
    turned = record.turn.turn_deg[first:stop]
    travel = np.abs(np.cumsum(turned))
    # a table that stops exactly after a revolution may log slightly less than 360°
    whole = int(np.floor(travel[-1] / REVOLUTION_DEG + 1e-6))
    if whole < 1:
        return plateau_noise.Part(first, stop, 1.0, 0)
    last = min(int(np.searchsorted(travel, whole * REVOLUTION_DEG)), travel.size - 1)
    excess = float(travel[last]) - whole * REVOLUTION_DEG
    share = 1.0 - min(max(excess / abs(float(turned[last])), 0.0), 1.0)
    return plateau_noise.Part(first, first + last + 1, share, whole)


def _averages(
    record: plateau_noise.Record, parts: list[plateau_noise.Part], values: Array
) -> Array:
    """Time averages [p, ...] of values [n, ...] over the plateaus."""
    averages = []
    for part in parts:
        averages.append(part.average(record, values[part.rows]))
        chunks.release(values)
    return np.array(averages)


def _without_rest(
    turn: Turn, parts: list[plateau_noise.Part], *, determined: bool, along_axis: bool
) -> tuple[list[plateau_noise.Part], tuple[str, ...]]:
    """Plateaus except those at rest at which the earth's horizontal rate is unknown, and a flag for
    the removed ones; along the axis it reaches a gyro through its misalignment alone, and none is
    removed.
    """
    turning = [
        part for part in parts if part.revolutions or abs(np.sum(turn.turn_deg[part.rows])) > 1.0
    ]
    if not (turning or determined):
        raise FitError(
            "the table never turns in this log",
            hint="a scale factor needs held rates other than zero",
        )
    rest = len(parts) - len(turning)
    if determined or along_axis or not rest:
        return parts, ()
    note = (
        f"{rest} plateaus at rest left out: their share of the earth's horizontal rate is unknown"
    )
    return turning, (note,)

"""Which of two temperatures follows the other, by how much, and with which gain."""

from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array

BLOCKS = 600
"""Block means that the two are compared by."""


@dataclass(frozen=True, slots=True)
class Lead:
    """The follower f and its driver d: f = offset + gain · d − lag · rate, by least squares."""

    gain: float
    offset: float
    """Follower where the driver is 0, at rest [unit]."""
    lag_s: float
    """Lag of the follower [s]; negative where it runs ahead."""
    correlation: float
    """Of the follower's deficit with the rate, both without what offset and gain explain: 1 for a
    pure lag, −1 for a lead.
    """
    swing: float
    """Range of the deficit that the rates make [unit]."""


def fit_lead(time: Array, follower: Array, driver: Array) -> Lead:
    """Gain, offset and lag of a follower [n] to its driver [n] over time [n, s].

    The rate is that of the mean of both, by central differences of block means: an exchange of the
    two changes the sign of the lag and nothing else, and so does a unit of time that is not
    seconds.
    """
    count = min(BLOCKS, time.size // 3)
    if count < 10:
        return Lead(1.0, 0.0, 0.0, 0.0, 0.0)
    t, f, d = (_blocks(series, count) for series in (time, follower, driver))
    scale = (float(np.ptp(f)) or 1.0) / (float(np.ptp(d)) or 1.0)
    rate = np.gradient(0.5 * (f / scale + d), t)
    others = np.column_stack([np.ones(count), d])
    design = np.column_stack([others, -rate])
    offset, gain, lag = np.linalg.lstsq(design, f, rcond=None)[0].tolist()
    left_rate, left = (
        series - others @ np.linalg.lstsq(others, series, rcond=None)[0] for series in (-rate, f)
    )
    power = float(np.sqrt((left_rate @ left_rate) * (left @ left)))
    together = float(left_rate @ left) / power if power > 0.0 else 0.0
    return Lead(gain, offset, lag, together, abs(lag) * float(np.ptp(rate)))


def _blocks(series: Array, count: int) -> Array:
    """Means of `count` blocks."""
    edges = np.linspace(0, series.size, count + 1).astype(np.int64)
    sums: Array = np.add.reduceat(series, edges[:-1])
    return sums / np.diff(edges)

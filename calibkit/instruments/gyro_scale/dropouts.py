"""Rows of held rates in which a gyro indicates far less than the table turns: pulses were lost."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from calibkit import check
from calibkit.arrays import Array, Mask
from calibkit.frame import Finding, Log, values
from calibkit.instruments.gyro_scale.numeric.plateau_means import Plateaus
from calibkit.numeric import chunks, order_statistics
from calibkit.numeric.dispersion import MAD_TO_SIGMA

SHARE = 0.5
"""Share of the expected indication below which a row is a dropout."""
CLEAR = 8.0
"""Standard deviations of single rows that a dropout is below what is expected."""
RESOLVED = 1e-6
"""Share of the largest indication below which a response is no rotation: a gyro across the axis."""


def _is_low(data: Array, rest: float, expected: float) -> Mask:
    """Which indications [n] are below a share of the expected one beyond that at rest."""
    return np.asarray((data - rest) * np.sign(expected) < SHARE * abs(expected), dtype=np.bool_)


def find(log: Log, held: Plateaus, columns: Sequence[str]) -> Iterator[Finding]:
    """Findings on the first dropout of each gyro's column, with the number of rows and what the
    other held rates let expect there.

    A held rate without any response is a dead zone or a gyro across the table axis, no dropout.
    """
    for column in columns:
        data = values(log.frame, column)
        middle = np.array([order_statistics.median(data[a:b]) for a, b in held.span.tolist()])
        fast = np.abs(held.rate_dps) >= np.median(np.abs(held.rate_dps))
        # a gyro across the axis may respond less than it indicates at rest
        line = np.polyfit(held.rate_dps, middle, 1) if np.ptp(held.rate_dps) > 0.0 else (0.0, 0.0)
        rest = float(line[1])
        K = float(np.median((middle[fast] - rest) / held.rate_dps[fast]))
        least = RESOLVED * max(map(abs, log.extremes(column)))
        lost, first, expected = 0, -1, 0.0
        for (a, b), rate, median in zip(
            held.span.tolist(), held.rate_dps.tolist(), middle.tolist(), strict=True
        ):
            noise = MAD_TO_SIGMA * order_statistics.median_magnitude(data[a:b], median)
            if SHARE * abs(K * rate) <= max(CLEAR * noise, least):
                continue
            low = chunks.rows_where(data[a:b], partial(_is_low, rest=rest, expected=K * rate))
            if 0 < low.size < b - a:
                first, expected = (first, expected) if lost else (a + int(low[0]), rest + K * rate)
                lost += low.size
        if lost:
            yield check.finding_at_row(
                log,
                first,
                column,
                f"{data[first]:.4g} 1/s while the table turns ({lost} such"
                f" row{'s' if lost > 1 else ''})",
                f"about {expected:.4g} 1/s, as the other held rates let expect",
                "pulses were lost: repair the logger, or leave the rows out:"
                f" {log.advise_exclude([first])}",
                "dropout",
                figure=float(data[first]),
            )

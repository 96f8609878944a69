"""Uncertainty of a statistic of an autocorrelated series from blocks of it, drawn with
replacement.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibkit.arrays import Array


CORRELATED_RUN = 5
"""Fewest lags in a row that must be insignificant before a correlation counts as ended (Politis &
White 2004).
"""


@dataclass(frozen=True, slots=True)
class Bootstrap:
    """A statistic [q] of an autocorrelated series, its covariance [q, q] with degrees of freedom,
    replicates [r, q].
    """

    estimate: Array
    covariance: Array
    dof: float
    replicates: Array
    block: int

    @property
    def standard_uncertainty(self) -> Array:
        """Square roots of the covariance's diagonal [q]."""
        return np.sqrt(np.diag(self.covariance))


def moving_block_bootstrap(
    series: Array,
    statistic: Callable[[Array], Array],
    generator: np.random.Generator,
    *,
    block: int | None = None,
    replicates: int = 500,
) -> Bootstrap:
    """Uncertainty of a statistic of an autocorrelated stationary series from blocks drawn with
    replacement.

    The series [n] or [n, k] may be the residuals of a fit and the statistic, of a series to a
    number or [q], the coefficients refitted to it. The block [samples] is that of `block_length`
    when absent. Raises FitError for a value not finite, a block longer than half the series, a
    single replicate, and as `block_length` does.

    Künsch 1989: blocks start anywhere in [0, n − block]. The covariance is divided by 1 − block/n,
    what deviations from the series' own mean lose, and has the 1.5 n/block degrees of freedom of a
    Bartlett window at zero frequency. It stays low by what the seams cut: u of a mean by 5 %, 11 %,
    20 % for correlation times of n/1000, n/200, n/50.
    """
    if not np.isfinite(series).all():
        raise FitError(
            "a value that is not finite reached the bootstrap", hint="exclude the rows that hold it"
        )
    samples = series.shape[0]
    length = block_length(series) if block is None else block
    if not 1 <= length <= samples // 2 or replicates < 2:
        raise FitError(
            f"blocks of {length} in a series of {samples}, {replicates} replicates",
            hint="expected two blocks or more and two replicates or more",
        )
    count = -(-samples // length)
    found = []
    for _ in range(replicates):
        starts = generator.integers(0, samples - length + 1, count)
        found.append(
            np.atleast_1d(
                statistic(series[(starts[:, None] + np.arange(length)).ravel()[:samples]])
            )
        )
    drawn = np.asarray(found, dtype=np.float64)
    covariance = np.atleast_2d(np.cov(drawn, rowvar=False)) / (1.0 - length / samples)
    estimate = np.atleast_1d(np.asarray(statistic(series), dtype=np.float64))
    return Bootstrap(estimate, covariance, 1.5 * samples / length, drawn, length)


def block_length(series: Array) -> int:
    """Block for a bootstrap of a series [n] or [n, k] (the longest of its columns), by Politis &
    White 2004.

    b = (2 G²/D)^(1/3) n^(1/3), G = Σ λ|k| R(k), D = 4/3 (Σ λ R(k))², λ a flat-top window up to
    twice the lag where the correlation ends, corrected after Patton, Politis & White 2009; from 1
    to min(3 √n, n/3). Raises FitError where the correlation does not end within √n lags: such a
    series holds no replicates of itself.
    """
    return max(_block_length(column) for column in series.reshape(series.shape[0], -1).T)


def _block_length(series: Array) -> int:
    """Block for one column [n]."""
    n = series.size
    centred = series - series.mean()
    size = 1 << (2 * n - 1).bit_length()
    autocovariance = np.fft.irfft(np.abs(np.fft.rfft(centred, size)) ** 2, size)[:n] / n
    if float(np.ptp(series)) == 0.0:
        return 1
    reach = 2 * max(_correlation_end(autocovariance / autocovariance[0]), 1)
    lags = np.arange(1 - min(reach, n), min(reach, n))
    window = np.clip(2.0 * (1.0 - np.abs(lags) / reach), 0.0, 1.0) * autocovariance[np.abs(lags)]
    spectrum = float(window.sum())
    if spectrum <= 0.0:
        return 1
    wanted = (1.5 * (float(window @ np.abs(lags)) / spectrum) ** 2 * n) ** (1.0 / 3.0)
    return max(1, int(np.ceil(min(wanted, 3.0 * np.sqrt(n), n / 3.0))))


def _correlation_end(correlation: Array) -> int:
    """Last lag before the autocorrelation [n] stays below 2 √(log₁₀ n/n) for five lags or more."""
    n = correlation.size
    run = max(CORRELATED_RUN, int(np.sqrt(np.log10(n))))
    most = min(int(np.ceil(np.sqrt(n))) + run, n - 1)
    small = np.abs(correlation[1 : most + 1]) < 2.0 * np.sqrt(np.log10(n) / n)
    quiet = (
        np.flatnonzero(np.convolve(small, np.ones(run), mode="valid") == run)
        if most >= run
        else np.zeros(0)
    )
    if quiet.size == 0:
        raise FitError(
            f"the correlation does not end within {most} of {n} samples: no block is long enough",
            hint="give the block, or the series at a coarser interval",
        )
    return int(quiet[0])

"""Joint fit of a bias over temperature to many logs of one instrument, at the noise of its blocks.

    y = b0 + t_j + Σ_k c_k x_k + e,   V = Cov e = σ² D⁻¹ + B² K,   means of D blocks of log j   (1)
    -2 log L_R = Σ ln(1 + ρ λ) + ln|Xᵀ V⁻¹ X| + ν ln σ̂²,   ρ = B²/σ²                            (2)

x_k are the terms of temperature, its rate and lagged temperatures (`terms`, scaled), c_k what is
sought. t_j is the turn-on bias of log j: free, or random with a variance that the logs tell. K is
the kernel of flicker noise along a log, λ its eigenvalues beside D⁻¹: `flicker.Turned` turns the
means of a log so that their variances are σ² (1 + ρ λ). A fit is plain least squares of rows that
are turned and divided by their noise. White noise averages out; flicker noise (bias instability)
and model misfit do not and dominate the uncertainty of drift coefficients. Both are modelled as
flicker noise of level B by restricted maximum likelihood. Unlike a kernel estimate (Newey & West
1987), this keeps correlation that is as long as the log. A long soak has many rows but little news,
as flicker noise says; nothing else keeps soaks from outvoting ramps.

Samples that stand out of their block (`spikes`), and blocks that stand out of their neighbours and
of what all terms explain (`sound_blocks`), are left out.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Self

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric import dispersion
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.dispersion import MAD_TO_SIGMA, mad_sigma
from calibkit.numeric.flicker import Turned, kernel
from calibkit.numeric.intervals import Intervals
from calibkit.numeric.least_squares import fit

if TYPE_CHECKING:
    from scipy.sparse import csr_array

LEVELS = np.concatenate([np.linspace(0.0, 2.0, 51), np.geomspace(2.0, 200.0, 31)[1:]])
"""Grid of flicker levels, in standard deviations of the white noise of a group."""
MOST_GROUPS = 250
"""Largest number of groups of a log: the size of the matrices that are factored."""
DEPENDENT_EIGENVALUE = 1e-12
"""Eigenvalue of a correlation matrix below which its columns count as dependent."""


@dataclass(frozen=True, slots=True)
class BlockNoise:
    """Variance of the white noise of a row [(°/h)²] and level B of the flicker noise [°/h]."""

    white_variance: float
    flicker: float


def estimate_noise(rotation: Turned, design: Array, indication: Array) -> BlockNoise:
    """White variance of a row and flicker level of blocks with a design [m, k] and indication [m],
    with a free offset of each log and common coefficients.

    The level is the root mean square over the posterior for a flat prior on B over the white noise
    of a group of usual size. The maximum of the likelihood would understate a level near zero, as
    half of the time it lies on the boundary.
    """
    rotated = rotation.rows(np.column_stack([np.ones(indication.size), design, indication]))
    levels, size = len(LEVELS), rotated.shape[1]
    # moments of design and indication about the level of each log, and (2) without its last term
    total, deviance = np.zeros((levels, size - 1, size - 1)), np.zeros(levels)
    with_level = np.zeros((levels, size - 2))
    for rows, _ in rotation.parts:
        # 1 + ρ λ of (2), for all flicker levels of the grid at once
        spread = 1.0 + (LEVELS**2 / rotation.typical)[:, None] * rotation.flicker[rows]
        products = rotated[rows, :, None] * rotated[rows, None, :]
        moment = (1.0 / spread) @ products.reshape(len(products), -1)
        moment = moment.reshape(levels, size, size)
        with_level += np.diagonal(moment, axis1=1, axis2=2)[:, 1:-1]
        # the free level of the log is eliminated by its normal equation
        total += moment[:, 1:, 1:] - moment[:, 1:, :1] * moment[:, :1, 1:] / moment[:, :1, :1]
        deviance += np.sum(np.log(spread), axis=1) + np.log(moment[:, 0, 0])
    # a column that is constant in each log is rounding alone about their levels
    squares = np.diagonal(total, axis1=1, axis2=2)[:, :-1]
    varies = squares > DEPENDENT_EIGENVALUE * with_level
    length = np.sqrt(np.where(varies, squares, 1.0))
    to_unit = varies / length
    unit = to_unit[:, :, None] * to_unit[:, None, :]
    gram, vectors = np.linalg.eigh(total[:, :-1, :-1] * unit)
    # dependent columns are allowed: the noise about them is asked for, not their coefficients
    gram = np.maximum(gram, DEPENDENT_EIGENVALUE)
    right = np.einsum("lij,li->lj", vectors, total[:, :-1, -1] * to_unit)
    left = total[:, -1, -1] - np.sum(right**2 / gram, axis=1)
    dof = max(len(rotated) - len(rotation.parts) - int(varies[0].sum()), 1)
    white = np.maximum(left, np.finfo(float).tiny) / dof
    deviance += np.sum(np.log(gram), axis=1) + 2.0 * np.sum(np.log(length), axis=1)
    deviance += dof * np.log(white)
    # posterior on the uneven grid for a prior that is flat in B
    share = np.exp(-0.5 * (deviance - deviance.min())) * np.gradient(LEVELS)
    share /= share.sum()
    square = share @ (LEVELS**2 * white)
    return BlockNoise(float(share @ white), float(np.sqrt(square / rotation.typical)))


def covariance_of(estimator: Array, design: Array, indication: Array) -> Array:
    """Covariance [p, p] of what an estimator P [p, n] makes of an indication [n], σ² P Pᵀ +
    B² P K Pᵀ; the noise is that about a design [n, k], whose first column is 1.
    """
    starts = np.arange(0, indication.size, -(-indication.size // MOST_GROUPS))
    count = np.diff(np.append(starts, indication.size)).astype(np.float64)
    sums = np.add.reduceat(np.column_stack([design[:, 1:], indication]), starts, axis=0)
    means = sums / count[:, None]
    rotation = Turned.of_logs(np.zeros_like(starts), np.arange(count.size), count)
    noise = estimate_noise(rotation, means[:, :-1], means[:, -1])
    P = np.add.reduceat(estimator, starts, axis=1)
    of_flicker = noise.flicker**2 * P @ kernel(count.size) @ P.T
    return np.asarray(noise.white_variance * estimator @ estimator.T + of_flicker, dtype=np.float64)


SAMPLE_SPIKE = 5.0
"""Deviation from the median of the interval, in standard deviations, above which a sample is a
spike: 6 of 10 million normal samples are.
"""


def spikes(indication: Array, intervals: Intervals) -> Integers:
    """Rows [k] of the spikes in an indication [n].

    A sample is compared with the median of its model interval. The standard deviation is estimated
    from the median absolute deviation over the whole log or over the interval, whichever is larger,
    so that true changes within an interval are not spikes. If most samples equal their median
    (counts of a quiet gyro), the smallest non-zero deviation is used instead. With two samples in
    an interval neither is a spike.
    """
    middles = dispersion.run_medians(indication, intervals.first)
    distances = indication - np.repeat(middles, intervals.count)
    np.abs(distances, out=distances)
    log_deviation = dispersion.median(distances)
    if log_deviation == 0.0 and distances.any():
        log_deviation = float(distances[distances > 0.0].min())
    # an interval that deviates more has a higher limit, so that true changes within it are no
    # spikes; it matters only where a sample stands out of the log's
    rows = np.flatnonzero(distances > SAMPLE_SPIKE * MAD_TO_SIGMA * log_deviation)
    interval = np.searchsorted(intervals.first, rows, side="right") - 1
    hit, of_interval = np.unique(interval, return_inverse=True)
    deviation = np.array(
        [
            np.median(distances[first : first + count])
            for first, count in zip(intervals.first[hit], intervals.count[hit], strict=True)
        ]
    )
    return rows[distances[rows] > SAMPLE_SPIKE * MAD_TO_SIGMA * deviation[of_interval]]


def means_without_spikes(values: Array, intervals: Intervals, *, excluded: Integers) -> Array:
    """Means [m] of values [n] over the model intervals without the `excluded` rows [k]; an interval
    with no other rows keeps them.
    """
    averages = intervals.means(values)
    hit, first_excluded = np.unique(
        np.searchsorted(intervals.first, excluded, side="right") - 1, return_index=True
    )
    ends = np.append(first_excluded, excluded.size)
    for k, interval in enumerate(hit.tolist()):
        first, count = int(intervals.first[interval]), int(intervals.count[interval])
        sound = np.ones(count, dtype=np.bool_)
        sound[excluded[ends[k] : ends[k + 1]] - first] = False
        if sound.any():
            averages[interval] = np.mean(values[first : first + count][sound])
    return averages


NEIGHBOURS = 7
"""Blocks in the running median of the residuals: a longer deviation is model misfit, not a spike.
"""
ITERATIONS = 30
BLOCK_SPIKE = 3.5
"""Standard deviations beyond which an isolated residual is a spike."""
DEPENDENT = 1e-5
"""Smallest singular value of columns of unit length below which they count as dependent."""
LEAST_LOGS = 3
"""Fewest logs that show how much turn-on biases differ."""
SIZES = 41
"""Standard deviations of the turn-on biases that are tried."""
LEAST_NOISE = 1e-9
"""Smallest noise of a block, relative to how far the indication scatters."""


@dataclass(frozen=True, slots=True)
class ThermalLog:
    """Block means [n] of one log: time [s], case and chamber temperature [°C], indication [°/h],
    and the index of each block's ramp.

    `part` [n] is the index of the ramp in the log, from 0; a soak belongs to the ramp before it.
    """

    name: str
    time: Array
    case: Array
    env: Array
    indication: Array
    part: Integers
    fitted: Mask | None = None
    """[n], which blocks are fitted; None for all."""
    starts: tuple[tuple[int, float], ...] = ()
    """First blocks of the spans across which lags are not carried, each with the temperature rate
    [°C/min] of the run-up that is assumed before it; none: the log begins at rest.
    """


def thermal_blocks(
    name: str,
    intervals: Intervals,
    means: Iterable[Array],
    indication: Array,
    begins: Sequence[int] = (),
) -> ThermalLog:
    """Block means of a log from the interval means [m] of time, case and chamber, and an indication
    [n, °/h].

    Spikes of the indication are left out. `begins` are the first rows of all ramps but the first.
    """
    time, case, env = means
    rate = means_without_spikes(indication, intervals, excluded=spikes(indication, intervals))
    ramp = np.searchsorted(np.asarray(begins, dtype=np.int64), intervals.first, side="right")
    return ThermalLog(name, time, case, env, rate, ramp.astype(np.int64))


@dataclass(frozen=True, slots=True)
class Stack:
    """Several logs in sequence: indication [n, °/h], which rows are fitted [n], and the rows of
    each log and of each ramp.
    """

    logs: tuple[ThermalLog, ...]
    indication: Array
    fitted: Mask
    log_rows: tuple[slice, ...]
    ramps: tuple[slice, ...]
    ramp_log: Integers
    ramp_names: tuple[str, ...]

    @classmethod
    def of_logs(cls, logs: Sequence[ThermalLog]) -> Self:
        """Stack logs; raises FitError for no log, a value that is not finite, or a ramp of less
        than ten blocks.
        """
        if not logs:
            raise FitError("no log to fit", hint="check the file names in [logs]")
        log_rows, ramps, ramp_log, names, row = [], [], [], [], 0
        for number, log in enumerate(logs):
            columns = log.time, log.case, log.env, log.indication
            if not all(np.isfinite(column).all() for column in columns):
                raise FitError(
                    f"{log.name}: a value that is not finite reached the fit",
                    hint="exclude the rows that hold it",
                )
            edges = [0, *(np.flatnonzero(np.diff(log.part)) + 1).tolist(), log.part.size]
            for k, (start, stop) in enumerate(pairwise(edges), start=1):
                if stop - start < 10:
                    raise FitError(
                        f"{log.name}: a ramp of {stop - start} blocks over"
                        f" {log.time[stop - 1] - log.time[start]:.3g} s, expected at least 10",
                        hint="shorten drift.interval_s; a ramp that took longer was logged in"
                        ' another unit: state it, [columns.time_s] unit = "min"',
                    )
                ramps.append(slice(row + start, row + stop))
                ramp_log.append(number)
                names.append(log.name if len(edges) == 2 else f"{log.name}:{k}")
            log_rows.append(slice(row, row + log.part.size))
            row += log.part.size
        fitted_masks = (
            np.ones(log.time.size, bool) if log.fitted is None else log.fitted for log in logs
        )
        return cls(
            tuple(logs),
            np.concatenate([log.indication for log in logs]),
            np.concatenate(list(fitted_masks)),
            tuple(log_rows),
            tuple(ramps),
            np.array(ramp_log, dtype=np.int64),
            tuple(names),
        )

    @property
    def levels(self) -> Array:
        """Mean indication [logs] of each log."""
        return np.array([log.indication.mean() for log in self.logs])

    @property
    def level_columns(self) -> Array:
        """Columns [n, logs], 1 in the rows of each log."""
        number = np.repeat(np.arange(len(self.logs)), [log.time.size for log in self.logs])
        return np.asarray(number[:, None] == np.arange(len(self.logs)), dtype=np.float64)


@dataclass(frozen=True)
class WhitenedRows:
    """Means of groups of the blocks of logs, turned to where their noise is independent, and
    divided by it.
    """

    stacked: Stack
    sound: Mask
    """Which blocks [n] of the stack are fitted."""
    starts: Integers
    """[m], first of the fitted blocks in each group."""
    rotation: Turned
    noise: BlockNoise

    @classmethod
    def of_stack(cls, stacked: Stack, sound: Mask, left_out: slice = slice(0, 0)) -> Self:
        """Rows of the sound blocks [n] of logs without those of one ramp, at white noise."""
        included = sound.copy()
        included[left_out] = False
        blocks = np.flatnonzero(included)
        log, place = np.empty((2, blocks.size), dtype=np.int64)
        for number, rows in enumerate(stacked.log_rows):
            of_log = slice(*np.searchsorted(blocks, (rows.start, rows.stop)))
            log[of_log] = number
            size = -(-(rows.stop - rows.start) // MOST_GROUPS)
            place[of_log] = (blocks[of_log] - rows.start) // size
        starts = np.flatnonzero(np.diff(log * MOST_GROUPS + place, prepend=-1))
        count = np.diff(np.append(starts, blocks.size)).astype(np.float64)
        _, number_of = np.unique(log[starts], return_inverse=True)
        rotation = Turned.of_logs(number_of, place[starts], count)
        return cls(stacked, included, starts, rotation, BlockNoise(1.0, 0.0))

    def means(self, values: Array) -> Array:
        """Means [m, k] over the groups of values [n, k] of all blocks."""
        return np.asarray(self._averaging @ values, dtype=np.float64)

    @property
    def _averaging(self) -> "csr_array":
        """Matrix [m, n] of the means over the groups; sparse, it is many times faster than sums of
        slices of many columns. It is not kept: a log of 200 ramps is left without each in turn.
        """
        from scipy.sparse import csr_array  # not before a fit needs it

        blocks = np.flatnonzero(self.sound)
        ends = np.append(self.starts, blocks.size)
        sizes = np.diff(ends)
        shape = (sizes.size, self.stacked.indication.size)
        return csr_array((np.repeat(1.0 / sizes, sizes), blocks, ends), shape=shape)

    def at_noise_of(self, left: Array, columns: Array | None = None) -> Self:
        """The rows at the noise of what is left [n] beside a free level of each log, and about a
        fit of columns [n, k] where such are given.
        """
        design = np.zeros((left.size, 0)) if columns is None else columns
        means = self.means(np.column_stack([design, left]))
        noise = estimate_noise(self.rotation, means[:, :-1], means[:, -1])
        least_variance = (LEAST_NOISE * float(np.std(self.stacked.indication))) ** 2 or 1.0
        return replace(
            self, noise=replace(noise, white_variance=max(noise.white_variance, least_variance))
        )

    def of(self, values: Array) -> Array:
        """Rows [m, k] of values [n, k] of all blocks."""
        white, flicker = self.noise.white_variance, self.noise.flicker
        u = np.sqrt(white + flicker**2 * self.rotation.flicker)
        return self.rotation.rows(self.means(values)) / u[:, None]

    @cached_property
    def _levels_and_indication(self) -> tuple[Array, Array]:
        """Rows [m, logs] of the level of each log that is there, and [m] of the indication."""
        levels = self.stacked.level_columns
        present = np.any(levels[self.sound] > 0.0, axis=0)
        whitened = self.of(np.column_stack([levels[:, present], self.stacked.indication]))
        return whitened[:, :-1], whitened[:, -1]

    def solve(self, columns: Array, turn_on_variance: float = np.inf) -> "LeastSquares | None":
        """Fit of columns [n, k] to the indication; None if they are linearly dependent."""
        return self.solve_rows(self.of(columns), turn_on_variance)

    def solve_rows(self, X: Array, turn_on_variance: float = np.inf) -> "LeastSquares | None":
        """The same of columns [m, k] that are rows already.

        Turn-on biases of finite variance τ² add the rows 0 = (l_j − mean l)/τ.
        """
        levels, y = self._levels_and_indication
        logs, k = levels.shape[1], X.shape[1]
        X = np.hstack([levels, X])
        if np.isfinite(turn_on_variance):
            turn_on_rows = (np.eye(logs) - 1.0 / logs) / np.sqrt(turn_on_variance)
            X = np.vstack([X, np.pad(turn_on_rows, ((0, 0), (0, k)))])
            y = np.append(y, np.zeros(logs))
        length = np.linalg.norm(X, axis=0)
        if not np.all(length > 0.0):
            return None
        u, singular, vt = np.linalg.svd(X / length, full_matrices=False)
        if singular[-1] < DEPENDENT:
            return None
        root = vt.T / singular / length[:, None]
        parameters = root @ (u.T @ y)
        square = float(np.sum((y - X @ parameters) ** 2))
        return LeastSquares(parameters, root @ root.T, square, logs)

    def solve_terms(self, columns: Array, names: Sequence[str]) -> tuple["LeastSquares", float]:
        """Fit of columns [n, k] with turn-on biases that are as alike as the logs show, and their
        variance. Raises FitError naming the terms that the logs cannot determine.
        """
        free = self.solve(columns)
        if free is None:
            levels = self.stacked.level_columns
            column_names = [*[""] * levels.shape[1], *names]
            whitened = self.of(np.hstack([levels, columns]))
            loose = list(filter(None, fit.undetermined(whitened, column_names))) or list(names)
            raise FitError(
                f"the logs cannot determine {', '.join(loose)}",
                hint="vary temperature, rate and gradient, or drop these terms",
            )
        variance = free.turn_on_variance()
        return self.solve(columns, variance) or free, variance


@dataclass(frozen=True, slots=True)
class LeastSquares:
    """Levels of logs and coefficients of columns, with their covariance by the noise."""

    parameters: Array
    """[logs + k]."""
    covariance: Array
    square: float
    """Sum of the squares of the whitened residuals."""
    logs: int

    @property
    def levels(self) -> Array:
        """[logs], b0 plus the turn-on bias of each."""
        return self.parameters[: self.logs]

    @property
    def coefficients(self) -> Array:
        """[k]."""
        return self.parameters[self.logs :]

    def turn_on_variance(self) -> float:
        """Variance of the turn-on biases, from free levels l ~ N(b0, τ² I + C), C their covariance:
        mean over its posterior for a flat prior on τ, as the maximum would understate one near
        zero; infinite, biases that are free, for fewer than LEAST_LOGS.
        """
        # With the most likely size in its place, that of `calibkit.fit`, k = 2 covered 90.5 % of
        # the coefficients of lagged models, not 93.2 % (benchmarks/drift_coverage.py, 40 gyros).
        if self.logs < LEAST_LOGS:
            return float("inf")
        C, constant = self.covariance[: self.logs, : self.logs], np.ones(self.logs)
        u, spread = np.sqrt(np.mean(np.diag(C))), np.std(self.levels)
        # from turn-on biases that do not show to those that are everything
        sizes = np.geomspace(0.01 * u, 100.0 * max(u, spread), SIZES)
        deviance = np.empty(SIZES)
        for number, size in enumerate(sizes):
            V = C + size**2 * np.eye(self.logs)
            inverse = np.linalg.inv(V)
            information = constant @ inverse @ constant
            turn_on = self.levels - constant @ inverse @ self.levels / information
            deviance[number] = (
                np.linalg.slogdet(V)[1] + np.log(information) + turn_on @ inverse @ turn_on
            )
        share = np.exp(-0.5 * (deviance - deviance.min())) * sizes
        return float(share @ sizes**2 / share.sum())


def sound_blocks(columns: Array, stacked: Stack) -> Mask:
    """Which blocks [n] are fitted and no spikes about a fit of these columns [n, k].

    It is isolated residuals that are judged, less the median of their neighbours in the same log,
    so that rows stay where a model misses a transient of minutes; linearly dependent columns are
    allowed.
    """
    X = np.column_stack([columns, stacked.level_columns])
    X = X / np.maximum(np.linalg.norm(X, axis=0), np.finfo(float).tiny)
    sound = stacked.fitted.copy()
    for _ in range(ITERATIONS):
        coefficients = np.linalg.lstsq(X[sound], stacked.indication[sound], rcond=DEPENDENT)[0]
        residual, half = stacked.indication - X @ coefficients, NEIGHBOURS // 2
        isolated = np.empty_like(residual)
        for rows in stacked.log_rows:
            padded = np.pad(residual[rows], half, mode="reflect")
            neighbourhoods = np.lib.stride_tricks.sliding_window_view(padded, NEIGHBOURS)
            # a row among its own neighbours would often be the median, and the scale too small
            median = np.median(np.delete(neighbourhoods, half, axis=1), axis=1)
            isolated[rows] = np.abs(residual[rows] - median)
        before = sound
        sound = stacked.fitted & (isolated <= BLOCK_SPIKE * mad_sigma(isolated[stacked.fitted]))
        if np.array_equal(sound, before):
            break
    return sound

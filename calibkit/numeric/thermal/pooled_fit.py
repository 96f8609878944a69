"""Joint fit of a bias over temperature to many logs of one instrument.

    y_i = b0 + t_j + Σ_k c_k x_ki + e_i        row i of log j

x_k are the terms of temperature, its rate and lagged temperatures (`terms`, scaled), c_k what is
sought, e white noise of variance σ². t_j is the turn-on bias of log j: random, of variance σ²/a.
With a = 0 it is free, and only changes within a log tell c_k; the larger a (`alike`), the more the
levels at which logs stand tell them too. a comes from the logs (`pooled_moments.find_alike`).

The weight of a row is the product of two: Tukey's biweight of its residual, against spikes, and the
weight by how long its temperature was held (`occupancy`), so that soaks do not outvote ramps.

All sums are moment matrices, one a ramp: adding up those of any ramps gives the fit to these by a
small linear system, which makes leaving out each ramp, and searching for lags, cheap.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, Self

import numpy as np

from calibkit.arrays import Array, Integers, Mask
from calibkit.errors import FitError
from calibkit.numeric.dispersion import mad_sigma, rms
from calibkit.numeric.flicker import Turned
from calibkit.numeric.intervals import Intervals
from calibkit.numeric.least_squares import fit
from calibkit.numeric.least_squares.robust import HUBER, TUKEY
from calibkit.numeric.thermal import noise as thermal_noise, occupancy, pooled_moments
from calibkit.numeric.thermal.terms import (
    Drivers,
    Scales,
    ThermalModel,
    chosen_columns,
)

NEIGHBOURS = 7
"""Blocks in the running median of the residuals: a longer deviation is model misfit, not a spike.
"""
ITERATIONS = 30
SETTLED = 1e-3
"""Largest change of a robust weight that ends the iteration."""
LASTING_S = (60.0, 300.0)
"""Shortest and longest lag [s] of the residual products that give the misfit."""
LASTING_LAGS = 25


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
    held: Intervals,
    means: Iterable[Array],
    indication: Array,
    begins: Sequence[int] = (),
) -> ThermalLog:
    """Block means of a log from the interval means [m] of time, case and chamber, and an indication
    [n, °/h].

    Spikes of the indication are left out. `begins` are the first rows of all ramps but the first.
    """
    time, case, env = means
    rate = occupancy.means(indication, held, without=occupancy.spikes(indication, held))
    ramp = np.searchsorted(np.asarray(begins, dtype=np.int64), held.first, side="right")
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
    alike: float = 0.0
    """White variance of a row over the variance of the turn-on biases; 0 where they are free."""

    @classmethod
    def of_logs(cls, logs: Sequence[ThermalLog]) -> Self:
        """Stack logs; raises FitError for no log, a value that is not finite, or a ramp of less
        than ten blocks.
        """
        if not logs:
            raise FitError("no log to fit", hint="check the file names in [logs]")
        for log in logs:
            if not all(
                np.isfinite(values).all()
                for values in (log.time, log.case, log.env, log.indication)
            ):
                raise FitError(
                    f"{log.name}: a value that is not finite reached the fit",
                    hint="exclude the rows that hold it",
                )
        ramps, owners, names, log_rows = [], [], [], []
        row = 0
        for number, log in enumerate(logs):
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
                owners.append(number)
                names.append(log.name if len(edges) == 2 else f"{log.name}:{k}")
            log_rows.append(slice(row, row + log.part.size))
            row += log.part.size
        return cls(
            tuple(logs),
            np.concatenate([log.indication for log in logs]),
            np.concatenate(
                [np.ones(log.time.size, bool) if log.fitted is None else log.fitted for log in logs]
            ),
            tuple(log_rows),
            tuple(ramps),
            np.array(owners, dtype=np.int64),
            tuple(names),
        )


def moments(columns: Array, weights: Array, stacked: Stack) -> Array:
    """Weighted moment matrices [ramps, k + 2, k + 2] of (1, columns [n, k], indication), one per
    ramp.
    """
    whole = np.empty((columns.shape[0], columns.shape[1] + 2))
    whole[:, 0], whole[:, 1:-1], whole[:, -1] = 1.0, columns, stacked.indication
    weighted = whole * weights[:, None]
    return np.stack([weighted[rows].T @ whole[rows] for rows in stacked.ramps])


def pool_moments(moment: Array, stacked: Stack, left_out: int | None = None) -> Array:
    """Moment matrix [k + 1, k + 1] of all ramps but `left_out`, with the turn-on biases of their
    logs eliminated.
    """
    return pooled_moments.pool(_by_log(moment, stacked, left_out), stacked.alike)


def _by_log(moment: Array, stacked: Stack, left_out: int | None = None) -> Array:
    """Moment matrices [logs, k + 2, k + 2] of logs, from those of their ramps but `left_out`."""
    kept = [ramp for ramp in range(len(stacked.ramps)) if ramp != left_out]
    _, first = np.unique(stacked.ramp_log[kept], return_index=True)
    return np.asarray(np.add.reduceat(moment[kept], first, axis=0), dtype=np.float64)


def with_turn_on(columns: Array, weights: Array, stacked: Stack) -> Stack:
    """Stack whose turn-on biases are as alike as a fit to columns [n, k] shows."""
    by_log = _by_log(moments(columns, weights, stacked), stacked)
    return replace(stacked, alike=pooled_moments.find_alike(by_log, int(np.count_nonzero(weights))))


def _residuals(
    columns: Array, coefficients: Array, weights: Array, stacked: Stack
) -> tuple[Array, Array]:
    """Residuals [n, °/h] about their weighted mean in each log, and these means [logs, °/h]: b0
    plus the turn-on bias.
    """
    residual = stacked.indication - columns @ coefficients
    offsets = np.array(
        [np.average(residual[rows], weights=weights[rows]) for rows in stacked.log_rows]
    )
    return residual - np.repeat(offsets, [log.time.size for log in stacked.logs]), offsets


def _centre(columns: Array, weights: Array, stacked: Stack) -> Array:
    """Columns [n, k] about their weighted mean in each log."""
    centred = columns.copy(order="K")
    for rows in stacked.log_rows:
        centred[rows] -= np.average(centred[rows], axis=0, weights=weights[rows])
    return centred


def _isolated(residual: Array, stacked: Stack) -> Array:
    """Residuals [n] less the median of their neighbours in the same log, which removes slow misfit;
    a row among its own neighbours would often be the median, and the scale too small.
    """
    apart = np.empty_like(residual)
    half = NEIGHBOURS // 2
    for rows in stacked.log_rows:
        around = np.lib.stride_tricks.sliding_window_view(
            np.pad(residual[rows], half, mode="reflect"), NEIGHBOURS
        )
        apart[rows] = residual[rows] - np.median(np.delete(around, half, axis=1), axis=1)
    return apart


def _loss_weights(apart: Array, *, biweight: bool) -> Array:
    """Weights [n] of Huber's loss or of Tukey's biweight for isolated residuals [n] relative to
    their scale.
    """
    ratio = np.abs(apart) / (mad_sigma(apart) or 1.0)
    if biweight:
        return np.asarray((1.0 - np.minimum(ratio / TUKEY, 1.0) ** 2) ** 2, dtype=np.float64)
    return np.asarray(HUBER / np.maximum(ratio, HUBER), dtype=np.float64)


def coefficients(columns: Array, weights: Array, stacked: Stack, names: Sequence[str]) -> Array:
    """Coefficients [k] of a weighted fit with an offset per log.

    Raises FitError naming the terms that the logs cannot determine.
    """
    found = pooled_moments.solve(pool_moments(moments(columns, weights, stacked), stacked))
    if found is not None:
        return found[0]
    loose = fit.undetermined(
        _centre(columns, weights, stacked) * np.sqrt(weights)[:, None], names
    ) or list(names)
    raise FitError(
        f"the logs cannot determine {', '.join(loose)}",
        hint="vary temperature, rate and gradient, or drop these terms",
    )


def robust_weights(columns: Array, stacked: Stack) -> Array:
    """Tukey's biweight weights [n] of the rows of a fit to these columns, iterated from Huber's.

    The loss acts on isolated residuals, so that rows keep their weight where a model misses a
    transient of minutes; linearly dependent columns are allowed.
    """
    weights = stacked.fitted.astype(np.float64)
    for biweight in (False, True):
        for _ in range(ITERATIONS):
            apart = _isolated(_projected_out(columns, weights, stacked), stacked)
            moved, weights = weights, _loss_weights(apart, biweight=biweight) * stacked.fitted
            if float(np.max(np.abs(moved - weights))) < SETTLED:
                break
    return weights


def _misfit_lags(log: ThermalLog) -> list[int]:
    """Lags [blocks] of the residual products of a log, between both LASTING_S; about LASTING_LAGS
    of them.
    """
    step = float(np.median(np.diff(log.time)))
    first, last = (max(round(apart / step), 1) for apart in LASTING_S)
    return list(range(first, last + 1, max((last - first) // (LASTING_LAGS - 1), 1)))


def _projected_out(columns: Array, weights: Array, stacked: Stack) -> Array:
    """Residuals [n, °/h] of a weighted least-squares fit (pseudo-inverse) with a free offset per
    log.
    """
    matrix = pool_moments(moments(columns, weights, stacked), stacked)
    square = np.diag(matrix)[:-1]
    length = np.sqrt(np.where(square > 0.0, square, 1.0))
    correlation = matrix[:-1, :-1] / np.outer(length, length)
    found = (
        np.linalg.pinv(correlation, rcond=pooled_moments.DEPENDENT, hermitian=True)
        @ (matrix[:-1, -1] / length)
        / length
    )
    return _residuals(columns, found, weights, stacked)[0]


def balanced_weights(columns: Array, robust: Array, stacked: Stack, names: Sequence[str]) -> Array:
    """Weights [n] of the rows: robust weights [n] times the weights by the occupancy of their
    temperatures.
    """
    found = coefficients(columns, robust, stacked, names)
    residual, _ = _residuals(columns, found, robust, stacked)
    noise = mad_sigma(_isolated(residual, stacked))
    lasting = [
        occupancy.misfit(residual[rows], robust[rows], _misfit_lags(log))
        for rows, log in zip(stacked.log_rows, stacked.logs, strict=True)
    ]
    return robust * occupancy.weights(
        occupancy.counts(np.concatenate([log.case for log in stacked.logs])), noise, rms(lasting)
    )


@dataclass(frozen=True, slots=True)
class Solution:
    """Fitted model in the scaled basis, with the columns and weights of its fit."""

    form: Literal["level", "lagged"]
    terms: tuple[str, ...]
    scales: Scales
    drivers: Drivers
    columns: Array
    """[n, k], the scaled terms without b0."""
    sensitivities: Array
    """[n, m], derivative of the drift by the logarithm of each free lag."""
    coefficients: Array
    """[k]."""
    log_lags: Array
    """Logarithms of the lags [s]; empty for a level model."""
    free: Mask
    """[lags], whether a lag is determined by the fit and not at its bound."""
    robust: Array
    """[n], robust weights."""
    weights: Array
    """[n], robust weights times those by the occupancy of the temperatures."""
    window_s: float
    alike: float
    """White variance of a row over the variance of the turn-on biases."""

    def finish(self, stacked: Stack) -> ThermalModel:
        """Drift model in raw units, with a covariance for white and flicker noise.

        Raises FitError naming the terms that the logs cannot determine.
        """
        chosen = chosen_columns(self.terms)[1:]
        exact = _exact(self, stacked)
        design = np.column_stack([self.columns, self.sensitivities])
        residual, level = _residuals(self.columns, exact, self.weights, stacked)
        groups = [
            thermal_noise.group_rows(design[rows], residual[rows], self.weights[rows])
            for rows in stacked.log_rows
        ]
        turned = Turned.of_logs(
            np.repeat(np.arange(len(groups)), [group.weight.size for group in groups]),
            np.concatenate([group.effective for group in groups]),
        )
        noise = thermal_noise.estimate(
            turned,
            np.concatenate([group.design for group in groups]),
            np.concatenate([group.indication for group in groups]),
        )
        matrix = _to_raw_and_lags(self, len(stacked.logs), chosen)
        found = thermal_noise.covariance(groups, noise, self.alike)
        covariance = matrix @ found @ matrix.T
        turn_on_variance = _turn_on_variance(level, found)
        covariance[0, 0] += turn_on_variance
        scaled = np.concatenate([[level.mean()], np.zeros(8)])
        scaled[chosen] = exact
        used, logs = int(np.count_nonzero(self.robust)), len(stacked.logs)
        dof = used - chosen.size - int(self.free.sum()) - logs
        return ThermalModel(
            form=self.form,
            terms=self.terms,
            coefficients=self.scales.to_raw() @ scaled,
            lags=tuple(np.exp(self.log_lags).tolist()),
            covariance=covariance,
            window_s=self.window_s,
            valid=Drivers(*(values[stacked.fitted] for values in self.drivers)).valid(),
            turn_on=level - level.mean(),
            turn_on_variance=turn_on_variance,
            constant_dof=float(logs - 1) if logs > 1 else float(dof),
            dof=dof,
            residual_rms=float(np.sqrt(np.average(residual**2, weights=self.robust))),
            noise=noise,
            model_error=0.0,
            model_error_dof=float("inf"),
            entangled=(),
            flags=(),
        )


def _exact(solution: Solution, stacked: Stack) -> Array:
    """Coefficients [k] by orthogonal factorisation of the columns, centred by their weighted means
    in each log, and of these means where the turn-on biases are alike.
    """
    if not solution.columns.shape[1]:
        return np.zeros(0)
    whole, weights = np.column_stack([solution.columns, stacked.indication]), solution.weights
    rows = _centre(whole, weights, stacked)
    if solution.alike:
        sums = np.array([weights[log].sum() for log in stacked.log_rows])
        means = np.array([(whole[log] - rows[log])[0] for log in stacked.log_rows])
        between, apart = pooled_moments.between_logs(sums, means, solution.alike)
        rows, weights = np.concatenate([rows, apart]), np.concatenate([weights, between])
    return fit.linear(
        rows[:, :-1], rows[:, -1], weights=weights, names=solution.terms[1:]
    ).coefficients


def _to_raw_and_lags(solution: Solution, logs: int, chosen: Integers) -> Array:
    """Matrix [9 + lags, logs + k + free lags] from (offsets, scaled coefficients, logarithms of the
    free lags) to raw units and seconds.
    """
    k, lags = chosen.size, solution.log_lags.size
    scaled = np.zeros((9 + lags, logs + k + int(solution.free.sum())))
    scaled[0, :logs] = 1.0 / logs
    scaled[chosen, logs + np.arange(k)] = 1.0
    free = np.flatnonzero(solution.free)
    scaled[9 + free, logs + k + np.arange(free.size)] = np.exp(solution.log_lags[free])
    raw = np.eye(9 + lags)
    raw[:9, :9] = solution.scales.to_raw()
    # terms that were not fitted have zero rows in `scaled`
    return np.asarray(raw @ scaled, dtype=np.float64)


def _turn_on_variance(level: Array, covariance: Array) -> float:
    """Variance [(°/h)²] of the mean turn-on bias: the scatter of the logs' offsets beyond their own
    uncertainty, over their number.
    """
    count = level.size
    if count < 2:
        return 0.0
    own = float(np.mean(np.diag(covariance)[:count]) - np.mean(covariance[:count, :count]))
    return max(float(np.var(level, ddof=1)) - own, 0.0) / count

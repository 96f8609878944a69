"""Fits of level and lagged models (`terms`) to logs with turn-on biases.

    level    T is the case temperature, G = T_case − T_env, rates by `coil.level_drivers`
    lagged   τ_o T_o' = T_s − T_o,   τ_i T_i' = T_o − T_i,   T = T_o,  G = T_o − T_i

As G' = T_o' − G/τ_i is a linear combination of T' and G, s_grad_rate is no term of a lagged model.
At given lags a model is linear: its coefficients are eliminated at every step, so that the search
is over the lags alone (variable projection, Golub & Pereyra 1973). A level model has no lags.

`level_basis` and `lagged_basis` say how terms follow from lags, `Basis.solve` finds the lags of a
set of terms, `finish` the model in raw units at the noise about it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.arrays import Array, Integers, Mask
from calibkit.numeric.dispersion import rms
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.pooled_fit import LeastSquares, Stack, WhitenedRows, sound_blocks
from calibkit.numeric.thermal.terms import (
    LAGS,
    TERMS,
    Drivers,
    Scales,
    ThermalModel,
    chosen_columns,
)

LAGGED_TERMS = tuple(term for term in TERMS if term != "s_grad_rate")
BOUNDS_S = (20.0, 3600.0)
"""Bounds of the lags [s]: shorter lags are not resolved by model intervals, longer ones outlast a
soak.
"""
STARTS_S = (30.0, 70.0, 160.0, 360.0, 800.0, 1800.0)
"""Grid of lags [s] for the start of the minimisation."""
MOST_STARTS = 3
STEP = 1e-3
"""Change of the logarithm of a lag for numerical derivatives of the columns."""
LARGEST_STEP = 0.7
"""Largest change of the logarithm of a lag in one iteration: a factor of two."""
ITERATIONS = 25
HALVINGS = 6
DETERMINED = 0.3
"""Relative standard uncertainty of a lag above which its distribution, and those of the terms
correlated with it, are not normal.
"""
ONE_WITH_LAGS = ("s_rate", "s_grad", "s_grad2")
CLOSE, SETTLED = 1e-4, 1e-10
"""Changes of the logarithm of a lag from which on steps are full, and that end the search."""


@dataclass(frozen=True)
class Basis:
    """Logs and how the nine terms along them follow from lags; `rows` are at the noise about all
    terms of a level model, at which candidates are compared.
    """

    rows: WhitenedRows
    scales: Scales
    source: Drivers | coil.Path
    """What the terms are made of: of a level model what the logs show themselves, of a lagged one
    the case temperatures that the coil follows.
    """
    window_s: float = 0.0
    """Trailing window of the rates of a level model [s]."""

    def drivers(self, log_lags: Array) -> Drivers:
        """Drivers [n] of all logs in sequence, for the logarithms of no lag, one lag or two."""
        if isinstance(self.source, Drivers):
            return self.source
        outer, *inner = np.exp(log_lags).tolist()
        return self.source.drivers(outer, inner[0] if inner else None)

    def design(self, log_lags: Array) -> Array:
        """Scaled columns [n, 9] of all terms, for the logarithms of the lags."""
        return self.drivers(log_lags).scaled_design(self.scales)

    @cached_property
    def grid(self) -> list[tuple[Array, Array]]:
        """Logarithms of lags [2] on a grid, and whitened rows [m, 9] of all terms at each, for the
        start of every candidate.
        """
        pairs = np.stack(np.meshgrid(STARTS_S, STARTS_S, indexing="ij"), -1).reshape(-1, 2)
        return [(lags, self.rows.of(self.design(lags))) for lags in np.log(pairs)]

    def solve(self, terms: Sequence[str]) -> "TermSolution":
        """Fit a model with these terms; the coil of a lagged one has one lag unless s_grad is among
        them, then two.

        Raises FitError for terms that do not belong to a lagged model or that the logs cannot
        determine.
        """
        if isinstance(self.source, Drivers):
            solution = TermSolution("level", self, tuple(terms), np.zeros(0))
            _, variance = self.rows.solve_terms(solution.columns, solution.terms[1:])
            return replace(solution, turn_on_variance=variance)
        if "s_grad_rate" in terms:
            raise FitError(
                "s_grad_rate is not a term of a lagged model:"
                " G' = T' − G/τ_i is a sum of the others",
                hint="drop it",
            )
        # without a gradient a second lag would not enter the model
        starts = self._starts(chosen_columns(terms)[1:], 2 if "s_grad" in terms else 1)
        at_starts = (TermSolution("lagged", self, tuple(terms), lags) for lags in starts)
        roughly = (minimise(start, settled=CLOSE) for start in at_starts)
        rough = min(roughly, key=lambda solution: solution.square)
        # turn-on biases are free in the search for the lags, random in what is kept
        variance = rough.least_squares.turn_on_variance()
        return minimise(replace(rough, turn_on_variance=variance))

    def _starts(self, column_numbers: Integers, count: int) -> list[Array]:
        """Logarithms of `count` lags to begin with: the best MOST_STARTS local minima on the grid.

        The logs hardly determine which of two lags is the outer one, and each order may have a
        minimum.
        """
        squares = np.full(len(self.grid), np.inf)
        for k, (_, rows) in enumerate(self.grid):
            fit = self.rows.solve_rows(rows[:, column_numbers])
            if fit is not None:
                squares[k] = fit.square
        if not np.isfinite(squares).any():
            raise _undetermined()
        over_lags = squares.reshape(len(STARTS_S), -1)[:, : None if count > 1 else 1]
        least_nearby = np.lib.stride_tricks.sliding_window_view(
            np.pad(over_lags, 1, constant_values=np.inf), (3, 3)
        ).min(axis=(2, 3))
        outer, inner = np.nonzero((over_lags <= least_nearby) & np.isfinite(over_lags))
        best = np.argsort(over_lags[outer, inner], kind="stable")[:MOST_STARTS]
        return [self.grid[outer[k] * len(STARTS_S) + inner[k]][0][:count] for k in best]


def level_basis(stacked: Stack) -> Basis:
    """Basis of level fits; spikes are those about a fit of all terms.

    The trailing window is WINDOW_S, or for long blocks twice the shortest that gives rates.
    """
    step = max(float(np.median(np.diff(log.time))) for log in stacked.logs)
    # rates need four blocks in half a window
    window_s = max(coil.WINDOW_S, 2.0 * (coil.LEAST_SAMPLES - 1) * round(step, 3))
    parts = [coil.level_drivers(log.time, log.case, log.env, window_s) for log in stacked.logs]
    log_drivers = Drivers(*map(np.concatenate, zip(*parts, strict=True)))
    scales = log_drivers.valid().scales()
    columns = log_drivers.scaled_design(scales)[:, 1:]
    rows = WhitenedRows.of_stack(stacked, sound_blocks(columns, stacked))
    rows = rows.at_noise_of(stacked.indication, columns)
    return Basis(rows, scales, log_drivers, window_s)


def lagged_basis(rows: WhitenedRows) -> Basis:
    """Basis of lagged fits to rows, whose spikes and noise come from a level fit to the same
    logs.
    """
    logs = rows.stacked.logs
    case_path = coil.path_of_spans([(log.time, log.case, log.starts) for log in logs])
    # the scales of the columns hardly depend on the lags: those of the middle of the grid serve
    # all
    middle = float(np.sqrt(STARTS_S[2] * STARTS_S[3]))
    scales = case_path.drivers(middle, middle).valid().scales()
    return Basis(rows, scales, case_path)


@dataclass(frozen=True)
class TermSolution:
    """Fit of terms at given lags, in the scaled basis."""

    form: Literal["level", "lagged"]
    basis: Basis
    terms: tuple[str, ...]
    """Terms that are fitted, b0 first."""
    log_lags: Array
    """Logarithms of the lags [s]; empty for a level model."""
    turn_on_variance: float = np.inf
    """Of the turn-on biases; infinite where they are free."""

    @property
    def rows(self) -> WhitenedRows:
        """Rows of the fit."""
        return self.basis.rows

    @cached_property
    def columns(self) -> Array:
        """Scaled columns [n, k] of the terms beside b0."""
        return self.basis.design(self.log_lags)[:, chosen_columns(self.terms)[1:]]

    @cached_property
    def fit(self) -> LeastSquares | None:
        """Coefficients at these lags; None if the columns are linearly dependent."""
        return self.rows.solve(self.columns, self.turn_on_variance)

    @property
    def least_squares(self) -> LeastSquares:
        """Coefficients at these lags; FitError if the columns are linearly dependent."""
        if self.fit is None:
            raise _undetermined()
        return self.fit

    @property
    def square(self) -> float:
        """Sum of squares."""
        return self.least_squares.square

    @cached_property
    def sensitivities(self) -> Array:
        """Derivatives [n, lags] of the fitted drift by the logarithm of each lag."""
        changes = np.zeros((len(self.columns), self.log_lags.size))
        # inside the bounds
        # a lag at its bound is stepped inwards
        shifts = np.where(self.log_lags + STEP < np.log(BOUNDS_S[1]), STEP, -STEP)
        for k, step in enumerate(np.diag(shifts)):
            shifted_columns = replace(self, log_lags=self.log_lags + step).columns
            changes[:, k] = (shifted_columns - self.columns) @ self.least_squares.coefficients
        return changes / shifts

    @cached_property
    def free(self) -> Mask:
        """[lags], whether a lag is determined: not at its bound, and its derivative independent of
        the columns. Others count as given.
        """
        low, high = np.log(BOUNDS_S)
        inside: Mask = (self.log_lags > low + STEP) & (self.log_lags < high - STEP)
        tangent_columns = np.column_stack([self.columns, self.sensitivities])
        if self.rows.solve(tangent_columns, self.turn_on_variance) is None:
            inside[:] = False
        return inside

    @property
    def endless(self) -> bool:
        """Whether a lag lies at its upper bound, so that it does not describe a real lag."""
        return bool(np.any(self.log_lags > np.log(BOUNDS_S[1]) - STEP))

    @property
    def parameters(self) -> int:
        """Number of terms, lags and turn-on biases."""
        return len(self.terms) + self.log_lags.size + len(self.rows.stacked.logs) - 1

    @property
    def tangent(self) -> Array:
        """Columns [n, k + m] of the model about its lags."""
        return np.column_stack([self.columns, self.sensitivities[:, self.free]])

    def leave_out(self, remaining_rows: Iterable[WhitenedRows]) -> Iterator[Array]:
        """Drift [n, up to a constant] of all blocks by the fit without each ramp in turn.

        ω = X c + S δ with the columns X and the derivatives S by the logarithms of the lags:
        linearised about the fit to all ramps. Where the other ramps determine no lag, the lags
        stay.
        """
        tangent = self.tangent
        for rows in remaining_rows:
            predicted = np.zeros(len(self.columns))
            for columns in (tangent, self.columns):
                solved = rows.solve(columns, self.turn_on_variance)
                if solved is not None:
                    predicted = columns @ solved.coefficients
                    break
            yield predicted


def minimise(solution: TermSolution, settled: float = SETTLED) -> TermSolution:
    """Least sum of squares over the lags within BOUNDS_S, by Gauss-Newton steps with free
    coefficients (Golub & Pereyra 1973, Kaufman 1975), each halved until it lowers the sum, until
    no logarithm of a lag changes by more than `settled`. Raises FitError if the columns are
    linearly dependent at the start.
    """
    last = np.inf
    for _ in range(ITERATIONS):
        tangent_columns = np.column_stack([solution.columns, solution.sensitivities])
        linearised = solution.rows.solve(tangent_columns, solution.turn_on_variance)
        if linearised is None:
            break
        step = linearised.coefficients[solution.columns.shape[1] :]
        # a linear step is not to be trusted beyond a factor of two
        step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        size = float(np.max(np.abs(step)))
        # near the minimum, differences of the sum of squares are below rounding
        near_minimum = size <= CLOSE
        if near_minimum and size >= 0.5 * last:
            break
        for halving in range(1 if near_minimum else HALVINGS):
            log_lags = np.clip(solution.log_lags + step * 0.5**halving, *np.log(BOUNDS_S))
            candidate = replace(solution, log_lags=log_lags)
            if candidate.fit is not None and (near_minimum or candidate.square < solution.square):
                break
        else:
            break
        solution, last = candidate, size
        if size < settled:
            break
    return solution


def _undetermined() -> FitError:
    """Error for logs that cannot determine the terms."""
    return FitError(
        "the logs cannot determine the terms of the lagged model", hint="vary temperature and rate"
    )


def finish(solution: TermSolution) -> ThermalModel:
    """Drift model in raw units at the noise about the solution, misfit included; flags name the
    lags that the logs do not determine, and the terms entangled with them are listed.

    b0 is the mean of the levels of the logs: of its variance, τ²/logs is that of their turn-on
    biases, which is the scatter of the levels beyond their own uncertainty. Raises FitError naming
    the terms that the logs cannot determine.
    """
    stacked = solution.rows.stacked
    rows = solution.rows.at_noise_of(stacked.indication, solution.tangent)
    solution = replace(solution, basis=replace(solution.basis, rows=rows))
    if solution.log_lags.size:
        solution = minimise(solution)
    column_numbers, free = chosen_columns(solution.terms)[1:], np.flatnonzero(solution.free)
    solved, _ = rows.solve_terms(solution.columns, solution.terms[1:])
    tangent = rows.solve(solution.tangent, solution.turn_on_variance) or solved
    logs, levels, lags = solved.logs, solved.levels, np.exp(solution.log_lags)
    # from (levels, scaled coefficients, logarithms of the free lags) to (raw units, seconds);
    # terms and lags that were not fitted have zero rows
    to_terms = np.zeros((9 + lags.size, logs + column_numbers.size + free.size))
    to_terms[0, :logs] = 1.0 / logs
    to_terms[column_numbers, logs + np.arange(column_numbers.size)] = 1.0
    to_terms[9 + free, logs + column_numbers.size + np.arange(free.size)] = lags[free]
    to_raw = np.eye(9 + lags.size)
    to_raw[:9, :9] = solution.basis.scales.to_raw()
    matrix = to_raw @ to_terms
    covariance = matrix @ tangent.covariance @ matrix.T
    turn_on_variance = 0.0
    if logs > 1:
        of_levels = tangent.covariance[:logs, :logs]
        estimation_variance = float(np.mean(np.diag(of_levels)) - np.mean(of_levels))
        turn_on_variance = max(float(np.var(levels, ddof=1)) - estimation_variance, 0.0) / logs
    # b0 is an average over few power-ons: τ²/logs stays however many rows there are
    covariance[0, 0] += turn_on_variance
    scaled = np.concatenate([[levels.mean()], np.zeros(8)])
    scaled[column_numbers] = solved.coefficients
    drift = solution.columns @ solved.coefficients
    residual = (stacked.indication - drift - stacked.level_columns @ levels)[rows.sound]
    dof = residual.size - column_numbers.size - free.size - logs
    # lags that the logs do not determine, and what holds with them jointly only
    flags: list[str] = []
    remarks: list[str] = []
    entangled: list[str] = []
    relative = np.sqrt(np.diag(covariance)[9:]) / lags
    for name, lag, is_free, u in zip(LAGS, lags, solution.free, relative, strict=False):
        if not is_free:
            entangled += LAGS[: lags.size]
            held = f"{name} is taken as {lag:.0f} s: the logs do not determine it"
            (flags if solution.endless else remarks).append(held)
        elif u > DETERMINED:
            remarks.append(
                f"{name} is {lag:.0f} s with a relative standard uncertainty of {u:.1g}: hardly"
                " determined"
            )
        if not is_free or u > DETERMINED:
            entangled += [name, *(term for term in ONE_WITH_LAGS if term in solution.terms)]
    drivers = solution.basis.drivers(solution.log_lags)
    return ThermalModel(
        form=solution.form,
        terms=solution.terms,
        coefficients=solution.basis.scales.to_raw() @ scaled,
        lags=tuple(lags.tolist()),
        covariance=covariance,
        window_s=solution.basis.window_s,
        valid=Drivers(*(values[stacked.fitted] for values in drivers)).valid(),
        turn_on=levels - levels.mean(),
        turn_on_variance=turn_on_variance,
        constant_dof=float(logs - 1) if logs > 1 else float(dof),
        dof=dof,
        residual_rms=rms(residual),
        noise=rows.noise,
        entangled=tuple(dict.fromkeys(entangled)),
        flags=tuple(flags),
        remarks=tuple(remarks),
    )

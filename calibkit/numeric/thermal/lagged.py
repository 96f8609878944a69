"""The `lagged` model: drift as a function of coil temperatures that follow the case through
first-order lags, fitted by variable projection.

    τ_o T_o' = T_s − T_o,        τ_i T_i' = T_o − T_i,        T = T_o,  G = T_o − T_i

As G' = T_o' − G/τ_i is a linear combination of T' and G, s_grad_rate is not a term of this model.
The linear coefficients are eliminated at every step, so that the minimisation is over the lags
alone (Golub & Pereyra 1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric.thermal import coil, pooled_fit, pooled_moments
from calibkit.numeric.thermal.pooled_fit import Solution, Stack
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
CLOSE = 1e-4
"""Decrease of the sum of squares, relative to that of an average row, below which the minimisation
ends.
"""
DETERMINED = 0.3
"""Relative standard uncertainty of a lag above which its distribution, and those of the terms
correlated with it, are not normal.
"""
ONE_WITH_LAGS = ("s_rate", "s_grad", "s_grad2")
SETTLED = 1e-10
"""Change of the logarithm of a lag that ends `_polished`."""


@dataclass(frozen=True, slots=True)
class Survey:
    """Logs of a lagged fit, with moments of all terms on a grid of lags for the start of every
    candidate.
    """

    stacked: Stack
    along: coil.Path
    scales: Scales
    robust: Array
    """[n], robust weights of the rows."""
    grid: Array
    """[g, 2], logarithms of the lags."""
    moments: Array
    """[g, ramps, 9, 9], moments of (1, LAGGED_TERMS without b0, indication)."""

    def solve(self, terms: Sequence[str]) -> Solution:
        """Fit a lagged model with these terms; the coil has one lag unless s_grad is among them,
        then two.

        Raises FitError for terms that do not belong to a lagged model or that the logs cannot
        determine.
        """
        chosen = chosen_columns(terms)[1:]
        names = tuple(TERMS[k] for k in chosen)
        if "s_grad_rate" in names:
            raise FitError(
                "s_grad_rate is not a term of a lagged model:"
                " G' = T' − G/τ_i is a sum of the others",
                hint="drop it",
            )
        problem = Problem(self, chosen, self.robust)
        count = 2 if "s_grad" in names else 1
        reached = [_projected(problem, start[:count]) for start in _starts(self, chosen, count)]
        rough = min(reached, key=lambda lags: lags.square)
        design = problem.design(rough.log_lags)
        weights = pooled_fit.balanced_weights(design, self.robust, self.stacked, names)
        problem = Problem(self, chosen, weights).with_turn_on(design)
        return _solution(problem, _polished(problem, _projected(problem, rough.log_lags)), names)

    @classmethod
    def of_logs(cls, stacked: Stack, robust: Array) -> Self:
        """Survey of logs; the robust weights [n] come from another fit to the same logs."""
        along = coil.path_of_spans([(log.time, log.case, log.starts) for log in stacked.logs])
        middle = float(np.sqrt(STARTS_S[2] * STARTS_S[3]))
        scales = along.drivers(middle, middle).valid().scales()
        every = np.arange(1, len(LAGGED_TERMS))
        grid = np.log(
            np.stack(np.meshgrid(STARTS_S, STARTS_S, indexing="ij"), axis=-1).reshape(-1, 2)
        )
        designs = (along.drivers(*np.exp(lags)).scaled_design(scales)[:, every] for lags in grid)
        found = np.stack([pooled_fit.moments(design, robust, stacked) for design in designs])
        return cls(stacked, along, scales, robust, grid, found)


@dataclass(frozen=True, slots=True)
class _Lags:
    """Logarithms of the lags, the linear coefficients [k] for them, and the weighted sum of
    squares.
    """

    log_lags: Array
    coefficients: Array
    square: float


@dataclass(frozen=True, slots=True)
class Problem:
    """Separable least-squares problem for variable projection: the columns depend on the lags."""

    survey: Survey
    chosen: Integers
    weights: Array

    def with_turn_on(self, design: Array) -> Self:
        """Problem with turn-on biases that are as random as the logs show at a design [n, k]."""
        stacked = pooled_fit.with_turn_on(design, self.weights, self.survey.stacked)
        return replace(self, survey=replace(self.survey, stacked=stacked))

    def drivers(self, log_lags: Array) -> Drivers:
        """Drivers [n] of all logs in sequence, for the logarithms of one lag or two."""
        outer, *inner = np.exp(log_lags).tolist()
        return self.survey.along.drivers(outer, inner[0] if inner else None)

    def design(self, log_lags: Array) -> Array:
        """Scaled columns [n, k] of the chosen terms."""
        return self.drivers(log_lags).scaled_design(self.survey.scales)[:, self.chosen]

    def at(self, log_lags: Array, design: Array) -> _Lags | None:
        """Linear coefficients and sum of squares at given lags; None if the columns are linearly
        dependent.
        """
        found = self.solve(design)
        return None if found is None else _Lags(log_lags, *found)

    def solve(self, design: Array) -> tuple[Array, float] | None:
        """Coefficients [k] and weighted sum of squares for scaled columns; None if they are
        linearly dependent.
        """
        pooled = pooled_fit.pool_moments(
            pooled_fit.moments(design, self.weights, self.survey.stacked), self.survey.stacked
        )
        return pooled_moments.solve(pooled)

    def sensitivities(self, here: _Lags, design: Array) -> Array:
        """Derivatives [n, lags] of the fitted drift by the logarithm of each lag."""
        shifts = _shifts(here.log_lags)
        moved = [self.design(here.log_lags + step) - design for step in np.diag(shifts)]
        return np.column_stack([change @ here.coefficients for change in moved]) / shifts

    def direction(self, here: _Lags, design: Array) -> Array | None:
        """Gauss-Newton step of the logarithms of the lags with free coefficients (Golub & Pereyra
        1973, Kaufman 1975).
        """
        found = self.solve(np.column_stack([design, self.sensitivities(here, design)]))
        return (
            None
            if found is None
            else np.clip(found[0][self.chosen.size :], -LARGEST_STEP, LARGEST_STEP)
        )


def _undetermined() -> FitError:
    """Error for logs that cannot determine the terms."""
    return FitError(
        "the logs cannot determine the terms of the lagged model", hint="vary temperature and rate"
    )


def _shifts(log_lags: Array) -> Array:
    """Steps [lags] of the logarithms for numerical derivatives, inside the bounds."""
    return np.where(log_lags + STEP < np.log(BOUNDS_S[1]), STEP, -STEP)


def _projected(problem: Problem, start: Array) -> _Lags:
    """Minimise the sum of squares over the lags within BOUNDS_S from a start [lags], by variable
    projection.

    The iteration ends when a step lowers the sum of squares by less than CLOSE times that of an
    average row; the remaining distance to the minimum is about √CLOSE standard deviations. Raises
    FitError if the columns are linearly dependent at the start.
    """
    design = problem.design(start)
    here = problem.at(start, design)
    if here is None:
        raise _undetermined()
    enough = CLOSE / float(problem.weights.sum())
    for _ in range(ITERATIONS):
        step = problem.direction(here, design)
        lower = None if step is None else _lower(problem, here, step)
        if lower is None:
            break
        settled = here.square - lower[0].square < enough * here.square
        here, design = lower
        if settled:
            break
    return here


def _lower(problem: Problem, here: _Lags, step: Array) -> tuple[_Lags, Array] | None:
    """First point with a lower sum of squares along a step that is halved repeatedly; None if there
    is none.
    """
    for halving in range(HALVINGS):
        log_lags = np.clip(here.log_lags + step * 0.5**halving, *np.log(BOUNDS_S))
        design = problem.design(log_lags)
        there = problem.at(log_lags, design)
        if there is not None and there.square < here.square:
            return there, design
    return None


def _polished(problem: Problem, here: _Lags) -> _Lags:
    """Refine a minimum by full Gauss-Newton steps, each less than half of the last; differences of
    the sum of squares are below rounding here.
    """
    last = np.inf
    for _ in range(ITERATIONS):
        step = problem.direction(here, problem.design(here.log_lags))
        if step is None:
            break
        moved = np.clip(here.log_lags + step, *np.log(BOUNDS_S))
        size = float(np.max(np.abs(moved - here.log_lags)))
        there = problem.at(moved, problem.design(moved)) if size < 0.5 * last else None
        if there is None or there.square > here.square * (
            1.0 + CLOSE / float(problem.weights.sum())
        ):
            break
        here, last = there, size
        if size < SETTLED:
            break
    return here


def _starts(surveyed: Survey, chosen: Integers, count: int) -> list[Array]:
    """Starting points (logarithms [2] of the lags): the best MOST_STARTS local minima on the grid.

    The logs hardly determine which of two lags is the outer one, and each order may have a minimum.
    """
    columns = np.concatenate([[0], chosen, [len(LAGGED_TERMS)]])
    squares = np.full(len(surveyed.grid), np.inf)
    for k, moment in enumerate(surveyed.moments):
        own = moment[:, columns[:, None], columns]
        found = pooled_moments.solve(pooled_fit.pool_moments(own, surveyed.stacked))
        if found is not None:
            squares[k] = found[1]
    if not np.isfinite(squares).any():
        raise _undetermined()
    grid = squares.reshape(len(STARTS_S), -1)[:, : None if count > 1 else 1]
    around = np.lib.stride_tricks.sliding_window_view(
        np.pad(grid, 1, constant_values=np.inf), (3, 3)
    ).min(axis=(2, 3))
    rows, places = np.nonzero((grid <= around) & np.isfinite(grid))
    best = np.argsort(grid[rows, places], kind="stable")[:MOST_STARTS]
    return [surveyed.grid[rows[k] * len(STARTS_S) + places[k]] for k in best]


def _solution(problem: Problem, found: _Lags, names: tuple[str, ...]) -> Solution:
    """Solution at the minimum; a lag at its bound, or without effect on drift, counts as given."""
    design = problem.design(found.log_lags)
    changes = problem.sensitivities(found, design)
    low, high = np.log(BOUNDS_S)
    # free only if the derivatives by the lags are independent of the columns
    free = (
        (found.log_lags > low + STEP)
        & (found.log_lags < high - STEP)
        & (problem.solve(np.column_stack([design, changes])) is not None)
    )
    return Solution(
        form="lagged",
        terms=("b0", *names),
        scales=problem.survey.scales,
        drivers=problem.drivers(found.log_lags),
        columns=design,
        sensitivities=changes[:, free],
        coefficients=found.coefficients,
        log_lags=found.log_lags,
        free=free,
        robust=problem.survey.robust,
        weights=problem.weights,
        window_s=0.0,
        alike=problem.survey.stacked.alike,
    )


def is_endless(solution: Solution) -> bool:
    """Whether a fitted lag lies at its upper bound, so that it does not describe a real lag."""
    return bool(np.any(solution.log_lags > np.log(BOUNDS_S[1]) - STEP))


def finish(solution: Solution, stacked: Stack) -> ThermalModel:
    """Drift model of a level or lagged solution; flags name the lags that the logs do not
    determine, and the terms entangled with them are listed.
    """
    model = solution.finish(stacked)
    relative = model.standard_uncertainty[9:] / np.array(model.lags)
    flags: list[str] = []
    entangled: list[str] = []
    for name, lag, free, u in zip(LAGS, model.lags, solution.free, relative, strict=False):
        if not free:
            entangled += LAGS[: len(model.lags)]
            flags.append(f"{name} is taken as {lag:.0f} s: the logs do not determine it")
        elif u > DETERMINED:
            flags.append(
                f"{name} is {lag:.0f} s with a relative standard uncertainty of {u:.1g}: hardly"
                " determined"
            )
        if not free or u > DETERMINED:
            entangled += [name, *(term for term in ONE_WITH_LAGS if term in model.terms)]
    return replace(model, flags=tuple(flags), entangled=tuple(dict.fromkeys(entangled)))

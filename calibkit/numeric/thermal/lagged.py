"""The `lagged` model: drift as a function of coil temperatures that follow the case through
first-order lags, fitted by variable projection.

    τ_o T_o' = T_s − T_o,        τ_i T_i' = T_o − T_i,        T = T_o,  G = T_o − T_i

As G' = T_o' − G/τ_i is a linear combination of T' and G, s_grad_rate is not a term of this model.
The linear coefficients are eliminated at every step, so that the minimisation is over the lags
alone (Golub & Pereyra 1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeAlias

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.errors import FitError
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.pooled_fit import LeastSquares, Rows, Solution
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
Grid: TypeAlias = list[tuple[Array, Array]]
"""Logarithms of lags [2] and whitened rows [m, 9] of all terms at each."""
CLOSE, SETTLED = 1e-4, 1e-10
"""Changes of the logarithm of a lag from which on steps are full, and that end the search."""


@dataclass(frozen=True, slots=True)
class _At:
    """Fit at given lags."""

    log_lags: Array
    design: Array
    """[n, k]."""
    fit: LeastSquares

    @property
    def square(self) -> float:
        """Sum of squares."""
        return self.fit.square


@dataclass(frozen=True, slots=True)
class LagSearch:
    """Separable least-squares problem: columns of logs that depend on the lags, at a noise of their
    rows.
    """

    along: coil.Path
    scales: Scales
    rows: Rows
    chosen: Integers
    """Columns of the terms beside b0."""
    turn_on_variance: float = np.inf

    @classmethod
    def of_rows(cls, rows: Rows) -> Self:
        """Search over rows, whose spikes and noise come from another fit to the same logs, for all
        terms.
        """
        logs = rows.stacked.logs
        along = coil.path_of_spans([(log.time, log.case, log.starts) for log in logs])
        middle = float(np.sqrt(STARTS_S[2] * STARTS_S[3]))
        scales = along.drivers(middle, middle).valid().scales()
        return cls(along, scales, rows, chosen_columns(LAGGED_TERMS)[1:])

    def drivers(self, log_lags: Array) -> Drivers:
        """Drivers [n] of all logs in sequence, for the logarithms of one lag or two."""
        outer, *inner = np.exp(log_lags).tolist()
        return self.along.drivers(outer, inner[0] if inner else None)

    def design(self, log_lags: Array) -> Array:
        """Scaled columns [n, 9] of all terms."""
        return self.drivers(log_lags).scaled_design(self.scales)

    def on_grid(self) -> Grid:
        """Logarithms of lags [2] on a grid, and whitened rows [m, 9] of all terms at each, for the
        start of every candidate.
        """
        pairs = np.stack(np.meshgrid(STARTS_S, STARTS_S, indexing="ij"), -1).reshape(-1, 2)
        return [(lags, self.rows.of(self.design(lags))) for lags in np.log(pairs)]

    def solve(self, terms: Sequence[str], grid: Grid) -> Solution:
        """Fit a lagged model with these terms; the coil has one lag unless s_grad is among them,
        then two.

        Raises FitError for terms that do not belong to a lagged model or that the logs cannot
        determine.
        """
        if "s_grad_rate" in terms:
            raise FitError(
                "s_grad_rate is not a term of a lagged model:"
                " G' = T' − G/τ_i is a sum of the others",
                hint="drop it",
            )
        search = replace(self, chosen=chosen_columns(terms)[1:])
        starts = search.starts(grid, 2 if "s_grad" in terms else 1)
        rough = min((search.minimise(start) for start in starts), key=lambda at: at.square)
        search = replace(search, turn_on_variance=rough.fit.turn_on_variance())
        return search.solution(search.minimise(rough.log_lags))

    def refine(self, solution: Solution) -> Solution:
        """A solution at the noise of these rows."""
        chosen, variance = chosen_columns(solution.terms)[1:], solution.turn_on_variance
        search = replace(self, chosen=chosen, turn_on_variance=variance)
        return search.solution(search.minimise(solution.log_lags))

    def starts(self, grid: Grid, count: int) -> list[Array]:
        """Logarithms of `count` lags to begin with: the best MOST_STARTS local minima on the grid.

        The logs hardly determine which of two lags is the outer one, and each order may have a
        minimum.
        """
        squares = np.full(len(grid), np.inf)
        for k, (_, rows) in enumerate(grid):
            fit = self.rows.solve_rows(rows[:, self.chosen])
            if fit is not None:
                squares[k] = fit.square
        if not np.isfinite(squares).any():
            raise _undetermined()
        over_lags = squares.reshape(len(STARTS_S), -1)[:, : None if count > 1 else 1]
        around = np.lib.stride_tricks.sliding_window_view(
            np.pad(over_lags, 1, constant_values=np.inf), (3, 3)
        ).min(axis=(2, 3))
        outer, inner = np.nonzero((over_lags <= around) & np.isfinite(over_lags))
        best = np.argsort(over_lags[outer, inner], kind="stable")[:MOST_STARTS]
        return [grid[outer[k] * len(STARTS_S) + inner[k]][0][:count] for k in best]

    def at(self, log_lags: Array) -> _At | None:
        """Fit at given lags; None if the columns are linearly dependent."""
        design = self.design(log_lags)[:, self.chosen]
        fit = self.rows.solve(design, self.turn_on_variance)
        return None if fit is None else _At(log_lags, design, fit)

    def sensitivities(self, here: _At) -> Array:
        """Derivatives [n, lags] of the fitted drift by the logarithm of each lag."""
        # inside the bounds
        shifts = np.where(here.log_lags + STEP < np.log(BOUNDS_S[1]), STEP, -STEP)
        changes = []
        for step in np.diag(shifts):
            moved = self.design(here.log_lags + step)[:, self.chosen]
            changes.append((moved - here.design) @ here.fit.coefficients)
        return np.column_stack(changes) / shifts

    def minimise(self, start: Array) -> _At:
        """Least sum of squares over the lags within BOUNDS_S, by Gauss-Newton steps with free
        coefficients (Golub & Pereyra 1973, Kaufman 1975), each halved until it lowers the sum.
        Raises FitError if the columns are linearly dependent at the start.
        """
        here = self.at(start)
        if here is None:
            raise _undetermined()
        last = np.inf
        for _ in range(ITERATIONS):
            tangent = np.column_stack([here.design, self.sensitivities(here)])
            linearised = self.rows.solve(tangent, self.turn_on_variance)
            if linearised is None:
                break
            step = linearised.coefficients[self.chosen.size :]
            step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
            size = float(np.max(np.abs(step)))
            # near the minimum, differences of the sum of squares are below rounding
            near = size <= CLOSE
            if near and size >= 0.5 * last:
                break
            for halving in range(1 if near else HALVINGS):
                log_lags = np.clip(here.log_lags + step * 0.5**halving, *np.log(BOUNDS_S))
                there = self.at(log_lags)
                if there is not None and (near or there.square < here.square):
                    break
            else:
                break
            here, last = there, size
            if size < SETTLED:
                break
        return here

    def solution(self, here: _At) -> Solution:
        """Solution at the minimum; a lag at its bound, or without effect on drift, counts as
        given.
        """
        changes = self.sensitivities(here)
        tangent = np.column_stack([here.design, changes])
        low, high = np.log(BOUNDS_S)
        # free only if the derivatives by the lags are independent of the columns
        free = (
            (here.log_lags > low + STEP)
            & (here.log_lags < high - STEP)
            & (self.rows.solve(tangent, self.turn_on_variance) is not None)
        )
        return Solution(
            form="lagged",
            terms=("b0", *(TERMS[k] for k in self.chosen)),
            scales=self.scales,
            drivers=self.drivers(here.log_lags),
            columns=here.design,
            sensitivities=changes[:, free],
            log_lags=here.log_lags,
            free=free,
            rows=self.rows,
            window_s=0.0,
            turn_on_variance=self.turn_on_variance,
            endless=bool(np.any(here.log_lags > high - STEP)),
        )


def _undetermined() -> FitError:
    """Error for logs that cannot determine the terms."""
    return FitError(
        "the logs cannot determine the terms of the lagged model", hint="vary temperature and rate"
    )


def finish(solution: Solution) -> ThermalModel:
    """Drift model of a level or lagged solution at the noise about it, misfit included; flags name
    the lags that the logs do not determine, and the terms entangled with them are listed.
    """
    rows = solution.rows.at_noise_of(solution.rows.stacked.indication, solution.tangent)
    solution = replace(solution, rows=rows)
    if solution.log_lags.size:
        solution = LagSearch.of_rows(rows).refine(solution)
    model = solution.finish()
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

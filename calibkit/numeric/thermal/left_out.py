"""Predictions of ramps that were left out of a fit, and errors as means of the drift figure."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.thermal import lagged, pooled_fit, pooled_moments
from calibkit.numeric.thermal.lagged import Survey
from calibkit.numeric.thermal.pooled_fit import Solution, Stack
from calibkit.numeric.thermal.terms import chosen_columns

FIGURE_BLOCKS = 10
"""Blocks that one mean of the drift figure averages: 100 s (the longer interval of GJB 2426A) at a
model interval of 10 s.
"""
LEAST_WEIGHT = 0.5
"""Smallest mean robust weight of a group of rows, relative to the median of all rows, with which
the group counts.
"""


def left_out_errors(
    predicted: Iterable[Array], stacked: Stack, robust: Array, figure_blocks: int
) -> tuple[Array, ...]:
    """Indication less a prediction of each ramp [m, °/h], as figure means about their mean."""
    found = []
    for rows, values in zip(stacked.ramps, predicted, strict=True):
        left = stacked.indication[rows] - values
        error = figure_means(left, robust[rows], figure_blocks)
        found.append(error - error.mean())
    return tuple(found)


def figure_means(values: Array, robust: Array, group: int) -> Array:
    """Robustly weighted means [m] of values [n] over groups of rows; groups of little weight and an
    incomplete last group are left out.
    """
    whole = max(values.size // group, 1) * min(group, values.size)
    weight = robust[:whole].reshape(-1, min(group, values.size))
    usable = weight.mean(axis=1) >= LEAST_WEIGHT * max(
        float(np.median(robust)), np.finfo(float).tiny
    )
    grouped = values[:whole].reshape(weight.shape)[usable]
    return np.asarray(np.average(grouped, axis=1, weights=weight[usable]), dtype=np.float64)


def predict_left_out(solution: Solution, survey: Survey | None, stacked: Stack) -> Iterator[Array]:
    """Drift [n, up to a constant] of all rows by the fit without each ramp in turn; a level
    solution has no survey, the lags of others start from the fit to all ramps.
    """
    stacked = replace(stacked, alike=solution.alike)
    if survey is None:
        moment = pooled_fit.moments(solution.columns, solution.weights, stacked)
        for number in range(len(stacked.ramps)):
            found = pooled_moments.solve(pooled_fit.pool_moments(moment, stacked, number))
            yield solution.columns @ (found[0] if found else np.zeros(solution.columns.shape[1]))
        return
    survey = replace(survey, stacked=stacked)
    problem = lagged.Problem(survey, chosen_columns(solution.terms)[1:], solution.weights)
    moments = problem.tangent_moments(solution.log_lags)
    for number in range(len(stacked.ramps)):
        yield problem.leave_out(solution.log_lags, moments, number)

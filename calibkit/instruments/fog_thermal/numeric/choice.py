"""The choice between no drift term, level models and lagged models, by what each does to a ramp
that it has not seen.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.fog_thermal.numeric import lagged, level, pooled_fit, uncertainty
from calibkit.instruments.fog_thermal.numeric.compensation import WORSE, LeftOutRamps
from calibkit.instruments.fog_thermal.numeric.lagged import Survey
from calibkit.instruments.fog_thermal.numeric.pooled_fit import Solution, Stack, ThermalLog
from calibkit.instruments.fog_thermal.numeric.terms import TERMS, ThermalModel, chosen_columns

CLEARLY = 0.95
"""Share of the raw drift figure that a model must get below on left-out ramps."""
ALIKE = 1.0025
"""Ratio of pooled errors up to which two candidates count as alike: the noise of 100 s means hides
more.
"""
FIGURE_BLOCKS = 10
"""Blocks that the drift figure averages: 100 s, the longer of the two intervals of GJB 2426A, at a
model interval of 10 s.
"""
LEAST_RAMPS = 3
"""Ramps that leaving one out needs: one more than the sides of a thermal cycle."""
LEAST_WEIGHT = 0.5
"""Mean robust weight of a group of rows, over the median of all rows, from which it counts."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A model that may be chosen."""

    name: str
    form: Literal["level", "lagged"]
    terms: tuple[str, ...]


STATIC = ("b0", "b1", "b2", "b3")
CANDIDATES = (
    _Candidate("level T", "level", STATIC[:2]),
    _Candidate("level T²", "level", STATIC[:3]),
    _Candidate("level T³", "level", STATIC),
    _Candidate("level T³, rate", "level", (*STATIC, "s_rate")),
    _Candidate("level T³, rate, gradient", "level", (*STATIC, "s_rate", "s_grad", "s_temp_rate")),
    _Candidate("level, all terms", "level", TERMS),
    _Candidate("lagged T³, one lag", "lagged", (*STATIC, "s_rate", "s_temp_rate")),
    _Candidate("lagged T³, rate, gradient", "lagged", (*STATIC, "s_rate", "s_grad", "s_temp_rate")),
    _Candidate("lagged, all terms", "lagged", lagged.LAGGED_TERMS),
)


@dataclass(frozen=True, slots=True)
class _Fitted:
    """A candidate with its solution on all ramps, and the survey that a lagged one is fitted again
    with.
    """

    candidate: _Candidate
    solution: Solution
    survey: Survey | None


@dataclass(frozen=True, slots=True)
class _LeftOut(LeftOutRamps):
    """What a candidate did to each ramp that was left out of its fit: drift rms of 100 s means, the
    ramp's mean removed.
    """

    candidate: _Candidate
    ramps: tuple[str, ...]
    errors: tuple[Array, ...]
    """Each ramp's compensated 100 s means [°/h], the mean removed."""
    parameters: int
    """Number of coefficients and lags."""
    endless: bool
    """Whether a lag came out as the longest that is looked for: then it stands for something that
    is not a lag.
    """

    @property
    def helps(self) -> bool:
        """Whether the left-out ramps came out clearly below raw together, and none of them
        above.
        """
        return self.pooled <= CLEARLY * self.pooled_raw and bool(
            np.all(self.compensated <= WORSE * self.raw)
        )


@dataclass(frozen=True, slots=True)
class ThermalChoice:
    """Every candidate's left-out errors, and the model that is exported (or none), with the
    reason.
    """

    tested: tuple[_LeftOut, ...]
    refused: tuple[str, ...]
    chosen: _LeftOut | None
    model: ThermalModel | None
    reason: str


def choose(
    logs: Sequence[ThermalLog],
    candidates: Sequence[_Candidate] = CANDIDATES,
    *,
    figure_blocks: int = FIGURE_BLOCKS,
) -> ThermalChoice:
    """Fit each candidate without each ramp in turn, and export the one with the smallest error on
    what it had not seen.

    Never worse than raw: a candidate whose pooled error is not below CLEARLY times the raw drift,
    or that makes any left-out ramp worse, is out; where all are, no drift term is exported.
    Left-out ramps are evaluated without clamping: the exported model has seen their ranges, and the
    question is whether its form holds.

    Parameters
    ----------
    logs : block means of each log.
    candidates : models to choose from.
    figure_blocks : blocks that the drift figures average.

    Raises
    ------
    FitError : no log, or a ramp too short.

    """
    stacked = pooled_fit.Stack.of_logs(logs)
    if len(stacked.ramps) < LEAST_RAMPS:
        reason = (
            f"{len(stacked.ramps)} ramps, expected at least {LEAST_RAMPS} to leave one out: no"
            " drift term"
        )
        return ThermalChoice((), (), None, None, reason)
    solutions, refused = _solutions_of(stacked, candidates)
    tested = tuple(_left_out(fitted, stacked, figure_blocks) for fitted in solutions)
    best = _best_of(tested)
    if best is None:
        return ThermalChoice(tested, refused, None, None, _nothing_helps(tested, refused))
    solution = solutions[best].solution
    if solution.form == "lagged":
        model = lagged.finish(solution, stacked)
    else:
        model = solution.finish(stacked)
    model = replace(
        model,
        model_error=uncertainty.model_error(
            tested[best].errors, uncertainty.explained(model, stacked.logs, figure_blocks)
        ),
        model_error_dof=float(len(stacked.ramps) - 1),
    )
    return ThermalChoice(tested, refused, tested[best], model, _why(tested[best]))


def _best_of(tested: Sequence[_LeftOut]) -> int | None:
    """Number of the candidate to export: of those that help and are alike the least, the one with
    the fewest parameters.

    One with a lag on its upper bound is only taken where no other helps.
    """
    helping = [k for k, result in enumerate(tested) if result.helps]
    helping = [k for k in helping if not tested[k].endless] or helping
    if not helping:
        return None
    least = min(tested[k].pooled for k in helping)
    alike = [k for k in helping if tested[k].pooled <= ALIKE * least]
    return min(alike, key=lambda k: (tested[k].parameters, tested[k].pooled))


def _why(best: _LeftOut) -> str:
    return (
        f"{best.candidate.name}: {best.pooled:.3g} deg/h on left-out ramps against"
        f" {best.pooled_raw:.3g} deg/h raw, the least, or the simplest of those alike, of the"
        " candidates that make no ramp worse"
    )


def _nothing_helps(tested: Sequence[_LeftOut], refused: Sequence[str]) -> str:
    if not tested:
        return f"no candidate could be fitted: {'; '.join(refused)}: no drift term"
    least = min(tested, key=lambda result: result.pooled)
    worse = [
        name
        for name, a, b in zip(least.ramps, least.compensated, least.raw, strict=True)
        if a > WORSE * b
    ]
    made = f" and makes {', '.join(worse)} worse" if worse else ""
    return (
        f"the best candidate ({least.candidate.name}) leaves {least.pooled:.3g} deg/h on left-out"
        f" ramps against {least.pooled_raw:.3g} deg/h raw{made}: no drift term"
    )


def _solutions_of(
    stacked: Stack, candidates: Sequence[_Candidate]
) -> tuple[list[_Fitted], tuple[str, ...]]:
    """Solutions of the candidates that the logs can determine, and why the others are not there.

    The robust weights of the rows are the same for every candidate, so that their errors compare.
    """
    prepared = level.basis(stacked)
    surveyed = (
        lagged.Survey.of_logs(stacked, prepared.robust)
        if any(c.form == "lagged" for c in candidates)
        else None
    )
    solved: list[_Fitted] = []
    refused = []
    for candidate in candidates:
        try:
            if surveyed is not None and candidate.form == "lagged":
                solution = surveyed.solve(candidate.terms)
            else:
                solution = prepared.solve(candidate.terms)
        except FitError as error:
            refused.append(f"{candidate.name}: {error.message}")
            continue
        solved.append(
            _Fitted(candidate, solution, surveyed if candidate.form == "lagged" else None)
        )
    return solved, tuple(refused)


def _left_out(fitted: _Fitted, stacked: Stack, figure_blocks: int) -> _LeftOut:
    """Errors of a candidate on each ramp when it is fitted to the others; lags start from the fit
    to all of them.
    """
    raw, compensated, errors = [], [], []
    robust = fitted.solution.robust
    for rows, predicted in zip(stacked.ramps, _predicted(fitted, stacked), strict=True):
        indication = stacked.indication[rows]
        raw.append(float(np.std(_figure_means(indication, robust[rows], figure_blocks))))
        error = _figure_means(indication - predicted, robust[rows], figure_blocks)
        errors.append(error - error.mean())
        compensated.append(float(np.std(error)))
    lags = fitted.solution.log_lags
    return _LeftOut(
        candidate=fitted.candidate,
        ramps=stacked.ramp_names,
        raw=np.array(raw),
        compensated=np.array(compensated),
        errors=tuple(errors),
        parameters=len(fitted.candidate.terms) + lags.size,
        endless=bool(np.any(lags > np.log(lagged.BOUNDS_S[1]) - lagged.STEP)),
    )


def _predicted(fitted: _Fitted, stacked: Stack) -> Iterator[Array]:
    """Drift [rows, °/h] of each ramp, up to a constant, by the model of all the others."""
    solution = fitted.solution
    if fitted.survey is None:
        moment = pooled_fit.moments(solution.columns, solution.weights, stacked)
        for number, rows in enumerate(stacked.ramps):
            found = pooled_fit.solve_moments(pooled_fit.pool_moments(moment, stacked, number))
            yield solution.columns[rows] @ (
                found[0] if found else np.zeros(solution.columns.shape[1])
            )
        return
    chosen = chosen_columns(solution.terms)[1:]
    problem = lagged.Problem(fitted.survey, chosen, solution.weights)
    moments = problem.tangent_moments(solution.log_lags)
    for number, rows in enumerate(stacked.ramps):
        yield problem.leave_out(solution.log_lags, moments, number)[rows]


def _figure_means(values: Array, robust: Array, group: int) -> Array:
    """Means [m] of values [n] over groups of rows, by robust weights, without the groups of little
    weight; a rest that fills no group is left out.
    """
    whole = max(values.size // group, 1) * min(group, values.size)
    weight = robust[:whole].reshape(-1, min(group, values.size))
    usable = weight.mean(axis=1) >= LEAST_WEIGHT * max(
        float(np.median(robust)), np.finfo(float).tiny
    )
    grouped = values[:whole].reshape(weight.shape)[usable]
    return np.asarray(np.average(grouped, axis=1, weights=weight[usable]), dtype=np.float64)

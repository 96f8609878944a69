"""Choice between no drift term, level models and lagged models by their errors on ramps that were
left out of the fit.
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
"""Largest ratio of the error on left-out ramps to the raw drift with which a model may be exported.
"""
ALIKE = 1.0025
"""Ratio of pooled errors up to which two candidates count as equal; the noise of 100 s means is
larger than that.
"""
FIGURE_BLOCKS = 10
"""Blocks that one mean of the drift figure averages: 100 s (the longer interval of GJB 2426A) at a
model interval of 10 s.
"""
LEAST_RAMPS = 3
"""Fewest ramps for leaving one out: one more than the two sides of a thermal cycle."""
LEAST_WEIGHT = 0.5
"""Smallest mean robust weight of a group of rows, relative to the median of all rows, with which
the group counts.
"""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """Candidate model: its name, form and terms."""

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
    """Candidate with its solution on all ramps, and the survey of the logs (of a lagged candidate)
    for further fits.
    """

    candidate: _Candidate
    solution: Solution
    survey: Survey | None


@dataclass(frozen=True, slots=True)
class _LeftOut(LeftOutRamps):
    """Errors of a candidate on each ramp when this ramp was left out of the fit: drift rms of 100 s
    means, the ramp's mean removed.
    """

    candidate: _Candidate
    ramps: tuple[str, ...]
    errors: tuple[Array, ...]
    """Compensated 100 s means of each ramp [°/h], the ramp's mean removed."""
    parameters: int
    """Number of coefficients and lags."""
    endless: bool
    """Whether a lag lies at its upper bound, so that it does not describe a real lag."""

    @property
    def helps(self) -> bool:
        """Whether the pooled error on left-out ramps is clearly below raw and no left-out ramp
        became worse.
        """
        return self.pooled <= CLEARLY * self.pooled_raw and bool(
            np.all(self.compensated <= WORSE * self.raw)
        )


@dataclass(frozen=True, slots=True)
class ThermalChoice:
    """Errors of all candidates on left-out ramps, the exported model or None, and the reason for
    the choice.
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
    """Fit each candidate without each ramp in turn and choose the one with the smallest pooled
    error on left-out ramps.

    A candidate is rejected if its pooled error is not below CLEARLY times the raw drift or if it
    makes any left-out ramp worse; if all are rejected, no drift term is exported. Left-out ramps
    are evaluated without clamping: the test is of the model's form, and the exported model is
    fitted to all their ranges.

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
    """Index of the candidate to export, None if none helps: the one with the fewest parameters
    among those whose pooled error equals the smallest within ALIKE.

    A candidate with a lag at its upper bound is taken only if no other helps.
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
    """Solutions of the candidates that the logs can determine, and the reasons why the others
    failed.

    All candidates have the same robust weights, so that their errors are comparable.
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
    """Errors of a candidate on each ramp, fitted to all other ramps; lags start from the fit to all
    ramps.
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
    """Drift [rows, °/h] of each ramp, up to a constant, predicted by the model fitted to all other
    ramps.
    """
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

"""Choice of the terms of one channel's bias by its errors on stretches that were left out of the
fit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.thermal import lagged, level, uncertainty
from calibkit.numeric.thermal.evaluate import evaluate_terms
from calibkit.numeric.thermal.lagged import Survey
from calibkit.numeric.thermal.left_out import figure_means, predict_left_out
from calibkit.numeric.thermal.noise import Flicker
from calibkit.numeric.thermal.pooled_fit import Solution, Stack, ThermalLog
from calibkit.numeric.thermal.terms import ThermalModel

CLEARLY = 0.95
"""Largest ratio of the error on left-out stretches to that without any term with which a model may
be exported.
"""
MOVING_DEGC_MIN = 0.3
"""Temperature rate [°C/min] from which on it changes."""
STATIC = ("b0", "b1", "b2", "b3")
RATES = ("s_rate", "s_temp_rate")
Form = Literal["level", "lagged"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """Candidate model: its name, form and terms."""

    name: str
    form: Form
    terms: tuple[str, ...]


CONSTANT = Candidate("constant", "level", STATIC[:1])
CANDIDATES = (
    Candidate("T", "level", STATIC[:2]),
    Candidate("T²", "level", STATIC[:3]),
    Candidate("T³", "level", STATIC),
    Candidate("T, dT/dt", "level", (*STATIC[:2], "s_rate")),
    Candidate("T³, dT/dt", "level", (*STATIC, "s_rate")),
    Candidate("T³, dT/dt, T·dT/dt", "level", (*STATIC, *RATES)),
    Candidate("lag, T", "lagged", (*STATIC[:2], "s_rate")),
    Candidate("lag, T²", "lagged", (*STATIC[:3], "s_rate")),
    Candidate("lag, T³", "lagged", (*STATIC, "s_rate")),
    Candidate("lag, T³, T·dT/dt", "lagged", (*STATIC, *RATES)),
    Candidate("two lags, T³", "lagged", (*STATIC, "s_grad")),
    Candidate("two lags, T³, dT/dt", "lagged", (*STATIC, "s_rate", "s_grad")),
    Candidate("two lags, T³, dT/dt, T·dT/dt", "lagged", (*STATIC, *RATES, "s_grad")),
)


@dataclass(frozen=True, slots=True)
class Tested:
    """Candidate with its errors on left-out stretches."""

    candidate: Candidate
    errors: tuple[Array, ...]
    """Figure means of each stretch, left out of the fit; the turn-on bias is that of the rest of
    the power-on, or the stretch's own where it has no other.
    """
    of_pairs: tuple[Array, ...]
    """The same of pairs of stretches, left out together: what a model misses is seen better by
    leaving out more, what tells models apart by leaving out less.
    """
    parameters: int
    endless: bool = False
    """Whether a lag lies at its upper bound, so that it does not describe a real lag."""

    @property
    def squares(self) -> Array:
        """Mean squares [stretches and pairs] of the errors."""
        return np.array([np.mean(error**2) for error in (*self.errors, *self.of_pairs)])

    @property
    def pooled(self) -> float:
        """Root of the mean over the stretches of the mean squares."""
        return float(np.sqrt(np.mean(self.squares)))

    def as_good_as(self, best: "Tested") -> bool:
        """Whether the error is within one standard error of that of the best, of the mean squares
        and of their logarithms: differences stretch by stretch, in which the noise of a stretch
        cancels, and of which one bad stretch does not decide alone.
        """
        least = np.finfo(np.float64).tiny
        pairs = (
            self.squares - best.squares,
            np.log(np.maximum(self.squares, least) / np.maximum(best.squares, least)),
        )
        return all(more.mean() <= np.std(more, ddof=1) / np.sqrt(more.size) for more in pairs)


@dataclass(frozen=True, slots=True)
class Choice:
    """Errors of all candidates, why others could not be fitted, the chosen model and its test."""

    tested: tuple[Tested, ...]
    refused: tuple[str, ...]
    chosen: Tested
    model: ThermalModel

    @property
    def constant(self) -> Tested:
        """Test of the bias without any term of temperature."""
        return self.tested[0]


def choose(
    stacked: Stack, candidates: Sequence[Candidate] = CANDIDATES, *, figure_blocks: int
) -> Choice:
    """Fit each candidate without each stretch in turn and choose the simplest within one standard
    error of the smallest error on left-out stretches; the constant where none is clearly below it.

    Raises FitError where no candidate can be fitted.
    """
    basis = level.basis(stacked)
    survey = Survey.of_logs(stacked, basis.robust)
    pairs = Stack.of_logs([replace(log, part=log.part // 2) for log in stacked.logs])
    constant = basis.solve(CONSTANT.terms)
    solved: list[tuple[Solution, Survey | None]] = [(constant, None)]
    tested = [_test(CONSTANT, constant, None, (stacked, pairs), figure_blocks)]
    refused: list[str] = []
    for candidate in candidates:
        own = survey if candidate.form == "lagged" else None
        try:
            solution = (own or basis).solve(candidate.terms)
        except FitError as error:
            refused.append(f"{candidate.name}: {error.message}")
            continue
        solved.append((solution, own))
        tested.append(_test(candidate, solution, own, (stacked, pairs), figure_blocks))
    if len(tested) == 1:
        raise FitError(
            f"no model can be fitted: {'; '.join(refused)}",
            hint="log the instrument while its temperature changes",
        )
    chosen = _best_of(tested)
    solution, own = solved[chosen]
    model = lagged.finish(solution, stacked) if own else solution.finish(stacked)
    model = _with_model_error(model, tested[chosen], pairs, figure_blocks)
    return Choice(tuple(tested), tuple(refused), tested[chosen], model)


def _best_of(tested: Sequence[Tested]) -> int:
    """Index of the chosen candidate; 0, the constant, unless another is clearly better."""
    helping = [k for k, one in enumerate(tested) if k and one.pooled <= CLEARLY * tested[0].pooled]
    if not helping:
        return 0
    best = min((tested[k] for k in helping), key=lambda one: one.pooled)
    if tested[0].as_good_as(best):
        return 0
    alike = [k for k in helping if tested[k].as_good_as(best)]
    return min(alike, key=lambda k: (tested[k].endless, tested[k].parameters, tested[k].pooled))


def _test(
    candidate: Candidate,
    solution: Solution,
    survey: Survey | None,
    stacks: tuple[Stack, Stack],
    figure_blocks: int,
) -> Tested:
    """Errors of a candidate on each stretch and each pair of them, fitted to all others."""
    bound = np.log(lagged.BOUNDS_S[1]) - lagged.STEP
    errors, of_pairs = (
        tuple(
            _errors(number, stacked.indication - drift, stacked, solution.weights, figure_blocks)
            for number, drift in enumerate(
                predict_left_out(
                    solution, None if survey is None else replace(survey, stacked=stacked), stacked
                )
            )
        )
        for stacked in stacks
    )
    return Tested(
        candidate,
        errors,
        of_pairs,
        len(candidate.terms) + solution.log_lags.size,
        bool(np.any(solution.log_lags > bound)),
    )


def _errors(number: int, left: Array, stacked: Stack, weights: Array, figure_blocks: int) -> Array:
    """Figure means of indication less prediction [n] over one stretch, less the level of the other
    stretches of its power-on.
    """
    own = stacked.ramps[number]
    log = stacked.log_rows[stacked.ramp_log[number]]
    others = weights[log].copy()
    others[own.start - log.start : own.stop - log.start] = 0.0
    means = figure_means(left[own], weights[own], figure_blocks)
    level = np.average(left[log], weights=others) if others.any() else means.mean()
    return np.asarray(means - level, dtype=np.float64)


def _with_model_error(
    model: ThermalModel, tested: Tested, stacked: Stack, figure_blocks: int
) -> ThermalModel:
    """Model with what lasts in its errors on left-out stretches beyond noise and coefficients: at
    rest or while the temperature changes, whichever is larger.
    """
    still = model.nearest_fitted(0.0)
    found: list[tuple[Array, list[Array], Mask]] = []
    errors = iter(tested.of_pairs)
    for log in stacked.logs:
        along = evaluate_terms(model, log.time, log.case, log.env, still, log.starts).sensitivities
        found += _stretch_errors(model, log, along, errors, figure_blocks)
    sizes = [0.0]
    for moving in (True, False):
        parts = [(e[run], c, run) for e, c, m in found for run in _runs(m == moving)]
        if parts:
            known = np.concatenate(
                [
                    at_lag[run.start : max(run.stop - k, run.start)]
                    for _, c, run in parts
                    for k, at_lag in zip(uncertainty.NEIGHBOURING, c, strict=True)
                ]
            )
            errors_of = [e for e, *_ in parts]
            sizes.append(uncertainty.model_error(errors_of, known.sum() / max(known.size, 1)))
    return replace(
        model, model_error=max(sizes), model_error_dof=float(max(len(stacked.ramps) - 1, 1))
    )


def _runs(mask: Mask) -> list[slice]:
    """Runs of a mask [n]."""
    runs = chunks.find_runs(mask.size, lambda a, b: mask[a:b])
    return [slice(first, stop) for first, stop in runs.tolist()]


def _stretch_errors(
    model: ThermalModel,
    log: ThermalLog,
    sensitivities: Array,
    errors: Iterator[Array],
    figure_blocks: int,
) -> Iterator[tuple[Array, list[Array], Mask]]:
    """Errors [m] on each stretch of a log, the covariances [m − k] of neighbouring ones that type A
    uncertainty and flicker noise cause about the level of the rest, and whether the temperature
    changes [m].
    """
    parts = np.unique(log.part)
    rows = [np.flatnonzero(log.part == part) for part in parts]
    counts = [max(own.size // figure_blocks, 1) for own in rows]
    groups = [
        np.array_split(own[: count * figure_blocks], count)
        for own, count in zip(rows, counts, strict=True)
    ]
    whole = [group for own in groups for group in own]
    s = np.stack([sensitivities[group].mean(axis=0) for group in whole])
    flicker, variance = Flicker(len(whole), uncertainty.NEIGHBOURING), model.noise.flicker**2
    rate = np.array([60.0 * np.ptp(log.case[g]) / max(np.ptp(log.time[g]), 1.0) for g in whole])
    part = np.repeat(parts, counts)
    for number in parts:
        inside, error = part == number, next(errors)
        if error.size != np.count_nonzero(inside):
            continue
        first = int(np.argmax(inside))
        by_flicker = flicker.about_level(first, first + error.size, of_rest=True)
        apart = s[inside] - s[inside if inside.all() else ~inside].mean(axis=0)
        known = [
            uncertainty.of_coefficients(model, apart, k) + variance * noise
            for k, noise in zip(uncertainty.NEIGHBOURING, by_flicker, strict=True)
        ]
        yield error, known, rate[inside] > MOVING_DEGC_MIN

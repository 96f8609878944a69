"""Choice of the terms of one channel's bias by its errors on stretches that were left out of the
fit, each CANDIDATE a set of terms x_k of y = b + Σ_k c_k x_k (`numeric.thermal.terms`).

What lasts in the errors of the chosen one, beyond the noise and the uncertainty of c_k, is its
model error: e² = mean product of neighbouring errors − what these explain of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.constants import SECONDS_PER_MINUTE
from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.thermal import fits, uncertainty
from calibkit.numeric.thermal.evaluate import evaluate_terms
from calibkit.numeric.thermal.left_out import (
    CLEARLY,
    STATIC,
    Candidate,
    LeftOutErrors,
    figure_means,
    leave_out,
    simplest,
    solve,
)
from calibkit.numeric.thermal.pooled_fit import Stack, WhitenedRows
from calibkit.numeric.thermal.terms import ThermalModel

MOVING_DEGC_MIN = 0.3
"""Temperature rate [°C/min] from which on it changes."""
RATES = ("s_rate", "s_temp_rate")
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
class Choice:
    """Errors of all candidates on stretches and on pairs of them, left out together, why others
    could not be fitted, the chosen model and its test. What a model misses is seen better by
    leaving out more, what tells models apart by leaving out less.
    """

    tested: tuple[LeftOutErrors, ...]
    refused: tuple[str, ...]
    chosen_errors: LeftOutErrors
    model: ThermalModel

    @property
    def constant(self) -> LeftOutErrors:
        """Test of the bias without any term of temperature."""
        return self.tested[0]


def choose(
    stacked: Stack, candidates: Sequence[Candidate] = CANDIDATES, *, figure_blocks: int
) -> Choice:
    """Fit each candidate without each stretch in turn and choose the simplest within one standard
    error of the smallest error on left-out stretches; the constant where none is clearly below it.

    Raises FitError where no candidate can be fitted.
    """
    pairs = Stack.of_logs([replace(log, part=log.part // 2) for log in stacked.logs])
    basis = fits.level_basis(stacked)
    solved, refused = solve((CONSTANT, *candidates), basis)
    cuts = [(cut, leave_out(cut, basis.rows)) for cut in (stacked, pairs)]
    errors = [_left_out(fit, cuts, figure_blocks) for _, fit in solved]
    tested = [
        LeftOutErrors(candidate.name, left, errors[0], fit.parameters, fit.endless)
        for (candidate, fit), left in zip(solved, errors, strict=True)
    ]
    if len(tested) == 1:
        raise FitError(
            f"no model can be fitted: {'; '.join(refused)}",
            hint="log the instrument while its temperature changes",
        )
    helping = (k for k, test in enumerate(tested) if k and test.pooled <= CLEARLY * test.pooled_raw)
    chosen_number = simplest(tested, (0, *helping))
    model = fits.finish(solved[chosen_number][1])
    of_pairs = errors[chosen_number][len(stacked.ramps) :]
    model = _with_model_error(model, of_pairs, pairs, figure_blocks)
    return Choice(tuple(tested), tuple(refused), tested[chosen_number], model)


def _left_out(
    solution: fits.TermSolution,
    cuts: Sequence[tuple[Stack, tuple[WhitenedRows, ...]]],
    figure_blocks: int,
) -> tuple[Array, ...]:
    """Errors of a candidate on each stretch, then on each pair of them, fitted to all others; the
    turn-on bias is that of the rest of the power-on, or the stretch's own where it has no other.
    """
    sound = solution.rows.sound
    errors = []
    for stacked, remaining_rows in cuts:
        for number, drift in enumerate(solution.leave_out(remaining_rows)):
            left = stacked.indication - drift
            errors.append(_errors(number, left, stacked, sound, figure_blocks))
    return tuple(errors)


def _errors(number: int, left: Array, stacked: Stack, sound: Mask, figure_blocks: int) -> Array:
    """Figure means of indication less prediction [n] over one stretch, less the level of the other
    stretches of its power-on.
    """
    stretch = stacked.ramps[number]
    log = stacked.log_rows[stacked.ramp_log[number]]
    rest_of_power_on = sound[log].copy()
    rest_of_power_on[stretch.start - log.start : stretch.stop - log.start] = False
    means = figure_means(left[stretch], sound[stretch], figure_blocks)
    level = (
        np.average(left[log], weights=rest_of_power_on) if rest_of_power_on.any() else means.mean()
    )
    return np.asarray(means - level, dtype=np.float64)


def _with_model_error(
    model: ThermalModel, of_pairs: Sequence[Array], stacked: Stack, figure_blocks: int
) -> ThermalModel:
    """Model with what lasts in its errors on left-out stretches beyond noise and coefficients: at
    rest or while the temperature changes, whichever is larger.
    """
    rest_degc = model.nearest_fitted(0.0)
    stretches: list[tuple[Array, list[Array], Mask]] = []
    errors = iter(of_pairs)
    for log in stacked.logs:
        sensitivities = evaluate_terms(
            model, log.time, log.case, log.env, rest_degc, log.starts
        ).sensitivities
        parts = uncertainty.explain_parts(model, log, sensitivities, figure_blocks, of_rest=True)
        for rows, covariances in parts:
            error = next(errors)
            if error.size == len(rows):
                minutes = np.maximum(np.ptp(log.time[rows], axis=1), 1.0) / SECONDS_PER_MINUTE
                rate = np.ptp(log.case[rows], axis=1) / minutes
                stretches.append((error, covariances, rate > MOVING_DEGC_MIN))
    sizes = [0.0]
    for moving in (True, False):
        # errors of the runs, and the products of neighbouring ones that noise and coefficients make
        run_errors: list[Array] = []
        products: list[Array] = []
        for error, covariances, changing in stretches:
            for run in _runs(changing == moving):
                run_errors.append(error[run])
                for k, at_lag in zip(uncertainty.NEIGHBOURING, covariances, strict=True):
                    products.append(at_lag[run.start : max(run.stop - k, run.start)])
        if run_errors:
            expected = np.concatenate(products)
            explained = expected.sum() / max(expected.size, 1)
            sizes.append(uncertainty.model_error(run_errors, explained))
    return replace(
        model, model_error=max(sizes), model_error_dof=float(max(len(stacked.ramps) - 1, 1))
    )


def _runs(mask: Mask) -> list[slice]:
    """Runs of a mask [n]."""
    return [slice(first, stop) for first, stop in chunks.find_runs(mask).tolist()]

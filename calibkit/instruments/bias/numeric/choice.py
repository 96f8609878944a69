"""Choice between no drift term, level models, lagged models and banks of lags by their errors on
ramps that were left out of the fit.

Of each left-out ramp j the error is s_j, the mean square of what is left of its 100 s means. A
candidate helps if √(mean s_j) is clearly below that of the raw indication and no s_j is larger than
raw by more than its noise; of those that help the simplest within one standard error of the best is
exported (`left_out.simplest`).

A bank of lags grows by further terms (`grow`): one is asked for by the evidence of all logs,
ln p(y | with) − ln p(y | without), and kept where left-out ramps do not speak against it. One that
is not kept is stated with its probability 1/(1 + p(without)/p(with)), and the change of the drift
that it would make.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.errors import FitError
from calibkit.instruments.bias.numeric import bank, bank_fit
from calibkit.instruments.bias.numeric.bank import OnLevels
from calibkit.numeric import chunks
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import SECONDS_PER_MINUTE
from calibkit.numeric.thermal import evaluate, fits
from calibkit.numeric.thermal.left_out import (
    CLEARLY,
    FIGURE_BLOCKS,
    MOVING_DEGC_MIN,
    STATIC,
    WORSE,
    Candidate,
    LeftOutErrors,
    figure_means,
    leave_out,
    left_out_errors,
    simplest,
    solve,
    split_noise,
)
from calibkit.numeric.thermal.pooled_fit import Stack, ThermalLog, WhitenedRows
from calibkit.numeric.thermal.terms import TERMS, ThermalModel

BANK = "bank of lags"
LIKELY = 0.5
"""Probability from which a term that is not modelled is flagged."""
LEAST_RAMPS = 3
"""Fewest ramps for leaving one out: one more than the two sides of a thermal cycle."""
FURTHER = {"g": "table over temperature", "h": "hysteresis", "w": "warm-up"}
"""Further terms of a bank, and what they describe."""
ASKED = {"g": 1.0, "h": 0.0, "w": 1.0}
"""Increase of the logarithm of the evidence from which a further term is tested on left-out ramps:
odds of 3 to 1, of a hysteresis even odds. All logs together tell it, by their levels, before a
single ramp shows it, and a bank without it is wrong at rest, where no ramp tests it.
"""


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """Further term that a bank has not: its name, how far off [°/h] the drift is if it is there,
    and how probable it is by the evidence.
    """

    name: str
    size: float
    probability: float


@dataclass(frozen=True, slots=True)
class _Fitted:
    """Candidate by its name, with its solution on all ramps."""

    name: str
    solution: fits.TermSolution | bank_fit.BankSolution
    unmodelled: tuple[Unmodelled, ...] = ()
    """Terms that left-out ramps do not ask for, or the evidence does not."""


def grow(
    rows: WhitenedRows, remaining_rows: Sequence[WhitenedRows], *, one_sided: bool
) -> Iterator[_Fitted]:
    """Bank of lags, then with one further term after the other, the likeliest first, as long as one
    helps. Ramps of one direction show no hysteresis.
    """
    name, letters, before = BANK, "", bank_fit.solve(bank_fit.state_problem(rows))
    # ramps of one direction leave a hysteresis on one branch
    absent = set(FURTHER) - ({"h"} if one_sided else set())
    while absent:
        # of a long log a solution is large: only those that the evidence asks for are kept
        gains, sizes, asked_for = {}, {}, {}
        for letter in sorted(absent):
            # at the static lag without the term
            problem = bank_fit.state_problem(
                before.problem.rows,
                letters + letter,
                drift=before.problem.drift,
                before=before.problem,
            )
            solution = bank_fit.solve_at(problem, before.lag, before.posterior.theta)
            # evidence integrated over the variances: a term that is not needed costs what its
            # prior is too wide
            gains[letter] = solution.posterior.log_integral - before.posterior.log_integral
            sizes[letter] = solution.change_from(before)
            if gains[letter] >= ASKED[letter]:
                asked_for[letter] = solution
        for letter in sorted(asked_for, key=lambda letter: -gains[letter]):
            if _left_out_ramps_agree(before, asked_for[letter], remaining_rows):
                break
        else:
            unmodelled = [
                Unmodelled(FURTHER[letter], sizes[letter], 1.0 / (1.0 + float(np.exp(-gain))))
                for letter, gain in gains.items()
            ]
            yield _Fitted(name, before, tuple(unmodelled))
            return
        yield _Fitted(name, before)
        absent -= {letter}
        name, letters = f"{name}, {FURTHER[letter]}", letters + letter
        before = bank_fit.solve(asked_for[letter].problem)
    yield _Fitted(name, before)


def _left_out_ramps_agree(
    before: bank_fit.BankSolution,
    after: bank_fit.BankSolution,
    remaining_rows: Sequence[WhitenedRows],
) -> bool:
    """Whether left-out ramps do not speak against a term that the evidence asks for, by more than a
    standard error of the difference ramp by ramp. Logs that start unsettled show what looks like
    one: there left-out ramps must come out better.
    """
    squares = []
    for solution in (after, before):
        stacked = solution.problem.stacked
        drifts = solution.leave_out(remaining_rows)
        predicted = (drift[ramp] for drift, ramp in zip(drifts, stacked.ramps, strict=True))
        # initial states that the term leaves no need for would hide what it explains
        errors = left_out_errors(
            solution.with_own_start(predicted) if after.unsettled else predicted,
            stacked,
            solution.problem.rows.sound,
            FIGURE_BLOCKS,
        )
        squares.append(np.array([np.var(error) for error in errors]))
    increase = squares[0] - squares[1]
    # an unsettled start looks like a hysteresis or a warm-up: there the ramps must come out better
    chance = 0.0 if before.unsettled else float(np.std(increase, ddof=1) / np.sqrt(increase.size))
    return bool(increase.mean() < chance)


CANDIDATES = (
    Candidate("level T", "level", STATIC[:2]),
    Candidate("level T²", "level", STATIC[:3]),
    Candidate("level T³", "level", STATIC),
    Candidate("level T³, rate", "level", (*STATIC, "s_rate")),
    Candidate("level T³, rate, gradient", "level", (*STATIC, "s_rate", "s_grad", "s_temp_rate")),
    Candidate("level, all terms", "level", TERMS),
    Candidate("lagged T³, one lag", "lagged", (*STATIC, "s_rate", "s_temp_rate")),
    Candidate("lagged T³, rate, gradient", "lagged", (*STATIC, "s_rate", "s_grad", "s_temp_rate")),
    Candidate("lagged, all terms", "lagged", fits.LAGGED_TERMS),
    Candidate(BANK, "bank", ()),
)


def _helps(test: LeftOutErrors) -> bool:
    """Whether the pooled error on left-out ramps is clearly below raw and no left-out ramp became
    worse by more than its noise: the standard error of compensated² − raw².
    """
    chance = [
        np.std(e**2 - r**2) / np.sqrt(e.size) for e, r in zip(test.errors, test.raw, strict=True)
    ]
    # a ramp that is worse within its noise speaks against nothing
    limit = WORSE**2 * test.raw_squares + 2.0 * np.array(chance)
    return test.pooled <= CLEARLY * test.pooled_raw and bool(np.all(test.squares <= limit))


@dataclass(frozen=True, slots=True)
class ThermalChoice:
    """Errors of all candidates on left-out ramps, the exported model or None, and the reason for
    the choice.
    """

    tested: tuple[LeftOutErrors, ...]
    refused: tuple[str, ...]
    chosen_errors: LeftOutErrors | None
    model: OnLevels | None
    reason: str


def choose(
    logs: Sequence[ThermalLog],
    candidates: Sequence[Candidate] = CANDIDATES,
    *,
    figure_blocks: int = FIGURE_BLOCKS,
) -> ThermalChoice:
    """Fit each candidate without each ramp in turn and choose the simplest within one standard
    error of the smallest error on left-out ramps.

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
    stacked = Stack.of_logs(logs)
    if len(stacked.ramps) < LEAST_RAMPS:
        reason = (
            f"{len(stacked.ramps)} ramps, expected at least {LEAST_RAMPS} to leave one out: no"
            " drift term"
        )
        return ThermalChoice((), (), None, None, reason)
    # all candidates leave out the same rows, so that their errors are comparable
    basis = fits.level_basis(stacked)
    case = np.concatenate([log.case for log in stacked.logs])
    changes = [case[rows.stop - 1] - case[rows.start] for rows in stacked.ramps]
    # by what the case did, not by names of logs
    one_sided = bool(np.all(np.sign(changes) == np.sign(changes[0])))
    remaining_rows = leave_out(stacked, basis.rows)
    solved, refused = solve(candidates, basis)
    fitted = [_Fitted(candidate.name, solution) for candidate, solution in solved]
    last_bank: bank_fit.BankSolution | None = None
    if any(candidate.form == "bank" for candidate in candidates):
        fitted += grow(basis.rows, remaining_rows, one_sided=one_sided)
        solution = fitted[-1].solution
        last_bank = solution if isinstance(solution, bank_fit.BankSolution) else None
    # errors on each ramp, fitted to all other ramps; lags start from the fit to all ramps
    sound = basis.rows.sound
    raw = left_out_errors((np.zeros(1) for _ in stacked.ramps), stacked, sound, figure_blocks)
    results = []
    for fit in fitted:
        ramp_drifts = zip(fit.solution.leave_out(remaining_rows), stacked.ramps, strict=True)
        predicted: Iterable[Array] = (drift[rows] for drift, rows in ramp_drifts)
        if last_bank is not None:  # which knows how unsettled logs start
            predicted = last_bank.with_own_start(predicted)
        errors = left_out_errors(predicted, stacked, sound, figure_blocks)
        # the lags of a bank are given
        endless = isinstance(fit.solution, fits.TermSolution) and fit.solution.endless
        results.append(LeftOutErrors(fit.name, errors, raw, fit.solution.parameters, endless))
    tested = tuple(results)
    best = _best_of(tested, one_sided=one_sided)
    if best is None:
        reason = f"no candidate could be fitted: {'; '.join(refused)}: no drift term"
        if tested:
            least = min(tested, key=lambda result: result.pooled)
            ramps = zip(stacked.ramp_names, least.squares, least.raw_squares, strict=True)
            worse = [name for name, left, before in ramps if left > WORSE**2 * before]
            harm = f" and makes {', '.join(worse)} worse" if worse else ""
            reason = (
                f"the best candidate ({least.name}) leaves {least.pooled:.3g} deg/h on left-out"
                f" ramps against {least.pooled_raw:.3g} deg/h raw{harm}: no drift term"
            )
        return ThermalChoice(tested, tuple(refused), None, None, reason)
    chosen, solution = tested[best], fitted[best].solution
    model: OnLevels = (
        fits.finish(solution) if isinstance(solution, fits.TermSolution) else solution.finish()
    )
    evaluations = [bank.evaluate(model, log.time, log.case, log.env) for log in stacked.logs]
    sensitivities = [evaluation.sensitivities for evaluation in evaluations]
    explained = evaluate.explained(model, stacked.logs, sensitivities, figure_blocks)
    variance, remarks = evaluate.model_error(chosen.errors, explained) ** 2, [*model.remarks]
    for term in fitted[best].unmodelled:
        # a term that is probably there and not modelled: its effect, weighted with its probability
        variance += term.probability * term.size**2
        if term.probability > LIKELY:
            remarks.append(
                f"{term.name} is likely, which would change the drift by some {term.size:.2g}"
                " deg/h, but the logs do not ask for it clearly, or left-out ramps speak against"
                " it: it is not modelled and is in the uncertainty"
            )
    model = replace(
        model,
        model_error=float(np.sqrt(variance)),
        model_error_dof=float(len(stacked.ramps) - 1),
        remarks=tuple(remarks),
    )
    smallest = min((test for test in tested if _helps(test)), key=lambda test: test.pooled)
    reason = (
        f"{chosen.name}: {chosen.pooled:.3g} deg/h on left-out ramps against"
        f" {chosen.pooled_raw:.3g} deg/h raw and {split_noise(chosen.errors).noise:.3g} deg/h of"
        " noise alone, "
    )
    if smallest is chosen:
        reason += "the smallest error of the candidates"
    else:
        reason += (
            "the simplest model within the noise of the best on left-out ramps"
            f" ({smallest.name}, {smallest.pooled:.3g} deg/h)"
        )
    return ThermalChoice(tested, tuple(refused), chosen, model, reason)


def _best_of(tested: Sequence[LeftOutErrors], *, one_sided: bool = False) -> int | None:
    """Index of the candidate to export, None if none helps: the one with the fewest parameters
    among those as good as the best within the noise.

    Where all ramps go one way, a bank is taken if it helps: the priors of its terms hold for the
    other way, where nothing tests the others.
    """
    helping = [k for k, test in enumerate(tested) if _helps(test)]
    # a further term of a bank has been tested when it was added: the last bank stands for all
    banks = [k for k in helping if tested[k].name.startswith(BANK)]
    helping = [k for k in helping if k not in banks[:-1]]
    if one_sided and banks:
        helping = banks[-1:]
    return simplest(tested, helping) if helping else None


# Channels at rest beside one thermometer: stretches of power-ons are left out


RATES = ("s_rate", "s_temp_rate")
CONSTANT = Candidate("constant", "level", STATIC[:1])
TERM_CANDIDATES = (
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
class TermChoice:
    """Errors of all candidates on stretches, then on pairs of them, the chosen one, and its
    model.
    """

    tested: tuple[LeftOutErrors, ...]
    """Of the constant first."""
    chosen_errors: LeftOutErrors
    model: ThermalModel

    @property
    def varies(self) -> bool:
        """Whether the model has a term beside the constant."""
        return self.chosen_errors is not self.tested[0]


def choose_terms(
    stacked: Stack, candidates: Sequence[Candidate] = TERM_CANDIDATES, *, figure_blocks: int
) -> TermChoice:
    """Fit each candidate without each stretch in turn, and without each pair of them, and choose
    the simplest within one standard error of the smallest error; the constant where none is clearly
    below it. What a model misses is seen better by leaving out more, what tells models apart by
    leaving out less.

    Raises FitError where no candidate can be fitted.
    """
    # longer left-out stretches show what a model misses, short ones tell models apart
    pairs = Stack.of_logs([replace(log, part=log.part // 2) for log in stacked.logs])
    basis = fits.level_basis(stacked)
    solved, refused = solve((CONSTANT, *candidates), basis)
    if len(solved) == 1:
        raise FitError(
            f"no model can be fitted: {'; '.join(refused)}",
            hint="log the instrument while its temperature changes",
        )
    cuts, sound = [(cut, leave_out(cut, basis.rows)) for cut in (stacked, pairs)], basis.rows.sound
    tested: list[LeftOutErrors] = []
    for candidate, solution in solved:
        errors = []
        for cut, remaining_rows in cuts:
            for number, drift in enumerate(solution.leave_out(remaining_rows)):
                # less the turn-on bias of the rest of the power-on, or the stretch's own where it
                # has no other
                stretch, log = cut.ramps[number], cut.log_rows[cut.ramp_log[number]]
                rest = sound[log].copy()
                rest[stretch.start - log.start : stretch.stop - log.start] = False
                left = cut.indication - drift
                means = figure_means(left[stretch], sound[stretch], figure_blocks)
                level = np.average(left[log], weights=rest) if rest.any() else means.mean()
                errors.append(np.asarray(means - level, dtype=np.float64))
        raw = tested[0].errors if tested else tuple(errors)
        name, parameters = candidate.name, solution.parameters
        tested.append(LeftOutErrors(name, tuple(errors), raw, parameters, solution.endless))
    helping = (k for k, test in enumerate(tested) if k and test.pooled <= CLEARLY * test.pooled_raw)
    number = simplest(tested, (0, *helping))
    model = fits.finish(solved[number][1])
    error = _lasting_error(model, tested[number].errors[len(stacked.ramps) :], pairs, figure_blocks)
    dof = float(max(len(pairs.ramps) - 1, 1))
    model = replace(model, model_error=error, model_error_dof=dof)
    return TermChoice(tuple(tested), tested[number], model)


def _lasting_error(
    model: ThermalModel, of_pairs: Sequence[Array], stacked: Stack, figure_blocks: int
) -> float:
    """What lasts in errors on left-out pairs of stretches beyond noise and coefficients: at rest or
    while the temperature changes, whichever is larger.
    """
    rest_degc = model.nearest_fitted(0.0)
    stretches: list[tuple[Array, list[Array], Mask]] = []
    errors = iter(of_pairs)
    for log in stacked.logs:
        evaluation = evaluate.evaluate_terms(
            model, log.time, log.case, log.env, rest_degc, log.starts
        )
        parts = evaluate.explain_parts(
            model, log, evaluation.sensitivities, figure_blocks, of_rest=True
        )
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
            for first, stop in chunks.find_runs(changing == moving).tolist():
                run_errors.append(error[first:stop])
                for k, at_lag in zip(evaluate.NEIGHBOURING, covariances, strict=True):
                    products.append(at_lag[first : max(stop - k, first)])
        if run_errors:
            expected = np.concatenate(products)
            explained = expected.sum() / max(expected.size, 1)
            sizes.append(evaluate.model_error(run_errors, explained))
    return max(sizes)

"""Growth of a bank of lags by further terms, one after the other.

A term is asked for by the evidence of all logs, ln p(y | with) − ln p(y | without), and kept where
left-out ramps do not speak against it. One that is not kept is stated with its probability
1/(1 + p(without)/p(with)), and the change of the drift that it would make.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.instruments.fog_thermal.numeric import bank_fit
from calibkit.numeric.thermal.left_out import FIGURE_BLOCKS, left_out_errors
from calibkit.numeric.thermal.pooled_fit import WhitenedRows

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
class Grown:
    """Bank of lags with the further terms [letters] that it has, and those that it has not."""

    letters: str
    solution: bank_fit.BankSolution
    unmodelled: tuple[Unmodelled, ...] = ()

    @property
    def name(self) -> str:
        """Names of the further terms, each after a comma."""
        return "".join(f", {FURTHER[letter]}" for letter in self.letters)


def grow(
    rows: WhitenedRows, remaining_rows: Sequence[WhitenedRows], *, one_sided: bool
) -> Iterator[Grown]:
    """Bank of lags, then with one further term after the other, the likeliest first, as long as one
    helps. Ramps of one direction show no hysteresis.
    """
    bank = Grown("", bank_fit.solve(bank_fit.state_problem(rows)))
    absent = set(FURTHER) - ({"h"} if one_sided else set())
    while absent:
        before = bank.solution
        solutions, gains = {}, {}
        for letter in sorted(absent):
            # at the static lag without the term
            problem = bank_fit.state_problem(
                before.problem.rows, bank.letters + letter, drift=before.problem.drift
            )
            solutions[letter] = bank_fit.solve_at(problem, before.lag, before.posterior.theta)
            gains[letter] = solutions[letter].posterior.log_integral - before.posterior.log_integral
        for letter in sorted(gains, key=lambda letter: -gains[letter]):
            if gains[letter] >= ASKED[letter] and _helps(before, solutions[letter], remaining_rows):
                break
        else:
            unmodelled = []
            for letter, gain in gains.items():
                size, odds = solutions[letter].change_from(before), float(np.exp(-gain))
                unmodelled.append(Unmodelled(FURTHER[letter], size, 1.0 / (1.0 + odds)))
            yield replace(bank, unmodelled=tuple(unmodelled))
            return
        yield bank
        absent -= {letter}
        bank = Grown(bank.letters + letter, bank_fit.solve(solutions[letter].problem))
    yield bank


def _helps(
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
            solution.rows.sound,
            FIGURE_BLOCKS,
        )
        squares.append(np.array([np.var(error) for error in errors]))
    increase = squares[0] - squares[1]
    chance = 0.0 if before.unsettled else float(np.std(increase, ddof=1) / np.sqrt(increase.size))
    return bool(increase.mean() < chance)

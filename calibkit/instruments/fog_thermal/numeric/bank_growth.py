"""Growth of a bank of lags by further terms, one after the other."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.numeric import bank_fit
from calibkit.instruments.fog_thermal.numeric.bank_groups import Groups
from calibkit.numeric.thermal.left_out import FIGURE_BLOCKS, left_out_errors
from calibkit.numeric.thermal.pooled_fit import Stack

FURTHER = {"g": "table over temperature", "h": "hysteresis", "w": "warm-up"}
"""Further terms of a bank, and what they describe."""
ASKED = 1.0
"""Increase of the logarithm of the evidence from which a further term is tested on left-out ramps:
odds of 3 to 1. Left-out ramps decide.
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
    solution: bank_fit.Solution
    unmodelled: tuple[Unmodelled, ...] = ()

    @property
    def name(self) -> str:
        """Names of the further terms, each after a comma."""
        return "".join(f", {FURTHER[letter]}" for letter in self.letters)


def grow(stacked: Stack, robust: Array, *, one_sided: bool) -> Iterator[Grown]:
    """Bank of lags, then with one further term after the other, as long as the evidence asks for it
    and left-out ramps come out better. Ramps of one direction show no hysteresis.
    """
    groups = Groups.of_stack(stacked, robust)
    here = Grown("", bank_fit.solve(bank_fit.state_problem(stacked, groups)))
    left = set(FURTHER) - ({"h"} if one_sided else set())
    while left:
        tried = {letter: _with_term(here, letter, stacked) for letter in sorted(left)}
        before = here.solution.posterior.log_integral
        gains = {name: one.posterior.log_integral - before for name, one in tried.items()}
        letter = max(gains, key=lambda name: gains[name])
        # initial states that the term leaves no need for would hide what it explains
        unsettled = tried[letter].unsettled
        errors = [_mean_square(one, own_start=unsettled) for one in (tried[letter], here.solution)]
        if gains[letter] < ASKED or errors[0] >= errors[1]:
            found = (
                Unmodelled(
                    FURTHER[name],
                    tried[name].change_from(here.solution),
                    1.0 / (1.0 + np.exp(-gain)),
                )
                for name, gain in gains.items()
            )
            yield replace(here, unmodelled=tuple(found))
            return
        yield here
        left -= {letter}
        here = Grown(here.letters + letter, bank_fit.solve(tried[letter].problem))
    yield here


def _with_term(here: Grown, letter: str, stacked: Stack) -> bank_fit.Solution:
    """Fit with one more term, at the static lag without it."""
    problem = bank_fit.state_problem(stacked, here.solution.problem.groups, here.letters + letter)
    return bank_fit.solve_at(problem, here.solution.lag, here.solution.posterior.theta)


def _mean_square(solution: bank_fit.Solution, *, own_start: bool) -> float:
    """Mean over the ramps of the variance of the error on each left-out ramp, in groups of
    blocks, with the initial state of the ramp or without.
    """
    predicted, own = solution.leave_out(), solution.problem
    if own_start:
        predicted = solution.with_own_start(predicted)
    errors = left_out_errors(predicted, own.stacked, own.groups.weights, FIGURE_BLOCKS)
    return float(np.mean([np.var(error) for error in errors]))

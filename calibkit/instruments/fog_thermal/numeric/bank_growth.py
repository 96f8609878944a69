"""Growth of a bank of lags by further terms, one after the other."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.numeric import bank_fit
from calibkit.instruments.fog_thermal.numeric.bank_groups import Groups
from calibkit.numeric.thermal.left_out import FIGURE_BLOCKS, left_out_errors
from calibkit.numeric.thermal.pooled_fit import Stack

GAINED = 3.0
"""Increase of the logarithm of the evidence from which a further term of a bank is tested on
left-out ramps: odds of 20 to 1.
"""
FURTHER = {"g": "table over temperature", "h": "hysteresis", "w": "warm-up"}
"""Further terms of a bank, and what they describe."""


@dataclass(frozen=True, slots=True)
class Grown:
    """Bank of lags with the further terms [letters] that it has, and names and sizes [°/h] of those
    that the evidence asks for and left-out ramps do not.
    """

    letters: str
    solution: bank_fit.Solution
    unmodelled: tuple[tuple[str, float], ...] = ()

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
        tried = {letter: _with_term(here, letter, stacked, groups) for letter in sorted(left)}
        before = here.solution.posterior.log_integral
        gains = {name: one.posterior.log_integral - before for name, one in tried.items()}
        letter = max(gains, key=lambda name: gains[name])
        better = _mean_square(tried[letter], stacked) < _mean_square(here.solution, stacked)
        if gains[letter] < GAINED or not better:
            likely = (name for name in gains if gains[name] > 0.0)
            sizes = tuple((FURTHER[name], tried[name].size_of_part(name)) for name in likely)
            yield replace(here, unmodelled=sizes)
            return
        yield here
        left -= {letter}
        here = Grown(here.letters + letter, bank_fit.solve(tried[letter].problem))
    yield here


def _with_term(here: Grown, letter: str, stacked: Stack, groups: Groups) -> bank_fit.Solution:
    """Fit with one more term, at the static lag without it."""
    problem = bank_fit.state_problem(stacked, groups, here.letters + letter)
    return bank_fit.solve_at(problem, here.solution.lag, here.solution.posterior.theta)


def _mean_square(solution: bank_fit.Solution, stacked: Stack) -> float:
    """Mean over the ramps of the variance of the error on each left-out ramp, in groups of
    blocks.
    """
    errors = left_out_errors(
        solution.leave_out(), stacked, solution.problem.groups.weights, FIGURE_BLOCKS
    )
    return float(np.mean([np.var(error) for error in errors]))

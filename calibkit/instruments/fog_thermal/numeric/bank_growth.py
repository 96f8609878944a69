"""Growth of a bank of lags by further terms, one after the other."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.numeric import bank_fit
from calibkit.numeric.thermal.left_out import FIGURE_BLOCKS, left_out_errors
from calibkit.numeric.thermal.pooled_fit import Rows

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
    solution: bank_fit.Solution
    unmodelled: tuple[Unmodelled, ...] = ()

    @property
    def name(self) -> str:
        """Names of the further terms, each after a comma."""
        return "".join(f", {FURTHER[letter]}" for letter in self.letters)


def grow(rows: Rows, without: Sequence[Rows], *, one_sided: bool) -> Iterator[Grown]:
    """Bank of lags, then with one further term after the other, the likeliest first, as long as one
    helps. Ramps of one direction show no hysteresis.
    """
    here = Grown("", bank_fit.solve(bank_fit.state_problem(rows)))
    left = set(FURTHER) - ({"h"} if one_sided else set())
    while left:
        tried = {letter: _with_term(here, letter) for letter in sorted(left)}
        before = here.solution.posterior.log_integral
        gains = {name: one.posterior.log_integral - before for name, one in tried.items()}
        likeliest = sorted(gains, key=lambda name: -gains[name])
        asked = [k for k in likeliest if gains[k] >= ASKED[k]]
        letter = next((k for k in asked if _helps(here.solution, tried[k], without)), "")
        if not letter:
            found = (
                Unmodelled(
                    FURTHER[name],
                    tried[name].change_from(here.solution),
                    float(1.0 / (1.0 + np.exp(-gain))),
                )
                for name, gain in gains.items()
            )
            yield replace(here, unmodelled=tuple(found))
            return
        yield here
        left -= {letter}
        here = Grown(here.letters + letter, bank_fit.solve(tried[letter].problem))
    yield here


def _helps(before: bank_fit.Solution, after: bank_fit.Solution, without: Sequence[Rows]) -> bool:
    """Whether left-out ramps do not speak against a term that the evidence asks for, by more than a
    standard error of the difference ramp by ramp. Logs that start unsettled show what looks like
    one: there left-out ramps must come out better.
    """
    # initial states that the term leaves no need for would hide what it explains
    squares = [
        _left_out_squares(one, without, own_start=after.unsettled) for one in (after, before)
    ]
    more = squares[0] - squares[1]
    chance = 0.0 if before.unsettled else float(np.std(more, ddof=1) / np.sqrt(more.size))
    return bool(more.mean() < chance)


def _with_term(here: Grown, letter: str) -> bank_fit.Solution:
    """Fit with one more term, at the static lag without it."""
    own = here.solution.problem
    problem = bank_fit.state_problem(own.rows, here.letters + letter, drift=own.drift)
    return bank_fit.solve_at(problem, here.solution.lag, here.solution.posterior.theta)


def _left_out_squares(
    solution: bank_fit.Solution, without: Sequence[Rows], *, own_start: bool
) -> Array:
    """Variance [ramps] of the error on each left-out ramp, in groups of blocks, with the initial
    state of the ramp or without.
    """
    own, whole = solution.problem, solution.leave_out(without)
    predicted: Iterable[Array] = (
        drift[ramp] for drift, ramp in zip(whole, own.stacked.ramps, strict=True)
    )
    if own_start:
        predicted = solution.with_own_start(predicted)
    errors = left_out_errors(predicted, own.stacked, own.rows.sound, FIGURE_BLOCKS)
    return np.array([np.var(error) for error in errors])

"""Inputs of the self-test and what the twin makes of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import frexp, ldexp

import numpy as np

from calibkit.errors import CoefficientError
from calibkit.firmware import twin, twin_clock
from calibkit.firmware.chain import Chain, Program, Trials
from calibkit.firmware.lanes import Words
from calibkit.firmware.steps import Sum
from calibkit.numeric.arrays import Array

INSIDE = 12
"""Vectors of a chain without memory that are within all ranges, the first ones."""
PLACES = ((-1.02, 1.02, 0.31, -0.43), (0.2, -0.6, 0.5, -0.7))
"""Where [half widths from the middle] the next four vectors are in ranges with a limit, and in
others.
"""
TRIED = 512
"""Inputs within their ranges at which a coefficient may count."""
CLOCKED = 32
"""Updates of the rows of a self-test that are called by the clock, one after the other."""
LEAST = float(np.finfo(np.float64).tiny)
"""Tolerance of an output that is exact."""
FOR_ZERO = 0.0625
"""What a coefficient of 0 becomes where the others are doubled."""
Coefficient = tuple[str, int]
"""Table, and place in it."""


@dataclass(frozen=True, slots=True)
class Vectors:
    """Inputs, outputs and statuses of the self-test, one row per call (the last of `updates`);
    words as the firmware sees them.
    """

    inputs: Mapping[str, tuple[float, ...]]
    updates: tuple[int, ...]
    outputs: Mapping[str, tuple[float, ...]]
    status: tuple[int, ...]
    elapsed_ms: tuple[int, ...] = ()
    """From call to call; none of a chain that keeps no time."""

    @staticmethod
    def make(chain: Chain, program: Program, bounds: Mapping[str, float]) -> "Vectors":
        """Vectors that reach both ends of every range and the clamping beyond, and in which every
        coefficient counts that does so anywhere by more than the self-test allows.
        """
        trials = chain.trials or _spread_trials(chain)
        words = {name: values.astype(twin.dtype(program)) for name, values in trials.inputs.items()}
        if chain.trials is None:
            words = _with_every_coefficient(chain, program, words, tolerances(chain, bounds))
        columns = {name: tuple(column.tolist()) for name, column in words.items()}
        return _recomputed(program, columns, trials.updates, trials.elapsed_ms)


def tolerances(
    chain: Chain, bounds: Mapping[str, float], updates: Sequence[int] = (1,)
) -> dict[str, float]:
    """Difference that the self-test allows an output: both sides may be off by the bound, which a
    sum adds up.
    """
    summed = max(*updates, CLOCKED) if chain.structure.summing else 1
    # the test's temperatures jump, which the bound leaves out
    jumps = 2.0 if chain.condition else 1.0
    return {name: float(f"{2.0 * jumps * bound * summed:.2g}") for name, bound in bounds.items()}


def candidates(chain: Chain, program: Program) -> dict[str, Words]:
    """Inputs of TRIED calls anywhere within their ranges."""
    rng, columns = np.random.default_rng(2), {}
    for entry in chain.structure.inputs:
        low, high = (float(limit) for limit in chain.tables[entry.table][:2])
        values = coarsen(rng.uniform(low, high, TRIED), (high - low) / 2.0)
        columns[entry.name] = values.astype(twin.dtype(program))
    return columns


def find_unnoticed(
    program: Program, words: Mapping[str, Words], tolerances: Mapping[str, float]
) -> set[Coefficient]:
    """Coefficients whose change moves no output by more than is allowed, at any of the inputs."""
    tables = {t.table for s in program.structure.steps if isinstance(s, Sum) for t in s.terms}
    return {
        (table, place)
        for table in tables - {""}
        for place in range(len(program.tables[table]))
        if _moves(program, words, tolerances, (table, place)).max() <= 1.0
    }


def _moves(
    program: Program,
    words: Mapping[str, Words],
    tolerances: Mapping[str, float],
    coefficient: Coefficient,
) -> Array:
    """By how much [n] a coefficient that is doubled, or a 0 that is not, moves an output, over what
    is allowed.
    """
    table, place = coefficient
    numbers = list(program.tables[table])
    numbers[place] = 2.0 * numbers[place] or FOR_ZERO
    changed = replace(program, tables={**program.tables, table: tuple(numbers)})
    right, wrong = (twin.call(variant, words).outputs for variant in (program, changed))
    shares = [np.abs(wrong[o] - right[o]) / max(tolerances[o], LEAST) for o in right]
    return np.asarray(np.max(shares, axis=0), dtype=np.float64)


def _with_every_coefficient(
    chain: Chain,
    program: Program,
    words: dict[str, Words],
    tolerances: Mapping[str, float],
) -> dict[str, Words]:
    """Inputs of which some have given way to candidates that notice what none did."""
    missed = find_unnoticed(program, words, tolerances)
    candidate_inputs = candidates(chain, program)
    for coefficient in sorted(missed):
        moves = _moves(program, candidate_inputs, tolerances, coefficient)
        best = int(np.argmax(moves))
        for row in range(INSIDE) if moves[best] > 1.0 else ():
            trial = {name: column.copy() for name, column in words.items()}
            for name, column in trial.items():
                column[row] = candidate_inputs[name][best]
            still_missed = find_unnoticed(program, trial, tolerances)
            if still_missed <= missed - {coefficient}:
                words, missed = trial, still_missed
                break
    return words


def _recomputed(
    program: Program,
    inputs: Mapping[str, tuple[float, ...]],
    updates: tuple[int, ...],
    elapsed_ms: tuple[int, ...],
) -> Vectors:
    """Outputs and statuses of the twin for rows of inputs, in turn where the chain has memory."""
    columns = {name: np.array(words, dtype=twin.dtype(program)) for name, words in inputs.items()}
    if program.structure.has_memory:  # a sum begins anew: its error bound grows with the updates
        anew = program.structure.summing
        results = list(twin_clock.run_in_turn(program, columns, updates, elapsed_ms, anew=anew))
    else:
        results = [twin.call(program, columns)]
    outputs = {
        output.name: tuple(np.concatenate([r.outputs[output.name] for r in results]).tolist())
        for output in program.structure.outputs
    }
    status = tuple(np.concatenate([result.status for result in results]).tolist())
    return Vectors(dict(inputs), updates, outputs, status, elapsed_ms)


def require_recomputed(
    program: Program, file_vectors: Vectors, name: str, source: str = "numbers"
) -> None:
    """CoefficientError for a file whose vectors are not those that its numbers give."""
    recomputed = _recomputed(
        program, file_vectors.inputs, file_vectors.updates, file_vectors.elapsed_ms
    )
    if (recomputed.outputs, recomputed.status) != (file_vectors.outputs, file_vectors.status):
        raise CoefficientError(
            f"{name}: its vectors are not those of its {source}", hint="export it again"
        )


def _spread_trials(chain: Chain) -> Trials:
    """Inputs over their ranges, each in an order of its own so that no two are proportional, then
    beyond them, and each indication by itself beyond its fitted range.
    """
    inputs, columns = chain.structure.inputs, {}
    ends = [(k, end) for k, entry in enumerate(inputs) if entry.beyond for end in range(2)]
    steps = (np.arange(INSIDE) * 2 + 1) / INSIDE - 1.0
    for number, entry in enumerate(inputs):
        limits = [float(limit) for limit in chain.tables[entry.table]]
        middle, half = (limits[0] + limits[1]) / 2.0, (limits[1] - limits[0]) / 2.0
        reach = 0.75 if entry.unit == "degC" else 0.55
        order = (np.arange(INSIDE) * (1, 5, 7, 11)[number % 4] + 3 * number) % INSIDE
        limited = not entry.beyond and bool(entry.flag or number == 0)
        places = np.concatenate([reach * steps[order], PLACES[0 if limited else 1]])
        values = coarsen(middle + half * places, half)
        excesses = [
            coarsen(np.array([1.02 * limits[end]]), limits[1])[0]
            if owner == number
            else values[INSIDE + end]
            for owner, end in ends
        ]
        columns[entry.name] = np.concatenate([values, excesses])
    return Trials(columns, (1,) * (INSIDE + len(PLACES[0]) + len(ends)))


def coarsen(values: Array, half: float) -> Array:
    """Values on a coarse binary grid for a range of that half width: short fractions, the same in
    every number format and as text.
    """
    unit = ldexp(1.0, frexp(half)[1] - 10)
    return np.asarray(np.rint(values / unit) * unit, dtype=np.float64)

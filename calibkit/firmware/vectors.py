"""Inputs of the self-test and what the twin makes of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import frexp, ldexp

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import CoefficientError
from calibkit.firmware import twin
from calibkit.firmware.chain import Chain, Trials
from calibkit.firmware.program import Program

COUNT = 16
"""Vectors of a chain without memory."""


@dataclass(frozen=True, slots=True)
class Vectors:
    """Inputs, outputs and statuses of the self-test, one row a call (the last of `updates`); words
    as the firmware sees them.
    """

    inputs: Mapping[str, tuple[float, ...]]
    updates: tuple[int, ...]
    outputs: Mapping[str, tuple[float, ...]]
    status: tuple[int, ...]

    @staticmethod
    def make(chain: Chain, program: Program) -> "Vectors":
        """Vectors that reach both ends of every range and the clamping beyond, and in which every
        coefficient counts.
        """
        trials = chain.trials or Trials(_spread_inputs(chain), (1,) * COUNT)
        words = {name: twin.encode(program, name, values) for name, values in trials.inputs.items()}
        if program.format.fixed and chain.trials is None:  # the word that stands for no number
            words[program.structure.inputs[0].name][-1] = program.format.no_number
        columns = {name: tuple(column.tolist()) for name, column in words.items()}
        return _recomputed(program, columns, trials.updates)


def _recomputed(
    program: Program, inputs: Mapping[str, tuple[float, ...]], updates: tuple[int, ...]
) -> Vectors:
    """Outputs and statuses of the twin for rows of inputs, in turn where the chain has memory."""
    columns = {name: np.array(words, dtype=twin.dtype(program)) for name, words in inputs.items()}
    if program.structure.has_memory:  # a sum begins anew: its error bound grows with the updates
        found = list(twin.run_in_turn(program, columns, updates, anew=program.structure.summing))
    else:
        found = [twin.call(program, columns)]
    outputs = {
        output.name: tuple(np.concatenate([r.outputs[output.name] for r in found]).tolist())
        for output in program.structure.outputs
    }
    status = tuple(np.concatenate([result.status for result in found]).tolist())
    return Vectors(dict(inputs), updates, outputs, status)


def require_recomputed(program: Program, stated: Vectors, name: str, of: str = "numbers") -> None:
    """CoefficientError for a file whose vectors are not those that its numbers give."""
    again = _recomputed(program, stated.inputs, stated.updates)
    if (again.outputs, again.status) != (stated.outputs, stated.status):
        raise CoefficientError(
            f"{name}: its vectors are not those of its {of}", hint="export it again"
        )


def _spread_inputs(chain: Chain) -> dict[str, Array]:
    """Inputs over their ranges, each in an order of its own so that no two are proportional, the
    last ones beyond the ranges.
    """
    found = {}
    inside = COUNT - 4
    steps = (np.arange(inside) * 2 + 1) / inside - 1.0
    for number, entry in enumerate(chain.structure.inputs):
        low, high = (float(limit) for limit in chain.tables[entry.table])
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        reach = 0.75 if entry.unit == "degC" else 0.55
        order = (np.arange(inside) * (1, 5, 7, 11)[number % 4] + 3 * number) % inside
        limited = entry.flag or number == 0
        beyond = (-1.02, 1.02, 0.31, -0.43) if limited else (0.2, -0.6, 0.5, -0.7)
        places = np.concatenate([reach * steps[order], beyond])
        found[entry.name] = coarsen(middle + half * places, half)
    return found


def coarsen(values: Array, half: float) -> Array:
    """Values on a coarse binary grid for a range of that half width: short fractions, the same in
    every number format and as text.
    """
    unit = ldexp(1.0, frexp(half)[1] - 10)
    return np.asarray(np.rint(values / unit) * unit, dtype=np.float64)

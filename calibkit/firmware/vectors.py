"""Inputs of the self-test and what the twin makes of them."""

from __future__ import annotations

from dataclasses import dataclass
from math import frexp, ldexp
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import CoefficientError
from calibkit.firmware import ranges, twin

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from calibkit.arrays import Array
    from calibkit.firmware.chain import Chain
    from calibkit.firmware.program import Program
    from calibkit.firmware.twin import Result, State, Words

SUMMED = 3
"""Updates of each row of a chain that sums increments."""
COUNT = 16
"""Vectors of a chain without memory."""
IN_TURN = (
    (0.0, 0.0, 0.0, 1),
    (0.03, 0.1, 0.3, 1),
    (0.05, 0.3, 0.6, 1),
    (0.04, 0.5, 0.9, 1),
    (0.07, -0.3, 0.5, 1),
    (0.06, 0.4, 0.08, 1),
    (0.1, -0.2, -0.4, 1),
    (0.08, -0.5, -0.7, 1),
    (0.02, -0.8, -0.9, 1),
    (0.09, 0.05, -0.5, 1),
    (0.055, -0.3, -0.08, 1),
    (0.01, 0.05, 0.02, 1),
    (0.1, 0.9, 0.5, 3),
    (0.5, 1.2, 1.4, 3),
    (1.02, 1.2, 4.5, 1),
    (0.96, 2.6, 0.8, 8),
    (0.96, 0.5, 0.2, 160),
    (0.2, -0.4, -0.3, 3),
    (-0.5, -1.2, -1.4, 3),
    (-1.02, -2.6, -4.5, 2),
    (-0.96, -0.7, -0.8, 8),
    (-0.96, 0.3, 0.1, 160),
    (-0.2, 0.2, 0.5, 6),
    (0.1, -0.3, -0.2, 12),
)
"""A chain with memory, from its reset on: case temperature over the range of its input, how far the
air is ahead over the largest gradient, rate of the air over the largest fitted one, and how many
updates that lasts; both ends of every range.
"""


@dataclass(frozen=True, slots=True)
class Vectors:
    """Inputs, outputs and statuses of the self-test, one row a call (the last of `updates`); words
    as the firmware sees them.
    """

    inputs: Mapping[str, tuple[float, ...]]
    updates: tuple[int, ...]
    outputs: Mapping[str, tuple[float, ...]]
    status: tuple[int, ...]


def make_vectors(chain: Chain, program: Program) -> Vectors:
    """Vectors that reach both ends of every range and the clamping beyond, and in which every
    coefficient counts.
    """
    memory = program.structure.has_memory
    physical, updates = _in_turn(chain) if memory else (_apart(chain), (1,) * COUNT)
    words = {name: twin.encode(program, name, values) for name, values in physical.items()}
    if program.format.fixed and not memory:  # the word that stands for no number
        name = program.structure.inputs[0].name
        words[name] = np.concatenate([words[name][:-1], [program.format.no_number]])
    return recomputed(
        program, {name: tuple(column.tolist()) for name, column in words.items()}, updates
    )


def recomputed(
    program: Program, inputs: Mapping[str, tuple[float, ...]], updates: tuple[int, ...]
) -> Vectors:
    """Outputs and statuses of the twin for rows of inputs, in turn where the chain has memory."""
    columns = {name: np.array(words, dtype=twin.dtype(program)) for name, words in inputs.items()}
    memory = program.structure.has_memory
    found = list(_updated(program, columns, updates)) if memory else [twin.call(program, columns)]
    outputs = {
        output.name: tuple(np.concatenate([r.outputs[output.name] for r in found]).tolist())
        for output in program.structure.outputs
    }
    status = tuple(np.concatenate([result.status for result in found]).tolist())
    return Vectors(dict(inputs), updates, outputs, status)


def require_recomputed(program: Program, stated: Vectors, name: str, of: str = "numbers") -> None:
    """CoefficientError for a file whose vectors are not those that its numbers give."""
    again = recomputed(program, stated.inputs, stated.updates)
    if (again.outputs, again.status) != (stated.outputs, stated.status):
        raise CoefficientError(
            f"{name}: its vectors are not those of its {of}", hint="export it again"
        )


def _updated(
    program: Program, columns: Mapping[str, Words], updates: tuple[int, ...]
) -> Iterator[Result]:
    """Last result of each row of a chain with memory; one that sums starts anew in every row."""
    state: State | None = twin.reset(program, 1)
    for k, count in enumerate(updates):
        if program.structure.summing:
            state = twin.reset(program, 1)
        row = {name: column[k : k + 1] for name, column in columns.items()}
        for _ in range(count):
            result = twin.call(program, row, state)
            state = result.state
        yield result


def _apart(chain: Chain) -> dict[str, Array]:
    """Inputs over their ranges, each in its own order so that none goes with another, the last ones
    beyond.
    """
    known, found = ranges.find_ranges(chain, usual=False), {}
    inside = COUNT - 4
    steps = (np.arange(inside) * 2 + 1) / inside - 1.0
    for number, entry in enumerate(chain.structure.inputs):
        low, high = (float(limit) for limit in known[entry.name])
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        reach = 0.75 if entry.unit == "degC" else 0.55
        order = (np.arange(inside) * (1, 5, 7, 11)[number % 4] + 3 * number) % inside
        beyond = (
            np.array([-1.02, 1.02, 0.31, -0.43])
            if entry.flag or number == 0
            else np.array([0.2, -0.6, 0.5, -0.7])
        )
        # short binary fractions, the same in every number format, and as text
        found[entry.name] = _short(
            middle + half * np.concatenate([reach * steps[order], beyond]), half
        )
    return found


def _in_turn(chain: Chain) -> tuple[dict[str, Array], tuple[int, ...]]:
    """Inputs of one thermal history, and the updates of each of its rows."""
    known = ranges.find_ranges(chain, usual=False)
    low, high = (float(limit) for limit in known["temp_case_degc"])
    half = (high - low) / 2.0
    if "x_map" in chain.tables:
        half = float(chain.tables["x_map"][3] / chain.tables["x_map"][1])
    case, ahead, pace, updates = (np.array(column) for column in zip(*IN_TURN, strict=True))
    physical = {"temp_case_degc": (low + high) / 2.0 + half * case}
    physical["temp_env_degc"] = physical["temp_case_degc"] + _largest_gradient(chain) * ahead
    if chain.structure.summing:  # few increments: the error bound grows with them
        physical["temp_env_rate_degc_min"] = float(known["temp_env_rate_degc_min"][1]) / 4.0 * pace
        updates = np.full_like(updates, SUMMED)
    columns = {entry.name: _short(physical[entry.name], half) for entry in chain.structure.inputs}
    return columns, tuple(updates.tolist())


def _largest_gradient(chain: Chain) -> float:
    """Largest fitted difference [K] between case and air; 0 where the air does not enter."""
    maps = [step for step in chain.structure.maps if step.source == "apart"]
    reach = [abs(chain.tables[step.table][0]) + 1 / chain.tables[step.table][1] for step in maps]
    return float(max(reach, default=0))


def _short(values: Array, half: float) -> Array:
    """Values on a coarse binary grid."""
    unit = ldexp(1.0, frexp(half)[1] - 10)
    return np.asarray(np.rint(values / unit) * unit, dtype=np.float64)

"""Inputs of the self-test and what the twin makes of them."""

from __future__ import annotations

from dataclasses import dataclass
from math import frexp, ldexp
from typing import TYPE_CHECKING

import numpy as np

from calibkit.firmware import ranges, twin

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from calibkit.firmware.chain import Chain
    from calibkit.firmware.program import Program

COUNT = 16
"""Vectors of a chain without memory."""
UPDATES = 24
"""Updates of one with memory, from its reset on."""


@dataclass(frozen=True, slots=True)
class Vectors:
    """Inputs, outputs and statuses of the self-test, one row a call; words as the firmware sees them."""

    inputs: Mapping[str, tuple[float, ...]]
    outputs: Mapping[str, tuple[float, ...]]
    status: tuple[int, ...]


def of(chain: Chain, program: Program) -> Vectors:
    """Vectors that reach both ends of every range and the clamping beyond, and in which every coefficient counts."""
    physical = _in_turn(chain) if program.structure.interval_s is not None else _apart(chain)
    words = {name: twin.encoded(program, name, values) for name, values in physical.items()}
    if program.format.fixed and program.structure.interval_s is None:  # the word that stands for no number
        name = program.structure.inputs[0].name
        words[name] = np.concatenate([words[name][:-1], [-(1 << (program.format.bits - 1))]])
    return recomputed(program, {name: tuple(column.tolist()) for name, column in words.items()})


def recomputed(program: Program, inputs: Mapping[str, tuple[float, ...]]) -> Vectors:
    """Outputs and statuses of the twin for rows of inputs, in turn where the chain has a memory."""
    columns = {name: np.array(words, dtype=twin.dtype(program)) for name, words in inputs.items()}
    if program.structure.interval_s is None:
        found = [twin.call(program, columns)]
    else:
        state, found = twin.reset(program, 1), []
        for k in range(len(next(iter(inputs.values())))):
            found.append(twin.call(program, {name: column[k : k + 1] for name, column in columns.items()}, state))
            after = found[-1].state
            assert after is not None  # noqa: S101 (it was called with one)
            state = after
    outputs = {
        output.name: tuple(np.concatenate([result.outputs[output.name] for result in found]).tolist())
        for output in program.structure.outputs
    }
    return Vectors(dict(inputs), outputs, tuple(np.concatenate([result.status for result in found]).tolist()))


def _apart(chain: Chain) -> dict[str, NDArray[np.float64]]:
    """Inputs over their ranges, each in its own order so that none goes with another, the last ones beyond."""
    known, found = ranges.of(chain, usual=False), {}
    inside = COUNT - 4
    steps = (np.arange(inside) * 2 + 1) / inside - 1.0
    for number, entry in enumerate(chain.structure.inputs):
        low, high = (float(limit) for limit in known[entry.name])
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        reach = 0.75 if entry.unit == "degC" else 0.55
        order = (np.arange(inside) * (1, 5, 7, 11)[number % 4] + 3 * number) % inside
        beyond = np.array([-1.02, 1.02, 0.31, -0.43]) if entry.flag or number == 0 else np.array([0.2, -0.6, 0.5, -0.7])
        # short binary fractions, the same in every number format, and as text
        found[entry.name] = _short(middle + half * np.concatenate([reach * steps[order], beyond]), half)
    return found


def _in_turn(chain: Chain) -> dict[str, NDArray[np.float64]]:
    """Inputs of one thermal history: a rise, a rest, a fall, a fast rise beyond the range; the air leads the case."""
    known = ranges.of(chain, usual=False)
    low, high = (float(limit) for limit in known["temp_case_degc"])
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    usual = float(chain.usual.get("move", 0.04))
    pace = np.array([0.8] * 8 + [0.1] * 3 + [-0.9] * 8 + [0.5] * 2 + [16.0, 8.0, -4.0])
    case = middle + half * (-0.1 + 0.8 * usual * np.concatenate([[0.0], np.cumsum(pace)[:-1]]))
    lead = half * 0.12 * np.concatenate([[0.0], pace[1:]]).clip(-1.5, 1.5)
    physical = {"temp_case_degc": case, "temp_env_degc": case + lead}
    rates = [span for name, span in known.items() if name == "temp_env_rate_degc_min"]
    if rates:
        physical["temp_env_rate_degc_min"] = float(rates[0][1]) * 0.2 * pace.clip(-6.0, 6.0)
    return {entry.name: _short(physical[entry.name], half) for entry in chain.structure.inputs}


def _short(values: NDArray[np.float64], half: float) -> NDArray[np.float64]:
    """Values on a coarse binary grid."""
    unit = ldexp(1.0, frexp(half)[1] - 10)
    return np.asarray(np.rint(values / unit) * unit, dtype=np.float64)

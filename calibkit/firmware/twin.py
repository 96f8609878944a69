"""What the firmware computes, bit for bit, in numpy: the same operations on the same words in the
same order.

Bit for bit holds for C that is compiled without contraction to fused multiply-add
(`-ffp-contract=off`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibkit.firmware.chain import Program
from calibkit.firmware.lanes import Call, State, Words

INVALID = 1 << 15
"""Status of an input that is no number."""


@dataclass(frozen=True, slots=True)
class TwinResult:
    """Outputs and status of one call, and the state after it."""

    outputs: Mapping[str, Words]
    status: Words
    state: State | None

    @property
    def after(self) -> State:
        """State after a call of a chain with memory."""
        assert self.state is not None  # noqa: S101 (it was called with its state)
        return self.state

    @property
    def before(self) -> Mapping[str, Words]:
        """Outputs of the update before."""
        return self.after.before


def reset(program: Program, lanes: int) -> State:
    """State of a device that has just been switched on."""
    zero = np.zeros(lanes, dtype=dtype(program))
    return State(
        {memory.name: zero for memory in program.structure.memories},
        {
            slope.name: np.zeros((slope.length, lanes), dtype=dtype(program))
            for slope in program.structure.slopes
        },
        np.zeros(lanes, dtype=np.int64),
        {output.name: zero for output in program.structure.outputs},
        {output.name: zero for output in program.structure.outputs},
        {entry.name: zero for entry in program.structure.inputs},
        np.zeros(lanes, dtype=np.int64),
    )


def call(program: Program, inputs: Mapping[str, Words], state: State | None = None) -> TwinResult:
    """One call of the firmware's function on lanes of inputs [n]; a chain with memory needs its
    state.
    """
    bad, structure = find_refused(inputs), program.structure
    bits = {flag: 1 << k for k, flag in enumerate(structure.flags)}
    no_status = np.zeros(bad.size, dtype=np.int64)
    run = Call(program.tables, dtype(program), bits, state, no_status)
    with np.errstate(all="ignore"):
        for entry in structure.inputs:
            safe = np.where(bad, 0, inputs[entry.name]).astype(run.number)
            run.values[entry.name] = entry.value(run, safe)
        for step in structure.steps:
            run.values[step.name] = step.value(run)
    fresh = {o.name: run.values[o.source] for o in structure.outputs}
    status = np.where(bad, INVALID, run.status)
    if state is None:
        outputs = {
            name: np.where(bad, np.nan, words).astype(words.dtype) for name, words in fresh.items()
        }
        return TwinResult(outputs, status, None)
    outputs = {
        name: np.where(bad, state.last_outputs[name], words) for name, words in fresh.items()
    }
    after = replace(
        state,
        values={
            m.name: np.where(bad, state.values[m.name], run.values[m.source])
            for m in structure.memories
        },
        histories={
            name: np.where(bad, state.histories[name], rows) for name, rows in run.histories.items()
        },
        updates=np.where(bad, state.updates, state.updates + 1),
        last_outputs=outputs,
    )
    return TwinResult(outputs, status, after)


def find_refused(inputs: Mapping[str, Words]) -> Words:
    """Whether an input is no number, in each lane."""
    return np.asarray(np.any([~np.isfinite(words) for words in inputs.values()], axis=0))


def dtype(program: Program) -> Any:  # noqa: ANN401 (a numpy type)
    """Type that lanes are kept in."""
    return np.float32 if program.format.bits == 24 else np.float64

"""What the firmware computes, bit for bit, in numpy: the same operations on the same words in the
same order.

Bit for bit holds for C that is compiled without contraction to fused multiply-add
(`-ffp-contract=off`). Every value is an array over lanes, so that one call
runs many instants of a chain without memory, or many devices.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibkit.firmware.chain import (
    ChainInput,
    ChainTerm,
    Limit,
    Map,
    Memory,
    Play,
    Quotient,
    Select,
    Slope,
    Step,
    Sum,
)
from calibkit.firmware.program import Program

Words: TypeAlias = NDArray[Any]
"""Floats of the program's format."""

INVALID = 1 << 15
"""Status of an input that is no number."""


@dataclass(frozen=True, slots=True)
class State:
    """What a chain keeps from update to update."""

    values: Mapping[str, Words]
    histories: Mapping[str, Words]
    """Last values of each slope's source, the newest first."""
    updates: Words
    last_outputs: Mapping[str, Words]
    """Last outputs, which an invalid input leaves as they were."""
    before: Mapping[str, Words]
    """Outputs of the update before."""
    inputs: Mapping[str, Words]
    """Last inputs that were used."""
    waited_ms: Words
    """Since the last used inputs, and half an interval."""


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
    bad = find_refused(inputs)
    with np.errstate(all="ignore"):
        run = _Run(program, state, np.zeros(bad.size, dtype=np.int64))
        for entry in program.structure.inputs:
            safe = np.where(bad, 0, inputs[entry.name]).astype(dtype(program))
            run.values[entry.name] = run.input(entry, safe)
        for step in program.structure.steps:
            run.values[step.name] = run.step(step)
    fresh = {o.name: run.values[o.source] for o in program.structure.outputs}
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
            for m in program.structure.memories
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


class _Run:
    """One call while it runs: values by name, status, and the status of each side of a
    selection.
    """

    def __init__(self, program: Program, state: State | None, status: Words) -> None:
        self.program, self.state, self.status = program, state, status
        self.values: dict[str, Words] = {}
        self.sides: dict[str, Words] = {}
        self.histories: dict[str, Words] = {}
        self.bits = {flag: 1 << k for k, flag in enumerate(program.structure.flags)}

    def numbers(self, table: str) -> list[Any]:
        """Numbers of a table in the type of the lanes."""
        return [dtype(self.program)(x) for x in self.program.tables[table]]

    def flag(self, name: str, lanes: Words, group: str) -> None:
        """Raise a status on some lanes."""
        if not name:
            return
        raised = np.where(lanes, self.bits[name], 0)
        if group:
            self.sides[group] = self.sides.get(group, np.zeros_like(self.status)) | raised
        else:
            self.status = self.status | raised

    def limited(self, x: Words, low: Any, high: Any, flag: str, group: str) -> Words:  # noqa: ANN401
        """Bring a value into a range; raises the flag where it was outside."""
        self.flag(flag, (x < low) | (x > high), group)
        return np.where(x < low, low, np.where(x > high, high, x))

    def input(self, entry: ChainInput, x: Words) -> Words:
        """A value brought into its range; an indication as it is."""
        low, high = self.numbers(entry.table)
        if not entry.beyond:
            return self.limited(x, low, high, entry.flag, "")
        self.flag(entry.beyond, (x < low) | (x > high), "")
        return x

    def step(self, step: Step) -> Words:  # noqa: PLR0911 (one return per kind of step)
        """Value of one step."""
        match step:
            case Map():
                return self.map(step)
            case Sum():
                return self.sum(step)
            case Limit():
                low, high = self.numbers(step.table)
                return self.limited(self.values[step.source], low, high, step.flag, "")
            case Quotient():
                return self.quotient(step)
            case Memory():
                return self.memory(step)
            case Play():
                return self.play(step)
            case Slope():
                return self.slope(step)
            case Select():
                return self.select(step)

    def map(self, step: Map) -> Words:
        """U = (x − middle)/half, brought into its range."""
        middle, reciprocal, low, high = self.numbers(step.table)
        u = (self.values[step.source] - middle) * reciprocal
        return self.limited(u, low, high, step.flag, step.group)

    def sum(self, step: Sum) -> Words:
        """Terms from left to right."""
        total = self.term(step.terms[0])
        for entry in step.terms[1:]:
            total = total + self.term(entry)
        return total

    def term(self, entry: ChainTerm) -> Words:
        """One term."""
        factors = [self.values[name] for name in entry.factors]
        value = self.polynomial(entry) if entry.table else factors.pop(0)
        for factor in factors:
            value = value * factor
        return -value if entry.sign < 0 else value

    def polynomial(self, entry: ChainTerm) -> Words:
        """Horner's scheme from the highest power down."""
        *lower, total = self.numbers(entry.table)
        if not entry.over:
            return np.full(self.status.shape, total)
        x = self.values[entry.over]
        total = np.full(x.shape, total)
        for c in reversed(lower):
            total = total * x + c
        return np.asarray(total)

    def quotient(self, step: Quotient) -> Words:
        """Quotient."""
        return np.asarray(self.values[step.numerator] / self.values[step.denominator])

    def memory(self, step: Memory) -> Words:
        """Value of the update before."""
        assert self.state is not None  # noqa: S101 (a chain with memory is called with its state)
        remembered = self.state.values[step.name]
        return (
            np.where(self.state.updates == 0, self.values[step.source], remembered)
            if step.start == "same"
            else remembered
        )

    def play(self, step: Play) -> Words:
        """What is kept, brought to within the distances of the source."""
        low, high = self.numbers(step.table)
        x, previous = self.values[step.source], self.values[step.kept]
        return self.limited(previous, x + low, x + high, "", "")

    def slope(self, step: Slope) -> Words:
        """Rate over the values that are kept."""
        assert self.state is not None  # noqa: S101 (as above)
        history = np.vstack(
            [self.values[step.source][None, :], self.state.histories[step.name][:-1]]
        )
        self.histories[step.name] = history
        count = np.minimum(self.state.updates + 1, step.length)
        self.flag(step.flag, count < step.least, "")
        weights = np.array(self.numbers(step.table)).reshape(-1, step.length - 1)
        row = weights[np.maximum(count - step.least, 0)]
        total = np.zeros_like(history[0])
        for i in range(1, step.length):
            product = row[:, i - 1] * (history[i] - history[0])
            total = np.where(i < count, total + product, total)
        return np.asarray(np.where(count < step.least, np.zeros_like(total), total))

    def select(self, step: Select) -> Words:
        """Value of the first side that holds."""
        source = self.values[step.source]
        total = np.zeros_like(self.values[step.cases[0].value])
        undecided = np.ones(source.shape, dtype=bool)
        for case in step.cases:
            (threshold,) = self.numbers(case.table)
            up, down = source >= threshold, source <= -threshold
            lanes = undecided & {1: up, -1: down, 0: up | down}[case.side]
            total = np.where(lanes, self.values[case.value], total)
            side = self.sides.get(case.group, np.zeros_like(self.status))
            self.status = self.status | np.where(lanes, side, 0)
            undecided = undecided & ~lanes
        self.flag(step.flag, undecided, "")
        return total

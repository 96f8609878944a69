"""What the firmware computes, bit for bit, in numpy: the same operations on the same words in the
same order.

Bit for bit holds for C that is compiled without contraction to fused multiply-add
(`-ffp-contract=off`); fixed point has none. Every value is an array over lanes, so that one call
runs many instants of a chain without memory, or many devices.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibkit.arrays import Array
from calibkit.firmware.chain import (
    Input,
    Limit,
    Map,
    Memory,
    Play,
    Quotient,
    Select,
    Slope,
    Step,
    Sum,
    Term,
)
from calibkit.firmware.program import Program

Words: TypeAlias = NDArray[Any]
"""Floats of the program's format, or words of a fixed-point format as int64."""

INVALID = 1 << 15
"""Status of an input that is no number."""


@dataclass(frozen=True, slots=True)
class State:
    """What a chain keeps from update to update."""

    values: Mapping[str, Words]
    histories: Mapping[str, Words]
    """Last values of each slope's source, the newest first."""
    updates: Words
    held: Mapping[str, Words]
    """Last outputs, which an invalid input leaves as they were."""
    before: Mapping[str, Words]
    """Outputs of the update before."""
    inputs: Mapping[str, Words]
    """Last inputs that were used."""
    waited_ms: Words
    """Since the last used inputs, and half an interval."""


@dataclass(frozen=True, slots=True)
class Result:
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


def encode(program: Program, name: str, physical: Array) -> Words:
    """Words that an application hands over for physical values of an input; what does not fit
    becomes the nearest word that does.
    """
    if not program.format.fixed:
        return np.asarray(physical, dtype=dtype(program))
    none = program.format.no_number
    most = -none - 1
    scaled = np.rint(np.asarray(physical, dtype=np.float64) * 2.0 ** program.scales[name])
    finite = np.nan_to_num(scaled, nan=0.0, posinf=most, neginf=-most)
    return np.where(np.isnan(scaled), none, np.clip(finite, -most, most).astype(np.int64))


def decode(program: Program, name: str, words: Words) -> Array:
    """Physical values of an output; NaN for the word that stands for no number."""
    if not program.format.fixed:
        return np.asarray(words, dtype=np.float64)
    physical = words.astype(np.float64) * 2.0 ** -program.scales[f"out.{name}"]
    return np.where(words == program.format.no_number, np.nan, physical)


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


def call(program: Program, inputs: Mapping[str, Words], state: State | None = None) -> Result:
    """One call of the firmware's function on lanes of inputs [n]; a chain with memory needs its
    state.
    """
    bad = find_refused(program, inputs)
    with np.errstate(all="ignore"):
        run = _Run(program, state, np.zeros(bad.size, dtype=np.int64))
        for entry in program.structure.inputs:
            safe = np.where(bad, 0, inputs[entry.name]).astype(dtype(program))
            run.values[entry.name] = run.input(entry, safe)
        for step in program.structure.steps:
            run.values[step.name] = run.step(step)
    fresh = {o.name: run.out(o.name, o.source) for o in program.structure.outputs}
    status = np.where(bad, INVALID, run.status)
    if state is None:
        none = program.format.no_number if program.format.fixed else np.nan
        outputs = {
            name: np.where(bad, none, words).astype(words.dtype) for name, words in fresh.items()
        }
        return Result(outputs, status, None)
    outputs = {name: np.where(bad, state.held[name], words) for name, words in fresh.items()}
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
        held=outputs,
    )
    return Result(outputs, status, after)


def find_refused(program: Program, inputs: Mapping[str, Words]) -> Words:
    """Whether an input is no number, in each lane."""
    if program.format.fixed:
        invalid = [words == program.format.no_number for words in inputs.values()]
    else:
        invalid = [~np.isfinite(words) for words in inputs.values()]
    return np.asarray(np.any(invalid, axis=0))


def dtype(program: Program) -> Any:  # noqa: ANN401 (a numpy type)
    """Type that lanes are kept in."""
    if program.format.fixed:
        return np.int64
    return np.float32 if program.format.bits == 24 else np.float64


class _Run:
    """One call while it runs: values by name, status, and the status of each side of a
    selection.
    """

    def __init__(self, program: Program, state: State | None, status: Words) -> None:
        self.program, self.state, self.status = program, state, status
        self.fixed = program.format.fixed
        self.values: dict[str, Words] = {}
        self.sides: dict[str, Words] = {}
        self.histories: dict[str, Words] = {}
        self.bits = {flag: 1 << k for k, flag in enumerate(program.structure.flags)}

    def numbers(self, table: str) -> list[Any]:
        """Numbers of a table in the type of the lanes."""
        return [dtype(self.program)(x) for x in self.program.tables[table]]

    def flag(self, name: str, where: Words, group: str) -> None:
        """Raise a status on some lanes."""
        if not name:
            return
        raised = np.where(where, self.bits[name], 0)
        if group:
            self.sides[group] = self.sides.get(group, np.zeros_like(self.status)) | raised
        else:
            self.status = self.status | raised

    def limited(self, x: Words, low: Any, high: Any, flag: str, group: str) -> Words:  # noqa: ANN401
        """Bring a value into a range; raises the flag where it was outside."""
        self.flag(flag, (x < low) | (x > high), group)
        return np.where(x < low, low, np.where(x > high, high, x))

    def input(self, entry: Input, x: Words) -> Words:
        """A value brought into its range; an indication as it is, in fixed point up to its full
        scale.
        """
        low, high, *full = self.numbers(entry.table)
        if not entry.beyond:
            return self.limited(x, low, high, entry.flag, "")
        self.flag(entry.beyond, (x < low) | (x > high), "")
        return self.limited(x, full[0], full[1], entry.flag, "") if full else x

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
        if self.fixed:
            u = _rounded(u, self.program.map_places(step))
        return self.limited(u, low, high, step.flag, step.group)

    def sum(self, step: Sum) -> Words:
        """Terms from left to right."""
        total = self.term(step, 0, step.terms[0])
        for number, entry in enumerate(step.terms[1:], start=1):
            total = total + self.term(step, number, entry)
        return total

    def term(self, step: Sum, number: int, entry: Term) -> Words:
        """One term, at the scale of its sum."""
        scales, factors = self.program.scales, list(enumerate(entry.factors, start=1))
        if entry.table:
            value, scale = self.polynomial(entry), scales.get(entry.table, 0)
        else:
            (_, first), *factors = factors
            value, scale = self.values[first], scales.get(first, 0)
        if not self.fixed:
            for _, name in factors:
                value = value * self.values[name]
            return -value if entry.sign < 0 else value
        for k, name in factors:
            target = scales[f"{step.name}.{number}.{k}"]
            value, scale = (
                _rounded(value * self.values[name], scale + scales[name] - target),
                target,
            )
        value = _rounded(value, scale - scales[step.name])
        return -value if entry.sign < 0 else value

    def polynomial(self, entry: Term) -> Words:
        """Horner's scheme from the highest power down."""
        *lower, total = self.numbers(entry.table)
        if not entry.over:
            return np.full(self.status.shape, total)
        x = self.values[entry.over]
        total = np.full(x.shape, total)
        for c in reversed(lower):
            total = total * x
            if self.fixed:
                total = _rounded(total, self.program.scales[entry.over])
            total = total + c
        return np.asarray(total)

    def quotient(self, step: Quotient) -> Words:
        """Quotient, in fixed point cut off towards 0."""
        n, d = self.values[step.numerator], self.values[step.denominator]
        if not self.fixed:
            return np.asarray(n / d)
        places = self.program.quotient_places(step)
        return np.asarray(np.sign(n) * np.sign(d) * ((np.abs(n) << places) // np.abs(d)))

    def memory(self, step: Memory) -> Words:
        """Value of the update before."""
        assert self.state is not None  # noqa: S101 (a chain with memory is called with its state)
        kept = self.state.values[step.name]
        return (
            np.where(self.state.updates == 0, self.values[step.source], kept)
            if step.start == "same"
            else kept
        )

    def play(self, step: Play) -> Words:
        """What is kept, brought to within the distances of the source."""
        low, high = self.numbers(step.table)
        x, kept = self.values[step.source], self.values[step.kept]
        if self.fixed:
            x = _rounded(x, self.program.scales[step.source] - self.program.scales[step.name])
        return self.limited(kept, x + low, x + high, "", "")

    def slope(self, step: Slope) -> Words:
        """Rate over the values that are kept."""
        assert self.state is not None  # noqa: S101 (as above)
        kept = np.vstack([self.values[step.source][None, :], self.state.histories[step.name][:-1]])
        self.histories[step.name] = kept
        count = np.minimum(self.state.updates + 1, step.length)
        self.flag(step.flag, count < step.least, "")
        weights = np.array(self.numbers(step.table)).reshape(-1, step.length - 1)
        row = weights[np.maximum(count - step.least, 0)]
        total = np.zeros_like(kept[0])
        for i in range(1, step.length):
            product = row[:, i - 1] * (kept[i] - kept[0])
            if self.fixed:
                product = _rounded(product, self.program.slope_places(step))
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
            here = undecided & {1: up, -1: down, 0: up | down}[case.side]
            value = self.values[case.value]
            if self.fixed:
                value = _rounded(
                    value, self.program.scales[case.value] - self.program.scales[step.name]
                )
            total = np.where(here, value, total)
            side = self.sides.get(case.group, np.zeros_like(self.status))
            self.status = self.status | np.where(here, side, 0)
            undecided = undecided & ~here
        self.flag(step.flag, undecided, "")
        return total

    def out(self, name: str, source: str) -> Words:
        """An output at its own scale."""
        if not self.fixed:
            return self.values[source]
        most = -self.program.format.no_number - 1
        places = self.program.scales[source] - self.program.scales[f"out.{name}"]
        return np.clip(_rounded(self.values[source], places), -most, most)


def _rounded(x: Words, places: int) -> Words:
    """Word x · 2^−places, halves up; the exact product by a power of two where places < 0."""
    if places <= 0:
        return x << -places
    return (x + (1 << (places - 1))) >> places

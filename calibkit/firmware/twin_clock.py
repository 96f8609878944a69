"""What the firmware of a chain with memory computes by the clock, bit for bit: gaps bridged, jumps
left out, and rows of updates in turn.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from calibkit.firmware import twin
from calibkit.firmware.chain import Program
from calibkit.firmware.lanes import State, Words
from calibkit.firmware.twin import TwinResult
from calibkit.numeric.arrays import Integers

LONGEST_MS = 2**32 - 1
"""Milliseconds that a counter of 32 bits holds."""


def update(
    program: Program, inputs: Mapping[str, Words], elapsed_ms: Integers, state: State
) -> TwinResult:
    """One call of the firmware's update on lanes of inputs [n], so many milliseconds [n] after the
    call before: intervals without a usable input are bridged in a straight line.
    """
    structure, pace = program.structure, program.structure.pace
    assert pace is not None  # noqa: S101 (a chain that keeps time)
    bits = {flag: 1 << k for k, flag in enumerate(structure.flags)}
    starting, off_interval, jumped = (bits[flag] for flag in pace.flags)
    length, first = structure.interval_ms, state.updates == 0
    waited = np.minimum(state.waited_ms + elapsed_ms, LONGEST_MS)
    waited = np.where(first, length + length // 2, waited)
    count, bad = waited // length, twin.find_refused(inputs)
    safe = {name: np.where(bad, state.inputs[name], words) for name, words in inputs.items()}
    late = count > pace.longest
    jump = ~bad & ~first & ~late & (count > 0) & _jumps(program, safe, count, state)
    used = ~bad & ~jump & (count > 0)
    status = np.where(
        bad, twin.INVALID, np.where(jump, jumped, np.where(count == 0, off_interval, 0))
    )
    lags = {memory.name for memory in structure.memories if memory.source in pace.lags}
    after = _restarted(state, lags, used & late)
    steps = np.where(late, 1, np.maximum(count, 1))
    for k in range(1, int(np.max(np.where(used, steps, 0), initial=0)) + 1):
        lanes = used & (k <= steps)
        result = twin.call(program, _between(program, state.inputs, safe, k, steps), after)
        after = _chosen(lanes, result, after)
        status = np.where(lanes, result.status, status)
    settling_updates = int(program.tables[pace.table][0])
    uneven = ~first & ((count != 1) | (np.abs(elapsed_ms - length) > length // 8))
    status = status | np.where(used & uneven, off_interval, 0)
    status = status | np.where(used & (after.updates <= settling_updates), starting, 0)
    before = {
        name: np.where(
            used & first,
            after.last_outputs[name],
            np.where(count == 0, old, state.last_outputs[name]),
        )
        for name, old in state.before.items()
    }
    after = replace(
        after,
        before=before,
        inputs={name: np.where(used, safe[name], words) for name, words in state.inputs.items()},
        waited_ms=np.where(used, waited % length, waited),
    )
    return TwinResult(after.last_outputs, status, after)


def _jumps(program: Program, inputs: Mapping[str, Words], count: Words, state: State) -> Words:
    """Whether the followed input moved further than so many intervals allow."""
    pace = program.structure.pace
    assert pace is not None  # noqa: S101 (as above)
    kind = twin.dtype(program)
    move = inputs[pace.followed].astype(kind) - state.inputs[pace.followed].astype(kind)
    largest_move = kind(program.tables[pace.table][1]) * count.astype(kind)
    return np.asarray((move < -largest_move) | (move > largest_move))


def _between(
    program: Program, before: Mapping[str, Words], inputs: Mapping[str, Words], k: int, count: Words
) -> dict[str, Words]:
    """Inputs of the k-th of so many intervals, in a straight line from those before."""
    inputs_between = {}
    for name, words in inputs.items():
        kind = twin.dtype(program)
        start, end = before[name].astype(kind), words.astype(kind)
        part = (end - start) * (kind(k) / count.astype(kind))
        inputs_between[name] = np.where(k == count, end, start + part)
    return inputs_between


def _restarted(state: State, lags: Collection[str], lanes: Words) -> State:
    """State in which lags are at rest on some lanes, and the updates counted anew."""
    values = {
        name: np.where(lanes, 0, words).astype(words.dtype) if name in lags else words
        for name, words in state.values.items()
    }
    return replace(state, values=values, updates=np.where(lanes, 0, state.updates))


def _chosen(lanes: Words, result: TwinResult, before: State) -> State:
    """State after a call on some lanes, before it on the others."""
    after = result.after

    def chosen(new: Mapping[str, Words], old: Mapping[str, Words]) -> dict[str, Words]:
        return {name: np.where(lanes, words, old[name]) for name, words in new.items()}

    return replace(
        before,
        values=chosen(after.values, before.values),
        histories=chosen(after.histories, before.histories),
        updates=np.where(lanes, after.updates, before.updates),
        last_outputs=chosen(after.last_outputs, before.last_outputs),
    )


def run_in_turn(
    program: Program,
    inputs: Mapping[str, Words],
    updates: Sequence[int],
    elapsed_ms: Sequence[int] = (),
    *,
    anew: bool = False,
) -> Iterator[TwinResult]:
    """Last result of each row of inputs [n] of a chain with memory, which lasts as many updates as
    stated; from a reset on, Rows with no time between the calls
    take the steps without the clock, `anew` each from a reset.
    """
    state = twin.reset(program, 1)
    for k, (count, elapsed) in enumerate(zip_longest(updates, elapsed_ms, fillvalue=0)):
        if anew and not elapsed:
            state = twin.reset(program, 1)
        row = {name: words[k : k + 1] for name, words in inputs.items()}
        for _ in range(count):
            if elapsed:
                result = update(program, row, np.array([elapsed]), state)
            else:
                result = twin.call(program, row, state)
            state = result.after
        yield result

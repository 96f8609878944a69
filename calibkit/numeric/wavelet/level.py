"""One level of the lifting transform, forth and back, in blocks that stay in the cache.

Compiled steps (native/lifting.c) do it where they were built. They take every sum and product in
the order and with the rounding of the array steps: the numbers are the same, bit for bit.
"""

import ctypes
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.native import kernels_for
from calibkit.numeric.wavelet.extension import Continuation, continue_signal
from calibkit.numeric.wavelet.factor import Scheme
from calibkit.numeric.wavelet.reach import (
    Move,
    Pass,
    Span,
    covering_pairs,
    cut_span,
    intersection,
    made_of,
    passes,
    sources,
)
from calibkit.numeric.wavelet.shrinkage import Shrinkage

BLOCK = 1 << 15
"""Pairs of samples that go through the lifting steps at a time: their buffers stay in a
second-level cache.
"""
NOTHING = Continuation("constant", 0.0, 0.0)
"""Of samples that reach as far as the filters."""
CODES = {"soft": 1, "hard": 2, "garrote": 3, "firm": 4}
"""Shrinkage rules as the compiled steps number them; 0 leaves details as they are."""
WIDEST = 256
"""Reach of the steps beyond a block of pairs that the compiled steps have memory for; known
wavelets have 50.
"""


def analyse_level(
    values: Array,
    first: int,
    scheme: Scheme,
    span: Span,
    beyond: Continuation,
    outputs: tuple[tuple[Array, int], ...],
) -> None:
    """One level: coefficients of the given indices, from values whose element 0 has the index
    `first`.

    Approximation and details go into arrays whose element 0 has a stated index; those outside of
    them are dropped.
    """
    (low, at_low), (high, at_high) = outputs
    plans, library = encoded(scheme), kernels_for(values, low, high)
    if library is None or plans is None:
        _analyse_arrays(values, first, scheme, span, beyond, outputs)
        return
    blocks = cut_span(span, BLOCK)
    inner = intersection(span, made_of(scheme, (first, first + values.size)))
    if inner[0] < inner[1]:  # what no extension touches goes through at once
        before, behind = (span[0], inner[0]), (inner[1], span[1])
        blocks = [inner, *cut_span(before, BLOCK), *cut_span(behind, BLOCK)]
    for block in blocks:
        start, stop = sources(scheme, block)
        part = continue_signal(values, start - first, stop - first, beyond)
        library.calibkit_analysed(
            *plans[0], part.ctypes.data, start, *block,
            low.ctypes.data, at_low, low.size, high.ctypes.data, at_high, high.size,
        )  # fmt: skip


def synthesise_level(
    channels: tuple[Array, Array],
    scheme: Scheme,
    first: int,
    span: Span,
    shrink: tuple[Callable[[int, Array], Array] | None, int],
    out: Array,
) -> None:
    """One level back: the values of the given indices, from coefficients whose element 0 has the
    index `first`.

    `shrink` is what makes the details to be used of those given, and the level that it is given;
    None takes them as they are.
    """
    plans, library = encoded(scheme), kernels_for(*channels, out)
    if library is None or plans is None:
        _synthesise_arrays(channels, scheme, first, span, shrink, out)
        return
    (low, high), (treat, level) = channels, shrink
    rule = None if treat is None else _encoded_rule(treat, level)
    if treat is not None and rule is None:
        high = np.ascontiguousarray(treat(level, high), dtype=np.float64)
    library.calibkit_synthesised(
        *plans[1], low.ctypes.data, high.ctypes.data, first, *covering_pairs(scheme, span),
        *(rule or (0, 0.0, 0.0)), out.ctypes.data, span[0], out.size,
    )  # fmt: skip


def analyse_levels(scheme: Scheme, operations: Integers, room: Array) -> None:
    """Analyses one after the other in one array of memory; native/lifting.c says what the numbers
    of an operation [m, 10] are.
    """
    plans, library = encoded(scheme), kernels_for(room)
    if library is not None and plans is not None:
        library.calibkit_analysed_levels(
            *plans[0], operations.ctypes.data, len(operations), room.ctypes.data
        )
        return
    for at, first, low, high, *outputs in operations.tolist():
        made = tuple(
            (room[out : out + size], origin) for out, origin, size in (outputs[:3], outputs[3:])
        )
        _analyse_arrays(room[at:], first, scheme, (low, high), NOTHING, made)


def synthesise_levels(
    scheme: Scheme, operations: Integers, room: Array, shrinkage: Shrinkage
) -> None:
    """Syntheses one after the other in one array of memory; native/lifting.c says what the numbers
    of an operation [m, 9] are.
    """
    plans, library = encoded(scheme), kernels_for(room)
    rules = [_encoded_rule(shrinkage, level) for level in range(shrinkage.thresholds.size)]
    if library is not None and plans is not None and all(rules):
        library.calibkit_synthesised_levels(
            *plans[1],
            operations.ctypes.data,
            len(operations),
            CODES[shrinkage.rule],
            shrinkage.thresholds.ctypes.data,
            room.ctypes.data,
        )
        return
    for low, high, first, _, _, level, out, origin, size in operations.tolist():
        channels, made = (room[low:], room[high:]), room[out : out + size]
        span = (origin, origin + size)
        _synthesise_arrays(channels, scheme, first, span, (shrinkage, level), made)


@cache
def encoded(scheme: Scheme) -> tuple[tuple[Any, Any], tuple[Any, Any]] | None:
    """Steps and factors of analysis and synthesis as native/lifting.c reads them; None where the
    steps reach farther than it has memory for.
    """
    forth, back = passes(scheme)
    if any(high - low > WIDEST for plan in (forth, back) for low, high in plan.reach):
        return None
    return _encoded_pass(scheme, forth), _encoded_pass(scheme, back)


def _encoded_pass(scheme: Scheme, plan: Pass) -> tuple[Any, Any]:
    """Numbers in the order that native/lifting.c states."""
    steps = [len(plan.moves), *plan.reach[0], *plan.reach[1], *scheme.shifts, scheme.parity]
    factors = [*scheme.gains, *(1.0 / gain for gain in scheme.gains)]
    for move in plan.moves:
        steps += [move.target, move.low, move.high, len(move.terms)]
        for tap, offsets in move.terms:
            steps += [len(offsets), *offsets]
            factors.append(tap)
    return (ctypes.c_int64 * len(steps))(*steps), (ctypes.c_double * len(factors))(*factors)


def _encoded_rule(
    shrink: Callable[[int, Array], Array], level: int
) -> tuple[int, float, float] | None:
    """Code, threshold and its square of a shrinkage that the compiled steps know; None for others.

    At a threshold of zero, soft shrinkage is left to the arrays: the sign of a zero is theirs to
    decide.
    """
    if not isinstance(shrink, Shrinkage):
        return None
    threshold = float(shrink.thresholds[level])
    if threshold > 0.0 or (threshold == 0.0 and shrink.rule != "soft"):
        return CODES[shrink.rule], threshold, threshold**2
    return None


def _analyse_arrays(
    values: Array,
    first: int,
    scheme: Scheme,
    span: Span,
    beyond: Continuation,
    outputs: tuple[tuple[Array, int], ...],
) -> None:
    """As `analyse_level`, block by block, where there are no compiled steps."""
    plan, _ = passes(scheme)
    buffers, scratch = _buffers(plan, span)
    for block in cut_span(span, BLOCK):
        starts = (block[0] + plan.reach[0][0], block[0] + plan.reach[1][0])
        for c in (0, 1):
            size = block[1] + plan.reach[c][1] - starts[c]
            at = 2 * starts[c] + scheme.parity + c - first
            buffers[c][:size] = continue_signal(values, at, at + 2 * size - 1, beyond)[::2]
        _lift(buffers, starts, plan.moves, block, scratch)
        for c, (out, origin) in enumerate(outputs):
            low, high = max(block[0], origin), min(block[1], origin + out.size)
            if high > low:
                at = low + scheme.shifts[c] - starts[c]
                np.multiply(
                    buffers[c][at : at + high - low],
                    scheme.gains[c],
                    out=out[low - origin : high - origin],
                )


def _synthesise_arrays(
    channels: tuple[Array, Array],
    scheme: Scheme,
    first: int,
    span: Span,
    shrink: tuple[Callable[[int, Array], Array] | None, int],
    out: Array,
) -> None:
    """As `synthesise_level`, block by block, where there are no compiled steps."""
    treat, level = shrink
    _, plan = passes(scheme)
    whole = covering_pairs(scheme, span)
    buffers, scratch = _buffers(plan, whole)
    for block in cut_span(whole, BLOCK):
        starts = (block[0] + plan.reach[0][0], block[0] + plan.reach[1][0])
        for c, coefficients in enumerate(channels):
            size = block[1] + plan.reach[c][1] - starts[c]
            at = starts[c] - scheme.shifts[c] - first
            inputs = coefficients[at : at + size]
            if c == 1 and treat is not None:
                inputs = treat(level, inputs)
            np.multiply(inputs, 1.0 / scheme.gains[c], out=buffers[c][:size])
        _lift(buffers, starts, plan.moves, block, scratch)
        for c in (0, 1):
            # the first and the last pair may reach beyond the span by a sample
            origin = scheme.parity + c - span[0]
            low = max(block[0], -(origin // 2))
            high = min(block[1], (out.size - 1 - origin) // 2 + 1)
            made = buffers[c][low - starts[c] : high - starts[c]]
            out[2 * low + origin : 2 * high + origin : 2] = made


def _buffers(plan: Pass, span: Span) -> tuple[tuple[Array, Array], Array]:
    """Memory for both channels of a block with their reach, and for one term."""
    size = min(BLOCK, span[1] - span[0]) + max(high - low for low, high in plan.reach)
    return (np.empty(size), np.empty(size)), np.empty(size)


def _lift(
    channels: tuple[Array, Array], starts: Span, moves: Sequence[Move], block: Span, scratch: Array
) -> None:
    """Run lifting steps in place on a block of two channels whose first elements have the indices
    `starts`.
    """
    for move in moves:
        first = block[0] + move.low
        size = block[1] + move.high - first
        at = first - starts[move.target]
        target, term = channels[move.target][at : at + size], scratch[:size]
        source = channels[1 - move.target]
        for tap, offsets in move.terms:
            shifted = [
                source[k : k + size]
                for k in (first - starts[1 - move.target] + offset for offset in offsets)
            ]
            if len(shifted) == 1:
                np.multiply(shifted[0], tap, out=term)
            else:
                np.add(shifted[0], shifted[1], out=term)
                for more in shifted[2:]:
                    term += more
                term *= tap
            target += term

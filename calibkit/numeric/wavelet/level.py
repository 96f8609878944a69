"""One level of the lifting transform, forth and back, in blocks that stay in the cache."""

from collections.abc import Callable, Sequence

import numpy as np

from calibkit.arrays import Array
from calibkit.numeric.wavelet import compiled
from calibkit.numeric.wavelet.extension import Beyond, continued
from calibkit.numeric.wavelet.factor import Scheme
from calibkit.numeric.wavelet.reach import (
    Move,
    Pass,
    Span,
    both,
    cut,
    made_of,
    pairs,
    passes,
    sources,
)

BLOCK = 1 << 15
"""Pairs of samples that go through the lifting steps at a time: their buffers stay in a
second-level cache.
"""


def analysed(
    values: Array,
    first: int,
    scheme: Scheme,
    span: Span,
    beyond: Beyond,
    outputs: tuple[tuple[Array, int], ...],
) -> None:
    """One level: coefficients of the given indices, from values whose element 0 has the index
    `first`.

    Approximation and details go into arrays whose element 0 has a stated index; those outside of
    them are dropped.
    """
    library = compiled.library_for(scheme, values, outputs[0][0], outputs[1][0])
    if library is None:
        _analyse(values, first, scheme, span, beyond, outputs)
        return
    clear = made_of(scheme, (first, first + values.size))
    if clear[0] <= span[0] and clear[1] >= span[1]:
        compiled.analyse(library, values, first, scheme, span, outputs)
        return
    inner = both(span, clear)
    if inner[0] == inner[1]:
        inner = (span[1], span[1])
    else:
        compiled.analyse(library, values, first, scheme, inner, outputs)
    for block in (*cut((span[0], inner[0]), BLOCK), *cut((inner[1], span[1]), BLOCK)):
        start, stop = sources(scheme, block)
        compiled.analyse(
            library,
            continued(values, start - first, stop - first, beyond),
            start,
            scheme,
            block,
            outputs,
        )


def synthesised(
    channels: tuple[Array, Array],
    scheme: Scheme,
    first: int,
    span: Span,
    shrink: tuple[Callable[[int, Array], Array] | None, int],
    out: Array,
) -> None:
    """One level back: the values of the given indices, from coefficients whose element 0 has the
    index `first`.

    `shrink` is what makes the details to be used of those given, and the level that it is told;
    None takes them as they are.
    """
    treat, level = shrink
    library = compiled.library_for(scheme, *channels, out)
    if library is None:
        _synthesise(channels, scheme, first, span, shrink, out)
        return
    rule = None if treat is None else compiled.rule_of(treat, level)
    if treat is not None and rule is None:
        channels = (channels[0], np.ascontiguousarray(treat(level, channels[1]), dtype=np.float64))
    compiled.synthesise(
        library, channels, first, scheme, pairs(scheme, span), rule or (0, 0.0, 0.0), (out, span[0])
    )


def _analyse(
    values: Array,
    first: int,
    scheme: Scheme,
    span: Span,
    beyond: Beyond,
    outputs: tuple[tuple[Array, int], ...],
) -> None:
    """Coefficients of the given indices, block by block."""
    plan, _ = passes(scheme)
    room, scratch = _buffers(plan, span)
    for block in cut(span, BLOCK):
        starts = (block[0] + plan.reach[0][0], block[0] + plan.reach[1][0])
        for c in (0, 1):
            size = block[1] + plan.reach[c][1] - starts[c]
            at = 2 * starts[c] + scheme.parity + c - first
            room[c][:size] = continued(values, at, at + 2 * size - 1, beyond)[::2]
        _lifted(room, starts, plan.moves, block, scratch)
        for c, (out, origin) in enumerate(outputs):
            low, high = max(block[0], origin), min(block[1], origin + out.size)
            if high > low:
                at = low + scheme.shifts[c] - starts[c]
                np.multiply(
                    room[c][at : at + high - low],
                    scheme.gains[c],
                    out=out[low - origin : high - origin],
                )


def _synthesise(
    channels: tuple[Array, Array],
    scheme: Scheme,
    first: int,
    span: Span,
    shrink: tuple[Callable[[int, Array], Array] | None, int],
    out: Array,
) -> None:
    """Values of the given indices, block by block."""
    treat, level = shrink
    _, plan = passes(scheme)
    whole = pairs(scheme, span)
    room, scratch = _buffers(plan, whole)
    for block in cut(whole, BLOCK):
        starts = (block[0] + plan.reach[0][0], block[0] + plan.reach[1][0])
        for c, coefficients in enumerate(channels):
            size = block[1] + plan.reach[c][1] - starts[c]
            at = starts[c] - scheme.shifts[c] - first
            inputs = coefficients[at : at + size]
            if c == 1 and treat is not None:
                inputs = treat(level, inputs)
            np.multiply(inputs, 1.0 / scheme.gains[c], out=room[c][:size])
        _lifted(room, starts, plan.moves, block, scratch)
        for c in (0, 1):
            # the first and the last pair may reach beyond the span by a sample
            origin = scheme.parity + c - span[0]
            low, high = (
                max(block[0], -(origin // 2)),
                min(block[1], (out.size - 1 - origin) // 2 + 1),
            )
            out[2 * low + origin : 2 * high + origin : 2] = room[c][
                low - starts[c] : high - starts[c]
            ]


def _buffers(plan: Pass, span: Span) -> tuple[tuple[Array, Array], Array]:
    """Room for both channels of a block with their reach, and for one term."""
    size = min(BLOCK, span[1] - span[0]) + max(high - low for low, high in plan.reach)
    return (np.empty(size), np.empty(size)), np.empty(size)


def _lifted(
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

"""The lifting wavelet transform: schemes by name, analysis and synthesis of signals of any length."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.extension import EXTENSIONS, Beyond, Extension, continued, end_values, extended
from calibkit.numeric.factor import LITERAL, Scheme, Step, factored
from calibkit.numeric.spans import release

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Room = Callable[[int], Array]

__all__ = [
    "EXTENSIONS",
    "Decomposition",
    "Extension",
    "Scheme",
    "Step",
    "extended",
    "forward",
    "inverse",
    "scheme",
    "span",
    "untouched",
]

Span = tuple[int, int]
"""First index and one past the last."""

BLOCK = 1 << 15
"""Pairs of samples that go through the lifting steps at a time: their buffers stay in a second-level cache."""
CHUNK = 1 << 18
"""Samples that go through all levels at a time, so that approximations stay in the cache too."""
TOGETHER = 10
"""Levels that a chunk goes through; deeper ones start from the whole approximation of the tenth, a thousandth of the signal."""
COARSEST = 64
"""Coefficients of the coarsest level that a chunk has at least, many more than the filters read beyond its ends."""


@dataclass(frozen=True, slots=True)
class Decomposition:
    """A signal's wavelet coefficients, in the signal's unit, with what is needed to go back.

    Coefficient k of details[j] has index first[j] + k at level j + 1, index 0 lying at sample 0; there are a few more
    than length / 2^(j + 1), those that reach the signal from the extension. interior[j] selects the details whose
    filter lies wholly on the signal.
    """

    scheme: Scheme
    length: int
    extension: Extension
    approximation: Array
    details: tuple[Array, ...]
    first: tuple[int, ...]
    interior: tuple[slice, ...]


@dataclass(frozen=True, slots=True)
class _Move:
    """A lifting step on the target channel's indices start + low … stop + high − 1, taps of equal value joined."""

    target: int
    terms: tuple[tuple[float, tuple[int, ...]], ...]
    low: int
    high: int


@dataclass(frozen=True, slots=True)
class _Pass:
    """The steps of analysis or synthesis, and how far each channel must reach beyond the wanted pairs."""

    moves: tuple[_Move, ...]
    reach: tuple[Span, Span]


def scheme(name: str) -> Scheme:
    """Lifting scheme "haar", "cdf53", "cdf97", "db2", or any discrete PyWavelets wavelet, factored.

    Raises
    ------
    FitError : no such wavelet (with the nearest names), or a bank that cannot be factored well.
    """
    if name in LITERAL:
        return LITERAL[name]
    import pywt  # costs start-up that literal schemes don't need

    known = [*LITERAL, *pywt.wavelist(kind="discrete")]
    if name not in known:
        near = difflib.get_close_matches(name.lower().replace("/", "").replace(" ", ""), known, n=3, cutoff=0.5)
        raise FitError(
            f"unknown wavelet {name!r}",
            hint=f"did you mean {' or '.join(near)}?" if near else "use haar, cdf53, cdf97, db4, sym8 or the like",
        )
    return factored(name)


def forward(
    signal: Array, scheme: Scheme, levels: int, *, extension: Extension, room: Room = np.empty
) -> Decomposition:
    """Wavelet coefficients of a signal [n], any n ≥ 1, over a number of levels.

    Parameters
    ----------
    signal : [n], equidistant samples in any unit.
    extension : what stands beyond the ends (see `extended`).
    room : makes the arrays that details are put in; memory beyond them is that of a chunk.

    Raises
    ------
    FitError : an empty signal, no levels, an unknown extension.

    Notes
    -----
    The signal is extended once, by as many samples as the coefficients that reach it need, and the lifting steps run
    on the extended signal without any rule for boundaries, odd lengths or powers of two. `inverse` undoes every step
    with the very numbers it was done with, so that reconstruction is perfect for every scheme, extension and length.
    """
    samples = np.ascontiguousarray(signal, dtype=np.float64)
    if samples.ndim != 1 or samples.size == 0 or levels < 1:
        raise FitError(
            f"a signal of shape {np.shape(signal)} cannot be transformed over {levels} levels",
            hint="give at least one sample and one level",
        )
    if extension not in EXTENSIONS:
        raise FitError(f"unknown extension {extension!r}", hint=f"use one of {', '.join(EXTENSIONS)}")
    wanted = _spans(scheme, (0, samples.size), levels)
    needed = _needed(scheme, wanted)
    details = tuple(room(high - low) for low, high in wanted[1:])
    beyond = Beyond(extension, *end_values(samples, extension, 3 << (levels - 1)))
    values, first = samples, 0
    for above in range(0, levels, TOGETHER):
        below = min(above + TOGETHER, levels)
        approximation = np.empty(needed[below][1] - needed[below][0])
        for shares, spans in _chunks(scheme, needed[above : below + 1]):
            part, at = values, first
            for j, (share, span) in enumerate(zip(shares[1:], spans[1:], strict=True), start=above):
                own = _both(share, wanted[j + 1])
                placed = (details[j][_selected(own, wanted[j + 1])], own[0])
                part = _analysed(part, at, scheme, span, beyond, placed)
                at = span[0]
                release(samples, details[j])
            approximation[_selected(shares[-1], needed[below])] = part
        values, first = approximation, needed[below][0]
    clean, _ = untouched(scheme, samples.size, levels)
    return Decomposition(
        scheme,
        samples.size,
        extension,
        values,
        details,
        tuple(low for low, _ in wanted[1:]),
        tuple(_selected(indices, within) for indices, within in zip(clean[1:], wanted[1:], strict=True)),
    )


def inverse(
    decomposition: Decomposition, shrink: Callable[[int, Array], Array] | None = None, *, room: Room = np.empty
) -> Array:
    """Signal [n] from its wavelet coefficients, thresholded or not; `room` makes the array that it is put in.

    `shrink` makes of any stretch of the details of a level, 0 the finest, those to be used; it is called block by block
    while they are in the cache, for some of them twice, and must treat each detail by itself.

    Raises
    ------
    FitError : coefficients whose number is not that of the signal's length.
    """
    scheme, levels = decomposition.scheme, len(decomposition.details)
    wanted = _spans(scheme, (0, decomposition.length), levels)
    for (low, high), detail in zip(wanted[1:], decomposition.details, strict=True):
        if detail.shape != (high - low,) or decomposition.approximation.shape != (wanted[-1][1] - wanted[-1][0],):
            raise FitError(
                f"{detail.shape} details where {high - low} belong to {decomposition.length} samples",
                hint="change coefficients in place or by new values of the same number",
            )
    known = decomposition.approximation
    for above in range((levels - 1) // TOGETHER * TOGETHER, -1, -TOGETHER):
        below = min(above + TOGETHER, levels)
        out = room(wanted[above][1] - wanted[above][0])
        for chunk in _cut(wanted[above], max(CHUNK, COARSEST << (below - above))):
            parts = _spans(scheme, chunk, below - above)
            signal = known[_selected(parts[-1], wanted[below])]
            for level in range(below, above, -1):
                detail = decomposition.details[level - 1][_selected(parts[level - above], wanted[level])]
                span = parts[level - above - 1]
                made = out[_selected(chunk, wanted[above])] if level == above + 1 else np.empty(span[1] - span[0])
                treat = None if shrink is None else partial(shrink, level - 1)
                _synthesised((signal, detail), scheme, parts[level - above][0], span, treat, made)
                signal = made
            release(out, *decomposition.details)
        known = out
    return known


def span(scheme: Scheme, start: int, stop: int, levels: int) -> Span:
    """Samples that reach the reconstruction of samples start … stop − 1 through any of its coefficients."""
    wanted = _spans(scheme, (start, stop), levels)
    read = wanted[-1]
    for needed in wanted[-2::-1]:
        read = _hull(_sources(scheme, read), needed)
    return read


@lru_cache(maxsize=64)
def _spans(scheme: Scheme, samples: Span, levels: int) -> tuple[Span, ...]:
    """Indices of the coefficients that rebuild a range of samples, level by level; level 0 is the range itself."""
    _, plan = _passes(scheme)
    wanted = [samples]
    for _ in range(levels):
        low, high = _pairs(scheme, wanted[-1])
        wanted.append(
            (
                min(low + plan.reach[c][0] - scheme.shifts[c] for c in (0, 1)),
                max(high + plan.reach[c][1] - scheme.shifts[c] for c in (0, 1)),
            )
        )
    return tuple(wanted)


def _needed(scheme: Scheme, wanted: Sequence[Span]) -> list[Span]:
    """Indices of the approximations of all levels that the wanted coefficients are made of; level 0 goes beyond the signal."""
    needed = [wanted[-1]]
    for level in wanted[-2::-1]:
        needed.append(_hull(_sources(scheme, needed[-1]), level))
    return needed[::-1]


def _chunks(scheme: Scheme, wanted: Sequence[Span]) -> Iterator[tuple[list[Span], list[Span]]]:
    """Cut all levels at the same times: each chunk's share of the wanted indices, and the indices computed for it."""
    levels = len(wanted) - 1
    for coarsest in _cut(wanted[-1], max(CHUNK >> levels, COARSEST)):
        shares = []
        for level, (low, high) in enumerate(wanted):
            start = low if coarsest[0] == wanted[-1][0] else coarsest[0] << (levels - level)
            stop = high if coarsest[1] == wanted[-1][1] else coarsest[1] << (levels - level)
            shares.append((min(max(start, low), high), min(max(stop, low), high)))
        spans = [coarsest]
        for share in shares[-2::-1]:
            spans.append(_hull(_sources(scheme, spans[-1]), share))
        yield shares, spans[::-1]


@lru_cache(maxsize=64)
def untouched(scheme: Scheme, length: int, levels: int) -> tuple[tuple[Span, ...], Span]:
    """Indices of the coefficients that the extension does not touch, level by level, and of such samples rebuilt.

    Level 0 is the signal itself. An empty range has its end at or before its start.
    """
    forth, back = _passes(scheme)
    shift = scheme.shifts
    clean = [(0, length)]
    for _ in range(levels):
        low, high = clean[-1]
        clean.append(
            (
                max(-((scheme.parity + c - low) // 2) - forth.reach[c][0] for c in (0, 1)),
                min((high - 1 - scheme.parity - c) // 2 + 1 - forth.reach[c][1] for c in (0, 1)),
            )
        )
    low, high = clean[-1]
    for level in range(levels, 0, -1):
        low, high = max(low, clean[level][0]), min(high, clean[level][1])
        low = 2 * max(low + shift[c] - back.reach[c][0] for c in (0, 1)) + scheme.parity
        high = 2 * min(high + shift[c] - back.reach[c][1] for c in (0, 1)) + scheme.parity
    return tuple(clean), (max(low, 0), min(high, length))


def _sources(scheme: Scheme, outputs: Span) -> Span:
    """Indices of the level above that the analysis of the given indices reads."""
    plan, _ = _passes(scheme)
    return (
        min(2 * (outputs[0] + plan.reach[c][0]) + scheme.parity + c for c in (0, 1)),
        max(2 * (outputs[1] - 1 + plan.reach[c][1]) + scheme.parity + c + 1 for c in (0, 1)),
    )


def _hull(one: Span, other: Span) -> Span:
    """Smallest range that holds two ranges."""
    return min(one[0], other[0]), max(one[1], other[1])


def _both(one: Span, other: Span) -> Span:
    """Indices that two ranges share; an empty range has its end at its start."""
    low = max(one[0], other[0])
    return low, max(low, min(one[1], other[1]))


def _selected(indices: Span, within: Span) -> slice:
    """Elements of an array of the indices `within` that have the given indices."""
    low, high = max(indices[0], within[0]), min(indices[1], within[1])
    return slice(low - within[0], max(low, high) - within[0])


def _pairs(scheme: Scheme, samples: Span) -> Span:
    """Pairs (2i + parity, 2i + 1 + parity) that cover a range of samples."""
    return (samples[0] - scheme.parity) // 2, (samples[1] - 1 - scheme.parity) // 2 + 1


@cache
def _passes(scheme: Scheme) -> tuple[_Pass, _Pass]:
    """Analysis and synthesis as moves with their ranges, worked out from the outputs backwards."""
    reversed_steps = [Step(s.updates, s.first, tuple(-tap for tap in s.taps)) for s in reversed(scheme.steps)]
    return _planned(scheme.steps, scheme.shifts), _planned(reversed_steps, (0, 0))


def _planned(steps: Sequence[Step], shifts: Span) -> _Pass:
    """Ranges of every step, so that each channel is right over the wanted pairs (shifted) at the end."""
    reach = [[shift, shift] for shift in shifts]
    moves: list[_Move] = []
    for step in reversed(steps):
        target = 0 if step.updates == "approximation" else 1
        terms: dict[float, tuple[int, ...]] = {}
        for k, tap in enumerate(step.taps):
            terms[tap] = (*terms.get(tap, ()), step.first + k)
        low, high = reach[target]
        moves.append(_Move(target, tuple(terms.items()), low, high))
        source = reach[1 - target]
        source[0] = min(source[0], low + step.first)
        source[1] = max(source[1], high + step.first + len(step.taps) - 1)
    return _Pass(tuple(reversed(moves)), ((reach[0][0], reach[0][1]), (reach[1][0], reach[1][1])))


def _analysed(
    values: Array, first: int, scheme: Scheme, span: Span, beyond: Beyond, placed: tuple[Array, int]
) -> Array:
    """One level: approximation of the given indices, from values whose element 0 has the index `first`.

    The details of some of these indices go into an array whose element 0 has a stated index.
    """
    plan, _ = _passes(scheme)
    approximation = np.empty(span[1] - span[0])
    outputs = (approximation, span[0]), placed
    room, scratch = _buffers(plan, span)
    for block in _cut(span, BLOCK):
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
                np.multiply(room[c][at : at + high - low], scheme.gains[c], out=out[low - origin : high - origin])
    return approximation


def _synthesised(
    channels: tuple[Array, Array],
    scheme: Scheme,
    first: int,
    span: Span,
    treat: Callable[[Array], Array] | None,
    out: Array,
) -> None:
    """One level back: the values of the given indices, from coefficients whose element 0 has the index `first`."""
    _, plan = _passes(scheme)
    pairs = _pairs(scheme, span)
    room, scratch = _buffers(plan, pairs)
    for block in _cut(pairs, BLOCK):
        starts = (block[0] + plan.reach[0][0], block[0] + plan.reach[1][0])
        for c, coefficients in enumerate(channels):
            size = block[1] + plan.reach[c][1] - starts[c]
            at = starts[c] - scheme.shifts[c] - first
            inputs = coefficients[at : at + size]
            if c == 1 and treat is not None:
                inputs = treat(inputs)
            np.multiply(inputs, 1.0 / scheme.gains[c], out=room[c][:size])
        _lifted(room, starts, plan.moves, block, scratch)
        for c in (0, 1):
            # the first and the last pair may reach beyond the span by a sample
            origin = scheme.parity + c - span[0]
            low, high = max(block[0], -(origin // 2)), min(block[1], (out.size - 1 - origin) // 2 + 1)
            out[2 * low + origin : 2 * high + origin : 2] = room[c][low - starts[c] : high - starts[c]]


def _cut(span: Span, size: int) -> list[Span]:
    """Consecutive pieces of a range of indices, of the given size but for the last."""
    return [(low, min(low + size, span[1])) for low in range(span[0], span[1], size)]


def _buffers(plan: _Pass, span: Span) -> tuple[tuple[Array, Array], Array]:
    """Room for both channels of a block with their reach, and for one term."""
    size = min(BLOCK, span[1] - span[0]) + max(high - low for low, high in plan.reach)
    return (np.empty(size), np.empty(size)), np.empty(size)


def _lifted(channels: tuple[Array, Array], starts: Span, moves: Sequence[_Move], block: Span, scratch: Array) -> None:
    """Run lifting steps in place on a block of two channels whose first elements have the indices `starts`."""
    for move in moves:
        first = block[0] + move.low
        size = block[1] + move.high - first
        at = first - starts[move.target]
        target, term = channels[move.target][at : at + size], scratch[:size]
        source = channels[1 - move.target]
        for tap, offsets in move.terms:
            shifted = [source[k : k + size] for k in (first - starts[1 - move.target] + offset for offset in offsets)]
            if len(shifted) == 1:
                np.multiply(shifted[0], tap, out=term)
            else:
                np.add(shifted[0], shifted[1], out=term)
                for more in shifted[2:]:
                    term += more
                term *= tap
            target += term

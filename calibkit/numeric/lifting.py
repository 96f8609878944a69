"""The lifting wavelet transform: schemes by name, analysis and synthesis of signals of any length."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from calibkit.errors import FitError
from calibkit.numeric.factor import Scheme, Step, factored

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

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

Extension = Literal["symmetric", "antisymmetric", "trend", "constant", "periodic"]
EXTENSIONS: tuple[Extension, ...] = get_args(Extension)
Span = tuple[int, int]
"""First index and one past the last."""

BLOCK = 1 << 15
"""Output pairs worked on at a time: three buffers of them stay in a second-level cache."""

ROOT2, ROOT3 = math.sqrt(2.0), math.sqrt(3.0)
ALPHA, BETA, GAMMA, DELTA = -1.586134342059924, -0.052980118572961, 0.882911075530934, 0.443506852043971
ZETA = 1.149604398860241
"""CDF 9/7 lifting coefficients (Daubechies & Sweldens 1998, section 7.7; ISO/IEC 15444-1 annex F)."""

LITERAL = {
    literal.name: literal
    for literal in (
        Scheme("haar", (Step("detail", 0, (-1.0,)), Step("approximation", 0, (0.5,))), ROOT2, 1.0 / ROOT2),
        Scheme("cdf53", (Step("detail", 0, (-0.5, -0.5)), Step("approximation", -1, (0.25, 0.25))), ROOT2, 1.0 / ROOT2),
        Scheme(
            "cdf97",
            (
                Step("detail", 0, (ALPHA, ALPHA)),
                Step("approximation", -1, (BETA, BETA)),
                Step("detail", 0, (GAMMA, GAMMA)),
                Step("approximation", -1, (DELTA, DELTA)),
            ),
            ZETA,
            1.0 / ZETA,
        ),
        Scheme(
            "db2",
            (
                Step("detail", 0, (-ROOT3,)),
                Step("approximation", 0, (ROOT3 / 4.0, (ROOT3 - 2.0) / 4.0)),
                Step("detail", -1, (1.0,)),
            ),
            (ROOT3 + 1.0) / ROOT2,
            (ROOT3 - 1.0) / ROOT2,
        ),
    )
}
"""Schemes written out by hand; every other name is a PyWavelets bank that is factored."""


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


def forward(signal: Array, scheme: Scheme, levels: int, *, extension: Extension) -> Decomposition:
    """Wavelet coefficients of a signal [n], any n ≥ 1, over a number of levels.

    Parameters
    ----------
    signal : [n], equidistant samples in any unit.
    extension : what stands beyond the ends (see `extended`).

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
    wanted, computed = _spans(scheme, (0, samples.size), levels)
    details: list[Array] = []
    approximation, first = samples, 0
    for level in range(1, levels + 1):
        approximation, detail = _analysed(approximation, first, scheme, computed[level], extension, 3 << (levels - 1))
        first = computed[level][0]
        details.append(detail[wanted[level][0] - first : wanted[level][1] - first])
    clean, _ = untouched(scheme, samples.size, levels)
    return Decomposition(
        scheme,
        samples.size,
        extension,
        approximation,
        tuple(details),
        tuple(low for low, _ in wanted[1:]),
        tuple(_selected(indices, within) for indices, within in zip(clean[1:], wanted[1:], strict=True)),
    )


def inverse(decomposition: Decomposition) -> Array:
    """Signal [n] from its wavelet coefficients, thresholded or not.

    Raises
    ------
    FitError : coefficients whose number is not that of the signal's length.
    """
    scheme, levels = decomposition.scheme, len(decomposition.details)
    wanted, _ = _spans(scheme, (0, decomposition.length), levels)
    for (low, high), detail in zip(wanted[1:], decomposition.details, strict=True):
        if detail.shape != (high - low,) or decomposition.approximation.shape != (wanted[-1][1] - wanted[-1][0],):
            raise FitError(
                f"{detail.shape} details where {high - low} belong to {decomposition.length} samples",
                hint="change coefficients in place or by new values of the same number",
            )
    signal = decomposition.approximation
    for level in range(levels, 0, -1):
        signal = _synthesised(
            signal, decomposition.details[level - 1], scheme, first=wanted[level][0], span=wanted[level - 1]
        )
    return signal


def extended(signal: Array, start: int, stop: int, extension: Extension, window: int) -> Array:
    """Samples start … stop − 1 of a signal [n] that goes on beyond its ends.

    "symmetric" mirrors at the end samples, x(−k) = x(k); "antisymmetric" reflects in the end points,
    x(−k) = 2 x(0) − x(k), which keeps a linear trend but carries the noise of one sample into the whole extension;
    "trend" reflects in the value at the end of a straight line fitted to the last `window` samples, which keeps a
    linear trend and averages the noise (`forward` takes one and a half of the coarsest level's scale, 1.5 · 2^levels,
    as the window); "constant" holds the end values; "periodic" joins the two ends.
    """
    n = signal.size
    if start >= 0 and stop <= n:
        return signal[start:stop]
    at = np.arange(start, stop)
    if extension == "periodic":
        return signal[at % n]
    if extension == "constant":
        return signal[np.clip(at, 0, n - 1)]
    turns, phase = np.divmod(at, 2 * max(n - 1, 1))
    ahead = phase < n
    samples = signal[np.where(ahead, phase, np.minimum(2 * (n - 1) - phase, n - 1))]
    if extension == "symmetric":
        return samples
    left, right = (signal[0], signal[-1]) if extension == "antisymmetric" else _end_values(signal, window)
    return np.asarray(np.where(ahead, samples, 2.0 * right - samples) + 2.0 * turns * (right - left))


def _end_values(signal: Array, window: int) -> tuple[float, float]:
    """Values at the first and the last sample of straight lines fitted to `window` samples at each end."""
    size = min(max(window, 2), signal.size)
    offset = np.arange(size) - (size - 1) / 2.0
    spread = float(offset @ offset) or 1.0
    values = [
        float(np.mean(end)) - float(offset @ end) / spread * (size - 1) / 2.0
        for end in (signal[:size], signal[::-1][:size])
    ]
    return values[0], values[1]


def span(scheme: Scheme, start: int, stop: int, levels: int) -> Span:
    """Samples that reach the reconstruction of samples start … stop − 1 through any of its coefficients."""
    return _spans(scheme, (start, stop), levels)[1][0]


@lru_cache(maxsize=64)
def _spans(scheme: Scheme, signal: Span, levels: int) -> tuple[tuple[Span, ...], tuple[Span, ...]]:
    """Coefficient indices needed to rebuild the signal, level by level, and those computed on the way to them."""
    forth, back = _passes(scheme)
    shift = scheme.shifts
    wanted = [signal]
    for _ in range(levels):
        low, high = _pairs(scheme, wanted[-1])
        wanted.append(
            (
                min(low + back.reach[c][0] - shift[c] for c in (0, 1)),
                max(high + back.reach[c][1] - shift[c] for c in (0, 1)),
            )
        )
    computed = list(wanted)
    for level in range(levels, 0, -1):
        low, high = computed[level]
        first = min(2 * (low + forth.reach[c][0]) + scheme.parity + c for c in (0, 1))
        last = max(2 * (high - 1 + forth.reach[c][1]) + scheme.parity + c for c in (0, 1))
        computed[level - 1] = (min(first, wanted[level - 1][0]), max(last + 1, wanted[level - 1][1]))
    return tuple(wanted), tuple(computed)


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
    values: Array, first: int, scheme: Scheme, span: Span, extension: Extension, window: int
) -> tuple[Array, Array]:
    """One level: approximation and details of the given indices, from values whose element 0 has the index `first`."""
    plan, _ = _passes(scheme)
    outputs = np.empty(span[1] - span[0]), np.empty(span[1] - span[0])
    room, scratch = _buffers(plan, span)
    for low in range(span[0], span[1], BLOCK):
        block = (low, min(low + BLOCK, span[1]))
        starts = (low + plan.reach[0][0], low + plan.reach[1][0])
        for c in (0, 1):
            size = block[1] + plan.reach[c][1] - starts[c]
            at = 2 * starts[c] + scheme.parity + c - first
            room[c][:size] = extended(values, at, at + 2 * size - 1, extension, window)[::2]
        _lifted(room, starts, plan.moves, block, scratch)
        for c in (0, 1):
            at = low + scheme.shifts[c] - starts[c]
            out = outputs[c][low - span[0] : block[1] - span[0]]
            np.multiply(room[c][at : at + out.size], scheme.gains[c], out=out)
    return outputs


def _synthesised(approximation: Array, detail: Array, scheme: Scheme, *, first: int, span: Span) -> Array:
    """One level back: the values of the given indices, from coefficients whose element 0 has the index `first`."""
    _, plan = _passes(scheme)
    pairs = _pairs(scheme, span)
    out = np.empty(2 * (pairs[1] - pairs[0]))
    inputs = (approximation, detail)
    room, scratch = _buffers(plan, pairs)
    for low in range(pairs[0], pairs[1], BLOCK):
        block = (low, min(low + BLOCK, pairs[1]))
        starts = (low + plan.reach[0][0], low + plan.reach[1][0])
        for c in (0, 1):
            size = block[1] + plan.reach[c][1] - starts[c]
            at = starts[c] - scheme.shifts[c] - first
            np.multiply(inputs[c][at : at + size], 1.0 / scheme.gains[c], out=room[c][:size])
        _lifted(room, starts, plan.moves, block, scratch)
        for c in (0, 1):
            at = low - starts[c]
            out[2 * (low - pairs[0]) + c : 2 * (block[1] - pairs[0]) : 2] = room[c][at : at + block[1] - low]
    begin = span[0] - 2 * pairs[0] - scheme.parity
    return out[begin : begin + span[1] - span[0]]


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

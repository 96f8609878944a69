"""The lifting wavelet transform: schemes by name, analysis and synthesis of signals of any
length.
"""

import difflib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric.chunks import release
from calibkit.numeric.wavelet import reach
from calibkit.numeric.wavelet.extension import EXTENSIONS, Continuation, Extension, window_of
from calibkit.numeric.wavelet.factor import LITERAL, Scheme, factor_bank
from calibkit.numeric.wavelet.level import analyse_level, synthesise_level
from calibkit.numeric.wavelet.reach import Span, coefficients_of, covering_pairs, passes, sources

Allocate = Callable[[int], Array]
"""Allocates an array for so many values."""
CHUNK = 1 << 18
"""Samples that go through all levels at a time, so that approximations stay in the cache too."""
TOGETHER = 10
"""Levels that a chunk goes through; deeper ones start from the whole approximation of the tenth, a
thousandth of the signal.
"""
COARSEST = 64
"""Coefficients of the coarsest level that a chunk has at least, many more than the filters read
beyond its ends.
"""


@dataclass(frozen=True, slots=True)
class _Decomposition:
    """A signal's wavelet coefficients, in the signal's unit, with what is needed to go back.

    Coefficient k of details[j] has index first[j] + k at level j + 1, index 0 lying at sample 0;
    there are a few more than length / 2^(j + 1), those that reach the signal from the extension.
    interior[j] selects the details whose filter lies wholly on the signal.
    """

    scheme: Scheme
    length: int
    approximation: Array
    details: tuple[Array, ...]
    first: tuple[int, ...]
    interior: tuple[slice, ...]


def find_scheme(name: str) -> Scheme:
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
        near = difflib.get_close_matches(
            name.lower().replace("/", "").replace(" ", ""), known, n=3, cutoff=0.5
        )
        raise FitError(
            f"unknown wavelet {name!r}",
            hint=(
                f"did you mean {' or '.join(near)}?"
                if near
                else "use haar, cdf53, cdf97, db4, sym8 or the like"
            ),
        )
    return factor_bank(name)


def forward(
    signal: Array,
    scheme: Scheme,
    levels: int,
    *,
    extension: Extension,
    allocate: Allocate = np.empty,
) -> _Decomposition:
    """Wavelet coefficients of a signal [n], any n ≥ 1, over a number of levels.

    Parameters
    ----------
    signal : [n], equidistant samples in any unit.
    extension : what stands beyond the ends (see `extension.Continuation`).
    allocate : makes the arrays that details are put in; memory beyond them is that of a chunk.

    Raises
    ------
    FitError : an empty signal, no levels, an unknown extension.

    Notes
    -----
    The signal is extended once, by as many samples as the coefficients that reach it need, and the
    lifting steps run on the extended signal without any rule for boundaries, odd lengths or powers
    of two. `inverse` undoes every step with the very numbers it was done with, so that
    reconstruction is perfect for every scheme, extension and length.
    """
    samples = np.ascontiguousarray(signal, dtype=np.float64)
    if samples.ndim != 1 or samples.size == 0 or levels < 1:
        raise FitError(
            f"a signal of shape {np.shape(signal)} cannot be transformed over {levels} levels",
            hint="give at least one sample and one level",
        )
    if extension not in EXTENSIONS:
        raise FitError(
            f"unknown extension {extension!r}", hint=f"use one of {', '.join(EXTENSIONS)}"
        )
    wanted = reach.coefficients_of(scheme, (0, samples.size), levels)
    needed = approximations_needed(scheme, wanted)
    details = tuple(allocate(high - low) for low, high in wanted[1:])
    beyond = Continuation.fit(samples, extension, window_of(levels))
    values, first, buffers = samples, 0, [np.empty(0), np.empty(0)]
    for above in range(0, levels, TOGETHER):
        below = min(above + TOGETHER, levels)
        approximation = np.empty(needed[below][1] - needed[below][0])
        for shares, spans in _chunks(scheme, needed[above : below + 1]):
            part, at = values, first
            for j, (share, here) in enumerate(zip(shares[1:], spans[1:], strict=True), start=above):
                own = reach.intersection(share, wanted[j + 1])
                low = _buffer(buffers, j, here)
                high = details[j][_slice_within(own, wanted[j + 1])]
                analyse_level(part, at, scheme, here, beyond, ((low, here[0]), (high, own[0])))
                part, at = low, here[0]
                release(samples, details[j])
            approximation[_slice_within(shares[-1], needed[below])] = part
        values, first = approximation, needed[below][0]
    (_, *clean), _ = reach.untouched(scheme, samples.size, levels)
    starts, interior = [low for low, _ in wanted[1:]], map(_slice_within, clean, wanted[1:])
    return _Decomposition(scheme, samples.size, values, details, tuple(starts), tuple(interior))


def inverse(
    decomposition: _Decomposition,
    shrink: Callable[[int, Array], Array] | None = None,
    *,
    allocate: Allocate = np.empty,
    into: Array | None = None,
) -> Array:
    """Signal [n] from its wavelet coefficients, thresholded or not, put into an array [n] or one
    that `allocate` makes.

    `shrink` makes of any part of the details of a level, 0 the finest, those to be used; it is
    called block by block while they are in the cache, for some of them twice, and must treat each
    detail by itself.

    Raises
    ------
    FitError : coefficients whose number is not that of the signal's length.
    """
    scheme, details = decomposition.scheme, decomposition.details
    known, levels = decomposition.approximation, len(details)
    wanted = reach.coefficients_of(scheme, (0, decomposition.length), levels)
    for (low, high), given in zip((*wanted[1:], wanted[-1]), (*details, known), strict=True):
        if given.shape != (high - low,):
            raise FitError(
                f"{given.shape} details where {high - low} belong to {decomposition.length}"
                " samples",
                hint="change coefficients in place or by new values of the same number",
            )
    buffers = [np.empty(0), np.empty(0)]
    for above in range((levels - 1) // TOGETHER * TOGETHER, -1, -TOGETHER):
        below = min(above + TOGETHER, levels)
        low, high = wanted[above]
        out = into if above == 0 and into is not None else allocate(high - low)
        for chunk in reach.cut_span(wanted[above], max(CHUNK, COARSEST << (below - above))):
            spans = reach.coefficients_of(scheme, chunk, below - above)
            signal = known[_slice_within(spans[-1], wanted[below])]
            for level in range(below, above, -1):
                here, there = spans[level - above - 1 : level - above + 1]
                detail = details[level - 1][_slice_within(there, wanted[level])]
                made = (
                    out[_slice_within(chunk, wanted[above])]
                    if level == above + 1
                    else _buffer(buffers, level, here)
                )
                treat = (shrink, level - 1)
                synthesise_level((signal, detail), scheme, there[0], here, treat, made)
                signal = made
            release(out, *details)
        known = out
    return known


def _chunks(scheme: Scheme, wanted: Sequence[Span]) -> Iterator[tuple[list[Span], list[Span]]]:
    """Cut all levels at the same times: each chunk's share of the wanted indices, and the indices
    computed for it.
    """
    levels = len(wanted) - 1
    for coarsest in reach.cut_span(wanted[-1], max(CHUNK >> levels, COARSEST)):
        shares = []
        for level, (low, high) in enumerate(wanted):
            start = low if coarsest[0] == wanted[-1][0] else coarsest[0] << (levels - level)
            stop = high if coarsest[1] == wanted[-1][1] else coarsest[1] << (levels - level)
            shares.append((min(max(start, low), high), min(max(stop, low), high)))
        yield shares, approximations_needed(scheme, [*shares[:-1], coarsest])


def _buffer(buffers: list[Array], level: int, indices: Span) -> Array:
    """Memory for so many values of a level, in one of two arrays in turn: new arrays would cost
    more than the lifting.
    """
    size = indices[1] - indices[0]
    if buffers[level % 2].size < size:
        buffers[level % 2] = np.empty(size)
    return buffers[level % 2][:size]


def approximations_needed(scheme: Scheme, wanted: Sequence[Span]) -> list[Span]:
    """Indices of the approximations of all levels that the wanted coefficients are made of; level 0
    goes beyond the signal.
    """
    needed = [wanted[-1]]
    for level in wanted[-2::-1]:
        low, high = sources(scheme, needed[-1])
        needed.append((min(low, level[0]), max(high, level[1])))
    return needed[::-1]


def shared_length(scheme: Scheme, length: int) -> int:
    """Values that an array must have for the finest details at its end to be read before a signal
    from its start reaches them.

    Synthesis works off pairs in order. When the details of pair i are read, from i + reach − shift
    on, the samples before 2 i + parity + 1 may have been written (half a pair by the chunk before);
    of all pairs the last comes closest.
    """
    _, (_, high) = coefficients_of(scheme, (0, length), 1)
    _, back = passes(scheme)
    _, last = covering_pairs(scheme, (0, length))
    # detail k lies `high − k` values before the end
    return high - back.reach[1][0] + scheme.shifts[1] + last + scheme.parity + 1


def _slice_within(indices: Span, within: Span) -> slice:
    """Elements of an array of the indices `within` that have the given indices."""
    low, high = max(indices[0], within[0]), min(indices[1], within[1])
    return slice(low - within[0], max(low, high) - within[0])

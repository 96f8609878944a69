"""The decimated wavelet transform of a signal of any length: one level after the other, by lifting
steps where the wavelet has some written out, else by the filters of PyWavelets.

A level parts its values into even ones s_i = x_(2i) and odd ones d_i = x_(2i+1). Lifting steps
change one by the other in turn, so that d becomes details and s an approximation, which is the
signal of the next level; subtracted in reverse order they give the values back (methods, lifting).
"""

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, reduce

import numpy as np
import pywt

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.numeric import chunks
from calibkit.numeric.wavelet.extension import Coefficients, Ends, Span

Allocate = Callable[[int], Array]
"""Allocates an array for so many values."""

EVEN, ODD = 0, 1
BLOCK = 1 << 15
"""Pairs of values that go through all steps of a level at a time: they stay in a processor's
second-level cache.
"""


@dataclass(frozen=True, slots=True)
class Step:
    """One lifting step: channel_i += tap · Σ_k other channel_(i + offsets[k])."""

    updates: int
    tap: float
    offsets: tuple[int, ...]


class Lifting:
    """One level of a wavelet transform by lifting steps in the order of analysis, then s · gain and
    d / gain; a part of a level at a time, as long as it reaches far enough.

    Coefficients i are made of the values 2i + reads[0] … 2i + reads[1]; the values 2i and 2i + 1
    are rebuilt from the coefficients i + needs[0] … i + needs[1]. Approximation i lies at the value
    2i + delay.
    """

    def __init__(self, bank: str, gain: float, *steps: Step) -> None:
        self.bank, self.gain, self.steps = bank, gain, steps
        self.undoing = [replace(step, tap=-step.tap) for step in reversed(steps)]
        low, high = _reach(self.steps)
        self.reads = (min(2 * low[EVEN], 2 * low[ODD] + 1), max(2 * high[EVEN], 2 * high[ODD] + 1))
        low, high = _reach(self.undoing)
        self.needs = (min(low), max(high))
        ramp = np.arange(self.reads[0] // 2 * 2, self.reads[1] + 1, dtype=np.float64)
        self.delay = float(self.analyse(ramp)[0][0]) / math.sqrt(2.0)

    def analyse(self, values: Array) -> tuple[Array, Array]:
        """Approximations and details [m], from just the values that they are made of, the first at
        an even index.
        """
        channels = values[EVEN::2].copy(), values[ODD::2].copy()
        _lift(channels, self.steps)
        first = -(self.reads[0] // 2)
        stop = (values.size - self.reads[1] + 1) // 2
        return channels[EVEN][first:stop] * self.gain, channels[ODD][first:stop] / self.gain

    def synthesise(self, approximations: Array, details: Array) -> Array:
        """Values [2 m] from just the coefficients [k] that they need."""
        channels = approximations / self.gain, details * self.gain
        _lift(channels, self.undoing)
        first, stop = -self.needs[0], details.size - self.needs[1]
        values = np.empty(2 * (stop - first))
        values[EVEN::2], values[ODD::2] = channels[EVEN][first:stop], channels[ODD][first:stop]
        return values


def _reach(steps: Sequence[Step]) -> tuple[list[int], list[int]]:
    """Lowest and highest index of both channels that index 0 of either depends on."""
    low, high = [0, 0], [0, 0]
    for step in reversed(steps):
        target, source = step.updates, 1 - step.updates
        low[source] = min(low[source], low[target] + min(step.offsets))
        high[source] = max(high[source], high[target] + max(step.offsets))
    return low, high


def _lift(channels: tuple[Array, Array], steps: Sequence[Step]) -> None:
    """Run steps in place wherever all that they read has been through the steps before."""
    start, stop = [0, 0], [channel.size for channel in channels]
    for step in steps:
        target, source = step.updates, 1 - step.updates
        low = max(start[target], start[source] - min(step.offsets))
        high = min(stop[target], stop[source] - max(step.offsets))
        neighbours = [channels[source][low + k : high + k] for k in step.offsets]
        channels[target][low:high] += step.tap * reduce(np.add, neighbours)
        start[target], stop[target] = low, high


class Filters:
    """As `Lifting`, by a filter bank of PyWavelets that has no lifting steps written out."""

    def __init__(self, bank: str) -> None:
        self.bank, self.half = bank, pywt.Wavelet(bank).dec_len // 2
        self.reads, self.needs = (2 - 2 * self.half, 1), (0, self.half - 1)
        # centre of the low-pass filter: how far behind its values an approximation stands
        low = np.array(pywt.Wavelet(bank).dec_lo)
        self.delay = 1.0 - float(low @ np.arange(low.size)) / math.sqrt(2.0)

    def analyse(self, values: Array) -> tuple[Array, Array]:
        """As `Lifting.analyse`."""
        approximations, details = pywt.dwt(values.copy(), self.bank, mode="zero")
        # for the others PyWavelets has extended the values by zeros
        whole = slice(self.half - 1, values.size // 2)
        return approximations[whole], details[whole]

    def synthesise(self, approximations: Array, details: Array) -> Array:
        """As `Lifting.synthesise`."""
        return np.asarray(pywt.idwt(approximations, details, self.bank, mode="zero"))


Wavelet = Lifting | Filters
ROOT2, ROOT3 = math.sqrt(2.0), math.sqrt(3.0)
LIFTING = {
    # d_i −= s_i;  s_i += d_i / 2
    "haar": Lifting("haar", ROOT2, Step(ODD, -1.0, (0,)), Step(EVEN, 0.5, (0,))),
    # d_i −= (s_i + s_(i+1)) / 2;  s_i += (d_(i−1) + d_i) / 4
    "cdf53": Lifting("bior2.2", ROOT2, Step(ODD, -0.5, (0, 1)), Step(EVEN, 0.25, (-1, 0))),
    # d_i += α (s_i + s_(i+1));  s_i += β (d_(i−1) + d_i);  the same with γ and δ; gain ζ
    # (Daubechies & Sweldens 1998, section 7.7; ISO/IEC 15444-1 annex F)
    "cdf97": Lifting(
        "bior4.4",
        1.149604398860241,
        Step(ODD, -1.586134342059924, (0, 1)),
        Step(EVEN, -0.052980118572961, (-1, 0)),
        Step(ODD, 0.882911075530934, (0, 1)),
        Step(EVEN, 0.443506852043971, (-1, 0)),
    ),
    # d_i −= √3 s_i;  s_i += √3/4 d_i + (√3 − 2)/4 d_(i+1);  d_i += s_(i−1)
    "db2": Lifting(
        "db2",
        (ROOT3 + 1.0) / ROOT2,
        Step(ODD, -ROOT3, (0,)),
        Step(EVEN, ROOT3 / 4.0, (0,)),
        Step(EVEN, (ROOT3 - 2.0) / 4.0, (1,)),
        Step(ODD, 1.0, (-1,)),
    ),
}
"""Wavelets whose steps are written out; all others are banks of PyWavelets."""


@cache
def find_wavelet(name: str) -> Wavelet:
    """Wavelet "haar", "cdf53", "cdf97", "db2", or any discrete one of PyWavelets.

    Raises
    ------
    FitError : no such wavelet (with the nearest names).
    """
    if name in LIFTING:
        return LIFTING[name]
    known = [*LIFTING, *pywt.wavelist(kind="discrete")]
    if name in known:
        return Filters(name)
    plain = name.lower().replace("/", "").replace(" ", "")
    near = difflib.get_close_matches(plain, known, n=3, cutoff=0.5)
    raise FitError(
        f"unknown wavelet {name!r}",
        hint=f"did you mean {' or '.join(near)}?"
        if near
        else "use haar, cdf53, cdf97, db4, sym8 or the like",
    )


def clean_spans(wavelet: Wavelet, length: int, levels: int) -> list[Span]:
    """Indices of the coefficients of each level, 0 the signal [length] itself, that no extension
    touches.
    """
    clean = [(0, length)]
    for _ in range(levels):
        low, high = clean[-1]
        clean.append((-((wavelet.reads[0] - low) // 2), (high - 1 - wavelet.reads[1]) // 2 + 1))
    return clean


def analyse(
    above: Coefficients, wavelet: Wavelet, ends: Ends, allocate: Allocate = np.empty
) -> tuple[Coefficients, Coefficients]:
    """Approximations and details that the approximations of the level above are rebuilt from, to
    their ends and whatever stands beyond: a few more than half as many of either.

    `allocate` makes their arrays; memory beyond them is that of a block.
    """
    first = above.span[0] // 2 + wavelet.needs[0]
    count = (above.span[1] + 1) // 2 + wavelet.needs[1] - first
    approximations, details = allocate(count), allocate(count)
    for a, b in chunks.ranges(count, BLOCK):
        read = 2 * (first + a) + wavelet.reads[0] // 2 * 2, 2 * (first + b) - 1 + wavelet.reads[1]
        approximations[a:b], details[a:b] = wavelet.analyse(ends.extend(above, read))
        chunks.release(above.values, approximations, details)
    level = above.level + 1
    return Coefficients(approximations, first, level), Coefficients(details, first, level)


def synthesise(
    approximations: Coefficients,
    details: Coefficients,
    span: Span,
    wavelet: Wavelet,
    shrink: Callable[[int, Array], Array],
    allocate: Allocate = np.empty,
) -> Coefficients:
    """Approximations of the level above of given indices, from those of a level and what `shrink`
    makes of its details: of any part of the details of a level, 0 the finest, those to be used.
    """
    level, size = details.level - 1, span[1] - span[0]
    values, first_pair = allocate(size), span[0] // 2
    for a, b in chunks.ranges((span[1] + 1) // 2 - first_pair, BLOCK):
        needed = first_pair + a + wavelet.needs[0], first_pair + b + wavelet.needs[1]
        shrunk = shrink(level, details.part(needed))
        rebuilt = wavelet.synthesise(approximations.part(needed), shrunk)
        # the first and the last pair may reach beyond the span by a value
        start = 2 * (first_pair + a) - span[0]
        low, high = max(start, 0), min(start + rebuilt.size, size)
        values[low:high] = rebuilt[low - start : high - start]
        chunks.release(values, details.values, approximations.values)
    return Coefficients(values, span[0], level)


def average_over_shifts(
    known: Coefficients,
    levels: int,
    wavelet: Wavelet,
    ends: Ends,
    shrink: Callable[[int, Array], Array],
    allocate: Allocate = np.empty,
) -> Coefficients:
    """Approximations of a level with the details of further levels shrunk as by `synthesise`,
    averaged over all shifts (stationary transform, cycle spinning), in blocks that overlap by the
    reach of its filters.
    """
    period = 1 << levels
    # of the filters of all levels together, there and back
    reach = (period - 1) * (pywt.Wavelet(wavelet.bank).dec_len - 1)
    values = allocate(known.values.size)
    for a, b in chunks.ranges(values.size, BLOCK):
        part = ends.extend(known, (known.first + a - reach, known.first + b + reach))
        # `swt` joins the ends of what it is given, and its length must be a multiple of the period
        part = np.pad(part, (0, -part.size % period), mode="edge")
        coefficients = pywt.swt(part, wavelet.bank, level=levels, trim_approx=True)
        for k in range(1, levels + 1):  # the coarsest details come first
            coefficients[k] = shrink(known.level + levels - k, coefficients[k])
        values[a:b] = pywt.iswt(coefficients, wavelet.bank)[reach : reach + b - a]
        chunks.release(known.values, values)
    return Coefficients(values, known.first, known.level)

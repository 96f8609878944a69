"""One level of the decimated wavelet transform: by lifting steps where the wavelet has some written
out, else by the filters of PyWavelets.

A level parts its values into even ones s_i = x_(2i) and odd ones d_i = x_(2i+1). Lifting steps
change one by the other in turn, so that d becomes details and s an approximation, which is the
signal of the next level; subtracted in reverse order they give the values back (methods, lifting).

A signal is extended beyond its ends (`denoise.beyond`) before it is transformed. What a level does
at the ends of its values is therefore of no interest, as long as it can be undone.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pywt

from calibkit.errors import FitError, did_you_mean
from calibkit.numeric.arrays import Array
from calibkit.numeric.chunks import ranges

EVEN, ODD = 0, 1
CACHED = 1 << 15
"""Values that are changed at a time: they stay in a processor's second-level cache."""


@dataclass(frozen=True, slots=True)
class Step:
    """One lifting step: channel_i += tap · Σ_k other channel_(i + offsets[k])."""

    updates: int
    tap: float
    offsets: tuple[int, ...]

    def run(self, channels: tuple[Array, Array], sign: float) -> None:
        """Add it in place, or with a sign of −1 undo it; not at the ends where a neighbour is
        missing.
        """
        target, source = channels[self.updates], channels[1 - self.updates]
        first, stop = max(-min(self.offsets), 0), target.size - max(*self.offsets, 0)
        for start, end in ranges(stop - first, CACHED):
            nearest, *others = (source[first + start + k : first + end + k] for k in self.offsets)
            neighbours = nearest.copy()
            for other in others:
                neighbours += other
            neighbours *= sign * self.tap
            target[first + start : first + end] += neighbours


@dataclass(frozen=True, slots=True)
class Wavelet:
    """One level by lifting steps in the order of analysis, then s · gain and d / gain; without
    steps by the filters of a bank.
    """

    bank: str
    """Filter bank of PyWavelets that it equals, up to a shift and the sign of the details."""
    reads: tuple[int, int]
    """Coefficients i are made of the values 2i + reads[0] … 2i + reads[1]."""
    gain: float = 1.0
    steps: tuple[Step, ...] = ()

    @property
    def length(self) -> int:
        """Values that a coefficient is made of, at most."""
        return int(pywt.Wavelet(self.bank).dec_len)

    def analyse(self, values: Array) -> tuple[Array, Array]:
        """Approximations and details [n/2] of values [n]."""
        if not self.steps:
            approximations, details = pywt.dwt(values.copy(), self.bank, mode="zero")
            # the last ones are of zeros beyond the values
            return approximations[: values.size // 2], details[: values.size // 2]
        even, odd = values[EVEN::2].copy(), values[ODD::2].copy()
        for step in self.steps:
            step.run((even, odd), 1.0)
        even *= self.gain
        odd /= self.gain
        return even, odd

    def synthesise(self, approximations: Array, details: Array) -> Array:
        """Values [2 n] of approximations and details [n]."""
        if not self.steps:
            inside = pywt.idwt(approximations, details, self.bank, mode="zero")
            return np.pad(inside, (0, self.length - 2))
        values = np.empty(2 * details.size)
        even, odd = values[EVEN::2], values[ODD::2]
        even[:], odd[:] = approximations, details
        even /= self.gain
        odd *= self.gain
        for step in reversed(self.steps):
            step.run((even, odd), -1.0)
        return values


ROOT2, ROOT3 = math.sqrt(2.0), math.sqrt(3.0)
LIFTING = {
    # d_i −= s_i;  s_i += d_i / 2
    "haar": Wavelet("haar", (0, 1), ROOT2, (Step(ODD, -1.0, (0,)), Step(EVEN, 0.5, (0,)))),
    # d_i −= (s_i + s_(i+1)) / 2;  s_i += (d_(i−1) + d_i) / 4
    "cdf53": Wavelet(
        "bior2.2", (-2, 2), ROOT2, (Step(ODD, -0.5, (0, 1)), Step(EVEN, 0.25, (-1, 0)))
    ),
    # d_i += α (s_i + s_(i+1));  s_i += β (d_(i−1) + d_i);  the same with γ and δ; gain ζ
    # (Daubechies & Sweldens 1998, section 7.7; ISO/IEC 15444-1 annex F)
    "cdf97": Wavelet(
        "bior4.4",
        (-4, 4),
        1.149604398860241,
        (
            Step(ODD, -1.586134342059924, (0, 1)),
            Step(EVEN, -0.052980118572961, (-1, 0)),
            Step(ODD, 0.882911075530934, (0, 1)),
            Step(EVEN, 0.443506852043971, (-1, 0)),
        ),
    ),
    # d_i −= √3 s_i;  s_i += √3/4 d_i + (√3 − 2)/4 d_(i+1);  d_i += s_(i−1)
    "db2": Wavelet(
        "db2",
        (-2, 3),
        (ROOT3 + 1.0) / ROOT2,
        (
            Step(ODD, -ROOT3, (0,)),
            Step(EVEN, ROOT3 / 4.0, (0,)),
            Step(EVEN, (ROOT3 - 2.0) / 4.0, (1,)),
            Step(ODD, 1.0, (-1,)),
        ),
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
    wavelet_names = [*LIFTING, *pywt.wavelist(kind="discrete")]
    if name not in wavelet_names:
        advice = "use haar, cdf53, cdf97, db4, sym8 or the like"
        plain_name = name.lower().replace("/", "").replace(" ", "")
        hint = did_you_mean(plain_name, wavelet_names, advice)
        raise FitError(f"unknown wavelet {name!r}", hint=hint)
    return Wavelet(name, (2 - pywt.Wavelet(name).dec_len, 1))


def clean_spans(wavelet: Wavelet, length: int, levels: int) -> list[tuple[int, int]]:
    """Indices of the coefficients of each level, 0 the signal [length] itself, that no extension
    touches.

    Coefficient i of level j is made of the samples p i + (p − 1) reads[0] … p i + (p − 1) reads[1],
    p = 2^j.
    """
    periods, (first, last) = [1 << j for j in range(levels + 1)], wavelet.reads
    return [(-(first * (p - 1) // p), (length - 1 - last * (p - 1)) // p + 1) for p in periods]

"""Denoising that does not depend on where a signal begins: the mean over shifted transforms.

A decimated transform treats a step differently by where it falls between its samples (Coifman &
Donoho 1995, Translation-invariant de-noising). Shifts by 2^k samples leave the coefficients of the
first k levels as they are, so that only the coarsest levels are transformed again, of a few
approximations: all shifts there together cost less than one transform.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.numeric.wavelet import reach
from calibkit.numeric.wavelet.denoise import Denoised, denoise, find_thresholds, prepare
from calibkit.numeric.wavelet.extension import Continuation, Extension, continue_signal
from calibkit.numeric.wavelet.factor import Scheme
from calibkit.numeric.wavelet.level import analyse_levels, synthesise_levels
from calibkit.numeric.wavelet.lifting import Allocate, approximations_needed
from calibkit.numeric.wavelet.reach import Span, coefficients_of, covering_pairs
from calibkit.numeric.wavelet.shrinkage import Rule, Shrinkage, Threshold

COARSE = 3
"""Levels that are transformed with every shift."""
MOST_ROWS = 1 << 18
"""Longest signal [rows] that is transformed with shifts: in a longer one of the same duration noise
averages out at more levels, and it need not fit into memory.
"""


def denoise_shifted(
    signal: Array,
    *,
    wavelet: str,
    levels: int | None,
    threshold: Threshold,
    rule: Rule,
    extension: Extension,
    allocate: Allocate = np.empty,
) -> Denoised:
    """Denoised signal [n] as by `denoise.denoise`, averaged over all shifts of the coarsest levels;
    noise and thresholds are those of the transform without shift. Raises FitError as it does.
    """
    if signal.size > MOST_ROWS:
        return denoise(
            signal,
            wavelet=wavelet,
            levels=levels,
            threshold=threshold,
            rule=rule,
            extension=extension,
            allocate=allocate,
        )
    samples, scheme, depth = prepare(signal, wavelet, levels, threshold, rule)
    ready = _planned(scheme, samples.size, depth)
    beyond = Continuation.fit(samples, extension, 3 << (depth - 1))
    plan, room = ready.plan, np.empty(ready.plan.size)
    room[: plan.samples[1] - plan.samples[0]] = continue_signal(samples, *plan.samples, beyond)
    analyse_levels(scheme, ready.forth, room)
    own = [room[at : at + size] for at, size in plan.own]
    noise, thresholds = find_thresholds(own, scheme, threshold, samples.size)
    shrinkage = Shrinkage(rule, thresholds)
    synthesise_levels(scheme, ready.back_coarse, room, shrinkage)
    shifts = room[plan.shifts : plan.shifts + plan.turns * plan.count].reshape(plan.turns, -1)
    room[plan.mean : plan.mean + plan.count] = shifts.mean(axis=0)
    synthesise_levels(scheme, ready.back, room, shrinkage)
    _, (low, high) = reach.untouched(scheme, samples.size, depth)
    margin = 2 << depth  # a shift moves what the extension touches by less
    inner = (low + margin, max(high - margin, low + margin))
    made = room[plan.out : plan.out + samples.size].copy()
    return Denoised(made, noise, thresholds, inner, depth)


@dataclass(frozen=True, slots=True)
class _Level:
    """Place and first index of the approximation of a level, and the places of the details down to
    it.
    """

    at: int
    first: int
    details: tuple[int, ...]


@dataclass(slots=True)
class _Plan:
    """Where everything lies in one array of memory, and the operations on it in their order.

    An operation is a row of numbers, which native/lifting.c explains.
    """

    scheme: Scheme
    samples: Span
    """Indices of the extended signal, which lies at the beginning."""
    clean: tuple[Span, ...]
    """Indices of the details of each level, without shift, that lie wholly on the signal."""
    size: int = 0
    forth: list[list[int]] = field(default_factory=list)
    back_coarse: list[list[int]] = field(default_factory=list)
    back: list[list[int]] = field(default_factory=list)
    own: list[tuple[int, int]] = field(default_factory=list)
    """Place and number of those details."""
    turns: int = 0
    """Number of shifts."""
    shifts: int = 0
    """Place of what the coarse levels give with each shift, one behind the other."""
    count: int = 0
    """Their number with one shift."""
    mean: int = 0
    """Place of their mean."""
    out: int = 0
    """Place of the signal that is made."""

    def place(self, indices: Span) -> int:
        """Memory for so many values."""
        self.size += indices[1] - indices[0]
        return self.size - (indices[1] - indices[0])

    def analyse(
        self, at: int, first: int, needed: Sequence[Span], wanted: Sequence[Span]
    ) -> _Level:
        """Levels one after the other from values at a place, element 0 of which has the index
        `first`; the last approximation, and the places of all details.
        """
        found = []
        for low, high in zip(needed[1:], wanted[1:], strict=True):
            places = [(self.place(span), span[0], span[1] - span[0]) for span in (low, high)]
            self.forth.append([at, first, *low, *places[0], *places[1]])
            at, first = places[0][:2]
            found.append(places[1][0])
        return _Level(at, first, tuple(found))

    def note_own(self, details: Sequence[int], wanted: Sequence[Span]) -> None:
        """Note where the details of further levels lie wholly on the signal."""
        for at, span in zip(details, wanted[1:], strict=True):
            low, high = reach.intersection(self.clean[len(self.own) + 1], span)
            self.own.append((at + low - span[0], high - low))

    def synthesise(
        self, last: _Level, wanted: Sequence[Span], level: int, out: int
    ) -> Iterator[list[int]]:
        """Operations from the coefficients of the last level back to `wanted[0]`, which goes to the
        place `out`; `level` is the number of the first of them.
        """
        here = last.at + wanted[-1][0] - last.first
        for k in range(len(wanted) - 1, 0, -1):
            above = wanted[k - 1]
            made = self.place(above) if k > 1 else out
            pairs = covering_pairs(self.scheme, above)
            sizes = (above[0], above[1] - above[0])
            yield [here, last.details[k - 1], wanted[k][0], *pairs, level + k - 1, made, *sizes]
            here = made


@dataclass(frozen=True, slots=True)
class _Ready:
    """A plan, and its operations forth, back from the coarse levels and back from the others."""

    plan: _Plan
    forth: Integers
    back_coarse: Integers
    back: Integers


@lru_cache(maxsize=64)
def _planned(scheme: Scheme, length: int, depth: int) -> _Ready:
    """Plan for a signal of a length: levels that all shifts share, then the others shift by
    shift.
    """
    fine = max(depth - COARSE, 0)
    wanted = coefficients_of(scheme, (0, length), depth)[: fine + 1]
    low, high = wanted[fine]
    turns = range(1 << (depth - fine))
    coarse = [coefficients_of(scheme, (low - turn, high - turn), depth - fine) for turn in turns]
    deeper = [approximations_needed(scheme, spans) for spans in coarse]
    last = (
        min(spans[0][0] + turn for turn, spans in enumerate(deeper)),
        max(spans[0][1] + turn for turn, spans in enumerate(deeper)),
    )
    needed = approximations_needed(scheme, [*wanted[:fine], last])
    plan = _Plan(scheme, needed[0], reach.untouched(scheme, length, depth)[0])
    shared = plan.analyse(plan.place(needed[0]), needed[0][0], needed, wanted)
    plan.note_own(shared.details, wanted)
    plan.turns, plan.count = len(turns), high - low
    plan.shifts = plan.place((0, len(turns) * plan.count))
    for turn in turns:
        one = plan.analyse(shared.at, shared.first - turn, deeper[turn], coarse[turn])
        if turn == 0:
            plan.note_own(one.details, coarse[turn])
        out = plan.shifts + turn * plan.count
        plan.back_coarse += plan.synthesise(one, coarse[turn], fine, out)
    plan.mean = plan.place((0, plan.count))
    plan.out = plan.place((0, length)) if fine else plan.mean
    mean = _Level(plan.mean, low, shared.details)
    plan.back += plan.synthesise(mean, wanted, 0, plan.out)
    operations = (plan.forth, plan.back_coarse, plan.back)
    return _Ready(plan, *(np.array(rows, dtype=np.int64) for rows in operations))

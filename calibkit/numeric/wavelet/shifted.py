"""Denoising that does not depend on where a signal begins: the mean over shifted transforms.

A decimated transform treats a step differently by where it falls between its samples (Coifman &
Donoho 1995, Translation-invariant de-noising). Shifts by 2^k samples leave the coefficients of the
first k levels as they are, so that only the coarsest levels are transformed again, of a few
approximations: all shifts there together cost less than one transform.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Self

import numpy as np

from calibkit.arrays import Array, Integers
from calibkit.native import kernels_for
from calibkit.numeric.dispersion import MAD_OF_UNIT_NORMAL
from calibkit.numeric.wavelet import reach
from calibkit.numeric.wavelet.denoise import (
    OWN_NOISE_FROM,
    Denoised,
    denoise,
    find_thresholds,
    prepare,
)
from calibkit.numeric.wavelet.extension import (
    EXTENSIONS,
    SIGNIFICANT,
    Continuation,
    Extension,
    lengths_at_end,
    sections,
    window_of,
)
from calibkit.numeric.wavelet.factor import Scheme
from calibkit.numeric.wavelet.level import CODES, analyse_levels, encoded, synthesise_levels
from calibkit.numeric.wavelet.lifting import Allocate
from calibkit.numeric.wavelet.reach import Span, coefficients_of, covering_pairs
from calibkit.numeric.wavelet.shrinkage import (
    THRESHOLDS,
    Rule,
    Shrinkage,
    Threshold,
    noise_gains,
)

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
    ready = _planned(scheme, samples.size, depth, periodic=extension == "periodic")
    room = np.empty(ready.plan.size)
    asked = (extension, rule, threshold)
    found = _compiled(ready, asked, samples, room) or _by_arrays(ready, asked, samples, room)
    made = room[ready.plan.start : ready.plan.start + samples.size]
    return Denoised(made, *found, ready.inner, depth)


def _compiled(
    ready: "_Ready", asked: tuple[Extension, Rule, Threshold], samples: Array, room: Array
) -> tuple[Array, Array] | None:
    """As `_by_arrays`, to the last bit, by compiled steps; None where they cannot."""
    extension, rule, threshold = asked
    scheme, library = ready.plan.scheme, kernels_for(samples, room)
    plans = encoded(scheme)
    if library is None or plans is None or threshold != "universal":
        return None
    read = _encoded_plan(scheme, samples.size, ready.depth, extension, rule)
    noise, thresholds = found = np.empty((2, ready.depth))
    addresses = (one.ctypes.data for one in (*read, samples, room, found))
    failed = library.calibkit_denoised(*plans[0], *plans[1], *addresses)
    return None if failed else (noise, thresholds)


def _by_arrays(
    ready: "_Ready", asked: tuple[Extension, Rule, Threshold], samples: Array, room: Array
) -> tuple[Array, Array]:
    """Denoise samples [n] into the plan's place in an array; noise and thresholds [levels]."""
    (extension, rule, threshold), plan = asked, ready.plan
    scheme = plan.scheme
    beyond = Continuation.fit(samples, extension, window_of(ready.depth))
    added, sign = _beyond(beyond)
    room[plan.start : plan.start + samples.size] = samples
    for operation in ready.forth:
        first, count = operation[-2:].tolist()
        to, low, high, side = ready.ends[first : first + count].T
        share, gain = ready.shares[first : first + count].T
        inside = room[low] + share * (room[high] - room[low])
        room[to] = added[side] * gain + sign[side] * inside
        analyse_levels(scheme, operation[None, :-2], room)
    own = [room[at : at + size] for at, size in plan.own]
    noise, thresholds = find_thresholds(own, scheme, threshold, samples.size)
    shrinkage = Shrinkage(rule, thresholds)
    synthesise_levels(scheme, ready.back_coarse, room, shrinkage)
    shifts = room[plan.shifts : plan.shifts + plan.turns * plan.count].reshape(plan.turns, -1)
    room[plan.mean : plan.mean + plan.count] = shifts.mean(axis=0)
    synthesise_levels(scheme, ready.back, room, shrinkage)
    return noise, thresholds


def _beyond(beyond: Continuation) -> tuple[Array, Array]:
    """What is added beyond each end [2], and what a value within is multiplied by [2]."""
    ends, turned = np.array([beyond.left, beyond.right]), np.array(beyond.turned)
    if beyond.extension == "constant":
        return ends, np.zeros(2)
    turned &= beyond.extension != "periodic"
    return np.where(turned, 2.0 * ends, 0.0), np.where(turned, -1.0, 1.0)


@dataclass(frozen=True, slots=True)
class _Level:
    """Where the approximation of a level lies: its place, the index of its element 0, the indices
    that are known without an end, and what its indices mean in samples: step · index + origin.
    """

    at: int
    first: int
    known: Span
    step: float
    origin: float
    gain: float
    """What a constant of 1 has become."""

    def place(self, index: int) -> int:
        """Where an index lies."""
        return self.at + index - self.first

    def shifted(self, turn: int) -> Self:
        """The same by indices that begin `turn` later."""
        low, high = self.known
        known, origin = (low - turn, high - turn), self.origin + self.step * turn
        return replace(self, first=self.first - turn, known=known, origin=origin)


@dataclass(slots=True)
class _Plan:
    """Where everything lies in one array of memory, and the operations on it in their order.

    An operation is a row of numbers, which native/lifting.c explains; behind those of an analysis
    stand the first of the values beyond the ends that are to be made before, and their number.
    """

    scheme: Scheme
    length: int
    periodic: bool
    clean: tuple[Span, ...]
    """Indices of the details of each level, without shift, that lie wholly on the signal."""
    size: int = 0
    forth: list[list[int]] = field(default_factory=list)
    back_coarse: list[list[int]] = field(default_factory=list)
    back: list[list[int]] = field(default_factory=list)
    ends: list[Integers] = field(default_factory=list)
    """Of each value beyond an end: its place, those of the two values that it is made of, and 1 at
    the right end [m, 4].
    """
    shares: list[Array] = field(default_factory=list)
    """Share of the second of those two values, and what a constant of 1 is at their level [m,
    2].
    """
    made: int = 0
    """Number of values beyond the ends."""
    own: list[tuple[int, int]] = field(default_factory=list)
    """Place and number of the details that lie wholly on the signal."""
    start: int = 0
    """Place of the signal, given and made."""
    turns: int = 0
    """Number of shifts."""
    shifts: int = 0
    """Place of what the coarse levels give with each shift, one behind the other."""
    count: int = 0
    """Their number with one shift."""
    mean: int = 0
    """Place of their mean."""

    def place(self, indices: Span) -> int:
        """Memory for so many values."""
        self.size += indices[1] - indices[0]
        return self.size - (indices[1] - indices[0])

    def continue_level(self, level: _Level, needed: Span) -> tuple[int, int]:
        """Values of a level that lie beyond what is known of it: the first of them and their
        number.

        A level goes on as the signal does, which is reflected in its end samples or begins anew. As
        the ends lie between the coefficients of a level, its values there are interpolated.
        """
        (low, high), first = level.known, self.made
        index = np.r_[needed[0] : low, high : max(needed[1], high)]
        right = (index >= high).astype(np.int64)
        away = level.step * index + level.origin
        within = away + self.length * (1 - 2 * right)
        if not self.periodic:
            within = 2.0 * (self.length - 1) * right - away
        at = np.round((within - level.origin) / level.step, 9)
        below = np.clip(np.floor(at), low, max(high - 2, low)).astype(np.int64)
        above = np.minimum(below + 1, high - 1)
        places = [level.place(i) for i in (index, below, above)]
        self.ends.append(np.column_stack([*places, right]))
        share = np.clip(at - below, 0.0, 1.0)
        self.shares.append(np.column_stack([share, np.full(index.size, level.gain)]))
        self.made += index.size
        return first, index.size

    def analyse(
        self, level: _Level, wanted: Sequence[Span], last: Span, *, continued: bool
    ) -> tuple[list[_Level], list[int]]:
        """Levels one after the other, each over its wanted indices, of the last of which more are
        needed later; the places of all details. `continued`: the first is already continued.
        """
        levels, details = [level], []
        gain, delay = _centre(self.scheme)
        for j in range(1, len(wanted)):
            low, high = wanted[j]
            reads = reach.sources(self.scheme, wanted[j])
            ends = (0, 0) if continued and j == 1 else self.continue_level(level, reads)
            more = reach.sources(self.scheme, wanted[j + 1]) if j + 1 < len(wanted) else last
            held = (min(low, more[0]), max(high, more[1]))
            at, detail = self.place(held), self.place(wanted[j])
            outputs = (at + low - held[0], low, high - low, detail, low, high - low)
            self.forth.append([level.at, level.first, low, high, *outputs, *ends])
            step, origin = 2.0 * level.step, level.origin + level.step * delay
            level = _Level(at, held[0], wanted[j], step, origin, level.gain * gain)
            levels.append(level)
            details.append(detail)
        return levels, details

    def note_own(self, details: Sequence[int], wanted: Sequence[Span]) -> None:
        """Note where the details of further levels lie wholly on the signal."""
        for at, span in zip(details, wanted[1:], strict=True):
            low, high = reach.intersection(self.clean[len(self.own) + 1], span)
            self.own.append((at + low - span[0], high - low))

    def transform_shifts(
        self, shared: _Level, coarse: Sequence[Sequence[Span]], last: Span
    ) -> None:
        """Further levels forth and back shift by shift, each over its wanted indices, from a shared
        level of which `last` is needed.
        """
        ends = self.continue_level(shared, last)
        for turn, wanted in enumerate(coarse):
            first = len(self.forth)
            levels, details = self.analyse(shared.shifted(turn), wanted, wanted[-1], continued=True)
            if turn == 0:
                self.forth[first][-2:] = ends
                self.note_own(details, wanted)
            out, number = self.shifts + turn * self.count, len(self.clean) - len(wanted)
            self.back_coarse += self.synthesise(levels, details, number, out)

    def synthesise(
        self, levels: Sequence[_Level], details: Sequence[int], number: int, out: int
    ) -> Iterator[list[int]]:
        """Operations from the coefficients of the last level back to the first, which goes to the
        place `out`, the others where they were before; `number` is that of the first detail.
        """
        here = levels[-1].place(levels[-1].known[0])
        for k in range(len(levels) - 1, 0, -1):
            low, high = levels[k - 1].known
            made = levels[k - 1].place(low) if k > 1 else out
            pairs = covering_pairs(self.scheme, (low, high))
            first = levels[k].known[0]
            yield [here, details[k - 1], first, *pairs, number + k - 1, made, low, high - low]
            here = made


def _centre(scheme: Scheme) -> tuple[float, float]:
    """What a constant of 1 becomes in the approximation, and the sample about which the filter of
    coefficient 0 lies.
    """
    taps = [
        (tap, 2 * (low + k) + channel + scheme.parity)
        for channel, (low, values) in enumerate(scheme.polyphase()[0])
        for k, tap in enumerate(values)
    ]
    gain = sum(tap for tap, _ in taps)
    return gain, round(sum(tap * at for tap, at in taps) / gain, 9)


@dataclass(frozen=True, slots=True)
class _Ready:
    """A plan, and its operations forth, back from the coarse levels and back from the others."""

    plan: _Plan
    depth: int
    forth: Integers
    back_coarse: Integers
    back: Integers
    ends: Integers
    shares: Array
    inner: Span
    """Samples that the extension does not touch with any shift."""

    @classmethod
    def of_plan(cls, plan: _Plan, depth: int, inner: Span) -> Self:
        """All as arrays; `inner` are the samples that no extension touches without shift."""
        margin = 2 << depth  # a shift moves what the extension touches by less
        return cls(
            plan=plan,
            depth=depth,
            forth=np.array(plan.forth, dtype=np.int64),
            back_coarse=np.array(plan.back_coarse, dtype=np.int64),
            back=np.array(plan.back, dtype=np.int64),
            ends=np.concatenate(plan.ends),
            shares=np.concatenate(plan.shares),
            inner=(inner[0] + margin, max(inner[1] - margin, inner[0] + margin)),
        )


@lru_cache(maxsize=64)
def _planned(scheme: Scheme, length: int, depth: int, *, periodic: bool) -> _Ready:
    """Plan for a signal of a length: levels that all shifts share, then the others shift by
    shift.
    """
    fine = max(depth - COARSE, 0)
    wanted = coefficients_of(scheme, (0, length), depth)[: fine + 1]
    low, high = wanted[fine]
    turns = range(1 << (depth - fine))
    coarse = [coefficients_of(scheme, (low - turn, high - turn), depth - fine) for turn in turns]
    last = (low, high)
    for turn, spans in enumerate(coarse):
        start, stop = reach.sources(scheme, spans[1])
        last = (min(last[0], start + turn), max(last[1], stop + turn))
    clean, inner = reach.untouched(scheme, length, depth)
    plan = _Plan(scheme, length, periodic, clean)
    begin = reach.sources(scheme, wanted[1]) if fine else last
    begin = (min(begin[0], 0), max(begin[1], length))
    signal = _Level(plan.place(begin), begin[0], (0, length), 1.0, 0.0, 1.0)
    plan.start, plan.turns, plan.count = signal.place(0), len(turns), high - low
    levels, details = plan.analyse(signal, wanted, last, continued=False)
    plan.note_own(details, wanted)
    plan.shifts = plan.place((0, plan.turns * plan.count))
    plan.mean = levels[-1].place(low)
    plan.transform_shifts(levels[-1], coarse, last)
    plan.back += plan.synthesise(levels, details, 0, plan.start)
    plan.size = max(plan.size, begin[1] - begin[0] + 2 * length + 4)  # room for the ends
    return _Ready.of_plan(plan, depth, inner)


@lru_cache(maxsize=64)
def _encoded_plan(
    scheme: Scheme, length: int, depth: int, extension: Extension, rule: Rule
) -> tuple[Integers, Array]:
    """What native/denoised.c reads: the layout of the memory with all operations, and tables."""
    ready = _planned(scheme, length, depth, periodic=extension == "periodic")
    plan, known = ready.plan, sum(size >= OWN_NOISE_FROM for _, size in ready.plan.own)
    differing, limit, window = lengths_at_end(length, window_of(depth))
    sizes, squares = sections(window, limit)
    numbers = [
        *(length, plan.start, EXTENSIONS.index(extension), CODES[rule], depth, known),
        *(plan.turns, plan.count, plan.shifts, plan.mean, plan.made),
        *(len(plan.forth), len(plan.back_coarse), len(plan.back)),
        *(differing - 1, limit, window, sizes.size),
    ]
    operations = (np.array(plan.own), ready.forth, ready.back_coarse, ready.back, ready.ends)
    layout = np.concatenate([np.array(numbers), *(rows.ravel() for rows in operations)])
    of_unit = THRESHOLDS["universal"](np.empty(0), 1.0, length)
    settings = (MAD_OF_UNIT_NORMAL, SIGNIFICANT, of_unit)
    gains = noise_gains(scheme, depth)
    return layout, np.concatenate([settings, gains, sizes, squares, ready.shares.ravel()])

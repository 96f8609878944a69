"""Which coefficients and samples a lifting transform makes of which: indices alone, worked out from
the steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

from calibkit.numeric.wavelet.factor import Scheme, Step

Span = tuple[int, int]
"""First index and one past the last."""


@dataclass(frozen=True, slots=True)
class Move:
    """A lifting step on the target channel's indices start + low … stop + high − 1, taps of equal
    value joined.
    """

    target: int
    terms: tuple[tuple[float, tuple[int, ...]], ...]
    low: int
    high: int


@dataclass(frozen=True, slots=True)
class Pass:
    """The steps of analysis or synthesis, and how far each channel must reach beyond the wanted
    pairs.
    """

    moves: tuple[Move, ...]
    reach: tuple[Span, Span]


@lru_cache(maxsize=64)
def coefficients_of(scheme: Scheme, samples: Span, levels: int) -> tuple[Span, ...]:
    """Indices of the coefficients that rebuild a range of samples, level by level; level 0 is the
    range itself.
    """
    _, plan = passes(scheme)
    wanted = [samples]
    for _ in range(levels):
        low, high = covering_pairs(scheme, wanted[-1])
        wanted.append(
            (
                min(low + plan.reach[c][0] - scheme.shifts[c] for c in (0, 1)),
                max(high + plan.reach[c][1] - scheme.shifts[c] for c in (0, 1)),
            )
        )
    return tuple(wanted)


@lru_cache(maxsize=64)
def untouched(scheme: Scheme, length: int, levels: int) -> tuple[tuple[Span, ...], Span]:
    """Indices of the coefficients that the extension does not touch, level by level, and of such
    samples rebuilt.

    Level 0 is the signal itself. An empty range has its end at or before its start.
    """
    _, back = passes(scheme)
    shift = scheme.shifts
    clean = [(0, length)]
    for _ in range(levels):
        clean.append(made_of(scheme, clean[-1]))
    low, high = clean[-1]
    for level in range(levels, 0, -1):
        low, high = max(low, clean[level][0]), min(high, clean[level][1])
        low = 2 * max(low + shift[c] - back.reach[c][0] for c in (0, 1)) + scheme.parity
        high = 2 * min(high + shift[c] - back.reach[c][1] for c in (0, 1)) + scheme.parity
    return tuple(clean), (max(low, 0), min(high, length))


def sources(scheme: Scheme, outputs: Span) -> Span:
    """Indices of the level above that the analysis of the given indices reads."""
    plan, _ = passes(scheme)
    return (
        min(2 * (outputs[0] + plan.reach[c][0]) + scheme.parity + c for c in (0, 1)),
        max(2 * (outputs[1] - 1 + plan.reach[c][1]) + scheme.parity + c + 1 for c in (0, 1)),
    )


def made_of(scheme: Scheme, samples: Span) -> Span:
    """Indices whose analysis reads none but the given samples; an empty range has its end at or
    before its start.
    """
    plan, _ = passes(scheme)
    return (
        max(-((scheme.parity + c - samples[0]) // 2) - plan.reach[c][0] for c in (0, 1)),
        min((samples[1] - 1 - scheme.parity - c) // 2 + 1 - plan.reach[c][1] for c in (0, 1)),
    )


def intersection(one: Span, other: Span) -> Span:
    """Indices that two ranges share; an empty range has its end at its start."""
    low = max(one[0], other[0])
    return low, max(low, min(one[1], other[1]))


def covering_pairs(scheme: Scheme, samples: Span) -> Span:
    """Pairs (2i + parity, 2i + 1 + parity) that cover a range of samples."""
    return (samples[0] - scheme.parity) // 2, (samples[1] - 1 - scheme.parity) // 2 + 1


@cache
def passes(scheme: Scheme) -> tuple[Pass, Pass]:
    """Analysis and synthesis as moves with their ranges, worked out from the outputs backwards."""
    reversed_steps = [
        Step(s.updates, s.first, tuple(-tap for tap in s.taps)) for s in reversed(scheme.steps)
    ]
    return _planned(scheme.steps, scheme.shifts), _planned(reversed_steps, (0, 0))


def _planned(steps: Sequence[Step], shifts: Span) -> Pass:
    """Ranges of every step, so that each channel is right over the wanted pairs (shifted) at the
    end.
    """
    reach = [[shift, shift] for shift in shifts]
    moves: list[Move] = []
    for step in reversed(steps):
        terms: dict[float, tuple[int, ...]] = {}
        for k, tap in enumerate(step.taps):
            terms[tap] = (*terms.get(tap, ()), step.first + k)
        low, high = reach[step.updates]
        moves.append(Move(step.updates, tuple(terms.items()), low, high))
        source = reach[1 - step.updates]
        source[0] = min(source[0], low + step.first)
        source[1] = max(source[1], high + step.first + len(step.taps) - 1)
    return Pass(tuple(reversed(moves)), ((reach[0][0], reach[0][1]), (reach[1][0], reach[1][1])))


def cut_span(span: Span, size: int) -> list[Span]:
    """Consecutive parts of a range of indices, of the given size but for the last."""
    return [(low, min(low + size, span[1])) for low in range(span[0], span[1], size)]

"""One level of the lifting transform by compiled steps, where they were built: the numbers of
`lifting_level`, bit for bit.

Every sum and product is done in the order and with the rounding of the arrays' own; only how often
memory is walked differs.
"""

import ctypes
from collections.abc import Callable
from ctypes import CDLL
from dataclasses import dataclass
from functools import cache
from typing import Any

from calibkit.arrays import Array
from calibkit.numeric.compiled import kernels_for
from calibkit.numeric.wavelet.factor import Scheme
from calibkit.numeric.wavelet.reach import Pass, Span, passes
from calibkit.numeric.wavelet.shrinkage import Shrinkage

CODES = {"soft": 1, "hard": 2, "garrote": 3, "firm": 4}
"""Shrinkage rules as the compiled steps number them; 0 leaves details as they are."""
WIDEST = 256
"""Reach of the steps beyond a block of pairs that the compiled steps have room for; known wavelets
have 50.
"""


@dataclass(frozen=True, slots=True)
class _Plan:
    """Steps as the compiled code reads them (see native/lifting.c)."""

    steps: Any
    factors: Any


def library_for(scheme: Scheme, *arrays: Array) -> CDLL | None:
    """The compiled steps, where they were built, have room for a scheme and can read and write
    arrays as these lie in memory.
    """
    return kernels_for(*arrays) if _fits(scheme) else None


def analyse(
    library: CDLL,
    samples: Array,
    first: int,
    scheme: Scheme,
    block: Span,
    outputs: tuple[tuple[Array, int], ...],
) -> None:
    """Coefficients of the given indices into arrays whose element 0 has a stated index; others are
    dropped.

    `samples`, whose element 0 has the index `first`, hold all that they are made of.
    """
    plan = _plans(scheme)[0]
    (low, at_low), (high, at_high) = outputs
    library.calibkit_analysed(
        plan.steps, plan.factors, samples.ctypes.data, first, *block,
        low.ctypes.data, at_low, low.size, high.ctypes.data, at_high, high.size,
    )  # fmt: skip


def synthesise(
    library: CDLL,
    channels: tuple[Array, Array],
    first: int,
    scheme: Scheme,
    block: Span,
    rule: tuple[int, float, float],
    out: tuple[Array, int],
) -> None:
    """Samples of the given pairs into an array whose element 0 has a stated index; others are
    dropped.

    `channels`, whose elements 0 have the index `first`, hold all that they are made of; `rule` is
    that of `rule_of`.
    """
    plan = _plans(scheme)[1]
    low, high = channels
    made, at = out
    library.calibkit_synthesised(
        plan.steps,
        plan.factors,
        low.ctypes.data,
        high.ctypes.data,
        first,
        *block,
        *rule,
        made.ctypes.data,
        at,
        made.size,
    )


def rule_of(shrink: Callable[[int, Array], Array], level: int) -> tuple[int, float, float] | None:
    """Code, threshold and its square of a shrinkage that the compiled steps know; None where they
    don't.

    At a threshold of zero, soft shrinkage is left to the arrays: the sign of a zero is theirs to
    decide.
    """
    if not isinstance(shrink, Shrinkage):
        return None
    threshold = float(shrink.thresholds[level])
    if threshold > 0.0 or (threshold == 0.0 and shrink.rule != "soft"):
        return CODES[shrink.rule], threshold, threshold**2
    return None


@cache
def _fits(scheme: Scheme) -> bool:
    """Whether the steps reach no farther than the compiled code has room for."""
    return all(high - low <= WIDEST for plan in passes(scheme) for low, high in plan.reach)


@cache
def _plans(scheme: Scheme) -> tuple[_Plan, _Plan]:
    """Analysis and synthesis of a scheme for the compiled code."""
    factors = (*scheme.gains, *(1.0 / gain for gain in scheme.gains))
    forth, back = (_plan(scheme, plan, factors) for plan in passes(scheme))
    return forth, back


def _plan(scheme: Scheme, plan: Pass, factors: tuple[float, ...]) -> _Plan:
    """Numbers in the order that native/lifting.c states."""
    steps = [len(plan.moves), *plan.reach[0], *plan.reach[1], *scheme.shifts, scheme.parity]
    taps = list(factors)
    for move in plan.moves:
        steps += [move.target, move.low, move.high, len(move.terms)]
        for tap, offsets in move.terms:
            steps += [len(offsets), *offsets]
            taps.append(tap)
    encoded = (ctypes.c_int64 * len(steps))(*steps)
    return _Plan(encoded, (ctypes.c_double * len(taps))(*taps))

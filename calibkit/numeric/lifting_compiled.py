"""One level of the lifting transform by compiled steps, where they were built: the numbers of `lifting_level`, bit for bit.

Every sum and product is done in the order and with the rounding of the arrays' own; only how often memory is walked differs.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.native import kernels
from calibkit.numeric.lifting_reach import passes
from calibkit.numeric.shrinkage import Shrinkage

if TYPE_CHECKING:
    from collections.abc import Callable
    from ctypes import CDLL

    from numpy.typing import NDArray

    from calibkit.numeric.factor import Scheme
    from calibkit.numeric.lifting_reach import Pass, Span

    Array = NDArray[np.float64]

CODES = {"soft": 1, "hard": 2, "garrote": 3, "firm": 4}
"""Shrinkage rules as the compiled steps number them; 0 leaves details as they are."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """Steps as the compiled code reads them (see native/lifting.c), and the room that a block needs [numbers]."""

    steps: Any
    factors: Any
    room: int


def serves(*arrays: Array) -> bool:
    """Whether the compiled steps were built and can read and write these arrays as they lie in memory."""
    return kernels() is not None and all(a.dtype == np.float64 and a.flags.c_contiguous for a in arrays)


def analyse(samples: Array, first: int, scheme: Scheme, block: Span, outputs: tuple[tuple[Array, int], ...]) -> None:
    """Coefficients of the given indices into arrays whose element 0 has a stated index; others are dropped.

    `samples`, whose element 0 has the index `first`, hold all that they are made of.
    """
    forth, _ = _plans(scheme)
    room = np.empty(forth.room)
    where = [part for out, origin in outputs for part in (_address(out), origin, out.size)]
    _library().calibkit_analysed(forth.steps, forth.factors, _address(room), _address(samples), first, *block, *where)


def synthesise(
    channels: tuple[Array, Array],
    first: int,
    scheme: Scheme,
    block: Span,
    rule: tuple[int, float, float],
    out: tuple[Array, int],
) -> None:
    """Samples of the given pairs into an array whose element 0 has a stated index; others are dropped.

    `channels`, whose elements 0 have the index `first`, hold all that they are made of; `rule` is that of `rule_of`.
    """
    _, back = _plans(scheme)
    room = np.empty(back.room)
    given = (_address(channels[0]), _address(channels[1]), first)
    where = (_address(out[0]), out[1], out[0].size)
    _library().calibkit_synthesised(back.steps, back.factors, _address(room), *given, *block, *rule, *where)


def rule_of(shrink: Callable[[int, Array], Array], level: int) -> tuple[int, float, float] | None:
    """Code, threshold and its square of a shrinkage that the compiled steps know; None where they don't.

    At a threshold of zero, soft shrinkage is left to the arrays: the sign of a zero is theirs to decide.
    """
    if not isinstance(shrink, Shrinkage):
        return None
    threshold = float(shrink.thresholds[level])
    if threshold > 0.0 or (threshold == 0.0 and shrink.rule != "soft"):
        return CODES[shrink.rule], threshold, threshold**2
    return None


def _address(array: Array) -> int:
    """Where the first element lies."""
    return int(array.__array_interface__["data"][0])


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
    return _Plan(encoded, (ctypes.c_double * len(taps))(*taps), int(_library().calibkit_lifting_room(encoded)))


def _library() -> CDLL:
    """The compiled library, whose presence `serves` has told."""
    library = kernels()
    if library is None:
        raise RuntimeError("no compiled kernels")
    return library

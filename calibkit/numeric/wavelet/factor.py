"""Lifting schemes, written out or factored from a filter bank (Daubechies & Sweldens 1998) with a
search on condition.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError

Laurent = tuple[int, tuple[float, ...]]
"""A Laurent polynomial in the shift Z, (Z·s)_i = s_(i+1): its lowest power and its coefficients
from there upwards.
"""
Row = tuple[Laurent, Laurent]
"""How one output depends on the two channels: (of the approximation channel, of the detail
channel).
"""

APPROXIMATION, DETAIL = 0, 1
"""The two channels, as indices of rows, gains and shifts."""
ONE: Laurent = (0, (1.0,))
ZERO: Laurent = (0, ())
BEAM = 64
"""Partial factorings kept at each length of the remainders."""
FINALISTS = 8
"""Complete factorings compared by their conditioning, the last step included."""
NEGLIGIBLE = 1e-12
"""End taps of a remainder below this are rounding (filter taps are of the order of one)."""
POLISHINGS = 3
ACCEPTED = 1e-11
"""Largest difference from the table's taps that still counts as that bank: tables are good to 1e-16
… 3e-12.
"""
WORST_CONDITION = 12.0
"""Largest accepted logarithm of the condition number: beyond, reconstruction loses more than five
of sixteen digits.
"""


@dataclass(frozen=True, slots=True)
class Step:
    """One lifting step: updated channel_i += Σ_k taps[k] · other channel_(i + first + k)."""

    updates: int
    first: int
    taps: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Scheme:
    """Lifting steps in the order of analysis, then gains and shifts of approximation and detail.

    The approximation channel starts as samples 2i + parity, the detail channel as samples 2i + 1 +
    parity; after the steps the outputs are gain · channel_(i + shift).
    """

    name: str
    steps: tuple[Step, ...]
    gains: tuple[float, float]
    parity: int = 0
    shifts: tuple[int, int] = (0, 0)

    def __hash__(self) -> int:
        """By the name alone: what is known of a scheme is looked up at every level of every chunk,
        and its steps are long.
        """
        return hash(self.name)

    def polyphase(self) -> tuple[Row, Row]:
        """Rows of the analysis polyphase matrix that the steps multiply to: of the approximation,
        of the detail.
        """
        rows: list[Row] = [(ONE, ZERO), (ZERO, ONE)]
        for step in self.steps:
            own, other, q = rows[step.updates], rows[1 - step.updates], (step.first, step.taps)
            rows[step.updates] = (
                _plus(own[0], _times(q, other[0])),
                _plus(own[1], _times(q, other[1])),
            )
        (low, high), shifts, gains = rows, self.shifts, self.gains
        a, d = (shifts[0], (gains[0],)), (shifts[1], (gains[1],))
        return (_times(a, low[0]), _times(a, low[1])), (_times(d, high[0]), _times(d, high[1]))


ROOT2, ROOT3 = math.sqrt(2.0), math.sqrt(3.0)
ALPHA, BETA, GAMMA, DELTA = (
    -1.586134342059924,
    -0.052980118572961,
    0.882911075530934,
    0.443506852043971,
)
ZETA = 1.149604398860241
"""CDF 9/7 lifting coefficients (Daubechies & Sweldens 1998, section 7.7; ISO/IEC 15444-1 annex F).
"""

LITERAL = {
    literal.name: literal
    for literal in (
        Scheme(
            "haar",
            (Step(DETAIL, 0, (-1.0,)), Step(APPROXIMATION, 0, (0.5,))),
            (ROOT2, 1.0 / ROOT2),
        ),
        Scheme(
            "cdf53",
            (Step(DETAIL, 0, (-0.5, -0.5)), Step(APPROXIMATION, -1, (0.25, 0.25))),
            (ROOT2, 1.0 / ROOT2),
        ),
        Scheme(
            "cdf97",
            (
                Step(DETAIL, 0, (ALPHA, ALPHA)),
                Step(APPROXIMATION, -1, (BETA, BETA)),
                Step(DETAIL, 0, (GAMMA, GAMMA)),
                Step(APPROXIMATION, -1, (DELTA, DELTA)),
            ),
            (ZETA, 1.0 / ZETA),
        ),
        Scheme(
            "db2",
            (
                Step(DETAIL, 0, (-ROOT3,)),
                Step(APPROXIMATION, 0, (ROOT3 / 4.0, (ROOT3 - 2.0) / 4.0)),
                Step(DETAIL, -1, (1.0,)),
            ),
            ((ROOT3 + 1.0) / ROOT2, (ROOT3 - 1.0) / ROOT2),
        ),
    )
}
"""Schemes written out by hand; every other name is a PyWavelets bank that is factored."""


@dataclass(frozen=True, slots=True)
class _Partial:
    """A factoring under way: what is left of the low-pass row, the steps taken, the log of their
    condition number.
    """

    cost: float
    row: Row
    steps: tuple[Step, ...]

    @property
    def length(self) -> int:
        """Taps that are left in the row."""
        return len(self.row[0][1]) + len(self.row[1][1])


@cache
def factor_bank(name: str) -> Scheme:
    """Lifting scheme of a discrete PyWavelets filter bank, equal to it in index, sign and scale.

    Raises
    ------
    FitError : the bank's own table does not reconstruct, or no well-conditioned factoring was
        found; the message states
        the largest difference between the filters of the steps and the table.

    Notes
    -----
    Euclid's algorithm on the polyphase components of the low-pass filter (Daubechies & Sweldens
    1998, section 7) has a choice at every division: which end to cancel, which of two equally long
    components to reduce. Taken greedily the quotients explode; a beam search keeps the partial
    factorings whose steps multiply to the smallest condition number. The steps found are then
    polished by Gauss-Newton on the taps of the table, because divisions by small end taps leave
    errors of 1e-11. Both ways to name the samples even and odd are tried. Takes 1 ms (short banks)
    to 0.2 s.
    """
    import pywt  # costs start-up that literal schemes don't need

    wavelet = pywt.Wavelet(name)
    candidates = [
        (scheme, bank)
        for parity in (0, 1)
        for bank in [(_polyphase(wavelet.dec_lo, parity), _polyphase(wavelet.dec_hi, parity))]
        for scheme in _factorings(name, bank, parity)
    ]
    scheme, bank = min(candidates, key=lambda pair: _condition(pair[0]))
    scheme = _polished(scheme, bank)
    error = _error(scheme, bank)
    if not (error <= ACCEPTED and _condition(scheme) <= WORST_CONDITION):
        raise FitError(
            f"wavelet {name!r} cannot be factored into lifting steps: the best steps found"
            f" reproduce its filters with an error of {error:.1e} at condition number"
            f" {math.exp(_condition(scheme)):.1e}, {ACCEPTED:.0e} and"
            f" {math.exp(WORST_CONDITION):.1e} are the limits",
            hint="use db1 to db25, sym2 to sym20, coif1 to coif8, a bior or rbio bank, or cdf97",
        )
    return scheme


def _condition(scheme: Scheme) -> float:
    """Natural logarithm of a bound on the scheme's condition number, from the norms of its steps
    and gains.
    """
    approximation, detail = (abs(math.log(abs(gain))) for gain in scheme.gains)
    return approximation + detail + sum(_shear(step.taps) for step in scheme.steps)


def _polyphase(taps: Sequence[float], parity: int) -> Row:
    """Polyphase components of a PyWavelets analysis filter: output_i = Σ_k taps[k] · sample_(2i + 1
    − k).
    """
    at = {1 - k - parity: float(tap) for k, tap in enumerate(taps)}
    even = [(m // 2, tap) for m, tap in sorted(at.items()) if m % 2 == 0]
    odd = [((m - 1) // 2, tap) for m, tap in sorted(at.items()) if m % 2]
    return _trimmed(even[0][0], [tap for _, tap in even], 0.0), _trimmed(
        odd[0][0], [tap for _, tap in odd], 0.0
    )


def _factorings(name: str, bank: tuple[Row, Row], parity: int) -> Iterator[Scheme]:
    """Complete factorings of a bank, from the best-conditioned reductions of its low-pass row."""
    low, high = bank
    for partial in _reductions(low):
        lowest, (gain,) = partial.row[0]
        row = list(high)
        for step in partial.steps:  # divided out of the matrix on the right
            q = (step.first, tuple(-tap for tap in step.taps))
            row[1 - step.updates] = _plus(row[1 - step.updates], _times(q, row[step.updates]))
        # the low-pass row is now (gain Z^lowest, 0), so this entry is a monomial but for rounding
        powers, taps = row[1]
        k = max(range(len(taps)), key=lambda j: abs(taps[j]))
        last = _trimmed(
            row[0][0] - powers - k, [tap / taps[k] for tap in row[0][1]], 100.0 * NEGLIGIBLE
        )
        steps = (*partial.steps, Step(DETAIL, *last)) if last[1] else partial.steps
        yield Scheme(name, steps, (gain, taps[k]), parity, (lowest, powers + k))


def _reductions(row: Row) -> list[_Partial]:
    """Ways to reduce a row to (monomial, 0) by lifting steps, the best conditioned first: a beam
    search.
    """
    start = _Partial(0.0, row, ())
    waiting = {start.length: [start]}
    finished: list[_Partial] = []
    for length in range(start.length, 1, -1):
        kept = sorted(waiting.pop(length, []), key=lambda partial: partial.cost)[:BEAM]
        for partial in kept:
            if len(partial.row[0][1]) == 1:
                finished.append(_ended(partial))
            for follower in _followers(partial):
                waiting.setdefault(follower.length, []).append(follower)
    return sorted(finished, key=lambda partial: partial.cost)[:FINALISTS]


def _ended(partial: _Partial) -> _Partial:
    """Cancel the whole detail component by an approximation component of one tap."""
    (lowest, (pivot,)), (first, taps) = partial.row
    step = Step(APPROXIMATION, first - lowest, tuple(tap / pivot for tap in taps))
    done = _append_step(partial, step, ZERO)
    return replace(done, cost=done.cost + abs(math.log(abs(pivot))))


def _followers(partial: _Partial) -> Iterator[_Partial]:
    """Every way to cancel one end tap of the longer component by the shorter one."""
    for reduced in (0, 1):
        (low, taps), (other_low, other) = partial.row[reduced], partial.row[1 - reduced]
        if len(taps) < len(other):
            continue
        for end, first in ((0, low - other_low), (-1, low + len(taps) - other_low - len(other))):
            q = taps[end] / other[end]
            left = list(taps)
            for k, tap in enumerate(other):
                left[first + other_low - low + k] -= q * tap
            left[end] = 0.0
            remainder = _trimmed(low, left, NEGLIGIBLE)
            if remainder[1]:
                yield _append_step(partial, Step(1 - reduced, first, (q,)), remainder)


def _append_step(partial: _Partial, step: Step, remainder: Laurent) -> _Partial:
    """Append a step, merged with the last one where both update the same channel."""
    row = (remainder, partial.row[1]) if step.updates == DETAIL else (partial.row[0], remainder)
    if not partial.steps or partial.steps[-1].updates != step.updates:
        return _Partial(partial.cost + _shear(step.taps), row, (*partial.steps, step))
    last = partial.steps[-1]
    merged = Step(step.updates, *_plus((last.first, last.taps), (step.first, step.taps)))
    cost = partial.cost - _shear(last.taps) + _shear(merged.taps)
    return _Partial(cost, row, (*partial.steps[:-1], merged))


def _shear(taps: Sequence[float]) -> float:
    """Logarithm of the norm of a lifting step, asinh(|q|/2) for a shear by |q| = Σ |taps|."""
    return math.asinh(sum(abs(tap) for tap in taps) / 2.0)


def _error(scheme: Scheme, bank: tuple[Row, Row]) -> float:
    """Largest difference of the scheme's filter taps from the bank's."""
    return float(np.max(np.abs(_difference(scheme, bank))))


def _difference(scheme: Scheme, bank: tuple[Row, Row]) -> Array:
    """Differences of the scheme's filter taps from the bank's, the four components one after the
    other.
    """
    width = (
        2 * (len(bank[0][0][1]) + len(bank[1][0][1]))
        + 4 * sum(len(step.taps) for step in scheme.steps)
        + 64
    )
    out = np.zeros((4, width))
    for sign, rows in ((1.0, scheme.polyphase()), (-1.0, bank)):
        for line, (low, taps) in zip(out, (*rows[0], *rows[1]), strict=True):
            line[width // 2 + low : width // 2 + low + len(taps)] += sign * np.asarray(taps)
    return out.ravel()


def _polished(scheme: Scheme, bank: tuple[Row, Row]) -> Scheme:
    """Adjust the taps and gains by Gauss-Newton until the scheme's filters are the bank's; never
    worse than before.
    """
    best, error = scheme, _error(scheme, bank)
    for _ in range(POLISHINGS):
        taps = [tap for step in scheme.steps for tap in step.taps]
        parameters = np.array([*taps, *scheme.gains])
        difference = _difference(scheme, bank)
        # the filters are linear in every single parameter, so a unit step is its exact derivative
        jacobian = np.stack(
            [
                _difference(_with(scheme, parameters + unit), bank) - difference
                for unit in np.eye(parameters.size)
            ],
            axis=1,
        )
        reached = jacobian.any(axis=1)
        correction = np.linalg.lstsq(jacobian[reached], -difference[reached], rcond=NEGLIGIBLE)[0]
        if not np.max(np.abs(correction)) < 0.1:
            break
        scheme = _with(scheme, parameters + correction)
        if not _error(scheme, bank) < error:
            break
        best, error = scheme, _error(scheme, bank)
    return best


def _with(scheme: Scheme, parameters: Array) -> Scheme:
    """The same scheme with other parameters [p]: all taps, then the two gains."""
    values = iter(parameters.tolist())
    steps = tuple(
        replace(step, taps=tuple(next(values) for _ in step.taps)) for step in scheme.steps
    )
    return replace(scheme, steps=steps, gains=(next(values), next(values)))


def _times(a: Laurent, b: Laurent) -> Laurent:
    """Product of two Laurent polynomials."""
    if not a[1] or not b[1]:
        return ZERO
    return a[0] + b[0], tuple(np.convolve(a[1], b[1]).tolist())


def _plus(a: Laurent, b: Laurent) -> Laurent:
    """Sum of two Laurent polynomials."""
    if not a[1] or not b[1]:
        return b if b[1] else a
    low = min(a[0], b[0])
    total = [0.0] * (max(a[0] + len(a[1]), b[0] + len(b[1])) - low)
    for start, taps in (a, b):
        for k, tap in enumerate(taps):
            total[start - low + k] += tap
    return low, tuple(total)


def _trimmed(low: int, taps: Sequence[float], limit: float) -> Laurent:
    """Laurent polynomial without the end taps that are at most limit in size."""
    kept = [k for k, tap in enumerate(taps) if abs(tap) > limit]
    return (low + kept[0], tuple(taps[kept[0] : kept[-1] + 1])) if kept else ZERO

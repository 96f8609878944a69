"""How a chain with memory keeps time: what a start, a gap and a jump of the case do to its results,
bounded by the chain's own lags.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np

from calibkit.errors import OutputError
from calibkit.firmware import bounds, formats, program, vectors
from calibkit.firmware.chain import Chain, Pace, Sum, Trials

SETTLED = 0.01
"""Share of the error of a start on the fastest fitted ramp at which the lags count as settled."""
FASTEST = 2
"""Multiple of the largest fitted rate up to which a chain with memory follows the case, and its
printed error bound holds.
"""
NOISE = 128
"""A move of this share of the range in which the case is followed is no jump."""
CLOCK = (
    (0.0, 1, 1000.0),
    (0.4, 1, 1.0),
    (0.9, 2, 1.0),
    (1.0, 1, 0.25),
    (2.0, 1, 2.75),
    (60.0, 2, 1.0),
    (2.2, 1, 1.0),
    (2.0, 1, 0.7),
    (2.0, 1, 1.3),
    (2.0, 3, 1.0),
    (3.5, 1, 1.0),
    (40.0, 1, 1000.0),
    (40.0, 2, 1.0),
    (40.3, 1, 3.0),
)
"""Calls of the self-test by the clock: where the case is, in moves that an interval allows from the
middle of its range; how many calls; and how many intervals each is after the one before.
"""
MOST_UPDATES = 100_000
"""Updates after which lags that have not settled are refused."""


def keep_time(chain: Chain, followed: str, rate: Fraction, longest_gap_s: float) -> Chain:
    """Chain that keeps time by the input `followed`, with the largest fitted rate [°C/min] and the
    longest gap [s] that is bridged; OutputError for an interval that is no whole number of
    milliseconds.
    """
    h = chain.structure.interval_s or 0.0
    if chain.structure.interval_ms < 1 or abs(1000.0 * h - chain.structure.interval_ms) > 1e-6:
        raise OutputError(
            f"interval_s = {h:g}: no whole number of milliseconds, which the firmware counts",
            hint="fit with an interval of whole milliseconds",
        )
    low, high = chain.tables[f"{followed}_range"]
    longest = max(1, int(longest_gap_s / h))
    gains = bounds.find_gains(chain, program.quantise(chain, formats.FORMATS["f64"]))
    started = _errors_of_start(chain, gains)
    settled = len(started) - 1
    move = max(FASTEST * rate * Fraction(h) / 60, (high - low) / NOISE)
    structure = replace(chain.structure, pace=Pace(followed, longest, "pace", tuple(chain.ramped)))
    timing = [
        f"jump          a {followed} {float(move):.3g} degC an interval from the last is not used",
        f"gap           up to {longest * h:g} s is bridged in a straight line",
    ]
    if chain.structure.summing:
        timing[1] += "; a longer one is left out of the sum: anchor it"
    if settled:
        worst = f"while the case moves by no more than {float(rate):.3g} degC/min"
        bridged = _errors_of_gap(chain, gains, longest)
        timing[1] += f", wrong by up to {_listed(chain, bridged)} {worst}; a longer one is a start"
        timing.append(
            f"start         STARTING for {settled * h:g} s after a reset, which, {worst}, is wrong"
            f" by up to {_listed(chain, started[0])} at first, {_listed(chain, started[-1])} then"
        )
    tables = {**chain.tables, "pace": (Fraction(settled), move)}
    return replace(chain, structure=structure, tables=tables, timing=tuple(timing))


def _listed(chain: Chain, errors: Mapping[str, float]) -> str:
    """Error of each output with its unit."""
    return ", ".join(
        f"{errors[output.name]:.2g} {output.unit}" for output in chain.structure.outputs
    )


def _errors_of_start(
    chain: Chain, gains: Mapping[str, Mapping[str, float]]
) -> list[Mapping[str, float]]:
    """Largest error of each output from the reset on, update by update until the lags have
    settled; none where there is no lag.
    """
    kept = {name: float(value) for name, value in chain.ramped.items()}
    found = [_weighed(gains, kept)]
    while chain.ramped and any(
        error > SETTLED * found[0][name] for name, error in found[-1].items()
    ):
        if len(found) > MOST_UPDATES:
            raise OutputError(
                f"the lags have not settled after {MOST_UPDATES} updates",
                hint="fit with a longer interval_s",
            )
        kept = _advanced(chain, kept, 0.0)
        found.append(_weighed(gains, kept))
    return found


def _errors_of_gap(
    chain: Chain, gains: Mapping[str, Mapping[str, float]], longest: int
) -> Mapping[str, float]:
    """Largest error of each output behind a gap of so many intervals, where the case was anywhere
    between its ends that the largest fitted rate reaches: at most 2 R s (g − s)/g from the line.
    """
    kept = dict.fromkeys(chain.ramped, 0.0)
    most = dict(kept)
    away = [2.0 * k * (longest - k) / longest for k in range(longest + 1)]
    for k in range(longest):
        kept = _advanced(chain, kept, (away[k + 1] - away[k]) / FASTEST)
        most = {name: max(most[name], abs(value)) for name, value in kept.items()}
    # a lag forgets, so that its last error counts; a difference of two is bounded by either's
    driven = {name: _is_driven(chain, name) for name in kept}
    return _weighed(gains, {n: abs(kept[n]) if driven[n] else max(most.values()) for n in kept})


def _is_driven(chain: Chain, name: str) -> bool:
    """Whether a remembered value follows the case alone, not another remembered value."""
    sources = {memory.name: memory.source for memory in chain.structure.memories}
    return {sources[factor] for factor, _ in _linear(chain, name) if factor in sources} == {name}


def _weighed(
    gains: Mapping[str, Mapping[str, float]], kept: Mapping[str, float]
) -> Mapping[str, float]:
    """Error of each output by those of remembered values."""
    return {
        output: sum(by[name] * abs(value) for name, value in kept.items())
        for output, by in gains.items()
    }


def _linear(chain: Chain, name: str) -> Iterator[tuple[str, float]]:
    """Factors of a remembered value, a sum of values with constant weights, and their weights."""
    (step,) = (s for s in chain.structure.steps if s.name == name and isinstance(s, Sum))
    for term in step.terms:
        weight = float(chain.tables[term.table][0]) if term.table else 1.0
        yield term.factors[0], term.sign * weight


def _advanced(chain: Chain, kept: Mapping[str, float], moved: float) -> dict[str, float]:
    """Errors of remembered values one update later, the case moving by an error of so many times
    its fastest usual move.
    """
    sources = {memory.name: memory.source for memory in chain.structure.memories}
    found = {}
    for name in kept:
        found[name] = sum(
            weight
            * (kept[sources[factor]] if factor in sources else moved * float(chain.usual[factor]))
            for factor, weight in _linear(chain, name)
        )
    return found


def by_the_clock(chain: Chain, trials: Trials) -> Trials:
    """Trials with the calls of CLOCK behind them, in which the case moves from the middle of its
    range by shares of what an interval allows.
    """
    pace, interval = chain.structure.pace, chain.structure.interval_ms
    assert pace is not None  # noqa: S101 (a chain that keeps time)
    move = float(chain.tables[pace.table][1])
    inputs, units = {}, {entry.name: entry.unit for entry in chain.structure.inputs}
    for name, column in trials.inputs.items():
        low, high = (float(limit) for limit in chain.tables[f"{name}_range"])
        # the air moves half as far, a rate stays within its range
        pull = move if name == pace.followed else 0.5 * move
        still = 0.0 if units[name] == "degC" else 0.1 * (high - low)
        away = np.array([still or share * pull for share, _, _ in CLOCK])
        added = vectors.coarsen(0.5 * (low + high) + away, 8.0 * move)
        inputs[name] = np.concatenate([column, added])
    calls = [(count, round(share * interval)) for _, count, share in CLOCK]
    if settled := int(chain.tables[pace.table][0]):  # STARTING ends
        inputs = {name: np.append(column, [column[-1]] * 2) for name, column in inputs.items()}
        calls += [(settled, 0), (1, interval)]
    updates, elapsed = zip(*calls, strict=True)
    return Trials(inputs, (*trials.updates, *updates), (*(0 for _ in trials.updates), *elapsed))

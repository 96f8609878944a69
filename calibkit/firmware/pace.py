"""How a chain with memory keeps time: what a start, a gap and a jump of the case do to its results,
bounded by the chain's own lags.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from typing import Self

import numpy as np

from calibkit.errors import OutputError
from calibkit.firmware import bounds, exact, formats, vectors
from calibkit.firmware.chain import Chain, Pace, Trials
from calibkit.firmware.steps import Sum
from calibkit.numeric.arrays import Array

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


@dataclass(frozen=True, slots=True)
class _Lags:
    """The remembered values of a chain that a reset takes for 0: next = decay · values + driven ·
    move, the move in those of FASTEST times the largest fitted rate.
    """

    names: tuple[str, ...]
    decay: Array
    driven: Array
    ramped: Array
    """On the fastest fitted ramp."""
    gains: Mapping[str, Array]
    """Output → largest derivative by each value."""

    @classmethod
    def find(cls, chain: Chain) -> Self:
        """Those of a chain, whose steps are sums of values with constant weights."""
        names = tuple(chain.ramped)
        sources = {m.name: m.source for m in chain.structure.memories if m.source in names}
        decay, driven = np.zeros((len(names), len(names))), np.zeros(len(names))
        sums = {step.name: step for step in chain.structure.steps if isinstance(step, Sum)}
        for row, name in enumerate(names):
            for term in sums[name].terms:
                weight = float(chain.tables[term.table][0]) if term.table else 1.0
                (factor,) = term.factors
                if factor in sources:
                    decay[row, names.index(sources[factor])] += term.sign * weight
                else:
                    driven[row] += term.sign * weight * float(chain.usual[factor])
        ramped = np.array([float(chain.ramped[name]) for name in names])
        gains = {}
        quantised = chain.quantise(formats.FORMATS["f64"])
        for output, output_gains in bounds.find_gains(chain, quantised).items():
            gains[output] = np.array([output_gains[name] for name in names])
        return cls(names, decay, driven, ramped, gains)

    def weigh(self, values: Array) -> dict[str, float]:
        """Error of each output by those of the values."""
        return {output: float(gain @ np.abs(values)) for output, gain in self.gains.items()}


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
    lags = _Lags.find(chain)
    started = _errors_of_start(lags)
    settling_updates = len(started) - 1
    # of slow ramps noise of the thermometer would be a jump
    move = max(FASTEST * rate * Fraction(h) / 60, (high - low) / NOISE)
    structure = replace(chain.structure, pace=Pace(followed, longest, "pace", tuple(chain.ramped)))
    furthest = exact.round_to(float(move), 3, up=True)
    timing = [
        (
            f"jump          a {followed} more than {furthest:.3g} degC an interval from the last is"
            " not used"
        ),
        f"gap           up to {longest * h:g} s is bridged in a straight line",
    ]
    if chain.structure.summing:
        timing[1] += "; a longer one is left out of the sum: anchor it"
    if settling_updates:
        highest = exact.round_to(float(rate), 3, up=False)
        worst = f"while the case moves by no more than {highest:.3g} degC/min"
        bridged = _errors_of_gap(lags, longest)
        timing[1] += f", wrong by up to {_listed(chain, bridged)} {worst}; a longer one is a start"
        first, last = _listed(chain, started[0]), _listed(chain, started[-1])
        timing.append(
            f"start         STARTING for {settling_updates * h:g} s after a reset, which, {worst},"
            f" is wrong by up to {first} at first, {last} then"
        )
    tables = {**chain.tables, "pace": (Fraction(settling_updates), move)}
    return replace(chain, structure=structure, tables=tables, timing=tuple(timing))


def _listed(chain: Chain, errors: Mapping[str, float]) -> str:
    """Error of each output with its unit."""
    return ", ".join(
        f"{exact.round_to(errors[output.name], 2, up=True):.2g} {output.unit}"
        for output in chain.structure.outputs
    )


def _errors_of_start(lags: _Lags) -> list[Mapping[str, float]]:
    """Largest error of each output from the reset on, update by update until the lags have
    settled; none where there is no lag.
    """
    lag_errors = lags.ramped
    errors_by_update: list[Mapping[str, float]] = [lags.weigh(lag_errors)]
    while lags.names and any(
        error > SETTLED * errors_by_update[0][name] for name, error in errors_by_update[-1].items()
    ):
        if len(errors_by_update) > MOST_UPDATES:
            raise OutputError(
                f"the lags have not settled after {MOST_UPDATES} updates",
                hint="fit with a longer interval_s",
            )
        lag_errors = lags.decay @ lag_errors
        errors_by_update.append(lags.weigh(lag_errors))
    return errors_by_update


def _errors_of_gap(lags: _Lags, longest: int) -> Mapping[str, float]:
    """Largest error of each output behind a gap of so many intervals, where the case was anywhere
    between its ends that the largest fitted rate reaches: at most 2 R s (g − s)/g from the line.
    """
    lag_errors, largest_errors = np.zeros(len(lags.names)), np.zeros(len(lags.names))
    # of a case that ran ahead at the largest rate and came back, from the line between both ends
    distances = [2.0 * k * (longest - k) / longest for k in range(longest + 1)]
    for before, after in pairwise(distances):
        lag_errors = lags.decay @ lag_errors + lags.driven * (after - before) / FASTEST
        largest_errors = np.maximum(largest_errors, np.abs(lag_errors))
    # a lag forgets, so that its last error counts; a difference of two is bounded by either's
    is_single_lag = np.count_nonzero(lags.decay, axis=1) == 1
    return lags.weigh(np.where(is_single_lag, np.abs(lag_errors), largest_errors.max(initial=0.0)))


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
        rate_offset = 0.0 if units[name] == "degC" else 0.1 * (high - low)
        offsets = np.array([rate_offset or share * pull for share, _, _ in CLOCK])
        added = vectors.coarsen(0.5 * (low + high) + offsets, 8.0 * move)
        inputs[name] = np.concatenate([column, added])
    calls = [(count, round(share * interval)) for _, count, share in CLOCK]
    settling_updates = int(chain.tables[pace.table][0])
    if settling_updates:  # one call up to the end of STARTING, and one without it
        inputs = {name: np.append(column, [column[-1]] * 2) for name, column in inputs.items()}
        calls += [(settling_updates, 0), (1, interval)]
    updates, elapsed = zip(*calls, strict=True)
    return Trials(inputs, (*trials.updates, *updates), (*(0 for _ in trials.updates), *elapsed))

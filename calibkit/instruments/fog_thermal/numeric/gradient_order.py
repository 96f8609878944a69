"""The order of the drift coefficients over temperature rate, chosen by what it does to a rate it
has not seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.arrays import Array
from calibkit.instruments.fog_thermal.numeric import compensation, gradient
from calibkit.instruments.fog_thermal.numeric.compensation import WORSE, LeftOutRamps

SAME_RATE = 0.1
"""Relative difference up to which two ramps count as one temperature rate."""
MARGIN = 0.9
"""Factor below raw that the pooled error must reach: of several orders one beats raw by some
percent by luck alone.
"""


@dataclass(frozen=True, slots=True)
class LeftOutRates(LeftOutRamps):
    """Drift rms [°/h] of each ramp's log for an order of the polynomials: `compensated` is by a
    model that was fitted without that ramp's rate, `fitted` by one that was fitted with it.
    """

    order: int
    fitted: Array

    @property
    def helps(self) -> bool:
        """Whether the left-out ramps came out clearly better than raw, and no ramp worse, left out
        or not.

        A left-out edge rate is held or clamped, so that only the full fit shows what the model does
        to it.
        """
        worst = np.maximum(self.compensated, self.fitted)
        return self.pooled <= MARGIN * self.pooled_raw and bool(np.all(worst <= WORSE * self.raw))


def _rate_groups(ramps: Sequence[gradient.RampFit]) -> list[list[int]]:
    """Indices of the ramps, grouped by temperature rate, slowest to fastest."""
    order = sorted(range(len(ramps)), key=lambda i: ramps[i].rate)
    groups: list[list[int]] = []
    for i in order:
        last = ramps[groups[-1][0]].rate if groups else None
        if last is not None and abs(ramps[i].rate - last) <= SAME_RATE * abs(last):
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _leave_one_rate_out(
    ramps: Sequence[gradient.RampFit],
    logs: Sequence[gradient.Blocks],
    order: int,
    side: str,
    group: int,
) -> LeftOutRates:
    """Fit the polynomials without each rate in turn and compensate that rate's logs as the
    instrument would.

    The left-out rate may lie outside the remaining ones: it is then clamped or held exactly as at
    run time. `group` is the number of intervals that the drift figure averages. Needs more rates
    than order + 1.
    """
    raw = np.array([compensation.drift_rms(log.indication, group) for log in logs])
    compensated = np.zeros(len(ramps))
    groups = _rate_groups(ramps)
    for left in groups:
        polynomial = gradient.fit_over_rates(
            [ramps[i] for other in groups if other is not left for i in other], order, side
        )
        for i in left:
            compensated[i] = _left(polynomial, logs[i], group)
    whole = gradient.fit_over_rates(ramps, order, side)
    return LeftOutRates(
        raw, compensated, order, np.array([_left(whole, log, group) for log in logs])
    )


def _left(polynomial: gradient.RatePolynomial, log: gradient.Blocks, group: int) -> float:
    """Drift rms [°/h] that a side's polynomials leave of a log."""
    delta = compensation.increments([polynomial], log.gradient, log.rate).delta
    return compensation.drift_rms(log.indication - compensation.recursive(delta), group)


def candidates(
    ramps: Sequence[gradient.RampFit], logs: Sequence[gradient.Blocks], side: str, group: int
) -> list[LeftOutRates]:
    """Leave-one-rate-out results of every order that the rates of a side can test: four rates never
    test the cubic.
    """
    return [
        _leave_one_rate_out(ramps, logs, order, side, group)
        for order in range(len(_rate_groups(ramps)) - 1)
    ]


def best(results: Sequence[LeftOutRates]) -> LeftOutRates | None:
    """Of the orders that help, the one with the smallest pooled error; none when no order helps."""
    helping = [result for result in results if result.helps]
    return min(helping, key=lambda result: result.pooled) if helping else None

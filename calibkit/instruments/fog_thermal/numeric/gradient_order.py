"""Order of the polynomials of the drift coefficients over temperature rate, chosen by
leave-one-rate-out.
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
"""Largest ratio of the pooled error to raw with which an order helps: of several orders one is some
percent better by chance.
"""


@dataclass(frozen=True, slots=True)
class LeftOutRates(LeftOutRamps):
    """Drift rms [ramps, °/h] of the ramps' logs for one order: `compensated` by a model fitted
    without the ramp's rate, `fitted` by the model fitted to all rates.
    """

    order: int
    fitted: Array

    @property
    def helps(self) -> bool:
        """Whether the pooled error on left-out ramps is clearly below raw and no ramp became worse,
        left out or not.

        If the slowest or the fastest rate is left out, the model holds or clamps it; only the fit
        to all rates shows the effect of the model there.
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
    """Fit the polynomials without each rate in turn and compensate the logs of that rate as at run
    time.

    A left-out rate outside the remaining ones is held or clamped as at run time. `group` is the
    number of intervals in one mean of the drift figure. More rates than order + 1 are needed.
    """
    raw = np.array([compensation.drift_rms(log.indication, group) for log in logs])
    errors: dict[int, Array] = {}
    groups = _rate_groups(ramps)
    for left in groups:
        polynomial = gradient.fit_over_rates(
            [ramps[i] for other in groups if other is not left for i in other], order, side
        )
        for i in left:
            errors[i] = _residual(polynomial, logs[i], group)
    whole = gradient.fit_over_rates(ramps, order, side)
    return LeftOutRates(
        raw,
        np.array([np.std(errors[i]) for i in range(len(ramps))]),
        tuple(errors[i] for i in range(len(ramps))),
        order,
        np.array([np.std(_residual(whole, log, group)) for log in logs]),
    )


def _residual(polynomial: gradient.RatePolynomial, log: gradient.Blocks, group: int) -> Array:
    """Means [m, °/h] of a log after compensation by the polynomials of a side."""
    delta = compensation.increments([polynomial], log.gradient, log.rate).delta
    return compensation.figure_means(log.indication - compensation.recursive(delta), group)


def candidates(
    ramps: Sequence[gradient.RampFit], logs: Sequence[gradient.Blocks], side: str, group: int
) -> list[LeftOutRates]:
    """Leave-one-rate-out results of every order that the rates of a side can test; four rates
    cannot test the cubic.
    """
    return [
        _leave_one_rate_out(ramps, logs, order, side, group)
        for order in range(len(_rate_groups(ramps)) - 1)
    ]


def best(results: Sequence[LeftOutRates]) -> LeftOutRates | None:
    """Result of the order with the smallest pooled error among those that help; None if none do."""
    helping = [result for result in results if result.helps]
    return min(helping, key=lambda result: result.pooled) if helping else None

"""The published scheme for the logs of a recipe: drift.json (a_j of each ramp), and which
polynomials a_j(r) go into drift_rate.json.

    ω_k - ω_(k-1) = a_0(r) + a_1(r) G_(k-1) + a_2(r) G²_(k-1),   a_j(r) = Σ_m c_jm r^m

G is the temperature gradient and r the rate of the chamber air, positive on heating; sides are
heating and cooling. The sum of the steps is taken off the indication (`published`). The order of
a_j(r) is the recipe's, or the best of those that left-out temperature rates can test; none where no
order is clearly better than no compensation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.fog_thermal.numeric import drift_figures, published
from calibkit.instruments.fog_thermal.numeric.drift_figures import WORSE
from calibkit.instruments.fog_thermal.ramps import PreparedLog, Ramp
from calibkit.instruments.fog_thermal.recipe import Drift
from calibkit.numeric.thermal.left_out import LeftOutErrors, blocks_per_figure

SAME_RATE = 0.1
"""Relative difference up to which two ramps count as one temperature rate."""
MARGIN = 0.9
"""Largest ratio of the pooled error to raw with which an order helps: of several orders one is some
percent better by chance.
"""


@dataclass(frozen=True, slots=True)
class FittedRamp:
    """Ramp, its log, and the fit of its drift coefficients."""

    ramp: Ramp
    log: PreparedLog
    fit: published.RampFit

    def with_soaks(self) -> published.DriftBlocks:
        """Block means of the ramp with the soaks around it: the whole log where it has one ramp."""
        log_ramps = self.log.ramps
        before = [ramp.stop for ramp in log_ramps if ramp.stop <= self.ramp.start]
        after = [ramp.start for ramp in log_ramps if ramp.start >= self.ramp.stop]
        raw = self.log.raw
        return raw.between(max(before, default=0), min(after, default=raw.time.size))


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOutRates(LeftOutErrors):
    """Errors of one order on the logs of rates that were left out, one log for each ramp."""

    side: str
    order: int
    fitted: Array
    """Mean squares [ramps, (°/h)²] of what the model fitted to all rates leaves."""

    @property
    def helps(self) -> bool:
        """Whether the pooled error on left-out ramps is clearly below raw, by MARGIN, and no ramp
        became worse by WORSE, left out or not.

        If the slowest or the fastest rate is left out, the model holds or clamps it; only the fit
        to all rates shows the effect of the model there.
        """
        worst = np.maximum(self.squares, self.fitted)
        unharmed = bool(np.all(worst <= WORSE**2 * self.raw_squares))
        return self.pooled <= MARGIN * self.pooled_raw and unharmed


@dataclass(frozen=True, slots=True)
class SideChoice:
    """Leave-one-rate-out results of each order on one side, and the exported polynomial."""

    side: str
    tested: tuple[LeftOutRates, ...]
    polynomial: published.RatePolynomial | None
    flags: tuple[str, ...]


def alone(spec: Drift) -> bool:
    """Whether the recipe asks for the published scheme alone."""
    return spec.model == "gradient_rate" or (spec.model == "auto" and spec.order != "auto")


def fit_ramps(logs: Sequence[PreparedLog], spec: Drift) -> tuple[list[FittedRamp], tuple[str, ...]]:
    """Fit a0, a1, a2 of every ramp, and flags of ramps that cannot determine them: other models are
    fitted all the same, and the scheme is then tested on no ramp. Raises FitError that names the
    log where no other model is asked for.
    """
    fitted, flags = [], []
    for log in logs:
        for ramp in log.ramps:
            raw, denoised = (
                blocks.between(ramp.start, ramp.stop) for blocks in (log.raw, log.denoised)
            )
            try:
                fit = denoised.fit_ramp(ramp.rate, estimate=spec.estimate, raw=raw.indication)
            except FitError as error:
                if alone(spec):
                    raise FitError(f"{log.source.name}: {error.message}", hint=error.hint) from None
                flags.append(f"gradient_rate: not tested: {ramp.name}: {error.message}")
            else:
                fitted.append(FittedRamp(ramp, log, fit))
    return fitted, tuple(flags)


def left_out_rates(
    ramps: Sequence[published.RampFit], logs: Sequence[published.DriftBlocks], side: str, group: int
) -> list[LeftOutRates]:
    """Fit the polynomials of a side without each temperature rate in turn, and compensate the logs
    of that rate as at run time: for every order that the rates can test (four rates cannot test
    the cubic).

    A left-out rate outside the remaining ones is held or clamped as at run time. `group` is the
    number of intervals in one mean of the drift figure.
    """
    # indices of the ramps of each temperature rate, by rising signed rate
    rates: list[list[int]] = []
    for i in sorted(range(len(ramps)), key=lambda i: ramps[i].rate):
        group_rate = ramps[rates[-1][0]].rate if rates else np.inf
        if rates and abs(ramps[i].rate - group_rate) <= SAME_RATE * abs(group_rate):
            rates[-1].append(i)
        else:
            rates.append([i])

    def compensated(polynomial: published.RatePolynomial, log: published.DriftBlocks) -> Array:
        delta = published.increments([polynomial], log.gradient, log.rate).delta
        return means(log.indication - published.recursive(delta))

    def means(output: Array) -> Array:
        drift_means = drift_figures.figure_means(output, group)
        return np.asarray(drift_means - drift_means.mean())

    raw = tuple(means(log.indication) for log in logs)
    tested = []
    for order in range(len(rates) - 1):
        errors = [np.zeros(0)] * len(ramps)
        for left_out in rates:
            remaining_ramps = [ramps[i] for rate in rates if rate is not left_out for i in rate]
            polynomial = published.fit_over_rates(remaining_ramps, order, side)
            for i in left_out:
                errors[i] = compensated(polynomial, logs[i])
        all_rates = published.fit_over_rates(ramps, order, side)
        fitted = np.array([np.mean(compensated(all_rates, log) ** 2) for log in logs])
        name = f"gradient_rate {side}, order {order}"
        tested.append(LeftOutRates(name, tuple(errors), raw, side=side, order=order, fitted=fitted))
    return tested


def choose(ramps: Sequence[FittedRamp], spec: Drift) -> list[SideChoice]:
    """Polynomials of each side, of the order in the recipe or the best by leave-one-rate-out, or
    None.
    """
    choices = []
    for side in ("both",) if spec.sides == "joint" else ("heating", "cooling"):
        members = [
            item for item in ramps if side == "both" or (item.fit.rate > 0.0) == (side == "heating")
        ]
        if members:
            choices.append(_choose_side(members, spec, side))
    if all(choice.polynomial is not None for choice in choices):
        return choices
    # the recursion of one side alone would follow only half of a thermal cycle, and keep the
    # difference as a bias
    withdrawn = []
    for choice in choices:
        flags = choice.flags
        if choice.polynomial is not None:
            reason = "alone it would leave a bias after a thermal cycle"
            flags = (*flags, f"gradient_rate {choice.side}: not exported: {reason}")
        withdrawn.append(replace(choice, polynomial=None, flags=flags))
    return withdrawn


def _choose_side(members: Sequence[FittedRamp], spec: Drift, side: str) -> SideChoice:
    """Polynomials of one side: those of the recipe's order whatever left-out rates show, with flags
    of what is missing or worse; else of the best order that was tested, if one helps.
    """
    fits, logs = [item.fit for item in members], [item.with_soaks() for item in members]
    tested = left_out_rates(fits, logs, side, blocks_per_figure(spec.interval_s))
    flags = []
    if spec.order != "auto":
        polynomial = published.fit_over_rates(fits, spec.order, side)
        if polynomial.dof == 0:
            flags.append(
                f"{side}: zero degrees of freedom over the rates: order {spec.order} passes"
                " through every a_j and no rate is left to test it"
            )
        flags += [
            f"{side}: pinned order {spec.order} leaves {result.pooled:.3g} deg/h on left-out rates"
            f" against {result.pooled_raw:.3g} deg/h raw, or makes a ramp worse"
            for result in tested
            if result.order == spec.order and not result.helps
        ]
        return SideChoice(side, tuple(tested), polynomial, tuple(flags))
    helping = (result for result in tested if result.helps)
    best = min(helping, key=lambda result: result.pooled, default=None)
    if best is not None:
        polynomial = published.fit_over_rates(fits, best.order, side)
        return SideChoice(side, tuple(tested), polynomial, ())
    reason = "one temperature rate only, so that no rate can be left out to test the model"
    if tested:
        best_tested = min(tested, key=lambda result: result.pooled)
        reason = (
            f"leave-one-rate-out leaves {best_tested.pooled:.3g} deg/h at best (order"
            f" {best_tested.order}) against {best_tested.pooled_raw:.3g} deg/h raw, or makes a"
            " ramp worse"
        )
    return SideChoice(side, tuple(tested), None, (f"gradient_rate {side}: not exported: {reason}",))

"""Prepared logs → drift.json (a_j of each ramp) and drift_rate.json (a_j as polynomials of
temperature rate).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from calibkit.coefficients import StageResult
from calibkit.errors import FitError
from calibkit.instruments.fog_thermal import forms
from calibkit.instruments.fog_thermal.numeric import gradient, gradient_order
from calibkit.instruments.fog_thermal.ramps import PreparedLog, Ramp
from calibkit.instruments.fog_thermal.recipe import Drift
from calibkit.numeric.thermal.left_out import blocks_per_figure


@dataclass(frozen=True, slots=True)
class FittedRamp:
    """Ramp, its log, and the fit of its drift coefficients."""

    ramp: Ramp
    log: PreparedLog
    fit: gradient.RampFit


@dataclass(frozen=True, slots=True)
class SideChoice:
    """Leave-one-rate-out results of each order on one side, and the exported polynomial."""

    side: str
    tested: tuple[gradient_order.LeftOutRates, ...]
    chosen: gradient.RatePolynomial | None
    flags: tuple[str, ...]


def fit_ramps(logs: Sequence[PreparedLog], spec: Drift) -> tuple[list[FittedRamp], tuple[str, ...]]:
    """Fit a0, a1, a2 of every ramp, and flags of ramps that cannot determine them: other models are
    fitted all the same, and the scheme is then tested on no ramp. Raises FitError that names the
    log where no other model is asked for.
    """
    alone = spec.model == "gradient_rate" or (spec.model == "auto" and spec.order != "auto")
    fitted, flags = [], []
    for log in logs:
        for ramp in log.ramps:
            try:
                raw = log.raw.indication[ramp.start : ramp.stop]
                found = log.denoised.between(ramp.start, ramp.stop).fit_ramp(
                    ramp.rate, estimate=spec.estimate, raw=raw
                )
            except FitError as error:
                if alone:
                    raise FitError(f"{log.source.name}: {error.message}", hint=error.hint) from None
                flags.append(f"gradient_rate: not tested: {ramp.name}: {error.message}")
            else:
                fitted.append(FittedRamp(ramp, log, found))
    return fitted, tuple(flags)


def drift_result(
    ramps: Sequence[FittedRamp],
    logs: Sequence[PreparedLog],
    spec: Drift,
    undetermined: Sequence[str],
) -> StageResult:
    """drift.json: one model per ramp; its coefficients are per model interval."""
    return StageResult(
        "drift",
        models=tuple(forms.write_ramp(item.ramp.name, item.fit, spec.interval_s) for item in ramps),
        flags=(*(flag for log in logs for flag in log.flags), *undetermined),
    )


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
    return _whole_cycle(choices)


def _whole_cycle(choices: list[SideChoice]) -> list[SideChoice]:
    """Withdraw the model of a side if the other measured side has none.

    The recursion would otherwise follow only one half of a thermal cycle and keep the difference as
    a bias.
    """
    if all(choice.chosen is not None for choice in choices):
        return choices
    withdrawn = []
    for choice in choices:
        reason = (
            f"gradient_rate {choice.side}: not exported: alone it would leave a bias after a"
            " thermal cycle"
        )
        flags = choice.flags if choice.chosen is None else (*choice.flags, reason)
        withdrawn.append(replace(choice, chosen=None, flags=flags))
    return withdrawn


def _choose_side(members: Sequence[FittedRamp], spec: Drift, side: str) -> SideChoice:
    """Choose the polynomials of one side."""
    fits = [item.fit for item in members]
    tested = gradient_order.candidates(
        fits,
        [_ramp_and_soaks(item) for item in members],
        side,
        blocks_per_figure(spec.interval_s),
    )
    if spec.order != "auto":
        return _pinned(fits, tested, spec.order, side)
    winner = gradient_order.best(tested)
    if winner is not None:
        return SideChoice(
            side, tuple(tested), gradient.fit_over_rates(fits, winner.order, side), ()
        )
    if not tested:
        reason = "one temperature rate only, so that no rate can be left out to test the model"
    else:
        least = min(tested, key=lambda result: result.pooled)
        reason = (
            f"leave-one-rate-out leaves {least.pooled:.3g} deg/h at best (order {least.order})"
            f" against {least.pooled_raw:.3g} deg/h raw, or makes a ramp worse"
        )
    return SideChoice(side, tuple(tested), None, (f"gradient_rate {side}: not exported: {reason}",))


def _ramp_and_soaks(item: FittedRamp) -> gradient.Blocks:
    """Block means of a ramp with the soaks around it: the whole log where it has one ramp."""
    before = [ramp.stop for ramp in item.log.ramps if ramp.stop <= item.ramp.start]
    after = [ramp.start for ramp in item.log.ramps if ramp.start >= item.ramp.stop]
    return item.log.raw.between(max(before, default=0), min(after, default=item.log.raw.time.size))


def _pinned(
    fits: Sequence[gradient.RampFit],
    tested: Sequence[gradient_order.LeftOutRates],
    pinned: int,
    side: str,
) -> SideChoice:
    """Export the order in the recipe whatever leave-one-rate-out shows; flags state what is missing
    or worse.
    """
    polynomial = gradient.fit_over_rates(fits, pinned, side)
    flags = []
    if polynomial.dof == 0:
        flags.append(
            f"{side}: zero degrees of freedom over the rates: order {pinned} passes through every"
            " a_j and no rate is left to test it"
        )
    match = next((result for result in tested if result.order == pinned), None)
    if match is not None and not match.helps:
        flags.append(
            f"{side}: pinned order {pinned} leaves {match.pooled:.3g} deg/h on left-out rates "
            f"against {match.pooled_raw:.3g} deg/h raw, or makes a ramp worse"
        )
    return SideChoice(side, tuple(tested), polynomial, tuple(flags))

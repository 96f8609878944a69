"""Prepared logs → drift.json (a_j of each ramp) and drift_rate.json (a_j as polynomials of
temperature rate).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibkit.coefficients import Coefficient, Figure, Model, Parameter, StageResult
from calibkit.errors import FitError
from calibkit.instruments.fog_thermal.numeric import gradient, gradient_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.instruments.fog_thermal.ramps import PreparedLog, Ramp
    from calibkit.instruments.fog_thermal.recipe import Drift

FIGURE_INTERVAL_S = 100.0
"""Averaging time of the drift figure [s]: the longer of the two that GJB 2426A names."""
GRADIENT_UNITS = ("deg/h", "deg/h/K", "deg/h/K^2")


@dataclass(frozen=True, slots=True)
class FittedRamp:
    """A ramp, the log it stands in, and its drift coefficients."""

    ramp: Ramp
    log: PreparedLog
    fit: gradient.RampFit


@dataclass(frozen=True, slots=True)
class SideChoice:
    """What leave-one-rate-out said of each order on one side, and the polynomial that is exported
    (or none).
    """

    side: str
    tested: tuple[gradient_order.LeftOut, ...]
    chosen: gradient.RatePolynomial | None
    flags: tuple[str, ...]


def group(interval_s: float) -> int:
    """Number of model intervals that the drift figure averages."""
    return max(1, round(FIGURE_INTERVAL_S / interval_s))


def fit_ramps(logs: Sequence[PreparedLog], spec: Drift) -> list[FittedRamp]:
    """Fit a0, a1, a2 of every ramp; raises FitError naming the ramp that cannot determine them."""
    fitted = []
    for log in logs:
        for ramp in log.ramps:
            try:
                blocks = log.denoised.between(ramp.start, ramp.stop)
                found = gradient.ramp(blocks, ramp.rate, estimate=spec.estimate)
            except FitError as error:
                raise FitError(f"{log.source.name}: {error.message}", hint=error.hint) from None
            fitted.append(FittedRamp(ramp, log, found))
    return fitted


def drift_result(ramps: Sequence[FittedRamp], spec: Drift) -> StageResult:
    """drift.json: one fog-drift-gradient/1 model a ramp; its coefficients are per model
    interval.
    """
    models = []
    for item in ramps:
        found = item.fit
        uncertainty = np.sqrt(np.diag(found.covariance))
        models.append(
            Model(
                name=item.ramp.name,
                form="fog-drift-gradient/1",
                coefficients=tuple(
                    Coefficient(name, float(value), unit, float(u))
                    for name, value, unit, u in zip(
                        gradient.TERMS, found.coefficients, GRADIENT_UNITS, uncertainty, strict=True
                    )
                ),
                covariance=tuple(map(tuple, found.covariance.tolist())),
                dof=found.dof,
                residual_rms=found.residual_rms,
                residual_unit="deg/h",
                valid={
                    "temp_case_degc": found.case,
                    "gradient_degc": found.gradient,
                    "temp_rate_degc_min": (found.rate, found.rate),
                },
                parameters=(
                    Parameter("interval", spec.interval_s, "s"),
                    Parameter("rate", found.rate, "degC/min"),
                ),
            )
        )
    flags = tuple(
        flag
        for log in dict.fromkeys(item.log.name for item in ramps)
        for flag in _log_flags(ramps, log)
    )
    return StageResult("drift", models=tuple(models), flags=flags)


def _log_flags(ramps: Sequence[FittedRamp], name: str) -> tuple[str, ...]:
    """Flags of the log of that name."""
    return next(item.log.flags for item in ramps if item.log.name == name)


def choose(ramps: Sequence[FittedRamp], spec: Drift) -> list[SideChoice]:
    """Polynomials of each side: the pinned order, or the best by leave-one-rate-out, or none."""
    choices = []
    for side in ("both",) if spec.sides == "joint" else ("heating", "cooling"):
        members = [
            item for item in ramps if side == "both" or (item.fit.rate > 0.0) == (side == "heating")
        ]
        if members:
            choices.append(_choose_side(members, spec, side))
    return _whole_cycle(choices)


def _whole_cycle(choices: list[SideChoice]) -> list[SideChoice]:
    """Withdraw a side's model where the other measured side has none.

    The recursion would follow one half of a thermal cycle and not the other, and keep the
    difference as a bias.
    """
    if all(choice.chosen is not None for choice in choices):
        return choices
    withdrawn = []
    for choice in choices:
        flags = choice.flags
        if choice.chosen is not None:
            flags = (
                *flags,
                (
                    f"gradient_rate {choice.side}: not exported: alone it would leave a bias after"
                    " a thermal cycle"
                ),
            )
        withdrawn.append(replace(choice, chosen=None, flags=flags))
    return withdrawn


def _choose_side(members: Sequence[FittedRamp], spec: Drift, side: str) -> SideChoice:
    """Choice of one side."""
    fits = [item.fit for item in members]
    tested = gradient_order.candidates(
        fits, [_stretch(item) for item in members], side, group(spec.interval_s)
    )
    if spec.order != "auto":
        return _pinned(fits, tested, spec.order, side)
    winner = gradient_order.best(tested)
    if winner is not None:
        polynomial = gradient.over_rates(fits, winner.order, side)
        return SideChoice(side, tuple(tested), polynomial, ())
    if not tested:
        reason = "one temperature rate only, so that no rate can be left out to test the model"
    else:
        least = min(tested, key=lambda result: result.pooled)
        reason = (
            f"leave-one-rate-out leaves {least.pooled:.3g} deg/h at best (order {least.order})"
            f" against {least.pooled_raw:.3g} deg/h raw, or makes a ramp worse"
        )
    return SideChoice(side, tuple(tested), None, (f"gradient_rate {side}: not exported: {reason}",))


def _stretch(item: FittedRamp) -> gradient.Blocks:
    """Block means of a ramp with the soaks around it: the whole log where it has one ramp."""
    before = [ramp.stop for ramp in item.log.ramps if ramp.stop <= item.ramp.start]
    after = [ramp.start for ramp in item.log.ramps if ramp.start >= item.ramp.stop]
    return item.log.raw.between(max(before, default=0), min(after, default=item.log.raw.time.size))


def _pinned(
    fits: Sequence[gradient.RampFit],
    tested: Sequence[gradient_order.LeftOut],
    pinned: int,
    side: str,
) -> SideChoice:
    """The order that the recipe pins, exported whatever leave-one-rate-out says, and flagged for
    what it is.
    """
    polynomial = gradient.over_rates(fits, pinned, side)
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


def rate_model(polynomial: gradient.RatePolynomial, interval_s: float) -> Model:
    """fog-drift-rate/1 model of one side."""
    size = polynomial.order + 1
    uncertainty = np.sqrt(np.clip(np.diag(polynomial.covariance), 0.0, None))
    names = [(j, m) for j in range(3) for m in range(size)]
    return Model(
        name=polynomial.side,
        form="fog-drift-rate/1",
        coefficients=tuple(
            Coefficient(f"c{j}{m}", float(polynomial.c[j, m]), _unit(j, m), float(u))
            for (j, m), u in zip(names, uncertainty, strict=True)
        ),
        covariance=tuple(map(tuple, polynomial.covariance.tolist())),
        dof=polynomial.dof,
        residual_rms=polynomial.residual_rms,
        residual_unit="deg/h",
        valid={
            "temp_rate_degc_min": polynomial.rates,
            "gradient_degc": polynomial.gradient,
            "temp_case_degc": polynomial.case,
        },
        parameters=(
            Parameter("interval", interval_s, "s"),
            Parameter("order", float(polynomial.order), "1"),
            Parameter("slowest_rate", polynomial.slowest, "degC/min"),
        ),
    )


def _unit(j: int, m: int) -> str:
    """Unit of c_jm: that of a_j for each (°C/min)^m."""
    per = {0: "", 1: "/(degC/min)"}.get(m, f"/(degC/min)^{m}")
    return GRADIENT_UNITS[j] + per


def rate_polynomial(model: Model) -> gradient.RatePolynomial:
    """Polynomial of a fog-drift-rate/1 model: the inverse of rate_model."""
    size = len(model.coefficients) // 3
    c = np.array([[model.value(f"c{j}{m}") for m in range(size)] for j in range(3)])
    return gradient.RatePolynomial(
        model.name,
        c,
        np.array(model.covariance),
        model.dof,
        model.residual_rms,
        model.valid["temp_rate_degc_min"],
        model.value("slowest_rate"),
        model.valid["gradient_degc"],
        model.valid["temp_case_degc"],
    )


def left_out_figures(choices: Sequence[SideChoice]) -> tuple[Figure, ...]:
    """Leave-one-rate-out figures of every tested order, raw beside them."""
    figures = []
    for choice in choices:
        if choice.tested:
            figures.append(
                Figure(f"raw_drift_rms.{choice.side}", choice.tested[0].pooled_raw, "deg/h", 0.0)
            )
        figures += [
            Figure(
                f"leave_one_rate_out_rms.{choice.side}.order_{result.order}",
                result.pooled,
                "deg/h",
                0.0,
            )
            for result in choice.tested
        ]
    return tuple(figures)

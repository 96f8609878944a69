"""Results of a gyro's thermal run → the records that the report draws and prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric import drift
from calibkit.report.fog_thermal import DriftLog, DriftReport, OrderError, RampCoefficients, RateCurve
from calibkit.report.summary import Summary, SummaryTable, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.coefficients import Criterion
    from calibkit.frame import Log
    from calibkit.stages.fog_compensate import DriftModel, LogFigures
    from calibkit.stages.fog_drift import FittedRamp, SideChoice
    from calibkit.stages.fog_ramps import PreparedLog


def drift_report(
    title: str,
    logs: Sequence[PreparedLog],
    ramps: Sequence[FittedRamp],
    choices: Sequence[SideChoice],
    model: DriftModel,
) -> DriftReport:
    """Everything that the figures of a fit show."""
    shown = tuple(log_view(log, model) for log in logs)
    points = tuple(
        RampCoefficients(item.fit.rate, item.fit.coefficients, np.sqrt(np.diag(item.fit.covariance))) for item in ramps
    )
    curves = tuple(_curve(choice.chosen) for choice in choices if choice.chosen is not None)
    return DriftReport(title, model.interval_s, shown, points, curves, tuple(map(_orders, choices)))


def log_view(log: PreparedLog, model: DriftModel) -> DriftLog:
    """What the figures show of one log."""
    return DriftLog(
        log.name,
        log.raw.time,
        log.raw.case,
        log.raw.indication,
        log.denoised.indication,
        model.output(log.raw, log.raw.indication, "recursive"),
    )


def _curve(polynomial: drift.RatePolynomial) -> RateCurve:
    """Exported polynomials over their fitted rates."""
    rate = np.linspace(*polynomial.rates, 101)
    return RateCurve(polynomial.side, rate, drift.evaluate(polynomial, rate))


def _orders(choice: SideChoice) -> OrderError:
    """Errors of the tested orders of a side."""
    return OrderError(
        choice.side,
        choice.tested[0].pooled_raw if choice.tested else 0.0,
        tuple(result.order for result in choice.tested),
        tuple(result.pooled for result in choice.tested),
        choice.chosen.order if choice.chosen is not None else None,
    )


def summary(
    title: str,
    figures: Sequence[LogFigures],
    ramps: Sequence[FittedRamp],
    choices: Sequence[SideChoice],
    flags: Sequence[str],
    criteria: Sequence[Criterion],
) -> Summary:
    """What the console and report.txt say of a fit."""
    tables = (ramp_table(ramps), choice_table(choices), before_after_table(figures))
    return Summary(title, tables, tuple(dict.fromkeys(flags)), tuple(criteria))


def ramp_table(ramps: Sequence[FittedRamp]) -> SummaryTable:
    """a_j of each ramp with standard uncertainties."""
    rows = []
    for item in ramps:
        u = np.sqrt(np.diag(item.fit.covariance))
        cells = [f"{value:.3e} ± {error:.0e}" for value, error in zip(item.fit.coefficients, u, strict=True)]
        rows.append((item.ramp.name, f"{item.fit.rate:+.2f}", *cells))
    return SummaryTable(
        "Drift coefficients of each ramp, per interval (± standard uncertainty, type A)",
        ("ramp", "°C/min", "a0 [°/h]", "a1 [°/h/K]", "a2 [°/h/K²]"),
        tuple(rows),
    )


def choice_table(choices: Sequence[SideChoice]) -> SummaryTable:
    """Drift rms on withheld rates for each order, and what was exported."""
    rows = []
    for choice in choices:
        exported = "none" if choice.chosen is None else f"order {choice.chosen.order}"
        raw = number(choice.tested[0].pooled_raw) if choice.tested else "-"
        errors = "  ".join(f"{result.order}: {result.pooled:.3g}" for result in choice.tested) or "not testable"
        rows.append((choice.side, raw, errors, exported))
    return SummaryTable(
        "Withheld-rate error: each rate left out in turn, drift rms of its log [°/h, 100 s means]",
        ("side", "raw", "order: compensated", "exported"),
        tuple(rows),
    )


def before_after_table(figures: Sequence[LogFigures]) -> SummaryTable:
    """Drift rms of each log before and after with the rate gain beside it."""
    rows = tuple(
        (
            log.name,
            number(log.before),
            number(log.after),
            f"{log.reduction:.2f}",
            f"{log.gain_recursive:.4f}",
            f"{log.after_one_step:.3g} ({log.gain_one_step + 0.0:.3f})",
        )
        for log in figures
    )
    return SummaryTable(
        "Drift rms of each log [°/h, 100 s means]; rate gain: share of a true constant rate that is left in the output",
        ("log", "before", "after", "before/after", "rate gain", "one_step (its gain)"),
        rows,
    )


def validation_entry(log: Log, figures: LogFigures, model: DriftModel) -> dict[str, object]:
    """JSON object of one validated log."""
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "mode": model.mode,
        "drift_rms_before": figures.before,
        "drift_rms_after": figures.after if model.mode == "recursive" else figures.after_one_step,
        "reduction": figures.reduction,
        "rate_gain": figures.gain_recursive if model.mode == "recursive" else figures.gain_one_step,
        "one_step": {"drift_rms_after": figures.after_one_step, "rate_gain": figures.gain_one_step},
        "unit": "deg/h",
        "averaging_s": 100.0,
        "flags": list(figures.flags),
    }

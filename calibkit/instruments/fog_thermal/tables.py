"""Results of a gyro's thermal run → the records that the report draws and prints."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibkit.frame import Log
from calibkit.instruments.fog_thermal.bias import BothWays
from calibkit.instruments.fog_thermal.compensate import DriftModel, LogFigures, drift_along
from calibkit.instruments.fog_thermal.decision import Export
from calibkit.instruments.fog_thermal.figures import (
    DriftLog,
    DriftReport,
    HysteresisView,
    RampCoefficients,
    RateCurve,
    Tested,
)
from calibkit.instruments.fog_thermal.gradient_file import FittedRamp, SideChoice
from calibkit.instruments.fog_thermal.numeric import gradient
from calibkit.instruments.fog_thermal.numeric.choice import ThermalChoice
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.instruments.fog_thermal.uncertainty import Statement, tabulate_statements
from calibkit.report.summary import number
from calibkit.report.table import Table


def drift_report(
    recipe: FogThermalRecipe,
    logs: Sequence[PreparedLog],
    ramps: Sequence[FittedRamp],
    choices: Sequence[SideChoice],
    tested: Sequence[Tested],
    model: DriftModel,
    ways: BothWays | None,
) -> DriftReport:
    """Everything that the figures of a fit show."""
    points = tuple(
        RampCoefficients(
            item.fit.rate, item.fit.coefficients, np.sqrt(np.diag(item.fit.covariance))
        )
        for item in ramps
    )
    curves = []
    for polynomial in (choice.chosen for choice in choices if choice.chosen is not None):
        rate = np.linspace(*polynomial.rates, 101)
        a = gradient.evaluate(polynomial, rate)
        curves.append(RateCurve(polynomial.side, bool(model.polynomials), rate, a))
    sides = () if ways is None else (("indication", ways.before), ("left by the model", ways.after))
    return DriftReport(
        recipe.title or recipe.procedure,
        model.interval_s,
        tuple(log_view(log, model) for log in logs),
        points,
        tuple(curves),
        tuple(tested),
        tuple(
            HysteresisView(name, side.temperature, side.difference, side.standard_uncertainty)
            for name, side in sides
            if side is not None
        ),
    )


def log_view(log: PreparedLog, model: DriftModel) -> DriftLog:
    """What the figures show of one log."""
    return DriftLog(
        log.name,
        log.raw.time,
        log.raw.case,
        log.raw.indication,
        log.denoised.indication,
        drift_along(model, log.raw).subtract(log.raw.indication, "recursive"),
    )


def list_tested(
    choices: Sequence[SideChoice], levels: ThermalChoice | None, export: Export
) -> tuple[Tested, ...]:
    """Every model that was tested on withheld ramps, the orders of the published scheme side by
    side.
    """
    orders = tuple(
        Tested(
            f"gradient_rate {choice.side}, order {result.order}",
            result.pooled_raw,
            result.pooled,
            bool(export.model.polynomials)
            and choice.chosen is not None
            and choice.chosen.order == result.order,
        )
        for choice in choices
        for result in choice.tested
    )
    if levels is None:
        return orders
    return orders + tuple(
        Tested(
            result.candidate.name,
            result.pooled_raw,
            result.pooled,
            export.name == result.candidate.name,
        )
        for result in levels.tested
    )


def fit_tables(
    ramps: Sequence[FittedRamp],
    results: Sequence[Tested],
    logs: Sequence[LogFigures],
    stated: Sequence[Statement],
) -> list[Table]:
    """Coefficients of each ramp with standard uncertainties, every model's drift rms on withheld
    ramps, each log before and after, and the uncertainty where it can be stated.
    """
    coefficients = []
    for item in ramps:
        u = np.sqrt(np.diag(item.fit.covariance))
        cells = [
            f"{value:.3e} ± {error:.0e}"
            for value, error in zip(item.fit.coefficients, u, strict=True)
        ]
        coefficients.append((item.ramp.name, f"{item.fit.rate:+.2f}", *cells))
    shares = tuple(
        (
            entry.name,
            number(entry.raw),
            number(entry.left),
            f"{entry.share:.3f}",
            "exported" if entry.exported else "",
        )
        for entry in results
    )
    return [
        Table(
            "Drift coefficients of each ramp, per interval (± standard uncertainty, type A)",
            ("ramp", "°C/min", "a0 [°/h]", "a1 [°/h/K]", "a2 [°/h/K²]"),
            tuple(coefficients),
        ),
        Table(
            "Withheld-ramp error: each rate or ramp left out in turn [°/h, 100 s means]",
            ("model", "raw", "compensated", "share of raw", ""),
            shares,
        ),
        before_after_table(logs),
        *([tabulate_statements(stated)] if stated else []),
    ]


def before_after_table(figures: Sequence[LogFigures]) -> Table:
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
    return Table(
        "Drift rms of each log [°/h, 100 s means]; rate gain: share of a true constant rate that is"
        " left in the output",
        ("log", "before", "after", "before/after", "rate gain", "one_step (its gain)"),
        rows,
    )


def coverage_tables(logs: Sequence[Mapping[str, Any]]) -> tuple[Table, ...]:
    """How uncertain the compensated rate of each validated log is said to be, and whether its 100 s
    means are as near.
    """
    rows = []
    for log in logs:
        entry = log["uncertainty"]
        if "means_of_100_s" in entry:
            sizes = (entry["standard_uncertainty_mean"], entry["expanded_uncertainty_largest"])
            share = entry["share_within_expanded_uncertainty"]
            rows.append(
                (
                    log["name"],
                    *(number(size, 2) for size in sizes),
                    str(entry["means_of_100_s"]),
                    f"{share:.1%}",
                )
            )
    if not rows:
        return ()
    title = (
        "Compensated rate [°/h]: stated uncertainty, and 100 s means within it and noise of their"
        " log's mean (95 % expected)"
    )
    return (Table(title, ("log", "u, mean", "U, largest", "means", "within"), tuple(rows)),)


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

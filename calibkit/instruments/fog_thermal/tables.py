"""Results of a gyro's thermal run → data of the report's figures and tables."""

from collections.abc import Mapping, Sequence
from typing import Any

from calibkit.arrays import Array
from calibkit.frame import Log, values
from calibkit.instruments.fog_thermal.compensate import DriftModel, LogFigures
from calibkit.instruments.fog_thermal.decision import Export
from calibkit.instruments.fog_thermal.figures import DriftLog, DriftReport, Tested
from calibkit.instruments.fog_thermal.gradient_choice import FittedRamp, SideChoice
from calibkit.instruments.fog_thermal.numeric.choice import ThermalChoice
from calibkit.instruments.fog_thermal.numeric.drift_figures import NoiseSplit
from calibkit.instruments.fog_thermal.numeric.hysteresis import Hysteresis
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.instruments.fog_thermal.uncertainty import Statement, tabulate_statements
from calibkit.numeric.dispersion import rms
from calibkit.numeric.noise import allan
from calibkit.report.summary import number
from calibkit.report.table import Table

SPLIT_HEADS = ("noise alone", "drift left (+u)")
UNEVEN = 0.05
"""Largest relative deviation of a sampling step from the median with which a log is evenly sampled.
"""


def drift_report(
    recipe: FogThermalRecipe,
    logs: Sequence[PreparedLog],
    compensated: Sequence[LogFigures],
    ramps: Sequence[FittedRamp],
    choices: Sequence[SideChoice],
    tested: Sequence[Tested],
    model: DriftModel,
    hysteresis: tuple[tuple[str, Hysteresis], ...],
) -> DriftReport:
    """Data of the figures of a fit."""
    return DriftReport(
        recipe.title or recipe.procedure,
        model.interval_s,
        tuple(log_view(log, model) for log in logs),
        tuple(item.fit for item in ramps),
        tuple(choice.chosen for choice in choices if choice.chosen is not None),
        tuple(tested),
        bool(model.polynomials),
        hysteresis,
        rms([log.split.noise for log in compensated]),
    )


def log_view(log: PreparedLog, model: DriftModel) -> DriftLog:
    """Data of one log for the figures."""
    return DriftLog(
        log.name,
        log.raw.time,
        log.raw.case,
        log.raw.indication,
        log.denoised.indication,
        model.drift_along(log.raw).subtract(log.raw.indication, "recursive"),
    )


def list_tested(
    choices: Sequence[SideChoice], levels: ThermalChoice, export: Export
) -> tuple[Tested, ...]:
    """Results of all models tested on left-out ramps or rates; each order of the published scheme
    is listed.
    """
    named = [
        (
            f"gradient_rate {choice.side}, order {result.order}",
            result,
            bool(export.model.polynomials)
            and choice.chosen is not None
            and choice.chosen.order == result.order,
        )
        for choice in choices
        for result in choice.tested
    ] + [
        (result.candidate.name, result, export.name == result.candidate.name)
        for result in levels.tested
    ]
    splits = [result.split for _, result, _ in named]
    noise = min((split.noise for split in splits), default=0.0)
    return tuple(
        Tested(name, result.pooled_raw, result.pooled, split.at_most(noise), exported)
        for (name, result, exported), split in zip(named, splits, strict=True)
    )


def fit_tables(
    ramps: Sequence[FittedRamp],
    results: Sequence[Tested],
    logs: Sequence[LogFigures],
    stated: Sequence[Statement],
    covered: Mapping[str, Mapping[str, Any]],
) -> list[Table]:
    """Tables of the ramps' coefficients with standard uncertainties, of the drift rms of tested
    models on left-out ramps, of each log before and after, and of the uncertainty if stated.
    """
    coefficients = []
    for item in ramps:
        each = zip(item.fit.coefficients, item.fit.standard_uncertainty, strict=True)
        cells = [f"{value:.3e} ± {u:.0e}" for value, u in each]
        coefficients.append((item.ramp.name, f"{item.fit.rate:+.2f}", *cells))
    shares = tuple(
        (
            entry.name,
            number(entry.raw),
            number(entry.left),
            *_split_cells(entry.split),
            f"{entry.share:.3f}",
            "exported" if entry.exported else "",
        )
        for entry in results
    )
    return [
        Table(
            "Withheld-ramp error: each rate or ramp left out in turn [°/h, 100 s means]",
            ("model", "before", "after", *SPLIT_HEADS, "after/before", ""),
            shares,
        ),
        before_after_table(logs),
        *([tabulate_statements(stated)] if stated else []),
        *coverage_tables(covered, "fitted"),
        Table(
            "Drift coefficients of each ramp, per interval (± standard uncertainty, type A)",
            ("ramp", "°C/min", "a0 [°/h]", "a1 [°/h/K]", "a2 [°/h/K²]"),
            tuple(coefficients),
        ),
    ]


def _split_cells(split: NoiseSplit) -> tuple[str, str]:
    """Cells of the noise alone, and of the drift left with its standard uncertainty."""
    return number(split.noise), f"{number(split.left, 2)} (+{number(split.left_uncertainty, 1)})"


def before_after_table(figures: Sequence[LogFigures]) -> Table:
    """Table of each log's drift rms before and after compensation, with the rate gain."""
    rows = tuple(
        (
            log.name,
            number(log.before),
            number(log.after),
            *_split_cells(log.split),
            f"{log.reduction:.2f}",
            f"{log.gain_recursive:.4f}",
        )
        for log in figures
    )
    return Table(
        "Drift rms of each log [°/h, 100 s means]; rate gain: share of a true constant rate that is"
        " left in the output",
        (
            "log",
            "before",
            "after",
            *SPLIT_HEADS,
            "before/after",
            "rate gain",
        ),
        rows,
    )


def coverage_tables(entries: Mapping[str, Mapping[str, Any]], which: str) -> tuple[Table, ...]:
    """Table of the stated uncertainty of the compensated rate of each log, by its name, and the
    share of its 100 s means within it, about the log's mean and absolutely.
    """
    rows = []
    for name, entry in entries.items():
        if "means_of_100_s" in entry:
            sizes = (entry["standard_uncertainty_mean"], entry["expanded_uncertainty_largest"])
            share = entry["share_within_expanded_uncertainty"]
            absolutely = ("", "")
            if "offset" in entry:
                reach = number(entry["offset_expanded_uncertainty"], 2)
                absolutely = (
                    f"{entry['share_within_absolutely']:.1%}",
                    f"{entry['offset']:+.3f} (U {reach})",
                )
            rows.append(
                (
                    name,
                    *(number(size, 2) for size in sizes),
                    str(entry["means_of_100_s"]),
                    f"{share:.1%}",
                    *absolutely,
                )
            )
    if not rows:
        return ()
    title = (
        f"Compensated rate of the {which} logs [°/h]: stated uncertainty, and 100 s means within it"
        " and noise (95 % expected), about the log's mean and absolutely; offset from the rate at"
        " rest of the fit"
    )
    heads = ("log", "u, mean", "U, largest", "means", "about mean", "absolutely", "offset")
    return (Table(title, heads, tuple(rows)),)


def allan_deviations(log: Log, after: Array) -> dict[str, object]:
    """JSON object of the overlapping Allan deviations [°/h] of a log's indication and its
    compensated rate [n, °/h], or the reason why there are none.

    Nothing is denoised or resampled, as the Allan deviation would show the filter.
    """
    usual = log.steps.usual
    if max(log.steps.longest - usual, usual - log.steps.shortest) > UNEVEN * usual:
        return {"not_available": "the log is not evenly sampled"}
    raw, left = (
        allan.overlapping(rate, usual, allocate=log.allocate)
        for rate in (values(log.frame, "gyro_dph"), after)
    )
    return {
        "estimator": "overlapping Allan deviation",
        "unit": "deg/h",
        "tau_s": left.tau_s.tolist(),
        "before": raw.deviation.tolist(),
        "after": left.deviation.tolist(),
        "after_lower": left.lower.tolist(),
        "after_upper": left.upper.tolist(),
        "probability": left.probability,
    }


def validation_entry(log: Log, figures: LogFigures, model: DriftModel) -> dict[str, object]:
    """JSON object of one validated log."""
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "mode": model.mode,
        "drift_rms_before": figures.before,
        "drift_rms_after": figures.after if model.mode == "recursive" else figures.after_one_step,
        "noise_rms": figures.split.noise,
        "drift_left_rms": figures.split.left,
        "drift_left_standard_uncertainty": figures.split.left_uncertainty,
        "reduction": figures.reduction,
        "rate_gain": figures.gain_recursive if model.mode == "recursive" else figures.gain_one_step,
        "one_step": {"drift_rms_after": figures.after_one_step, "rate_gain": figures.gain_one_step},
        "unit": "deg/h",
        "averaging_s": 100.0,
        "flags": list(figures.flags),
    }

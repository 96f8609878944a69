"""Results of biases over temperature → tables, first screens, criteria."""

from collections.abc import Mapping, Sequence
from typing import Any

from calibkit.instruments.bias.compensate import LogFigures
from calibkit.instruments.bias.drift_choice import Export, LeftOutRates
from calibkit.instruments.bias.ramps import PreparedLog
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.numeric.dispersion import rms
from calibkit.numeric.noise import allan
from calibkit.numeric.thermal.left_out import NoiseSplit, split_noise
from calibkit.records.coefficients import at_least, at_most, over_stated_u
from calibkit.records.frame import Log, values
from calibkit.report.overview import KeyValue, Overview, describe_span
from calibkit.report.summary import Summary, number
from calibkit.report.table import Column, Table


def validation_summary(
    entries: Sequence[Mapping[str, Any]],
    title: str,
    error_name: str,
    *,
    min_reduction: float | None = None,
    max_residual_over_noise: float | None = None,
) -> Summary:
    """Summary of a validation: each channel before and after, the error that its uncertainty is
    compared with, by its name, and criteria of the limits that are stated.
    """
    rows: list[tuple[str, ...]] = []
    errors, criteria = [], []
    for entry in entries:
        for channel in entry["channels"]:
            name = f"{entry['name']} {channel['name']}"
            cells = [number(channel["before"]), number(channel["after"]), channel["unit"]]
            if "share_within_expanded_uncertainty" in channel:
                cells.append(f"{channel['share_within_expanded_uncertainty']:.0%}")
            rows.append((entry["name"], channel["name"], *cells))
            errors.append((f"{name}: {error_name}", channel))
            if min_reduction is not None and channel["reduction"] is not None:
                criterion_name, ratio = f"{name}: reduction", channel["reduction"]
                criteria.append(at_least(criterion_name, ratio, min_reduction, "1"))
            if max_residual_over_noise is not None:
                criterion_name, ratio = (
                    f"{name}: residual over noise",
                    channel["residual_over_noise"],
                )
                criteria.append(at_most(criterion_name, ratio, max_residual_over_noise, "1"))
    heads = ("log", "channel", "before", "after", "unit", "within")
    width = max(map(len, rows), default=5)
    filled = tuple((*row, *[""] * (width - len(row))) for row in rows)
    table = Table(title, heads[:width], filled)
    flags = tuple(dict.fromkeys(flag for entry in entries for flag in entry["flags"]))
    return Summary("", (table,), flags, (*over_stated_u(errors), *criteria))


UNEVEN = 0.05
"""Largest relative deviation of a sampling step from the median with which a log is evenly sampled.
"""
_UNIT = "°/h"


def tabulate_tested(export: Export) -> Table:
    """Table of the drift rms that tested models leave on left-out ramps or rates; each order of the
    published scheme is listed.
    """
    exported = {errors.name for errors in export.errors}
    rows, noise = [], export.left_out_noise
    for errors in export.tested:
        left = split_noise(errors.errors).at_most(noise)
        rows.append(
            (
                errors.name,
                number(errors.pooled_raw),
                number(errors.pooled),
                number(left.noise),
                f"{number(left.left, 2)} (+{number(left.left_uncertainty, 1)})",
                f"{errors.pooled / errors.pooled_raw:.3f}",
                "exported" if errors.name in exported else "",
            )
        )
    return Table(
        "Withheld-ramp error: each rate or ramp left out in turn [°/h, 100 s means]",
        ("model", "before", "after", "noise alone", "drift left (+u)", "after/before", ""),
        tuple(rows),
    )


def coverage_tables(entries: Mapping[str, Mapping[str, Any]], log_kind: str) -> tuple[Table, ...]:
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
        f"Compensated rate of the {log_kind} logs [°/h]: stated uncertainty, and 100 s means within"
        " it and noise (95 % expected), about the log's mean and absolutely; offset from the"
        " rate at rest of the fit"
    )
    heads = ("log", "u, mean", "U, largest", "means", "about mean", "absolutely", "offset")
    return (Table(title, heads, tuple(rows)),)


def validation_entry(
    log: Log,
    figures: LogFigures,
    mode: str,
    output: Array,
    uncertainty: Mapping[str, Any],
) -> dict[str, Any]:
    """JSON object of one validated log, with the overlapping Allan deviations [°/h] of its
    indication and of its compensated rate [n, °/h]: nothing is denoised or resampled, as the Allan
    deviation would show the filter.
    """
    usual = log.steps.usual
    deviations: dict[str, object] = {"not_available": "the log is not evenly sampled"}
    if max(log.steps.longest - usual, usual - log.steps.shortest) <= UNEVEN * usual:
        raw = allan.overlapping(values(log.frame, "gyro_dph"), usual)
        left = allan.overlapping(output, usual)
        deviations = {
            "estimator": "overlapping Allan deviation",
            "unit": "deg/h",
            "tau_s": left.tau_s.tolist(),
            "before": raw.deviation.tolist(),
            "after": left.deviation.tolist(),
            "after_lower": left.lower.tolist(),
            "after_upper": left.upper.tolist(),
            "probability": left.probability,
        }
    return {
        "name": log.file,
        "sha256": log.sha256,
        "rows": log.rows,
        "mode": mode,
        "drift_rms_before": figures.before,
        "drift_rms_after": figures.after if mode == "recursive" else figures.after_one_step,
        "noise_rms": figures.split.noise,
        "drift_left_rms": figures.split.left,
        "drift_left_standard_uncertainty": figures.split.left_uncertainty,
        "reduction": figures.before / figures.after if figures.after > 0.0 else float("inf"),
        "rate_gain": figures.gain_recursive if mode == "recursive" else figures.gain_one_step,
        "one_step": {"drift_rms_after": figures.after_one_step, "rate_gain": figures.gain_one_step},
        "unit": "deg/h",
        "averaging_s": 100.0,
        "flags": list(figures.flags),
        "uncertainty": uncertainty,
        "allan_deviation": deviations,
    }


def _ramp_rows(logs: Sequence[LogFigures], prepared: Sequence[PreparedLog] = ()) -> Table:
    """Drift of each log before and after, what is left without the noise, and the share of a true
    constant rate in the output, with its temperature rates where the prepared logs are given.
    """
    rates = {
        log.name: ", ".join(f"{ramp.rate:+.1f}".replace("-", "−") for ramp in log.ramps)
        for log in prepared
    }
    rows = tuple(
        (
            log.name,
            *((rates[log.name],) if rates else ()),
            *(log.before, log.after, _state_left(log.split), log.gain_recursive),
        )
        for log in logs
    )
    columns = (
        *(f"[{_UNIT}]", *(("°C/min",) if rates else ())),
        *(Column("before", ".3f"), Column("after", ".3f"), "drift left (95 %)"),
        Column("rate gain", ".3f"),
    )
    return Table("Drift of each log, rms of 100 s means", columns, rows)


def _state_left(split: NoiseSplit) -> str:
    """Drift that is left without the noise, ± U; what it is at most where that may be none."""
    U = 2.0 * split.left_uncertainty
    if split.left <= U:
        return f"< {number(split.left + U, 2)}"
    return " ± ".join(gum.rounded(split.left, U))


def summarize_fit(
    prepared: Sequence[PreparedLog],
    compensated: Sequence[LogFigures],
    export: Export,
    drift_uncertainties: Sequence[Mapping[str, Any]],
    at_rest: KeyValue | None,
) -> Overview:
    """First screen of a fit; `at_rest` is the bias or the rate at rest."""
    raw = rms([log.before for log in compensated])
    noise = rms([log.split.noise for log in compensated])
    facts, values = [], []
    if export.errors:
        subject, raw = "ramps the fit had not seen", rms([e.pooled_raw for e in export.errors])
        left = rms([errors.pooled for errors in export.errors])
        sentence = _compare_drift(subject, raw, left, export.left_out_noise)
        values = [
            KeyValue("drift on left-out ramps, before", raw, _UNIT),
            KeyValue("drift on left-out ramps, after", left, _UNIT),
        ]
        reason = "chosen"
        if not export.model.polynomials:
            rivals = [errors for errors in export.tested if not isinstance(errors, LeftOutRates)]
            is_best = export.errors[0].pooled <= min(errors.pooled for errors in rivals)
            reason = "the best" if is_best else "the simplest that is as good as the best"
        count = f"of {len(export.tested)} models, tested on left-out ramps"
        facts.append(f"Model: {export.name}, {reason} {count}.")
    elif export.model.exported:
        left = rms([log.after for log in compensated])
        sentence = _compare_drift("the fitted ramps alone", raw, left, noise)
        facts.append(f"Model: {export.name}, tested on no ramp that was left out of its fit.")
    else:
        sentence = (
            f"No drift term is exported. Drift of the logs (100 s averages, rms): {raw:.3f}"
            f" {_UNIT}; noise alone gives {noise:.3f} {_UNIT}."
        )
    if drift_uncertainties:
        worst = max(drift_uncertainties, key=lambda entry: float(entry["expanded_uncertainty"]))
        U = KeyValue("largest uncertainty of the correction", worst["expanded_uncertainty"], _UNIT)
        values.append(U)
        facts.append(
            f"L{U.name[1:]}: {U.value:.2g} {_UNIT} (k = {worst['coverage_factor']:.2f}),"
            f" {worst['where']}, {worst['temp_case_degc']:.0f} °C."
        )
    if at_rest is not None:
        values.append(at_rest)
        facts.append(f"{at_rest.name[0].upper()}{at_rest.name[1:]}: {at_rest}.")
    return Overview(sentence, tuple(facts), tuple(values), _ramp_rows(compensated, prepared))


def _compare_drift(subject: str, raw: float, left: float, noise: float) -> str:
    """Drift before and after beside what noise alone gives, in words."""
    return (
        f"Drift on {subject} (100 s averages, rms): {raw:.3f} {_UNIT} before, {left:.3f} {_UNIT}"
        f" after; noise alone gives {noise:.3f} {_UNIT}."
    )


def summarize_validation(
    compensated: Sequence[LogFigures], entries: Sequence[Mapping[str, Any]]
) -> Overview:
    """First screen of a validation."""
    raw, left = rms([log.before for log in compensated]), rms([log.after for log in compensated])
    noise = rms([log.split.noise for log in compensated])
    gains = [log.gain_recursive for log in compensated]
    span = describe_span(min(gains), max(gains), "", ".4f").strip()
    facts = [f"Rate gain (share of a true constant rate left in the output): {span}."]
    covered = [
        (
            entry["uncertainty"]["share_within_expanded_uncertainty"],
            entry["uncertainty"]["means_of_100_s"],
        )
        for entry in entries
        if "means_of_100_s" in entry["uncertainty"]
    ]
    if covered:
        means = sum(count for _, count in covered)
        share = sum(part * count for part, count in covered) / means
        facts.append(f"{share:.1%} of {means} means of 100 s lie within their U (95 % expected).")
    sentence = _compare_drift("logs that were not fitted", raw, left, noise)
    return Overview(sentence, tuple(facts), (), _ramp_rows(compensated))

"""First screens of a gyro's thermal run: drift on ramps that were not fitted, what noise alone
gives, the model, the largest U, a row per log.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from calibkit.instruments.fog_thermal.compensate import LogFigures
from calibkit.instruments.fog_thermal.decision import Export
from calibkit.instruments.fog_thermal.figures import Tested
from calibkit.instruments.fog_thermal.numeric.choice import ThermalChoice
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.instruments.fog_thermal.uncertainty import Statement
from calibkit.numeric.dispersion import rms
from calibkit.report.overview import KeyValue, Overview, describe_span
from calibkit.report.table import Column, Table

_UNIT = "°/h"
_HEADS = ("before", "after", "noise alone", "drift left")


def _ramp_rows(logs: Sequence[LogFigures], prepared: Sequence[PreparedLog] = ()) -> Table:
    """Drift of each log before and after beside the noise, with its temperature rates where the
    prepared logs are given.
    """
    rates = {
        log.name: ", ".join(f"{ramp.rate:+.1f}".replace("-", "−") for ramp in log.ramps)
        for log in prepared
    }
    rows = tuple(
        (
            log.name,
            *((rates[log.name],) if rates else ()),
            *(log.before, log.after, log.split.noise, log.split.left),
        )
        for log in logs
    )
    columns = (f"[{_UNIT}]", *(("°C/min",) if rates else ()), *(Column(h, ".3f") for h in _HEADS))
    return Table("Drift of each log, rms of 100 s means", columns, rows)


def summarize_fit(
    prepared: Sequence[PreparedLog],
    compensated: Sequence[LogFigures],
    tested: Sequence[Tested],
    levels: ThermalChoice,
    export: Export,
    stated: Sequence[Statement],
    at_rest: KeyValue | None,
) -> Overview:
    """First screen of a fit; `at_rest` is the bias or the rate at rest."""
    noise = rms([log.split.noise for log in compensated])
    facts, values = [], []
    used = [entry for entry in tested if entry.exported]
    if used:
        raw, left = rms([entry.raw for entry in used]), rms([entry.left for entry in used])
        there = rms([entry.split.noise for entry in used])
        sentence = _compare_drift("ramps left out of the fit", raw, left, there)
        where = "drift on left-out ramps"
        values = [
            KeyValue(f"{where}, before", raw, _UNIT),
            KeyValue(f"{where}, after", left, _UNIT),
        ]
        facts.append(f"Model: {export.name}, {_explain_choice(export, levels, tested)}.")
    else:
        before = rms([log.before for log in compensated])
        sentence = (
            f"No drift term is exported. Drift of the logs (rms of 100 s means): {before:.3f}"
            f" {_UNIT}; noise alone gives {noise:.3f} {_UNIT}."
        )
    if stated:
        worst = max(stated, key=lambda one: one.expanded_uncertainty)
        U = KeyValue("largest U of the drift taken off", worst.expanded_uncertainty, _UNIT)
        values.append(U)
        facts.append(
            f"L{U.name[1:]}: {worst.expanded_uncertainty:.2g} {_UNIT} (k ="
            f" {worst.coverage_factor:.2f}), {worst.where}, {worst.temp_case_degc:.0f} °C."
        )
    if at_rest is not None:
        values.append(at_rest)
        facts.append(f"{at_rest.name[0].upper()}{at_rest.name[1:]}: {at_rest}.")
    return Overview(sentence, tuple(facts), tuple(values), _ramp_rows(compensated, prepared))


def _compare_drift(where: str, raw: float, left: float, noise: float) -> str:
    """Drift before and after beside what noise alone gives, in words."""
    return (
        f"Drift on {where} (rms of 100 s means): {raw:.3f} {_UNIT} before, {left:.3f} {_UNIT}"
        f" after; noise alone gives {noise:.3f} {_UNIT}."
    )


def _explain_choice(export: Export, levels: ThermalChoice, tested: Sequence[Tested]) -> str:
    """How many models were tested on left-out ramps, and why this one was chosen."""
    count = f"of {len(tested)} models tested on left-out ramps"
    if levels.chosen is None or export.model.thermal is None:
        return f"chosen {count}"
    best = min(one.pooled for one in levels.tested)
    if levels.chosen.pooled <= best:
        return f"the smallest error {count}"
    return f"the simplest within the noise of the best, {count}"


def summarize_validation(
    compensated: Sequence[LogFigures], entries: Sequence[Mapping[str, Any]]
) -> Overview:
    """First screen of a validation."""
    raw, left = (rms([getattr(log, when) for log in compensated]) for when in ("before", "after"))
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

"""Bias of each channel of a static instrument as a polynomial of a temperature, or of any other
abscissa: logs → bias.json (equation and fit in `polynomials`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from calibkit import check as checks, units
from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.certificate.results import ListTable
from calibkit.check import copies
from calibkit.coefficients import Input, Record
from calibkit.forms import POLYNOMIAL
from calibkit.frame import Examined, Finding, Log, refuse, values
from calibkit.ingest import logs as ingest, write_back
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.bias import certificate, figures, polynomials, sensitivities, tables
from calibkit.instruments.bias.forms import POLYNOMIALS
from calibkit.instruments.bias.recipe import BiasTemperatureRecipe

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from calibkit.certificate.results import Block
    from calibkit.certificate.stated import Stated
    from calibkit.ingest.evidence import Evidence
    from calibkit.ingest.logs import LogReader
    from calibkit.ingest.recipe_text import RecipeChoice
    from calibkit.ingest.write_back import Applied
    from calibkit.report.summary import Summary

Recipe = BiasTemperatureRecipe
KEY_FIGURES = (r"bias\..+(\.p\d|\.residual_rms| at \S+ degC)",)
FORMS = (POLYNOMIAL,)


def read(
    spec: BiasTemperatureRecipe, data: Path, file: str, reader: LogReader = ingest.read_log
) -> Log:
    """One log in the recipe's columns; time is read where the log has it."""
    return reader(spec, data / file, file, tuple(dict.fromkeys(spec.own_columns())), ("time_s",))


def _find_faults(spec: BiasTemperatureRecipe, log: Log) -> list[Finding]:
    """What is wrong with a log."""
    findings = [
        *checks.find_too_few_rows(log, spec.polynomials.min_rows),
        *checks.find_missing_values(log, list(log.frame.columns)),
    ]
    if any(finding.refused for finding in findings):
        return findings
    timed = "time_s" in log.frame.columns
    if timed:
        findings += checks.find_unordered_times(log)
        findings += checks.find_gaps(log, spec.polynomials.max_gap_s)
    findings += checks.find_constant_columns(log, [spec.polynomials.abscissa])
    if any(finding.refused for finding in findings):
        return findings
    for column in spec.still_columns():
        findings += checks.series.check_indication(log, column, units.column_unit(column))
    if timed and units.column_unit(spec.polynomials.abscissa) == "degC":
        findings += checks.thermometers.check_steps(log, spec.polynomials.abscissa)
        findings += checks.thermometers.find_lost_sign(log, spec.polynomials.abscissa)
    return [
        *findings,
        *checks.magnitude.find_compensated_names(log, spec, spec.still_columns()),
    ]


def faults(spec: BiasTemperatureRecipe, log: Log) -> Examined:
    """Find what is wrong with one log."""
    return Examined(tuple(_find_faults(spec, log)))


def fit(
    spec: BiasTemperatureRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[figures.BiasReport]:
    """Fit every polynomial to the rows of all logs together."""
    logs, flags = [], []
    for log in copies.refuse_copies(
        ingest.read_ahead(progress(files, "reading"), lambda file: read(spec, data, file))
    ):
        findings = _find_faults(spec, log)
        refuse(findings)
        logs.append(log)
        flags += [f"{log.file}: {note}" for note in log.notes]
        flags += [str(finding) for finding in findings if finding.flagged]
    channels = polynomials.fit(logs, spec.polynomials, spec.errors)
    flags += [flag for channel in channels for flag in channel.flags]
    result = polynomials.result(channels, flags)
    influences = sensitivities.find(result)
    result_tables = tabulate_fit([result], spec, influences, _list_coefficients)
    return Fitted(
        (result,),
        tuple(Input.of(log) for log in logs),
        polynomials.summary(spec, channels, flags, result_tables),
        figures.BiasReport(spec.polynomials.abscissa, tuple(channel.curve for channel in channels)),
        sensitivities=influences,
    )


def _list_coefficients(basis: Stated) -> tuple[Block, ...]:
    """Blocks of the certificate without biases over temperature, which the figure shows: the page
    of one of many small devices stays small.
    """
    return tuple(
        replace(
            block, tables=tuple(table for table in block.tables if isinstance(table, ListTable))
        )
        for block in certificate.blocks(basis)
    )


def correct(spec: BiasTemperatureRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Take each channel's polynomial, zero at the reference, out of every row."""
    log = read(spec, data.parent, data.name)
    refuse(_find_faults(spec, log))
    columns, flags = polynomials.compensate(log, records[POLYNOMIALS], spec)
    added = {}
    for name, corrected in columns.items() if spec.output.drift else ():
        stem, unit = name.rsplit("_", 1)
        added[f"{stem}_drift_{unit}"] = values(log.frame, name) - corrected
    return write_back.rewrite_log(spec, data, log, columns, added), flags


def validate(
    spec: BiasTemperatureRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Standard deviation of each channel before and after, of logs that were not fitted."""
    entries = []
    for log in logs:
        refuse(_find_faults(spec, log))
        entries.append(polynomials.validation_entry(log, records[POLYNOMIALS], spec))
    limit = spec.acceptance.max_residual_over_noise
    return {"logs": entries}, tables.validation_summary(
        entries, "Standard deviation", "drift", max_residual_over_noise=limit
    )


def propose(evidence: Evidence) -> RecipeChoice | None:
    """Recipe for a static instrument with times and one temperature: all that it measures."""

    def keys_of(channels: Sequence[str]) -> dict[str, str]:
        polynomial_entries = ", ".join(
            f'{{ indication = "{name}", order = 3 }}' for name in channels
        )
        return {} if list(channels) == ["gyro_dph"] else {"bias": f"[{polynomial_entries}]"}

    return evidence.choose_at_rest("bias_temperature", keys_of)

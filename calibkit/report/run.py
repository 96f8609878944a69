"""A run's coefficient files as a summary that a person can read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.coefficients import Criterion
from calibkit.report.summary import Summary, SummaryTable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibkit.coefficients import Model, Record

MOST_FIGURES = 40


def summary(name: str, document: Mapping[str, Any], records: Mapping[str, Record]) -> Summary:
    """Every model and figure of a run with units and standard uncertainties."""
    tables = [table(record.stage, model) for record in records.values() for model in record.models]
    tables += [
        figures(record)
        for record in records.values()
        if record.figures and record.stage != "denoise"
    ]
    criteria = tuple(Criterion(**entry) for entry in document["acceptance"])
    title = (
        f"{name}: {document['procedure']}, effective from {document['effective_from']},"
        f" {document['software']}"
    )
    return Summary(title, tuple(tables), tuple(document["flags"]), criteria)


def table(stage: str, model: Model) -> SummaryTable:
    """Coefficients of one model."""
    rows = tuple(
        (c.name, f"{c.value:.9g}", f"{c.standard_uncertainty:.2g}", c.unit)
        for c in model.coefficients
    )
    valid = ", ".join(
        f"{column} {low:.4g} to {high:.4g}" for column, (low, high) in model.valid.items()
    )
    chosen = ", ".join(f"{p.name} {p.value:g} {p.unit}" for p in model.parameters)
    title = (
        f"{stage}: {model.name} ({model.form};"
        f" {'; '.join(filter(None, (chosen, f'valid for {valid}' if valid else '')))})"
    )
    return SummaryTable(title, ("coefficient", "value", "standard uncertainty", "unit"), rows)


def figures(record: Record) -> SummaryTable:
    """Figures of one stage."""
    rows = tuple(
        (
            f.name,
            f"{f.value:.6g}",
            f"{f.standard_uncertainty:.2g}" if f.standard_uncertainty else "-",
            f.unit,
        )
        for f in record.figures[:MOST_FIGURES]
    )
    return SummaryTable(
        f"{record.stage}: figures", ("figure", "value", "standard uncertainty", "unit"), rows
    )

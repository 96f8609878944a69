"""A run's coefficient files as tables: for people, and as CSV."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from calibkit.records.coefficients import Coefficient, Condition, Criterion, Model, Record
from calibkit.report.summary import Summary
from calibkit.report.table import Cell, Column, Table, tabulate

MOST_FIGURES = 40
"""Figures of a stage that the console shows."""
SHARED = "errors that observations share"
RUN_COLUMNS = (
    "serial",
    "revision",
    "effective_from",
    "stage",
    "kind",
    "model",
    "form",
    "name",
    "value",
    "unit",
    "standard_uncertainty",
    "dof",
)


def quantity_table(
    title: str,
    quantities: Iterable[Coefficient | Condition],
    *,
    head: str,
    digits: tuple[str, str],
    unstated: str = "0",
    dof: bool = False,
) -> Table:
    """Names, values, standard uncertainties and units of coefficients, figures or conditions.

    `digits` are the formats of value and uncertainty, `unstated` is what people read for an
    uncertainty of 0; `dof` adds effective degrees of freedom where a coefficient has its own.
    """
    columns = (
        Column(head, key="name"),
        Column("value", digits[0]),
        Column("standard uncertainty", digits[1], key="standard_uncertainty", zero=unstated),
        "unit",
        *((Column("degrees of freedom", ".3g", key="effective_dof", missing=""),) if dof else ()),
    )
    return tabulate(title, columns, quantities)


def states_dof(models: Iterable[Model]) -> bool:
    """Whether a coefficient of a model has effective degrees of freedom of its own."""
    return any(c.effective_dof is not None for model in models for c in model.coefficients)


def list_components(title: str, models: Iterable[Model]) -> Table:
    """Errors that observations share, in some models: standard deviations with their standard
    uncertainties.
    """
    rows = tuple(
        (model.name, part.name, part.value, part.standard_uncertainty, part.unit, part.groups)
        for model in models
        for part in model.components
    )
    numbers = Column("standard deviation", ".3g"), Column("standard uncertainty", ".2g")
    columns = ("model", "error", *numbers, "unit", Column("groups", ".0f"))
    return Table(title, columns, rows)


def summarize_run(name: str, document: Mapping[str, Any], records: Mapping[str, Record]) -> Summary:
    """Every model and figure of a run with units and standard uncertainties."""
    tables = [
        quantity_table(
            _model_title(record.stage, model),
            model.coefficients,
            head="coefficient",
            digits=(".9g", ".2g"),
            dof=states_dof([model]),
        )
        for record in records.values()
        for model in record.models
    ]
    shared = (
        list_components(f"{record.stage}: {SHARED}", record.models) for record in records.values()
    )
    tables += [table for table in shared if table.rows]
    tables += [
        quantity_table(
            f"{record.stage}: figures",
            record.figures[:MOST_FIGURES],
            head="figure",
            digits=(".6g", ".2g"),
            unstated="-",
        )
        for record in records.values()
        if record.figures and record.stage != "denoise"
    ]
    title = (
        f"{name}: {document['procedure']}, effective from {document['effective_from']},"
        f" {document['software']}"
    )
    return Summary(title, tuple(tables), tuple(document["flags"]), stated_criteria(document))


def stated_criteria(document: Mapping[str, Any]) -> tuple[Criterion, ...]:
    """Acceptance limits that run.json or a validation states, and how the results stand against
    them.
    """
    return tuple(Criterion(**entry) for entry in document["acceptance"])


def _model_title(stage: str, model: Model) -> str:
    """A model with its form, chosen parameters and valid ranges."""
    parameters = ", ".join(f"{p.name} {p.value:g} {p.unit}" for p in model.parameters)
    valid = ", ".join(
        f"{column} {low:.4g} to {high:.4g}" for column, (low, high) in model.valid.items()
    )
    properties = filter(None, (parameters, f"valid for {valid}" if valid else ""))
    return f"{stage}: {model.name} ({model.form}; {'; '.join(properties)})"


def list_numbers(records: Iterable[Record]) -> Table:
    """Coefficients, parameters and figures of a run, one row each, for CSV."""
    return Table("", RUN_COLUMNS, tuple(row for record in records for row in _number_rows(record)))


def _number_rows(record: Record) -> Iterator[tuple[Cell, ...]]:
    """Rows of one stage in `list_numbers`."""
    place = (record.serial, record.revision, record.effective_from, record.stage)
    for model in record.models:
        of_model = (model.name, model.form)
        for c in model.coefficients:
            u, dof = c.standard_uncertainty, model.dof_of(c)
            yield (*place, "coefficient", *of_model, c.name, c.value, c.unit, u, dof)
        for p in model.parameters:
            yield (*place, "parameter", *of_model, p.name, p.value, p.unit, None, None)
        for part in model.components:
            u, name = part.standard_uncertainty, part.name
            yield (*place, "component", *of_model, name, part.value, part.unit, u, None)
    for f in record.figures:
        u = f.standard_uncertainty
        yield (*place, "figure", "", "", f.name, f.value, f.unit, u or None, f.effective_dof)

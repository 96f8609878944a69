"""Tables of a run's page: coefficients and figures with units and uncertainties, conditions,
combined uncertainties; their numbers with every digit.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from calibkit.records.coefficients import Record
from calibkit.report.markup import Content, element
from calibkit.report.run import SHARED, list_components, quantity_table, states_dof
from calibkit.report.table import Column, Table

EXACT = ("", ".3g")
"""Formats of a value, with every digit of the coefficient file, and of its uncertainty."""
SIX = Column("", ".6g")
COMBINED = (
    "result",
    Column("value", ".6g", missing="–"),
    "unit",
    Column("u", ".6g", missing="–"),
    Column("effective dof", ".6g", missing="∞"),
    Column("k", ".6g", missing="–"),
    Column("U", ".6g", missing="–"),
    "components",
)


def cells(table: Table) -> list[list[Content]]:
    """Rows of a table as people read them; a number with every digit as its machine value."""
    return [
        [
            element("data", column.text(cell), value=repr(float(cell)))
            if isinstance(cell, float)
            else column.text(cell)
            for column, cell in zip(table.formats, row, strict=True)
        ]
        for row in table.rows
    ]


def six_digits(value: float) -> Content:
    """A number with six digits, and every digit as its machine value."""
    return element("data", SIX.text(float(value)), value=repr(float(value)))


def as_stated(entry: Mapping[str, Any]) -> str:
    """An entry of a recipe's list."""
    return "; ".join(
        f"{key}: {value}" for key, value in entry.items() if value not in (None, "", [], {})
    )


def model_tables(record: Record) -> list[Table]:
    """Coefficients of each model of a stage."""
    caption, dof = f"Coefficients of {record.stage}.json", states_dof(record.models)
    return [
        quantity_table(caption, model.coefficients, head="coefficient", digits=EXACT, dof=dof)
        for model in record.models
    ]


def shared_errors(record: Record) -> Table:
    """Errors that observations share, in the models of a stage."""
    return list_components(f"{record.stage}: {SHARED}", record.models)


def figures_table(record: Record) -> Table:
    """Figures of merit of a stage."""
    return quantity_table(
        f"Figures of {record.stage}.json",
        record.figures,
        head="figure",
        digits=EXACT,
        unstated="not stated",
    )


def conditions_table(records: Mapping[str, Record]) -> Table:
    """Conditions under which the coefficients were found, each once."""
    conditions = dict.fromkeys(entry for record in records.values() for entry in record.conditions)
    return quantity_table(
        "Conditions", conditions, head="condition", digits=EXACT, unstated="not stated"
    )


def combined_table(entries: Sequence[Mapping[str, Any]]) -> Table:
    """Combined and expanded uncertainties of results, with their components."""
    rows = tuple(
        (
            " ".join((entry["result"], *_where_it_holds(entry))),
            entry.get("value"),
            str(entry.get("unit", "")),
            entry.get("standard_uncertainty"),
            entry.get("effective_dof"),
            entry.get("coverage_factor"),
            entry.get("expanded_uncertainty"),
            ", ".join(
                f"{part['name']} ({part['kind']}) {part['standard_uncertainty']:.3g}"
                for part in entry.get("components", ())
            ),
        )
        for entry in entries
    )
    return Table("Combined uncertainties, type A and type B", COMBINED, rows)


def _where_it_holds(entry: Mapping[str, Any]) -> Iterator[str]:
    """Where a result holds, and with what probability its U covers it."""
    if "where" in entry:
        yield str(entry["where"])
    if entry.get("temp_case_degc") is not None:
        yield f"at {entry['temp_case_degc']:.4g} °C"
    if "probability" in entry:
        yield f"({100.0 * entry['probability']:.4g} %)"

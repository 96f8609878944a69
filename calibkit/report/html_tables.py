"""Tables of a run's record for its page: limits, coefficients and figures with units and
uncertainties, logs, digests.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.report.markup import Content, Markup, element, joined, row, table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.coefficients import Coefficient, Condition, Model, Record
    from calibkit.report.summary import SummaryTable

FOLDED = 40
"""Rows of a table beyond which it is folded up."""


def exact(value: float) -> Markup:
    """A number with every digit of the coefficient file."""
    return element("data", repr(value), value=repr(value))


def uncertainty(value: float, none: str = "0") -> Markup:
    """A standard uncertainty in three digits, the file's as its machine value; of 0 what that means
    there.
    """
    return element("data", f"{value:.3g}" if value else none, value=repr(value))


def _stated(entry: Coefficient | Condition) -> Markup:
    """Row of a figure or a condition, which need not have an uncertainty."""
    u = uncertainty(entry.standard_uncertainty, "not stated")
    return row(entry.name, exact(entry.value), u, entry.unit, numbers=(1, 2))


def folded(caption: str, rows: int, made: Markup) -> Markup:
    """A table as it is, or behind its caption where it is long."""
    if rows <= FOLDED:
        return made
    return element("details", element("summary", f"{caption} ({rows} rows)"), made)


def summary_table(shown: SummaryTable) -> Markup:
    """A table of the summary."""
    width = len(shown.columns)
    numbers = range(1, width)
    rows = [row(*cells, *[""] * (width - len(cells)), numbers=numbers) for cells in shown.rows]
    return folded(shown.title, len(rows), table(shown.title, shown.columns, [rows], numbers))


def acceptance(criteria: Sequence[Mapping[str, Any]]) -> Markup:
    """Acceptance limits and how the results stand against them; what failed is marked."""
    heads = ("limit on", "result", "limit", "unit", "")
    rows = [
        row(
            entry["name"],
            element("data", f"{entry['value']:.6g}", value=repr(entry["value"])),
            element("data", f"{entry['limit']:.6g}", value=repr(entry["limit"])),
            entry["unit"],
            "held" if entry["passed"] else element("strong", "FAILED"),
            kind="" if entry["passed"] else "failed",
            numbers=(1, 2),
        )
        for entry in criteria
    ]
    return table("Acceptance limits", heads, [rows], (1, 2))


def coefficients(record: Record) -> Markup:
    """Every coefficient of a stage, its models below each other."""
    heads = ("coefficient", "value", "standard uncertainty", "unit")
    bodies = [[_model_row(model), *_coefficient_rows(model)] for model in record.models]
    caption = f"Coefficients of {record.stage}.json"
    count = sum(len(model.coefficients) for model in record.models)
    return folded(caption, count, table(caption, heads, bodies, (1, 2)))


def _coefficient_rows(model: Model) -> list[Markup]:
    """One row a coefficient."""
    return [
        row(
            entry.name,
            exact(entry.value),
            uncertainty(entry.standard_uncertainty),
            entry.unit,
            numbers=(1, 2),
        )
        for entry in model.coefficients
    ]


def _model_row(model: Model) -> Markup:
    """The head of a model's rows: its name, form, validity, degrees of freedom and residual."""
    valid = [
        f"{column} from {low:.6g} to {high:.6g}" for column, (low, high) in model.valid.items()
    ]
    chosen = [
        f"{entry.name} = {entry.value:.9g}{'' if entry.unit == '1' else f' {entry.unit}'}"
        for entry in model.parameters
    ]
    residual = (
        f"{model.dof} degrees of freedom, residual rms {model.residual_rms:.6g}"
        f" {model.residual_unit}"
    )
    said = "; ".join((model.form, *(f"valid for {part}" for part in valid), *chosen, residual))
    return element(
        "tr",
        element("th", element("b", model.name), f" {said}", scope="rowgroup", colspan="4"),
        class_="model",
    )


def figures(record: Record) -> Markup:
    """Figures of merit of a stage."""
    heads = ("figure", "value", "standard uncertainty", "unit")
    rows = [_stated(entry) for entry in record.figures]
    caption = f"Figures of {record.stage}.json"
    return folded(caption, len(rows), table(caption, heads, [rows], (1, 2)))


def conditions(records: Sequence[Record]) -> Markup:
    """Conditions under which the coefficients were found, each once."""
    found = dict.fromkeys(entry for record in records for entry in record.conditions)
    heads = ("condition", "value", "standard uncertainty", "unit")
    rows = [_stated(entry) for entry in found]
    return (
        table("Conditions", heads, [rows], (1, 2))
        if rows
        else element("p", "The recipe states no conditions.")
    )


def combined(entries: Sequence[Mapping[str, Any]]) -> Markup:
    """Combined and expanded uncertainties of results, with their components."""
    heads = ("result", "value", "unit", "u", "effective dof", "k", "U", "components")
    rows = [
        row(
            " ".join((entry["result"], *_where(entry))),
            _number(entry.get("value")),
            str(entry.get("unit", "")),
            _number(entry.get("standard_uncertainty")),
            _number(entry.get("effective_dof")) if entry.get("effective_dof") is not None else "∞",
            _number(entry.get("coverage_factor")),
            _number(entry.get("expanded_uncertainty")),
            ", ".join(
                f"{part['name']} ({part['kind']}) {part['standard_uncertainty']:.3g}"
                for part in entry.get("components", ())
            ),
            numbers=(1, 3, 4, 5, 6),
        )
        for entry in entries
    ]
    return table("Combined uncertainties, type A and type B", heads, [rows], (1, 3, 4, 5, 6))


def _where(entry: Mapping[str, Any]) -> list[str]:
    """Where a result holds, and with what probability its U covers it."""
    parts = [str(entry["where"])] if "where" in entry else []
    parts += (
        [f"at {entry['temp_case_degc']:.4g} °C"] if entry.get("temp_case_degc") is not None else []
    )
    return parts + ([f"({100.0 * entry['probability']:.4g} %)"] if "probability" in entry else [])


def _number(value: float | None) -> Content:
    """A number in six digits with its machine value, or a dash."""
    return "–" if value is None else element("data", f"{value:.6g}", value=repr(value))


def logs(inputs: Sequence[Mapping[str, Any]]) -> Markup:
    """Logs with rows, digests and how each was read."""
    rows = [
        row(
            entry["name"],
            str(entry["rows"]),
            element("code", entry["sha256"]),
            joined([element("div", said) for said in entry.get("reading", ())], ""),
            numbers=(1,),
        )
        for entry in inputs
    ]
    made = table("Logs", ("log", "rows", "SHA-256", "how it was read"), [rows], (1,))
    return folded("Logs", len(rows), made)


def entries(caption: str, found: Sequence[Mapping[str, Any]]) -> Markup:
    """Entries of a recipe's list (exclusions, corrections, type B terms), one a row, as they were
    written.
    """
    rows = [
        row(
            str(number),
            "; ".join(
                f"{key}: {value}" for key, value in entry.items() if value not in (None, "", [], {})
            ),
        )
        for number, entry in enumerate(found, start=1)
    ]
    return table(caption, ("", "as stated"), [rows], ())


def facts(caption: str, pairs: Sequence[tuple[str, Content]]) -> Markup:
    """Names and values."""
    return table(caption, ("", ""), [[row(name, value) for name, value in pairs]], ())

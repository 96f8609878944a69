"""Tables of a run's record for its page: limits, coefficients and figures with units and
uncertainties, logs, digests.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from calibkit.coefficients import Model, Record
from calibkit.report.markup import Content, Markup, element, joined, row, table
from calibkit.report.run import quantity_table
from calibkit.report.table import Cell, Column, Table

FOLDED = 40
"""Rows of a table beyond which it is folded up."""
EXACT = ("", ".3g")
"""Formats of a value, with every digit of the coefficient file, and of its uncertainty."""
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


def _shown(column: Column, cell: Cell) -> Content:
    """A cell as people read it; a number with every digit as its machine value."""
    text = column.text(cell)
    return element("data", text, value=repr(float(cell))) if isinstance(cell, float) else text


def _rows_of(made: Table, numbers: Sequence[int]) -> list[Markup]:
    """Rows of a table of records."""
    columns = made.formats
    return [row(*map(_shown, columns, cells), numbers=numbers) for cells in made.rows]


def _record_table(made: Table, numbers: Sequence[int]) -> Markup:
    """A table of records, its numbers with every digit."""
    return table(made.title, made.heads, [_rows_of(made, numbers)], numbers)


def _folded(caption: str, rows: int, made: Markup) -> Markup:
    """A table as it is, or behind its caption where it is long."""
    if rows <= FOLDED:
        return made
    return element("details", element("summary", f"{caption} ({rows} rows)"), made)


def summary_table(made: Table) -> Markup:
    """A table of the summary, as its texts."""
    width = len(made.columns)
    numbers = range(1, width)
    rows = [row(*cells, *[""] * (width - len(cells)), numbers=numbers) for cells in made.texts]
    return _folded(made.title, len(rows), table(made.title, made.heads, [rows], numbers))


def acceptance(criteria: Sequence[Mapping[str, Any]]) -> Markup:
    """Acceptance limits and how the results stand against them; what failed is marked."""
    heads = ("limit on", "result", "limit", "unit", "")
    six = Column("", ".6g")
    rows = [
        row(
            entry["name"],
            _shown(six, float(entry["value"])),
            _shown(six, float(entry["limit"])),
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
    caption = f"Coefficients of {record.stage}.json"
    made = [
        quantity_table(caption, model.coefficients, head="coefficient", digits=EXACT)
        for model in record.models
    ]
    bodies = [
        [_model_row(model), *_rows_of(one, (1, 2))]
        for model, one in zip(record.models, made, strict=True)
    ]
    count = sum(len(one.rows) for one in made)
    return _folded(caption, count, table(caption, made[0].heads, bodies, (1, 2)))


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
    about = "; ".join((model.form, *(f"valid for {part}" for part in valid), *chosen, residual))
    return element(
        "tr",
        element("th", element("b", model.name), f" {about}", scope="rowgroup", colspan="4"),
        class_="model",
    )


def figures(record: Record) -> Markup:
    """Figures of merit of a stage."""
    made = quantity_table(
        f"Figures of {record.stage}.json",
        record.figures,
        head="figure",
        digits=EXACT,
        unstated="not stated",
    )
    return _folded(made.title, len(made.rows), _record_table(made, (1, 2)))


def conditions(records: Sequence[Record]) -> Markup:
    """Conditions under which the coefficients were found, each once."""
    found = dict.fromkeys(entry for record in records for entry in record.conditions)
    if not found:
        return element("p", "The recipe states no conditions.")
    made = quantity_table(
        "Conditions", found, head="condition", digits=EXACT, unstated="not stated"
    )
    return _record_table(made, (1, 2))


def combined(entries: Sequence[Mapping[str, Any]]) -> Markup:
    """Combined and expanded uncertainties of results, with their components."""
    rows = tuple(
        (
            " ".join((entry["result"], *_where(entry))),
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
    title = "Combined uncertainties, type A and type B"
    return _record_table(Table(title, COMBINED, rows), (1, 3, 4, 5, 6))


def _where(entry: Mapping[str, Any]) -> list[str]:
    """Where a result holds, and with what probability its U covers it."""
    parts = [str(entry["where"])] if "where" in entry else []
    parts += (
        [f"at {entry['temp_case_degc']:.4g} °C"] if entry.get("temp_case_degc") is not None else []
    )
    return parts + ([f"({100.0 * entry['probability']:.4g} %)"] if "probability" in entry else [])


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
    return _folded("Logs", len(rows), made)


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

"""What a run's page lists: limits, flags, coefficients and figures with units and uncertainties,
logs, digests.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from calibkit.coefficients import Model, Record
from calibkit.report.markup import Content, Markup, element, escaped, join_markup
from calibkit.report.overview import concise
from calibkit.report.run import SHARED, list_components, quantity_table, states_dof
from calibkit.report.table import Cell, Column, Table

FOLDED = 40
"""Rows of a table beyond which it is folded up."""
EXACT = ("", ".3g")
"""Formats of a value, with every digit of the coefficient file, and of its uncertainty."""
FAILED_LIMITS = "REJECTED: these coefficients failed the acceptance limits."
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


def _row(first: Content, *contents: Content, kind: str = "", numbers: Sequence[int] = ()) -> Markup:
    """A row whose first cell names it; the cells at `numbers` are set as numbers."""
    cells = (
        element("td", content, class_="number" if column in numbers else "")
        for column, content in enumerate(contents, start=1)
    )
    return element("tr", element("th", first, scope="row"), *cells, class_=kind)


def _table(
    caption: Content,
    heads: Sequence[Content],
    bodies: Sequence[Sequence[Markup]],
    numbers: Sequence[int],
) -> Markup:
    """A table with a caption and column heads in a frame that scrolls sideways where the page is
    narrow.
    """
    head = element(
        "tr",
        *(
            element("th", name, scope="col", class_="number" if column in numbers else "")
            for column, name in enumerate(heads)
        ),
    )
    parts = [element("caption", element("span", caption)), element("thead", head)]
    parts += [Markup(f"<tbody>\n{join_markup(rows)}\n</tbody>") for rows in bodies]
    return element(
        "div",
        Markup(f"<table>\n{join_markup(parts)}\n</table>"),
        class_="wide",
        tabindex="0",
        role="group",
    )


def _show_cell(column: Column, cell: Cell) -> Content:
    """A cell as people read it; a number with every digit as its machine value."""
    text = column.text(cell)
    return element("data", text, value=repr(float(cell))) if isinstance(cell, float) else text


def _rows_of(table: Table, numbers: Sequence[int]) -> list[Markup]:
    """Rows of a table of records."""
    columns = table.formats
    return [_row(*map(_show_cell, columns, cells), numbers=numbers) for cells in table.rows]


def _record_table(table: Table, numbers: Sequence[int]) -> Markup:
    """A table of records, its numbers with every digit."""
    return _table(table.title, table.heads, [_rows_of(table, numbers)], numbers)


def _folded(caption: str, rows: int, markup: Markup) -> Markup:
    """A table as it is, or behind its caption where it is long."""
    if rows <= FOLDED:
        return markup
    return element("details", element("summary", f"{caption} ({rows} rows)"), markup)


def summary_table(table: Table) -> Markup:
    """A table of the summary, as its texts."""
    width = len(table.columns)
    numbers = range(1, width)
    rows = [_row(*cells, *[""] * (width - len(cells)), numbers=numbers) for cells in table.texts]
    return _folded(table.title, len(rows), _table(table.title, table.heads, [rows], numbers))


def list_rows(
    caption: str, heads: Sequence[str], rows: Sequence[Sequence[Content]], numbers: Sequence[int]
) -> Markup:
    """A table of texts and pieces; the cells at `numbers` are set as numbers."""
    return _table(caption, heads, [[_row(*cells, numbers=numbers) for cells in rows]], numbers)


def list_limits(criteria: Sequence[Mapping[str, Any]]) -> Markup:
    """Acceptance limits and how the results stand against them; what failed is marked."""
    six = Column("", ".6g")
    rows = [
        _row(
            entry["name"],
            _show_cell(six, float(entry["value"])),
            _show_cell(six, float(entry["limit"])),
            entry["unit"],
            "met" if entry["passed"] else element("strong", "FAILED"),
            kind="" if entry["passed"] else "failed",
            numbers=(1, 2),
        )
        for entry in criteria
    ]
    return _table("Acceptance limits", ("limit on", "result", "limit", "unit", ""), [rows], (1, 2))


def _coefficients(record: Record) -> Markup:
    """Every coefficient of a stage, its models below each other."""
    caption = f"Coefficients of {record.stage}.json"
    dof = states_dof(record.models)
    tables = [
        quantity_table(caption, model.coefficients, head="coefficient", digits=EXACT, dof=dof)
        for model in record.models
    ]
    heads = tables[0].heads
    bodies = [
        [_model_row(model, len(heads)), *_rows_of(table, (1, 2, 4))]
        for model, table in zip(record.models, tables, strict=True)
    ]
    rows = sum(len(table.rows) for table in tables)
    return _folded(caption, rows, _table(caption, heads, bodies, (1, 2, 4)))


def _model_row(model: Model, columns: int) -> Markup:
    """The head of a model's rows: its name, form, validity, degrees of freedom and residual."""
    valid = [
        f"{column} from {low:.6g} to {high:.6g}" for column, (low, high) in model.valid.items()
    ]
    parameters = [
        f"{entry.name} = {entry.value:.9g}{'' if entry.unit == '1' else f' {entry.unit}'}"
        for entry in model.parameters
    ]
    properties = (
        model.form,
        *(f"valid for {part}" for part in valid),
        *parameters,
        f"{model.dof} degrees of freedom",
    )
    residual = f"residual rms {model.residual_rms:.6g} {model.residual_unit}"
    head = (element("b", model.name), f" {'; '.join(properties)}, {residual}")
    return element(
        "tr", element("th", *head, scope="rowgroup", colspan=f"{columns}"), class_="model"
    )


def _figures(record: Record) -> Markup:
    """Figures of merit of a stage."""
    table = quantity_table(
        f"Figures of {record.stage}.json",
        record.figures,
        head="figure",
        digits=EXACT,
        unstated="not stated",
    )
    return _folded(table.title, len(table.rows), _record_table(table, (1, 2)))


def _conditions(records: Sequence[Record]) -> Markup:
    """Conditions under which the coefficients were found, each once."""
    conditions = dict.fromkeys(entry for record in records for entry in record.conditions)
    if not conditions:
        return element("p", "The recipe states no conditions.")
    return _record_table(
        quantity_table(
            "Conditions", conditions, head="condition", digits=EXACT, unstated="not stated"
        ),
        (1, 2),
    )


def _combined(entries: Sequence[Mapping[str, Any]]) -> Markup:
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
    table = Table("Combined uncertainties, type A and type B", COMBINED, rows)
    return _record_table(table, (1, 3, 4, 5, 6))


def _where_it_holds(entry: Mapping[str, Any]) -> Iterator[str]:
    """Where a result holds, and with what probability its U covers it."""
    if "where" in entry:
        yield str(entry["where"])
    if entry.get("temp_case_degc") is not None:
        yield f"at {entry['temp_case_degc']:.4g} °C"
    if "probability" in entry:
        yield f"({100.0 * entry['probability']:.4g} %)"


def _logs(inputs: Sequence[Mapping[str, Any]]) -> Markup:
    """Logs with rows, digests and how each was read."""
    rows = [
        _row(
            entry["name"],
            str(entry["rows"]),
            element("code", entry["sha256"]),
            join_markup([element("div", line) for line in entry.get("reading", ())], ""),
            numbers=(1,),
        )
        for entry in inputs
    ]
    table = _table("Logs", ("log", "rows", "SHA-256", "how it was read"), [rows], (1,))
    return _folded("Logs", len(rows), table)


def _entries(caption: str, entries: Sequence[Mapping[str, Any]]) -> Markup:
    """Entries of a recipe's list (exclusions, corrections, type B terms), one a row, as they were
    written.
    """
    rows = [
        _row(
            str(number),
            "; ".join(
                f"{key}: {value}" for key, value in entry.items() if value not in (None, "", [], {})
            ),
        )
        for number, entry in enumerate(entries, start=1)
    ]
    return _table(caption, ("", "as stated"), [rows], ())


def _facts(caption: str, pairs: Sequence[tuple[str, Content]]) -> Markup:
    """Names and values."""
    return _table(caption, ("", ""), [[_row(name, value) for name, value in pairs]], ())


def list_flags(flags: Sequence[str]) -> Markup:
    """Flags, one below the other."""
    return element("ul", join_markup([element("li", flag) for flag in flags]), class_="flags")


def list_exported(document: Mapping[str, Any], records: Sequence[Record]) -> list[Markup]:
    """What firmware takes, as value(standard uncertainty); of which file, form and range."""
    parts = []
    if document["verdict"] == "rejected":
        parts.append(element("p", element("strong", FAILED_LIMITS), class_="warn"))
    for record in records:
        rows = []
        for model in record.models:
            rows.append(_model_row(model, 3))
            rows += [
                _row(c.name, concise(c.value, c.standard_uncertainty), c.unit, numbers=(1,))
                for c in model.coefficients
            ]
        if rows:
            caption = (
                f"{record.stage}.json: value(standard uncertainty, type A, of the last digits)"
            )
            heads = ("coefficient", "value", "unit")
            parts.append(_table(caption, heads, [rows], (1,)))
    return parts or [element("p", "No coefficient is exported.")]


def list_coefficients(document: Mapping[str, Any], records: Mapping[str, Record]) -> list[Markup]:
    """Models and figures of every stage, as the coefficient files have them."""
    parts = []
    if document["verdict"] == "rejected":
        parts.append(element("p", element("strong", FAILED_LIMITS), class_="warn"))
    parts.append(
        element(
            "p",
            "Values with every digit of the coefficient files. Standard uncertainties are of type A"
            " alone and are rounded here; what instruments add stands under Uncertainty.",
        )
    )
    for record in records.values():
        stage_flags = [flag for flag in record.flags if flag not in document["flags"]]
        parts += [element("h4", f"{record.stage}.json")]
        parts += [list_flags(stage_flags)] if stage_flags else []
        parts += [_coefficients(record)] if record.models else []
        shared = list_components(f"{record.stage}: {SHARED}", record.models)
        parts += [_record_table(shared, (2, 3, 5))] if shared.rows else []
        parts += [_figures(record)] if record.figures else []
        if not record.models and not record.figures:
            parts.append(element("p", "This stage exports nothing."))
    return parts


def list_uncertainties(document: Mapping[str, Any]) -> list[Markup]:
    """Combined uncertainties and the type B terms of the recipe."""
    combined, terms = document.get("uncertainty"), document.get("type_b")
    parts = [
        _combined(combined) if combined else element("p", "No combined uncertainty is stated.")
    ]
    return [*parts, _entries("Type B terms of the recipe", terms)] if terms else parts


def list_logs(document: Mapping[str, Any]) -> list[Markup]:
    """What was read, what of it was left out by whom and why, what was corrected."""
    parts = [_logs(document["inputs"])]
    if document["excluded"]:
        parts.append(_entries("Left out", document["excluded"]))
    if document.get("corrections"):
        parts.append(
            _entries(
                "Corrections from certificates of reference instruments", document["corrections"]
            )
        )
    return parts


def list_origin(document: Mapping[str, Any], records: Mapping[str, Record]) -> list[Markup]:
    """Conditions, software, recipe, and the digests by which the files are known."""
    recipe = document["recipe"]
    versions = ", ".join(f"{name} {version}" for name, version in document["libraries"].items())
    pairs = [
        ("serial", document["serial"]),
        ("revision", str(document["revision"])),
        ("procedure", document["procedure"]),
        ("effective from", document["effective_from"]),
        ("software", f"{document['software']}, Python {document['python']}, {versions}"),
        ("recipe", recipe["name"]),
        ("SHA-256 of the recipe", element("code", recipe["sha256"])),
        *(("changed by --set", element("code", text)) for text in recipe["overrides"]),
        *(
            (f"{name} supersedes the file of sha256", element("code", record.supersedes))
            for name, record in records.items()
            if record.supersedes
        ),
    ]
    files = [
        (f"SHA-256 of {entry['name']}", element("code", entry["sha256"]))
        for entry in document["files"]
    ]
    return [
        _conditions(tuple(records.values())),
        _facts("Where this comes from", pairs),
        _facts("Files of the run (this page is listed in run.json)", files),
        element(
            "details",
            element("summary", "The recipe as it was written"),
            Markup(f"<pre>{escaped(recipe['text'])}</pre>"),
        ),
    ]

"""A run for people: its report as blocks, its coefficient files as tables, and as CSV."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from calibkit.records.coefficients import Coefficient, Condition, Criterion, Model, Record
from calibkit.report import documents
from calibkit.report.blocks import (
    Block,
    Chart,
    Findings,
    Fold,
    Heading,
    Page,
    Standing,
    Text,
    Values,
)
from calibkit.report.overview import Overview, concise
from calibkit.report.summary import Summary
from calibkit.report.table import Cell, Column, Table, tabulate

MOST_FIGURES = 40
"""Figures of a stage that the console shows."""
MOST_CHECKS = 6
"""Findings on the first screen of a page."""
EXACT = ("", ".3g")
"""Formats of a value, with every digit of the coefficient file, and of its uncertainty."""
THINNED = "Of long curves the extremes of short pieces are drawn; the fit used every point."
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
FACTS = ("", Column("", key="as stated"))
"""Columns of facts by name."""


@dataclass(frozen=True, slots=True)
class Shown:
    """What the report of a run shows beside run.json and the coefficient files; its page keeps
    this.
    """

    title: str
    verdict: str
    """The verdict in a sentence."""
    overview: Overview = field(default_factory=Overview)
    tables: tuple[Table, ...] = ()
    checks: tuple[str, ...] = ()
    captions: tuple[str, ...] = ()
    """Of each figure."""
    thinned: bool = False
    """Whether long curves of the figures were thinned."""
    exported: tuple[str, ...] = ()
    """Coefficient files that firmware takes; empty where there is none."""
    no_firmware: str = ""
    """Why nothing can be exported to firmware; empty where it can."""
    measured: str = ""
    """Dates of the logs; empty where they state none."""
    text: str = ""
    """The results as text, of a run whose page kept no tables."""


def compose_page(
    document: Mapping[str, Any],
    records: Mapping[str, Record],
    shown: Shown,
    drawings: Sequence[str],
) -> Page:
    """The report of a run: first the verdict, the figure that shows it, a few values and what to
    check; every number behind it, folded up.

    `document` is its run.json but for what cannot know the report yet, digest and file list.
    """
    rejected = document["verdict"] == "rejected"
    standing: Standing = "open" if document["verdict"] == "no verdict" else document["verdict"]
    charts = [
        Chart(svg, f"{'REJECTED. ' if rejected else ''}Figure {number}. {caption}")
        for number, (svg, caption) in enumerate(zip(drawings, shown.captions, strict=True), start=1)
    ]
    subtitle = (
        shown.title or document["procedure"],
        shown.overview.data_extent,
        f"measured {shown.measured}" if shown.measured else "",
        f"effective from {document['effective_from']}",
    )
    alert = "REJECTED: these coefficients failed the acceptance limits."
    warning = (Text(alert, "warn"),) if rejected else ()
    notes: list[Block] = [
        Findings(tuple(document["flags"])) if document["flags"] else Text("No notes.")
    ]
    if shown.thinned:
        notes.append(Text(THINNED))
    exported = tuple(_exported_models(records, shown))
    parts: dict[str, Iterable[Block]] = {
        "Exported model": (*warning, *exported) if exported else (),
        "Results": (
            *map(Text, shown.overview.facts),
            *shown.tables,
            *((Text(shown.text, "code"),) if shown.text else ()),
        ),
        "More figures": charts[1:],
        "Limits": (
            _limits(document["acceptance"]) if document["acceptance"] else Text(shown.verdict),
        ),
        "Notes": notes,
        "Coefficients": (*warning, *_coefficients(document, records)),
        "Uncertainty": _uncertainty(document),
        "Logs": _logs(document),
        "Where this comes from": _origin(document, records),
    }
    folds = [Fold(name, blocks) for name, part in parts.items() if (blocks := tuple(part))]
    name = f"{document['serial']} r{document['revision']:03d}"
    return Page(
        title=f"{'REJECTED: ' if rejected else ''}{name}, {document['procedure']}",
        verdict=shown.verdict,
        standing=standing,
        subtitle=" · ".join(filter(None, subtitle)),
        lead=shown.overview.sentence,
        first=tuple(_first_screen(document, shown, charts[:1])),
        blocks=(Heading("Details"), *folds),
    )


def _first_screen(
    document: Mapping[str, Any], shown: Shown, charts: Sequence[Chart]
) -> Iterator[Block]:
    """What is seen before anything is unfolded."""
    overview = shown.overview
    yield from charts
    if overview.values:
        yield Values(tuple((f"{v.name[0].upper()}{v.name[1:]}", str(v)) for v in overview.values))
    if any(value.expanded_uncertainty for value in overview.values):
        yield Text("± is the expanded uncertainty of the fit (95 %).")
    if document["verdict"] == "rejected":
        yield Text("No firmware: the run is rejected")
    elif shown.no_firmware:
        yield Text(f"No firmware: {shown.no_firmware}")
    elif shown.exported:
        yield Text(f"Load {', '.join(shown.exported)} into the firmware.")
    checks = [*shown.checks]
    if document["excluded"]:
        checks.append(f"{len(document['excluded'])} exclusions of logs or parts of them: see Logs")
    if document["recipe"]["overrides"]:
        checks.append("the recipe was changed by --set: see Where this comes from")
    if not checks:
        yield Text("Nothing to check.")
        return
    yield Heading(f"Please check ({len(checks)})")
    yield Findings(tuple(checks[:MOST_CHECKS]))
    if len(checks) > MOST_CHECKS:
        yield Text(f"{len(checks) - MOST_CHECKS} more below, under Notes.")


def _exported_models(records: Mapping[str, Record], shown: Shown) -> Iterator[Table]:
    """What firmware takes, as value(standard uncertainty)."""
    for name in shown.exported or records:
        for model in records[name].models if name in records else ():
            rows = tuple(
                (c.name, concise(c.value, c.standard_uncertainty), c.unit)
                for c in model.coefficients
            )
            yield Table(f"{name}: {model.name}", ("coefficient", "value", "unit"), rows)


def _limits(acceptance: Sequence[Mapping[str, Any]]) -> Table:
    """Acceptance limits and how the results stand against them."""
    columns = ("limit on", Column("result", ".6g"), Column("limit", ".6g"), "unit", "")
    rows = []
    for entry in acceptance:
        numbers = float(entry["value"]), float(entry["limit"])
        rows.append(
            (entry["name"], *numbers, entry["unit"], "met" if entry["passed"] else "FAILED")
        )
    failed = tuple(k for k, entry in enumerate(acceptance) if not entry["passed"])
    return Table("Acceptance limits", columns, tuple(rows), failed)


def _coefficients(document: Mapping[str, Any], records: Mapping[str, Record]) -> Iterator[Block]:
    """Models and figures of every stage, as the coefficient files have them."""
    yield Text(
        "Values with every digit of the coefficient files. Standard uncertainties are of type A"
        " alone and are rounded here; what instruments add stands under Uncertainty."
    )
    for record in records.values():
        yield Heading(f"{record.stage}.json", 4)
        flags = tuple(flag for flag in record.flags if flag not in document["flags"])
        if flags:
            yield Findings(flags)
        yield from model_tables(record, EXACT)
        if record.figures:
            title = f"Figures of {record.stage}.json"
            yield quantity_table(
                title, record.figures, head="figure", digits=EXACT, unstated="not stated"
            )
        if not record.models and not record.figures:
            yield Text("This stage exports nothing.")


def _uncertainty(document: Mapping[str, Any]) -> Iterator[Block]:
    """Combined and expanded uncertainties of results with their components, and type B terms."""
    rows = []
    for entry in document.get("uncertainty", ()):
        where = str(entry.get("where", ""))
        if entry.get("temp_case_degc") is not None:
            where += f" at {entry['temp_case_degc']:.4g} °C"
        if "probability" in entry:
            where += f" ({100.0 * entry['probability']:.4g} %)"
        components = ", ".join(
            f"{part['name']} ({part['kind']}) {part['standard_uncertainty']:.3g}"
            for part in entry.get("components", ())
        )
        sizes = [
            entry.get(key)
            for key in (
                "standard_uncertainty",
                "effective_dof",
                "coverage_factor",
                "expanded_uncertainty",
            )
        ]
        name = " ".join(f"{entry['result']} {where}".split())
        rows.append((name, entry.get("value"), str(entry.get("unit", "")), *sizes, components))
    columns = (
        "result",
        Column("value", ".6g", missing="–"),
        "unit",
        Column("u", ".6g", missing="–"),
        Column("effective dof", ".6g", missing="∞"),
        Column("k", ".6g", missing="–"),
        Column("U", ".6g", missing="–"),
        "components",
    )
    if rows:
        yield Table("Combined uncertainties, type A and type B", columns, tuple(rows))
    else:
        yield Text("No combined uncertainty is stated.")
    yield from _as_stated("Type B terms of the recipe", document.get("type_b", ()))


def _logs(document: Mapping[str, Any]) -> Iterator[Block]:
    """Logs with rows, digests and how each was read; what was left out of them, and corrected."""
    columns = ("log", "rows", "SHA-256", "how it was read")
    rows = tuple(
        (entry["name"], entry["rows"], entry["sha256"], "\n".join(entry.get("reading", ())))
        for entry in document["inputs"]
    )
    yield Table("Logs", columns, rows)
    yield from _as_stated("Left out", document["excluded"])
    corrections = document.get("corrections", ())
    yield from _as_stated("Corrections from certificates of reference instruments", corrections)


def _as_stated(title: str, entries: Sequence[Mapping[str, Any]]) -> Iterator[Table]:
    """Entries of a recipe's list, one a row, as they were written; nothing where there are none."""
    rows = []
    for number, entry in enumerate(entries, start=1):
        stated = (f"{k}: {value}" for k, value in entry.items() if value not in (None, "", [], {}))
        rows.append((number, "; ".join(stated)))
    if rows:
        yield Table(title, ("", "as stated"), tuple(rows))


def _origin(document: Mapping[str, Any], records: Mapping[str, Record]) -> Iterator[Block]:
    """Conditions, software, recipe, and the digests by which the files are known."""
    conditions = dict.fromkeys(entry for record in records.values() for entry in record.conditions)
    if conditions:
        yield quantity_table(
            "Conditions", conditions, head="condition", digits=EXACT, unstated="not stated"
        )
    else:
        yield Text("The recipe states no conditions.")
    recipe = document["recipe"]
    libraries = "".join(f", {name} {version}" for name, version in document["libraries"].items())
    facts = [
        ("serial", document["serial"]),
        ("revision", document["revision"]),
        ("procedure", document["procedure"]),
        ("effective from", document["effective_from"]),
        ("software", f"{document['software']}, Python {document['python']}{libraries}"),
        ("recipe", recipe["name"]),
        ("SHA-256 of the recipe", recipe["sha256"]),
        *(("changed by --set", text) for text in recipe["overrides"]),
        *(
            (f"{name} supersedes the file of sha256", record.supersedes)
            for name, record in records.items()
            if record.supersedes
        ),
    ]
    yield Table("Where this comes from", FACTS, tuple(facts))
    digests = tuple(
        (f"SHA-256 of {entry['name']}", entry["sha256"])
        for entry in document["files"]
        if entry["name"] != documents.PAGE  # which cannot know its own
    )
    yield Table("Files of the run (this page is listed in run.json)", FACTS, digests)
    yield Fold("The recipe as it was written", (Text(recipe["text"], "code"),))


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


def model_tables(record: Record, digits: tuple[str, str]) -> list[Table]:
    """Coefficients of each model of a stage, and errors that observations of them share."""
    tables = [
        quantity_table(
            f"{record.stage}: {_describe_model(model)}",
            model.coefficients,
            head="coefficient",
            digits=digits,
            dof=any(c.effective_dof is not None for c in model.coefficients),
        )
        for model in record.models
    ]
    shared = list_components(f"{record.stage}: errors that observations share", record.models)
    return [*tables, shared] if shared.rows else tables


def _describe_model(model: Model) -> str:
    """A model with its form, chosen parameters, valid ranges, degrees of freedom and residual."""
    facts = [
        model.form,
        *(f"{p.name} = {p.value:.9g} {p.unit}".removesuffix(" 1") for p in model.parameters),
    ]
    facts += [
        f"valid for {column} from {low:.4g} to {high:.4g}"
        for column, (low, high) in model.valid.items()
    ]
    facts.append(f"{model.dof} degrees of freedom")
    facts.append(f"residual rms {model.residual_rms:.4g} {model.residual_unit}")
    return f"{model.name} ({'; '.join(facts)})"


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
    tables: list[Table] = []
    for record in records.values():
        tables += model_tables(record, (".9g", ".2g"))
    for record in records.values():
        if record.figures and record.stage != "denoise":
            figures = record.figures[:MOST_FIGURES]
            title = f"{record.stage}: figures"
            tables.append(
                quantity_table(title, figures, head="figure", digits=(".6g", ".2g"), unstated="-")
            )
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

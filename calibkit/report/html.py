"""A run's report as one HTML page that opens anywhere: first the verdict, the picture that shows
it, four values and what to check; every number folded below.

It is made of what the text is made of, and of the coefficient files, by the template run.html.j2;
it loads nothing, and its content security policy lets it load nothing: no script and no style but
its own, which are named by their digests.
"""

import base64
import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibkit.libraries.templates import read_templates
from calibkit.records.coefficients import Coefficient, Record
from calibkit.report import html_tables, svg
from calibkit.report.documents import Drawn
from calibkit.report.markup import Markup, shown
from calibkit.report.overview import concise
from calibkit.report.table import Table

if TYPE_CHECKING:
    import jinja2

FOLDER = Path(__file__).parent
REJECTED = '@media print{@page{@top-center{content:"REJECTED";color:#b00020;font-weight:bold}}}'
"""What a rejected run's page prints on every sheet of paper."""
HOW = (
    "Zoom: Ctrl + wheel, or the wheel alone once a figure is clicked; drag to move; double-click a"
    " panel to fill the figure with it, again for the whole; two fingers on a touch screen; the"
    " numbers below a figure show a panel. Keys: + − arrows, 0 for the whole, 1 to 9 for a panel."
)
THINNED = " Of long curves the extremes of short pieces are drawn; the fit used every point."
MOST_CHECKS = 6
"""Findings on the first screen."""
MOST_ROWS = 40
"""Rows of a table beyond which it is folded up."""


@dataclass(frozen=True, slots=True)
class Shown:
    """What a page shows beside run.json and the coefficient files."""

    drawn: Drawn
    exported: tuple[str, ...] = ()
    """Coefficient files that firmware takes; empty where there is none."""
    no_firmware: str = ""
    """Why nothing can be exported to firmware; empty where it can."""
    measured: str = ""
    """Dates of the logs; empty where they state none."""


def page(document: Mapping[str, Any], records: Mapping[str, Record], content: Shown) -> bytes:
    """The page of a run as UTF-8: `document` is its run.json but for what cannot know this page
    yet, digest and file list.
    """
    rejected = document["verdict"] == "rejected"
    summary = content.drawn.summary
    run_name = f"{document['serial']} r{document['revision']:03d}"
    title = f"{run_name}, {document['procedure']}"
    checks = [*summary.checks]
    if document["excluded"]:
        checks.append(f"{len(document['excluded'])} exclusions of logs or parts of them: see Logs")
    if document["recipe"]["overrides"]:
        checks.append("the recipe was changed by --set: see Where this comes from")
    figures = content.drawn.figures
    drawings, thinned = svg.inline(figures)
    names = content.exported or tuple(records)
    return _fill(
        "run.html.j2",
        f"REJECTED: {title}" if rejected else title,
        style=REJECTED if rejected else "",
        script=_own("page.js"),
        run_name=run_name,
        document=document,
        records=records,
        summary=summary,
        overview=summary.overview,
        shown=content,
        rejected=rejected,
        facts=[
            summary.title or document["procedure"],
            summary.overview.data_extent,
            f"measured {content.measured}" if content.measured else "",
            f"effective from {document['effective_from']}",
        ],
        checks=checks,
        most_checks=MOST_CHECKS,
        drawings=[
            {"caption": figure.get_suptitle(), "svg": Markup(drawing)}
            for figure, drawing in zip(figures, drawings, strict=True)
        ],
        how=HOW + (THINNED if thinned else ""),
        exported=[records[name] for name in names if name in records and records[name].models],
    )


def first_screen_of(page: str) -> str:
    """The page of a run without what is folded below its first screen, and without its script."""
    first_screen, _, details = page.partition("<h2>Details</h2>")
    return f"{first_screen}</main></body></html>" if details else page


def page_of_parts(title: str, band: str, kind: str, parts: Mapping[str, Sequence[Markup]]) -> bytes:
    """A page of parts below their headings, under a verdict in a band of its colour, as UTF-8."""
    return _fill("sections.html.j2", title, band=band, kind=kind, parts=parts)


def summary_table(table: Table) -> Markup:
    """A table of the summary, as its texts."""
    return _fill_macro("summary_table", table)


def list_rows(
    caption: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str | Markup]],
    numbers: Sequence[int],
) -> Markup:
    """A table of texts and pieces; the cells at `numbers` are set as numbers."""
    return _fill_macro("rows", caption, heads, rows, numbers)


def _fill(template: str, title: str, *, style: str = "", script: str = "", **values: Any) -> bytes:  # noqa: ANN401 (what a template prints)
    """A page as UTF-8: a template under calibkit's own style and what is added to it."""
    style = _own("page.css") + style
    page = templates().get_template(template)
    text = page.render(
        title=title,
        style=Markup(style),
        script=Markup(script) if script else "",
        policy=Markup(_policy(style, script)),
        **values,
    )
    return shown(text).encode()


def _fill_macro(name: str, *values: Any) -> Markup:  # noqa: ANN401 (what a template prints)
    """A piece of a page."""
    module = templates().get_template("tables.html.j2").module
    return Markup(shown(getattr(module, name)(*values)))


@functools.cache
def templates() -> "jinja2.Environment":
    """Templates of pages."""
    environment = read_templates(FOLDER, escaped=True)
    environment.globals["most_rows"] = MOST_ROWS
    environment.filters.update(
        {
            "as_stated": html_tables.as_stated,
            "cells": html_tables.cells,
            "combined_table": html_tables.combined_table,
            "concise": _concise,
            "conditions_table": html_tables.conditions_table,
            "figures_table": html_tables.figures_table,
            "model_tables": html_tables.model_tables,
            "shared_errors": html_tables.shared_errors,
            "six_digits": html_tables.six_digits,
        }
    )
    return environment


def _concise(coefficient: Coefficient) -> str:
    """A coefficient as value(standard uncertainty)."""
    return concise(coefficient.value, coefficient.standard_uncertainty)


@functools.cache
def _own(file: str) -> str:
    """Text of a file of this package, without lines of comment and spaces at their ends."""
    lines = map(str.strip, (FOLDER / file).read_text(encoding="utf-8").splitlines())
    return "\n".join(line for line in lines if line and not line.startswith("//"))


def _policy(style: str, script: str) -> str:
    """Content security policy under which nothing but this page's own style and script is used and
    nothing is loaded.
    """
    digests = [
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for text in (style, script)
    ]
    return (
        f"default-src 'none'; style-src {digests[0]}; script-src {digests[1]}; base-uri 'none';"
        " form-action 'none'"
    )

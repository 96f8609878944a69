"""A run's report as one HTML page that opens anywhere: verdict and flags first, figures that can be
zoomed, every number.

It is made of what the PDF and the text are made of, and of the coefficient files; it loads nothing,
and its content security policy lets it load nothing: no script and no style but its own, which are
named by their digests.
"""

import base64
import hashlib
from collections.abc import Mapping
from importlib import resources
from typing import Any

from calibkit.coefficients import Record
from calibkit.report import html_tables as tables, svg
from calibkit.report.documents import Drawn
from calibkit.report.markup import Markup, element, join_markup

SECTIONS = (
    "Verdict",
    "Flags",
    "Results",
    "Figures",
    "Coefficients",
    "Uncertainty",
    "Logs",
    "Origin",
)
REJECTED = '@media print{@page{@top-center{content:"REJECTED";color:#b00020;font-weight:bold}}}'
"""What a rejected run's page prints on every sheet of paper."""
HOW = (
    "Zoom: Ctrl + wheel, or the wheel alone once a figure is clicked; drag to move; double-click a"
    " panel to fill the figure with it, again for the whole; two fingers on a touch screen; the"
    " numbers below a figure show a panel. Keys: + − arrows, 0 for the whole, 1 to 9 for a panel."
)
THINNED = " Of long curves the extremes of short pieces are drawn; the fit used every point."


def page(document: Mapping[str, Any], records: Mapping[str, Record], drawn: Drawn) -> bytes:
    """The page of a run as UTF-8: `document` is its run.json but for what cannot know this page
    yet, digest and file list.
    """
    rejected = document["verdict"] == "rejected"
    style = _own("page.css") + (REJECTED if rejected else "")
    script = _own("page.js")
    title = f"{_run_name(document)}, {document['procedure']}"
    head = [
        Markup('<meta charset="utf-8">'),
        Markup(f'<meta http-equiv="Content-Security-Policy" content="{_policy(style, script)}">'),
        Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        Markup('<meta name="color-scheme" content="light dark">'),
        element("title", f"REJECTED: {title}" if rejected else title),
        Markup(f"<style>{style}</style>"),
    ]
    body = [
        _top(document, drawn),
        element("main", join_markup(_sections(document, records, drawn)), id="content"),
        Markup(f"<script>{script}</script>"),
    ]
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{join_markup(head)}\n</head>\n'
        f"<body>\n{join_markup(body)}\n</body>\n</html>\n"
    ).encode()


def _run_name(document: Mapping[str, Any]) -> str:
    """Serial and revision."""
    return f"{document['serial']} r{document['revision']:03d}"


def _own(file: str) -> str:
    """Text of a file of this package."""
    return resources.files("calibkit.report").joinpath(file).read_text(encoding="utf-8")


def _policy(style: str, script: str) -> str:
    """Content security policy under which nothing but this page's own style and script is used and
    nothing is loaded.
    """
    own = [
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for text in (style, script)
    ]
    return (
        f"default-src 'none'; style-src {own[0]}; script-src {own[1]}; base-uri 'none'; form-action"
        " 'none'"
    )


def _top(document: Mapping[str, Any], drawn: Drawn) -> Markup:
    """Whose run this is, the verdict on it, and the way to each section."""
    kind = "open" if document["verdict"] == "no verdict" else document["verdict"]
    facts = f"{document['procedure']}, effective from {document['effective_from']}"
    links = [element("a", section, href=f"#{section.lower()}") for section in SECTIONS]
    return join_markup(
        [
            element("a", "Skip to the verdict", href="#verdict", class_="skip"),
            element("header", element("h1", _run_name(document)), element("p", facts)),
            element(
                "p", element("strong", drawn.summary.last_line), class_=f"band {kind}", id="band"
            ),
            element("nav", join_markup(links, " "), aria_label="Sections"),
        ]
    )


def _sections(
    document: Mapping[str, Any], records: Mapping[str, Record], drawn: Drawn
) -> list[Markup]:
    """Every section in order, under its heading."""
    limits = document["acceptance"]
    without = element("p", f"{drawn.summary.last_line}.")
    parts = {
        "Verdict": [tables.list_limits(limits) if limits else without],
        "Flags": _flags(document),
        "Results": [tables.summary_table(shown) for shown in drawn.summary.tables],
        "Figures": _figures(drawn, rejected=document["verdict"] == "rejected"),
        "Coefficients": tables.list_coefficients(document, records),
        "Uncertainty": tables.list_uncertainties(document),
        "Logs": tables.list_logs(document),
        "Origin": tables.list_origin(document, records),
    }
    return [
        element(
            "section",
            element("h2", name, id=name.lower()),
            Markup("\n"),
            join_markup(parts[name]),
            aria_labelledby=name.lower(),
        )
        for name in SECTIONS
    ]


def _flags(document: Mapping[str, Any]) -> list[Markup]:
    """What must be known before a number is used: flags, and what was left out or corrected."""
    found = list(document["flags"])
    if document["excluded"]:
        found.append(f"{len(document['excluded'])} exclusions of logs or parts of them: see Logs")
    if document["recipe"]["overrides"]:
        found.append("the recipe was changed by --set: see Origin")
    return [tables.list_flags(found) if found else element("p", "No flags.")]


def _figures(drawn: Drawn, *, rejected: bool) -> list[Markup]:
    """Each figure in a frame that takes the focus, with buttons for what the pointer does."""
    drawings, thinned = svg.inline(drawn.figures)
    parts = [element("p", HOW + (THINNED if thinned else ""), class_="how")]
    for number, (figure, drawing) in enumerate(zip(drawn.figures, drawings, strict=True), start=1):
        caption = f"Figure {number}. {figure.get_suptitle()}"
        frame = element(
            "div",
            Markup(drawing),
            class_="frame",
            tabindex="0",
            role="group",
            aria_label=f"{caption} (can be zoomed)",
        )
        mark = [element("strong", "REJECTED. ")] if rejected else []
        parts.append(
            element(
                "figure",
                frame,
                element("div", class_="tools"),
                element("output", class_="reading"),
                element("figcaption", *mark, caption),
            )
        )
    return parts if drawings else [element("p", "No figures were drawn.")]

"""A run's report as one HTML page that opens anywhere: first the verdict, the picture that shows
it, four values and what to check; every number folded below.

It is made of what the text is made of, and of the coefficient files; it loads nothing,
and its content security policy lets it load nothing: no script and no style but its own, which are
named by their digests.
"""

import base64
import functools
import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from calibkit.coefficients import Record
from calibkit.report import html_tables as tables, svg
from calibkit.report.documents import Drawn
from calibkit.report.markup import Markup, element, join_markup

REJECTED = '@media print{@page{@top-center{content:"REJECTED";color:#b00020;font-weight:bold}}}'
"""What a rejected run's page prints on every sheet of paper."""
HOW = (
    "Zoom: Ctrl + wheel, or the wheel alone once a figure is clicked; drag to move; double-click a"
    " panel to fill the figure with it, again for the whole; two fingers on a touch screen; the"
    " numbers below a figure show a panel. Keys: + − arrows, 0 for the whole, 1 to 9 for a panel."
)
_QUOTED = re.compile(r"""("[^"\n]*"|`[^`]*`)""")
_AROUND = re.compile(r" ?([-=,{}()?:;<>&|*+/!]+) ?(?:(?<=[{;,(])\n)?")
_MOST_CHECKS = 6
"""Findings on the first screen."""
THINNED = " Of long curves the extremes of short pieces are drawn; the fit used every point."


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


def page(document: Mapping[str, Any], records: Mapping[str, Record], page_content: Shown) -> bytes:
    """The page of a run as UTF-8: `document` is its run.json but for what cannot know this page
    yet, digest and file list.
    """
    rejected = document["verdict"] == "rejected"
    title = f"{_run_name(document)}, {document['procedure']}"
    frames = _figures(page_content.drawn, rejected=rejected)
    folded = [
        _fold(name, parts) for name, parts in _parts(document, records, page_content, frames[1:])
    ]
    body = [
        _top(document, page_content),
        element(
            "main",
            _first_screen(document, page_content, frames[:1]),
            element("h2", "Details"),
            join_markup(folded),
            id="content",
        ),
    ]
    return whole_page(
        f"REJECTED: {title}" if rejected else title,
        body,
        style=REJECTED if rejected else "",
        script=_own("page.js"),
    )


def first_screen_of(page: str) -> str:
    """The page of a run without what is folded below its first screen, and without its script."""
    first_screen, _, details = page.partition("<h2>Details</h2>")
    return f"{first_screen}</main></body></html>" if details else page


def whole_page(title: str, body: Sequence[Markup], *, style: str = "", script: str = "") -> bytes:
    """A page that loads nothing, as UTF-8: its body under calibkit's own style and what is added to
    it, and a script.
    """
    style = _own("page.css") + style
    head = [
        Markup('<meta charset="utf-8">'),
        Markup(f'<meta http-equiv="Content-Security-Policy" content="{_policy(style, script)}">'),
        Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        Markup('<meta name="color-scheme" content="light dark">'),
        element("title", title),
        Markup(f"<style>{style}</style>"),
    ]
    end = [Markup(f"<script>{script}</script>")] if script else []
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{join_markup(head)}\n</head>\n'
        f"<body>\n{join_markup([*body, *end])}\n</body>\n</html>\n"
    ).encode()


def page_of_parts(title: str, band: str, kind: str, parts: Mapping[str, Sequence[Markup]]) -> bytes:
    """A page of parts below their headings, under a verdict in a band of its colour, as UTF-8."""
    sections = [
        element("section", element("h2", heading), join_markup(content))
        for heading, content in parts.items()
    ]
    body = [
        element("header", element("h1", title)),
        element("p", element("strong", band), class_=f"band {kind}"),
        element("main", join_markup(sections), id="content"),
    ]
    return whole_page(title, body)


def _run_name(document: Mapping[str, Any]) -> str:
    """Serial and revision."""
    return f"{document['serial']} r{document['revision']:03d}"


@functools.cache
def _own(file: str) -> str:
    """Text of a file of this package, without lines of comment and spaces that nobody reads."""
    text = resources.files("calibkit.report").joinpath(file).read_text(encoding="utf-8")
    lines = map(str.strip, text.splitlines())
    code = "\n".join(line for line in lines if line and not line.startswith("//"))
    if file.endswith(".css"):  # there spaces have meanings
        return code
    parts = _QUOTED.split(code)
    parts[::2] = [_AROUND.sub(r"\1", part) for part in parts[::2]]
    return "".join(parts)


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


def _top(document: Mapping[str, Any], page_content: Shown) -> Markup:
    """Whose run this is, and the verdict on it."""
    kind = "open" if document["verdict"] == "no verdict" else document["verdict"]
    summary = page_content.drawn.summary
    facts = [
        summary.title or document["procedure"],
        summary.overview.data_extent,
        f"measured {page_content.measured}" if page_content.measured else "",
        f"effective from {document['effective_from']}",
    ]
    return join_markup(
        [
            element("a", "Skip to the details", href="#results", class_="skip"),
            element(
                "header",
                element("h1", _run_name(document)),
                element("p", " · ".join(filter(None, facts))),
            ),
            element("p", element("strong", summary.last_line), class_=f"band {kind}", id="band"),
        ]
    )


def _first_screen(
    document: Mapping[str, Any], page_content: Shown, frames: Sequence[Markup]
) -> Markup:
    """What was found in a sentence, the picture that shows it, the key values, what to check."""
    summary = page_content.drawn.summary
    overview = summary.overview
    lead = [element("p", overview.sentence, class_="lead")] if overview.sentence else []
    values = [
        element(
            "div",
            element("dt", f"{key_value.name[0].upper()}{key_value.name[1:]}"),
            element("dd", str(key_value)),
        )
        for key_value in overview.values
    ]
    checks = [*summary.checks]
    if document["excluded"]:
        checks.append(f"{len(document['excluded'])} exclusions of logs or parts of them: see Logs")
    if document["recipe"]["overrides"]:
        checks.append("the recipe was changed by --set: see Where this comes from")
    side_column = [element("dl", join_markup(values))] if values else []
    if any(key_value.standard_uncertainty for key_value in overview.values):
        side_column.append(
            element("p", "Digits in brackets: standard uncertainty of the last digits (k = 1).")
        )
    if document["verdict"] == "rejected":
        side_column.append(element("p", "No firmware: the run is rejected"))
    elif page_content.no_firmware:
        side_column.append(element("p", f"No firmware: {page_content.no_firmware}"))
    elif page_content.exported:
        side_column.append(element("p", f"Firmware takes {', '.join(page_content.exported)}"))
    if checks:
        side_column += [
            element("h2", f"Please check ({len(checks)})"),
            tables.list_flags(checks[:_MOST_CHECKS]),
        ]
        if len(checks) > _MOST_CHECKS:
            side_column.append(
                element("p", f"{len(checks) - _MOST_CHECKS} more below, under Notes.")
            )
    else:
        side_column.append(element("p", "Nothing to check."))
    parts = [element("div", join_markup(frames), class_="picture")] if frames else []
    parts.append(element("div", join_markup(side_column), class_="beside"))
    return element(
        "section", *lead, element("div", join_markup(parts), class_="screen"), id="first"
    )


def _parts(
    document: Mapping[str, Any],
    records: Mapping[str, Record],
    page_content: Shown,
    frames: Sequence[Markup],
) -> Iterator[tuple[str, Sequence[Markup]]]:
    """Heading and content of every folded part in order, the exported model first."""
    summary = page_content.drawn.summary
    record_names = page_content.exported or tuple(records)
    exported = [records[name] for name in record_names if name in records and records[name].models]
    if exported:
        yield "Exported model", tables.list_exported(document, exported)
    facts = [element("p", fact) for fact in summary.overview.facts]
    yield "Results", [*facts, *map(tables.summary_table, summary.tables)]
    if frames:
        yield "More figures", frames
    limits = document["acceptance"]
    yield "Limits", [tables.list_limits(limits) if limits else element("p", summary.last_line)]
    flags = list(document["flags"])
    yield "Notes", [tables.list_flags(flags) if flags else element("p", "No notes.")]
    yield "Coefficients", tables.list_coefficients(document, records)
    yield "Uncertainty", tables.list_uncertainties(document)
    yield "Logs", tables.list_logs(document)
    yield "Where this comes from", tables.list_origin(document, records)


def _fold(name: str, parts: Sequence[Markup]) -> Markup:
    """A part of the page behind its heading."""
    key = name.lower().replace(" ", "-")
    return element(
        "details",
        element("summary", element("h3", name, id=key)),
        element("section", join_markup(parts), aria_labelledby=key),
        class_="part",
    )


def _figures(drawn: Drawn, *, rejected: bool) -> list[Markup]:
    """Each figure in a frame that takes the focus, with buttons for what the pointer does."""
    drawings, thinned = svg.inline(drawn.figures)
    parts = []
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
        how = HOW + (THINNED if thinned else "")
        parts.append(
            element(
                "figure",
                frame,
                element("div", class_="tools", title=how),
                element("output", class_="reading"),
                element("figcaption", *mark, caption),
            )
        )
    return parts

"""The page of a run as PDF: the same content and the same figures, typeset by typst."""

from __future__ import annotations

import datetime as dt
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from calibkit.errors import OutputError
from calibkit.libraries import extras

_TEMPLATE = Path(__file__).with_name("report.typ")
_SVG = re.compile(r"<svg\b.*?</svg>", re.DOTALL)
_HEADINGS = {"h1": 1, "h2": 2, "h3": 2, "h4": 3}
_TEXTS = {"p", "li", "dt", "dd", "caption", "figcaption", "th", "td", "pre", *_HEADINGS}
"""Elements whose text is one block or one cell."""
_UNSEEN = {"style", "script", "title"}


class _Blocks(HTMLParser):
    """Blocks of a page in their order: headings, paragraphs, items, key values, tables, figures,
    each a JSON object.
    """

    def __init__(self, drawings: list[str]) -> None:
        super().__init__()
        self.blocks: list[dict[str, Any]] = []
        self._drawings = drawings
        self._table: dict[str, Any] | None = None
        self._row: list[dict[str, Any]] = []
        self._open: list[tuple[str, dict[str, str | None]]] = []
        self._text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begin a table, a row, a text, or place a figure."""
        attributes = dict(attrs)
        if tag == "x-figure":
            drawing = self._drawings[int(attributes["number"] or 0)]
            self.blocks.append({"kind": "figure", "svg": drawing})
        elif tag == "table":
            self._table = {"kind": "table", "rows": [], "heads": 0, "columns": 0, "caption": ""}
        elif tag == "tr":
            self._row = []
        elif tag in _TEXTS or tag in _UNSEEN:
            self._open.append((tag, attributes))
            self._text = []

    def handle_data(self, data: str) -> None:
        """Take text of an open element."""
        self._text.append(data)

    def handle_endtag(self, tag: str) -> None:
        """End what was begun; a text becomes a block, or a cell of the open table."""
        if tag == "tr" and self._table is not None:
            self._table["rows"].append(self._row)
            width = sum(cell["span"] for cell in self._row)
            self._table["columns"] = max(self._table["columns"], width)
        elif tag == "thead" and self._table is not None:
            self._table["heads"] = len(self._table["rows"])
        elif tag == "table" and self._table is not None:
            self.blocks.append(self._table)
            self._table = None
        elif self._open and self._open[-1][0] == tag:
            self._close(*self._open.pop())

    def _close(self, tag: str, attributes: dict[str, str | None]) -> None:
        """Place the text of an element that ends."""
        text = "".join(self._text)
        text = text if tag == "pre" else " ".join(text.split())
        names = (attributes.get("class") or "").split()
        if tag in ("th", "td"):
            span = int(attributes.get("colspan") or 1)
            self._row.append({"text": text, "span": span, "number": "number" in names})
        elif tag == "caption" and self._table is not None:
            self._table["caption"] = text
        elif tag in _HEADINGS:
            self.blocks.append({"kind": "heading", "level": _HEADINGS[tag], "text": text})
        elif tag not in _UNSEEN and text:
            kind = "band" if "band" in names else "lead" if "lead" in names else tag
            self.blocks.append({"kind": kind, "text": text})


def render_page(page: bytes, date: str) -> bytes:
    """PDF of a run's page, the same for the same page; `date` (YYYY-MM-DD) is its only date.

    Raises OutputError without typst.
    """
    text = page.decode("utf-8")
    drawings = [
        drawing.replace(
            "<svg", '<svg xmlns="http://www.w3.org/2000/svg" font-family="DejaVu Sans"', 1
        )
        for drawing in _SVG.findall(text)
    ]
    numbers = iter(range(len(drawings)))
    parser = _Blocks(drawings)
    parser.feed(_SVG.sub(lambda _: f'<x-figure number="{next(numbers)}"></x-figure>', text))
    typst = extras.load_library("typst", "pdf", "a report as PDF needs typst")
    import matplotlib as mpl

    try:
        document: bytes = typst.compile(
            str(_TEMPLATE),
            sys_inputs={"blocks": json.dumps(parser.blocks, ensure_ascii=False)},
            font_paths=[str(Path(mpl.get_data_path()) / "fonts" / "ttf")],
            timestamp=dt.datetime.combine(dt.date.fromisoformat(date), dt.time(), dt.UTC),
        )
    except typst.TypstError as error:
        raise OutputError(f"typst: {error.message}", hint="this is a bug") from error
    return document

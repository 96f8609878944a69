"""Blocks as one HTML page that opens anywhere, by the template page.html.j2.

It loads nothing, and its content security policy lets it load nothing: no script and no style but
its own, which are named by their digests.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import json
import re
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from calibkit.libraries.templates import read_templates
from calibkit.report.blocks import printable
from calibkit.report.run import Shown

if TYPE_CHECKING:
    import jinja2
    from pydantic import TypeAdapter

    from calibkit.report.blocks import Page
    from calibkit.report.table import Table

FOLDER = Path(__file__).parent
REJECTED = '@media print{@page{@top-center{content:"REJECTED";color:#b00020;font-weight:bold}}}'
"""What a rejected run's page prints on every sheet of paper."""
MOST_ROWS = 40
"""Rows of a table beyond which it is folded up."""
_SVG = re.compile(r"<svg\b.*?</svg>", re.DOTALL)
_KEPT = re.compile(r'<script type="application/json">(.*?)</script>', re.DOTALL)


def render(page: Page, kept: Shown | None = None) -> bytes:
    """A page as UTF-8; of a run's it keeps what only the fit knows, for `read_kept`."""
    style = _own("page.css") + (REJECTED if page.standing == "rejected" else "")
    script = _own("page.js")
    text = (
        _templates()
        .get_template("page.html.j2")
        .render(
            page=page,
            style=style,
            script=script,
            policy=_policy(style, script),
            kept="" if kept is None else _dump(kept),
        )
    )
    return printable(text).encode()


def summary_table(table: Table) -> str:
    """A table as HTML."""
    module = _templates().get_template("blocks.html.j2").module
    return printable(module.show_table(table))  # type: ignore[attr-defined] # a macro


def first_screen_of(page: str) -> str:
    """The page of a run without what is folded below its first screen, and without its script."""
    first_screen, _, details = page.partition("<h2>Details</h2>")
    return f"{first_screen}</main></body></html>" if details else page


def _dump(content: Shown) -> str:
    """What a page keeps of a fit, as JSON of ASCII that ends no element of HTML."""
    stored = _kept_type().dump_python(content, exclude_defaults=True)
    return json.dumps(stored, separators=(",", ":")).replace("<", "\\u003c")


@functools.cache
def _kept_type() -> TypeAdapter[Shown]:
    """What writes and reads what a page keeps; to make it takes as long as a page."""
    from pydantic import TypeAdapter

    return TypeAdapter(Shown)


def read_kept(page: str) -> tuple[Shown | None, list[str]]:
    """What the page of a run keeps of its fit, None where an older calibkit wrote it, and its
    figures. Raises ValueError where something else was put there.
    """
    kept = _KEPT.search(page)
    content = None if kept is None else _kept_type().validate_python(json.loads(kept[1]))
    drawings = _SVG.findall(page)
    if content is not None and len(drawings) != len(content.captions):
        raise ValueError(f"{len(drawings)} figures, expected {len(content.captions)}")
    return content, drawings


@functools.cache
def _templates() -> jinja2.Environment:
    """Templates of pages."""
    environment = read_templates(FOLDER, escaped=True)
    environment.globals["most_rows"] = MOST_ROWS
    environment.filters["kind"] = lambda block: type(block).__name__.lower()
    environment.filters["exact_rows"] = _exact_rows
    return environment


def _exact_rows(table: Table) -> list[list[tuple[str, str]]]:
    """Rows of a table: the text of each cell, and of a rounded number its value with every
    digit.
    """
    rows = []
    for texts, row in zip(table.texts, table.rows, strict=True):
        exact = [repr(float(cell)) if isinstance(cell, float) else "" for cell in row]
        pairs = zip_longest(texts, exact, fillvalue="")
        rows.append([(text, number if number != text else "") for text, number in pairs])
    return rows


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

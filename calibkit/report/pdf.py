"""Blocks as PDF, typeset by typst after report.typ: the same content as the page."""

from __future__ import annotations

import datetime as dt
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibkit.errors import OutputError
from calibkit.libraries import extras
from calibkit.report.blocks import describe_block, printable

if TYPE_CHECKING:
    from calibkit.report.blocks import Page

_TEMPLATE = Path(__file__).with_name("report.typ")


def render(page: Page, date: str) -> bytes:
    """A page as PDF, the same bytes for the same page; `date` (YYYY-MM-DD) is its only date.

    Raises OutputError without typst.
    """
    typst = extras.load_library("typst", "pdf", "a report as PDF needs typst")
    import matplotlib as mpl

    content = {
        "title": page.title,
        "subtitle": page.subtitle,
        "verdict": page.verdict,
        "lead": page.lead,
        "standing": page.standing,
        "blocks": [describe_block(block) for block in (*page.first, *page.blocks)],
    }
    try:
        document: bytes = typst.compile(
            str(_TEMPLATE),
            sys_inputs={"page": json.dumps(_printable(content), ensure_ascii=False)},
            font_paths=[str(Path(mpl.get_data_path()) / "fonts" / "ttf")],
            timestamp=dt.datetime.combine(dt.date.fromisoformat(date), dt.time(), dt.UTC),
        )
    except typst.TypstError as error:
        raise OutputError(f"typst: {error.message}", hint="this is a bug") from error
    return document


def _printable(content: Any) -> Any:  # noqa: ANN401 (a value of JSON)
    """A value of JSON with the code of characters that cannot be shown."""
    if isinstance(content, str):
        return printable(content)
    if isinstance(content, dict):
        return {key: _printable(value) for key, value in content.items()}
    return [_printable(part) for part in content] if isinstance(content, list | tuple) else content

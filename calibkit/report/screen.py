"""The first screen of a command: at most 25 lines, the verdict among the first three, one line per
cause of doubt, and what to do next.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from calibkit.errors import visible

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.report.summary import Summary
    from calibkit.report.table import Table

MOST = 25
"""Lines that a command prints at most."""
_FEWEST_ROWS = 6
"""Lines of the table that long findings leave, its heads among them."""
_LONGEST = 3
"""Lines of one finding."""
MORE = "more: --details"


def compose_screen(
    summary: Summary, tail: Sequence[str], width: int, *, most: int = MOST
) -> list[str]:
    """Lines of a screen: whose result, the verdict, what was found, a line per ramp or run, what to
    check, and the tail, as it is.
    """
    shown = summary.overview
    whose = f"{summary.title}{f' · {shown.about}' if shown.about else ''}"
    texts = (whose, summary.last_line, shown.sentence, *shown.facts)
    tables = summary.tables if shown.table is None else (shown.table,)
    return arrange(texts, tables, summary.checks, tail, width, most=most)


def arrange(
    texts: Sequence[str],
    tables: Sequence[Table],
    findings: Sequence[str],
    tail: Sequence[str],
    width: int,
    *,
    most: int = MOST,
) -> list[str]:
    """Lines of a screen of its parts; of rows and findings as many as there is room for, and how
    many more there are.
    """
    head = [line for text in texts for line in wrap(text, width, 2)]
    rows = [
        line
        for table in tables
        for line in ([table.title] if len(tables) > 1 else []) + _align(table, width)
    ]
    found = [wrap(f"- {text}", width, _LONGEST) for text in findings]
    doubts = sum(map(len, found)) + bool(found)
    room = most - len(head) - len(tail)
    rows = shorten(rows, max(room - doubts, min(len(rows), _FEWEST_ROWS)))
    blocks = [[*head], rows, _list_findings(found, room - len(rows)), [*tail]]
    blocks = [block for block in blocks if block]
    apart = sum(map(len, blocks)) + len(blocks) - 1 <= most
    return [
        line
        for at, block in enumerate(blocks)
        for line in (["", *block] if apart and at else block)
    ]


def shorten(lines: Sequence[str], most: int = MOST) -> list[str]:
    """The first lines, and how many more there are where that is not all."""
    if len(lines) <= most:
        return [*lines]
    kept = max(most - 1, 0)
    return [*lines[:kept], f"{len(lines) - kept} {MORE}"][:most]


def _list_findings(found: Sequence[Sequence[str]], most: int) -> list[str]:
    """Findings under their heading as far as there is room, and how many more there are."""
    if not found:
        return []
    lines = [f"Please check ({len(found)})"]
    for at, finding in enumerate(found):
        last = at == len(found) - 1
        if len(lines) + len(finding) > most - (not last):
            return [*lines, f"{len(found) - at} {MORE}"]
        lines += finding
    return lines


def wrap(text: str, width: int, most: int) -> list[str]:
    """A text in lines of a width, at most so many; words and paths are not broken."""
    return textwrap.wrap(
        visible(text),
        width,
        subsequent_indent="  ",
        break_long_words=False,
        break_on_hyphens=False,
        max_lines=most,
        placeholder=" … (--details)",
    )


def _align(table: Table, width: int) -> list[str]:
    """Heads and rows of a table as lines, numbers to the right, with as many columns as fit."""
    rows = [table.heads, *table.texts]
    count = max(map(len, rows))
    cells = [[visible(cell) for cell in (*row, *[""] * (count - len(row)))] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    while len(widths) > 1 and sum(widths) + 2 * len(widths) > width:
        widths.pop()
    return [
        "  ".join(
            cell.rjust(size) if at else cell.ljust(size)
            for at, (cell, size) in enumerate(zip(row, widths, strict=False))
        ).rstrip()
        for row in cells
    ]
